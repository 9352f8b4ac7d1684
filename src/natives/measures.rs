//! Measures of meshes and point sets: bounds, areas, volumes, distances.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use rayon::prelude::*;

use crate::mesh::nearest::Nearest;
use crate::stop;
use crate::tape::{Tensor, Unary, Var};

use super::meshes::welded_edges;
use super::value::{MeshValue, Value};
use super::{Args, Native, NativeError, Result};

pub(super) const TABLE: &[(&str, Native)] = &[
    ("bounds", |a| {
        let (low, high) = bounds(a.mesh(0)?)?;
        Ok(Value::Num(Var::stack(&[low, high])?))
    }),
    ("surface_area", |a| Ok(Value::Num(face_areas(a.mesh(0)?)?.sum()))),
    ("centroid", centroid),
    ("volume", volume),
    ("chamfer", chamfer),
];

/// The bounding box of a mesh's vertices, as nodes of the tape.
pub(super) fn bounds(mesh: &MeshValue) -> Result<(Var, Var)> {
    let lo = mesh.vertices.min_axes(&[0]).map_err(|_| NativeError::at(0, "the mesh has no vertices"))?;
    let hi = mesh.vertices.max_axes(&[0]).map_err(|_| NativeError::at(0, "the mesh has no vertices"))?;
    Ok((lo, hi))
}

/// Positions of the first, second and third corners of all faces.
fn corners(vertices: &Var, mesh: &MeshValue) -> Result<[Var; 3]> {
    let corner = |k: usize| vertices.rows(&mesh.faces.iter().map(|f| f[k]).collect::<Vec<_>>());
    Ok([corner(0)?, corner(1)?, corner(2)?])
}

fn face_areas(mesh: &MeshValue) -> Result<Var> {
    let [p, q, r] = corners(&mesh.vertices, mesh)?;
    Ok(q.sub(&p)?.cross(&r.sub(&p)?)?.length()?.scale(0.5))
}

/// The centroid of the surface.
fn centroid(a: &Args) -> Result<Value> {
    let mesh = a.mesh(0)?;
    let areas = face_areas(mesh)?;
    let total = areas.sum();
    if total.item() == Some(0.0) {
        return Err(NativeError::at(0, "a mesh without area has no centroid"));
    }
    let [p, q, r] = corners(&mesh.vertices, mesh)?;
    let middles = p.add(&q)?.add(&r)?.scale(1.0 / 3.0);
    let count = areas.len();
    let weighted = middles.mul(&areas.reshape(vec![count, 1])?)?.sum_axes(&[0])?;
    Ok(Value::Num(weighted.div(&total)?))
}

/// The volume as a signed sum of the tetrahedra from one point to all faces. For a closed mesh any point gives the same sum. Here it is
/// the mean of the vertices, so that little cancels for a mesh far from the origin.
fn volume(a: &Args) -> Result<Value> {
    let mesh = a.mesh(0)?;
    let open: Vec<usize> =
        welded_edges(mesh).iter().map(|(_, faces)| faces.len()).filter(|faces| faces % 2 == 1).collect();
    if !open.is_empty() {
        let edges = if open.len() == 1 { "edge belongs" } else { "edges belong" };
        let faces = if open.iter().all(|faces| *faces == 1) { "one face only" } else { "an odd number of faces" };
        return Err(NativeError::at(0, format!("only a closed mesh has a volume: {} {edges} to {faces}", open.len()))
            .help("a plane or a shell without caps is open; `merge` it with what closes it"));
    }
    let middle = Var::constant(mesh.vertices.value().clone()).mean_axes(&[0])?;
    let [p, q, r] = corners(&mesh.vertices.sub(&middle)?, mesh)?;
    Ok(Value::Num(p.dot(&q.cross(&r)?)?.sum().scale(1.0 / 6.0)))
}

/// The chamfer distance: the mean squared distance of each point to the nearest one of the other set, added over both directions. The
/// derivative takes the pairs of nearest points as constant, which is right except where a pair changes.
fn chamfer(a: &Args) -> Result<Value> {
    let points = |i: usize| -> Result<Var> {
        let points = match a.value(i)? {
            Value::Mesh(m) => m.vertices.clone(),
            Value::Num(v) if matches!(v.shape(), [_, 3]) => v.clone(),
            _ => return Err(a.wrong(i, "a mesh or an array of points")),
        };
        if points.is_empty() {
            return Err(NativeError::at(i, "no points to compare"));
        }
        if !points.value().is_finite() {
            return Err(NativeError::at(i, "a point is not finite"));
        }
        Ok(points)
    };
    let (x, y) = (points(0)?, points(1)?);
    let one_way = |from: &Var, to: &Var| -> Result<Var> {
        let tree = Nearest::new(rows(to.value()));
        let stop = stop::flag();
        let find = |p: &[f64; 3]| if stop.load(Ordering::Relaxed) { 0 } else { tree.find(*p) };
        let found: Vec<u32> = rows(from.value()).par_iter().map(find).collect();
        stop::check();
        let apart = from.sub(&to.rows(&found)?)?;
        Ok(apart.unary(Unary::Square).sum().scale(1.0 / found.len() as f64))
    };
    Ok(Value::Num(one_way(&x, &y)?.add(&one_way(&y, &x)?)?))
}

fn rows(t: &Tensor) -> Arc<[[f64; 3]]> {
    t.data.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect()
}
