//! A model, bare or under a sheen, a clear coat or both; or, in a blend, a rough pane.

use glam::Vec3;

use super::angles::Angles;
use super::coated::Coated;
use super::lit::Lit;
use super::lobes::{Chosen, Lobes};
use super::rough_pane::RoughPane;
use super::sheened::Sheened;
use super::{ATTACHED_ALPHA, BsdfAdjoint, Part};
use crate::render::material::MAX_INPUTS;

/// The lobes of a layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Layer {
    Bare(Lobes),
    Sheened(Sheened),
    Coated(Coated<Lobes>),
    CoatedSheen(Coated<Sheened>),
    /// In a blend only; by itself it is [`Bsdf::RoughPane`](super::Bsdf::RoughPane).
    Pane(RoughPane),
}

/// Evaluates an expression in what a layer is, which is [`Lit`].
macro_rules! with_lit {
    ($layer:expr, $lit:ident => $value:expr) => {
        match $layer {
            Layer::Bare($lit) => $value,
            Layer::Sheened($lit) => $value,
            Layer::Coated($lit) => $value,
            Layer::CoatedSheen($lit) => $value,
            Layer::Pane($lit) => $value,
        }
    };
}

impl Layer {
    /// Whether anything lies over the model.
    #[inline]
    pub fn is_covered(&self) -> bool {
        !matches!(self, Layer::Bare(_) | Layer::Pane(_))
    }

    /// The pane, if it is one, which lets light through.
    #[inline]
    pub fn pane(&self) -> Option<&RoughPane> {
        match self {
            Layer::Pane(pane) => Some(pane),
            _ => None,
        }
    }

    /// The width α of the coat's lobe, if there is a coat.
    fn coat_alpha(&self) -> Option<f32> {
        match self {
            Layer::Bare(_) | Layer::Sheened(_) | Layer::Pane(_) => None,
            Layer::Coated(coated) => Some(coated.coat_alpha()),
            Layer::CoatedSheen(coated) => Some(coated.coat_alpha()),
        }
    }

    fn narrow_lobes(&self) -> [bool; 2] {
        let coat = self.coat_alpha().is_some_and(|alpha| alpha < ATTACHED_ALPHA);
        // The facets of a pane are attached at every roughness.
        let lobe = self.lobes().is_none_or(|lobes| lobes.has_lobe() && lobes.alpha() < ATTACHED_ALPHA);
        [lobe, coat]
    }

    /// Whether a lobe is so narrow that it is attached ([`Bsdf::is_attached`](super::Bsdf::is_attached)).
    pub fn is_narrow(&self) -> bool {
        self.narrow_lobes() != [false; 2]
    }

    /// The lobes of a part of a material. The specular one has those that are attached, or, if no lobe of the material is (`any_narrow`), the
    /// microfacet lobes of the model and of the coat.
    pub fn chosen(&self, part: Part, any_narrow: bool) -> Chosen {
        let [lobe, coat] = self.narrow_lobes().map(|is_narrow| is_narrow || !any_narrow);
        match part {
            Part::Specular => Chosen { base: false, lobe, sheen: false, coat },
            Part::Diffuse => Chosen { base: true, lobe: !lobe, sheen: true, coat: !coat },
        }
    }

    /// Whether all its light belongs to the specular part.
    pub fn is_specular(&self, any_narrow: bool) -> bool {
        let rest = self.chosen(Part::Diffuse, any_narrow);
        let has_sheen = matches!(self, Layer::Sheened(_) | Layer::CoatedSheen(_));
        let has_base = self.lobes().is_some_and(Lobes::has_base);
        !(has_base || rest.lobe || has_sheen || rest.coat && self.coat_alpha().is_some())
    }

    /// What the albedo channel shows: the model without what lies over it, and white for a pane.
    pub fn albedo(&self) -> Vec3 {
        self.lobes().map_or(Vec3::ONE, Lobes::albedo)
    }

    /// Adjoint of [`Layer::albedo`], by input.
    pub fn d_albedo(&self, d_albedo: Vec3) -> [Vec3; MAX_INPUTS] {
        self.lobes().map_or([Vec3::ZERO; MAX_INPUTS], |lobes| lobes.d_albedo(d_albedo))
    }
}

impl Lit for Layer {
    fn lobes(&self) -> Option<&Lobes> {
        with_lit!(self, lit => lit.lobes())
    }

    fn lobes_mut(&mut self) -> Option<&mut Lobes> {
        with_lit!(self, lit => lit.lobes_mut())
    }

    fn eval(&self, angles: &Angles) -> Vec3 {
        with_lit!(self, lit => lit.eval(angles))
    }

    fn eval_and_pdf(&self, angles: &Angles) -> (Vec3, f32) {
        with_lit!(self, lit => Lit::eval_and_pdf(lit, angles))
    }

    fn eval_chosen(&self, chosen: Chosen, angles: &Angles) -> Vec3 {
        with_lit!(self, lit => lit.eval_chosen(chosen, angles))
    }

    fn d_eval_chosen(&self, chosen: Chosen, n: Vec3, wi: Vec3, wo: Vec3, d_f: Vec3, half_fixed: bool) -> BsdfAdjoint {
        with_lit!(self, lit => lit.d_eval_chosen(chosen, n, wi, wo, d_f, half_fixed))
    }

    fn sample_facet(&self, wi: Vec3, square: [f32; 2], u: f32) -> Option<Vec3> {
        with_lit!(self, lit => Lit::sample_facet(lit, wi, square, u))
    }

    fn pdf(&self, angles: &Angles) -> f32 {
        with_lit!(self, lit => lit.pdf(angles))
    }

    fn alpha(&self) -> f32 {
        with_lit!(self, lit => Lit::alpha(lit))
    }

    fn lobe_albedos(&self, ci: f32) -> [f32; 2] {
        with_lit!(self, lit => lit.lobe_albedos(ci))
    }
}
