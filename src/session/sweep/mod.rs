//! Many runs of one program: a list of combinations, each with overrides of declarations and a seed of its own.
//!
//! All runs share a folder. Each has a run folder below it, with the checkpoints from which a run goes on that was killed. What was begun
//! and what has ended stands in a journal, from which the table is made. Processes on several machines may work on one folder.

mod folder;
mod journal;
mod prune;
mod table;

use std::collections::HashSet;

pub use folder::{PAGE, Record, SweepFolder, is_sweep};
pub use journal::{End, Entry, Journal};
pub use prune::Judge;
pub use table::Table;

use super::Override;
use crate::files::fingerprint;

/// More combinations than this are refused: they are more likely a mistake than years of work.
pub const MOST: usize = 100_000;

/// Longer values are cut in the names of folders.
const LONGEST: usize = 40;

/// A declaration (or a field of one) and the texts of the values that it takes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Axis {
    pub name: String,
    pub values: Vec<String>,
}

/// One run of a sweep.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Combination {
    pub overrides: Vec<Override>,
    pub seed: u64,
}

/// All combinations of the axes' values with the seeds. Seeds change slowest, so that a sweep that is interrupted has some of everything.
/// `None` if there are more than [`MOST`].
pub fn combinations(axes: &[Axis], seeds: &[u64]) -> Option<Vec<Combination>> {
    let count = axes.iter().map(|axis| axis.values.len()).try_fold(seeds.len(), usize::checked_mul);
    count.filter(|count| *count <= MOST)?;
    let mut rows = vec![Vec::new()];
    for axis in axes {
        let with = |row: &Vec<Override>, value: &String| {
            let mut row = row.clone();
            row.push(Override { name: axis.name.clone(), value: value.clone() });
            row
        };
        rows = rows.iter().flat_map(|row| axis.values.iter().map(move |value| with(row, value))).collect();
    }
    let runs = seeds.iter().flat_map(|seed| rows.iter().map(|row| Combination { overrides: row.clone(), seed: *seed }));
    // A value or seed that is given twice is run once.
    let mut seen = HashSet::new();
    Some(runs.filter(|run| seen.insert(run.name())).collect())
}

impl Combination {
    /// `lr=0.01,seed=3`: names the run's folder, its lines in the journal, and itself. Values that no name of a file should have are written
    /// in other letters and told apart by a number.
    pub fn name(&self) -> String {
        let mut parts: Vec<String> = self.overrides.iter().map(|o| format!("{}={}", o.name, plain(&o.value))).collect();
        parts.push(format!("seed={}", self.seed));
        let name = parts.join(",");
        // Most file systems take names of 255 bytes.
        if name.len() <= 200 { name } else { format!("{}-{:016x}", &name[..180], fingerprint(name.as_bytes())) }
    }

    /// The values of all but the seed.
    pub fn row(&self) -> Vec<&str> {
        self.overrides.iter().map(|o| o.value.as_str()).collect()
    }
}

/// A value as part of a file's name.
fn plain(value: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '_' | '+' | '-');
    if value.len() <= LONGEST && value.chars().all(is_plain) {
        return value.to_owned();
    }
    let text: String = value.chars().filter(|c| !c.is_whitespace()).take(LONGEST).collect();
    let text = text.replace(|c: char| !is_plain(c), "_");
    format!("{text}-{:08x}", fingerprint(value.as_bytes()) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(name: &str, values: &[&str]) -> Axis {
        Axis { name: name.to_owned(), values: values.iter().map(|v| (*v).to_owned()).collect() }
    }

    #[test]
    fn every_value_meets_every_other_once() {
        let axes = [axis("a", &["1", "2", "1"]), axis("b", &["x", "y"])];
        let names: Vec<String> = combinations(&axes, &[0, 7]).unwrap().iter().map(Combination::name).collect();
        assert_eq!(names[..4], ["a=1,b=x,seed=0", "a=1,b=y,seed=0", "a=2,b=x,seed=0", "a=2,b=y,seed=0"]);
        assert_eq!((names.len(), names[4].as_str()), (8, "a=1,b=x,seed=7"));
        assert_eq!(combinations(&[], &[3]).unwrap()[0].name(), "seed=3");
        let many: Vec<u64> = (0..1000).collect();
        let long = ["1"; 101];
        assert!(combinations(&[axis("a", &long)], &many).is_none());
    }

    #[test]
    fn names_are_those_of_files_and_differ() {
        let name = |value: &str| combinations(&[axis("a", &[value])], &[0]).unwrap()[0].name();
        let hostile =
            ["../../x", "a/b", "adam(lr: 0.1)", "adam(lr:0.1)", &"9".repeat(300), &"8".repeat(300), "\"é\n\""];
        let names: HashSet<String> = hostile.iter().map(|v| name(v)).collect();
        assert_eq!(names.len(), hostile.len());
        assert!(names.iter().all(|n| n.len() < 200 && !n.contains(['/', '\n', ' ', '"'])), "{names:?}");
        let axes: Vec<Axis> = (0..30).map(|i| axis(&format!("variable{i}"), &["0.5"])).collect();
        let long = combinations(&axes, &[0, 1]).unwrap();
        assert!(long[0].name().len() < 255 && long[0].name() != long[1].name());
    }
}
