//! The command line from outside.
#![allow(dead_code)]

use std::fs;
use std::path::PathBuf;
use std::process::{Child, Output, Stdio};
use std::time::{Duration, Instant};

use assert_cmd::Command;
use tempfile::TempDir;

/// A small world: a lit triangle whose vertices and brightness are unknown.
pub const TRIANGLE: &str = r#"
camera eye { position: [0, 0, -4], look_at: [0, 0, 0], fov: 45deg, film: [16, 16] }
param corners: vec3[3] = [[-1, -0.8, 0], [1, -0.9, 0], [0.1, 1, 0]]
param glow = 0.5 in 0..1
shape panel { mesh: mesh(vertices: corners, faces: [[0, 2, 1]]), material: diffuse(reflectance: glow) }
light sky = constant(radiance: 1)
let target = render(eye, spp: 16) with { glow: 0.8 }
loss fit = mse(render(eye, spp: 2), target)
"#;

/// Loss and params without a renderer.
pub const BOWL: &str = r#"
param x = 3
param y: vec2 = [1, -1]
loss bowl = (x - 1) ^ 2 + (y.x - 2) ^ 2 + (y.y + 3) ^ 2
optimize bowl { using: sgd(lr: 0.2), steps: 60 }
expect bowl < 1e-6
print "x is {x:.3}"
"#;

/// Sends a signal; whether the process was there to take it.
pub fn send(child: &Child, signal: &str) -> bool {
    std::process::Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap().success()
}

/// How long a process may take that has next to nothing to do, on a machine that is slow and busy.
const PATIENCE: Duration = Duration::from_secs(120);

/// What a process leaves that is about to end, and prints little. One that does not end is killed, and fails the test.
#[track_caller]
pub fn ended(mut child: Child) -> Output {
    let begun = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if begun.elapsed() > PATIENCE {
            let _ = child.kill();
            panic!("it does not end");
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    child.wait_with_output().unwrap()
}

/// A folder of its own, in which the command line is run.
pub struct Place {
    pub folder: TempDir,
}

impl Place {
    pub fn new() -> Place {
        Place { folder: tempfile::tempdir().unwrap() }
    }

    pub fn write(&self, name: &str, text: impl AsRef<[u8]>) -> PathBuf {
        let path = self.folder.path().join(name);
        fs::write(&path, text).unwrap();
        path
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// What a script prints that is run in the folder `run`, whether that is there or not.
    #[track_caller]
    pub fn run(&self, script: &str) -> String {
        self.write("script.dscene", script);
        let output = self.dsl(&["run", "script.dscene", "--out", "run", "--force"]);
        assert_code(&output, 0);
        stdout(&output)
    }

    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(assert_cmd::cargo::cargo_bin!("dsl"));
        command.args(arguments).current_dir(self.folder.path()).env("NO_COLOR", "1").timeout(PATIENCE);
        command
    }

    /// What the program leaves that may not write more than some kilobytes into a file, as on a disk that is full.
    pub fn with_little_room(&self, arguments: &str) -> Output {
        let dsl = assert_cmd::cargo::cargo_bin!("dsl");
        let limited = format!("trap '' XFSZ; ulimit -f 20; exec '{}' {arguments}", dsl.display());
        let mut shell = std::process::Command::new("sh");
        shell.args(["-c", &limited]).current_dir(self.folder.path()).env("NO_COLOR", "1").output().unwrap()
    }

    /// Starts the program and does not wait for it.
    pub fn start(&self, arguments: &[&str]) -> Child {
        std::process::Command::new(assert_cmd::cargo::cargo_bin!("dsl"))
            .args(arguments)
            .current_dir(self.folder.path())
            .env("NO_COLOR", "1")
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    }

    pub fn dsl(&self, arguments: &[&str]) -> Output {
        self.command(arguments).output().unwrap()
    }
}

pub fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[track_caller]
pub fn assert_code(output: &Output, code: i32) {
    assert_eq!(output.status.code(), Some(code), "stdout:\n{}\nstderr:\n{}", stdout(output), stderr(output));
}

/// The script ended with a diagnostic: exit 1, and not because something broke.
#[track_caller]
pub fn assert_diagnosed(output: &Output) {
    assert_code(output, 1);
    let text = stderr(output);
    assert!(text.contains("dscene::") && !text.contains("dscene::internal") && !text.contains("panicked"), "{text}");
}

/// A PNG's width, and its colours at eight bits.
pub fn png_colors(bytes: &[u8]) -> (u32, Vec<[u8; 3]>) {
    let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().expect("a PNG");
    let mut data = vec![0; reader.output_buffer_size().expect("a small picture")];
    let frame = reader.next_frame(&mut data).expect("a whole picture");
    let channels = frame.color_type.samples();
    let pixels = data[..frame.buffer_size()].chunks_exact(channels);
    (frame.width, pixels.map(|p| if channels < 3 { [p[0]; 3] } else { [p[0], p[1], p[2]] }).collect())
}
