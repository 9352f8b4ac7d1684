//! The terms of a derivative: selects the estimators for the requested slots, decides how many samples each draws, and draws them in a
//! fixed order.

pub(super) mod caustic_edges;
pub(super) mod caustics;
pub mod interior;
pub mod primary;
pub mod reflections;
pub(super) mod roughness;
pub mod secondary;
pub(super) mod seen_through;
pub mod shadow;

use std::sync::atomic::AtomicBool;

use crate::grad::environment::MovingEnvironment;
use crate::grad::estimate::{self, Images, Pass};
use crate::grad::mirrors::curved::MirrorTree;
use crate::grad::mirrors::viewpoint::{Mirrors, Viewpoint};
use crate::grad::rows::Rows;
use crate::grad::sampling::allocate::{Estimator, Moments, PilotRuns, Terms, affordable, expense, typical_bounces};
use crate::grad::sampling::edge_tree::EdgeTree;
use crate::grad::sampling::guide::{GuideCache, GuideTraining};
use crate::grad::sink::{DenseSums, DirectionalDerivative, DirectionalDerivatives, Layout, Tangents};
use crate::image::Image;
use crate::ranks;
use crate::render::light_film::LightFilms;
use crate::render::sampler::hash;
use crate::render::texture::Filter;
use crate::render::{Camera, Input, Output, Scene, Settings, Slot, SphericalMap};
use crate::work;

use self::caustic_edges::{CausticEdges, CausticRims};
use self::caustics::Caustics;
use self::interior::Interior;
use self::primary::PrimaryEdges;
use self::reflections::Reflections;
use self::roughness::RoughnessPairs;
use self::secondary::Secondary;
use self::seen_through::SeenThrough;
use self::shadow::Shadows;

/// Most samples of one sequence over the image. More are drawn in rounds, each with its own sequence.
const MAX_SEQUENCE: usize = 1 << 22;

/// The destination of derivatives.
pub enum Accumulator<'a> {
    /// Reverse mode: derivatives of all slots.
    Slots(&'a mut DenseSums),
    /// The same for an adjoint image that the sampling density does not follow.
    Weighted(&'a Image, &'a mut DenseSums),
    /// Derivatives of each pixel in each slot.
    Rows(&'a mut Rows),
    /// Forward mode along one direction, and along several.
    Direction(&'a [f32], &'a mut Images),
    /// Forward mode along several directions at once.
    Directions(&'a Tangents, &'a mut Images),
}

impl Accumulator<'_> {
    fn pass(&mut self, request: &Request, pass: &dyn Pass) {
        let &Request { scene, camera, layout, adjoint, stop, .. } = request;
        let reach = camera.filter.most_pixels();
        let _work = work::begin("derivatives", pass.items().div_ceil(ranks::place().count) as u64);
        match self {
            Accumulator::Slots(total) => estimate::reverse(scene, layout, adjoint, pass, total, stop),
            Accumulator::Weighted(d_image, total) => estimate::reverse(scene, layout, d_image, pass, total, stop),
            Accumulator::Rows(rows) => rows.add(scene, layout, pass, stop),
            Accumulator::Direction(tangent, images) => {
                let sink = || DirectionalDerivative { tangent, sum: 0.0 };
                estimate::forward(scene, layout, sink, pass, reach, images, stop);
            }
            Accumulator::Directions(tangents, images) => {
                let sink = || DirectionalDerivatives::new(tangents);
                estimate::forward(scene, layout, sink, pass, reach, images, stop);
            }
        }
    }
}

/// The problem: scene, camera, settings, requested slots and the adjoint image.
pub struct Request<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) camera: &'a Camera,
    pub(crate) settings: &'a Settings,
    pub(crate) layout: &'a Layout,
    /// The adjoint image. The sampling density follows its magnitude.
    pub adjoint: &'a Image,
    pub(crate) guides: Option<&'a GuideCache>,
    /// After this is set samples may be left out, and the result is meaningless.
    pub stop: &'a AtomicBool,
}

/// All estimators whose terms can be non-zero for the requested slots, in a fixed order.
pub fn run_estimators(request: &Request, accumulator: &mut Accumulator) {
    let &Request { scene, camera, settings, layout, adjoint, guides, .. } = request;
    if layout.size() == 0 {
        return;
    }
    let seed = hash(settings.seed, 0x61_646a_6f69_6e74);
    let has_paths = settings.has_paths();
    let interior = (has_paths && !interior_vanishes(scene, settings, layout))
        .then(|| Interior::new(scene, camera, settings, layout, adjoint));
    let films = settings.has_caustics().then(|| LightFilms::new(scene)).flatten();
    let caustics = Caustics::new(scene, camera, films.as_ref(), settings);
    if !settings.boundary || !layout.moves_visibility() {
        return without_boundary(interior, caustics, request, seed, accumulator);
    }

    let lights = has_paths && settings.output == Output::Radiance && settings.max_bounces > 0;
    let mirrors = if lights { Mirrors::new(scene, layout) } else { Mirrors::default() };
    let tree = lights.then(|| EdgeTree::new(scene));
    let curved = (!mirrors.curved.is_empty()).then(|| MirrorTree::new(scene, camera, &mirrors.curved));
    let curved = curved.as_ref();
    let all_curved =
        curved.filter(|_| settings.max_bounces > 1).map(|_| MirrorTree::all(scene, camera, &mirrors.curved));
    let all_curved = all_curved.filter(|tree| !tree.is_empty());
    let viewpoints = Viewpoint::all(scene, camera, &mirrors.planes);

    let primary = (has_paths && layout.moves_things()).then(|| PrimaryEdges::new(&viewpoints, settings, adjoint, seed));
    if let Some(pass) = primary.as_ref().and_then(PrimaryEdges::enumeration) {
        accumulator.pass(request, &pass);
    }
    let reflections = curved.and_then(|tree| Reflections::new(scene, camera, tree, settings, adjoint, seed));

    let seen_through = SeenThrough::new(scene, camera, &mirrors, settings, layout, adjoint);
    let common = caustic_edges::Common::new(scene, camera, films.as_ref(), settings, layout);
    let (edges, rims) = (CausticEdges::new(common.as_ref()), CausticRims::new(common.as_ref()));

    let training = GuideTraining { scene, layout, adjoint, guides, effort: 1.0, seed };
    let caustics = caustics.map(|c| c.guided(&training));
    let (edges, rims) = (edges.map(|c| c.guided(&training)), rims.map(|c| c.guided(&training)));
    let by_light = expense(&caustics) + expense(&edges) + expense(&rims);
    let light_estimators = |environment: MovingEnvironment| {
        let mut interior = interior.clone();
        interior.iter_mut().for_each(|i| i.detached.environment = environment);
        let shadows = tree.as_ref().map(|tree| {
            let pixels = camera.width * camera.height;
            let count = settings.spp.max(1) as usize * (pixels / 8).clamp(1024, 131_072);
            Shadows::new(scene, environment, &viewpoints, settings, curved, tree, count)
        });
        let secondary = tree.as_ref().and_then(|tree| {
            Secondary::new(environment, camera, tree, &mirrors.planes, all_curved.as_ref(), settings, &training)
        });
        let total = expense(&primary)
            + expense(&interior)
            + expense(&shadows)
            + expense(&secondary)
            + expense(&reflections)
            + expense(&seen_through)
            + by_light;
        let bounces = if lights || films.is_some() { typical_bounces(settings.max_bounces) } else { 0.0 };
        let effort = affordable(total, settings.spp, camera.width * camera.height, bounces);
        let training = GuideTraining { effort, ..training };
        let shadows = shadows.map(|s| s.guided(&training));
        let secondary = secondary.map(|s| s.guided(&training));
        let runs = PilotRuns::new(scene, layout, adjoint, effort, seed);
        let moments = Terms {
            primary: runs.of(&primary),
            interior: runs.of(&interior),
            shadow: runs.of(&shadows),
            secondary: runs.of(&secondary),
            ..Terms::default()
        };
        ((interior, shadows, secondary), moments, runs)
    };
    let whole = lights && texel_steps_turn(scene, layout);
    let (mut estimators, mut moments, mut runs) =
        light_estimators(if whole { MovingEnvironment::Whole } else { MovingEnvironment::Peak });
    if scene.environment.is_some() && lights && !whole {
        let (others, other, other_runs) = light_estimators(MovingEnvironment::Whole);
        // If a mirror shows more of the receivers than the camera sees directly, edge-first samples that rarely end where the camera
        // looks would seem to have little noise.
        if other.shadow.found() && moments.advantage_over(&other) < 0.0 {
            (estimators, moments, runs) = (others, other, other_runs);
        }
    }
    let (interior, shadows, secondary) = estimators;
    moments.reflections = runs.of(&reflections);
    moments.seen_through = runs.of(&seen_through);
    moments.caustics = runs.of(&caustics);
    moments.caustic_edges = runs.of(&edges);
    moments.caustic_rims = runs.of(&rims);
    let counts = moments.split();
    draw(&primary, counts.primary, request, seed, accumulator);
    draw(&interior, counts.interior, request, seed, accumulator);
    draw(&shadows, counts.shadow, request, seed, accumulator);
    draw(&secondary, counts.secondary, request, seed, accumulator);
    draw(&reflections, counts.reflections, request, seed, accumulator);
    draw(&seen_through, counts.seen_through, request, seed, accumulator);
    draw(&caustics, counts.caustics, request, seed, accumulator);
    draw(&edges, counts.caustic_edges, request, seed, accumulator);
    draw(&rims, counts.caustic_rims, request, seed, accumulator);
}

/// The interior term alone, with pairs of directions for derivatives in roughness if these have less noise than scores of the paths' own
/// samples.
fn without_boundary(
    mut interior: Option<Interior>,
    caustics: Option<Caustics>,
    request: &Request,
    seed: u64,
    accumulator: &mut Accumulator,
) {
    let &Request { scene, camera, settings, layout, adjoint, .. } = request;
    draw(&caustics, caustics.as_ref().map_or(0, Estimator::count), request, seed, accumulator);
    let pairs = RoughnessPairs::new(scene, camera, settings, layout, adjoint);
    let runs = PilotRuns::new(scene, layout, adjoint, 1.0, seed);
    if interior.is_some() && pairs.is_some() {
        let plain = Terms { interior: runs.of(&interior), ..Terms::<Moments>::default() };
        interior.iter_mut().for_each(|i| i.detached.distributions = true);
        let paired = Terms { interior: runs.of(&interior), roughness: runs.of(&pairs), ..Terms::default() };
        if paired.advantage_over(&plain) > 0.0 {
            let counts = paired.split();
            draw(&interior, counts.interior, request, seed, accumulator);
            return draw(&pairs, counts.roughness, request, seed, accumulator);
        }
        interior.iter_mut().for_each(|i| i.detached.distributions = false);
    }
    let own = interior.as_ref().map_or(0, Estimator::count);
    draw(&interior, own, request, seed, accumulator);
}

/// Draws the samples of an estimator, in rounds of one sequence each.
fn draw(estimator: &Option<impl Estimator>, count: usize, request: &Request, seed: u64, accumulator: &mut Accumulator) {
    let Some(estimator) = estimator else { return };
    let rounds = count.div_ceil(MAX_SEQUENCE);
    for round in 0..rounds {
        let part = count * (round + 1) / rounds - count * round / rounds;
        accumulator.pass(request, &estimator.pass(part, part as f64 / count as f64, hash(seed, round as u64)));
    }
}

/// Whether the environment turns and is piecewise constant (nearest-texel lookup). Its steps turn with it, and a radiance in fixed
/// directions would not have their derivatives.
fn texel_steps_turn(scene: &Scene, layout: &Layout) -> bool {
    let nearest = |e: &SphericalMap| scene.description.textures[e.texels].filter == Filter::Nearest;
    layout.turns_environment() && scene.description.environment.as_ref().is_some_and(nearest)
}

/// Whether no requested slot changes the radiance along a path: only emission is visible, and it is constant on each light.
fn interior_vanishes(scene: &Scene, settings: &Settings, layout: &Layout) -> bool {
    let d = &scene.description;
    let constant = |t: usize| d.textures[t].is_constant();
    let mut emitters = d.shapes.iter().filter_map(|s| s.emission.as_ref());
    settings.output == Output::Radiance
        && settings.max_bounces == 0
        && !scene.absorbs()
        && !layout.slots.iter().any(|s| matches!(s, Slot::Texels(_) | Slot::Colors(_)))
        && emitters.all(|e| matches!(e.radiance, Input::Texture(t) if constant(t)))
        && d.environment.as_ref().is_none_or(|e| constant(e.texels))
        && d.shapes.iter().filter_map(|s| s.material.opacity).all(|o| matches!(o, Input::Texture(t) if constant(t)))
}
