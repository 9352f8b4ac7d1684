//! Surfaces with a grain: derivatives in its strength and its direction, and in what moves the surface, what it is made of and what is seen in it.

use crate::common::*;
use crate::normal_maps::pictured_floor;
use dscene::mesh::shapes;
use dscene::render::texture::{Filter, Texture, Wrap};
use dscene::render::*;
use glam::{Mat3, Quat, Vec2, Vec3, vec2, vec3};

/// What is brushed.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Metal,
    /// Under a coat.
    Lacquer,
    /// Beside a matte material.
    Worn,
    /// Under a normal map.
    Relief,
}

#[derive(Clone, Copy)]
struct Made {
    kind: Kind,
    roughness: f32,
    anisotropy: f32,
    turn: f32,
    /// Instead of the floor, a smooth ball.
    ball: bool,
    /// Height of the eye over the floor, in a distance of about 2.5.
    eye: f32,
    box_at: f32,
    /// Of the texture coordinates.
    picture: f32,
    /// Of the mesh, about an axis that leans.
    roll: f32,
    /// Of the mesh, along x.
    squeeze: f32,
}

impl Made {
    fn of(kind: Kind, roughness: f32) -> Made {
        let (anisotropy, turn, ball, eye, box_at) = (0.6, 0.5, false, 1.2, 0.2);
        Made { kind, roughness, anisotropy, turn, ball, eye, box_at, picture: 0.2, roll: 0.0, squeeze: 1.0 }
    }

    fn material(&self, b: &mut Builder) -> Material {
        let reflectance = b.constant(vec3(0.8, 0.6, 0.7));
        let roughness = b.scalar(self.roughness);
        let grain = Some(Grain { anisotropy: b.scalar(self.anisotropy), turn: b.scalar(self.turn) });
        let metal = MaterialKind::Conductor { reflectance, roughness };
        match self.kind {
            Kind::Metal => Material { grain, ..metal.into() },
            Kind::Lacquer => {
                let (metallic, specular) = (b.scalar(0.7), b.scalar(0.5));
                let kind = MaterialKind::Principled { base_color: reflectance, metallic, roughness, specular };
                let coat = Some(ClearCoat { weight: b.scalar(0.6), roughness: b.scalar(0.1) });
                Material { grain, coat, ..kind.into() }
            }
            Kind::Worn => {
                let matte = MaterialKind::Diffuse { reflectance: b.constant(vec3(0.3, 0.2, 0.1)) };
                let blend = Blend { kind: metal, grain, sheen: None, coat: None, weight: b.scalar(0.6) };
                Material { blend: Some(blend), ..matte.into() }
            }
            Kind::Relief => {
                let texel = |i: usize| {
                    let (x, y) = ((i % 6) as f32, (i / 6) as f32);
                    let tilt = vec2((1.9 * x + 0.7 * y).sin(), (0.8 * x - 2.3 * y).cos()) * 0.3;
                    ((tilt.extend(1.0).normalize() + 1.0) * 0.5).to_array()
                };
                let data = (0..36).flat_map(texel).collect();
                Material { grain, normals: Some(texture(b, [6, 6], data)), ..metal.into() }
            }
        }
    }

    fn build(&self) -> (SceneDescription, Camera) {
        let mut b = Builder::default();
        let brushed = self.material(&mut b);
        let mut mesh = if self.ball { shapes::sphere(0.9, 24).unwrap() } else { pictured_floor(1.5) };
        let picture = Vec2::from_angle(self.picture);
        mesh.uvs.iter_mut().flatten().for_each(|uv| *uv = picture.rotate(*uv));
        let (roll, squeeze) =
            (Quat::from_axis_angle(vec3(0.3, 0.9, 0.2).normalize(), self.roll), vec3(self.squeeze, 1.0, 1.0));
        mesh.vertices.iter_mut().for_each(|v| *v = roll * (*v * squeeze));
        mesh.normals.iter_mut().flatten().for_each(|n| *n = roll * (*n / squeeze).normalize());
        b.add(mesh, brushed);
        b.matte(cuboid(vec3(self.box_at, 0.4, 1.3), Vec3::splat(0.3), 0.4), 0.6);
        b.lamp(ceiling(vec3(0.3, 2.0, 0.5), 0.5), Vec3::splat(6.0));
        let texels = [0.3, 1.4, 0.5, 2.0, 0.7, 0.2, 1.6, 0.4];
        let sky = texels.iter().flat_map(|x| [*x, 0.8 * x + 0.1, 1.2 - 0.4 * x]).collect();
        if let Input::Texture(radiance) = texture(&mut b, [4, 2], sky) {
            b.description.environment = Some(SphericalMap { texels: radiance, rotation: Mat3::from_rotation_z(0.6) });
        }
        (b.description, look_at(vec3(0.0, self.eye, -2.5), vec3(0.0, 0.1, 0.0), 40.0, 12))
    }
}

fn texture(b: &mut Builder, [width, height]: [usize; 2], data: Vec<f32>) -> Input {
    let (wrap, filter) = (Wrap::Repeat, Filter::Bilinear);
    b.description.textures.push(Texture { width, height, channels: 3, data, packed: None, wrap, filter });
    Input::Texture(b.description.textures.len() - 1)
}

fn row(name: &str, made: Made, plan: &Plan, f: impl Fn(f32, &mut Made)) {
    row_by(agree, name, made, plan, f);
}

fn row_by(compare: Compare, name: &str, made: Made, plan: &Plan, f: impl Fn(f32, &mut Made)) {
    let build = move |t: f32| {
        let mut made = made;
        f(t, &mut made);
        made.build()
    };
    compare(&format!("brushed: {name}"), &build, plan);
}

const PLAN: fn() -> Plan = || Plan { h: 0.04, spp: 64, fd_spp: 1024, max_bounces: 2, least: 15.0, ..Plan::default() };

/// Lobes that are attached to the surface and lobes that are not, bare, under a coat, beside another material and under a normal map.
#[test]
fn grains_have_their_derivatives() {
    let turn: fn(f32, &mut Made) = |t, made| made.turn += t;
    let stronger: fn(f32, &mut Made) = |t, made| made.anisotropy += t;
    let rougher: fn(f32, &mut Made) = |t, made| made.roughness += t;
    for roughness in [0.15, 0.3, 0.6] {
        let metal = Made::of(Kind::Metal, roughness);
        let is_brief = roughness == 0.3;
        if is_brief || long() {
            row(&format!("turn on metal of {roughness}"), metal, &PLAN(), turn);
            row(&format!("anisotropy of metal of {roughness}"), metal, &PLAN(), stronger);
            let plan = Plan { h: 0.1 * roughness, ..PLAN() };
            row(&format!("roughness of metal of {roughness}"), metal, &plan, rougher);
        }
    }
    let grazing = Made { eye: 0.35, ..Made::of(Kind::Metal, 0.2) };
    row("turn at a grazing angle", grazing, &PLAN(), turn);
    row("turn on a relief", Made::of(Kind::Relief, 0.3), &PLAN(), turn);
    row("anisotropy of lacquer", Made::of(Kind::Lacquer, 0.3), &PLAN(), stronger);
    if long() {
        let ball = Made { ball: true, ..Made::of(Kind::Metal, 0.3) };
        row("turn on a ball", ball, &PLAN(), turn);
        row("turn on lacquer", Made::of(Kind::Lacquer, 0.3), &PLAN(), turn);
        row("turn on worn metal", Made::of(Kind::Worn, 0.3), &PLAN(), turn);
        row("anisotropy of worn metal", Made::of(Kind::Worn, 0.3), &PLAN(), stronger);
        row("anisotropy of a relief", Made::of(Kind::Relief, 0.3), &PLAN(), stronger);
    }
}

/// What moves the surface turns its grain, and what is seen in it moves along.
#[test]
fn what_moves_with_a_grain_has_its_derivatives() {
    let picture: fn(f32, &mut Made) = |t, made| made.picture += t;
    let roll: fn(f32, &mut Made) = |t, made| made.roll += t;
    let squeeze: fn(f32, &mut Made) = |t, made| made.squeeze += t;
    let box_at: fn(f32, &mut Made) = |t, made| made.box_at += t;
    let eye: fn(f32, &mut Made) = |t, made| made.eye += t;
    let near = Plan { h: 0.01, ..PLAN() };
    let metal = Made::of(Kind::Metal, 0.3);
    let ball = Made { ball: true, ..metal };
    row("picture turned on the floor", metal, &PLAN(), picture);
    row("relief squeezed", Made::of(Kind::Relief, 0.3), &near, squeeze);
    row("box in the floor", metal, &near, box_at);
    if long() {
        row("picture turned on a ball", ball, &PLAN(), picture);
        row_by(agree_in_finest, "ball rolled", ball, &near, roll);
        row_by(agree_in_finest, "ball squeezed", ball, &near, squeeze);
        row_by(agree_in_finest, "box in polished metal", Made::of(Kind::Metal, 0.08), &near, box_at);
        row("eye over the floor", metal, &near, eye);
    }
}
