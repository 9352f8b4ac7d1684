//! Meshes: built-in shapes that are differentiable in their sizes, mesh files, and operations on vertices and normals.

use std::sync::Arc;

use glam::DVec3;

use crate::memory;
use crate::mesh::{Mesh, MeshError, ops, shapes};
use crate::tape::{CustomOp, TapeError, Tensor, Var};

use super::linear::{about, affine_parts, euler, identity};
use super::measures::bounds;
use super::value::{MeshValue, Value};
use super::{Args, Native, NativeError, Result};

pub(super) const TABLE: &[(&str, Native)] = &[
    ("mesh", mesh_from_arrays),
    ("rectangle", |a| sized(shapes::rectangle(1.0, 1.0), [size(a, "width", 2.0)?, 1.0.into(), size(a, "depth", 2.0)?])),
    ("cube", |a| {
        let size = match a.get(0) {
            Some(_) => a.vector(0, 3, true)?,
            None => Var::constant(Tensor::full(&[3], 1.0)),
        };
        positive(0, "size", &size)?;
        give(stretched(&(&shapes::cube(1.0).map_err(mesh_error)?).into(), &size)?)
    }),
    ("sphere", |a| {
        let n = a.named_integer("subdivisions", 3..=1 << 16)?.unwrap_or(32) as usize;
        uniform(shapes::sphere(1.0, n), size(a, "radius", 1.0)?)
    }),
    ("icosphere", |a| {
        let n = a.named_integer("subdivisions", 0..=30)?.unwrap_or(3) as usize;
        uniform(shapes::icosphere(1.0, n), size(a, "radius", 1.0)?)
    }),
    ("disk", |a| {
        let n = a.named_integer("subdivisions", 3..=1 << 16)?.unwrap_or(32) as usize;
        uniform(shapes::disk(1.0, n), size(a, "radius", 1.0)?)
    }),
    ("cylinder", |a| {
        let n = a.named_integer("subdivisions", 3..=1 << 16)?.unwrap_or(32) as usize;
        let r = size(a, "radius", 1.0)?;
        let open = a.boolean("caps")? == Some(false);
        let unit = shapes::cylinder(1.0, 1.0, n).map(|m| if open { without_caps(m, |y| y.abs() > 0.25) } else { m });
        sized(unit, [r.clone(), size(a, "height", 2.0)?, r])
    }),
    ("cone", |a| {
        let n = a.named_integer("subdivisions", 3..=1 << 16)?.unwrap_or(32) as usize;
        let r = size(a, "radius", 1.0)?;
        let open = a.boolean("caps")? == Some(false);
        let unit = shapes::cone(1.0, 1.0, n).map(|m| if open { without_caps(m, |y| y < 0.0) } else { m });
        sized(unit, [r.clone(), size(a, "height", 2.0)?, r])
    }),
    ("torus", torus),
    ("grid", |a| {
        let columns = a.named_integer("columns", 1..=1 << 24)?.unwrap_or(16) as usize;
        let rows = a.named_integer("rows", 1..=1 << 24)?.unwrap_or(16) as usize;
        let (w, d) = (size(a, "width", 2.0)?, size(a, "depth", 2.0)?);
        sized(shapes::grid(columns, rows, 1.0, 1.0), [w, 1.0.into(), d])
    }),
    ("heightfield", heightfield),
    ("teapot", |a| {
        let n = a.named_integer("subdivisions", 1..=1 << 16)?.unwrap_or(8) as usize;
        give((&shapes::teapot(n).map_err(mesh_error)?).into())
    }),
    ("translate", |a| {
        let offset = a.vector(1, 3, false)?;
        keyframes(a, |m| Ok(MeshValue { vertices: m.vertices.add(&offset)?, ..m.clone() }))
    }),
    ("rotate", rotate),
    ("scale", |a| {
        let factor = a.vector(1, 3, true)?;
        if factor.value().data.contains(&0.0) {
            return Err(NativeError::at(1, "a mesh scaled by 0 has no surface"));
        }
        keyframes(a, |m| stretched(m, &factor))
    }),
    ("transform", |a| transformed(a.mesh(0)?, a.value(1)?, 1)),
    ("flip", |a| match a.value(0)? {
        Value::Mesh(_) => keyframes(a, |m| Ok(flipped(m))),
        _ => super::images::flip(a),
    }),
    ("smooth_normals", |a| keyframes(a, |m| Ok(MeshValue { normals: Some(smooth_normals(m)?), ..m.clone() }))),
    ("flat_normals", |a| keyframes(a, |m| Ok(MeshValue { normals: None, ..m.clone() }))),
    ("subdivide", subdivide),
    ("merge", |a| {
        let parts: Vec<Value> = match (a.value(0)?, a.get(1)) {
            (Value::List(items), None) => items.to_vec(),
            (first, None) => vec![first.clone()],
            (first, Some(second)) => vec![first.clone(), second.clone()],
        };
        let meshes: Option<Vec<&MeshValue>> = parts
            .iter()
            .map(|p| match p {
                Value::Mesh(m) => Some(&**m),
                _ => None,
            })
            .collect();
        give(merged(&meshes.ok_or_else(|| a.wrong(0, "a mesh or an array of meshes"))?)?)
    }),
    ("center", |a| give(centered(a.mesh(0)?)?)),
    ("laplacian_energy", laplacian_energy),
    ("edge_length_energy", edge_length_energy),
    ("normal_consistency", normal_consistency),
];

fn give(mesh: MeshValue) -> Result<Value> {
    Ok(Value::Mesh(Arc::new(mesh)))
}

/// Applies a function to the first argument, a mesh; to both keyframes if it moves.
fn keyframes(a: &Args, f: impl Fn(&MeshValue) -> Result<MeshValue>) -> Result<Value> {
    both(a.mesh(0)?, f)
}

/// A mesh transformed by a transform, rotation or matrix. For anything else, an error that blames argument `blame`.
pub(super) fn transformed(mesh: &MeshValue, by: &Value, blame: usize) -> Result<Value> {
    let (linear, offset) = affine_parts(by, blame)?;
    let rigid = matches!(by, Value::Rotation(_));
    both(mesh, |m| moved(m, &linear, offset.as_ref(), rigid, blame))
}

/// Applies a function to a mesh; to both keyframes if it moves.
fn both(mesh: &MeshValue, f: impl Fn(&MeshValue) -> Result<MeshValue>) -> Result<Value> {
    let closing = mesh.closing.as_ref().map(|m| f(m).map(Arc::new)).transpose()?;
    give(MeshValue { closing, ..f(mesh)? })
}

/// A mesh that moves from an opening to a closing keyframe.
pub(super) fn moving(a: &Args) -> Result<Value> {
    let (opening, closing) = (a.mesh(0)?, a.mesh(1)?);
    for (i, mesh) in [opening, closing].into_iter().enumerate() {
        if mesh.closing.is_some() {
            return Err(super::scene::moves_already(a, i, "meshes"));
        }
    }
    let count = |m: &MeshValue| (m.vertices.shape()[0], m.faces.len());
    if count(opening) != count(closing) || opening.faces != closing.faces {
        let ((v, f), (w, g)) = (count(opening), count(closing));
        let message = if (v, f) == (w, g) {
            "the keyframes join their vertices to triangles in different ways".to_owned()
        } else {
            format!("the keyframes are different meshes: {v} vertices and {f} triangles, then {w} and {g}")
        };
        let help = "write one mesh and move it: `moving(ball, ball |> translate([1, 0, 0]))`";
        return Err(NativeError::at(1, message).help(help));
    }
    if opening.normals.is_some() != closing.normals.is_some() {
        let help = "`smooth_normals` or `flat_normals` on both makes them alike";
        return Err(NativeError::at(1, "one keyframe has normals, the other has none").help(help));
    }
    give(MeshValue { closing: Some(Arc::new(closing.clone())), ..opening.clone() })
}

fn mesh_error(e: MeshError) -> NativeError {
    NativeError::new(e.to_string())
}

fn positive(index: usize, name: &str, v: &Var) -> Result<()> {
    match v.value().data.iter().find(|x| !(x.is_finite() && **x > 0.0)) {
        Some(x) => Err(NativeError::at(index, format!("`{name}` must be positive, this is {x}"))),
        None => Ok(()),
    }
}

/// An argument that must be a positive length.
fn size(a: &Args, name: &str, default: f64) -> Result<Var> {
    match a.named(name) {
        None => Ok(Var::from(default)),
        Some((index, _)) => {
            let v = a.scalar(index)?;
            positive(index, name, &v)?;
            Ok(v)
        }
    }
}

fn sized(unit: Result<Mesh, MeshError>, [x, y, z]: [Var; 3]) -> Result<Value> {
    let unit = MeshValue::from(&unit.map_err(mesh_error)?);
    give(stretched(&unit, &Var::stack(&[x, y, z])?)?)
}

/// Scales uniformly; normals do not change.
fn uniform(unit: Result<Mesh, MeshError>, factor: Var) -> Result<Value> {
    let unit = MeshValue::from(&unit.map_err(mesh_error)?);
    give(MeshValue { vertices: unit.vertices.mul(&factor)?, ..unit })
}

/// Scales along the axes; normals are scaled by the inverse.
fn stretched(mesh: &MeshValue, factor: &Var) -> Result<MeshValue> {
    let mirrored = factor.value().data.iter().product::<f64>() < 0.0;
    let normals = match &mesh.normals {
        Some(n) => {
            let [x, y, z] = factor.value().data[..] else { return Err(NativeError::new("a scale has 3 factors")) };
            let alike = !factor.is_live() && x == y && y == z && x > 0.0;
            Some(if alike { n.clone() } else { n.div(factor)?.normalize()? })
        }
        None => None,
    };
    let scaled = MeshValue { vertices: mesh.vertices.mul(factor)?, normals, ..mesh.clone() };
    Ok(if mirrored { reversed(scaled) } else { scaled })
}

/// Reverses the winding of the faces but not the normals, which keeps the outside outside after a reflection.
fn reversed(mesh: MeshValue) -> MeshValue {
    MeshValue { faces: Arc::new(mesh.faces.iter().map(|&[a, b, c]| [a, c, b]).collect()), ..mesh }
}

fn flipped(mesh: &MeshValue) -> MeshValue {
    MeshValue { normals: mesh.normals.as_ref().map(Var::neg), ..reversed(mesh.clone()) }
}

/// Maps vertices by `linear · v + offset` and normals by the inverse transpose of `linear`.
fn moved(mesh: &MeshValue, linear: &Var, offset: Option<&Var>, rigid: bool, blame: usize) -> Result<MeshValue> {
    let mut vertices = mesh.vertices.matmul(&linear.transpose()?)?;
    if let Some(offset) = offset {
        vertices = vertices.add(offset)?;
    }
    let normals = match &mesh.normals {
        // Rows: n' = A⁻ᵀ n, so n'ᵀ = nᵀ A⁻¹; for a rotation A⁻¹ = Aᵀ.
        Some(n) if rigid => Some(n.matmul(&linear.transpose()?)?),
        Some(n) => {
            let inverse = linear.inverse().map_err(|e| NativeError::at(blame, e.0))?;
            Some(n.matmul(&inverse)?.normalize()?)
        }
        None => None,
    };
    let moved = MeshValue { vertices, normals, ..mesh.clone() };
    let mirrored = !rigid && linear.determinant()?.item().is_some_and(|d| d < 0.0);
    Ok(if mirrored { reversed(moved) } else { moved })
}

fn rotate(a: &Args) -> Result<Value> {
    let mesh = a.mesh(0)?;
    if let (Some((axis, _)), None) = (a.named("axis"), a.named("angle")) {
        return Err(NativeError::at(axis, "an axis without an angle").help("write `rotate(axis: …, angle: 30deg)`"));
    }
    let mut turn = euler(a)?;
    let by = a.named("by").map(|(i, v)| affine_parts(v, i)).transpose()?.map(|(linear, _)| linear);
    for next in [about(a)?, by].into_iter().flatten() {
        turn = Some(match turn {
            Some(t) => next.matmul(&t)?,
            None => next,
        });
    }
    match turn {
        Some(t) => keyframes(a, |m| moved(m, &t, None, true, 0)),
        None => give(mesh.clone()),
    }
}

fn mesh_from_arrays(a: &Args) -> Result<Value> {
    let (vi, _) = a.need("vertices")?;
    let (fi, _) = a.need("faces")?;
    for (i, what) in [(vi, "vertices"), (fi, "faces")] {
        if matches!(a.value(i)?, Value::List(items) if items.is_empty()) {
            return Err(NativeError::at(i, format!("a mesh without {what} has nothing to show"))
                .help("leave the shape out of the scene instead"));
        }
    }
    let vertices = a.var(vi)?;
    let &[n, 3] = vertices.shape() else {
        if vertices.is_empty() {
            return Err(NativeError::at(vi, "a mesh without vertices has nothing to show"));
        }
        return Err(NativeError::at(vi, "vertices are points of 3 numbers: `[[x, y, z], …]`"));
    };
    let faces_var = a.var(fi)?;
    if faces_var.shape().get(1) != Some(&3) || faces_var.shape().len() != 2 {
        let empty = faces_var.is_empty();
        return Err(NativeError::at(
            fi,
            if empty {
                "a mesh without faces has nothing to show"
            } else {
                "faces are triples of indices: `[[0, 1, 2], …]`"
            },
        ));
    }
    let mut faces = Vec::with_capacity(faces_var.shape()[0]);
    for (f, face) in faces_var.value().data.chunks_exact(3).enumerate() {
        let mut corners = [0u32; 3];
        for (corner, &x) in corners.iter_mut().zip(face) {
            if x.fract() != 0.0 || x < 0.0 || x >= n as f64 {
                let why = format!("face {f} refers to vertex {x}, but there are {n} vertices");
                return Err(NativeError::at(fi, why).help(format!("indices go from 0 to {}", n.saturating_sub(1))));
            }
            *corner = x as u32;
        }
        faces.push(corners);
    }
    finite(vertices, vi, "vertices")?;
    let attribute = |name: &str, width: usize| -> Result<Option<Var>> {
        let Some((i, _)) = a.named(name) else { return Ok(None) };
        let v = a.var(i)?;
        if v.shape() != [n, width] {
            let found = Tensor::shape_text(v.shape());
            return Err(NativeError::at(
                i,
                format!("`{name}` must be {n}×{width}, one row for each vertex; this is {found}"),
            ));
        }
        finite(v, i, name)?;
        Ok(Some(v.clone()))
    };
    give(MeshValue {
        vertices: vertices.clone(),
        faces: Arc::new(faces),
        normals: attribute("normals", 3)?,
        uvs: attribute("uvs", 2)?,
        colors: attribute("colors", 3)?,
        closing: None,
    })
}

fn finite(v: &Var, index: usize, name: &str) -> Result<()> {
    let width = v.shape().last().copied().unwrap_or(1).max(1);
    match v.value().data.iter().position(|x| !x.is_finite()) {
        Some(i) => Err(NativeError::at(index, format!("{name}[{}] is not finite", i / width))),
        None => Ok(()),
    }
}

fn torus(a: &Args) -> Result<Value> {
    let n = a.named_integer("subdivisions", 3..=1 << 16)?.unwrap_or(32) as usize;
    let (major, minor) = (size(a, "radius", 1.0)?, size(a, "tube", 0.25)?);
    // A torus is linear in both radii: the difference of two tori is the derivative in a radius.
    let thin: MeshValue = (&shapes::torus(2.0, 1.0, n, n).map_err(mesh_error)?).into();
    let wide: MeshValue = (&shapes::torus(3.0, 1.0, n, n).map_err(mesh_error)?).into();
    let ring = wide.vertices.sub(&thin.vertices)?;
    let tube = thin.vertices.sub(&ring.scale(2.0))?;
    give(MeshValue { vertices: ring.mul(&major)?.add(&tube.mul(&minor)?)?, ..thin })
}

fn heightfield(a: &Args) -> Result<Value> {
    let heights = a.var(0)?;
    let (rows, columns) = match *heights.shape() {
        [r, c] | [r, c, 1] => (r, c),
        _ => return Err(NativeError::at(0, "heights are rows of numbers, or an image with one channel")),
    };
    if rows < 2 || columns < 2 {
        return Err(NativeError::at(0, "a heightfield needs at least 2 rows of 2 heights"));
    }
    let (w, d) = (size(a, "width", 2.0)?, size(a, "depth", 2.0)?);
    let flat: MeshValue = (&shapes::grid(columns - 1, rows - 1, 1.0, 1.0).map_err(mesh_error)?).into();
    let n = flat.vertices.shape()[0];
    if n != rows * columns {
        return Err(NativeError::new("the grid has another number of vertices than heights"));
    }
    let zero = Var::from(0.0);
    let spread = Var::stack(&[w, zero.clone(), d])?;
    let up = Var::constant(Tensor::vector(vec![0.0, 1.0, 0.0]));
    // Vertices are ordered from the near row (+z) to the far one, which is row 0 of the heights.
    let order: Vec<u32> = (0..rows as u32).rev().collect();
    let lifted = heights.reshape(vec![rows, columns])?.rows(&order)?.reshape(vec![n, 1])?.mul(&up)?;
    let lifted = MeshValue { vertices: flat.vertices.mul(&spread)?.add(&lifted)?, normals: None, ..flat };
    give(MeshValue { normals: Some(smooth_normals(&lifted)?), ..lifted })
}

/// A closed cylinder or cone without its cap at a height: without the faces whose corners are all at that height and whose normal is
/// vertical.
fn without_caps(mut m: Mesh, at_cap: impl Fn(f32) -> bool) -> Mesh {
    let vertices = &m.vertices;
    m.faces.retain(|f| {
        let [a, b, c] = f.map(|i| vertices[i as usize]);
        !([a, b, c].iter().all(|v| at_cap(v.y)) && a.y == b.y && b.y == c.y)
    });
    m
}

fn subdivide(a: &Args) -> Result<Value> {
    let levels = a.named_integer("levels", 0..=8)?.unwrap_or(1);
    keyframes(a, |mesh| subdivided(mesh, levels))
}

fn subdivided(mesh: &MeshValue, levels: i64) -> Result<MeshValue> {
    let mut mesh = mesh.clone();
    for _ in 0..levels {
        // There are four times as many faces, and while they are made also the old ones and a table of edges.
        memory::ask_for::<f64>(8 * mesh.numbers())?;
        let finer = ops::subdivide(&mesh.to_mesh()).map_err(|e| NativeError::at(0, e.to_string()))?;
        let half = |v: &Var| -> Result<Var> {
            let ends: [Vec<u32>; 2] = [0, 1].map(|k| finer.parents.iter().map(|p| p[k]).collect());
            Ok(v.rows(&ends[0])?.add(&v.rows(&ends[1])?)?.scale(0.5))
        };
        mesh = MeshValue {
            vertices: half(&mesh.vertices)?,
            faces: Arc::new(finer.mesh.faces),
            normals: mesh.normals.as_ref().map(half).transpose()?,
            uvs: mesh.uvs.as_ref().map(half).transpose()?,
            colors: mesh.colors.as_ref().map(half).transpose()?,
            closing: None,
        };
    }
    Ok(mesh)
}

fn merged(parts: &[&MeshValue]) -> Result<MeshValue> {
    if parts.is_empty() {
        return Err(NativeError::at(0, "no meshes to merge"));
    }
    memory::ask_for::<f64>(parts.iter().map(|p| p.numbers()).sum())?;
    let mut faces = Vec::new();
    let mut base = 0u32;
    for part in parts {
        faces.extend(part.faces.iter().map(|f| f.map(|i| i + base)));
        base += part.vertices.shape()[0] as u32;
    }
    // The merged mesh has an attribute if every part has it.
    let join = |of: fn(&MeshValue) -> Option<&Var>| -> Result<Option<Var>> {
        let all: Option<Vec<Var>> = parts.iter().map(|p| of(p).cloned()).collect();
        Ok(all.map(|v| Var::concat(&v, 0)).transpose()?)
    };
    let closing = if parts.iter().any(|p| p.closing.is_some()) {
        let parts: Vec<&MeshValue> = parts.iter().map(|p| p.closing.as_deref().unwrap_or(p)).collect();
        Some(Arc::new(merged(&parts)?))
    } else {
        None
    };
    Ok(MeshValue {
        closing,
        vertices: join(|m| Some(&m.vertices))?.unwrap_or_else(identity),
        faces: Arc::new(faces),
        normals: join(|m| m.normals.as_ref())?,
        uvs: join(|m| m.uvs.as_ref())?,
        colors: join(|m| m.colors.as_ref())?,
    })
}

/// Translated so that the middle of the bounding box (of the opening keyframe) is at the origin.
fn centered(mesh: &MeshValue) -> Result<MeshValue> {
    let (lo, hi) = bounds(mesh)?;
    let middle = lo.add(&hi)?.scale(0.5);
    with_vertices(mesh, |v| Ok(v.sub(&middle)?))
}

/// Applies a function to the vertices of both keyframes.
fn with_vertices(mesh: &MeshValue, f: impl Fn(&Var) -> Result<Var>) -> Result<MeshValue> {
    let still = |m: &MeshValue| -> Result<MeshValue> { Ok(MeshValue { vertices: f(&m.vertices)?, ..m.clone() }) };
    let closing = mesh.closing.as_ref().map(|m| still(m).map(Arc::new)).transpose()?;
    Ok(MeshValue { closing, ..still(mesh)? })
}

/// Centred, and scaled so that the longest side of the bounding box is 2.
pub(super) fn normalized(mesh: &MeshValue) -> Result<MeshValue> {
    let (lo, hi) = bounds(mesh)?;
    let extent = hi.sub(&lo)?.max()?;
    if extent.item().is_none_or(|e| e.is_nan() || e <= 0.0) {
        return Err(NativeError::at(0, "a mesh without extent cannot be normalized"));
    }
    let centered = centered(mesh)?;
    with_vertices(&centered, |v| Ok(v.div(&extent)?.scale(2.0)))
}

/// Area-weighted vertex normals, as an operation of the tape.
struct SmoothNormals(Arc<Vec<[u32; 3]>>);

fn points(t: &Tensor) -> Vec<DVec3> {
    t.data.chunks_exact(3).map(DVec3::from_slice).collect()
}

fn tensor(points: &[DVec3]) -> Tensor {
    Tensor::rows(points.iter().map(|p| p.to_array()))
}

impl CustomOp for SmoothNormals {
    fn name(&self) -> &str {
        "smooth_normals"
    }

    fn composed(&self, x: &[Var]) -> Option<Result<Var, TapeError>> {
        Some(composed_normals(&x[0], &self.0))
    }

    fn vjp(&self, x: &[&Tensor], _: &Tensor, g: &Tensor, _: &[bool]) -> Result<Vec<Option<Tensor>>, String> {
        let vertices = points(x[0]);
        let mut d = vec![DVec3::ZERO; vertices.len()];
        ops::d_smooth_normals(&vertices, &self.0, &points(g), &mut d);
        Ok(vec![Some(tensor(&d))])
    }

    fn jvp(&self, x: &[&Tensor], y: &Tensor, t: &[Option<&Tensor>]) -> Result<Tensor, String> {
        let Some(t) = t[0] else { return Ok(Tensor::zeros(&y.shape)) };
        Ok(tensor(&ops::jvp_smooth_normals(&points(x[0]), &self.0, &points(t))))
    }
}

/// [`ops::smooth_normals`] made of operations of the tape.
fn composed_normals(vertices: &Var, faces: &[[u32; 3]]) -> Result<Var, TapeError> {
    let (place, count) = ops::weld(&points(vertices.value()));
    let corner = |k: usize| vertices.rows(&faces.iter().map(|f| f[k]).collect::<Vec<_>>());
    let (a, b, c) = (corner(0)?, corner(1)?, corner(2)?);
    let crosses = b.sub(&a)?.cross(&c.sub(&a)?)?;
    let from: Vec<u32> = (0..faces.len() as u32).flat_map(|i| [i; 3]).collect();
    let to =
        faces.iter().flatten().flat_map(|&i| (0..3).map(|c| 3 * place[i as usize] + c).collect::<Vec<_>>()).collect();
    let sums = crosses.rows(&from)?.scatter(Arc::new(to), vec![count, 3]);
    sums.rows(&place)?.normalize()
}

fn smooth_normals(mesh: &MeshValue) -> Result<Var> {
    let value = tensor(&ops::smooth_normals(&points(mesh.vertices.value()), &mesh.faces));
    Ok(Var::custom(Arc::new(SmoothNormals(mesh.faces.clone())), vec![mesh.vertices.clone()], value))
}

/// Edges by welded position: their two ends (one vertex of each position) and the faces at them.
pub(super) fn welded_edges(mesh: &MeshValue) -> Vec<([u32; 2], Vec<u32>)> {
    let (place, count) = ops::weld(&points(mesh.vertices.value()));
    let mut first = vec![0u32; count];
    for (i, &p) in place.iter().enumerate().rev() {
        first[p as usize] = i as u32;
    }
    ops::edges(&place, &mesh.faces).into_iter().map(|(e, f)| (e.map(|p| first[p as usize]), f)).collect()
}

/// Mean, over all vertices, of the squared distance to the mean of their neighbours.
fn laplacian_energy(a: &Args) -> Result<Value> {
    let mesh = a.mesh(0)?;
    let n = mesh.vertices.shape()[0];
    let mut from = Vec::new();
    let mut to = Vec::new();
    let mut degree = vec![0.0f64; n];
    for ([i, j], _) in welded_edges(mesh) {
        for (i, j) in [(i, j), (j, i)] {
            from.push(j);
            to.push(i);
            degree[i as usize] += 1.0;
        }
    }
    let scatter: Vec<u32> = to.iter().flat_map(|&i| (0..3).map(move |c| 3 * i + c)).collect();
    let sums = mesh.vertices.rows(&from)?.scatter(Arc::new(scatter), vec![n, 3]);
    // Of several vertices at one position, all but the first have no edges and count as zero.
    let used: Vec<f64> = degree.iter().map(|&d| if d > 0.0 { 1.0 } else { 0.0 }).collect();
    let inverse: Vec<f64> = degree.iter().map(|&d| 1.0 / d.max(1.0)).collect();
    let count: f64 = used.iter().sum();
    let used = Var::constant(Tensor::new(vec![n, 1], used));
    let means = sums.mul(&Var::constant(Tensor::new(vec![n, 1], inverse)))?;
    let offset = mesh.vertices.mul(&used)?.sub(&means)?;
    Ok(Value::Num(offset.mul(&offset)?.sum().scale(1.0 / count.max(1.0))))
}

/// Mean squared edge length.
fn edge_length_energy(a: &Args) -> Result<Value> {
    let mesh = a.mesh(0)?;
    let edges = welded_edges(mesh);
    let end = |k: usize| mesh.vertices.rows(&edges.iter().map(|e| e.0[k]).collect::<Vec<_>>());
    let along = end(0)?.sub(&end(1)?)?;
    Ok(Value::Num(along.mul(&along)?.sum().scale(1.0 / edges.len().max(1) as f64)))
}

/// Mean, over all edges, of 1 − cos of the angle between the normals of the two faces.
fn normal_consistency(a: &Args) -> Result<Value> {
    let mesh = a.mesh(0)?;
    let corner = |k: usize| mesh.vertices.rows(&mesh.faces.iter().map(|f| f[k]).collect::<Vec<_>>());
    let (p, q, r) = (corner(0)?, corner(1)?, corner(2)?);
    let normals = q.sub(&p)?.cross(&r.sub(&p)?)?.normalize()?;
    let pairs: Vec<[u32; 2]> =
        welded_edges(mesh).iter().filter_map(|(_, f)| if let [a, b] = f[..] { Some([a, b]) } else { None }).collect();
    if pairs.is_empty() {
        return Ok(Value::scalar(0.0));
    }
    let side = |k: usize| normals.rows(&pairs.iter().map(|p| p[k]).collect::<Vec<_>>());
    Ok(Value::Num(side(0)?.dot(&side(1)?)?.mean()?.neg().shift(1.0)))
}
