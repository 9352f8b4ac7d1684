//! Finds bodies of glass that are none, for a warning. Light that meets a `dielectric` goes into what lies behind its faces, so that the surface has to
//! be closed, and its faces have to turn outwards.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use crate::mesh::{Mesh, ops};
use crate::render::accel::{Accel, Ray};
use crate::render::{MaterialKind, SceneDescription};

/// What is wrong with the surface of a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Flaw {
    /// It has a hole: light goes in and never comes out.
    Open,
    /// All of its faces turn inwards.
    InsideOut,
    /// Some faces turn inwards, others outwards.
    Mixed,
    /// A face lies where this shape of the scene, of whatever material, has one too. It may be the same shape.
    Shared(usize),
}

/// Triangles up to which bodies are looked at.
const MOST: usize = 1 << 22;

/// Holes smaller than this share of a surface are the seams of meshes that nearly fit together.
const SMALLEST_HOLE: f64 = 1e-4;

/// How near one another two faces are in one place, as a share of their coordinates' largest: rays that begin on one of them miss the other.
const SAME_PLACE: f32 = 4e-6;

/// The sine of the angle from which on faces that meet are not in one place.
const PARALLEL: f64 = 1e-3;

/// The cosine of the angle from their mean up to which the normals of a sheet turn: 78 degrees.
const SHEET: f64 = 0.2;

/// One triangle of a body.
struct Face {
    /// Index into the bodies.
    body: usize,
    /// Its corners, as numbers of positions.
    corners: [u32; 3],
    /// Its normal, as long as its area.
    area: DVec3,
}

impl Face {
    /// Whether it goes along an edge from its first end to its second.
    fn is_along(&self, edge: [u32; 2]) -> bool {
        (0..3).any(|k| [self.corners[k], self.corners[(k + 1) % 3]] == edge)
    }
}

/// Shapes of glass with what is wrong with them. Surfaces of several shapes may close each other. A body that is named here is wrong; others may be
/// so too: a sheet (water up to the horizon) is none that could be closed, and what lies within another body may be a bubble.
pub(super) fn flawed(description: &SceneDescription) -> Vec<(usize, Flaw)> {
    let is_glass = |kind: &MaterialKind| matches!(kind, MaterialKind::Dielectric { .. });
    let shapes = description.shapes.iter().enumerate();
    let bodies: Vec<(usize, &Mesh)> =
        shapes.filter(|(_, s)| is_glass(&s.material.kind)).map(|(i, shape)| (i, &shape.mesh)).collect();
    if bodies.is_empty() || bodies.iter().map(|(_, mesh)| mesh.faces.len()).sum::<usize>() > MOST {
        return Vec::new();
    }
    let mut found = Surface::new(&bodies).flaws();
    for (body, other) in shared(description, &bodies) {
        found[body].get_or_insert(Flaw::Shared(other));
    }
    bodies.iter().zip(found).filter_map(|((shape, _), flaw)| Some((*shape, flaw?))).collect()
}

/// The shapes in whose place faces of bodies lie: an index into the bodies, and one of a shape. Two bodies are named once, by the later one. (A face
/// is compared by short rays through some of its points. Surfaces that cross are not meant: light passes one after the other.)
fn shared(description: &SceneDescription, bodies: &[(usize, &Mesh)]) -> Vec<(usize, usize)> {
    let corners = |mesh: &Mesh, face: [u32; 3]| face.map(|i| mesh.vertices[i as usize]);
    let vertices = bodies.iter().flat_map(|(_, mesh)| &mesh.vertices);
    let (low, high) = vertices.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)));
    let reach = SAME_PLACE * low.abs().max(high.abs()).max_element();
    let is_near = |p: [Vec3; 3]| {
        let (from, to) = (p[0].min(p[1]).min(p[2]), p[0].max(p[1]).max(p[2]));
        from.cmple(high + reach).all() && to.cmpge(low - reach).all()
    };
    let (mut triangles, mut shapes) = (Vec::new(), Vec::new());
    for (i, shape) in description.shapes.iter().enumerate() {
        let near = shape.mesh.faces.iter().map(|face| corners(&shape.mesh, *face)).filter(|p| is_near(*p));
        triangles.extend(near);
        shapes.resize(triangles.len(), i);
    }
    if triangles.len() > MOST {
        return Vec::new();
    }
    let tree = Accel::new(&triangles);
    let area = |p: [Vec3; 3]| {
        let [a, b, c] = p.map(|p| p.as_dvec3());
        (b - a).cross(c - a)
    };
    let mut found = Vec::new();
    for (i, p) in triangles.iter().enumerate() {
        let Some(normal) = area(*p).try_normalize() else { continue };
        // The middle, and a point towards each corner.
        for weights in [[1.0; 3], [4.0, 1.0, 1.0], [1.0, 4.0, 1.0], [1.0, 1.0, 4.0]] {
            let p = (weights[0] * p[0] + weights[1] * p[1] + weights[2] * p[2]) / weights.iter().sum::<f32>();
            let (reach, dir) = (SAME_PLACE * p.abs().max_element(), normal.as_vec3());
            let ray = Ray { origin: p - reach * dir, dir, t_min: 0.0, t_max: 2.0 * reach };
            let Some(hit) = tree.closest(&ray, &[i as u32]) else { continue };
            let other = area(triangles[hit.prim as usize]);
            if normal.cross(other).length() < PARALLEL * other.length() {
                let [a, b] = [i, hit.prim as usize].map(|i| shapes[i]);
                let (earlier, later) = (a.min(b), a.max(b));
                let body = |shape| bodies.iter().position(|(of, _)| *of == shape);
                let pair = body(later).map(|body| (body, earlier));
                found.extend(pair.or_else(|| body(earlier).map(|body| (body, later))));
            }
        }
    }
    found
}

/// The surfaces of all bodies, welded where they have equal positions.
struct Surface {
    bodies: usize,
    positions: Vec<DVec3>,
    faces: Vec<Face>,
}

/// Faces that hang together.
struct Piece {
    /// The body of the first of its faces.
    body: usize,
    low: DVec3,
    high: DVec3,
    /// Six times its volume, less than 0 where faces turn inwards.
    volume: f64,
    /// Every edge has two faces or more, which do not disagree.
    is_closed: bool,
}

impl Surface {
    fn new(bodies: &[(usize, &Mesh)]) -> Surface {
        let vertices: Vec<DVec3> = bodies.iter().flat_map(|(_, mesh)| &mesh.vertices).map(|v| v.as_dvec3()).collect();
        let (place, count) = ops::weld(&vertices);
        let mut positions = vec![DVec3::ZERO; count];
        place.iter().zip(&vertices).for_each(|(at, v)| positions[*at as usize] = *v);
        let (mut faces, mut first) = (Vec::new(), 0);
        for (body, (_, mesh)) in bodies.iter().enumerate() {
            for face in &mesh.faces {
                let corners = face.map(|i| place[first + i as usize]);
                let [a, b, c] = corners.map(|i| positions[i as usize]);
                // Triangles without an area, such as those around the pole of a sphere, are no part of the surface.
                if a != b && b != c && c != a {
                    faces.push(Face { body, corners, area: 0.5 * (b - a).cross(c - a) });
                }
            }
            first += mesh.vertices.len();
        }
        Surface { bodies: bodies.len(), positions, faces }
    }

    /// What is wrong with each body.
    fn flaws(&self) -> Vec<Option<Flaw>> {
        let (sheets, mut pieces) = (self.sheets(), self.pieces());
        let mut flaws = vec![None; self.bodies];
        let mut ends = Vec::new();
        for around in self.edges().chunk_by(|a, b| a.0 == b.0) {
            let edge = around[0].0;
            let is_along = |face: u32| self.faces[face as usize].is_along(edge);
            let body = self.faces[around[0].1 as usize].body;
            let is_closed = match around[..] {
                [_] if sheets[body] => false,
                [end] => {
                    ends.push(end);
                    false
                }
                [(_, a), (_, b)] if is_along(a) == is_along(b) => {
                    flaws[body] = Some(Flaw::Mixed);
                    false
                }
                // Where there are more than two, several surfaces meet.
                _ => true,
            };
            pieces.of(edge[0]).is_closed &= is_closed;
        }
        for body in self.holes(&ends) {
            flaws[body].get_or_insert(Flaw::Open);
        }
        let pieces = pieces.found;
        let is_within = |piece: &Piece| {
            pieces.iter().any(|other| other.low.cmplt(piece.low).all() && piece.high.cmplt(other.high).all())
        };
        for piece in pieces.iter().filter(|piece| piece.is_closed && piece.volume < 0.0 && !is_within(piece)) {
            flaws[piece.body].get_or_insert(Flaw::InsideOut);
        }
        flaws
    }

    /// The edges of all faces, sorted, with the face of each. (Unlike `ops::edges` this has no list for each edge, which took most of the time.)
    fn edges(&self) -> Vec<([u32; 2], u32)> {
        let mut edges = Vec::with_capacity(3 * self.faces.len());
        for (i, face) in self.faces.iter().enumerate() {
            let [a, b, c] = face.corners;
            edges.extend([[a, b], [b, c], [c, a]].map(|[a, b]| ([a.min(b), a.max(b)], i as u32)));
        }
        edges.sort_unstable();
        edges
    }

    /// The pieces of which the surfaces consist.
    fn pieces(&self) -> Pieces {
        let count = self.positions.len();
        let mut connected = Connected::new(count);
        for [a, b, c] in self.faces.iter().map(|face| face.corners) {
            connected.join([a, b]);
            connected.join([b, c]);
        }
        let mut pieces = Pieces { connected, index: vec![NONE; count], found: Vec::new() };
        for face in &self.faces {
            let corners = face.corners.map(|i| self.positions[i as usize]);
            let piece = pieces.of_or(face.corners[0], || Piece {
                body: face.body,
                low: corners[0],
                high: corners[0],
                volume: 0.0,
                is_closed: true,
            });
            for corner in corners {
                (piece.low, piece.high) = (piece.low.min(corner), piece.high.max(corner));
            }
        }
        for face in &self.faces {
            let piece = pieces.of(face.corners[0]);
            let middle = 0.5 * (piece.low + piece.high);
            let [a, b, c] = face.corners.map(|i| self.positions[i as usize] - middle);
            piece.volume += a.dot(b.cross(c));
        }
        pieces
    }

    /// Which surfaces look the same way all over.
    fn sheets(&self) -> Vec<bool> {
        let mut sums = vec![DVec3::ZERO; self.bodies];
        self.faces.iter().for_each(|face| sums[face.body] += face.area);
        let mut is_sheet = vec![true; sums.len()];
        for face in self.faces.iter().filter(|face| face.area != DVec3::ZERO) {
            let sum = sums[face.body];
            // (A tube's sum is 0: that is no sheet.)
            is_sheet[face.body] &= face.area.dot(sum) > SHEET * face.area.length() * sum.length();
        }
        is_sheet
    }

    /// The bodies with holes. `ends` are the edges with one face, and that face: they go around holes. The size of a hole is that of the vector that its
    /// rim has for an area, ½ Σ a × b, so that a seam, which goes along a line and back, is none.
    fn holes(&self, ends: &[([u32; 2], u32)]) -> Vec<usize> {
        let mut areas = vec![0.0; self.bodies];
        self.faces.iter().for_each(|face| areas[face.body] += face.area.length());
        let mut rims = Connected::new(self.positions.len());
        ends.iter().for_each(|(edge, _)| rims.join(*edge));
        let mut found: HashMap<u32, (DVec3, usize)> = HashMap::new();
        // How many edges go out of a position more than into it: rims that do not go round are left.
        let mut balance: HashMap<u32, i32> = HashMap::new();
        for &(edge, face) in ends {
            let face = &self.faces[face as usize];
            let [a, b] = if face.is_along(edge) { edge } else { [edge[1], edge[0]] };
            *balance.entry(a).or_default() += 1;
            *balance.entry(b).or_default() -= 1;
            let rim = rims.of(a);
            let middle = self.positions[rim as usize];
            let [a, b] = [a, b].map(|i| self.positions[i as usize] - middle);
            found.entry(rim).or_insert((DVec3::ZERO, face.body)).0 += 0.5 * a.cross(b);
        }
        for (position, balance) in balance {
            if balance != 0 {
                found.remove(&rims.of(position));
            }
        }
        found
            .into_values()
            .filter(|(area, body)| area.length() > SMALLEST_HOLE * areas[*body])
            .map(|hole| hole.1)
            .collect()
    }
}

/// Which positions hang together by edges: for each one that it hangs together with, at last the one that stands for all of them.
struct Connected(Vec<u32>);

impl Connected {
    fn new(positions: usize) -> Connected {
        Connected((0..positions as u32).collect())
    }

    /// The position that stands for all that hang together with this one.
    fn of(&mut self, position: u32) -> u32 {
        let mut at = position as usize;
        while self.0[at] as usize != at {
            // Each way is halved when it is gone, so that none is long.
            self.0[at] = self.0[self.0[at] as usize];
            at = self.0[at] as usize;
        }
        at as u32
    }

    fn join(&mut self, edge: [u32; 2]) {
        let [a, b] = edge.map(|position| self.of(position));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

/// No piece yet.
const NONE: u32 = u32::MAX;

/// Pieces by the position that stands for all of theirs.
struct Pieces {
    connected: Connected,
    index: Vec<u32>,
    found: Vec<Piece>,
}

impl Pieces {
    /// The piece with that position, or a new one.
    fn of_or(&mut self, position: u32, new: impl FnOnce() -> Piece) -> &mut Piece {
        let at = &mut self.index[self.connected.of(position) as usize];
        if *at == NONE {
            *at = self.found.len() as u32;
            self.found.push(new());
        }
        &mut self.found[*at as usize]
    }

    /// The piece with that position, which is there.
    fn of(&mut self, position: u32) -> &mut Piece {
        let at = self.index[self.connected.of(position) as usize];
        &mut self.found[at as usize]
    }
}
