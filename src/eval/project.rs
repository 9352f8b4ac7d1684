//! Projects points of the world onto a camera's film: [`Camera::project`] as an operation of the tape.

use std::sync::Arc;

use glam::{DVec3, Vec2, Vec3};

use crate::diag::Diagnostic;
use crate::natives::value::{SceneValue, Value};
use crate::render::sensor::{CameraAdjoint, Projected};
use crate::render::{Camera, Slot};
use crate::source::Span;
use crate::tape::{CustomOp, Tensor, Var};

use super::{Engine, Result, error, lower};

/// One call. Its inputs are the points, followed by the camera's slots that depend on a leaf.
struct ProjectOp {
    camera: Camera,
    slots: Vec<Slot>,
    projected: Vec<Projected>,
}

impl ProjectOp {
    /// Adjoints of a point and of the camera's numbers, from the adjoint of the point's film position.
    fn adjoint(&self, projected: &Projected, d_place: Vec2, camera: &mut CameraAdjoint) -> Vec3 {
        self.camera.d_project(projected, d_place / self.camera.film_size(), camera)
    }
}

/// The adjoints of a slot's numbers.
fn of_slot(slot: Slot, d: &CameraAdjoint) -> Vec<f64> {
    let all = |x: &[f32]| x.iter().map(|x| f64::from(*x)).collect();
    match slot {
        Slot::CameraOrigin => all(&d.origin.to_array()),
        Slot::CameraFrame => d.frame.iter().flat_map(|row| row.to_array()).map(f64::from).collect(),
        Slot::CameraScale => all(&d.scale),
        Slot::CameraDistortion => all(&d.distortion),
        // A point is projected through the centre of the lens, at the opening keyframe.
        _ => Vec::new(),
    }
}

impl CustomOp for ProjectOp {
    fn name(&self) -> &str {
        "project"
    }

    fn vjp(&self, inputs: &[&Tensor], _: &Tensor, g: &Tensor, wants: &[bool]) -> Result<Vec<Option<Tensor>>, String> {
        let mut found: Vec<Tensor> = inputs.iter().map(|i| Tensor::zeros(&i.shape)).collect();
        for (k, (projected, g)) in self.projected.iter().zip(g.data.chunks_exact(2)).enumerate() {
            let mut camera = CameraAdjoint::default();
            let d_point = self.adjoint(projected, Vec2::new(g[0] as f32, g[1] as f32), &mut camera);
            for (to, d) in found[0].data[3 * k..].iter_mut().zip(d_point.to_array()) {
                *to += f64::from(d);
            }
            for (found, slot) in found[1..].iter_mut().zip(&self.slots) {
                found.data.iter_mut().zip(of_slot(*slot, &camera)).for_each(|(to, d)| *to += d);
            }
        }
        Ok(found.into_iter().zip(wants).map(|(d, wanted)| wanted.then_some(d)).collect())
    }

    fn jvp(&self, _: &[&Tensor], output: &Tensor, tangents: &[Option<&Tensor>]) -> Result<Tensor, String> {
        let mut found = Tensor::zeros(&output.shape);
        for (k, projected) in self.projected.iter().enumerate() {
            for (axis, to) in found.data[2 * k..2 * k + 2].iter_mut().enumerate() {
                let mut camera = CameraAdjoint::default();
                let d_point = self.adjoint(projected, Vec2::from_array([[1.0, 0.0], [0.0, 1.0]][axis]), &mut camera);
                if let Some(t) = tangents[0] {
                    *to += (0..3).map(|i| f64::from(d_point[i]) * t.data[3 * k + i]).sum::<f64>();
                }
                for (slot, t) in self.slots.iter().zip(&tangents[1..]) {
                    let Some(t) = t else { continue };
                    *to += of_slot(*slot, &camera).iter().zip(&t.data).map(|(d, t)| d * t).sum::<f64>();
                }
            }
        }
        Ok(found)
    }
}

impl Engine {
    /// `project(camera, point)`: film positions in 0..1 from the top left, for points or arrays or images of points.
    pub(super) fn project(&mut self, values: &[Value], spans: &[Option<Span>], span: Span) -> Result<Value> {
        let at = |i: usize| spans.get(i).copied().flatten().unwrap_or(span);
        let (Some(Value::Camera(camera)), Some(value)) = (values.first(), values.get(1)) else {
            return Err(error::value("points are projected by a camera", span));
        };
        let (points, image) = match value {
            Value::Num(points) => (points, false),
            Value::Image(points) => (points, true),
            other => return Err(error::value(format!("points are projected, not {}", other.kind()), at(1))),
        };
        let Some((3, outer)) = points.shape().split_last() else {
            let what = Tensor::shape_text(points.shape());
            return Err(error::value(format!("a point has 3 numbers, this is a {what}"), at(1)));
        };
        let lowered =
            lower::lower_camera(camera).map_err(|e| self.scene_error(e, &SceneValue::default(), &[], at(0)))?;
        // Points are projected through the centre of the lens, at the opening keyframe.
        let around = lowered.camera.origin.as_dvec3();
        let pinhole = lowered.relative_to(around).at(0.0);
        let size = pinhole.film_size().to_array().map(f64::from);
        let (mut projected, mut places) = (Vec::new(), Vec::new());
        for (k, p) in points.value().data.chunks_exact(3).enumerate() {
            let point = (DVec3::new(p[0], p[1], p[2]) - around).as_vec3();
            let seen = pinhole.project(point).ok_or_else(|| unseen(k, p, points.len() == 3, at(1)))?;
            places.extend([f64::from(seen.pixel.x) / size[0], f64::from(seen.pixel.y) / size[1]]);
            projected.push(seen);
        }
        let value = Tensor::new([outer, &[2]].concat(), places);
        let moving = |slot: &Slot| {
            matches!(slot, Slot::CameraOrigin | Slot::CameraFrame | Slot::CameraScale | Slot::CameraDistortion)
        };
        let (slots, nodes): (Vec<Slot>, Vec<Var>) = lowered.slots.into_iter().filter(|(s, _)| moving(s)).unzip();
        let inputs: Vec<Var> = [points.clone()].into_iter().chain(nodes).collect();
        let op = ProjectOp { camera: pinhole, slots, projected };
        let places = Var::custom(Arc::new(op), inputs, value);
        Ok(if image { Value::Image(places) } else { Value::Num(places) })
    }
}

fn unseen(k: usize, p: &[f64], only: bool, span: Span) -> Diagnostic {
    let which = if only { "the point".to_owned() } else { format!("point {k}") };
    let message = format!("{which} ({}, {}, {}) is not in front of the camera", p[0], p[1], p[2]);
    error::value(message, span).help("only what lies before a camera has a place on its film: leave the others out")
}
