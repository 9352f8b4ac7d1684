//! Runs in several processes: they leave what a run in one leaves, to the byte, whatever becomes of the processes.

#[path = "../../tests/common/left_behind.rs"]
mod left_behind;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use left_behind::{assert_same, left_behind};
use tempfile::TempDir;

const DSL: &str = env!("CARGO_BIN_EXE_dsl-mpi");

/// A pose that is found from a picture: images, gradients with edges, adaptive steps, plots and saves.
const POSE: &str = r#"
camera eye { position: [0, 2, -4], look_at: [0, 0.3, 0], fov: 45deg, film: [48, 37] }
param place: vec2 = [0.2, 0.1]
param glow = 0.5 in 0..1
shape floor { mesh: rectangle(width: 6, depth: 6), material: diffuse(reflectance: [0.6, glow, 0.4]) }
shape block {
  mesh: cube(size: [0.8, 0.6, 0.7]) |> translate([place.x, 0.5, place.y])
  material: plastic(diffuse: [0.7, 0.2, 0.2])
}
light lamp = point(position: [1, 3, -1], intensity: 20)
light sky = constant(radiance: 0.3)
let target = render(eye, spp: 32) with { place: [-0.1, 0.3], glow: 0.8 }
loss fit = mse(render(eye, spp: 4, max_bounces: 2), target)
optimize fit { using: adam(lr: 0.02), steps: 12, every 5 { save render(eye, spp: 2) to "frames/{step}.exr" } }
plot fit to "fit.svg"
save { place, glow } to "found.json"
save render(eye, spp: 8) to "end.exr"
"#;

/// Least squares: derivatives of all pixels along all unknowns, exactly and, beyond some hundreds of them, as a matrix.
const PIXELS: &str = r#"
camera eye { position: [0, 3, 0], look_at: [0, 0, 0], up: [0, 0, 1], fov: 50deg, film: [40, 40] }
param turn: rotation = rotation(axis: [0.2, 1, 0.1], angle: 5deg)
param paint = [[0.4 for x in 0..24] for y in 0..24] in 0..1
shape floor {
  mesh: rectangle(width: 2, depth: 2) |> rotate(by: turn)
  material: diffuse(reflectance: texture(paint))
}
light sun = directional(direction: [0.3, -1, 0.2], irradiance: 2)
light sky = constant(radiance: 0.2)
let target = render(eye, spp: 16) with { turn: rotation(angle: 0deg), paint: [[0.6 for x in 0..24] for y in 0..24] }
loss fit = mse(render(eye, spp: 2, max_bounces: 1), target)
optimize fit { using: levenberg_marquardt(), over: [turn], steps: 4 }
optimize fit { using: levenberg_marquardt(), steps: 3 }
save turn to "turn.json"
save paint to "paint.npy"
"#;

/// What learns from step to step: guides, control variates, a shadow by a moving edge, several starts.
const LEARNING: &str = r#"
camera eye { position: [0, 4, -0.5], look_at: [0, 0, 0], fov: 40deg, film: [32, 32] }
param corner: vec3 = [0.2, 1, 0.1] in -1..2
shape floor { mesh: rectangle(width: 4, depth: 4), material: conductor(reflectance: 0.8, roughness: 0.3) }
shape blade { mesh: triangle([-0.5, 1, -0.4], [0.6, 1, -0.5], corner), material: diffuse(reflectance: 0.3) }
light lamp = area(rectangle(width: 1, depth: 1) |> flip() |> translate([0, 3, 0]), radiance: 12)
let target = render(eye, spp: 32) with { corner: [0, 1, 0.5] }
loss fit = mse(render(eye, spp: 4, max_bounces: 2), target)
optimize fit { using: adam(lr: 0.05), steps: 8, control_variates: true, starts: 2 }
save corner to "corner.json"
"#;

struct Place(TempDir);

impl Place {
    fn new() -> Place {
        Place(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        fs::write(self.path(name), text).unwrap();
    }

    /// The program alone.
    fn alone(&self, arguments: &[&str]) -> Output {
        Command::new(DSL).args(arguments).current_dir(self.0.path()).output().unwrap()
    }

    /// The program in several processes.
    fn command(&self, processes: usize, arguments: &[&str]) -> Command {
        let mut command = mpirun();
        command.args(["-n", &processes.to_string(), DSL]).args(arguments).current_dir(self.0.path());
        command
    }

    fn together(&self, processes: usize, arguments: &[&str]) -> Output {
        self.command(processes, arguments).output().unwrap()
    }
}

/// More processes than there are processors, and, in containers, root, have to be asked for.
fn mpirun() -> Command {
    let mut command = Command::new("mpirun");
    command.arg("--oversubscribe");
    command.env("OMPI_ALLOW_RUN_AS_ROOT", "1").env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1").env("NO_COLOR", "1");
    // Where a process fails, all have come to their ends: nothing need be waited for.
    command.env("OMPI_MCA_odls_base_sigkill_timeout", "0");
    command
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[track_caller]
fn assert_code(output: &Output, code: i32) {
    let told = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(code), "stdout:\n{}\nstderr:\n{}", told.0, told.1);
}

#[test]
fn any_number_of_processes_leaves_the_same_bytes() {
    for (name, script) in [("pose", POSE), ("pixels", PIXELS), ("learning", LEARNING)] {
        let place = Place::new();
        place.write("a.dscene", script);
        assert_code(
            &place.alone(&["run", "a.dscene", "--out", "alone", "--seed", "3", "--threads", "1", "--quiet"]),
            0,
        );
        let expected = left_behind(&place.path("alone"));
        assert!(expected.len() > 2, "{name}: {:?}", expected.keys());
        for (processes, threads) in [(2, "1"), (3, "2")] {
            let run = format!("run-{processes}");
            let output = place.together(
                processes,
                &["run", "a.dscene", "--out", &run, "--seed", "3", "--threads", threads, "--quiet"],
            );
            assert_code(&output, 0);
            assert_same(&left_behind(&place.path(&run)), &expected, &format!("{name} in {processes} processes"));
        }
    }
}

/// The examples of the repository, with small pictures and for a step or two: a gradient with edges, a matrix that is too large to be solved, glass. What each expects
/// of its last step does not hold yet, alone or together.
#[test]
fn examples_leave_the_same_bytes() {
    for example in ["03_shadow_blocker", "19_relief_from_shading", "24_pool"] {
        let place = Place::new();
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../examples/{example}.dscene"));
        let run = |processes: usize, threads: &str| {
            let out = format!("run-{processes}-{threads}");
            let file = file.to_str().unwrap();
            let small = ["--steps", "2", "--set", "eye.film=[40, 40]"];
            let arguments = [&["run", file, "--out", &out, "--threads", threads, "--quiet"][..], &small].concat();
            let output = if processes > 1 { place.together(processes, &arguments) } else { place.alone(&arguments) };
            (output.status.code(), left_behind(&place.path(&out)))
        };
        let (code, expected) = run(1, "1");
        assert!(expected.len() > 2 && code.is_some_and(|code| code < 2), "{example}: {code:?} {:?}", expected.keys());
        for (processes, threads) in [(1, "2"), (3, "1")] {
            let (also, found) = run(processes, threads);
            assert_eq!(also, code, "{example} in {processes} processes");
            assert_same(&found, &expected, &format!("{example} in {processes} processes, {threads} threads"));
        }
    }
}

/// The process of this rank that was started in this folder.
fn process_of(rank: usize, folder: &Path) -> Option<u32> {
    let wanted = format!("OMPI_COMM_WORLD_RANK={rank}");
    let folder = folder.canonicalize().unwrap();
    let is_it = |process: &Path| {
        let environment = fs::read(process.join("environ")).unwrap_or_default();
        fs::read_link(process.join("cwd")).is_ok_and(|cwd| cwd == folder)
            && environment.split(|byte| *byte == 0).any(|variable| variable == wanted.as_bytes())
    };
    let processes = fs::read_dir("/proc").unwrap().map(|entry| entry.unwrap().path());
    let number = |path: &PathBuf| path.file_name()?.to_str()?.parse::<u32>().ok();
    processes.filter(|path| number(path).is_some() && is_it(path)).find_map(|path| number(&path))
}

/// Waits until the log of a run has so many lines.
fn wait_for_lines(place: &Place, run: &str, lines: usize) {
    let begun = Instant::now();
    let log = place.path(run).join("log.jsonl");
    while fs::read_to_string(&log).map_or(0, |text| text.lines().count()) < lines {
        assert!(begun.elapsed() < Duration::from_secs(60), "it takes too long");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn send(signal: &str, process: u32) {
    assert!(Command::new("kill").args([signal, &process.to_string()]).status().unwrap().success());
}

#[test]
fn a_run_that_loses_a_process_goes_on_with_another_number_of_them() {
    let place = Place::new();
    place.write("a.dscene", &POSE.replace("steps: 12", "steps: 100"));
    assert_code(&place.alone(&["run", "a.dscene", "--out", "alone", "--threads", "2", "--quiet"]), 0);
    let expected = left_behind(&place.path("alone"));
    // One that is killed, the first or another, and all that are asked to end: by what scheduler or user does, a signal to mpirun.
    for (number, (lost, signal)) in
        [(Some(2), "-KILL"), (Some(0), "-KILL"), (Some(1), "-TERM"), (None, "-TERM")].into_iter().enumerate()
    {
        let run = format!("run-{number}");
        let mut command = place.command(3, &["run", "a.dscene", "--out", &run, "--threads", "1"]);
        // Processes that are asked to end are killed after two seconds, not after one: disks of machines that are busy are slow. (`mpirun` waits
        // as long before it asks.)
        command.env("OMPI_MCA_odls_base_sigkill_timeout", "2");
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        wait_for_lines(&place, &run, 10);
        let written = || fs::metadata(place.path(&run).join("checkpoint.bin")).unwrap().modified().unwrap();
        let before = written();
        match lost {
            Some(rank) => send(signal, process_of(rank, place.0.path()).expect("the process of the rank")),
            None => send(signal, child.id()),
        }
        // Nothing is left of it.
        let begun = Instant::now();
        while (0..3).any(|rank| process_of(rank, place.0.path()).is_some()) {
            assert!(begun.elapsed() < Duration::from_secs(20), "processes are left");
            std::thread::sleep(Duration::from_millis(20));
        }
        // Now and then `mpirun` does not notice that all its processes have ended, and waits for them.
        while child.try_wait().unwrap().is_none() && begun.elapsed() < Duration::from_secs(30) {
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = child.kill();
        assert!(!child.wait().unwrap().success());
        // The first process, where it lives, writes a checkpoint at the end; the next one by time would be due after half a minute.
        assert_eq!(written() > before, lost != Some(0), "the checkpoint at the end: {lost:?} {signal}");
        let steps = fs::read_to_string(place.path(&run).join("log.jsonl")).unwrap().lines().count();
        assert!((10..100).contains(&steps), "{steps} steps");
        let resume = ["run", "a.dscene", "--resume", &run, "--threads", "1", "--quiet"];
        let output = if number % 2 == 0 { place.together(2, &resume) } else { place.alone(&resume) };
        assert_code(&output, 0);
        assert_same(&left_behind(&place.path(&run)), &expected, &format!("{lost:?} {signal}"));
    }
}

#[test]
fn one_process_speaks_for_all() {
    let place = Place::new();
    place.write("a.dscene", "param x = 2\nloss l = x ^ 2\nprint \"x is {x}\"\nexpect l < 1\nsave x to \"x.json\"");
    let output = place.together(3, &["run", "a.dscene", "--out", "run"]);
    assert_code(&output, 1);
    assert_eq!(text(&output.stdout), "x is 2\n");
    assert_eq!(text(&output.stderr).matches("dscene::run::expect").count(), 1, "{}", text(&output.stderr));
    assert!(place.path("run/x.json").is_file());
    // Values and gradients, as one object each.
    let output = place.together(2, &["eval", "a.dscene", "x + 1", "--json"]);
    assert_code(&output, 0);
    assert_eq!(text(&output.stdout).matches("\"value\":3").count(), 1, "{}", text(&output.stdout));
    // What renders nothing is done once.
    let output = place.together(3, &["check", "a.dscene"]);
    assert_code(&output, 0);
    // A mistake is told once.
    place.write("b.dscene", "print y");
    let output = place.together(3, &["run", "b.dscene"]);
    assert_code(&output, 1);
    assert_eq!(text(&output.stderr).matches("is not declared").count(), 1, "{}", text(&output.stderr));
    for (refused, help) in [
        (&["repl"][..], "without `mpirun`"),
        (&["watch", "a.dscene"], "without `mpirun`"),
        (&["run", "a.dscene", "--live"], "without `mpirun`"),
        (&["grad", "a.dscene", "--serve"], "without `mpirun`"),
        (&["sweep", "a.dscene", "--seeds", "2"], "--shard I/N"),
    ] {
        let output = place.together(2, refused);
        assert_code(&output, 1);
        let told = text(&output.stderr);
        assert!(told.matches("dscene::cli::processes").count() == 1 && told.contains(help), "{refused:?}: {told}");
    }
    // What is said before anything is done leaves MPI in order too.
    for (arguments, code) in [(&["--version"][..], 0), (&["run", "--help"], 0), (&["run"], 2)] {
        let output = place.together(2, arguments);
        assert_code(&output, code);
        assert!(!text(&output.stderr).contains("improperly"), "{}", text(&output.stderr));
    }
    let version = text(&place.together(2, &["--version"]).stdout);
    assert_eq!(version.matches("any number, by MPI").count(), 1, "{version}");
    // Without mpirun it is `dsl`.
    let output = place.alone(&["eval", "a.dscene", "x + 1"]);
    assert_code(&output, 0);
    assert_eq!(text(&output.stdout).trim(), "3");
}

#[test]
fn files_may_be_where_the_first_process_is_only() {
    let place = Place::new();
    let script = "import \"tools.dscene\" as tools\nlet table = load_json(\"table.json\")\n\
                  camera eye { position: [0, 0, -3], look_at: [0, 0, 0], film: [9, 7] }\n\
                  shape wall { mesh: tools.wall(table.size) }\nlight sky = constant(radiance: 1)\n\
                  save mean(render(eye, spp: 2)) to \"mean.json\"";
    fs::create_dir(place.path("full")).unwrap();
    fs::create_dir(place.path("empty")).unwrap();
    place.write("full/a.dscene", script);
    place.write("full/tools.dscene", "fn wall(size) = rectangle(width: size, depth: size) |> rotate(x: 90deg)");
    place.write("full/table.json", "{\"size\": 2}");
    let run = |more: &[&str]| {
        let mut command = mpirun();
        let arguments = [&["run", "a.dscene", "--out", "run", "--force"], more].concat();
        command.args(["-n", "1", "--wdir"]).arg(place.path("full")).arg(DSL).args(&arguments);
        command.args([":", "-n", "1", "--wdir"]).arg(place.path("empty")).arg(DSL).args(&arguments);
        command.output().unwrap()
    };
    let missing = run(&[]);
    assert!(!missing.status.success());
    let told = text(&missing.stderr);
    assert!(told.contains("process 2 of 2") && told.contains("a.dscene"), "{told}");
    let output = run(&["--broadcast"]);
    assert_code(&output, 0);
    assert!(place.path("full/run/mean.json").is_file());
    assert_eq!(fs::read_dir(place.path("empty")).unwrap().count(), 0, "only the first process writes");
}

#[test]
fn what_messages_cost_is_told() {
    let place = Place::new();
    place.write("a.dscene", POSE);
    let output = place.together(2, &["run", "a.dscene", "--out", "run", "--timings", "--steps", "2"]);
    assert_code(&output, 0);
    let told = text(&output.stderr);
    assert!(told.contains(" exchanges between 2 processes brought this one "), "{told}");
}
