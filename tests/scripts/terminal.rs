//! Commands in a terminal: how far long work has come, and what a person sees who types into the REPL, completes, looks at images and comes back
//! the next day.
#![cfg(unix)]

use std::fs::File;
use std::io::{Read, Write};
use std::process::{Child, Command};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Winsize, tcsetwinsize};

use crate::place::{Place, TRIANGLE};

/// No wait is as long as this, unless something is wrong.
const PATIENCE: Duration = Duration::from_secs(120);

/// A session in a terminal of 100 columns.
struct Session {
    child: Child,
    keys: File,
    seen: Arc<Mutex<Vec<u8>>>,
    /// What was waited for already.
    read: usize,
}

impl Session {
    /// `dsl repl`, as far as its first line.
    fn start(place: &Place, arguments: &[&str], images: &str) -> Session {
        let mut session = Session::of(place, &[&["repl", "--threads", "2"], arguments].concat(), images);
        session.until("dsl> ");
        session
    }

    /// Any command.
    fn of(place: &Place, arguments: &[&str], images: &str) -> Session {
        let terminal = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&terminal).unwrap();
        unlockpt(&terminal).unwrap();
        let name = ptsname(&terminal, Vec::new()).unwrap();
        tcsetwinsize(&terminal, Winsize { ws_row: 40, ws_col: 100, ws_xpixel: 0, ws_ypixel: 0 }).unwrap();
        let side = File::options().read(true).write(true).open(name.to_str().unwrap()).unwrap();
        let child = Command::new(assert_cmd::cargo::cargo_bin!("dsl"))
            .args(arguments)
            .current_dir(place.path(""))
            .env("XDG_DATA_HOME", place.path("data"))
            .env("HOME", place.path(""))
            .env("TERM", "xterm-256color")
            .env("DSCENE_IMAGES", images)
            .env_remove("NO_COLOR")
            .stdin(side.try_clone().unwrap())
            .stdout(side.try_clone().unwrap())
            .stderr(side)
            .spawn()
            .unwrap();
        let keys = File::from(terminal);
        let mut screen = keys.try_clone().unwrap();
        let seen = Arc::new(Mutex::new(Vec::new()));
        let all = seen.clone();
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            // At its end a terminal has an error.
            while let Ok(count @ 1..) = screen.read(&mut bytes) {
                all.lock().unwrap().extend_from_slice(&bytes[..count]);
            }
        });
        Session { child, keys, seen, read: 0 }
    }

    fn press(&mut self, keys: &str) {
        self.keys.write_all(keys.as_bytes()).unwrap();
    }

    /// What comes until a text does, that included.
    #[track_caller]
    fn until(&mut self, wanted: &str) -> String {
        let begun = Instant::now();
        loop {
            let new = String::from_utf8_lossy(&self.seen.lock().unwrap()[self.read..]).into_owned();
            if let Some(at) = new.find(wanted) {
                let text = &new[..at + wanted.len()];
                self.read += text.len();
                return text.to_owned();
            }
            assert!(begun.elapsed() < PATIENCE, "no {wanted:?} in {new:?}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Types a line; what is seen until the answer is complete.
    #[track_caller]
    fn enter(&mut self, line: &str) -> String {
        self.press(&format!("{line}\r"));
        // Where the next line is read, pastes are told from keys again.
        let mut text = self.until("\x1b[?2004l");
        text += &self.until("\x1b[?2004h");
        text
    }

    fn end(mut self) {
        self.press("\x04");
        assert!(self.child.wait().unwrap().success());
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A text without colours and other sequences for the terminal.
fn plain(text: &str) -> String {
    let mut out = String::new();
    let mut chars = text.chars();
    while let Some(c) = chars.next() {
        if c != '\x1b' {
            out.push(c);
        } else if chars.next() == Some('[') {
            let _ = chars.find(|c| c.is_ascii_alphabetic());
        }
    }
    out
}

/// Work for minutes, which is ended when enough was seen of it.
#[test]
fn long_work_shows_how_far_it_has_come() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE.replace("[16, 16]", "[256, 256]").replace("spp: 16", "spp: 40000"));
    let mut rendered = Session::of(&place, &["eval", "t.dscene", "fit", "--threads", "1"], "blocks");
    rendered.until("rendering");
    rendered.until(" %");
    rendered.until(" left");
    drop(rendered);
    let all = "mean(render(eye, spp: 1000) with { eye.film: [64, 64] })";
    let mut derived = Session::of(&place, &["grad", "t.dscene", "--of", all, "--threads", "1"], "blocks");
    derived.until("derivatives");
    derived.until(" %");
    drop(derived);
    // Nobody looks at what is quiet.
    let arguments = ["eval", "t.dscene", "mean(render(eye, spp: 150))", "--quiet"];
    let mut quiet = Session::of(&place, &arguments, "blocks");
    assert!(quiet.child.wait().unwrap().success());
    let seen = String::from_utf8_lossy(&quiet.seen.lock().unwrap()).into_owned();
    assert!(!seen.contains("rendering"), "{seen:?}");
}

#[test]
fn a_terminal_completes_highlights_draws_and_remembers() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    let mut session = Session::start(&place, &["t.dscene"], "blocks");
    // The only name that begins so is written out, words have the colours of what they are, and the value has a name.
    session.press("2 * glo\t");
    let answer = session.until("glow") + &session.enter("");
    assert!(answer.contains("\x1b[33m2\x1b[0m * \x1b[1mglow\x1b[0m"), "{answer:?}");
    assert!(plain(&answer).contains("1   : scalar   _1"), "{answer:?}");
    // What may be written is listed, with what it is.
    session.press("render(\t\t");
    let list = session.until("max_bounces");
    assert!(!list.contains("\x07\x07\x07"), "{list:?}");
    session.until("spp");
    session.press("\x03");
    // After Ctrl-C what was typed is dropped, up to the next line.
    session.until("\x1b[?2004h");
    session.until("dsl> ");
    session.press(":und\t\r");
    session.until("there is nothing to undo");
    // An entry goes on while a bracket is open.
    session.press("let a = [1,\r");
    session.until("1");
    assert!(plain(&session.enter("2]")).contains("a : vec2"));
    // Images, and the sign of derivatives.
    let picture = session.enter("render(eye, spp: 4)");
    assert_eq!(picture.matches('▀').count(), 16 * 8, "{picture:?}");
    assert!(plain(&picture).contains("image 16×16, 3 channels"), "{picture:?}");
    let change = session.enter("jvp(render(eye, spp: 4), glow)");
    assert!(change.contains("▀") && change.contains("white 0 … red"), "{change:?}");
    session.end();

    // The next day: the last line is there, and another kind of terminal gets the picture as a file.
    let mut session = Session::start(&place, &["t.dscene"], "kitty");
    session.press("\x1b[A");
    session.until("jvp");
    let change = session.enter("");
    assert!(change.contains("\x1b_Ga=T,f=100,q=2,m="), "{change:?}");
    session.end();
}

/// Lines that are typed, or pasted into a terminal that does not mark pastes, while an earlier one is computed.
#[test]
fn what_is_typed_ahead_is_kept() {
    let place = Place::new();
    place.write("t.dscene", TRIANGLE);
    let mut session = Session::start(&place, &["t.dscene"], "blocks");
    session.press("mean(render(eye, spp: 400))\r1 + 1\rlet a = [1,\r2]\ra.y + 5\r");
    let text = plain(&session.until("_3"));
    assert!(text.contains("2   : scalar   _2") && text.contains("7   : scalar   _3"), "{text}");
    session.end();
}

/// The bar of a sweep stays above its table, as it was at the end.
#[test]
fn the_bar_of_a_sweep_ends_full() {
    let place = Place::new();
    place.write("a.dscene", "param x = 1\noptimize x ^ 2 { using: sgd(lr: rate), steps: 3 }\nlet rate = 0.1\n");
    let arguments = ["sweep", "a.dscene", "--set", "rate=0.1,0.2,0.3", "--out", "r", "--threads", "1"];
    let mut session = Session::of(&place, &arguments, "blocks");
    let seen = plain(&session.until("seeds"));
    let last = seen.rsplit("sweep ").next().unwrap();
    assert!(last.contains("3/3") && !last.contains("running"), "{seen:?}");
    assert!(session.child.wait().unwrap().success());
}
