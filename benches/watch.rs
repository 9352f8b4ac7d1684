//! How long `dsl watch` takes from a save to the picture of the edit: the blocker of example 03, 128² pixels, 16 samples each.
//!
//! `cargo bench --bench watch` prints seconds from the end of the save to the first picture that a page is told of, and to the whole one,
//! by what the edit changes: the median and the worst of some edits.

use std::time::Instant;

#[path = "../tests/common/live.rs"]
mod live;
#[path = "../tests/common/place.rs"]
mod place;

use live::Server;
use place::Place;

const EDITS: usize = 15;

fn main() {
    // One blank between words, however the example is laid out; comments and strings have no others.
    let example = include_str!("../examples/03_shadow_blocker.dscene");
    let words = |line: &str| line.split_whitespace().collect::<Vec<&str>>().join(" ");
    let example = example.lines().map(words).collect::<Vec<String>>().join("\n").replace("[256, 256]", "[128, 128]");
    let place = Place::new();
    place.write("blocker.dscene", &example);
    let server = Server::start(&place, &["watch", "blocker.dscene", "--spp", "16"]);
    let mut events = server.events();
    events.until("picture", |p| p["spp"] == 16);
    events.phase("ready");
    println!("{:12} {:>25} {:>25}", "edit of", "first picture, s", "16 samples a pixel, s");
    for (what, before, after) in [
        ("a light", "radiance: 1000", "radiance: N00"),
        ("a material", "reflectance: 0.5", "reflectance: 0.N"),
        ("a mesh", "width: 4", "width: N"),
        ("the camera", "fov: 45deg", "fov: 4Ndeg"),
        ("a comment", "/// Recovers", "/// N Recovers"),
    ] {
        let (mut first, mut whole) = (Vec::new(), Vec::new());
        for i in 0..EDITS {
            assert!(example.contains(before), "{before}");
            let digit = (1 + i % 9).to_string();
            place.write("blocker.dscene", example.replace(before, &after.replace('N', &digit)));
            let saved = Instant::now();
            events.until("picture", |_| true);
            first.push(saved.elapsed().as_secs_f64());
            events.until("picture", |p| p["spp"] == 16);
            whole.push(saved.elapsed().as_secs_f64());
            events.phase("ready");
        }
        let told = |mut seconds: Vec<f64>| {
            seconds.sort_by(f64::total_cmp);
            format!("{:.3}, at most {:.3}", seconds[EDITS / 2], seconds[EDITS - 1])
        };
        println!("{what:12} {:>25} {:>25}", told(first), told(whole));
    }
}
