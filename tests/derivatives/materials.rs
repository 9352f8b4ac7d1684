//! Materials with lobes: derivatives against differences over all roughnesses, also of a part that reflects nothing.

use crate::common::*;
use dscene::grad::render;
use dscene::render::texture::{Filter, Texture, Wrap};
use dscene::render::*;
use glam::{Vec3, vec3};

/// Inputs of a narrow material: colours of both lobes.
struct Lobes {
    first: Vec3,
    second: Vec3,
}

type Make = fn(&mut Builder, &Lobes) -> MaterialKind;

/// Diffuse and specular colour.
const PHONG: Make = |b, lobes| MaterialKind::Phong {
    diffuse: b.constant(lobes.first),
    specular: b.constant(lobes.second),
    roughness: b.scalar(0.02),
};

/// Base colour, of which a tenth is metal.
const PRINCIPLED: Make = |b, lobes| MaterialKind::Principled {
    base_color: b.constant(lobes.first),
    metallic: b.scalar(0.1),
    roughness: b.scalar(0.3),
    specular: b.scalar(0.5),
};

/// A floor of such a material under a lamp, with a grey box on it.
fn floor_of(make: Make, black: [f32; 2], f: impl Fn(f32, &mut Lobes)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut lobes = Lobes { first: vec3(0.6, 0.4, 0.5) * black[0], second: vec3(0.5, 0.4, 0.3) * black[1] };
        f(t, &mut lobes);
        let mut b = Builder::default();
        let kind = make(&mut b, &lobes);
        b.add(floor(Vec3::ZERO, 1.5), Material::from(kind));
        let grey = b.diffuse(Vec3::splat(0.6));
        b.add(cuboid(vec3(0.2, 0.4, 0.3), Vec3::splat(0.3), 0.4), grey);
        b.lamp(ceiling(vec3(0.3, 1.5, 0.5), 0.5), Vec3::splat(4.0));
        (b.description, look_at(vec3(0.0, 1.2, -2.5), vec3(0.0, 0.2, 0.0), 40.0, 12))
    }
}

/// Paths that follow one part of a narrow material choose the other one too, though it is black.
#[test]
fn a_part_that_is_black_has_a_derivative() {
    let plan = Plan { h: 0.1, spp: 64, fd_spp: 1024, max_bounces: 2, ..Plan::default() };
    let first: fn(f32, &mut Lobes) = |t, l| l.first += t;
    let second: fn(f32, &mut Lobes) = |t, l| l.second += t;
    agree("phong, black cosine lobe", &floor_of(PHONG, [0.0, 1.0], first), &plan);
    agree("phong, black highlight", &floor_of(PHONG, [1.0, 0.0], second), &plan);
    agree("principled, black base", &floor_of(PRINCIPLED, [0.0, 1.0], first), &plan);
    agree(
        "principled, black base, 3 bounces",
        &floor_of(PRINCIPLED, [0.0, 1.0], first),
        &Plan { max_bounces: 3, ..plan },
    );
}

/// What lights a plate.
#[derive(Clone, Copy, Debug)]
enum Light {
    /// Four by two texels, without a sun.
    Sky,
    /// A square where the lobe looks.
    Lamp,
}

/// What moves.
#[derive(Clone, Copy, Debug)]
enum Moves {
    Tilt,
    Roughness,
    Colour,
    /// That of refraction.
    Index,
    /// The share that a coat covers.
    Coat,
    /// The colour of a sheen.
    Sheen,
    /// The share of the second material of a blend.
    Weight,
}

/// Between the roughnesses of the tables that `plastic`, `principled` and coats have of what they reflect, and `cloth` and sheens have.
const CELL: f32 = 0.05;

#[derive(Clone, Copy, Debug)]
struct Row {
    material: &'static str,
    roughness: f32,
    light: Light,
    /// Between the line of sight and the plate's normal.
    angle: f32,
    moves: Moves,
}

impl Row {
    /// A large plate of the material in the middle of a narrow view; its edges are out of sight.
    fn build(&self, t: f32) -> (SceneDescription, Camera) {
        let shift = |moves: bool| if moves { t } else { 0.0 };
        let mut b = Builder::default();
        let colour = vec3(0.7, 0.5, 0.6) + shift(matches!(self.moves, Moves::Colour));
        let roughness = b.scalar(self.roughness() + shift(matches!(self.moves, Moves::Roughness)));
        let colour = b.constant(colour);
        let kind = match self.material {
            "conductor" => MaterialKind::Conductor { reflectance: colour, roughness },
            "conductor by its index" => {
                let k = b.constant(vec3(3.6, 2.6, 2.3));
                MaterialKind::ConductorIor { eta: colour, k, roughness }
            }
            "phong" => MaterialKind::Phong { diffuse: b.constant(Vec3::splat(0.2)), specular: colour, roughness },
            "plastic" => {
                let ior = b.scalar(1.5 + shift(matches!(self.moves, Moves::Index)));
                MaterialKind::Plastic { diffuse: colour, ior, roughness }
            }
            "cloth" => MaterialKind::Cloth { diffuse: b.constant(vec3(0.6, 0.3, 0.4)), sheen: colour, roughness },
            "principled" => MaterialKind::Principled {
                base_color: colour,
                metallic: b.scalar(0.5),
                roughness,
                specular: b.scalar(0.6),
            },
            // The roughness is the coat's.
            "lacquer" => MaterialKind::Principled {
                base_color: colour,
                metallic: b.scalar(0.7),
                roughness: b.scalar(0.42),
                specular: b.scalar(0.5),
            },
            "coated paint" => MaterialKind::Diffuse { reflectance: colour },
            "coated metal" => MaterialKind::Conductor { reflectance: colour, roughness: b.scalar(0.12) },
            // The roughness is the sheen's.
            "dusty paint" => MaterialKind::Diffuse { reflectance: colour },
            "dusty metal" => MaterialKind::Conductor { reflectance: colour, roughness: b.scalar(0.12) },
            "dusty lacquer" => MaterialKind::Principled {
                base_color: colour,
                metallic: b.scalar(0.3),
                roughness: b.scalar(0.52),
                specular: b.scalar(0.5),
            },
            "worn metal" => MaterialKind::Conductor { reflectance: colour, roughness },
            "rusty lacquer" => MaterialKind::Principled {
                base_color: b.constant(vec3(0.2, 0.5, 0.3)),
                metallic: b.scalar(0.4),
                roughness: b.scalar(0.42),
                specular: b.scalar(0.5),
            },
            other => panic!("{other}"),
        };
        let under = match self.material {
            "worn metal" => Some(MaterialKind::Diffuse { reflectance: b.constant(vec3(0.3, 0.2, 0.1)) }),
            // A lobe narrower than that of what it is blended with.
            "rusty lacquer" => Some(MaterialKind::Conductor { reflectance: colour, roughness: b.scalar(0.25) }),
            _ => None,
        };
        let share = 0.4 + shift(matches!(self.moves, Moves::Weight));
        let blend = under.map(|kind| Blend { kind, grain: None, sheen: None, coat: None, weight: b.scalar(share) });
        let weight = 0.6 + shift(matches!(self.moves, Moves::Coat));
        let of_coat = |b: &mut Builder| if self.is_sheened() { b.scalar(0.27) } else { roughness };
        let coat = self.is_coated().then(|| ClearCoat { weight: b.scalar(weight), roughness: of_coat(&mut b) });
        let sheen = self.sheen(&mut b, roughness, t);
        let turn = glam::Quat::from_rotation_x(shift(matches!(self.moves, Moves::Tilt)));
        let mut plate = floor(Vec3::ZERO, 3.0);
        plate.vertices.iter_mut().for_each(|v| *v = turn * *v);
        b.add(plate, Material { sheen, coat, blend, ..Material::from(kind) });
        let (sin, cos) = self.angle.to_radians().sin_cos();
        match self.light {
            Light::Sky => {
                // Bright above the plate as the lobe sees it: any texel differs from its neighbours.
                let texels = [0.3, 1.4, 0.5, 2.0, 0.7, 0.2, 1.6, 0.4];
                let data = texels.iter().flat_map(|x| [*x, 0.8 * x + 0.1, 1.2 - 0.4 * x]).collect();
                let (wrap, filter) = (Wrap::Repeat, Filter::Bilinear);
                b.description.textures.push(Texture {
                    width: 4,
                    height: 2,
                    channels: 3,
                    data,
                    packed: None,
                    wrap,
                    filter,
                });
                let radiance = b.description.textures.len() - 1;
                // Where the mirror direction is, colours change along the tilt.
                let rotation = glam::Mat3::from_rotation_z(0.6);
                b.description.environment = Some(SphericalMap { texels: radiance, rotation });
            }
            Light::Lamp => {
                let centre = vec3(0.0, cos, sin) * 3.0;
                let mut lamp = ceiling(Vec3::ZERO, 0.5);
                for v in &mut lamp.vertices {
                    *v = glam::Quat::from_rotation_x(self.angle.to_radians()) * *v + centre + vec3(0.1, 0.2, -0.1);
                }
                b.lamp(lamp, Vec3::splat(4.0));
            }
        }
        (b.description, look_at(vec3(0.01, cos, -sin) * 4.0, Vec3::ZERO, 12.0, 8))
    }

    /// The sheen over the plate, which has this roughness.
    fn sheen(&self, b: &mut Builder, roughness: Input, t: f32) -> Option<SheenLayer> {
        let shift = if matches!(self.moves, Moves::Sheen) { t } else { 0.0 };
        self.is_sheened().then(|| SheenLayer { color: b.constant(vec3(0.5, 0.8, 0.3) + shift), roughness })
    }

    fn is_coated(&self) -> bool {
        ["lacquer", "coated paint", "coated metal", "rusty lacquer", "dusty lacquer"].contains(&self.material)
    }

    fn is_sheened(&self) -> bool {
        ["dusty paint", "dusty metal", "dusty lacquer"].contains(&self.material)
    }

    /// Whether derivatives in the roughness jump where it is that of a row of a table.
    fn has_table(&self) -> bool {
        self.is_coated() || self.is_sheened() || ["plastic", "principled", "cloth"].contains(&self.material)
    }

    /// Where derivatives are taken: what is read from the coat's table is linear between rows, and has none at a row.
    fn roughness(&self) -> f32 {
        match self.moves {
            Moves::Roughness if self.has_table() => ((self.roughness / CELL).round() + 0.5) * CELL,
            _ => self.roughness,
        }
    }

    /// Σ |w·I|.
    fn brightness(&self) -> f64 {
        let (scene, camera) = self.build(0.0);
        let settings = Settings {
            output: Output::Radiance,
            spp: 64,
            max_bounces: 1,
            seed: 1,
            boundary: false,
            ..Settings::default()
        };
        let image = render(&Scene::new(scene).unwrap(), &camera, &settings).unwrap();
        image.data.iter().zip(&weights(&camera, 3).data).map(|(i, w)| f64::from((i * w).abs())).sum()
    }

    fn check(&self) {
        let spp = match (self.light, self.moves) {
            (Light::Lamp, Moves::Roughness) => 256,
            (Light::Lamp, _) => 64,
            (Light::Sky, _) => 16,
        };
        let h = match self.moves {
            // A lamp mirrored by a narrow lobe has outlines, which must not move as far as a pixel: weights are another in the next.
            Moves::Tilt if matches!(self.light, Light::Lamp) && self.roughness < 0.3 => 0.0025,
            Moves::Tilt => 0.01,
            Moves::Roughness if self.has_table() => 0.2 * CELL,
            // A half-rough metal beside a matte one under a lamp: the derivative bends.
            Moves::Roughness if self.material == "worn metal" => 0.08 * self.roughness,
            Moves::Roughness => 0.2 * self.roughness.min(0.5),
            Moves::Colour | Moves::Index | Moves::Coat | Moves::Sheen | Moves::Weight => 0.05,
        };
        // A lobe that only sees light of one brightness is as bright however wide, and nothing is what its derivative may well be. But it
        // is a mean of scores of samples, some 4 / roughness each, of which any that is wrong shows in an eighth. So it is with a plate that
        // looks much the same from everywhere, and is turned.
        let least = match self.moves {
            Moves::Roughness => 0.5 * self.brightness() / f64::from(self.roughness),
            _ => 0.25 * self.brightness(),
        };
        let plan = Plan { spp, fd_spp: 512, h, least, ..Plan::default() };
        agree(&format!("{self:?}"), &|t| self.build(t), &plan);
    }
}

/// The rows that went wrong when half vectors were told from cosines.
#[test]
fn narrow_lobes_have_their_derivatives() {
    let row = |material, roughness, light, angle, moves| Row { material, roughness, light, angle, moves };
    let sky = Light::Sky;
    for row in [
        row("conductor", 0.0, sky, 60.0, Moves::Tilt),
        row("conductor", 0.05, sky, 60.0, Moves::Tilt),
        row("conductor", 0.05, sky, 5.0, Moves::Roughness),
        row("conductor", 0.05, Light::Lamp, 5.0, Moves::Tilt),
    ] {
        row.check();
    }
}

/// Every material with a lobe, from a mirror to the roughest, head on and at grazing angles.
#[test]
fn lobes_of_all_roughnesses_have_their_derivatives() {
    let mut rows = Vec::new();
    for material in ["conductor", "conductor by its index", "phong", "principled"] {
        for roughness in [0.0, 0.02, 0.05, 0.1, 0.3, 1.0] {
            for light in [Light::Sky, Light::Lamp] {
                for angle in [5.0, 80.0] {
                    for moves in [Moves::Tilt, Moves::Roughness, Moves::Colour] {
                        // At both ends of the domain there is a derivative to one side only.
                        if !matches!(moves, Moves::Roughness) || (roughness > 0.0 && roughness < 1.0) {
                            rows.push(Row { material, roughness, light, angle, moves });
                        }
                    }
                }
            }
        }
    }
    for (light, angle) in [(Light::Sky, 5.0), (Light::Lamp, 5.0), (Light::Sky, 80.0), (Light::Lamp, 80.0)] {
        for (roughness, moves) in [
            (0.02, Moves::Tilt),
            (0.1, Moves::Roughness),
            (0.3, Moves::Roughness),
            (0.1, Moves::Index),
            (0.6, Moves::Index),
            (0.3, Moves::Colour),
        ] {
            rows.push(Row { material: "plastic", roughness, light, angle, moves });
        }
    }
    // The most precise of the long statistics look at all of them; otherwise a sample that meets every value (five and nineteen share no
    // factor with the lengths of the lists above).
    let every = percent().map_or(19, |percent| if percent > 1.0 { 5 } else { 1 });
    rows.iter().step_by(every).for_each(Row::check);
}

/// The sheen over its base: narrow at grazing angles, and all over.
#[test]
fn cloth_has_its_derivatives() {
    let mut rows = Vec::new();
    for roughness in [0.1, 0.35, 0.8] {
        for (light, angle) in [(Light::Sky, 5.0), (Light::Lamp, 5.0), (Light::Sky, 80.0), (Light::Lamp, 80.0)] {
            for moves in [Moves::Tilt, Moves::Roughness, Moves::Colour] {
                rows.push(Row { material: "cloth", roughness, light, angle, moves });
            }
        }
    }
    rows.iter().step_by(percent().map_or(5, |_| 1)).for_each(Row::check);
}

/// A sheen over a matte surface, over a narrow lobe, and over a wide one with a coat above both.
#[test]
fn sheens_have_their_derivatives() {
    let mut rows = Vec::new();
    for (material, roughness) in [("dusty paint", 0.35), ("dusty metal", 0.1), ("dusty lacquer", 0.8)] {
        for (light, angle) in [(Light::Sky, 5.0), (Light::Lamp, 5.0), (Light::Sky, 75.0), (Light::Lamp, 75.0)] {
            for moves in [Moves::Tilt, Moves::Roughness, Moves::Colour, Moves::Sheen] {
                rows.push(Row { material, roughness, light, angle, moves });
            }
        }
    }
    rows.iter().step_by(percent().map_or(5, |_| 1)).for_each(Row::check);
}

/// A coat over lobes that are wider and narrower than its own, and over none.
#[test]
fn coats_have_their_derivatives() {
    let mut rows = Vec::new();
    for (material, roughness) in [("lacquer", 0.05), ("coated paint", 0.3), ("coated metal", 0.6)] {
        for (light, angle) in [(Light::Sky, 5.0), (Light::Lamp, 5.0), (Light::Sky, 75.0), (Light::Lamp, 75.0)] {
            for moves in [Moves::Tilt, Moves::Roughness, Moves::Colour, Moves::Coat] {
                rows.push(Row { material, roughness, light, angle, moves });
            }
        }
    }
    rows.iter().step_by(percent().map_or(5, |_| 1)).for_each(Row::check);
}

/// A narrow lobe beside a matte surface, and a coated material beside a lobe that is narrower than its own.
#[test]
fn blends_have_their_derivatives() {
    let mut rows = Vec::new();
    for (material, roughness) in [("worn metal", 0.1), ("worn metal", 0.5), ("rusty lacquer", 0.6)] {
        for (light, angle) in [(Light::Sky, 5.0), (Light::Lamp, 5.0), (Light::Sky, 75.0), (Light::Lamp, 75.0)] {
            for moves in [Moves::Tilt, Moves::Roughness, Moves::Colour, Moves::Weight] {
                rows.push(Row { material, roughness, light, angle, moves });
            }
        }
    }
    rows.iter().step_by(percent().map_or(5, |_| 1)).for_each(Row::check);
}
