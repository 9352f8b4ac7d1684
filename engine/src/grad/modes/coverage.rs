//! Describes the terms that are missing from a derivative, because no estimator covers them.

use std::sync::atomic::Ordering;

use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

use super::motion;
use crate::grad::mirrors::viewpoint::Mirrors;
use crate::grad::sink::Layout;
use crate::memory::bounded;
use crate::render::accel::PrimId;
use crate::render::edges::{Edge, EdgeFace};
use crate::render::texture::{Filter, Texture};
use crate::render::{Camera, Input, MaterialKind, Output, Projection, Scene, Settings, Shape, Slot, TextureId};
use crate::stop::{self, paced};

/// The missing terms of the derivatives with respect to `wrt`, in words; empty if they are complete.
pub fn coverage_gaps(scene: &Scene, camera: &Camera, settings: &Settings, wrt: &[Slot]) -> Vec<&'static str> {
    // If there is no memory for this, the derivative itself will fail for the same reason.
    bounded(|| gaps(scene, camera, settings, wrt)).unwrap_or_default()
}

fn gaps(scene: &Scene, camera: &Camera, settings: &Settings, wrt: &[Slot]) -> Vec<&'static str> {
    let mut gaps = Vec::new();
    let wrt = &motion::slice_slots(scene, camera, wrt)[..];
    let layout = Layout::new(scene, wrt);
    if slides_over(|texture| texture.is_mipmapped() && texture.coarsest() > 0, scene, settings, &layout) {
        gaps.push(
            "textures with `filter: trilinear` show other levels from another distance or angle, and these changes have no derivative \
             (derivatives in texels are complete; `bilinear` has no levels)",
        );
    }
    if slides_over(is_stepped, scene, settings, &layout) {
        gaps.push(
            "textures with `filter: nearest` (checkerboards too) jump between texels, and as points slide over them these \
             jumps have no derivative",
        );
    }
    if !layout.moves_visibility() {
        return gaps;
    }
    if layout.moves_things() && film_cuts_surfaces(scene, camera) {
        gaps.push(
            "the film of the orthographic camera cuts through surfaces, and where they begin in the image has no derivative \
             (from further back it sees the same, and nothing is cut)",
        );
    }
    if !settings.boundary {
        gaps.push(NO_BOUNDARY);
    } else if settings.output == Output::Radiance && settings.max_bounces > 0 && settings.has_paths() {
        gaps.extend(mirror_gaps(scene, settings, &layout));
        gaps.extend(glass_gaps(scene, settings));
    }
    if settings.boundary && settings.has_caustics() && !scene.description.delta_lights.is_empty() && folds(scene) {
        gaps.push(
            "a mirror or glass with smooth normals is so coarse that light which it throws jumps between its triangles; these jumps in \
             caustics have no derivative (finer triangles make them small)",
        );
    }
    gaps
}

/// The gap of renderings without boundary terms.
pub const NO_BOUNDARY: &str = "`boundary: false` leaves out silhouettes and shadow edges, which a param moves";

/// Whether triangles intersect the film of an orthographic camera, which sees only what is in front of it.
fn film_cuts_surfaces(scene: &Scene, camera: &Camera) -> bool {
    let cuts = |origin: Vec3, frame: [Vec3; 3], scale: [f32; 2], lens: f32| {
        let to_film = Mat3::from_cols(frame[0] * scale[0], frame[1] * scale[1], frame[2]).inverse();
        let [a, b] = camera.seen_film().map(|corner| camera.film(corner));
        let (middle, half) = (0.5 * (a + b), 0.5 * (b - a).abs() + Vec2::splat(lens) / Vec2::from_array(scale));
        let cuts = |prim: usize| {
            let corners = scene.corners(prim as PrimId).map(|p| to_film * (p - origin));
            let at_film = |i: usize| {
                let (a, b) = (corners[i], corners[(i + 1) % 3]);
                (a.z * b.z < 0.0).then(|| a.lerp(b, a.z / (a.z - b.z)).truncate())
            };
            let ends: Vec<Vec2> = (0..3).filter_map(at_film).collect();
            matches!(ends[..], [a, b] if meets_box(a - middle, b - middle, half))
        };
        paced(0..scene.prims.len(), 16).any(cuts)
    };
    camera.projection == Projection::Orthographic
        && (cuts(camera.origin, camera.frame, camera.scale, camera.lens.radius)
            || camera.closing.is_some_and(|to| cuts(to.origin, to.frame, to.scale, to.lens[0])))
}

/// Whether a segment intersects a box around the origin (separating axis test).
fn meets_box(a: Vec2, b: Vec2, half: Vec2) -> bool {
    let (middle, d) = (0.5 * (a + b), 0.5 * (b - a).abs());
    let normal = (b - a).perp();
    middle.abs().cmple(half + d).all() && normal.dot(middle).abs() <= normal.abs().dot(half)
}

/// A smooth mirror is coarse if it folds reflections for viewers at elevations up to this sine above a face: such as a ball of fewer than
/// ten rings.
const COARSE: f32 = 0.5;
/// The same for smooth glass. What it lets pass is folded up at no more than the angle between a face and its shading normals, where a
/// mirror folds up at twice that angle: so this is the sine of twice as many degrees, such as a ball of fewer than five rings. (What glass
/// reflects is a twentieth of the light; `tests/derivatives/gaps.rs` measures what is missing beyond.)
const COARSE_GLASS: f32 = 0.866;

/// Missing terms of reflections in mirrors.
fn mirror_gaps(scene: &Scene, settings: &Settings, layout: &Layout) -> Vec<&'static str> {
    let mirrors = Mirrors::new(scene, layout);
    let mut gaps = Vec::new();
    if settings.max_bounces < 2 {
        return gaps;
    }
    if !mirrors.show_no_mirror() {
        if scene.masked {
            gaps.push(
                "in a scene with masks (`opacity`) silhouettes seen in one mirror by way of another have no derivative",
            );
        } else if settings.max_bounces > 2 && scatters(scene) {
            gaps.push("silhouettes that a surface sees in one mirror by way of another have no derivative");
        }
    }
    let coarse = settings.max_bounces > 2 && !mirrors.curved.is_empty() && folds(scene);
    if coarse {
        gaps.push(
            "a mirror with smooth normals is so coarse that its rim would reflect into itself; shadows that other surfaces see by way of \
             such a rim have no derivative (finer triangles make rims narrow)",
        );
    }
    gaps
}

/// Whether smooth specular surfaces are so coarse that light which they turn jumps between their triangles.
fn folds(scene: &Scene) -> bool {
    let stop = stop::flag();
    let coarse = |e: &Edge| {
        let folding = e.folding(scene);
        let glass = |face: &EdgeFace| {
            let shape = scene.prims[face.prim as usize].shape as usize;
            scene.description.shapes[shape].material.kind.is_smooth_glass()
        };
        let coarse = if e.faces.iter().all(glass) { COARSE_GLASS } else { COARSE };
        // After an interruption the result does not matter.
        (folding.is_finite() && folding >= coarse) || stop.load(Ordering::Relaxed)
    };
    let folds = scene.edges().edges.par_iter().any(coarse);
    stop::check();
    folds
}

/// Whether some surface scatters light in more directions than one.
fn scatters(scene: &Scene) -> bool {
    let scatters = |s: &Shape| !s.material.kind.is_delta() && s.material.kind != MaterialKind::Black;
    scene.description.shapes.iter().any(scatters)
}

/// Missing terms of what is seen through smooth glass. (Rough glass has lobes, as other surfaces have.)
fn glass_gaps(scene: &Scene, settings: &Settings) -> Vec<&'static str> {
    let mut gaps = Vec::new();
    if !scene.description.shapes.iter().any(|s| s.material.kind.is_smooth_glass()) {
        return gaps;
    }
    if scene.masked {
        gaps.push("in a scene with masks (`opacity`) edges seen through glass have no derivative");
    }
    if settings.max_bounces < 2 || !scatters(scene) {
        return gaps;
    }
    gaps.push(
        "edges that other surfaces than the camera see through smooth glass, and the rims of the light that it throws on them \
         (caustics), have no derivative",
    );
    if !scene.description.delta_lights.is_empty() {
        gaps.push("shadows of `point`, `spot` and `directional` lights that are seen through glass have no derivative");
    }
    gaps
}

/// Whether a texture is piecewise constant.
fn is_stepped(texture: &Texture) -> bool {
    let mut texels = paced(texture.colors(), texture.channels);
    texture.filter == Filter::Nearest && texels.next().is_some_and(|first| texels.any(|t| t != first))
}

/// Whether a requested slot makes points slide over a texture of a kind: on a surface that moves or is seen by a camera
/// that moves; through reflected light, on any surface if anything moves; and in a mask, where light passes it.
fn slides_over(kind: fn(&Texture) -> bool, scene: &Scene, settings: &Settings, layout: &Layout) -> bool {
    let wrt = &layout.slots;
    let d = &scene.description;
    let of_kind = |t: TextureId| kind(&d.textures[t]);
    let reads = |input: Input| input.texture().is_some_and(of_kind);
    let radiance = settings.output == Output::Radiance;
    let lit = radiance && settings.max_bounces > 0;
    let of_camera = |s: &Slot| {
        matches!(
            s,
            Slot::CameraOrigin | Slot::CameraFrame | Slot::CameraScale | Slot::CameraLens | Slot::CameraDistortion
        )
    };
    let view = wrt.iter().any(of_camera);
    let (mut geometry, mut turns) = (false, view);
    for slot in wrt {
        geometry |= matches!(slot, Slot::Vertices(_) | Slot::Normals(_));
        turns |= *slot == Slot::EnvironmentRotation;
    }
    let slides = |i: usize| {
        let own = |s: &Slot| matches!(s, Slot::Vertices(j) | Slot::Uvs(j) if *j == i);
        view || wrt.iter().any(own) || (geometry && lit && settings.max_bounces > 1)
    };
    let sky = d.environment.as_ref().is_some_and(|e| of_kind(e.texels));
    let shape = |(i, s): (usize, &Shape)| {
        let scatters =
            (lit || settings.output == Output::Albedo) && s.material.scattering_inputs().any(|(_, i)| reads(*i));
        let tilts = (lit || settings.output == Output::Normal) && s.material.normals.is_some_and(reads);
        let emits = radiance && s.emission.as_ref().is_some_and(|e| reads(e.radiance));
        let mask = s.material.opacity.is_some_and(reads);
        (slides(i) && (scatters || tilts || emits || mask)) || (mask && lit && layout.moves_visibility())
    };
    (radiance && sky && (turns || (geometry && lit))) || d.shapes.iter().enumerate().any(shape)
}
