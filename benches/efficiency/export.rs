//! Writes the scenes for other renderers: `NAME.json`, with its arrays in `NAME.bin` (little-endian 32-bit words).

use std::path::Path;

use dscene::mesh::Mesh;
use dscene::render::texture::{Filter, Wrap};
use dscene::render::{DeltaLight, Input, MaterialKind, SceneDescription, Slot};
use glam::Vec3;
use serde_json::{Value, json};

use crate::Args;
use crate::measure::{self, References, Row};
use crate::scenes::{Case, Ramp};

/// Arrays one after the other; each is named by `[start, length]` in words.
#[derive(Default)]
struct Words(Vec<u8>);

impl Words {
    fn put(&mut self, data: impl IntoIterator<Item = [u8; 4]>) -> Value {
        let start = self.0.len() / 4;
        self.0.extend(data.into_iter().flatten());
        json!([start, self.0.len() / 4 - start])
    }

    fn floats(&mut self, data: impl IntoIterator<Item = f32>) -> Value {
        self.put(data.into_iter().map(f32::to_le_bytes))
    }

    fn vectors(&mut self, data: &[Vec3]) -> Value {
        self.floats(data.iter().flat_map(|v| v.to_array()))
    }
}

pub fn export(cases: &[&Case], folder: &Path, references: &References) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    for (i, case) in cases.iter().enumerate() {
        let name = format!("{i:02}");
        // Two seeds: the loss is what other renderers are compared with before anything else.
        let row = measure::row(case, 2, &Args::default(), references);
        let mut words = Words::default();
        let object = describe(case, &row, &mut words);
        std::fs::write(folder.join(format!("{name}.json")), serde_json::to_string_pretty(&object)?)?;
        std::fs::write(folder.join(format!("{name}.bin")), words.0)?;
        println!("{name} {}", case.id());
    }
    Ok(())
}

fn describe(case: &Case, row: &Row, words: &mut Words) -> Value {
    let (scene, camera) = (case.build)(0.0);
    let velocities: Vec<Value> = measure::velocities(case)
        .into_iter()
        .map(|(slot, velocity)| json!({"slot": slot_name(slot), "data": words.floats(velocity)}))
        .collect();
    let output = format!("{:?}", case.output).to_lowercase();
    json!({
        "kind": row.kind, "scene": row.scene, "param": row.param, "output": output,
        "bounces": case.bounces, "spp": case.spp, "method": format!("{:?}", case.method).to_lowercase(), "ramp": if case.ramp == Ramp::X { "x" } else { "y" },
        "loss": row.loss, "loss_error": row.loss_error, "reference": row.reference,
        "camera": {
            "projection": format!("{:?}", camera.projection).to_lowercase(),
            "origin": camera.origin.to_array(), "frame": camera.frame.map(|row| row.to_array()), "scale": camera.scale,
            "width": camera.width, "height": camera.height, "filter": format!("{:?}", camera.filter).to_lowercase(),
        },
        "shapes": shapes(&scene, words),
        "textures": textures(&scene, words),
        "delta_lights": scene.delta_lights.iter().map(delta_light).collect::<Vec<Value>>(),
        "environment": scene.environment.as_ref().map(|e| json!({
            "texture": e.texels, "rotation": e.rotation.transpose().to_cols_array(),
        })),
        "velocities": velocities,
    })
}

fn slot_name(slot: Slot) -> Value {
    match slot {
        Slot::Vertices(i) => json!(["vertices", i]),
        Slot::Normals(i) => json!(["normals", i]),
        Slot::Uvs(i) => json!(["uvs", i]),
        Slot::Colors(i) => json!(["colors", i]),
        Slot::Texels(i) => json!(["texels", i]),
        Slot::LightPlacement(i) => json!(["light placement", i]),
        Slot::LightPower(i) => json!(["light power", i]),
        Slot::EnvironmentRotation => json!(["environment rotation", 0]),
        Slot::CameraOrigin | Slot::CameraFrame | Slot::CameraScale | Slot::CameraLens | Slot::CameraShutter => {
            json!(["camera", 0])
        }
        // None of these scenes moves while a shutter is open.
        slot => json!([format!("{slot:?}"), 0]),
    }
}

fn shapes(scene: &SceneDescription, words: &mut Words) -> Vec<Value> {
    let mut mesh = |mesh: &Mesh| {
        json!({
            "vertices": words.vectors(&mesh.vertices),
            "faces": words.put(mesh.faces.iter().flatten().map(|i| i.to_le_bytes())),
            "normals": mesh.normals.as_ref().map(|n| words.vectors(n)),
            "uvs": mesh.uvs.as_ref().map(|uvs| words.floats(uvs.iter().flat_map(|uv| uv.to_array()))),
        })
    };
    let input = |input: Input| match input {
        Input::Texture(i) => json!(i),
        Input::VertexColor | Input::Tinted(_) => Value::Null,
    };
    let material = |kind: &MaterialKind| match *kind {
        MaterialKind::Black => json!({"kind": "black"}),
        MaterialKind::Diffuse { reflectance } => json!({"kind": "diffuse", "reflectance": input(reflectance)}),
        MaterialKind::Conductor { reflectance, roughness } => {
            json!({"kind": "conductor", "reflectance": input(reflectance), "roughness": input(roughness)})
        }
        MaterialKind::Dielectric { ior, roughness, .. } => {
            json!({"kind": "dielectric", "ior": input(ior), "roughness": roughness.map(input)})
        }
        MaterialKind::Mirror { reflectance } => json!({"kind": "mirror", "reflectance": input(reflectance)}),
        _ => json!({"kind": "other"}),
    };
    scene
        .shapes
        .iter()
        .map(|shape| {
            let emission = shape.emission.as_ref();
            json!({
                "mesh": mesh(&shape.mesh),
                "material": material(&shape.material.kind),
                "coat": shape.material.coat.as_ref().map(|c| json!({"weight": input(c.weight), "roughness": input(c.roughness)})),
                "normals": shape.material.normals.map(input),
                "emission": emission.map(|e| json!({"radiance": input(e.radiance), "two_sided": e.two_sided})),
            })
        })
        .collect()
}

fn textures(scene: &SceneDescription, words: &mut Words) -> Vec<Value> {
    scene
        .textures
        .iter()
        .map(|t| {
            json!({
                "width": t.width, "height": t.height, "channels": t.channels,
                "data": words.floats(t.numbers()),
                "wrap": match t.wrap { Wrap::Repeat => "repeat", Wrap::Clamp => "clamp", Wrap::Mirror => "mirror" },
                // Mitsuba has no mip maps: no scene has one.
                "filter": if t.filter == Filter::Nearest { "nearest" } else { "bilinear" },
            })
        })
        .collect()
}

fn delta_light(light: &DeltaLight) -> Value {
    match light {
        DeltaLight::Point { position, intensity } => {
            json!({"kind": "point", "position": position.to_array(), "power": intensity.to_array()})
        }
        // Mitsuba's fades out in another way: no scene has one.
        DeltaLight::Spot { position, intensity, .. } => {
            json!({"kind": "spot", "position": position.to_array(), "power": intensity.to_array()})
        }
        // No scene has one.
        DeltaLight::Goniometric { position, intensity, .. } => {
            json!({"kind": "point", "position": position.to_array(), "power": intensity.to_array()})
        }
        DeltaLight::Directional { direction, irradiance } => {
            json!({"kind": "directional", "direction": direction.to_array(), "power": irradiance.to_array()})
        }
    }
}
