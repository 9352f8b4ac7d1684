//! What an edge is, from wherever it is seen: its faces, its kind, and the points beside it.
//!
//! An edge is classified from a viewpoint without normals: the plane through the viewpoint and the edge has all opposite vertices of the
//! adjacent faces on one side (*contour*) or not (*crease*).

use glam::{DVec3, Vec3};

use crate::render::accel::PrimId;

/// Fraction of a face by which attributes are looked up inside of it: a texture may repeat at its very edge.
pub const INSIDE: f32 = 1e-5;

/// Sampling weight of edges between smoothly shaded faces relative to a silhouette: only the shadow terminator jumps there.
pub const SMOOTH_CREASE: f32 = 0.05;

/// A face at an edge, or one half of a face that the edge cuts in two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeFace {
    pub prim: PrimId,
    /// Barycentric coordinates of the edge's start and end.
    pub ends: [[f32; 3]; 2],
    /// A corner that is not on the edge: for a mesh edge the third one, else the one furthest into this half.
    pub corner: u8,
    /// Its position.
    pub opposite: Vec3,
}

impl EdgeFace {
    /// Whether the face's corners run in the direction of the edge.
    pub fn is_forward(&self) -> bool {
        let next = usize::from(self.corner + 1) % 3;
        self.ends[0][next] > self.ends[1][next]
    }
}

/// The side that a face shows to someone in its plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EdgeOn {
    Front,
    Back,
}

/// Sine of the angle between a direction and a face within which the face is seen edge-on: what single precision leaves uncertain.
const EDGE_ON: f32 = 2e-6;

/// What positions and directions are rounded by, over coordinates and distances, with some to spare.
const ROUNDING: f32 = 1e-6;

/// An undirected edge.
#[derive(Clone, Debug)]
pub struct Edge {
    pub p: [Vec3; 2],
    pub faces: Vec<EdgeFace>,
    /// The edge is where two surfaces cross: of each it has both halves, first of the one, then of the other; of a surface that ends
    /// there, last, the one half that there is. Seen from anywhere it is a crease, and it moves with both surfaces' planes.
    pub crossing: bool,
    /// Reflected radiance may jump across the edge where both its faces are seen.
    pub sharp: bool,
    /// How likely the edge is to matter to someone who looks from anywhere, in (0, 1]: about its exterior dihedral angle over
    /// π/2, for such is the chance that it is a contour and the size of the jump across it.
    pub weight: f32,
}

/// What a viewpoint sees of an edge.
#[derive(Clone, Copy, Debug)]
pub struct EdgeView {
    /// Unit normal of the plane through viewpoint and edge, pointing from the covering to the uncovered side
    /// (for a crease: from `foreground` to `background`).
    pub normal: Vec3,
    /// Index into `faces` of the face seen on the side that `normal` points away from.
    pub foreground: usize,
    /// The face seen on the other side, if the edge is a crease.
    pub background: Option<usize>,
    /// How faces seen edge-on were taken.
    edge_on: Option<EdgeOn>,
}

/// An edge as seen along a direction.
struct ViewFrame {
    /// Unit direction of the edge.
    e: DVec3,
    /// Unit normal of the plane through viewer and edge.
    n: DVec3,
    /// Of the angle between edge and line of sight.
    sine: f64,
    /// Perpendicular to the edge, of any length.
    towards_viewer: DVec3,
    edge_on: Option<EdgeOn>,
}

/// Where a face lies in the plane perpendicular to the edge.
struct FacePlace {
    /// On the side that [`ViewFrame::n`] points to.
    above: bool,
    /// The more, the smaller is the angle to the direction towards the viewer.
    nearness: f64,
    /// How far the face's opposite corner, at its height over the edge, is out of the plane of someone who sees it edge-on.
    tilt: f64,
}

impl Edge {
    pub fn length(&self) -> f32 {
        self.p[0].distance(self.p[1])
    }

    #[inline]
    pub fn point(&self, s: f32) -> Vec3 {
        self.p[0].lerp(self.p[1], s)
    }

    /// Whether two faces run through their edge in opposite directions, as on an oriented surface.
    pub fn is_wound_consistently(&self) -> bool {
        matches!(self.faces.as_slice(), [a, b] if a.is_forward() != b.is_forward())
    }

    /// Unit normal of the plane through the edge and a point, on the side from which the point lies to the left. (Slivers have edges so
    /// nearly parallel that single precision would leave little of it.)
    pub fn normal_with(&self, p: Vec3) -> Vec3 {
        let [a, b, p] = [self.p[0], self.p[1], p].map(Vec3::as_dvec3);
        (b - a).cross(p - a).normalize_or_zero().as_vec3()
    }

    /// Unit normal of one of the faces, oriented like the face.
    pub fn face_normal(&self, face: &EdgeFace) -> Vec3 {
        let n = self.normal_with(face.opposite);
        if face.is_forward() { n } else { -n }
    }

    /// The parameter of a point on the edge.
    pub(super) fn parameter(&self, p: Vec3) -> f32 {
        let e = self.p[1] - self.p[0];
        ((p - self.p[0]).dot(e) / e.length_squared()).clamp(0.0, 1.0)
    }

    /// Unit direction from start to end.
    pub fn direction(&self) -> Vec3 {
        (self.p[1] - self.p[0]).normalize()
    }

    /// Classifies the edge as seen along `dir` (unit, from the viewer to a point of the edge). `None` if the viewer looks along the edge.
    pub fn view(&self, dir: Vec3) -> Option<EdgeView> {
        self.classify(dir, None).map(|(view, _)| view)
    }

    /// [`Edge::view`] for viewers that may well be in the plane of a face, as cameras and lights above the side of a box are. The face
    /// shows them nothing; a contour lies at its near border or at its far one, and rounding, which would decide at each anew, may
    /// have it at both or at none. So the face is said to show one side, at all its edges alike. (Front and back are those of meshes that
    /// are wound outwards.)
    ///
    /// To a camera `EdgeOn::Back`: the contour is then at the near border of a box's side, in front of which the radiance is the one
    /// that is seen. To a light `EdgeOn::Front`: it is at the far border, which may be the box's foot on the floor, where there is
    /// no shadow.
    ///
    /// Lines of sight along such a face would hit its other parts by rounding, or miss what hides it: returns too by how much to move
    /// them aside (zero if there is no such face). `distance` is the viewer's.
    pub fn view_from(&self, dir: Vec3, distance: f32, edge_on: EdgeOn) -> Option<(EdgeView, Vec3)> {
        let (view, tilt) = self.classify(dir, Some(edge_on))?;
        let reach = ROUNDING * self.p[0].abs().max(self.p[1].abs()).max_element().max(distance);
        // Past a contour that is looked past, beside a crease only if its face was taken to be seen edge-on.
        let slack = if view.background.is_none() { f64::from(reach) } else { 0.0 };
        if tilt > slack {
            return Some((view, Vec3::ZERO));
        }
        let frame = self.view_frame(dir, Some(edge_on))?;
        let along: Vec3 = (0..self.faces.len())
            .filter(|&i| self.face_place(&frame, i).tilt <= slack)
            .map(|i| self.face_normal(&self.faces[i]))
            .sum();
        let aside = match (view.background, edge_on) {
            _ if along == Vec3::ZERO => Vec3::ZERO,
            (None, _) => view.normal,
            (Some(_), EdgeOn::Front) => along,
            (Some(_), EdgeOn::Back) => -along,
        };
        Some((view, aside * reach))
    }

    /// The view, and the least [`FacePlace::tilt`] of all faces.
    fn classify(&self, dir: Vec3, edge_on: Option<EdgeOn>) -> Option<(EdgeView, f64)> {
        let frame = self.view_frame(dir, edge_on)?;
        let mut best: [Option<(usize, f64)>; 2] = [None, None];
        let mut least = f64::INFINITY;
        for i in 0..self.faces.len() {
            let FacePlace { above, nearness, tilt } = self.face_place(&frame, i);
            least = least.min(tilt);
            let slot = &mut best[usize::from(above)];
            if slot.is_none_or(|(_, c)| nearness > c) {
                *slot = Some((i, nearness));
            }
        }
        let normal = frame.n.as_vec3();
        let (normal, foreground, background) = match best {
            [Some((f, _)), None] => (normal, f, None),
            [None, Some((f, _))] => (-normal, f, None),
            [Some((f, _)), Some((b, _))] => (normal, f, Some(b)),
            [None, None] => return None,
        };
        Some((EdgeView { normal, foreground, background, edge_on }, least))
    }

    #[inline]
    fn view_frame(&self, dir: Vec3, edge_on: Option<EdgeOn>) -> Option<ViewFrame> {
        let e = (self.p[1] - self.p[0]).as_dvec3();
        let d = dir.as_dvec3();
        let n = e.cross(d);
        let (length, reach) = (e.length(), n.length());
        if reach <= 1e-9 * length {
            return None;
        }
        let e = e / length;
        Some(ViewFrame { e, n: n / reach, sine: reach / length, towards_viewer: e * d.dot(e) - d, edge_on })
    }

    #[inline]
    fn face_place(&self, frame: &ViewFrame, face: usize) -> FacePlace {
        let face = &self.faces[face];
        let o = face.opposite.as_dvec3() - self.p[0].as_dvec3();
        let o = o - frame.e * o.dot(frame.e);
        let (side, height) = (frame.n.dot(o), o.length());
        let tilt = side.abs() * frame.sine - f64::from(EDGE_ON) * height;
        let above = match frame.edge_on {
            Some(shown) if tilt <= 0.0 => face.is_forward() == (shown == EdgeOn::Front),
            _ => side > 0.0,
        };
        FacePlace { above, nearness: frame.towards_viewer.dot(o) / height, tilt }
    }

    /// The face and all those that it hides from a viewer who looks along `dir`, nearest first.
    pub fn layers(&self, dir: Vec3, view: &EdgeView, face: usize) -> Vec<usize> {
        let Some(frame) = self.view_frame(dir, view.edge_on) else { return vec![face] };
        let places: Vec<FacePlace> = (0..self.faces.len()).map(|i| self.face_place(&frame, i)).collect();
        let mut layers: Vec<usize> = (0..places.len()).filter(|&i| places[i].above == places[face].above).collect();
        layers.sort_by(|&i, &j| places[j].nearness.total_cmp(&places[i].nearness).then(i.cmp(&j)));
        layers
    }

    /// Primitives of all faces at the edge.
    pub fn prims(&self) -> Vec<PrimId> {
        self.faces.iter().map(|f| f.prim).collect()
    }

    /// Barycentric coordinates on a face of the edge's point at `s`, moved into the face by the fraction `inset`.
    pub fn barycentric(&self, face: usize, s: f32, inset: f32) -> [f32; 3] {
        let EdgeFace { ends: [start, end], corner, .. } = self.faces[face];
        let mut b: [f32; 3] = std::array::from_fn(|i| (start[i] * (1.0 - s) + end[i] * s) * (1.0 - inset));
        b[usize::from(corner)] += inset;
        b
    }

    /// Primitives of other faces that lie below the plane of `face`, on the side that `normal` points away from: no ray that leaves the
    /// face upwards meets them. Where it starts [beside](Edge::beside) the edge at a grazing angle, rounding would have it do so.
    pub fn below(&self, face: usize, normal: Vec3) -> Vec<PrimId> {
        let own = self.faces[face].prim;
        // By more than corners are rounded: halves of a quadrilateral are one plane.
        let rounding = 1e-6 * self.p[0].abs().max(self.p[1].abs()).max_element();
        let rises = |f: &EdgeFace| {
            let o = f.opposite - self.p[0];
            normal.dot(o) > rounding + 1e-6 * o.length()
        };
        // Of a triangle that crosses this one both halves are faces, and one rises.
        let lies = |prim: PrimId| !self.faces.iter().any(|f| f.prim == prim && rises(f));
        self.faces.iter().map(|f| f.prim).filter(|&prim| prim != own && lies(prim)).collect()
    }

    /// The part between two of its parameters.
    pub(super) fn part(&self, from: f32, to: f32) -> Edge {
        let mut part = self.clone();
        part.p = [from, to].map(|s| self.point(s));
        for (i, face) in part.faces.iter_mut().enumerate() {
            face.ends = [from, to].map(|s| self.barycentric(i, s, 0.0));
        }
        part
    }
}

/// All edges of a scene.
pub struct EdgeTable {
    pub edges: Vec<Edge>,
    /// Emitters of one plane whose common edge is none of them.
    pub flat_emitters: Vec<[PrimId; 2]>,
}

/// Which edges of a smooth or flat surface there are, besides those at which light may jump.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seams {
    None,
    /// Those between shapes, and where texture coordinates jump, whether or not anything is made of them: for channels that show these.
    All,
}
