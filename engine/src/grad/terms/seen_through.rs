//! Boundary term of edges that the camera sees by way of several specular surfaces: through glass, in a mirror behind glass, in a mirror
//! seen in a mirror. (What one mirror alone shows is found exactly, by [`super::primary`] and [`super::reflections`].)
//!
//! The radiance of a pixel is an integral over its film. It jumps where the chain of specular surfaces that leads from the camera hits
//! another surface on one side than on the other: [`crate::grad::sampling::jumps`] says how such places are found, and what they count.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::grad::estimate::{Draw, Estimate, Pass, Sequence};
use crate::grad::mirrors::viewpoint::Mirrors;
use crate::grad::sampling::allocate::{Estimator, typical_bounces};
use crate::grad::sampling::jumps::{Jumps, Line, Nowhere, d_links, slope_on_film};
use crate::grad::sampling::pixels::{FilmDensity, active};
use crate::grad::sink::{Adjoints, Layout};
use crate::image::Image;
use crate::render::integrator::{NoRecord, Options, Start, trace};
use crate::render::sampler::{Sampler, hash};
use crate::render::specular::{Chain, Transport};
use crate::render::{Camera, Output, PixelFilter, Scene, Settings};

/// The estimator of edges that are seen by way of several specular surfaces.
pub struct SeenThrough<'a> {
    scene: &'a Scene,
    camera: &'a Camera,
    layout: &'a Layout,
    max_bounces: u32,
    jumps: Jumps<'a>,
    film: FilmDensity,
    count: usize,
}

impl<'a> SeenThrough<'a> {
    /// `None` if no chain can show an edge.
    pub fn new(
        scene: &'a Scene,
        camera: &'a Camera,
        mirrors: &Mirrors,
        settings: &Settings,
        layout: &'a Layout,
        adjoint: &Image,
    ) -> Option<SeenThrough<'a>> {
        let shapes = &scene.description.shapes;
        let chains = shapes.iter().any(|s| s.material.kind.is_smooth_glass()) || !mirrors.show_no_mirror();
        if !settings.has_paths()
            || settings.output != Output::Radiance
            || settings.max_bounces == 0
            || scene.masked
            || !chains
        {
            return None;
        }
        // Lines are drawn over squares of the film, whatever the filter.
        let cells = Camera { filter: PixelFilter::Box, ..*camera };
        let mut seen = SeenThrough {
            scene,
            camera,
            layout,
            max_bounces: settings.max_bounces,
            jumps: Jumps::new(scene),
            film: FilmDensity::new(&cells, adjoint),
            count: 0,
        };
        if seen.jumps.table.edges.is_empty() || seen.film.is_empty() {
            return None;
        }
        let (film, shown) = seen.where_chains_are(&cells, adjoint);
        seen.film = film;
        let spp = settings.spp.max(1) as usize;
        seen.count = (shown * spp / 2).max(active(adjoint) / 8).max(64);
        Some(seen)
    }

    /// The density of lines on film, which is small in pixels whose corners and middle show nothing specular; and the number of the
    /// others.
    fn where_chains_are(&self, cells: &Camera, adjoint: &Image) -> (FilmDensity, usize) {
        const ELSEWHERE: f32 = 0.02;
        let specular = |pixel: Vec2| {
            let hit = self.scene.accel.closest(&self.camera.ray(pixel), &[]);
            hit.is_some_and(|hit| {
                let shape = self.scene.prims[hit.prim as usize].shape as usize;
                self.scene.description.shapes[shape].material.kind.is_delta()
            })
        };
        let reach = 0.98 * self.camera.filter.radius();
        let shows = |i: usize| {
            let corner = Vec2::new((i % adjoint.width) as f32, (i / adjoint.width) as f32);
            let centre = self.camera.corner() + corner + 0.5;
            let places = [[0.0, 0.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]];
            places.into_iter().any(|place| specular(centre + reach * Vec2::from_array(place)))
        };
        let mut weights = adjoint.clone();
        let pixels = weights.data.par_chunks_exact_mut(adjoint.channels).enumerate();
        let shown = pixels
            .filter_map(|(i, values)| {
                let shown = values.iter().any(|v| *v != 0.0) && shows(i);
                if !shown {
                    values.iter_mut().for_each(|v| *v *= ELSEWHERE);
                }
                shown.then_some(())
            })
            .count();
        (FilmDensity::new(cells, &weights), shown)
    }

    /// The chain that the camera sees at a point of its film.
    fn chain(&self, camera: &Camera, line: &Line, pixel: Vec2) -> Chain {
        let (mut chain, most) = (Chain::default(), self.max_bounces as usize);
        chain.follow(self.scene, camera.ray(pixel), most, Transport::Radiance, |k, si| line.lobe(k, si));
        chain
    }

    /// The radiance that a chain brings to the camera from beyond its first `k` links.
    fn radiance(&self, chain: &Chain, k: usize, sampler: &Sampler) -> Vec3 {
        let link = &chain.links[k - 1];
        let options = Options { inside: Some(link.inside), ..Options::new(self.max_bounces - k as u32) };
        let start = Start::Ray(chain.rays[k], &[link.si.prim]);
        link.weight * trace(self.scene, start, &mut sampler.clone(), &options, &mut NoRecord)
    }
}

impl Draw for SeenThrough<'_> {
    type Scratch = ();

    fn draw(&self, first: f64, mut sampler: Sampler, weight: f64, _: &mut (), out: &mut dyn Estimate) {
        let film = self.film.place([first, f64::from(sampler.next_1d())]);
        if out.skips(&[(film.pixel as u32, 1.0)]) {
            return;
        }
        let camera = self.camera.sample_lens(&mut sampler);
        let [which, offset] = sampler.next_2d().into();
        let corner = film.position.floor();
        let (within, centre) = (film.position - corner, corner + 0.5);
        // One of the squares that the pixel's filter covers, each as likely as the others.
        let reach = self.camera.margin().ceil();
        let squares = 2.0 * reach + 1.0;
        let beside = if reach > 0.0 { (sampler.next_2d() * squares).floor() - reach } else { Vec2::ZERO };
        let corner = corner + beside;
        let line = Line::new(corner, within, which < 0.5, &mut sampler);
        // One of both directions was chosen.
        let weight = 2.0 * squares * squares * (film.weight * weight) as f32;
        let seen = |pixel: Vec2| self.chain(&camera, &line, pixel);
        let differs = |a: &Chain, b: &Chain| self.jumps.parts(a, b).is_some();
        line.march(offset, &seen, &differs, &mut |pixel, a, b| {
            let Some(k) = self.jumps.parts(a, b) else { return };
            // Directly visible edges, and those that a mirror alone shows, belong to others.
            let alone = k == 1 && a.links[0].si.bsdf.is_mirror();
            if k == 0 || alone {
                return;
            }
            let Some(passed) = self.jumps.passed(a, b, k) else { return };
            if passed.is_at_start(&a.rays[k]) {
                return;
            }
            let links = &a.links[..k];
            let mut nowhere = Nowhere;
            let ray = d_links(&mut Adjoints::new(self.scene, self.layout, &mut nowhere), links, passed.d_ray(1.0));
            let slope = slope_on_film(&camera, pixel, ray);
            // What stands on something throws its light on it, which is found a little aside only.
            let clear = self.jumps.aside(&passed, pixel, slope, line.ahead()).map(|places| places.map(seen));
            let side = |i: usize, near: &Chain| {
                let clear = clear.as_ref().map(|sides| &sides[i]).filter(|chain| passed.is_foot_of(chain, k));
                self.radiance(clear.unwrap_or(near), k, &sampler)
            };
            let jump = side(0, a) - side(1, b);
            if jump == Vec3::ZERO || !jump.is_finite() {
                return;
            }
            let motion = line.motion(slope);
            let filter = if reach > 0.0 { self.camera.filter.weight(pixel - centre) } else { 1.0 };
            let m = jump * (-weight * filter * motion);
            if !m.is_finite() {
                return;
            }
            out.pixel(film.pixel, &mut |d, out| {
                let d_h = d.dot(m);
                passed.d_point(out, &a.rays[k], passed.normal * d_h);
                let ray = d_links(out, links, passed.d_ray(d_h));
                camera.d_ray(pixel, ray.origin, ray.dir, &mut out.camera);
            });
        });
    }
}

impl Estimator for SeenThrough<'_> {
    fn count(&self) -> usize {
        self.count
    }

    fn cost(&self) -> f64 {
        40.0 + 4.0 * typical_bounces(self.max_bounces)
    }

    fn pass(&self, count: usize, share: f64, seed: u64) -> impl Pass + '_ {
        Sequence { of: self, count, weight: share / count as f64, seed: hash(seed, 0x0074_6872_6f75_6768) }
    }
}
