//! Materials: the scattering models with their inputs, declared once for the language and the renderer.

use std::convert::Infallible;

/// Index into a scene's textures.
pub type TextureId = usize;

/// The most inputs a scattering model has.
pub const MODEL_INPUTS: usize = 4;
/// The places that a model and what lies over it have among derivatives: one for each input of the model, then one for the numbers of its
/// covers ([`COVERS`]), one for the grain and one for the colour of the sheen.
pub const LAYER_INPUTS: usize = MODEL_INPUTS + 3;
/// The place of the numbers of what covers a model, among those of its layer: the weight of the coat is in the first channel, its roughness in the
/// second and the roughness of the sheen in the third.
pub const COVERS: usize = MODEL_INPUTS;
/// The place of the grain among those of its layer: its anisotropy is in the first channel, its turn in the second.
pub const GRAIN: usize = MODEL_INPUTS + 1;
/// The place of the colour of the sheen among those of its layer.
pub const SHEEN_COLOR: usize = MODEL_INPUTS + 2;
/// The places of all inputs that say how a surface scatters light: those of its layer, of the one that it is blended with, and of the weight
/// of that.
pub const MAX_INPUTS: usize = 2 * LAYER_INPUTS + 1;
/// The place of the weight of a blend.
pub const BLEND_WEIGHT: usize = 2 * LAYER_INPUTS;

/// Where a material reads one of its inputs from. Constants are 1×1 textures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// A texture, at the texture coordinates of the hit.
    Texture(TextureId),
    /// The mesh's interpolated vertex colours.
    VertexColor,
    /// A texture multiplied by the vertex colours.
    Tinted(TextureId),
}

impl Input {
    /// The texture it reads.
    pub fn texture(self) -> Option<TextureId> {
        match self {
            Input::Texture(t) | Input::Tinted(t) => Some(t),
            Input::VertexColor => None,
        }
    }

    /// Whether it reads the vertex colours.
    pub fn reads_colors(self) -> bool {
        matches!(self, Input::VertexColor | Input::Tinted(_))
    }
}

/// What the language calls an input of a material, and what numbers it takes there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InputField {
    /// The argument of the constructor, and the field of the material.
    pub name: &'static str,
    /// What its numbers mean.
    pub quantity: Quantity,
}

/// What the numbers of an input mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// RGB, each of at least 0.
    Color,
    /// From 0 to 1, in the first channel.
    Fraction,
    /// At least 0, in the first channel.
    Number,
    /// A refractive index relative to the air around, at least 1, in the first channel.
    Index,
    /// In radians, in the first channel.
    Angle,
}

/// A surface material: the closed set of scattering models with their inputs. An input is what the stage of the program makes of it:
/// nothing yet, a value of the language, where the renderer reads it from, or the number that was read.
#[derive(Clone, Debug, PartialEq)]
pub enum MaterialKind<I = Input> {
    /// Absorbs everything (a light without a material).
    Black,
    /// Lambertian reflection.
    Diffuse {
        /// The share of the light that is reflected, RGB in [0, 1].
        reflectance: I,
    },
    /// GGX microfacets, Schlick's Fresnel with normal-incidence `reflectance`; α = roughness².
    Conductor {
        /// The share of perpendicular light that is reflected (F0), RGB in [0, 1].
        reflectance: I,
        /// From 0, polished, to 1.
        roughness: I,
    },
    /// GGX microfacets, exact conductor Fresnel with per-channel complex index `eta + i k`; α = roughness².
    ConductorIor {
        /// The refractive index's real part, RGB.
        eta: I,
        /// Its imaginary part, which says how strongly the metal absorbs, RGB.
        k: I,
        /// From 0, polished, to 1.
        roughness: I,
    },
    /// Li et al. 2018: Lambert plus normalised Blinn-Phong microfacets, D = (e+2)/2π cosᵉ, e = 2/r − 2,
    /// Smith G by Walter's rational fit with α = √r, Schlick F.
    Phong {
        /// The reflectance of the Lambertian part, RGB in [0, 1].
        diffuse: I,
        /// The normal-incidence reflectance (F0) of the microfacets, RGB in [0, 1].
        specular: I,
        /// r above; the smaller, the sharper the highlight.
        roughness: I,
    },
    /// A Lambertian base under a clear coat: GGX with Schlick's Fresnel term of the index, and the light that the coat reflects back to the
    /// base (Saunderson 1942).
    Plastic {
        /// The reflectance of the base without the coat, RGB in [0, 1].
        diffuse: I,
        /// The coat's refractive index, from 1 to 10: 1.5 for most plastics and varnishes.
        ior: I,
        /// Of the coat, from 0, polished, to 1; α = roughness².
        roughness: I,
    },
    /// A Lambertian base under the sheen of upright fibres (Estevez & Kulla 2017), α = 0.07 + 0.93 roughness².
    Cloth {
        /// The reflectance of the base without the sheen, RGB in [0, 1].
        diffuse: I,
        /// The colour of the sheen, RGB in [0, 1].
        sheen: I,
        /// From 0, a sheen at grazing angles only, to 1, at all.
        roughness: I,
    },
    /// Perfect specular reflection.
    Mirror {
        /// The share of the light that is reflected, the same at all angles, RGB in [0, 1].
        reflectance: I,
    },
    /// The interface of glass, water or another clear body: reflects and refracts by the exact Fresnel equations. Its meshes are closed, or
    /// reach beyond everything else; normals by the right-hand rule point out of the body.
    Dielectric {
        /// The refractive index of the inside relative to the outside, from 1 to 10: 1.5 for glass, 1.33 for water.
        ior: I,
        /// Of ground glass, from 0, polished, to 1; α = roughness². `None` for a smooth interface, which has single directions instead of lobes.
        roughness: Option<I>,
        /// The absorption of the inside per unit length, RGB of at least 0, the same everywhere; `None` for a body that absorbs nothing.
        absorption: Option<I>,
    },
    /// A pane: a clear plate so thin that it shifts nothing. It reflects what its two faces do together, and lets the rest pass straight on;
    /// with rough faces both into lobes of GGX microfacets, the same on either side.
    ThinDielectric {
        /// The refractive index, from 1 to 10: 1.5 for glass.
        ior: I,
        /// The share of the light that passes, of what is not reflected, RGB in [0, 1].
        tint: I,
        /// Of a frosted pane, from 0, polished, to 1; α = roughness². `None` for smooth faces, which have single directions instead of lobes.
        roughness: Option<I>,
    },
    /// Metallic-roughness: (1−metallic)·base/π diffuse plus GGX with F0 = mix(0.08·specular, base, metallic).
    Principled {
        /// Reflectance of what is not metal, and F0 of what is, RGB in [0, 1].
        base_color: I,
        /// From 0, a dielectric (plastic, wood, stone), to 1, a metal.
        metallic: I,
        /// From 0, polished, to 1; α = roughness².
        roughness: I,
        /// In [0, 1]: F0 of what is not metal is 0.08 times this, so 0.5 is the usual 4 %.
        specular: I,
    },
}

impl<I> MaterialKind<I> {
    /// Whether it has a GGX lobe that reflects, which can have a grain.
    pub fn takes_grain(&self) -> bool {
        use MaterialKind::{Conductor, ConductorIor, Plastic, Principled};
        matches!(self, Conductor { .. } | ConductorIor { .. } | Plastic { .. } | Principled { .. })
    }

    /// What the language calls the constructor; of what reflects nothing there is none.
    pub fn name(&self) -> &'static str {
        match self {
            MaterialKind::Black => "black",
            MaterialKind::Diffuse { .. } => "diffuse",
            MaterialKind::Conductor { .. } | MaterialKind::ConductorIor { .. } => "conductor",
            MaterialKind::Phong { .. } => "phong",
            MaterialKind::Plastic { .. } => "plastic",
            MaterialKind::Cloth { .. } => "cloth",
            MaterialKind::Mirror { .. } => "mirror",
            MaterialKind::Dielectric { .. } => "dielectric",
            MaterialKind::ThinDielectric { .. } => "thin_dielectric",
            MaterialKind::Principled { .. } => "principled",
        }
    }

    /// The same model with something made of every input, one after the other. This is the only place that names them and says in which
    /// order they stand.
    #[inline]
    pub fn try_map<'a, J, E>(
        &'a self,
        mut make: impl FnMut(InputField, &'a I) -> Result<J, E>,
    ) -> Result<MaterialKind<J>, E> {
        use Quantity::{Color, Fraction, Index, Number};
        let mut make = |name, quantity, input| make(InputField { name, quantity }, input);
        Ok(match self {
            MaterialKind::Black => MaterialKind::Black,
            MaterialKind::Diffuse { reflectance } => {
                MaterialKind::Diffuse { reflectance: make("reflectance", Color, reflectance)? }
            }
            MaterialKind::Conductor { reflectance, roughness } => MaterialKind::Conductor {
                reflectance: make("reflectance", Color, reflectance)?,
                roughness: make("roughness", Fraction, roughness)?,
            },
            MaterialKind::ConductorIor { eta, k, roughness } => MaterialKind::ConductorIor {
                eta: make("eta", Color, eta)?,
                k: make("k", Color, k)?,
                roughness: make("roughness", Fraction, roughness)?,
            },
            MaterialKind::Phong { diffuse, specular, roughness } => MaterialKind::Phong {
                diffuse: make("diffuse", Color, diffuse)?,
                specular: make("specular", Color, specular)?,
                roughness: make("roughness", Fraction, roughness)?,
            },
            MaterialKind::Plastic { diffuse, ior, roughness } => MaterialKind::Plastic {
                diffuse: make("diffuse", Color, diffuse)?,
                ior: make("ior", Index, ior)?,
                roughness: make("roughness", Fraction, roughness)?,
            },
            MaterialKind::Cloth { diffuse, sheen, roughness } => MaterialKind::Cloth {
                diffuse: make("diffuse", Color, diffuse)?,
                sheen: make("sheen", Color, sheen)?,
                roughness: make("roughness", Fraction, roughness)?,
            },
            MaterialKind::Mirror { reflectance } => {
                MaterialKind::Mirror { reflectance: make("reflectance", Color, reflectance)? }
            }
            MaterialKind::Dielectric { ior, roughness, absorption } => MaterialKind::Dielectric {
                ior: make("ior", Index, ior)?,
                roughness: roughness.as_ref().map(|roughness| make("roughness", Fraction, roughness)).transpose()?,
                absorption: absorption.as_ref().map(|absorption| make("absorption", Color, absorption)).transpose()?,
            },
            MaterialKind::ThinDielectric { ior, tint, roughness } => MaterialKind::ThinDielectric {
                ior: make("ior", Index, ior)?,
                tint: make("tint", Color, tint)?,
                roughness: roughness.as_ref().map(|roughness| make("roughness", Fraction, roughness)).transpose()?,
            },
            MaterialKind::Principled { base_color, metallic, roughness, specular } => MaterialKind::Principled {
                base_color: make("base_color", Color, base_color)?,
                metallic: make("metallic", Fraction, metallic)?,
                roughness: make("roughness", Fraction, roughness)?,
                specular: make("specular", Number, specular)?,
            },
        })
    }

    /// As [`MaterialKind::try_map`], of what cannot fail.
    #[inline]
    pub fn map<'a, J>(&'a self, mut make: impl FnMut(InputField, &'a I) -> J) -> MaterialKind<J> {
        let Ok(kind) = self.try_map(|field, input| Ok::<J, Infallible>(make(field, input)));
        kind
    }

    /// The inputs in the order of their declaration.
    #[inline]
    pub fn inputs(&self) -> impl Iterator<Item = (InputField, &I)> {
        let (mut inputs, mut count) = ([None; MODEL_INPUTS], 0);
        self.map(|field, input| {
            inputs[count] = Some((field, input));
            count += 1;
        });
        inputs.into_iter().flatten()
    }
}

/// The sheen of upright fibres over whatever else a surface is made of: dust, fuzz, the velvety side of leather. The lobe is that of `cloth`
/// (Estevez & Kulla 2017).
#[derive(Clone, Debug, PartialEq)]
pub struct SheenLayer<I = Input> {
    /// The colour of the fibres, RGB in [0, 1]; black for none.
    pub color: I,
    /// From 0, a sheen at grazing angles only, to 1, at all.
    pub roughness: I,
}

/// The colour of a sheen over another material.
pub const SHEEN: InputField = InputField { name: "sheen", quantity: Quantity::Color };
/// The roughness of the sheen.
pub const SHEEN_ROUGHNESS: InputField = InputField { name: "sheen_roughness", quantity: Quantity::Fraction };

impl<I> SheenLayer<I> {
    /// The same sheen with something made of both inputs, one after the other.
    pub fn try_map<'a, J, E>(
        &'a self,
        mut make: impl FnMut(InputField, &'a I) -> Result<J, E>,
    ) -> Result<SheenLayer<J>, E> {
        Ok(SheenLayer { color: make(SHEEN, &self.color)?, roughness: make(SHEEN_ROUGHNESS, &self.roughness)? })
    }
}

/// The inputs of a sheen, if there is one.
fn of_sheen<I>(sheen: &Option<SheenLayer<I>>) -> impl Iterator<Item = (InputField, &I)> {
    sheen.iter().flat_map(|sheen| [(SHEEN, &sheen.color), (SHEEN_ROUGHNESS, &sheen.roughness)])
}

/// A clear coat over whatever else a surface is made of: varnish over wood, lacquer over metallic paint. GGX of a refractive index of 1.5.
#[derive(Clone, Debug, PartialEq)]
pub struct ClearCoat<I = Input> {
    /// How much of the surface it covers, from 0, none, to 1, all.
    pub weight: I,
    /// From 0, polished, to 1; α = roughness².
    pub roughness: I,
}

/// How much of a surface its coat covers.
pub const COAT: InputField = InputField { name: "coat", quantity: Quantity::Fraction };
/// The roughness of the coat.
pub const COAT_ROUGHNESS: InputField = InputField { name: "coat_roughness", quantity: Quantity::Fraction };

impl<I> ClearCoat<I> {
    /// The same coat with something made of both inputs, one after the other.
    pub fn try_map<'a, J, E>(
        &'a self,
        mut make: impl FnMut(InputField, &'a I) -> Result<J, E>,
    ) -> Result<ClearCoat<J>, E> {
        Ok(ClearCoat { weight: make(COAT, &self.weight)?, roughness: make(COAT_ROUGHNESS, &self.roughness)? })
    }

    /// As [`ClearCoat::try_map`], of what cannot fail.
    pub fn map<'a, J>(&'a self, mut make: impl FnMut(InputField, &'a I) -> J) -> ClearCoat<J> {
        let Ok(coat) = self.try_map(|field, input| Ok::<J, Infallible>(make(field, input)));
        coat
    }
}

/// The inputs of a coat, if there is one.
fn of_coat<I>(coat: &Option<ClearCoat<I>>) -> impl Iterator<Item = (InputField, &I)> {
    coat.iter().flat_map(|coat| [(COAT, &coat.weight), (COAT_ROUGHNESS, &coat.roughness)])
}

/// A grain: the microfacets of a GGX lobe are rougher along one direction of the surface than across it, as those of brushed metal are.
#[derive(Clone, Debug, PartialEq)]
pub struct Grain<I = Input> {
    /// From 0, as rough along it as across, to 1: α along it is α + (1 − α) anisotropy².
    pub anisotropy: I,
    /// Of the direction, counterclockwise from the tangent, along which the texture coordinate u grows, in radians.
    pub turn: I,
}

/// How much rougher a surface is along its grain.
pub const ANISOTROPY: InputField = InputField { name: "anisotropy", quantity: Quantity::Fraction };
/// Which way the grain lies.
pub const TURN: InputField = InputField { name: "turn", quantity: Quantity::Angle };

impl<I> Grain<I> {
    /// The same grain with something made of both inputs, one after the other.
    pub fn try_map<'a, J, E>(&'a self, mut make: impl FnMut(InputField, &'a I) -> Result<J, E>) -> Result<Grain<J>, E> {
        Ok(Grain { anisotropy: make(ANISOTROPY, &self.anisotropy)?, turn: make(TURN, &self.turn)? })
    }
}

/// The inputs of a grain, if there is one.
fn of_grain<I>(grain: &Option<Grain<I>>) -> impl Iterator<Item = (InputField, &I)> {
    grain.iter().flat_map(|grain| [(ANISOTROPY, &grain.anisotropy), (TURN, &grain.turn)])
}

/// The inputs of a model, of its grain, and of the sheen and the coat over it.
fn of_layer<'a, I>(
    kind: &'a MaterialKind<I>,
    grain: &'a Option<Grain<I>>,
    sheen: &'a Option<SheenLayer<I>>,
    coat: &'a Option<ClearCoat<I>>,
) -> impl Iterator<Item = (InputField, &'a I)> {
    kind.inputs().chain(of_grain(grain)).chain(of_sheen(sheen)).chain(of_coat(coat))
}

/// What a surface is made of beside its own model: rust in paint, moss on stone, the dirt of a street. Both reflect light in proportion to
/// their shares, as if they lay side by side in spots too small to be seen.
#[derive(Clone, Debug, PartialEq)]
pub struct Blend<I = Input> {
    /// The other model, whose lobes have a width as those of the surface's own.
    pub kind: MaterialKind<I>,
    /// The grain of the other model.
    pub grain: Option<Grain<I>>,
    /// The sheen over the other model.
    pub sheen: Option<SheenLayer<I>>,
    /// The coat over the other model.
    pub coat: Option<ClearCoat<I>>,
    /// The share of the other model, from 0, none of it, to 1, nothing else.
    pub weight: I,
}

/// The share of the second material of a blend.
pub const WEIGHT: InputField = InputField { name: "weight", quantity: Quantity::Fraction };

impl<I> Blend<I> {
    /// The same blend with something made of every input, one after the other.
    pub fn try_map<'a, J, E>(&'a self, mut make: impl FnMut(InputField, &'a I) -> Result<J, E>) -> Result<Blend<J>, E> {
        let kind = self.kind.try_map(&mut make)?;
        let grain = self.grain.as_ref().map(|grain| grain.try_map(&mut make)).transpose()?;
        let sheen = self.sheen.as_ref().map(|sheen| sheen.try_map(&mut make)).transpose()?;
        let coat = self.coat.as_ref().map(|coat| coat.try_map(&mut make)).transpose()?;
        Ok(Blend { kind, grain, sheen, coat, weight: make(WEIGHT, &self.weight)? })
    }
}

/// How a surface scatters light, on which sides, and where it has holes.
#[derive(Clone, Debug, PartialEq)]
pub struct Material<I = Input> {
    /// The scattering model and its inputs.
    pub kind: MaterialKind<I>,
    /// The grain of its GGX lobe, of models that have one.
    pub grain: Option<Grain<I>>,
    /// The sheen over it, of models whose lobes have a width.
    pub sheen: Option<SheenLayer<I>>,
    /// The coat over it and its sheen, of models whose lobes have a width.
    pub coat: Option<ClearCoat<I>>,
    /// What it is blended with, of models whose lobes have a width.
    pub blend: Option<Blend<I>>,
    /// Reflects (and is seen) only on the side of the right-hand-rule normal; the back is black.
    pub one_sided: bool,
    /// In [0, 1], the first channel: how much of the surface there is, the rest is a hole. `None` is opaque.
    pub opacity: Option<I>,
    /// A normal map: the shading normal (x, y, z) as (½ + x/2, ½ + y/2, ½ + z/2), RGB in [0, 1], in the frame of the texture coordinates.
    pub normals: Option<I>,
}

/// The opacity, which all materials may have.
pub const OPACITY: InputField = InputField { name: "opacity", quantity: Quantity::Fraction };
/// The normal map, which all materials may have whose lobes have a width.
pub const NORMALS: InputField = InputField { name: "normals", quantity: Quantity::Color };

impl<I> Material<I> {
    /// The same material with something made of every input, one after the other.
    pub fn try_map<'a, J, E>(
        &'a self,
        mut make: impl FnMut(InputField, &'a I) -> Result<J, E>,
    ) -> Result<Material<J>, E> {
        let kind = self.kind.try_map(&mut make)?;
        let grain = self.grain.as_ref().map(|grain| grain.try_map(&mut make)).transpose()?;
        let sheen = self.sheen.as_ref().map(|sheen| sheen.try_map(&mut make)).transpose()?;
        let coat = self.coat.as_ref().map(|coat| coat.try_map(&mut make)).transpose()?;
        let blend = self.blend.as_ref().map(|blend| blend.try_map(&mut make)).transpose()?;
        let opacity = self.opacity.as_ref().map(|opacity| make(OPACITY, opacity)).transpose()?;
        let normals = self.normals.as_ref().map(|normals| make(NORMALS, normals)).transpose()?;
        Ok(Material { kind, grain, sheen, coat, blend, one_sided: self.one_sided, opacity, normals })
    }

    /// As [`Material::try_map`], of what cannot fail.
    pub fn map<'a, J>(&'a self, mut make: impl FnMut(InputField, &'a I) -> J) -> Material<J> {
        let Ok(material) = self.try_map(|field, input| Ok::<J, Infallible>(make(field, input)));
        material
    }

    /// The inputs that say how the surface scatters light: those of the model, of its grain, of the sheen and of the coat, then those of what it
    /// is blended with.
    pub fn scattering_inputs(&self) -> impl Iterator<Item = (InputField, &I)> {
        let other = self.blend.iter().flat_map(|blend| {
            of_layer(&blend.kind, &blend.grain, &blend.sheen, &blend.coat).chain([(WEIGHT, &blend.weight)])
        });
        of_layer(&self.kind, &self.grain, &self.sheen, &self.coat).chain(other)
    }

    /// The grains of its layers.
    pub fn grains(&self) -> impl Iterator<Item = &Grain<I>> {
        self.grain.iter().chain(self.blend.iter().flat_map(|blend| &blend.grain))
    }

    /// Whether it reads the directions of the texture coordinates: its normal map or a grain.
    pub fn needs_tangents(&self) -> bool {
        self.normals.is_some() || self.grains().next().is_some()
    }

    /// [`Material::scattering_inputs`], then the opacity of a material with holes, then the normal map.
    pub fn inputs(&self) -> impl Iterator<Item = (InputField, &I)> {
        let opacity = self.opacity.as_ref().map(|opacity| (OPACITY, opacity));
        let normals = self.normals.as_ref().map(|normals| (NORMALS, normals));
        self.scattering_inputs().chain(opacity).chain(normals)
    }
}

impl<I: Clone> Material<I> {
    /// The two materials of a blend as they are by themselves: on the same sides, without its holes and its normal map.
    pub fn parts(&self) -> Option<[Material<I>; 2]> {
        let blend = self.blend.as_ref()?;
        let own = (&self.kind, &self.grain, &self.sheen, &self.coat);
        let other = (&blend.kind, &blend.grain, &blend.sheen, &blend.coat);
        Some([own, other].map(|(kind, grain, sheen, coat)| Material {
            grain: grain.clone(),
            sheen: sheen.clone(),
            coat: coat.clone(),
            one_sided: self.one_sided,
            ..kind.clone().into()
        }))
    }
}

impl<I> From<MaterialKind<I>> for Material<I> {
    /// Opaque, without a grain, a sheen, a coat or a normal map, not blended with another, and the same on both sides.
    fn from(kind: MaterialKind<I>) -> Material<I> {
        Material {
            kind,
            grain: None,
            sheen: None,
            coat: None,
            blend: None,
            one_sided: false,
            opacity: None,
            normals: None,
        }
    }
}
