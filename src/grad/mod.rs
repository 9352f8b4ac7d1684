//! Derivatives of rendered images: interior and boundary estimators, forward and reverse mode.
//!
//! The derivative of a pixel is the sum of an *interior* term (paths move smoothly, `interior`) and *boundary* terms
//! (something passes behind an edge: `primary` as the camera sees it, `shadow` as a light sees it, `secondary` as any
//! other path vertex sees it, `reflections` as curved mirrors show it). All use one parametrisation per radiance component; the table is in `ARCHITECTURE.md`.

pub mod allocate;
pub mod chains;
pub mod curved;
pub mod edge_tree;
pub mod estimate;
pub mod guide;
pub mod interior;
pub mod layers;
pub mod lens;
pub mod local;
pub mod motion;
pub mod pixels;
pub mod primary;
pub mod reflections;
pub mod roughness;
pub mod secondary;
pub mod shadow;
pub mod sink;
pub mod viewpoint;

use std::sync::atomic::AtomicBool;

use glam::{Mat3, Vec2, Vec3};
use rayon::prelude::*;

use crate::image::Image;
use crate::render::Projection;
use crate::render::accel::PrimId;
use crate::render::edges::Edge;
use crate::render::sampler::hash;
use crate::render::texture::Filter;
pub use crate::render::{
    Camera, Input, NEVER, Output, Scene, SceneError, Settings, Slot, render, render_until, validate_camera,
};
use crate::render::{Environment, Shape, TextureId};

use self::allocate::{Allocation, Estimator};
use self::curved::MirrorTree;
use self::edge_tree::EdgeTree;
use self::estimate::{Images, Pass};
use self::guide::Lesson;
pub use self::guide::Memory;
use self::interior::Interior;
use self::primary::PrimaryEdges;
use self::reflections::Reflections;
use self::roughness::RoughnessPairs;
use self::secondary::Secondary;
use self::shadow::{Shadows, Sky};
use self::sink::{Contract, Contraction, Contractions, Layout, Tangents, Total};
use self::viewpoint::{Mirrors, Viewpoint};

/// Most samples of one sequence over the image; more are drawn in rounds.
const MAX_SEQUENCE: usize = 1 << 22;

/// Reverse mode: Σ d_image · ∂image/∂slot for every slot of `wrt`, in the slot's own layout; NaN if `d_image` is not finite.
/// Uses samples independent of [`render`]'s with the same settings.
pub fn render_backward(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    d_image: &Image,
    wrt: &[Slot],
) -> Result<Vec<Vec<f64>>, SceneError> {
    render_backward_until(scene, camera, settings, d_image, wrt, None, &NEVER)
}

/// [`render_backward`] that remembers where its samples were of use when it was last asked, for much the same scene, and learns for
/// the next time. Once `stop` is set it returns soon, with numbers that are good for nothing.
pub fn render_backward_until(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    d_image: &Image,
    wrt: &[Slot],
    memory: Option<&Memory>,
    stop: &AtomicBool,
) -> Result<Vec<Vec<f64>>, SceneError> {
    check(camera, settings, d_image)?;
    if scene.moves_for(camera) {
        return motion::backward(scene, camera, settings, d_image, wrt, memory, stop);
    }
    let layout = Layout::new(scene, wrt);
    // Samples cannot follow an adjoint that is not a number, and the caller must hear of it.
    let finite = d_image.data.iter().all(|v| v.is_finite());
    if !finite {
        return Ok(layout.by_slot(vec![f64::NAN; layout.size()]));
    }
    let mut total = Total::new(layout.size());
    struct Run<'a>(&'a Scene, &'a Layout, &'a Image, &'a mut Total, &'a AtomicBool);
    impl Visit for Run<'_> {
        fn pass(&mut self, pass: &impl Pass) {
            estimate::reverse(self.0, self.1, self.2, pass, self.3, self.4);
        }
    }
    passes(scene, camera, settings, &layout, d_image, memory, &mut Run(scene, &layout, d_image, &mut total, stop));
    Ok(layout.by_slot(total.into_vec()))
}

/// Tangents of some slots, each in the slot's own layout; those of the others are zero.
pub type Direction = Vec<(Slot, Vec<f32>)>;

/// Directions that one sweep over the samples serves; for more, the same samples are drawn again.
pub const MAX_DIRECTIONS: usize = 64;

/// Forward mode: the derivative of the image along `tangents`.
pub fn render_forward(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    tangents: &[(Slot, Vec<f32>)],
) -> Result<Image, SceneError> {
    let mut images = render_jacobian(scene, camera, settings, &[tangents.to_vec()])?;
    // One direction, one image.
    Ok(images.swap_remove(0))
}

/// Forward mode along several directions at once: the derivative of the image along each, from one set of samples, which depends on
/// the slots that occur and not on the tangents. Takes 8 bytes per direction, pixel and channel besides the images, and some 50 MB.
pub fn render_jacobian(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    directions: &[Direction],
) -> Result<Vec<Image>, SceneError> {
    render_jacobian_until(scene, camera, settings, directions, &NEVER)
}

/// [`render_jacobian`] with the `stop` of [`render_backward_until`].
pub fn render_jacobian_until(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    directions: &[Direction],
    stop: &AtomicBool,
) -> Result<Vec<Image>, SceneError> {
    validate_camera(camera)?;
    if scene.moves_for(camera) {
        return motion::forward(scene, camera, settings, directions, stop);
    }
    let mut slots: Vec<Slot> = Vec::new();
    for (slot, _) in directions.iter().flatten() {
        if !slots.contains(slot) {
            slots.push(*slot);
        }
    }
    let layout = Layout::new(scene, &slots);
    let groups = directions.chunks(MAX_DIRECTIONS);
    Ok(groups.flat_map(|group| forward(scene, camera, settings, &layout, group, stop)).collect())
}

/// One sweep.
fn forward(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    layout: &Layout,
    directions: &[Direction],
    stop: &AtomicBool,
) -> Vec<Image> {
    let dense = |direction: &Direction| {
        let mut tangent = vec![0.0; layout.size()];
        for (slot, values) in direction {
            let Some(at) = layout.slots.iter().position(|s| s == slot) else { continue };
            let place = &mut tangent[layout.starts[at]..layout.starts[at + 1]];
            place.iter_mut().zip(values).for_each(|(t, v)| *t = *v);
        }
        tangent
    };
    let tangents: Vec<Vec<f32>> = directions.iter().map(dense).collect();
    let channels = settings.output.channels();
    let size = camera.width * camera.height * channels;
    let mut images = Images { directions: directions.len(), channels, data: vec![0.0; size * directions.len()] };
    // No pixel matters more than another.
    let mut even = Image::new(camera.width, camera.height, channels);
    even.data.fill(1.0);
    if let [tangent] = &tangents[..] {
        let sink = || Contraction { tangent, sum: 0.0 };
        let mut run = RunForward { scene, layout, sink, images: &mut images, stop };
        passes(scene, camera, settings, layout, &even, None, &mut run);
    } else {
        let tangents = Tangents::new(&tangents, layout.size());
        let sink = || Contractions::new(&tangents);
        let mut run = RunForward { scene, layout, sink, images: &mut images, stop };
        passes(scene, camera, settings, layout, &even, None, &mut run);
    }
    let of_direction = |k: usize| {
        let pixels = images.data.chunks_exact(channels).skip(k).step_by(directions.len());
        let data = pixels.flatten().map(|x| *x as f32).collect();
        Image { width: camera.width, height: camera.height, channels, data }
    };
    (0..directions.len()).map(of_direction).collect()
}

struct RunForward<'a, F> {
    scene: &'a Scene,
    layout: &'a Layout,
    sink: F,
    images: &'a mut Images,
    stop: &'a AtomicBool,
}

impl<S: Contract, F: Fn() -> S + Sync> Visit for RunForward<'_, F> {
    fn pass(&mut self, pass: &impl Pass) {
        estimate::forward(self.scene, self.layout, &self.sink, pass, self.images, self.stop);
    }
}

/// Terms that are missing from the derivatives in `wrt`, in words; empty if they are complete.
pub fn coverage_gaps(scene: &Scene, camera: &Camera, settings: &Settings, wrt: &[Slot]) -> Vec<&'static str> {
    let mut gaps = Vec::new();
    let wrt = &motion::entered(scene, camera, wrt)[..];
    let layout = Layout::new(scene, wrt);
    if slides_over_steps(scene, settings, &layout) {
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
        gaps.push("`boundary: false` leaves out silhouettes and shadow edges, which a param moves");
    } else if settings.output == Output::Radiance && settings.max_bounces > 0 {
        gaps.extend(mirror_gaps(scene, settings, &layout));
    }
    gaps
}

/// Whether triangles go through the film of an orthographic camera, in front of which alone they are seen.
fn film_cuts_surfaces(scene: &Scene, camera: &Camera) -> bool {
    let cuts = |origin: Vec3, frame: [Vec3; 3], scale: [f32; 2], lens: f32| {
        let to_film = Mat3::from_cols(frame[0] * scale[0], frame[1] * scale[1], frame[2]).inverse();
        let half = Vec2::ONE + Vec2::splat(lens) / Vec2::from_array(scale);
        let cuts = |prim: usize| {
            let corners = scene.corners(prim as PrimId).map(|p| to_film * (p - origin));
            let at_film = |i: usize| {
                let (a, b) = (corners[i], corners[(i + 1) % 3]);
                (a.z * b.z < 0.0).then(|| a.lerp(b, a.z / (a.z - b.z)).truncate())
            };
            let ends: Vec<Vec2> = (0..3).filter_map(at_film).collect();
            matches!(ends[..], [a, b] if meets_box(a, b, half))
        };
        (0..scene.prims.len()).any(cuts)
    };
    camera.projection == Projection::Orthographic
        && (cuts(camera.origin, camera.frame, camera.scale, camera.lens.radius)
            || camera.closing.is_some_and(|to| cuts(to.origin, to.frame, to.scale, to.lens[0])))
}

/// Whether a segment meets a box around the origin: no axis separates the two.
fn meets_box(a: Vec2, b: Vec2, half: Vec2) -> bool {
    let (middle, d) = (0.5 * (a + b), 0.5 * (b - a).abs());
    let normal = (b - a).perp();
    middle.abs().cmple(half + d).all() && normal.dot(middle).abs() <= normal.abs().dot(half)
}

/// A smooth mirror is coarse if it folds what it shows to those who see a face at angles up to the one of this sine: a ball of less than
/// ten rings.
const COARSE: f32 = 0.5;

/// What mirrors show that has no derivative.
fn mirror_gaps(scene: &Scene, settings: &Settings, layout: &Layout) -> Vec<&'static str> {
    let mirrors = Mirrors::new(scene, layout);
    let mut gaps = Vec::new();
    if settings.max_bounces < 2 {
        return gaps;
    }
    let alone = match mirrors.curved.as_slice() {
        [] => mirrors.planes.len() < 2,
        [one] => one.convex && mirrors.planes.is_empty(),
        _ => false,
    };
    if !alone {
        gaps.push("silhouettes seen in one mirror by way of another have no derivative");
    }
    let coarse = |e: &Edge| {
        let folding = e.folding(scene);
        folding.is_finite() && folding >= COARSE
    };
    if settings.max_bounces > 2 && !mirrors.curved.is_empty() && scene.edges().edges.par_iter().any(coarse) {
        gaps.push(
            "a mirror with smooth normals is so coarse that its rim would reflect into itself; shadows that other surfaces see by way of \
             such a rim have no derivative (finer triangles make rims narrow)",
        );
    }
    gaps
}

/// Whether anything asked for makes points slide over a texture that is constant by parts: on a surface that moves, or is seen by
/// a camera that does; as reflected light from any that move; and, in a mask, where light passes it.
fn slides_over_steps(scene: &Scene, settings: &Settings, layout: &Layout) -> bool {
    let wrt = &layout.slots;
    let d = &scene.description;
    let steps = |t: TextureId| {
        let texture = &d.textures[t];
        let mut texels = texture.data.chunks_exact(texture.channels);
        texture.filter == Filter::Nearest && texels.next().is_some_and(|first| texels.any(|t| t != first))
    };
    let reads = |input: Input| matches!(input, Input::Texture(t) if steps(t));
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
    let sky = d.environment.as_ref().is_some_and(|e| steps(e.radiance));
    let shape = |(i, s): (usize, &Shape)| {
        let (inputs, count) = s.material.kind.inputs();
        let scatters = (lit || settings.output == Output::Albedo) && inputs[..count].iter().any(|i| reads(*i));
        let emits = radiance && s.emission.as_ref().is_some_and(|e| reads(e.radiance));
        let mask = s.material.opacity.is_some_and(reads);
        (slides(i) && (scatters || emits || mask)) || (mask && lit && layout.moves_visibility())
    };
    (radiance && sky && (turns || (geometry && lit))) || d.shapes.iter().enumerate().any(shape)
}

trait Visit {
    fn pass(&mut self, pass: &impl Pass);
}

/// All estimators whose terms can be non-zero for what is asked, in a fixed order. Samples go where the adjoint image is
/// large.
fn passes(
    scene: &Scene,
    camera: &Camera,
    settings: &Settings,
    layout: &Layout,
    adjoint: &Image,
    memory: Option<&Memory>,
    visit: &mut impl Visit,
) {
    if layout.size() == 0 {
        return;
    }
    let seed = hash(settings.seed, 0x61_646a_6f69_6e74);
    let interior =
        (!interior_vanishes(scene, settings, layout)).then(|| Interior::new(scene, camera, settings, layout, adjoint));
    if !settings.boundary || !layout.moves_visibility() {
        let pairs = RoughnessPairs::new(scene, camera, settings, layout, adjoint);
        return without_boundary(interior, pairs, &Allocation::new(scene, layout, adjoint, seed), seed, visit);
    }

    let lights = settings.output == Output::Radiance && settings.max_bounces > 0;
    let mirrors = if lights { Mirrors::new(scene, layout) } else { Mirrors::default() };
    let tree = lights.then(|| EdgeTree::new(scene));
    let curved = (!mirrors.curved.is_empty()).then(|| MirrorTree::new(scene, camera, &mirrors.curved));
    let curved = curved.as_ref();
    let ways = curved.filter(|_| settings.max_bounces > 1).map(|_| MirrorTree::all(scene, camera, &mirrors.curved));
    let ways = ways.filter(|tree| !tree.is_empty());
    let viewpoints = Viewpoint::all(scene, camera, &mirrors.planes);

    let primary = layout.moves_things().then(|| PrimaryEdges::new(&viewpoints, settings, adjoint, seed));
    if let Some(pass) = primary.as_ref().and_then(PrimaryEdges::enumeration) {
        visit.pass(&pass);
    }
    let reflections = curved.and_then(|tree| Reflections::new(scene, camera, tree, settings, adjoint, seed));

    let lesson = Lesson { scene, layout, adjoint, memory, seed };
    let mut allocation = Allocation::new(scene, layout, adjoint, seed);
    allocation.measure(&primary);
    let along_light = |sky: Sky| {
        let mut interior = interior.clone();
        interior.iter_mut().for_each(|i| i.fixed.sky = sky);
        let shadows = tree.as_ref().map(|tree| {
            let pixels = camera.width * camera.height;
            let count = settings.spp.max(1) as usize * (pixels / 8).clamp(1024, 131_072);
            Shadows::new(scene, sky, &viewpoints, settings, curved, tree, count).guided(&lesson)
        });
        let secondary = tree
            .as_ref()
            .and_then(|tree| Secondary::new(sky, camera, tree, &mirrors.planes, ways.as_ref(), settings, &lesson));
        let mut allocation = allocation.clone();
        allocation.measure(&interior);
        allocation.measure(&shadows);
        allocation.measure(&secondary);
        ((interior, shadows, secondary), allocation)
    };
    let whole = lights && steps_turn(scene, layout);
    let (mut estimators, mut allocation) = along_light(if whole { Sky::Whole } else { Sky::Peak });
    if scene.environment.is_some() && lights && !whole {
        let (others, other) = along_light(Sky::Whole);
        // Edge-first samples that hardly ever end where the camera looks seem quiet if a mirror shows more than they do.
        const SHADOWS: usize = 2;
        if other.found(SHADOWS) && allocation.advantage_over(&other, 1) < 0.0 {
            (estimators, allocation) = (others, other);
        }
    }
    let (interior, shadows, secondary) = estimators;
    allocation.measure(&reflections);
    let counts = allocation.split();
    draw(&primary, counts[0], seed, visit);
    draw(&interior, counts[1], seed, visit);
    draw(&shadows, counts[2], seed, visit);
    draw(&secondary, counts[3], seed, visit);
    draw(&reflections, counts[4], seed, visit);
}

/// The interior alone, with pairs of directions for roughness where these are less noisy than scores of the paths' own samples.
fn without_boundary(
    mut interior: Option<Interior>,
    pairs: Option<RoughnessPairs>,
    nothing_measured: &Allocation,
    seed: u64,
    visit: &mut impl Visit,
) {
    if interior.is_some() && pairs.is_some() {
        let [mut plain, mut paired] = [(); 2].map(|()| nothing_measured.clone());
        plain.measure(&interior);
        interior.iter_mut().for_each(|i| i.fixed.distributions = true);
        paired.measure(&interior);
        paired.measure(&pairs);
        if paired.advantage_over(&plain, 0) > 0.0 {
            let counts = paired.split();
            draw(&interior, counts[0], seed, visit);
            return draw(&pairs, counts[1], seed, visit);
        }
        interior.iter_mut().for_each(|i| i.fixed.distributions = false);
    }
    let own = interior.as_ref().map_or(0, Estimator::count);
    draw(&interior, own, seed, visit);
}

/// Draws samples of an estimator, in rounds of one sequence each.
fn draw(estimator: &Option<impl Estimator>, count: usize, seed: u64, visit: &mut impl Visit) {
    let Some(estimator) = estimator else { return };
    let rounds = count.div_ceil(MAX_SEQUENCE);
    for round in 0..rounds {
        let part = count * (round + 1) / rounds - count * round / rounds;
        visit.pass(&estimator.pass(part, part as f64 / count as f64, hash(seed, round as u64)));
    }
}

/// Whether the environment turns and has steps between its texels: these turn with it, and a radiance that stays in its direction
/// would know nothing of them.
fn steps_turn(scene: &Scene, layout: &Layout) -> bool {
    let nearest = |e: &Environment| scene.description.textures[e.radiance].filter == Filter::Nearest;
    layout.turns_environment() && scene.description.environment.as_ref().is_some_and(nearest)
}

/// Whether nothing that is asked for changes the radiance along a path: only emission is seen, and it is the same all over
/// each light.
fn interior_vanishes(scene: &Scene, settings: &Settings, layout: &Layout) -> bool {
    let d = &scene.description;
    let constant = |t: usize| d.textures[t].is_constant();
    let mut emitters = d.shapes.iter().filter_map(|s| s.emission.as_ref());
    settings.output == Output::Radiance
        && settings.max_bounces == 0
        && !layout.slots.iter().any(|s| matches!(s, Slot::Texels(_) | Slot::Colors(_)))
        && emitters.all(|e| matches!(e.radiance, Input::Texture(t) if constant(t)))
        && d.environment.as_ref().is_none_or(|e| constant(e.radiance))
        && d.shapes.iter().filter_map(|s| s.material.opacity).all(|o| matches!(o, Input::Texture(t) if constant(t)))
}

fn check(camera: &Camera, settings: &Settings, d_image: &Image) -> Result<(), SceneError> {
    validate_camera(camera)?;
    let channels = settings.output.channels();
    if (d_image.width, d_image.height, d_image.channels) != (camera.width, camera.height, channels)
        || d_image.data.len() != camera.width * camera.height * channels
    {
        return Err(SceneError::Camera {
            what: format!(
                "the adjoint image is {}×{}×{}, the film {}×{}×{channels}",
                d_image.width, d_image.height, d_image.channels, camera.width, camera.height
            ),
        });
    }
    Ok(())
}
