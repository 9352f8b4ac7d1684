//! A scene made ready for rendering: flattened triangles, ray tree, light table.

use std::ops::Deref;
use std::sync::{Arc, OnceLock};

use glam::Vec3;

use super::accel::{Accel, PrimId};
use super::bodies::{Body, bodies};
use super::contacts::table::Contacts;
use super::edges::table::EdgeTable;
use super::environment::{EnvironmentPeak, EnvironmentTable};
use super::facets::{Facet, Prim, ShapeShading};
use super::light::table::LightTable;
use super::sampler::Discrete;
use super::scene::{Camera, SceneDescription, Shape};
use super::tangents::Tangents;
use super::validate::{SceneError, validate};
use super::view::View;
use crate::math::uniform_triangle;
use crate::memory;
use crate::stop::paced;

/// A scene made ready, as it is or as a camera sees it. Copies share what was built.
#[derive(Clone)]
pub struct Scene {
    world: Arc<World>,
    /// What decides between the levels of mip maps.
    pub(super) view: Option<View>,
}

/// A scene with its acceleration structures, built once from a description and used by many passes.
pub struct World {
    /// The description that it was built from.
    pub description: SceneDescription,
    pub(crate) accel: Accel,
    pub(crate) prims: Vec<Prim>,
    pub(crate) facets: Vec<Facet>,
    /// By shape.
    pub(crate) shape_shading: Vec<ShapeShading>,
    /// By shape, of those with normal maps.
    pub(crate) tangents: Vec<Option<Tangents>>,
    pub(crate) lights: LightTable,
    pub(crate) environment: Option<EnvironmentTable>,
    pub(crate) environment_peak: Option<EnvironmentPeak>,
    /// Half the diagonal of the bounding box.
    pub(crate) radius: f32,
    /// Whether some material has a mask.
    pub(crate) masked: bool,
    /// Whether some material is clear.
    pub(crate) has_glass: bool,
    /// The bodies of glass, if some of them absorb light.
    pub(super) bodies: Vec<Body>,
    /// Built when it is first used; rendering without derivatives does not need it.
    pub(super) edge_table: OnceLock<EdgeTable>,
    pub(super) edge_table_with_seams: OnceLock<EdgeTable>,
    pub(super) contact_table: OnceLock<Contacts>,
    /// Distribution over triangles by area.
    surface: OnceLock<Discrete>,
}

impl Deref for Scene {
    type Target = World;

    #[inline(always)]
    fn deref(&self) -> &World {
        &self.world
    }
}

impl Scene {
    /// Checks the description and builds the acceleration structures.
    pub fn new(description: SceneDescription) -> Result<Scene, SceneError> {
        Scene::following(description, None)
    }

    /// [`Scene::new`], given an earlier scene such as that of the last optimisation step. If it has the same number of triangles its ray
    /// tree is refitted, which takes a fraction of the time. The rendered image does not depend on this.
    pub fn following(description: SceneDescription, before: Option<&Scene>) -> Result<Scene, SceneError> {
        validate(&description)?;
        let world = memory::bounded(|| World::build(description, before)).map_err(SceneError::Memory)?;
        Ok(Scene { world: Arc::new(world), view: None })
    }

    /// The same scene, with mip maps on the levels that a camera sees. It must not move: [`Camera::at`] is the camera at one moment.
    pub fn seen_by(&self, camera: &Camera) -> Scene {
        Scene { world: self.world.clone(), view: Some(View::new(camera)) }
    }

    /// What was built, to be changed; `None` while copies share it.
    pub(super) fn world_mut(&mut self) -> Option<&mut World> {
        Arc::get_mut(&mut self.world)
    }
}

impl World {
    fn build(description: SceneDescription, before: Option<&Scene>) -> World {
        let triangles: u64 = description.shapes.iter().map(|s| s.mesh.faces.len() as u64).sum();
        memory::need(triangles * (size_of::<Prim>() + size_of::<Facet>() + size_of::<[Vec3; 3]>()) as u64);
        let faces = |(i, shape): (usize, &Shape)| {
            (0..shape.mesh.faces.len() as u32).map(move |face| Prim { shape: i as u32, face })
        };
        let prims: Vec<Prim> = paced(description.shapes.iter().enumerate().flat_map(faces), 2).collect();
        let corners = corners(&description);
        let radius = radius(&corners);
        let sky = description.environment.as_ref().map(|e| description.textures[e.texels].unpacked());
        let environment = sky.as_deref().map(EnvironmentTable::new);
        let environment_peak = sky.as_deref().and_then(EnvironmentPeak::new);
        drop(sky);
        let lights = LightTable::new(&description, &prims, radius, environment_peak.as_ref());
        let facets =
            paced(prims.iter().zip(&corners), 16).map(|(prim, corners)| Facet::new(prim.shape, *corners)).collect();
        let shape_shading = description.shapes.iter().map(|s| ShapeShading::new(&description, s)).collect();
        let accel = match before.filter(|before| before.prims.len() == prims.len()) {
            Some(before) => {
                let mut accel = before.accel.clone();
                accel.refit_or_rebuild(&corners);
                accel
            }
            None => Accel::new(&corners),
        };
        World {
            facets,
            shape_shading,
            tangents: description.shapes.iter().map(Tangents::new).collect(),
            masked: description.shapes.iter().any(|s| s.material.opacity.is_some()),
            has_glass: description.shapes.iter().any(|s| s.material.kind.is_clear()),
            bodies: bodies(&description),
            accel,
            description,
            prims,
            lights,
            environment,
            environment_peak,
            radius,
            edge_table: OnceLock::new(),
            edge_table_with_seams: OnceLock::new(),
            contact_table: OnceLock::new(),
            surface: OnceLock::new(),
        }
    }

    /// Updates everything after vertices and normals of the description have changed.
    pub(crate) fn refit(&mut self) {
        let corners = corners(&self.description);
        self.accel.refit_or_rebuild(&corners);
        for (facet, corners) in self.facets.iter_mut().zip(&corners) {
            *facet = Facet::new(facet.shape, *corners);
        }
        self.tangents = self.description.shapes.iter().map(Tangents::new).collect();
        self.bodies = bodies(&self.description);
        self.radius = radius(&corners);
        self.relight();
        self.edge_table = OnceLock::new();
        self.edge_table_with_seams = OnceLock::new();
        self.contact_table = OnceLock::new();
        self.surface = OnceLock::new();
    }

    /// Updates the lights after lights without area in the description have changed.
    pub(crate) fn relight(&mut self) {
        self.lights = LightTable::new(&self.description, &self.prims, self.radius, self.environment_peak.as_ref());
    }

    /// World-space corners of a primitive.
    #[inline]
    pub(crate) fn corners(&self, prim: PrimId) -> [Vec3; 3] {
        self.facets[prim as usize].corners
    }

    fn surface(&self) -> &Discrete {
        self.surface.get_or_init(|| {
            let area = |[a, b, c]: [Vec3; 3]| f64::from(0.5 * (b - a).cross(c - a).length());
            Discrete::new(paced(&self.facets, 4).map(|f| area(f.corners)))
        })
    }

    /// Samples a point on all surfaces, uniformly by area; the first number chooses the triangle. The scene must have a surface.
    pub(crate) fn surface_point(&self, which: f32, u: [f32; 2]) -> (PrimId, Vec3) {
        let (prim, ..) = self.surface().sample(f64::from(which));
        (prim as PrimId, self.facets[prim].point(uniform_triangle(u)))
    }

    /// Density of [`Scene::surface_point`], per unit area.
    pub(crate) fn surface_pdf(&self) -> f32 {
        1.0 / self.surface().total() as f32
    }
}

/// Corners of all triangles, in the order of the primitives.
fn corners(description: &SceneDescription) -> Vec<[Vec3; 3]> {
    let meshes = description.shapes.iter().map(|s| &s.mesh);
    paced(meshes.flat_map(|m| m.faces.iter().map(|f| f.map(|v| m.vertices[v as usize]))), 4).collect()
}

/// Half the diagonal of the bounding box; 1 for an empty scene.
fn radius(corners: &[[Vec3; 3]]) -> f32 {
    let points = paced(corners.iter().flatten(), 1);
    let (lo, hi) = points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), p| (lo.min(*p), hi.max(*p)));
    if corners.is_empty() { 1.0 } else { 0.5 * (hi - lo).length() }
}
