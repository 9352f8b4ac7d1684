//! State that the renderings of an optimisation's step leave for those of the next: guides (where samples contributed most) and images
//! as control variates. An optimisation owns it and lends it to the engine for each step.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use crate::grad::{self, GuideCache, SceneError, Settings};
use crate::image::Image;
use crate::render::Camera;
use crate::render::recursion::Recursion;
use crate::source::Span;

use super::lower::Lowered;

/// The sites of all renderings of an optimisation, with what each leaves for the next step.
#[derive(Default)]
pub struct History {
    sites: Vec<Site>,
}

/// A rendering that recurs at every step: at the same place in the program, in the same world, with the same camera (unless params move
/// the camera).
pub(super) struct Site {
    span: Span,
    path: u64,
    camera: Option<Camera>,
    /// Whether the current step has rendered it already.
    visited: bool,
    pub(super) guides: Arc<GuideCache>,
    last: Option<Last>,
}

/// The scene of the last step and the estimate of its image.
struct Last {
    scene: Arc<Lowered>,
    camera: Camera,
    max_bounces: u32,
    recursion: Recursion,
}

/// Most sites and most scenes that are kept. A program may choose new cameras at every step, so sites that do not recur must be dropped;
/// scenes are large.
const MOST_SITES: usize = 256;
const MOST_SCENES: usize = 4;

impl History {
    pub(super) fn begin_step(&mut self) {
        let surplus = self.sites.len().saturating_sub(MOST_SITES);
        self.sites.drain(..surplus);
        let mut scenes: Vec<*const Lowered> = Vec::new();
        for site in self.sites.iter_mut().rev() {
            site.visited = false;
            let Some(scene) = site.last.as_ref().map(|last| Arc::as_ptr(&last.scene)) else { continue };
            if scenes.contains(&scene) {
                continue;
            }
            if scenes.len() < MOST_SCENES {
                scenes.push(scene);
            } else {
                site.last = None;
            }
        }
    }

    /// The first matching site that the current step has not used yet. Sites are ordered by their last use.
    pub(super) fn site(&mut self, span: Span, path: u64, camera: Option<Camera>) -> &mut Site {
        let here = |s: &Site| !s.visited && (s.span, s.path) == (span, path) && s.camera == camera;
        let known = self.sites.iter().position(here).map(|i| self.sites.remove(i));
        let new = || Site { span, path, camera, visited: true, guides: Arc::default(), last: None };
        let site = known.unwrap_or_else(new);
        self.sites.push(Site { visited: true, ..site });
        let last = self.sites.len() - 1;
        &mut self.sites[last]
    }
}

impl Site {
    /// Whether [`Site::next`] also renders the scene of the last step again.
    pub(super) fn goes_on(&self) -> bool {
        self.last.is_some()
    }

    /// The step's image from its own rendering `image` and the estimate from the steps before.
    pub(super) fn next(
        &mut self,
        image: Image,
        scene: &Arc<Lowered>,
        camera: Camera,
        settings: &Settings,
        stop: &AtomicBool,
    ) -> Result<Image, SceneError> {
        // With another number of bounces the expected image differs, so the estimate starts again.
        let fits = |last: &Last| last.recursion.fits(&image) && last.max_bounces == settings.max_bounces;
        let recursion = match self.last.take().filter(fits) {
            Some(mut last) => {
                let before = grad::render_until(&last.scene.scene, &last.camera, settings, stop)?;
                last.recursion.advance(&image, &before);
                last.recursion
            }
            None => Recursion::new(image),
        };
        let found = recursion.image().clone();
        self.last = Some(Last { scene: scene.clone(), camera, max_bounces: settings.max_bounces, recursion });
        Ok(found)
    }
}
