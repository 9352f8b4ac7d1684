//! Images and data files with random damage: each loads or is refused in words; nothing panics, takes long or takes much memory.

#[path = "common/cpu.rs"]
mod cpu;
#[path = "common/dice.rs"]
mod dice;

use dscene::data::{ies, npy, safetensors, table};
use dscene::image::Image;
use dscene::image::file::{self, Encoding};
use dscene::network::{Description, Network};
use dscene::tape::Tensor;

use cpu::{CpuTime, patience};
use dice::Dice;

const MUTANTS: usize = 300;

/// Flips, drops, cuts or doubles bytes, or writes numbers that hurt, in the first bytes as often as elsewhere.
fn mutated(bytes: &[u8], dice: &mut Dice) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..1 + dice.below(4) {
        if bytes.is_empty() {
            break;
        }
        let end = if dice.below(2) == 0 { bytes.len().min(400) } else { bytes.len() };
        let at = dice.below(end);
        match dice.below(7) {
            0 => bytes.truncate(at),
            1 => drop(bytes.remove(at)),
            2 => bytes[at] ^= 1 << dice.below(8),
            3 => bytes[at] = [0, 0x7f, 0x80, 0xff][dice.below(4)],
            4 => bytes.iter_mut().skip(at).take(4).for_each(|b| *b = 0xff),
            5 => bytes.insert(at, bytes[at]),
            _ => {
                let digits: Vec<usize> = (0..bytes.len()).filter(|&i| bytes[i].is_ascii_digit()).collect();
                if let Some(&digit) = digits.get(dice.below(digits.len().max(1))) {
                    let numbers: [&[u8]; 5] = [b"-1", b"99999", b"4294967295", b"99999999999999999999", b"nan"];
                    bytes.splice(digit..=digit, numbers[dice.below(5)].iter().copied());
                }
            }
        }
    }
    bytes
}

fn survives(name: &str, whole: &[u8], read: impl Fn(&[u8]) -> Result<(), String> + std::panic::RefUnwindSafe) {
    dscene::memory::set_limit(1 << 30);
    read(whole).unwrap_or_else(|e| panic!("{name} unharmed: {e}"));
    let mut dice = Dice(0xda7a_5eed ^ whole.len() as u64);
    let mut refused = 0;
    for number in 0..MUTANTS {
        let bytes = mutated(whole, &mut dice);
        let begun = CpuTime::now();
        let outcome = std::panic::catch_unwind(|| read(&bytes));
        let outcome = outcome.unwrap_or_else(|_| panic!("mutant {number} of {name} panics: {bytes:?}"));
        assert!(begun.elapsed() < patience(), "mutant {number} of {name} is slow: {bytes:?}");
        refused += usize::from(outcome.is_err_and(|message| !message.is_empty()));
    }
    assert!(refused > MUTANTS / 20, "{name}: only {refused} of {MUTANTS} were refused");
}

fn image(bytes: &[u8]) -> Result<(), String> {
    let decoded = file::decode(bytes, Encoding::AsFile, None).map_err(|e| e.to_string())?;
    decoded.image.check().map_err(|e| panic!("no image: {e}"))
}

fn picture() -> Image {
    let mut picture = Image::new(13, 11, 3);
    picture.data.iter_mut().enumerate().for_each(|(i, x)| *x = i as f32 / 429.0);
    picture
}

fn saved(name: &str) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    file::save(&path, &picture()).unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn damaged_png() {
    survives("PNG", &saved("a.png"), image);
}

#[test]
fn damaged_exr() {
    survives("EXR", &saved("a.exr"), image);
}

#[test]
fn damaged_hdr() {
    survives("HDR", &saved("a.hdr"), image);
}

#[test]
fn damaged_jpeg() {
    let pixels: Vec<u8> = (0..48 * 32 * 3).map(|i| (i * 7 % 251) as u8).collect();
    for (progressive, kind) in [(false, jpeg_encoder::ColorType::Rgb), (true, jpeg_encoder::ColorType::Rgb)] {
        let mut jpeg = Vec::new();
        let mut encoder = jpeg_encoder::Encoder::new(&mut jpeg, 80);
        encoder.set_progressive(progressive);
        encoder.encode(&pixels, 48, 32, kind).unwrap();
        survives("JPEG", &jpeg, image);
    }
}

#[test]
fn damaged_npy() {
    let array = Tensor { shape: vec![3, 4], data: (0..12).map(f64::from).collect() };
    survives("NPY", &npy::encode(&array), |bytes| npy::decode(bytes).map(|_| ()));
}

#[test]
fn damaged_ies() {
    let text = "IESNA:LM-63-2002\n[TEST] none\nTILT=INCLUDE\n1 2\n0 90\n1 1\n1 1000 2 3 3 1 2 0.1 0.1 0\n1 1 30\n0 45 90\n0 90 180\n\
        9 8 7\n6 5 4\n3 2 1\n";
    survives("IES", text.as_bytes(), |bytes| {
        let map = ies::decode(bytes)?.map()?;
        assert!(map.data.iter().all(|c| c.is_finite() && *c >= 0.0));
        Ok(())
    });
}

#[test]
fn damaged_safetensors() {
    let array = Tensor { shape: vec![3, 4], data: (0..12).map(f64::from).collect() };
    survives("safetensors", &safetensors::encode([("a", &array), ("b.weight", &array)]), |bytes| {
        let arrays = safetensors::decode(bytes.to_vec())?;
        arrays.names().try_for_each(|name| arrays.floats(name).map(|_| ()))
    });
}

/// Descriptions and weights of a network, damaged together with their names and sizes.
#[test]
fn damaged_network() {
    let array = |shape: &[usize]| Tensor { shape: shape.to_vec(), data: vec![0.25; shape.iter().product()] };
    let (conv, fc) = (array(&[4, 3, 3, 3]), array(&[5, 64]));
    let weights = safetensors::encode([("c.weight", &conv), ("f.weight", &fc)]);
    let description = r#"{"input": {"width": 9, "height": 9, "channels": "rgb", "range": 1, "mean": [0, 0, 0], "std": [1, 1, 1]},
        "layers": [{"kind": "conv", "name": "c", "stride": 2, "padding": [1, 1], "activation": "relu", "label": "x"},
                   {"kind": "add", "with": "x"}, {"kind": "max_pool", "size": 2, "stride": 1},
                   {"kind": "linear", "name": "f"}]}"#;
    survives("network", description.as_bytes(), |bytes| {
        let text = String::from_utf8_lossy(bytes);
        let weights = safetensors::decode(weights.clone())?;
        let network = Network::new(Description::parse(&text)?, &weights).map_err(|e| format!("{e:?}"))?;
        let (width, height) = network.picture();
        network.value(&vec![0.5; width * height * 3]).map(|_| ()).map_err(|e| e.to_string())
    });
}

#[test]
fn damaged_csv() {
    let text = "name,x,y\n\"a, b\",1.5,2\nc,-3e7,4\nd,,6\n";
    survives("CSV", text.as_bytes(), |bytes| table::decode(bytes).map(|_| ()));
}

#[test]
fn damaged_json() {
    use dscene::check::{Disk, check_text};
    let text = r#"{"a": [1, 2.5, [3, 4]], "b": {"c": "text", "d": [[1, 2], [3, 4]]}, "e": null, "f": true}"#;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.json");
    survives("JSON", text.as_bytes(), |bytes| {
        std::fs::write(&path, bytes).unwrap();
        let script = format!("let data = load_json({:?})", path.display().to_string());
        let program = check_text("s.dscene", None, script, &[], &Disk).program.unwrap();
        let mut engine = dscene::eval::Engine::new(program, Default::default());
        let id = engine.program().ids().find(|&id| engine.program().decl(id).name == "data").unwrap();
        engine
            .eval_decl(id)
            .map(|value| assert!(!dscene::eval::show(&value, &Default::default()).is_empty()))
            .map_err(|d| d.message)
    });
}
