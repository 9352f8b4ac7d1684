//! State that the renderings of an optimisation's step leave for those of the next: guides (where samples contributed most) and images
//! as control variates. An optimisation owns it and lends it to the engine for each step.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use serde::{Deserialize, Serialize};

use crate::grad::{self, GuideCache, SceneError, Settings};
use crate::image::Image;
use crate::render::Camera;
use crate::render::recursion::Recursion;

use super::lower::Lowered;
use super::mix;

/// The sites of all renderings of an optimisation, with what each leaves for the next step.
#[derive(Clone, Default)]
pub struct History {
    sites: Vec<Site>,
    /// The params at the steps whose scenes are still needed: a run that is resumed builds those scenes from them again.
    places: BTreeMap<u64, Vec<Vec<f64>>>,
    /// The step that is evaluated once more to get its scenes back, in a run that is resumed.
    revisited: Option<u64>,
}

/// A rendering that recurs at every step: at the same place in the program, in the same world, with the same camera (unless params move
/// the camera).
pub(super) struct Site {
    key: u64,
    /// Whether the current step has rendered it already.
    visited: bool,
    pub(super) guides: Arc<GuideCache>,
    last: Option<Last>,
    /// A last step that was stored, and whose scene is yet to be built.
    stored: Option<StoredLast>,
}

/// The scene of the last step and the estimate of its image.
#[derive(Clone)]
struct Last {
    step: u64,
    scene: Arc<Lowered>,
    camera: Camera,
    max_bounces: u32,
    recursion: Recursion,
}

/// A history without its scenes, which are large and follow from the program and its params.
#[derive(Default, Serialize, Deserialize)]
pub struct StoredHistory {
    sites: Vec<StoredSite>,
    places: BTreeMap<u64, Vec<Vec<f64>>>,
}

#[derive(Serialize, Deserialize)]
struct StoredSite {
    key: u64,
    guides: GuideCache,
    last: Option<StoredLast>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct StoredLast {
    step: u64,
    /// The first site that has the same scene.
    scene: usize,
    max_bounces: u32,
    recursion: Recursion,
}

/// Most sites and most scenes that are kept. A program may choose new cameras at every step, so sites that do not recur must be dropped;
/// scenes are large.
const MOST_SITES: usize = 256;
const MOST_SCENES: usize = 4;

/// What tells sites apart. Cameras that differ in nothing that is printed are the same to the bit.
pub(super) fn site_key(place: u64, camera: Option<Camera>) -> u64 {
    camera.map_or(place, |camera| format!("{camera:?}").bytes().fold(place, |key, byte| mix(key, u64::from(byte))))
}

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

    /// Remembers where the params are at a step whose images later ones go on from.
    pub fn note_place(&mut self, step: u64, values: Vec<Vec<f64>>) {
        let sites = &self.sites;
        self.places.retain(|step, _| sites.iter().any(|s| s.last.as_ref().is_some_and(|last| last.step == *step)));
        self.places.insert(step, values);
    }

    /// The first matching site that the current step has not used yet. Sites are ordered by their last use.
    pub(super) fn site(&mut self, key: u64) -> &mut Site {
        let here = |s: &Site| !s.visited && s.key == key;
        let known = self.sites.iter().position(here).map(|i| self.sites.remove(i));
        let new = || Site { key, visited: true, guides: Arc::default(), last: None, stored: None };
        let site = known.unwrap_or_else(new);
        self.sites.push(Site { visited: true, ..site });
        let last = self.sites.len() - 1;
        &mut self.sites[last]
    }

    // ---- stored and resumed ----------------------------------------------------------------------------------------

    /// What a checkpoint keeps of it.
    pub(crate) fn store(&self) -> StoredHistory {
        let scene_of = |site: &Site| site.last.as_ref().map(|last| Arc::as_ptr(&last.scene));
        let stored = |site: &Site, last: &Last| StoredLast {
            step: last.step,
            scene: self.sites.iter().position(|other| scene_of(other) == scene_of(site)).unwrap_or_default(),
            max_bounces: last.max_bounces,
            recursion: last.recursion.clone(),
        };
        let site = |site: &Site| StoredSite {
            key: site.key,
            guides: (*site.guides).clone(),
            last: site.last.as_ref().map(|last| stored(site, last)),
        };
        StoredHistory { sites: self.sites.iter().map(site).collect(), places: self.places.clone() }
    }

    /// A history that was stored. Each of [`History::places`] is to be revisited before it is used.
    pub fn resumed(stored: StoredHistory) -> History {
        let site = |site: StoredSite| Site {
            key: site.key,
            visited: false,
            guides: Arc::new(site.guides),
            last: None,
            stored: site.last,
        };
        let sites = stored.sites.into_iter().map(site).collect();
        History { sites, places: stored.places, revisited: None }
    }

    /// Steps with the params at them, from which scenes are yet to be built.
    pub fn places(&self) -> Vec<(u64, Vec<Vec<f64>>)> {
        let is_needed =
            |step: u64| self.sites.iter().any(|s| s.stored.as_ref().is_some_and(|stored| stored.step == step));
        self.places.iter().filter(|(step, _)| is_needed(**step)).map(|(step, at)| (*step, at.clone())).collect()
    }

    pub(super) fn begin_revisit(&mut self, step: u64) {
        self.sites.iter_mut().for_each(|site| site.visited = false);
        self.revisited = Some(step);
    }

    pub(super) fn is_revisiting(&self) -> bool {
        self.revisited.is_some()
    }

    /// A rendering of the step that is revisited: its scene is what the site lacks. Returns the estimate that the step had.
    pub(super) fn revisit(&mut self, key: u64, scene: &Arc<Lowered>, camera: Camera) -> Option<Image> {
        let step = self.revisited?;
        let here = |s: &&mut Site| !s.visited && s.key == key && s.stored.as_ref().is_some_and(|l| l.step == step);
        let at = self.sites.iter_mut().find(here)?;
        at.visited = true;
        let StoredLast { max_bounces, recursion, .. } = at.stored.clone()?;
        let image = recursion.image().clone();
        at.last = Some(Last { step, scene: scene.clone(), camera, max_bounces, recursion });
        Some(image)
    }

    /// All has been revisited: sites that shared a scene share one again.
    pub fn end_revisits(&mut self) {
        self.revisited = None;
        let scenes: Vec<Option<Arc<Lowered>>> =
            self.sites.iter().map(|site| site.last.as_ref().map(|last| last.scene.clone())).collect();
        for site in &mut self.sites {
            let stored = site.stored.take();
            if let (Some(last), Some(stored)) = (&mut site.last, stored)
                && let Some(Some(scene)) = scenes.get(stored.scene)
            {
                last.scene = scene.clone();
            }
        }
    }
}

impl Clone for Site {
    /// With guides of its own, which a step changes in place.
    fn clone(&self) -> Site {
        let guides = Arc::new((*self.guides).clone());
        Site { guides, last: self.last.clone(), stored: self.stored.clone(), ..*self }
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
        step: u64,
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
        let max_bounces = settings.max_bounces;
        self.last = Some(Last { step, scene: scene.clone(), camera, max_bounces, recursion });
        Ok(found)
    }
}
