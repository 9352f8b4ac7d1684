//! Scripts with random damage that still check are run: whatever they do, they end in values or diagnostics.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use dscene::check::{self, hir};
use dscene::eval::{Engine, EngineOptions, on_large_stack};
use dscene::session::{Recorder, Runner};

use crate::dice::Dice;

const SCRIPTS: &[&str] = &[
    r#"camera eye { position: [0, 1, -4], look_at: [0, 0, 0], fov: 45deg, film: [8, 8] }
param p: vec3[3] = [[-1, -0.8, 0], [1, -0.9, 0], [0.1, 1, 0]]
param glow = 0.5 in 0..1 { lr: 2, scale: 0.5 }
shape panel { mesh: mesh(vertices: p, faces: [[0, 2, 1]]) |> scale(1.5) |> rotate(y: 20deg), material: diffuse(reflectance: glow) }
shape floor { mesh: rectangle(width: 4, depth: 4) |> translate([0, -1, 0]), material: conductor(roughness: 0.3, reflectance: [0.8, 0.6, 0.4]) }
light lamp = area(rectangle(width: 1, depth: 1) |> flip() |> translate([0, 3, 0]), radiance: 5)
light sky = constant(radiance: 0.2)
let target = render(eye, spp: 4) with { glow: 0.8, lamp.radiance: 4 }
loss fit = mse(render(eye, spp: 1, max_bounces: 2), target) + 0.1 * glow ^ 2
optimize fit { over: [p, glow], using: adam(lr: cosine(0.02, 0.001)), steps: 2, stop_when: loss < 0.0001, every 1 { print "{step:03} {glow:.3}" } }
optimize fit { over: [p, glow], using: levenberg_marquardt(damping: 0.01), steps: 2 }
expect fit >= 0
"#,
    r#"fn wave(x, n = 3) { let k = x * 2  sum([k ^ i / (i + 1) for i in 0..n if i != 2]) }
let xs = [0.1, 0.5, -1.5, 2]
let grid = [[i * j for i in 0..3] for j in 1..=3]
param a = 0.3
param r: rotation = rotation(axis: [0, 1, 0], angle: 30deg)
let angle = if a > 0.2 and not (a > 5) then 10deg else 0.25turn
loss l = (wave(a) - 1) ^ 2 + norm([sin(angle), cos(angle)]) + sum(abs(grid[1..3])) + max(xs) / len(xs)
print l, xs[-1], grid[0], grad(l, a), fd(l, a), jacobian(wave(a) * xs, a)
optimize l { using: sgd(lr: 0.01, momentum: 0.5), stage one { steps: 2 } stage two { steps: 1 } }
save xs |> sum() to "x.json"
"#,
    r#"camera eye { position: [0, 0, -3], look_at: [0, 0, 0], fov: 40deg, film: [8, 8], kind: orthographic, height: 3 }
let img = image([[[0.1, 0.2, 0.3], [0.9, 0.8, 0.7]], [[0, 0, 0], [1, 1, 1]]])
shape ball { mesh: sphere(subdivisions: 4) |> scale([1, 0.5, 1]), material: phong(diffuse: texture(img), specular: 0.3, roughness: 0.2) }
light sun = directional(direction: [1, -2, 1], irradiance: 3)
light lamp = spot(position: [1, 3, -2], direction: [-0.3, -1, 0.5], intensity: 8, cutoff: 35deg, beam: 12deg)
light env = environment(img, rotation: rotation(axis: [0, 1, 0], angle: 45deg))
param t = 0.2
let picture = render(eye, spp: 2)
print mean(picture), mean(depth(eye, spp: 1)), mean(alpha(eye, spp: 1)), blur(picture, sigma: 1) |> mean()
print estimate(mean(picture), 3), mean(jvp(picture * t, t))
"#,
];

/// Words, numbers and signs, with what lies between them.
fn tokens(text: &str) -> Vec<String> {
    let mut out: Vec<String> = Vec::new();
    let mut in_word = false;
    for c in text.chars() {
        let is_word = c.is_alphanumeric() || c == '_';
        match out.last_mut() {
            Some(last) if is_word && in_word => last.push(c),
            _ => out.push(c.to_string()),
        }
        in_word = is_word;
    }
    out
}

/// Replaces, swaps, drops or doubles a few tokens; mostly numbers, so that most scripts still check.
fn mutated(text: &str, dice: &mut Dice) -> String {
    const NUMBERS: &[&str] =
        &["0", "-1", "1e30", "0.5", "-0.0", "1e-30", "3", "0 / 0", "1 / 0", "7", "-100", "[1, 2, 3]", "[]"];
    let mut tokens = tokens(text);
    for _ in 0..1 + dice.below(3) {
        let is_number = |t: &String| t.starts_with(|c: char| c.is_ascii_digit());
        let numbers: Vec<usize> = (0..tokens.len()).filter(|&i| is_number(&tokens[i])).collect();
        let at = dice.below(tokens.len());
        match dice.below(8) {
            0..=4 => tokens[numbers[dice.below(numbers.len())]] = NUMBERS[dice.below(NUMBERS.len())].to_owned(),
            5 => {
                let other = dice.below(tokens.len());
                tokens.swap(at, other);
            }
            6 => drop(tokens.remove(at)),
            _ => tokens.insert(at, tokens[at].clone()),
        }
    }
    tokens.concat()
}

fn run(text: &str, flag: &Arc<AtomicBool>) -> bool {
    let checked = check::check_text("mutant.dscene", None, text, &[], &check::Disk);
    let Some(program) = checked.program else {
        return false;
    };
    let folder = tempfile::tempdir().unwrap();
    let actions: Vec<hir::Action> = program.actions.clone();
    let options = EngineOptions { seed: 1, base_dir: folder.path().to_path_buf(), interrupt: Some(flag.clone()) };
    let mut engine = Engine::new(program, options);
    let mut world = Recorder { stop_after: Some(4), ..Recorder::default() };
    let mut runner = Runner::new(&mut engine, &mut world);
    runner.outputs = folder.path().to_path_buf();
    for action in actions {
        if let Err(diagnostic) = runner.run(&[action]) {
            assert_ne!(diagnostic.code, "dscene::internal", "{}\n{text}", diagnostic.message);
            assert!(!diagnostic.message.is_empty());
        }
    }
    true
}

#[test]
fn damaged_scripts_end_in_values_or_diagnostics() {
    const MUTANTS: usize = 300;
    let started = Instant::now();
    let (mut ran, mut dice) = (0, Dice(0x77_1234_abcd));
    for number in 0..MUTANTS {
        let text = mutated(SCRIPTS[number % SCRIPTS.len()], &mut dice);
        let flag = Arc::new(AtomicBool::new(false));
        let done = Arc::new(AtomicBool::new(false));
        let watchdog = {
            let (flag, done, hanging) = (flag.clone(), done.clone(), text.clone());
            std::thread::spawn(move || {
                let begun = Instant::now();
                while !done.load(Ordering::Relaxed) {
                    std::thread::sleep(Duration::from_millis(5));
                    if begun.elapsed() > Duration::from_millis(500) {
                        flag.store(true, Ordering::Relaxed);
                    }
                    if begun.elapsed() > Duration::from_secs(60) {
                        eprintln!("a mutant hangs:\n{hanging}");
                        std::process::abort();
                    }
                }
            })
        };
        let begun = Instant::now();
        let outcome = std::panic::catch_unwind(|| on_large_stack(|| run(&text, &flag)));
        done.store(true, Ordering::Relaxed);
        watchdog.join().unwrap();
        match outcome {
            Ok(has_run) => ran += usize::from(has_run),
            Err(_) => panic!("mutant {number} panicked:\n{text}"),
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "mutant {number} took {:?}:\n{text}", begun.elapsed());
    }
    println!("{ran} of {MUTANTS} mutants ran, in {:?}", started.elapsed());
    assert!(ran > MUTANTS / 5, "only {ran} mutants could be run: the mutations are too rough to test anything");
}

#[test]
fn the_undamaged_scripts_run() {
    let flag = Arc::new(AtomicBool::new(false));
    for text in SCRIPTS {
        let checked = check::check_text("whole.dscene", None, *text, &[], &check::Disk);
        let errors: Vec<&str> = checked.diagnostics.iter().filter(|d| d.is_error()).map(|d| &*d.message).collect();
        assert!(errors.is_empty(), "{errors:?}\n{text}");
        assert!(on_large_stack(|| run(text, &flag)));
    }
}
