//! What a mesh or scene file says and is not done is told by name, and numbers beyond their range with what is taken instead.

use dscene::image::Image;
use dscene::image::file::encode_png;
use dscene::mesh::load::{Wanted, load};
use glam::Vec3;
use serde_json::{Value, json};

use crate::gltf::Builder;
use crate::mesh_files::{dot, material, only, read};
use crate::place::Place;

#[test]
fn what_a_material_asks_for_in_vain_is_told_by_name() {
    let place = Place::new();
    place.write("dot.png", dot(&[1.0, 0.0, 0.0]));
    let mtl = "newmtl m\nmap_Bump -bm 2 dot.png\nillum 7\nmap_Kd -mm 0 2 dot.png\nmap_Ke gone.png\nPs 0.5\n";
    let (_, loaded) = material(&place, mtl);
    let expected = [
        "parts of materials are left out: map_Bump of “m”, `-mm` of map_Kd of “m”, Ps of “m”",
        "glass (`illum` 4, 6, 7 and 9) without a refractive index (`Ni`) above 1 is rendered as an opaque surface: “m”",
        "image “gone.png” of material “m”: there is no such file or folder",
    ];
    assert_eq!(loaded.warnings, expected);
}

/// Each number that is brought back is told with what it was and what it is.
#[test]
fn numbers_of_a_material_beyond_their_range_are_told() {
    let place = Place::new();
    place.write("dot.png", dot(&[1.0, 0.0, 0.0]));
    for (mtl, told) in [
        ("d 1.7", "d of “m” (1.7, taken as 1)"),
        ("Tr -1", "Tr of “m” (-1, taken as 0)"),
        ("Pr 2", "Pr of “m” (2, taken as 1)"),
        ("Pm -0.5", "Pm of “m” (-0.5, taken as 0)"),
        ("Pc 3", "Pc of “m” (3, taken as 1)"),
        ("Pcr -3", "Pcr of “m” (-3, taken as 0)"),
        ("Ns -3", "Ns of “m” (-3, taken as 0)"),
        ("Ke -1", "Ke of “m” (-1, taken as 0)"),
        ("Ks 2 2 2", "Ks of “m” (2, taken as 1)"),
        ("Kd 3 -1 0.5", "Kd of “m” ([3, -1, 0.5], taken as [1, 0, 0.5])"),
        ("Ni 12\nillum 2", "Ni of “m” (12, taken as 10)"),
    ] {
        let (m, loaded) = material(&place, format!("newmtl m\n{mtl}\n"));
        let sentence = "numbers of materials beyond their range are brought back into it";
        assert_eq!(loaded.warnings, [format!("{sentence}: {told}")], "{mtl}");
        let units = [
            m.metallic,
            m.roughness,
            m.base_color.x,
            m.base_color.y,
            m.coat.as_ref().map_or(0.0, |coat| coat.roughness),
        ];
        assert!(units.iter().all(|x| (0.0..=1.0).contains(x)) && m.emissive == Vec3::ZERO, "{mtl}: {m:?}");
        assert_eq!(m.opacity, None, "{mtl}");
    }
    for (mtl, told) in [
        ("d nan", "lines that cannot be understood are left out: `d nan` (line 2 of “m.mtl”)"),
        ("Ni 0.5", "refractive indices (`Ni`) below 1 are left out: “m”"),
        ("Ka 1 0 0", "ambient colours (`Ka`, `map_Ka`) are left out: ambient light is traced: “m”"),
        ("map_Ka dot.png", "ambient colours (`Ka`, `map_Ka`) are left out: ambient light is traced: “m”"),
        ("Tf 0.5 1 1", "parts of materials are left out: Tf of “m”"),
        ("sharpness 100", "parts of materials are left out: sharpness of “m”"),
        ("illum 10", "parts of materials are left out: `illum 10` (a surface of which only the shadows show) of “m”"),
        ("Ks 1 0 0", "of the colours of highlights (`Ks`) only the mean is taken: “m”"),
        ("d 0.5\nTr 0.1", "where `d` and `Tr` contradict each other, `d` counts: “m”"),
        ("map_Kd -imfchan r dot.png", "parts of materials are left out: `-imfchan` of map_Kd of “m”"),
    ] {
        assert_eq!(material(&place, format!("newmtl m\n{mtl}\n")).1.warnings, [told], "{mtl}");
    }
    let (m, loaded) = material(&place, "newmtl m\nKa 0 0 0\nTf 1 1 1\nsharpness 60\nmap_aat on\nd 0.5\nTr 0.5\n");
    assert_eq!((loaded.warnings, m.opacity.unwrap().image.data[0]), (Vec::<String>::new(), 0.5));
}

#[test]
fn what_ply_says_in_vain_is_told_by_name() {
    let place = Place::new();
    let vertices = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float quality\nproperty float nx\n";
    let faces = "element face 3\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nproperty uchar red\n";
    let corners = "0 0 0 9 1\n1 0 0 9 1\n0 1 0 9 1\n";
    let rows = "3 0 1 2 6 0 0 1 0 0 1 255\n3 0 1 2 4 0 0 1 0 255\n2 0 1 4 0 0 1 0 255\n";
    place.write("a.ply", format!("ply\nformat ascii 1.0\n{vertices}{faces}end_header\n{corners}{rows}"));
    let expected = [
        "properties are left out: “quality” of “vertex”, “nx” of “vertex”, “red” of “face”",
        "texture coordinates (`texcoord`) that are not two numbers for each corner are left out: those of face 1",
        "faces of fewer than three corners are left out: face 2",
    ];
    assert_eq!(read(&place, "a.ply").warnings, expected);
    // Faces may come before vertices.
    place.write("b.ply", format!("ply\nformat ascii 1.0\n{faces}{vertices}end_header\n{rows}{corners}"));
    let loaded = read(&place, "b.ply");
    let mut found = loaded.warnings.clone();
    found.sort();
    assert_eq!(
        found[1..],
        [
            expected[0].replace(
                "“quality” of “vertex”, “nx” of “vertex”, “red” of “face”",
                "“red” of “face”, “quality” of “vertex”, “nx” of “vertex”"
            ),
            expected[1].to_owned()
        ]
    );
    assert_eq!(only(&loaded).mesh.faces.len(), 2);
    let strips = "element tristrips 1\nproperty list int int vertex_indices\nproperty int flags\nend_header\n";
    place.write("c.ply", format!("ply\nformat ascii 1.0\n{vertices}{strips}{corners}3 0 1 2 7\n"));
    assert!(read(&place, "c.ply").warnings[0].ends_with("“nx” of “vertex”, “flags” of “tristrips”"));
}

#[test]
fn what_gltf_asks_for_in_vain_is_told_by_name() {
    let place = Place::new();
    let mut file = Builder::new();
    file.add("images", json!({"uri": "gone.png"}));
    file.add("textures", json!({"source": 0}));
    file.add("textures", json!({"extensions": {"KHR_texture_basisu": {"source": 0}}}));
    file.add(
        "materials",
        json!({"name": "glass", "normalTexture": {"index": 0}, "emissiveTexture": {"index": 1},
        "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "metallicFactor": 0},
        "extensions": {"KHR_materials_transmission": {"transmissionFactor": 1},
            "KHR_materials_pbrSpecularGlossiness": {"glossinessFactor": 0.5}}}),
    );
    let mesh = file.triangle(json!({}), json!({"material": 0}));
    file.add(
        "nodes",
        json!({"mesh": mesh, "name": "n", "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {}}}}),
    );
    file.add("animations", json!({"name": "walk", "channels": [], "samplers": []}));
    place.write("a.gltf", file.text());
    let expected = [
        "animations are left out: everything is as it stands without them: “walk”",
        "extensions of nodes are left out: EXT_mesh_gpu_instancing of “n”",
        "image “gone.png” of “glass”: there is no such file or folder",
        "images in formats that are not supported are left out: KHR_texture_basisu of “glass”",
        "extensions of materials are left out: KHR_materials_pbrSpecularGlossiness of “glass”",
        "panes let all light through but for their colour: what they have beside it and their roughness is left out: “glass”",
    ];
    assert_eq!(read(&place, "a.gltf").warnings, expected);
    // A mesh alone has no material to be told of, but for files that are not there.
    let told = load(&place.path("a.gltf"), Wanted::Mesh).unwrap().warnings;
    assert_eq!(told, [expected[0], expected[1], "images are missing: “gone.png” of “glass”"]);
    // What is not supported is not damaged.
    for (required, version, says) in [
        (
            "KHR_draco_mesh_compression",
            "2.0",
            "its meshes are compressed (KHR_draco_mesh_compression), which is not supported",
        ),
        ("KHR_lights_punctual", "1.0", "this is glTF 1.0, which is not supported"),
    ] {
        let mut file = Builder::new();
        file.json["extensionsRequired"] = json!([required]);
        file.json["asset"]["version"] = json!(version);
        if version == "1.0" {
            file.json["meshes"] = json!({"a": {}});
        }
        let path = place.write("b.gltf", file.text());
        let found = load(&path, Wanted::Scene).unwrap_err().to_string();
        assert!(found.contains(says) && !found.contains("damaged"), "{found}");
    }
}

#[test]
fn what_else_gltf_has_is_told_by_name() {
    let place = Place::new();
    let mut file = Builder::new();
    place.write("dot.png", dot(&[1.0, 1.0, 1.0]));
    file.add("images", json!({"uri": "dot.png"}));
    file.add("textures", json!({"source": 0}));
    file.add("materials", json!({"name": "m", "occlusionTexture": {"index": 0}}));
    let zeros = file.add("accessors", json!({"componentType": 5126, "count": 3, "type": "VEC3"}));
    let mesh = file.triangle(json!({"COLOR_0": zeros, "COLOR_1": zeros}), json!({"material": 0}));
    file.add("nodes", json!({"mesh": mesh, "name": "n"}));
    file.json["scenes"] = json!([{"nodes": [0], "extensions": {"EXT_lights_image_based": {"light": 0}}}]);
    place.write("a.gltf", file.text());
    let expected = [
        "extensions of the scene are left out: EXT_lights_image_based",
        "vertex colours beside the first ones (COLOR_0) are left out: “n”",
        "occlusion textures are left out: rendering computes what they hold: “m”",
    ];
    assert_eq!(read(&place, "a.gltf").warnings, expected);
}

/// What lets light through has neither coat nor sheen nor holes, and metal lets none through: a material of glTF is metal where it does not say
/// otherwise.
#[test]
fn what_glass_of_gltf_has_in_vain_is_told() {
    let place = Place::new();
    // Roughness in the green channel, metal in the blue one: there is none.
    let image = Image { width: 1, height: 1, channels: 3, data: vec![1.0, 0.0, 0.0] };
    place.write("packed.png", encode_png(&image).unwrap());
    for (name, thickness) in [("pane", 0), ("body", 1)] {
        let glass = |name: &str, pbr: Value| {
            json!({"name": name, "pbrMetallicRoughness": pbr, "extensions": {
                "KHR_materials_transmission": {"transmissionFactor": 1},
                "KHR_materials_volume": {"thicknessFactor": thickness}}})
        };
        let mut decked = glass(name, json!({"metallicFactor": 0, "baseColorFactor": [1, 1, 1, 0.5]}));
        decked["alphaMode"] = json!("BLEND");
        for (extension, factors) in [
            ("KHR_materials_clearcoat", json!({"clearcoatFactor": 1})),
            ("KHR_materials_sheen", json!({"sheenColorFactor": [1, 0, 0]})),
            ("KHR_materials_specular", json!({"specularFactor": 0})),
        ] {
            decked["extensions"][extension] = factors;
        }
        let mut file = Builder::new();
        file.add("images", json!({"uri": "packed.png"}));
        file.add("textures", json!({"source": 0}));
        let packed = glass("packed", json!({"metallicRoughnessTexture": {"index": 0}}));
        for (i, material) in [decked, glass("steel", json!({})), packed].into_iter().enumerate() {
            file.add("materials", material);
            let uvs = file.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
            let mesh = file.triangle(json!({"TEXCOORD_0": uvs}), json!({"material": i}));
            file.add("nodes", json!({"mesh": mesh}));
        }
        file.json["scenes"] = json!([{"nodes": [0, 1, 2]}]);
        place.write("a.gltf", file.text());
        let loaded = read(&place, "a.gltf");
        let all = "of what lets all light through";
        let told = [
            format!("the coat {all} is left out: “{name}”"),
            format!("the sheen {all} is left out: “{name}”"),
            format!("the holes (`alphaMode`) {all} are left out: “{name}”"),
            format!("the specularFactor {all} is left out: its `ior` counts: “{name}”"),
        ];
        assert_eq!(loaded.warnings, told, "{name}");
        let clear = [0, 1, 2].map(|i: usize| loaded.parts[i].material.as_ref().unwrap().clear.is_some());
        assert_eq!(clear, [true, false, true], "{name}");
    }
}

/// With what it was and what it is, also where the glTF crate reads nothing.
#[test]
fn numbers_of_gltf_beyond_their_range_are_told() {
    let place = Place::new();
    let extension = |name: &str, what: Value| json!({"name": "m", "extensions": {name: what}});
    let pbr = |what: Value| json!({"name": "m", "pbrMetallicRoughness": what});
    let glass = |volume: Value, ior: f64| {
        json!({"name": "m", "pbrMetallicRoughness": {"roughnessFactor": 0, "metallicFactor": 0}, "extensions": {
            "KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_ior": {"ior": ior},
            "KHR_materials_volume": volume}})
    };
    let sheen = |color: Value, roughness: f64| {
        json!({"name": "m", "pbrMetallicRoughness": {"metallicFactor": 0}, "extensions": {
            "KHR_materials_specular": {"specularFactor": 0},
            "KHR_materials_sheen": {"sheenColorFactor": color, "sheenRoughnessFactor": roughness}}})
    };
    for (material, told) in [
        (pbr(json!({"roughnessFactor": 2})), "roughnessFactor of “m” (2, taken as 1)"),
        (pbr(json!({"metallicFactor": -1})), "metallicFactor of “m” (-1, taken as 0)"),
        (
            pbr(json!({"baseColorFactor": [2, 0.5, 1, 1]})),
            "baseColorFactor of “m” ([2, 0.5, 1, 1], taken as [1, 0.5, 1, 1])",
        ),
        (json!({"name": "m", "alphaMode": "MASK", "alphaCutoff": -1}), "alphaCutoff of “m” (-1, taken as 0)"),
        (json!({"name": "m", "emissiveFactor": [0, -2, 0]}), "emissiveFactor of “m” ([0, -2, 0], taken as 0)"),
        (
            extension("KHR_materials_emissive_strength", json!({"emissiveStrength": -3})),
            "emissiveStrength of “m” (-3, taken as 0)",
        ),
        (extension("KHR_materials_specular", json!({"specularFactor": 4})), "specularFactor of “m” (4, taken as 1)"),
        (extension("KHR_materials_ior", json!({"ior": 0.5})), "ior of “m” (0.5, taken as 1)"),
        (extension("KHR_materials_clearcoat", json!({"clearcoatFactor": 2})), "clearcoatFactor of “m” (2, taken as 1)"),
        (
            extension("KHR_materials_clearcoat", json!({"clearcoatFactor": 1, "clearcoatRoughnessFactor": -1})),
            "clearcoatRoughnessFactor of “m” (-1, taken as 0)",
        ),
        (
            extension("KHR_materials_anisotropy", json!({"anisotropyStrength": -1})),
            "anisotropyStrength of “m” (-1, taken as 0)",
        ),
        (sheen(json!([0.5, 0.5, 7]), 0.5), "sheenColorFactor of “m” ([0.5, 0.5, 7], taken as [0.5, 0.5, 1])"),
        (sheen(json!([1, 1, 1]), 1.5), "sheenRoughnessFactor of “m” (1.5, taken as 1)"),
        (glass(json!({"thicknessFactor": 1}), 30.0), "ior of “m” (30, taken as 10)"),
        (glass(json!({"thicknessFactor": -1}), 1.5), "thicknessFactor of “m” (-1, taken as 0)"),
        (
            glass(json!({"thicknessFactor": 1, "attenuationDistance": 1, "attenuationColor": [2, 1, 1]}), 1.5),
            "attenuationColor of “m” ([2, 1, 1], taken as 1)",
        ),
    ] {
        let mut file = Builder::new();
        file.add("materials", material.clone());
        let mesh = file.triangle(json!({}), json!({"material": 0}));
        file.add("nodes", json!({"mesh": mesh}));
        place.write("a.gltf", file.text());
        let loaded = read(&place, "a.gltf");
        let sentence = "numbers of materials beyond their range are brought back into it";
        let found: Vec<&String> = loaded.warnings.iter().filter(|told| !told.starts_with("without texture")).collect();
        assert_eq!(found, [&format!("{sentence}: {told}")], "{material}");
        assert_eq!(load(&place.path("a.gltf"), Wanted::Mesh).unwrap().warnings, Vec::<String>::new(), "{material}");
    }
}

/// Attributes that nothing is made of, and those that do not go with the mesh.
#[test]
fn attributes_of_gltf_that_are_left_out_are_told() {
    let place = Place::new();
    place.write("dot.png", dot(&[0.5, 0.5, 1.0]));
    let made = |attributes: &dyn Fn(&mut Builder) -> Value, material: Value| {
        let mut file = Builder::new();
        file.add("images", json!({"uri": "dot.png"}));
        file.add("textures", json!({"source": 0}));
        file.add("materials", material);
        let attributes = attributes(&mut file);
        let mesh = file.triangle(attributes, json!({"material": 0}));
        file.add("nodes", json!({"mesh": mesh, "name": "n"}));
        file
    };
    let all = |file: &mut Builder| {
        let uvs = file.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
        let own = file.floats("SCALAR", &[1.0, 2.0, 3.0]);
        let tangents = file.floats("VEC4", &[1.0, 0.0, 0.0, 1.0].repeat(3));
        json!({"TEXCOORD_0": uvs, "TEXCOORD_1": uvs, "TANGENT": tangents, "_FOO": own})
    };
    let normals = json!({"name": "m", "normalTexture": {"index": 0}});
    let second = "texture coordinates beside those of a material's first image are left out: TEXCOORD_1 of “n”";
    let expected = [
        "attributes of applications are left out: “_FOO”",
        "tangents (TANGENT) are left out: they are made from texture coordinates: “n”",
        second,
    ];
    let sorted = |mut all: Vec<String>| {
        all.sort();
        all
    };
    place.write("a.gltf", made(&all, normals.clone()).text());
    assert_eq!(sorted(read(&place, "a.gltf").warnings), expected);
    // Tangents are of no use without what is turned along them.
    place.write("b.gltf", made(&all, json!({"name": "m"})).text());
    assert_eq!(sorted(read(&place, "b.gltf").warnings), [expected[0], second]);
    for (name, kind, numbers) in [("TANGENT", "VEC4", 8), ("TEXCOORD_1", "VEC2", 8), ("_FOO", "SCALAR", 2)] {
        let short = |file: &mut Builder| json!({name: file.floats(kind, &vec![0.5; numbers])});
        let path = place.write("c.gltf", made(&short, normals.clone()).text());
        let found = load(&path, Wanted::Scene).map(|_| ());
        match name {
            // Nothing says that what applications keep is one for each vertex, and it is gone before.
            "_FOO" => assert!(found.is_ok(), "{found:?}"),
            _ => {
                let says = format!(
                    "“n”: the mesh has 3 vertices but {} of {name}",
                    numbers / kind[3..].parse::<usize>().unwrap()
                );
                assert!(found.unwrap_err().to_string().ends_with(&says), "{says}");
            }
        }
    }
    for (version, least, is_read) in [
        ("1.0", None, false),
        ("2", None, true),
        ("2.1", None, true),
        ("2.1", Some("2.1"), false),
        ("3.0", None, false),
        ("3.0", Some("2.0"), true),
    ] {
        let mut file = made(&|_| json!({}), json!({}));
        file.json["asset"]["version"] = json!(version);
        if let Some(least) = least {
            file.json["asset"]["minVersion"] = json!(least);
        }
        let path = place.write("d.gltf", file.text());
        let found = load(&path, Wanted::Scene).map(|_| ()).map_err(|e| e.to_string());
        assert_eq!(found.is_ok(), is_read, "{version} {least:?}: {found:?}");
        if let Err(told) = found {
            let says = format!("this is glTF {}, which is not supported; 2.0 is", least.unwrap_or(version));
            assert!(told.ends_with(&says), "{told}");
        }
    }
}
