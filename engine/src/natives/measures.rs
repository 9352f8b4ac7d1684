//! Measures of meshes and point sets: bounds, areas, volumes, distances.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use rayon::prelude::*;

use crate::image::flip;
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
    ("bending_energy", bending_energy),
    ("flip_map", flip_map),
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

/// The bending energy of discrete shells, Σ θ² · 3 |e|² / (A₁ + A₂) over the edges with two faces (Grinspun et al. 2003, for a shell that
/// is flat at rest), with 2 (1 − cos θ) for the square of the angle θ between the normals: the same for small angles, and smooth at 0.
fn bending_energy(a: &Args) -> Result<Value> {
    let mesh = a.mesh(0)?;
    let inner: Vec<([u32; 2], [u32; 2])> =
        welded_edges(mesh).iter().filter_map(|(e, f)| Some((*e, f[..].try_into().ok()?))).collect();
    if inner.is_empty() {
        return Ok(Value::scalar(0.0));
    }
    let [p, q, r] = corners(&mesh.vertices, mesh)?;
    let doubled = q.sub(&p)?.cross(&r.sub(&p)?)?;
    let (normals, areas) = (doubled.normalize()?, doubled.length()?.scale(0.5));
    let face = |of: &Var, k: usize| of.rows(&inner.iter().map(|(_, f)| f[k]).collect::<Vec<_>>());
    let end = |k: usize| mesh.vertices.rows(&inner.iter().map(|(e, _)| e[k]).collect::<Vec<_>>());
    let bent = face(&normals, 0)?.dot(&face(&normals, 1)?)?.neg().shift(1.0).scale(2.0);
    let along = end(1)?.sub(&end(0)?)?;
    let around = face(&areas, 0)?.add(&face(&areas, 1)?)?;
    Ok(Value::Num(bent.mul(&along.dot(&along)?.scale(3.0))?.div(&around)?.sum()))
}

/// [`flip::error_map`]. To look at, not to follow: it has no derivative.
fn flip_map(a: &Args) -> Result<Value> {
    let (image, reference) = (a.image(0)?, a.image(1)?);
    let [height, width, channels] = image.shape()[..] else { return Err(a.wrong(0, "an image")) };
    if image.shape() != reference.shape() {
        return Err(NativeError::at(
            1,
            format!(
                "the images are not of one size: {} and {}",
                Tensor::shape_text(image.shape()),
                Tensor::shape_text(reference.shape())
            ),
        ));
    }
    if channels != 3 && channels != 1 {
        return Err(NativeError::at(0, format!("an image of {channels} channels has no colours to compare")));
    }
    let pixels_per_degree = a.number(2)?;
    if !(1.0..=1000.0).contains(&pixels_per_degree) {
        return Err(NativeError::at(2, "a screen has 1 to 1000 pixels per degree"));
    }
    let colors = |image: &Var| -> Vec<f64> {
        image.value().data.iter().flat_map(|x| std::iter::repeat_n(*x, 3 / channels)).collect()
    };
    let map = flip::error_map(&colors(&image), &colors(&reference), width, height, pixels_per_degree);
    Ok(Value::Image(Var::constant(Tensor::new(vec![height, width, 1], map))))
}

fn rows(t: &Tensor) -> Arc<[[f64; 3]]> {
    t.data.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect()
}
