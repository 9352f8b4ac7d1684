//! Asset files with random damage: each loads or is refused in words, and nothing panics or takes long.

#[path = "common/cpu.rs"]
mod cpu;
#[path = "common/dice.rs"]
mod dice;
#[path = "common/gltf.rs"]
mod gltf;

use std::fs;

use dscene::image::Image;
use dscene::image::file::{self, Encoding};
use dscene::memory;
use dscene::mesh::load::{Wanted, load, load_cameras};
use serde_json::json;

use cpu::{CpuTime, patience};
use dice::Dice;
use gltf::Builder;

const OBJ: &str = "mtllib a.mtl\no one\nv 0 1 0\nv 1 1 0\nv 0 1 1\nv 1 1 1\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 1 0\nusemtl m\n\
                   f 1/1/1 2/2/1 3/3/1\ns 1\nf -3/2 -1/1 -2/3\nusemtl n\nf 1 2 4 3\n";
const MTL: &str = "newmtl m\nKd 0.5 0.2 0.1\nKs 0.1 0.1 0.1\nNs 30\nillum 2\nd 0.5\nTr 0.5\nmap_Kd -s 2 2 1 -o 0.5 0 -mm 0 1 a.png\n\
                   map_d -imfchan r a.png\nnewmtl n\nKe 1 1 1\nPr 0.3\nPm 1\nmap_Bump -bm 2 a.png\n";
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                   property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 1\n\
                   property list uchar int vertex_indices\nproperty list uchar float texcoord\n\
                   element tristrips 1\nproperty list int int vertex_indices\nend_header\n\
                   0 1 0 9 9 9\n1 1 0 9 9 9\n0 1 1 9 9 9\n1 1 1 9 9 9\n4 0 1 3 2 8 0 0 1 0 1 1 0 1\n5 0 1 2 -1 3\n";
const STL: &str = "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 1 0\nvertex 1 1 0\nvertex 0 1 1\nendloop\n\
                   endfacet\nendsolid x\n";

/// A file with everything that is read: a skin, morph targets, colours, sparse numbers, an image, lights, a camera.
fn gltf_file() -> Builder {
    let mut file = Builder::new();
    let joints = file.bytes("VEC4", 4, &[0, 1, 0, 0].repeat(3), false);
    let weights = file.floats("VEC4", &[0.5, 0.5, 0.0, 0.0].repeat(3));
    let colors = file.bytes("VEC4", 4, &[255; 12], true);
    let uvs = file.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let up = file.floats("VEC3", &[0.0, 0.0, 2.0].repeat(3));
    let (at, with) = (file.view(&[1, 0, 0, 0]), file.view(&[0; 12]));
    let sparse =
        json!({"count": 1, "indices": {"bufferView": at, "componentType": 5125}, "values": {"bufferView": with}});
    let right = file.add("accessors", json!({"componentType": 5126, "count": 3, "type": "VEC3", "sparse": sparse}));
    let attributes = json!({"JOINTS_0": joints, "WEIGHTS_0": weights, "COLOR_0": colors, "TEXCOORD_0": uvs});
    let primitive = json!({"material": 0, "targets": [{"POSITION": up}, {"POSITION": right}]});
    let mesh = file.triangle(attributes, primitive);
    file.json["meshes"][mesh]["weights"] = json!([0.5, 0.25]);
    let bind = file.floats("MAT4", &[1.0, 0.0, 0.0, 0.0, 0.0].repeat(7)[..32]);
    file.add("images", json!({"uri": "a.png"}));
    file.add("samplers", json!({"wrapS": 33071, "magFilter": 9728}));
    file.add("textures", json!({"source": 0, "sampler": 0}));
    file.add(
        "materials",
        json!({"name": "m", "alphaMode": "MASK", "emissiveFactor": [1, 1, 1],
        "extensions": {"KHR_materials_unlit": {}}, "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}),
    );
    file.add("nodes", json!({"mesh": mesh, "skin": 0, "children": [1, 2]}));
    let light = json!({"KHR_lights_punctual": {"light": 0}});
    file.add("nodes", json!({"translation": [1, 2, 4], "extensions": light}));
    file.add("nodes", json!({"rotation": [0, 0, 0, 1], "camera": 0}));
    file.add("cameras", json!({"type": "perspective", "perspective": {"yfov": 0.5, "aspectRatio": 2, "znear": 0.1}}));
    file.add("skins", json!({"joints": [1, 2], "inverseBindMatrices": bind}));
    let spot = json!({"type": "spot", "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.6}});
    file.json["extensions"] = json!({"KHR_lights_punctual": {"lights": [spot]}});
    file
}

/// Flips, drops, doubles or cuts bytes, or puts a number that hurts in place of a digit.
fn mutated(bytes: &[u8], dice: &mut Dice) -> Vec<u8> {
    const NUMBERS: [&[u8]; 7] = [b"-1", b"4294967295", b"99999999999999999999", b"nan", b"1e39", b"0", b"inf"];
    let mut bytes = bytes.to_vec();
    for _ in 0..1 + dice.below(3) {
        let at = dice.below(bytes.len());
        match dice.below(6) {
            0 => bytes.truncate(at),
            1 if !bytes.is_empty() => drop(bytes.remove(at)),
            2 if !bytes.is_empty() => bytes[at] ^= 1 << dice.below(8),
            3 if !bytes.is_empty() => bytes[at] = [0, 0x7f, 0x80, 0xff][dice.below(4)],
            _ => {
                let digits: Vec<usize> = (0..bytes.len()).filter(|&i| bytes[i].is_ascii_digit()).collect();
                if let Some(&digit) = digits.get(dice.below(digits.len())) {
                    bytes.splice(digit..=digit, NUMBERS[dice.below(NUMBERS.len())].iter().copied());
                }
            }
        }
    }
    bytes
}

/// The most bytes that this process ever held, where the system says so; what it holds elsewhere.
fn most_held() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    let kilobytes = line.and_then(|l| l.trim().strip_suffix("kB")?.trim().parse::<u64>().ok());
    kilobytes.map_or_else(memory::held, |k| 1024 * k)
}

#[test]
fn damaged_assets_load_or_are_refused() {
    const MUTANTS: usize = 300;
    let folder = tempfile::tempdir().unwrap();
    let mut picture = Image::new(5, 4, 3);
    picture.data.iter_mut().enumerate().for_each(|(i, x)| *x = i as f32 / 60.0);
    let gltf = gltf_file();
    // The OBJ is read for its MTL too, which comes first so that it is there in whole when the OBJ is damaged.
    let texts = [("a.mtl", MTL), ("a.obj", OBJ), ("a.ply", PLY), ("a.stl", STL), ("a.gltf", &gltf.text())];
    let mut files: Vec<(String, Vec<u8>)> =
        texts.into_iter().map(|(name, text)| (name.to_owned(), text.as_bytes().to_vec())).collect();
    files.push(("a.glb".to_owned(), gltf.glb()));
    file::save(&folder.path().join("a.png"), &picture).unwrap();
    fs::write(folder.path().join("a.obj"), OBJ).unwrap();
    for name in ["a.png", "a.exr", "a.hdr"] {
        let path = folder.path().join(name);
        file::save(&path, &picture).unwrap();
        files.push((name.to_owned(), fs::read(&path).unwrap()));
    }
    let mut dice = Dice(0x5eed_a55e);
    for (name, whole) in &files {
        let path = folder.path().join(name);
        let is_image = ["png", "exr", "hdr"].iter().any(|e| name.ends_with(e));
        // A damaged MTL is met by its OBJ.
        let extension = name.split('.').next_back().map(|e| if e == "mtl" { "obj" } else { e }).unwrap();
        let read = || match is_image {
            true => file::load(&path, Encoding::Srgb, None).map(|_| ()).map_err(|e| e.to_string()),
            false => {
                let cameras = load_cameras(&path).map(|_| ());
                let scene = load(&path.with_extension(extension), Wanted::Scene).map(|_| ());
                if name.contains(".gl") { scene.and(cameras) } else { scene }.map_err(|e| e.to_string())
            }
        };
        fs::write(&path, whole).unwrap();
        read().unwrap_or_else(|e| panic!("{name} unharmed: {e}"));
        let mut refused = 0;
        for number in 0..MUTANTS {
            let bytes = mutated(whole, &mut dice);
            fs::write(&path, &bytes).unwrap();
            let begun = CpuTime::now();
            let outcome = std::panic::catch_unwind(read);
            let text = String::from_utf8_lossy(&bytes);
            assert!(begun.elapsed() < patience(), "mutant {number} of {name} is slow:\n{text}");
            assert!(most_held() < 1 << 30, "mutant {number} of {name} takes much:\n{text}");
            match outcome {
                Ok(Ok(())) => {}
                Ok(Err(message)) => {
                    assert!(!message.is_empty());
                    refused += 1;
                }
                Err(_) => panic!("mutant {number} of {name} panics:\n{text}"),
            }
        }
        // An MTL is never a reason to refuse an OBJ.
        if name == "a.mtl" {
            assert_eq!(refused, 0);
            continue;
        }
        assert!(refused > MUTANTS / 20, "{name}: only {refused} of {MUTANTS} were refused");
    }
}
