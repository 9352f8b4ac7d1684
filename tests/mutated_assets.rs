//! Asset files with random damage: each loads or is refused in words, and nothing panics or takes long.

#[path = "common/dice.rs"]
mod dice;

use std::fs;
use std::time::{Duration, Instant};

use dscene::image::Image;
use dscene::image::file::{self, Encoding};
use dscene::mesh::load::{Wanted, load};

use dice::Dice;

const OBJ: &str = "v 0 1 0\nv 1 1 0\nv 0 1 1\nv 1 1 1\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 1 0\n\
                   f 1/1/1 2/2/1 3/3/1\nf -3/2/1 -1/1/1 -2/3/1\n";
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                   element face 1\nproperty list uchar int vertex_indices\nend_header\n0 1 0\n1 1 0\n0 1 1\n3 0 1 2\n";
const STL: &str = "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 1 0\nvertex 1 1 0\nvertex 0 1 1\nendloop\n\
                   endfacet\nendsolid x\n";
// One triangle: its three corners and indices in a data URI.
const GLTF: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0,"scale":[1,2,1]}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
"buffers":[{"byteLength":44,"uri":"data:application/octet-stream;base64,AAAAAAAAgD8AAAAAAACAPwAAgD8AAAAAAAAAAAAAgD8AAIA/AAABAAIAAAA="}],
"bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":6}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,1,0],"max":[1,1,1]},
{"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}]}"#;

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

#[test]
fn damaged_assets_load_or_are_refused() {
    const MUTANTS: usize = 400;
    let folder = tempfile::tempdir().unwrap();
    let mut picture = Image::new(5, 4, 3);
    picture.data.iter_mut().enumerate().for_each(|(i, x)| *x = i as f32 / 60.0);
    let mut files: Vec<(String, Vec<u8>)> = [("a.obj", OBJ), ("a.ply", PLY), ("a.stl", STL), ("a.gltf", GLTF)]
        .into_iter()
        .map(|(name, text)| (name.to_owned(), text.as_bytes().to_vec()))
        .collect();
    for name in ["a.png", "a.exr", "a.hdr"] {
        let path = folder.path().join(name);
        file::save(&path, &picture).unwrap();
        files.push((name.to_owned(), fs::read(&path).unwrap()));
    }
    let mut dice = Dice(0x5eed_a55e);
    for (name, whole) in &files {
        let path = folder.path().join(name);
        let is_image = ["png", "exr", "hdr"].iter().any(|e| name.ends_with(e));
        let read = || match is_image {
            true => file::load(&path, Encoding::Srgb).map(|_| ()).map_err(|e| e.to_string()),
            false => load(&path, Wanted::Scene).map(|_| ()).map_err(|e| e.to_string()),
        };
        fs::write(&path, whole).unwrap();
        read().unwrap_or_else(|e| panic!("{name} unharmed: {e}"));
        let mut refused = 0;
        for number in 0..MUTANTS {
            let bytes = mutated(whole, &mut dice);
            fs::write(&path, &bytes).unwrap();
            let begun = Instant::now();
            let outcome = std::panic::catch_unwind(read);
            let text = String::from_utf8_lossy(&bytes);
            assert!(begun.elapsed() < Duration::from_secs(10), "mutant {number} of {name} is slow:\n{text}");
            match outcome {
                Ok(Ok(())) => {}
                Ok(Err(message)) => {
                    assert!(!message.is_empty());
                    refused += 1;
                }
                Err(_) => panic!("mutant {number} of {name} panics:\n{text}"),
            }
        }
        assert!(refused > MUTANTS / 20, "{name}: only {refused} of {MUTANTS} were refused");
    }
}
