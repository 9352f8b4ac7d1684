//! Fits transformed cosines to the GGX lobe and tells how close they come.
//!
//! ```text
//! cargo bench --bench ltc                  how far the lobe is from the committed table, at and between its nodes
//! cargo bench --bench ltc -- --write       fits it again: engine/src/render/ltc_table.rs
//! ```

mod fit;

use std::path::PathBuf;

use dscene::render::ltc::{LEAST_ALPHA, Lobe, Node, SIZE};
use fit::Samples;
use glam::Vec3;

fn main() -> std::io::Result<()> {
    if std::env::args().any(|a| a == "--write") {
        let path: PathBuf = [env!("CARGO_MANIFEST_DIR"), "engine", "src", "render", "ltc_table.rs"].iter().collect();
        std::fs::write(path, text(&fit::table()))?;
        println!("written; build again and see how close it comes");
        return Ok(());
    }
    println!("½ ∫ |lobe − fit|, by α (down) and angle of incidence (across)");
    let angles: Vec<f32> = (0..9).map(|i| 10.0 * i as f32).collect();
    println!("{:>8}  {}", "", angles.iter().map(|a| format!("{a:6}°")).collect::<String>());
    for i in 0..=2 * (SIZE - 1) {
        let alpha = LEAST_ALPHA.powf(i as f32 / (2 * (SIZE - 1)) as f32);
        let distance = |angle: &f32| {
            let samples = Samples::new(angle.to_radians().cos(), alpha);
            format!("{:7.3}", samples.distance(&Lobe::new(alpha, Vec3::Z, samples.wi)))
        };
        println!("{alpha:8.4}  {}", angles.iter().map(distance).collect::<String>());
    }
    Ok(())
}

fn text(table: &[Node]) -> String {
    let mut text = String::from(
        "//! Written by `cargo bench --bench ltc -- --write`: transformed cosines fitted to the GGX lobe.\n\n\
         /// By angle of incidence, then by α.\n\
         #[rustfmt::skip]\n\
         pub static TABLE: [[f32; 5]; ",
    );
    text += &format!("{}] = [\n", table.len());
    for node in table {
        text += &format!("    [{}],\n", node.map(|x| format!("{x:.5e}")).join(", "));
    }
    text + "];\n"
}
