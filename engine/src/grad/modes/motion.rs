//! Derivatives of moving scenes: means over time slices (`render::motion`), in each of which scene and camera are static. A moving
//! quantity at time t is (1 − t)·opening + t·closing keyframe, and its derivatives go to both keyframes with these weights.

use std::sync::atomic::AtomicBool;

use glam::Vec3;

use super::forward;
use super::forward::Direction;
use crate::image::Image;
use crate::render::motion::Slice;
use crate::render::{Camera, Scene, SceneError, Settings, Slot};

/// Gives derivatives other times than values.
const DERIVATIVES: u64 = 1;

/// Maps slots of a moving scene to slots of its slices.
struct MovingSlots {
    /// Moving slots, as slots of a slice, with the difference between the keyframes.
    velocities: Vec<(Slot, Vec<f32>)>,
    /// Slots of a slice that depend on the requested slots.
    slice_slots: Vec<Slot>,
}

impl MovingSlots {
    fn new(scene: &Scene, camera: &Camera, slots: impl Iterator<Item = Slot>) -> MovingSlots {
        let velocity = |from: &[Vec3], to: &[Vec3]| -> Vec<f32> {
            from.iter().zip(to).flat_map(|(a, b)| (*b - *a).to_array()).collect()
        };
        let mut velocities = Vec::new();
        if let Some(to) = camera.closing {
            let from = camera.pose();
            let pair = |a: [f32; 2], b: [f32; 2]| vec![b[0] - a[0], b[1] - a[1]];
            velocities.push((Slot::CameraOrigin, velocity(&[from.origin], &[to.origin])));
            velocities.push((Slot::CameraFrame, velocity(&from.frame, &to.frame)));
            velocities.push((Slot::CameraScale, pair(from.scale, to.scale)));
            velocities.push((Slot::CameraLens, pair(from.lens, to.lens)));
        }
        for motion in &scene.description.light_motions {
            let opening = scene.description.delta_lights[motion.light].arrays(motion.light);
            for ((slot, from), (_, to)) in opening.into_iter().zip(motion.closing.arrays(motion.light)) {
                velocities.push((slot, from.iter().zip(&to).map(|(a, b)| b - a).collect()));
            }
        }
        for motion in &scene.description.motions {
            let mesh = &scene.description.shapes[motion.shape].mesh;
            velocities.push((Slot::Vertices(motion.shape), velocity(&mesh.vertices, &motion.vertices)));
            if let (Some(from), Some(to)) = (&mesh.normals, &motion.normals) {
                velocities.push((Slot::Normals(motion.shape), velocity(from, to)));
            }
        }
        let mut slice_slots = Vec::new();
        for slot in slots {
            let of_slot: Vec<Slot> = match slot {
                Slot::CameraShutter => {
                    velocities.iter().filter(|v| v.1.iter().any(|x| *x != 0.0)).map(|v| v.0).collect()
                }
                slot => vec![slot.opening()],
            };
            slice_slots.extend(of_slot);
        }
        slice_slots.sort_unstable();
        slice_slots.dedup();
        MovingSlots { velocities, slice_slots }
    }

    /// Weight of a keyframe's slot at a time; 1 for a slot that does not move.
    fn factor(&self, slot: Slot, slice: &Slice) -> f32 {
        if slot != slot.opening() {
            slice.time
        } else if self.velocities.iter().any(|(s, _)| *s == slot) {
            1.0 - slice.time
        } else {
            1.0
        }
    }

    /// Tangents of a slice's slots.
    fn tangents(&self, tangents: &Direction, slice: &Slice) -> Direction {
        let zero = |s: &Slot| (*s, vec![0.0; slice.scene.description.slot_len(*s)]);
        let mut still: Direction = self.slice_slots.iter().map(zero).collect();
        let mut add = |slot: Slot, values: &[f32], factor: f32| {
            if let Ok(i) = self.slice_slots.binary_search(&slot) {
                still[i].1.iter_mut().zip(values).for_each(|(sum, v)| *sum += v * factor);
            }
        };
        for (slot, values) in tangents {
            match (slot, &values[..]) {
                (Slot::CameraShutter, [open, close]) => {
                    let d_time = open * (1.0 - slice.share) + close * slice.share;
                    self.velocities.iter().for_each(|(slot, v)| add(*slot, v, d_time));
                }
                _ => add(slot.opening(), values, self.factor(*slot, slice)),
            }
        }
        still
    }
}

/// Slots of a static slice that depend on the requested slots.
pub fn slice_slots(scene: &Scene, camera: &Camera, wrt: &[Slot]) -> Vec<Slot> {
    MovingSlots::new(scene, camera, wrt.iter().copied()).slice_slots
}

/// Reverse mode for a scene that moves; `of_slice` gives derivatives in slots of a static slice.
pub fn backward(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    wrt: &[Slot],
    stop: &AtomicBool,
    of_slice: impl Fn(&Slice, &[Slot]) -> Vec<Vec<f64>>,
) -> Result<Vec<Vec<f64>>, SceneError> {
    let moving = MovingSlots::new(scene, camera, wrt.iter().copied());
    let mut total: Vec<Vec<f64>> = wrt.iter().map(|s| vec![0.0; scene.description.slot_len(*s)]).collect();
    scene.slices(camera, settings, DERIVATIVES, stop, |slice| {
        let found = of_slice(slice, &moving.slice_slots);
        let of = |slot: Slot| moving.slice_slots.binary_search(&slot).map_or(&[][..], |i| &found[i]);
        for (slot, sum) in wrt.iter().zip(&mut total) {
            if *slot == Slot::CameraShutter {
                let along = |(slot, v): &(Slot, Vec<f32>)| -> f64 {
                    of(*slot).iter().zip(v).map(|(g, v)| g * f64::from(*v)).sum()
                };
                let d_time: f64 = moving.velocities.iter().map(along).sum::<f64>() * f64::from(slice.weight);
                sum[0] += d_time * f64::from(1.0 - slice.share);
                sum[1] += d_time * f64::from(slice.share);
                continue;
            }
            let factor = f64::from(moving.factor(*slot, slice) * slice.weight);
            for (sum, g) in sum.iter_mut().zip(of(slot.opening())) {
                *sum += g * factor;
            }
        }
        Ok(())
    })?;
    Ok(total)
}

/// [`super::render_jacobian_until`] for a scene that moves.
pub fn forward(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    directions: &[Direction],
    stop: &AtomicBool,
) -> Result<Vec<Image>, SceneError> {
    let moving = MovingSlots::new(scene, camera, directions.iter().flatten().map(|t| t.0));
    let mut images = vec![Image::new(camera.width, camera.height, settings.output.channels()); directions.len()];
    scene.slices(camera, settings, DERIVATIVES, stop, |slice| {
        let still: Vec<Direction> = directions.iter().map(|tangents| moving.tangents(tangents, slice)).collect();
        let parts = forward::static_scene(slice.scene, &slice.camera, &slice.settings, &still, stop);
        for (image, part) in images.iter_mut().zip(&parts) {
            for (sum, x) in image.data.iter_mut().zip(&part.data) {
                *sum += x * slice.weight;
            }
        }
        Ok(())
    })?;
    Ok(images)
}
