//! The table, for the terminal and as a page.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use crate::measure::{FORWARD, Forward, Reference, Row};
use crate::scenes::Kind;

pub const HEADER: &str = "scene / parameter                                              value    reference      z    error  \
                          rel. std   CPU s  primal  1/(var·CPU s)";

fn or_dash(x: Option<f64>, show: impl Fn(f64) -> String) -> String {
    x.filter(|x| x.is_finite()).map_or("–".into(), show)
}

fn percent(x: f64) -> String {
    if x < 0.1 { format!("{:.2} %", 100.0 * x) } else { format!("{:.0} %", 100.0 * x) }
}

pub fn line(row: &Row) -> String {
    let name = format!("{} / {}", row.scene, row.param);
    let reference = or_dash(row.reference.as_ref().map(|r| r.value), |x| format!("{x:.4e}"));
    let z = or_dash(row.z(), |z| format!("{z:.1}"));
    let error = or_dash(row.combined_error(), percent);
    let relative = or_dash(Some(row.relative_std()), percent);
    format!(
        "{name:55} {:>12.4e} {reference:>12} {z:>6} {error:>8} {relative:>9} {:>7.3} {:>7.3} {:>14.3e}",
        row.value,
        row.cpu_seconds,
        row.primal_cpu_seconds,
        row.efficiency()
    )
}

/// What another renderer measured: the best of its settings.
#[derive(Clone, Debug, Deserialize)]
struct PeerRow {
    scene: String,
    param: String,
    /// Why it could not.
    error: Option<String>,
    #[serde(default)]
    setting: String,
    /// Settings of which that is the best.
    #[serde(default)]
    tried: u32,
    #[serde(default)]
    loss: f64,
    #[serde(default)]
    value: f64,
    #[serde(default)]
    std: f64,
    #[serde(default)]
    seeds: u64,
    #[serde(default)]
    cpu_seconds: f64,
    reference: Option<Reference>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Line<R> {
    Row(R),
    Forward { forward: Forward },
    Other(serde_json::Value),
}

/// The rows of a file, and its measurements of forward path tracing in the order in which they were made.
fn read<R: for<'a> Deserialize<'a>>(path: &Path) -> std::io::Result<(Vec<R>, Vec<Forward>)> {
    let text = std::fs::read_to_string(path)?;
    let (mut rows, mut forward) = (Vec::new(), Vec::new());
    for line in text.lines().filter(|line| line.starts_with('{')) {
        match serde_json::from_str(line)? {
            Line::Row(row) => rows.push(row),
            Line::Forward { forward: f } => forward.push(f),
            Line::Other(value) => eprintln!("skipped in {}: {value}", path.display()),
        }
    }
    Ok((rows, forward))
}

/// Prints the page's tables (Markdown) from our rows and a peer's, both as JSON lines.
pub fn side_by_side(ours: &Path, peer: &Path) -> std::io::Result<()> {
    let rows = read::<Row>(ours)?.0;
    let peer = read::<PeerRow>(peer)?.0;
    // Of several runs the last counts.
    let peer: BTreeMap<(&str, &str), &PeerRow> =
        peer.iter().map(|row| ((row.scene.as_str(), row.param.as_str()), row)).collect();
    println!(
        "| scene | parameter | value | z | error | rel. std | CPU s | 1/(var·CPU s) | Mitsuba: setting | z | rel. std | CPU s | 1/(var·CPU s) | ratio |"
    );
    println!("|---|---|--:|--:|--:|--:|--:|--:|---|--:|--:|--:|--:|--:|");
    // By class: ratios, and how many of them are to derivatives that are wrong.
    let mut ratios: BTreeMap<&str, (Vec<f64>, usize)> = BTreeMap::new();
    for row in &rows {
        let ours = format!(
            "| {} | {} | {:.3e} | {} | {} | {} | {:.3} | {:.2e} |",
            row.scene,
            row.param,
            row.value,
            or_dash(row.z(), |z| format!("{z:.1}")),
            or_dash(row.combined_error(), percent),
            or_dash(Some(row.relative_std()), percent),
            row.cpu_seconds,
            row.efficiency()
        );
        match peer.get(&(row.scene.as_str(), row.param.as_str())) {
            Some(PeerRow { error: Some(why), .. }) => println!("{ours} {why} | | | | | |"),
            Some(theirs) => {
                let (columns, ratio, biased) = their_columns(row, theirs);
                println!("{ours} {columns}");
                let class = ratios.entry(&row.kind).or_default();
                class.0.extend(ratio);
                class.1 += usize::from(biased);
            }
            None => println!("{ours} not run | | | | | |"),
        }
    }
    println!(
        "\n| class | rows | of them Mitsuba biased | smallest ratio | median | largest |\n|---|--:|--:|--:|--:|--:|"
    );
    for (kind, (mut ratios, biased)) in ratios {
        ratios.sort_by(f64::total_cmp);
        let (Some(first), Some(last)) = (ratios.first(), ratios.last()) else { continue };
        let middle = ratios[ratios.len() / 2];
        println!("| {kind} | {} | {biased} | {} | {} | {} |", ratios.len(), times(*first), times(middle), times(*last));
    }
    println!("\nOne gradient over its image with as many samples, in CPU time, where nothing moves:\n");
    println!("| scene | parameter | CPU s | over the image |\n|---|---|--:|--:|");
    for row in rows.iter().filter(|row| row.kind == Kind::Material.name()) {
        let over = times(row.cpu_seconds / row.primal_cpu_seconds);
        println!("| {} | {} | {:.3} | {over} |", row.scene, row.param, row.cpu_seconds);
    }
    Ok(())
}

/// Prints what both programs reached at forward path tracing, where they were measured in turns.
pub fn turns(ours: &Path, peer: &Path) -> std::io::Result<()> {
    let (ours, theirs) = (read::<Row>(ours)?.1, read::<PeerRow>(peer)?.1);
    for name in FORWARD {
        let speeds = |all: &[Forward]| -> Vec<f64> {
            all.iter().filter(|f| f.scene == name).map(|f| f.samples_per_cpu_second / 1e6).collect()
        };
        let (ours, theirs) = (speeds(&ours), speeds(&theirs));
        if ours.len() != theirs.len() {
            let message = format!("{name}: {} turns of one and {} of the other", ours.len(), theirs.len());
            return Err(std::io::Error::other(message));
        }
        let mut ratios: Vec<f64> = ours.iter().zip(&theirs).map(|(a, b)| a / b).collect();
        let line = |name: &str, numbers: &[f64], show: &dyn Fn(f64) -> String| {
            println!("| {name} | {} |", numbers.iter().map(|x| show(*x)).collect::<Vec<String>>().join(" | "));
        };
        let plain = |x: f64| format!("{x:.2}");
        println!("| {name} | {} |", (1..=ratios.len()).map(|i| i.to_string()).collect::<Vec<String>>().join(" | "));
        println!("|---{}|", "|--:".repeat(ratios.len()));
        line("dscene", &ours, &plain);
        line("Mitsuba", &theirs, &plain);
        line("ratio", &ratios, &times);
        ratios.sort_by(f64::total_cmp);
        if let Some(median) = ratios.get(ratios.len() / 2) {
            println!("\nThe ratio's median is {}.\n", times(*median));
        }
    }
    Ok(())
}

fn times(x: f64) -> String {
    if x >= 10.0 { format!("{x:.0}×") } else { format!("{x:.2}×") }
}

/// A peer's columns, how many times more efficient we are if it has a variance at all, and whether it is off by more
/// than 4 standard errors and 5 %.
fn their_columns(row: &Row, theirs: &PeerRow) -> (String, Option<f64>, bool) {
    let loss_off = (theirs.loss / row.loss - 1.0).abs();
    // A loss that is not ours is another scene: its derivative is not compared with our reference.
    let same = loss_off < 0.01;
    let measured = Row {
        value: theirs.value,
        std: theirs.std,
        seeds: theirs.seeds,
        cpu_seconds: theirs.cpu_seconds,
        reference: theirs.reference.clone().or_else(|| row.reference.clone().filter(|_| same)),
        ..row.clone()
    };
    let ratio = (theirs.std > 0.0).then(|| row.efficiency() / measured.efficiency());
    let off = |r: &Reference| (theirs.value - r.value).abs() > 0.05 * r.value.abs();
    let biased = measured.z().is_some_and(|z| z.abs() > 4.0) && measured.reference.as_ref().is_some_and(off);
    let note = if same { String::new() } else { format!(" (loss {} off)", percent(loss_off)) };
    let text = format!(
        "{} (of {}){note} | {} | {} | {:.2} | {} | {} |",
        theirs.setting,
        theirs.tried,
        or_dash(measured.z(), |z| format!("{z:.1}")),
        or_dash(Some(measured.relative_std()), percent),
        theirs.cpu_seconds,
        or_dash(Some(measured.efficiency()), |x| format!("{x:.2e}")),
        or_dash(ratio, |x| times(x) + if biased { " (biased)" } else { "" })
    );
    (text, ratio, biased)
}
