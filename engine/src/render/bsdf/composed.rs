//! How a material is put together: a model, its grain, the sheen and the coat over it, and what it is blended with.

use std::convert::Infallible;

use glam::Vec3;

use super::Bsdf;
use super::blended::Blended;
use super::brushed::Grain;
use super::coated::Coated;
use super::layer::Layer;
use super::lit::Lit;
use super::lobes::Lobes;
use super::matte::Matte;
use super::sheened::Sheened;
use crate::math::Frame;
use crate::render::material::{self, Blend, ClearCoat, InputField, Material, SheenLayer};

impl<I> Material<I> {
    /// What it does at a point where `value` gives its inputs.
    #[inline(always)]
    pub fn try_bsdf<E>(&self, mut value: impl FnMut(InputField, &I) -> Result<Vec3, E>) -> Result<Bsdf, E> {
        let mut bsdf = Bsdf::new(&self.kind.try_map(&mut value)?);
        if let Some(grain) = &self.grain {
            bsdf = bsdf.brushed(&grain.try_map(&mut value)?);
        }
        if let Some(sheen) = &self.sheen {
            bsdf = bsdf.sheened(&sheen.try_map(&mut value)?);
        }
        if let Some(coat) = &self.coat {
            bsdf = bsdf.coated(&coat.try_map(&mut value)?);
        }
        if let Some(blend) = &self.blend {
            bsdf = bsdf.blended(&blend.try_map(&mut value)?);
        }
        Ok(bsdf)
    }

    /// As [`Material::try_bsdf`], of what cannot fail.
    #[inline(always)]
    pub fn bsdf(&self, mut value: impl FnMut(InputField, &I) -> Vec3) -> Bsdf {
        let Ok(bsdf) = self.try_bsdf(|field, input| Ok::<Vec3, Infallible>(value(field, input)));
        bsdf
    }
}

impl Bsdf {
    /// The same with a grain in its GGX lobe, of which the inputs have these values. What has no such lobe has no grain.
    pub fn brushed(self, grain: &material::Grain<Vec3>) -> Bsdf {
        match self {
            Bsdf::Layer(Layer::Bare(lobes)) => {
                let grain = Grain::new(grain.anisotropy.x.clamp(0.0, 1.0), grain.turn.x);
                Bsdf::Layer(Layer::Bare(lobes.brushed(grain)))
            }
            other => other,
        }
    }

    /// Whether it depends on how the surface lies about its normal.
    #[inline]
    pub fn has_grain(&self) -> bool {
        match self {
            Bsdf::Layer(layer) => layer.lobes().is_some_and(Lobes::has_grain),
            Bsdf::Blended(blended) => blended.layers.iter().any(|layer| layer.lobes().is_some_and(Lobes::has_grain)),
            _ => false,
        }
    }

    /// The same with another thing made of each of its grains.
    fn with_grains(mut self, make: impl Fn(Grain) -> Grain) -> Bsdf {
        let layers = match &mut self {
            Bsdf::Layer(layer) => std::slice::from_mut(layer),
            Bsdf::Blended(blended) => &mut blended.layers[..],
            _ => &mut [],
        };
        for grain in layers.iter_mut().filter_map(|layer| layer.lobes_mut()?.grain_mut()) {
            *grain = make(*grain);
        }
        self
    }

    /// The same on a surface with this tangent and bitangent, unit vectors perpendicular to each other and to the normal.
    pub fn laid(self, axes: [Vec3; 2]) -> Bsdf {
        self.with_grains(|grain| grain.laid(axes))
    }

    /// The same for directions in the coordinates of a frame.
    pub fn in_frame(self, frame: &Frame) -> Bsdf {
        self.with_grains(|grain| grain.in_frame(frame))
    }

    /// Its lobes, as those of a part of a blend; `None` of what scatters no light, or in single directions, and of a body of rough glass.
    fn layer(self) -> Option<Layer> {
        match self {
            Bsdf::Diffuse { reflectance } => Some(Layer::Bare(Lobes::Matte(Matte { reflectance }))),
            Bsdf::Layer(layer) => Some(layer),
            Bsdf::RoughPane(pane) => Some(Layer::Pane(pane)),
            _ => None,
        }
    }

    /// The same under a sheen, of which the inputs have these values. What scatters no light, or in single directions, has none.
    pub fn sheened(self, sheen: &SheenLayer<Vec3>) -> Bsdf {
        let color = sheen.color.clamp(Vec3::ZERO, Vec3::ONE);
        let roughness = sheen.roughness.x.clamp(0.0, 1.0);
        match self.layer() {
            Some(Layer::Bare(under)) => Bsdf::Layer(Layer::Sheened(Sheened { color, roughness, under })),
            _ => self,
        }
    }

    /// The same under a clear coat, of which the inputs have these values. What scatters no light, or in single directions, has no coat.
    pub fn coated(self, coat: &ClearCoat<Vec3>) -> Bsdf {
        let [weight, roughness] = [coat.weight.x, coat.roughness.x].map(|x| x.clamp(0.0, 1.0));
        match self.layer() {
            Some(Layer::Bare(under)) => Bsdf::Layer(Layer::Coated(Coated { weight, roughness, under })),
            Some(Layer::Sheened(under)) => Bsdf::Layer(Layer::CoatedSheen(Coated { weight, roughness, under })),
            _ => self,
        }
    }

    /// The same blended with another material, of which the inputs have these values. What scatters no light, or in single directions, is not.
    pub fn blended(self, blend: &Blend<Vec3>) -> Bsdf {
        let mut other = Bsdf::new(&blend.kind);
        if let Some(grain) = &blend.grain {
            other = other.brushed(grain);
        }
        if let Some(sheen) = &blend.sheen {
            other = other.sheened(sheen);
        }
        if let Some(coat) = &blend.coat {
            other = other.coated(coat);
        }
        match self.layer().zip(other.layer()) {
            Some((a, b)) => Bsdf::Blended(Blended { layers: [a, b], weight: blend.weight.x.clamp(0.0, 1.0) }),
            None => self,
        }
    }
}
