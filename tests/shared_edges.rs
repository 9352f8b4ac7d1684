//! Edges that are more than the border of two faces of one mesh: derivatives against finite differences.

mod common;

use common::*;
use dscene::mesh::shapes;
use dscene::render::*;
use glam::{Mat3, Vec3, vec3};

/// A book above a floor with three leaves open, which meet in the spine: no leaf is seen edge-on or ends where another one seems to. `f` moves the spine's ends and the leaves' corners.
fn book(f: impl Fn(f32, &mut [Vec3; 8])) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let (foot, top) = (vec3(0.1, 0.3, 0.0), vec3(0.0, 1.6, 0.1));
        let out = [vec3(-1.1, 0.0, -0.3), vec3(0.7, 0.1, -0.8), vec3(1.0, -0.1, 0.4)];
        let mut v = [foot, top, foot + out[0], top + out[0], foot + out[1], top + out[1], foot + out[2], top + out[2]];
        f(t, &mut v);
        let mut b = Builder::default();
        let (paper, grey) = (b.diffuse(vec3(0.8, 0.7, 0.5)), b.diffuse(Vec3::splat(0.5)));
        let leaf = |i: u32| [[0, 2 * i, 2 * i + 1], [0, 2 * i + 1, 1]];
        b.shape(mesh(v.to_vec(), [leaf(1), leaf(2), leaf(3)].concat()), paper);
        b.shape(floor(Vec3::ZERO, 3.0), grey);
        b.light(ceiling(vec3(-0.8, 4.0, -1.5), 0.4), Vec3::splat(30.0));
        (b.scene, look_at(vec3(1.2, 2.9, -4.0), vec3(0.0, 0.7, 0.0), 45.0, 32))
    }
}

#[test]
fn three_faces_at_an_edge() {
    let plan = Plan { h: 0.02, spp: 32, ..Plan::default() };
    agree("book, x", &book(|t, v| v.iter_mut().for_each(|v| v.x += t)), &plan);
    agree("spine leans", &book(|t, v| v[1] += vec3(t, 0.0, -t)), &plan);
    agree("a leaf's corner", &book(|t, v| v[5] += vec3(-t, t, 0.0)), &plan);
    let global = Plan { max_bounces: 3, ..plan };
    agree("spine leans, 3 bounces", &book(|t, v| v[1] += vec3(t, 0.0, -t)), &global);
    let normals = Plan { output: Output::Normal, ..plan };
    agree("spine leans, normals", &book(|t, v| v[1] += vec3(t, 0.0, -t)), &normals);
}

/// A ball, its faces dealt out to two meshes, neither of which is whole anywhere.
fn dealt(f: impl Fn(f32, &mut Vec3)) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let ball = shapes::icosphere(0.7, 2).unwrap();
        let mut b = Builder::default();
        let (red, grey) = (b.diffuse(vec3(0.7, 0.3, 0.2)), b.diffuse(Vec3::splat(0.5)));
        let place = |v: &Vec3| {
            let mut v = Mat3::from_rotation_x(0.4) * *v + vec3(0.1, 1.1, 0.2);
            f(t, &mut v);
            v
        };
        let vertices: Vec<Vec3> = ball.vertices.iter().map(place).collect();
        for half in 0..2 {
            let faces = ball.faces.iter().enumerate().filter(|(i, _)| i % 2 == half).map(|(_, f)| *f).collect();
            b.shape(mesh(vertices.clone(), faces), red.clone());
        }
        b.shape(floor(Vec3::ZERO, 3.0), grey);
        b.light(ceiling(vec3(1.0, 4.0, -1.0), 0.4), Vec3::splat(30.0));
        (b.scene, look_at(vec3(0.0, 2.2, -4.0), vec3(0.0, 0.8, 0.0), 40.0, 32))
    }
}

#[test]
fn edges_between_meshes() {
    let plan = Plan { h: 0.02, spp: 32, ..Plan::default() };
    agree("dealt ball, x", &dealt(|t, v| v.x += t), &plan);
    agree("dealt ball grows", &dealt(|t, v| *v += (*v - vec3(0.1, 1.1, 0.2)) * t), &plan);
    agree("dealt ball, y, 2 bounces", &dealt(|t, v| v.y += t), &Plan { max_bounces: 2, ..plan });
}

/// Two boxes on a floor, pushed together but not flush: parts of their edges are one, and a side is hidden behind a side.
fn pushed_together(f: impl Fn(f32, &mut [Vec3; 3])) -> impl Fn(f32) -> (SceneDescription, Camera) {
    move |t| {
        let mut s = [vec3(0.0, 0.0, 0.2), vec3(0.5, 2.8, -0.5), vec3(-0.43, 2.8, 1.9)];
        f(t, &mut s);
        let [slide, light, eye] = s;
        let mut b = Builder::default();
        let turn = Mat3::from_rotation_y(0.3);
        for (centre, albedo) in [(vec3(-0.25, 0.25, 0.0), 0.7), (vec3(0.25, 0.25, 0.0) + slide, 0.2)] {
            let mut block = cuboid(centre, Vec3::splat(0.25), 0.0);
            block.vertices.iter_mut().for_each(|v| *v = turn * *v);
            let material = b.diffuse(Vec3::splat(albedo));
            b.shape(block, material);
        }
        let grey = b.diffuse(Vec3::splat(0.3));
        b.shape(floor(Vec3::ZERO, 2.5), grey);
        b.scene.delta_lights.push(DeltaLight::Point { position: light, intensity: Vec3::splat(6.0) });
        (b.scene, look_at(eye, vec3(0.0, 0.3, 0.0), 35.0, 32))
    }
}

#[test]
fn boxes_pushed_together() {
    let plan = Plan { h: 0.01, spp: 16, fd_spp: 1024, ..Plan::default() };
    agree("pushed together, camera x", &pushed_together(|t, s| s[2].x += t), &plan);
    agree("pushed together, light x", &pushed_together(|t, s| s[1].x += t), &plan);
    agree("pushed together, slide", &pushed_together(|t, s| s[0].z += t), &plan);
    let global = Plan { max_bounces: 2, ..plan };
    agree("pushed together, camera x, 2 bounces", &pushed_together(|t, s| s[2].x += t), &global);
}
