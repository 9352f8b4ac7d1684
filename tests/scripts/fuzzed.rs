//! Damaged inputs by chance, for every part that reads what others wrote. A few seconds of them by default, always the same ones; as many
//! seconds as one likes of one target by `DSCENE_FUZZ=SECONDS,TARGET` or, with other chance, `DSCENE_FUZZ=SECONDS,TARGET,SEED`:
//!
//! `DSCENE_FUZZ=600,parser cargo test --release --test scripts fuzzed:: -- --nocapture`
//!
//! The properties are those of the fuzzers in `fuzz/`, which find more for those who have a nightly compiler.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

use dscene::data::{npy, safetensors, table};
use dscene::image::Image;
use dscene::image::file;
use dscene::mesh::{save, shapes};
use dscene::tape::Tensor;

use crate::cpu::{CpuTime, patience};
use crate::dice::Dice;
use crate::gltf::Builder;
use crate::mutated_scripts::{damage, scripts};
use crate::properties;
use crate::typed_programs;

/// Draws inputs and hands them to `holds`, which panics if something does not hold; `seconds` of the processor, or as the environment says.
fn fuzz<T>(
    target: &str,
    seconds: f64,
    draw: impl Fn(&mut Dice) -> T,
    shown: impl Fn(&T) -> String,
    holds: impl Fn(&T),
) {
    let asked = std::env::var("DSCENE_FUZZ").ok();
    let mut words = asked.iter().flat_map(|asked| asked.split(','));
    let wall = words.next().map(|word| word.trim().parse().expect("DSCENE_FUZZ=SECONDS,TARGET"));
    if wall.is_some() && words.next().map(str::trim) != Some(target) {
        return;
    }
    let seed = words.next().map_or(0x5eed, |word| word.trim().parse().expect("a number as the seed"));
    let mut dice = Dice(seed ^ target.bytes().fold(0xf0221e5, |hash: u64, b| hash.wrapping_mul(31) + u64::from(b)));
    let (begun, worked) = (Instant::now(), CpuTime::now());
    let is_over = |wall: Option<f64>| match wall {
        Some(wall) => begun.elapsed().as_secs_f64() > wall,
        None => worked.elapsed().as_secs_f64() > seconds,
    };
    let (mut rounds, mut slowest) = (0_u64, Duration::ZERO);
    while !is_over(wall) {
        let input = draw(&mut dice);
        let working = CpuTime::now();
        let outcome = catch_unwind(AssertUnwindSafe(|| holds(&input)));
        let took = working.elapsed();
        assert!(outcome.is_ok(), "{target}, round {rounds}, of the input\n{}", shown(&input));
        assert!(took < patience(), "{target}, round {rounds}, takes {took:?} for the input\n{}", shown(&input));
        slowest = slowest.max(took);
        rounds += 1;
    }
    if wall.is_some() {
        eprintln!("{target}: {rounds} inputs hold; the slowest took {slowest:?}");
    }
}

/// A damaged script, or a part of one: most of what is wrong is wrong within a few statements.
fn text(scripts: &[String], dice: &mut Dice) -> String {
    let whole = &scripts[dice.below(scripts.len())];
    let parts: Vec<&str> = whole.split_inclusive("\n\n").collect();
    let from = dice.below(parts.len());
    let count = if dice.below(4) == 0 { parts.len() } else { 1 + dice.below(4) };
    let part: String = parts.iter().skip(from).take(count).copied().collect();
    damage(&part, dice)
}

#[test]
fn parser() {
    let scripts = scripts();
    scripts.iter().for_each(|text| properties::parser(text));
    fuzz("parser", 1.5, |dice| text(&scripts, dice), String::clone, |text| properties::parser(text));
}

#[test]
fn checker() {
    let scripts = scripts();
    fuzz("checker", 2.0, |dice| text(&scripts, dice), String::clone, |text| properties::checker(text));
}

/// Where the words (with digits: numbers) and the signs of a text are.
fn tokens(text: &str) -> Vec<(usize, usize)> {
    let kind = |c: char| match c {
        'a'..='z' | 'A'..='Z' | '0'..='9' | '_' => 'w',
        '+' | '-' | '*' | '/' | '<' | '>' | '=' | '^' | '%' | '@' => 's',
        _ => ' ',
    };
    let mut found: Vec<(usize, usize, char)> = vec![];
    for (at, c) in text.char_indices() {
        match found.last_mut() {
            Some((_, end, of)) if *end == at && *of == kind(c) => *end = at + c.len_utf8(),
            _ => found.push((at, at + c.len_utf8(), kind(c))),
        }
    }
    found.into_iter().filter(|(.., of)| *of != ' ').map(|(at, end, _)| (at, end)).collect()
}

/// A script that may well be right: up to three of its words and signs are others of the script, or numbers and signs that hurt.
fn altered(text: &str, dice: &mut Dice) -> String {
    const NUMBERS: [&str; 12] =
        ["0", "-1", "1", "0.5", "3", "1e9", "1e-300", "1e300", "90deg", "[1, 2, 3]", "(0 / 0)", "[x for x in 0..0]"];
    const SIGNS: [&str; 12] = ["+", "-", "*", "/", "^", "%", "@", "<", ">=", "==", "!=", "|>"];
    let mut text = text.to_owned();
    for _ in 0..1 + dice.below(3) {
        let mut found = tokens(&text);
        // Mostly a number for another: what a name stands for has a type.
        if dice.below(4) > 0 {
            found.retain(|(from, _)| text.as_bytes()[*from].is_ascii_digit());
        }
        let Some(&(from, to)) = found.get(dice.below(found.len())) else { continue };
        let old = &text[from..to];
        let new = match old.bytes().next() {
            Some(b'0'..=b'9') => {
                // Rarely something else than a number.
                let among = if dice.below(4) > 0 { 8 } else { NUMBERS.len() };
                NUMBERS[dice.below(among)].to_owned()
            }
            Some(b'a'..=b'z' | b'A'..=b'Z' | b'_') => {
                let (from, to) = found[dice.below(found.len())];
                text[from..to].to_owned()
            }
            _ => SIGNS[dice.below(SIGNS.len())].to_owned(),
        };
        text.replace_range(from..to, &new);
    }
    text
}

#[test]
fn evaluator() {
    let scripts = scripts();
    let draw = |dice: &mut Dice| {
        let whole = if dice.below(2) == 0 {
            scripts[dice.below(scripts.len())].clone()
        } else {
            let tape = |dice: &mut Dice| (0..1 + dice.below(60)).map(|_| dice.below(5000) as u16).collect();
            let tapes: Vec<Vec<u16>> = (0..1 + dice.below(6)).map(|_| tape(dice)).collect();
            typed_programs::script(&typed_programs::program(&tapes))
        };
        altered(&whole, dice)
    };
    let (drawn, evaluated) = (Cell::new(0), Cell::new(0));
    fuzz("evaluator", 3.0, draw, String::clone, |text| {
        drawn.set(drawn.get() + 1);
        evaluated.set(evaluated.get() + u32::from(properties::evaluator(text)));
    });
    assert!(4 * evaluated.get() >= drawn.get(), "only {} of {} scripts were right", evaluated.get(), drawn.get());
}

#[test]
fn formatter() {
    let scripts = scripts();
    let holds = |text: &String| _ = properties::formatter(text);
    fuzz("formatter", 2.0, |dice| text(&scripts, dice), String::clone, holds);
}

#[test]
fn lsp() {
    let scripts = scripts();
    let draw = |dice: &mut Dice| {
        let text = text(&scripts, dice);
        let mut bytes = properties::session(&text, |n| dice.below(n));
        // Some sessions are damaged themselves. The heads are left as they are, mostly, so that something is read at all.
        for _ in 0..[0, 0, 1, 3][dice.below(4)] {
            let at = dice.below(bytes.len());
            bytes[at] = b"{}[]\",:0-9nt\\"[dice.below(13)];
        }
        bytes
    };
    let shown = |bytes: &Vec<u8>| String::from_utf8_lossy(bytes).into_owned();
    fuzz("lsp", 2.0, draw, shown, |bytes| _ = properties::lsp(bytes));
}

/// Whole files of every ending.
fn whole_files() -> Vec<(&'static str, Vec<u8>)> {
    let mut picture = Image::new(13, 11, 3);
    picture.data.iter_mut().enumerate().for_each(|(i, x)| *x = i as f32 / 429.0);
    let folder = tempfile::tempdir().unwrap();
    let mut found = Vec::new();
    for ending in ["png", "hdr", "exr"] {
        let path = folder.path().join(format!("a.{ending}"));
        file::save(&path, &picture).unwrap();
        found.push((ending, std::fs::read(path).unwrap()));
    }
    let mut jpeg = Vec::new();
    let pixels: Vec<u8> = (0..48 * 32 * 3).map(|i| (i * 7 % 251) as u8).collect();
    jpeg_encoder::Encoder::new(&mut jpeg, 80).encode(&pixels, 48, 32, jpeg_encoder::ColorType::Rgb).unwrap();
    found.push(("jpg", jpeg));
    let array = Tensor { shape: vec![3, 2], data: vec![1.0, 2.0, 3.5, -4.0, 5.0, 1e9] };
    found.push(("npy", npy::encode(&array)));
    found.push(("safetensors", safetensors::encode([("a", &array)])));
    let rows = [["1", "2.5", "x"], ["3", "", "y"]].map(|row| row.map(str::to_owned).to_vec());
    found.push(("csv", table::encode(Some(&["wave length", "n", "name"]), &rows).unwrap()));
    let ball = shapes::icosphere(1.0, 1).unwrap();
    for ending in ["obj", "ply", "glb"] {
        found.extend(save::encode(&ball, ending).map(|bytes| (ending, bytes)));
    }
    let stl = "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 1 0\nvertex 1 1 0\nvertex 0 1 1\nendloop\nendfacet\nendsolid x\n";
    found.push(("stl", stl.as_bytes().to_vec()));
    let mut gltf = Builder::new();
    let mesh = gltf.triangle(serde_json::json!({}), serde_json::json!({}));
    gltf.add("nodes", serde_json::json!({ "mesh": mesh }));
    found.push(("gltf", gltf.text().into_bytes()));
    let mtl = "newmtl m\nKd 0.5 0.2 0.1\nKs 0.1 0.1 0.1\nNs 30\nillum 2\nd 0.5\nmap_Kd -s 2 2 1 -o 0.5 0 a.png\nKe 1 1 1\nPr 0.3\n";
    found.push(("mtl", mtl.as_bytes().to_vec()));
    found
}

/// Flips, drops, cuts or doubles bytes, or writes numbers that hurt.
fn damaged(bytes: &[u8], dice: &mut Dice) -> Vec<u8> {
    const NUMBERS: [&[u8]; 7] = [b"-1", b"4294967295", b"99999999999999999999", b"nan", b"1e39", b"0", b"inf"];
    let mut bytes = bytes.to_vec();
    for _ in 0..1 + dice.below(4) {
        let end = if dice.below(2) == 0 { bytes.len().min(400) } else { bytes.len() };
        let at = dice.below(end);
        match dice.below(7) {
            _ if bytes.is_empty() => {}
            0 => bytes.truncate(at),
            1 => drop(bytes.remove(at)),
            2 => bytes[at] ^= 1 << dice.below(8),
            3 => bytes[at] = [0, 0x7f, 0x80, 0xff][dice.below(4)],
            4 => bytes.iter_mut().skip(at).take(4).for_each(|b| *b = 0xff),
            5 => {
                let copy = bytes[at..(at + 1 + dice.below(40)).min(bytes.len())].to_vec();
                bytes.splice(at..at, copy);
            }
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
fn files() {
    let folder = tempfile::tempdir().unwrap();
    let whole = whole_files();
    for (ending, bytes) in &whole {
        assert!(properties::file(ending, bytes, folder.path()), "the whole .{ending} is refused");
    }
    assert!(properties::ENDINGS.iter().all(|ending| whole.iter().any(|(known, _)| known == ending)));
    let draw = |dice: &mut Dice| {
        let (ending, bytes) = &whole[dice.below(whole.len())];
        (*ending, damaged(bytes, dice))
    };
    let shown = |(ending, bytes): &(&str, Vec<u8>)| format!(".{ending}: {}", bytes.escape_ascii());
    fuzz("files", 2.0, draw, shown, |(ending, bytes)| _ = properties::file(ending, bytes, folder.path()));
}
