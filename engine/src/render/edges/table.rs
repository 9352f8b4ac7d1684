//! Edges: their faces, and their kind as seen from a viewpoint.
//!
//! An edge is classified by the plane through the viewpoint and the edge. If the opposite vertices of all its faces lie on one side of that
//! plane, the edge is a *contour*: what is behind shows past it. If they lie on both sides, it is a *crease*: both its sides show a face.
//! Normals are not needed.

use glam::{DVec3, Vec3};

use crate::render::accel::PrimId;

/// Attributes at an edge are looked up inside of the face, by this fraction of it: exactly at the edge, a texture that repeats might be
/// looked up on its other side.
pub const INSIDE: f32 = 1e-5;

/// Sampling weight of creases between smoothly shaded faces, relative to contours. The radiance is discontinuous there only at the shadow
/// terminator, where one face is turned away from a light and the other is not.
pub const SMOOTH_CREASE: f32 = 0.05;

/// A face at an edge, or one half of a face that the edge cuts in two.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeFace {
    pub(crate) prim: PrimId,
    /// Barycentric coordinates of the edge's start and end.
    pub ends: [[f32; 3]; 2],
    /// Index of a corner that is not on the edge: for a mesh edge the third corner, for a crossing the corner of this half that is farthest
    /// from the edge.
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

/// The side that a face is taken to show to a viewer in its plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EdgeOn {
    /// The side to which its normal points.
    Front,
    /// The other side.
    Back,
}

/// A face is seen edge-on if the sine of the angle between the line of sight and the face is less than this, the uncertainty of single
/// precision.
const EDGE_ON: f32 = 2e-6;

/// Rounding error of a position relative to its coordinates and its distance, with a margin.
const ROUNDING: f32 = 1e-6;

/// An undirected edge.
#[derive(Clone, Debug)]
pub struct Edge {
    /// Its ends.
    pub p: [Vec3; 2],
    pub(crate) faces: Vec<EdgeFace>,
    /// The edge is a crossing: two surfaces intersect there. Its faces are the two halves of the one surface and then the two halves of the
    /// other; of a surface that ends there, only one half, last. It is a crease from every viewpoint, and its points stay in the planes
    /// of both surfaces.
    pub crossing: bool,
    /// The reflected radiance may be discontinuous across the edge where both its faces are visible.
    pub sharp: bool,
    /// Sampling weight of the edge if nothing is known about the viewpoint, in (0, 1]: its exterior dihedral angle over π/2. Both the
    /// probability that it is a contour and the jump across it as a crease are about in proportion to that angle.
    pub weight: f32,
}

/// An edge as classified from a viewpoint.
#[derive(Clone, Copy, Debug)]
pub struct EdgeView {
    /// Unit normal of the plane through viewpoint and edge, pointing from the covering to the uncovered side
    /// (for a crease: from `foreground` to `background`).
    pub normal: Vec3,
    /// Index into `faces` of the face seen on the side that `normal` points away from.
    pub foreground: usize,
    /// The face seen on the other side, if the edge is a crease.
    pub background: Option<usize>,
    /// The side that faces seen edge-on were taken to show.
    edge_on: Option<EdgeOn>,
}

/// Geometry of an edge and a line of sight to it.
struct ViewFrame {
    /// Unit direction of the edge.
    e: DVec3,
    /// Unit normal of the plane through viewer and edge.
    n: DVec3,
    /// Sine of the angle between the edge and the line of sight.
    sine: f64,
    /// Component of the direction towards the viewer that is perpendicular to the edge, not normalised.
    towards_viewer: DVec3,
    edge_on: Option<EdgeOn>,
}

/// The position of a face relative to the plane through the viewer and the edge.
struct FacePosition {
    /// Whether the face lies on the side that [`ViewFrame::n`] points to.
    above: bool,
    /// Cosine of the angle between the face and the direction towards the viewer, up to a positive factor: of two faces on one side of the
    /// plane, the one with the larger value hides the other.
    nearness: f64,
    /// How far the face is from being seen edge-on, as a length at its opposite corner; not positive if it counts as seen edge-on.
    tilt: f64,
}

impl Edge {
    pub(crate) fn length(&self) -> f32 {
        self.p[0].distance(self.p[1])
    }

    #[inline]
    pub(crate) fn point(&self, s: f32) -> Vec3 {
        self.p[0].lerp(self.p[1], s)
    }

    /// Whether the edge has two faces with consistent winding: they run through the edge in opposite directions.
    pub fn is_wound_consistently(&self) -> bool {
        matches!(self.faces.as_slice(), [a, b] if a.is_forward() != b.is_forward())
    }

    /// Unit normal of the plane through the edge and a point `p`, in the direction (p1 − p0) × (p − p0). Computed in double precision: in a
    /// sliver the two vectors are so nearly parallel that their product in single precision would be mostly rounding error.
    pub fn normal_with(&self, p: Vec3) -> Vec3 {
        let [a, b, p] = [self.p[0], self.p[1], p].map(Vec3::as_dvec3);
        (b - a).cross(p - a).normalize_or_zero().as_vec3()
    }

    /// Unit normal of one of the faces, by the face's winding.
    pub fn face_normal(&self, face: &EdgeFace) -> Vec3 {
        let n = self.normal_with(face.opposite);
        if face.is_forward() { n } else { -n }
    }

    /// The parameter, in [0, 1], of the edge's point that is nearest to `p`.
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

    /// [`Edge::view`] for viewers that may lie in the plane of a face, such as a camera or a light straight above a side of a box. Such a
    /// face is seen edge-on, and the contour is either at its near border or at its far one. If rounding decided at each border, the
    /// contour might be at both or at none. So all edges of the face take it to show the same side, `edge_on`. (Front and back are
    /// those of a mesh that is wound outwards.)
    ///
    /// For a camera use [`EdgeOn::Back`]: the contour is then at the near border, and the radiance on its covering side is the one that
    /// the camera sees. For a light use [`EdgeOn::Front`]: the contour is then at the far border, which may be the foot of the box on a
    /// floor, where the box casts no shadow.
    ///
    /// A line of sight along such a face might hit other parts of the face by rounding, or miss what hides them. So an offset for lines of
    /// sight is returned too; it is zero if no face is seen edge-on. `distance` is the distance of the viewer.
    pub fn view_from(&self, dir: Vec3, distance: f32, edge_on: EdgeOn) -> Option<(EdgeView, Vec3)> {
        let (view, tilt) = self.classify(dir, Some(edge_on))?;
        let reach = ROUNDING * self.p[0].abs().max(self.p[1].abs()).max_element().max(distance);
        // At a contour lines of sight are moved past any face within reach of rounding; at a crease only aside of a face that counted as
        // seen edge-on.
        let slack = if view.background.is_none() { f64::from(reach) } else { 0.0 };
        if tilt > slack {
            return Some((view, Vec3::ZERO));
        }
        let frame = self.view_frame(dir, Some(edge_on))?;
        let along: Vec3 = (0..self.faces.len())
            .filter(|&i| self.face_position(&frame, i).tilt <= slack)
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

    /// The edge's view, and the least [`FacePosition::tilt`] of all faces.
    fn classify(&self, dir: Vec3, edge_on: Option<EdgeOn>) -> Option<(EdgeView, f64)> {
        let frame = self.view_frame(dir, edge_on)?;
        let mut best: [Option<(usize, f64)>; 2] = [None, None];
        let mut least = f64::INFINITY;
        for i in 0..self.faces.len() {
            let FacePosition { above, nearness, tilt } = self.face_position(&frame, i);
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
    fn face_position(&self, frame: &ViewFrame, face: usize) -> FacePosition {
        let face = &self.faces[face];
        let o = face.opposite.as_dvec3() - self.p[0].as_dvec3();
        let o = o - frame.e * o.dot(frame.e);
        let (side, height) = (frame.n.dot(o), o.length());
        let tilt = side.abs() * frame.sine - f64::from(EDGE_ON) * height;
        let above = match frame.edge_on {
            Some(shown) if tilt <= 0.0 => face.is_forward() == (shown == EdgeOn::Front),
            _ => side > 0.0,
        };
        FacePosition { above, nearness: frame.towards_viewer.dot(o) / height, tilt }
    }

    /// All faces on the same side of the edge as `face`, as seen along `dir`: the nearest first, each hiding those after it.
    pub fn layers(&self, dir: Vec3, view: &EdgeView, face: usize) -> Vec<usize> {
        let Some(frame) = self.view_frame(dir, view.edge_on) else { return vec![face] };
        let places: Vec<FacePosition> = (0..self.faces.len()).map(|i| self.face_position(&frame, i)).collect();
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

    /// Primitives of other faces that lie in or below the plane of `face`, where `normal` points up. No ray that leaves `face` upwards hits
    /// them, but because of rounding the intersection test may report a hit for a ray that starts [beside](Edge::beside) the edge at a
    /// grazing angle. So such rays skip them.
    pub fn below(&self, face: usize, normal: Vec3) -> Vec<PrimId> {
        let own = self.faces[face].prim;
        // A face rises if its corner is above the plane by more than rounding: the halves of a quadrilateral lie in one plane.
        let rounding = 1e-6 * self.p[0].abs().max(self.p[1].abs()).max_element();
        let rises = |f: &EdgeFace| {
            let o = f.opposite - self.p[0];
            normal.dot(o) > rounding + 1e-6 * o.length()
        };
        // A triangle that crosses this one has two halves here, one of which rises: rays may hit it.
        let lies = |prim: PrimId| !self.faces.iter().any(|f| f.prim == prim && rises(f));
        self.faces.iter().map(|f| f.prim).filter(|&prim| prim != own && lies(prim)).collect()
    }

    /// The part of the edge between two parameters.
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
    /// All edges at which something may be discontinuous.
    pub edges: Vec<Edge>,
    /// Pairs of coplanar emitters whose common edge is not in the table, because nothing is discontinuous there.
    pub flat_emitters: Vec<[PrimId; 2]>,
}

/// Which edges between faces that join smoothly are in the table, besides those at which radiance may be discontinuous.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seams {
    /// None of them.
    None,
    /// Edges between shapes, and edges at which texture coordinates are discontinuous, whether or not a material depends on them: for
    /// output channels that show shapes or texture coordinates.
    All,
}
