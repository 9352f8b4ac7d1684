//! The table of a sweep: a row for each combination of values, a column for each reported number, means with standard errors over seeds.

use std::collections::{HashMap, HashSet};

use serde_json::{Map, Value, json};

use super::Combination;
use super::journal::{End, Entry};
use crate::data::table;
use crate::diag::Diagnostic;
use crate::session::Override;
use crate::session::folder::number;
use crate::session::show::{self, plus_minus};
use crate::session::stats::Moments;

/// Most rows that a page shows.
const MOST_ROWS: usize = 500;

/// A sweep, as far as it has been run.
#[derive(Clone, Debug)]
pub struct Table {
    /// What is swept over.
    names: Vec<String>,
    columns: Vec<String>,
    /// Columns of which the largest mean is the best one, and not the smallest.
    maximized: HashSet<String>,
    rows: Vec<Row>,
    /// Runs that have not ended yet.
    missing: usize,
}

#[derive(Clone, Debug)]
struct Row {
    set: Vec<Override>,
    /// By seed, as planned.
    runs: Vec<(Combination, Option<Entry>)>,
    /// By column, of the runs that have finished and say something finite.
    moments: Vec<Moments>,
}

impl Table {
    /// Of the planned `runs`, with the ends of those that have ended. Of columns named by `maximized` the largest mean is the best one. If the sweep
    /// was `interrupted`, settings of which no run has ended have no row: it may have many thousands of them, and is to end at once.
    pub fn new(
        runs: &[Combination],
        ended: &HashMap<String, Entry>,
        maximized: &HashSet<String>,
        interrupted: bool,
    ) -> Table {
        let mut rows: Vec<Row> = Vec::new();
        let mut places: HashMap<Vec<&str>, usize> = HashMap::new();
        let mut columns: Vec<String> = Vec::new();
        let entries: Vec<Option<&Entry>> = runs.iter().map(|run| ended.get(&run.name())).collect();
        let with_end = runs.iter().zip(&entries).filter(|(_, entry)| entry.is_some());
        let told: HashSet<Vec<&str>> = with_end.map(|(run, _)| run.row()).collect();
        let missing = entries.iter().filter(|entry| entry.is_none()).count();
        let is_told = |run: &Combination| !interrupted || told.contains(&run.row());
        for (run, entry) in runs.iter().zip(entries).filter(|(run, _)| is_told(run)) {
            let place = *places.entry(run.row()).or_insert_with(|| {
                rows.push(Row { set: run.overrides.clone(), runs: Vec::new(), moments: Vec::new() });
                rows.len() - 1
            });
            for (name, _) in entry.iter().flat_map(|entry| &entry.values) {
                if !columns.contains(name) {
                    columns.push(name.clone());
                }
            }
            rows[place].runs.push((run.clone(), entry.cloned()));
        }
        for row in &mut rows {
            row.moments = columns.iter().map(|column| row.moments_of(column)).collect();
        }
        let names = runs.first().map_or(Vec::new(), |run| run.overrides.iter().map(|o| o.name.clone()).collect());
        Table { names, columns, maximized: maximized.clone(), rows, missing }
    }

    /// Whether every run has finished as the script wants it, or was pruned.
    pub fn is_success(&self) -> bool {
        let is_fine = |entry: &Entry| match entry.end {
            End::Finished => entry.failed_expects == 0,
            End::Pruned => true,
            End::Diverged | End::Error => false,
        };
        self.runs().all(|(_, entry)| entry.as_ref().is_none_or(is_fine))
    }

    /// Runs that have not ended yet.
    pub fn missing(&self) -> usize {
        self.missing
    }

    fn runs(&self) -> impl Iterator<Item = &(Combination, Option<Entry>)> {
        self.rows.iter().flat_map(|row| &row.runs)
    }

    /// By column, the row with the best mean.
    fn best(&self) -> Vec<Option<usize>> {
        let best = |(column, name): (usize, &String)| {
            let sign = if self.maximized.contains(name) { -1.0 } else { 1.0 };
            let mean = |row: &Row| row.moments[column].mean().first().map(|mean| sign * mean);
            let means = self.rows.iter().enumerate().filter_map(|(i, row)| Some((i, mean(row)?)));
            means.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i)
        };
        self.columns.iter().enumerate().map(best).collect()
    }

    /// For a terminal.
    pub fn text(&self) -> String {
        let seeds = self.seeds();
        let is_told = self.rows.iter().any(|row| !row.notes().is_empty());
        let mut head = self.names.clone();
        head.push("seeds".to_owned());
        head.extend(self.columns.iter().map(|c| format!("{}  ", show_name(c))));
        head.extend(is_told.then(String::new));
        let mut lines = vec![head];
        let best = self.best();
        for (i, row) in self.rows.iter().enumerate() {
            let mut line: Vec<String> = row.set.iter().map(|o| show_name(&o.value)).collect();
            line.push(row.finished_of(seeds));
            for (column, moments) in row.moments.iter().enumerate() {
                let is_best = self.rows.len() > 1 && best[column] == Some(i);
                line.push(format!("{} {}", shown(moments), if is_best { "*" } else { " " }));
            }
            line.extend(is_told.then(|| row.notes()));
            lines.push(line);
        }
        show::table(&lines)
    }

    /// For a page: the same of the first rows, and how many rows these leave out.
    pub fn for_page(&self) -> Value {
        let (seeds, best) = (self.seeds(), self.best());
        let row = |(i, row): (usize, &Row)| {
            let mean = |(column, moments): (usize, &Moments)| {
                json!([shown(moments), self.rows.len() > 1 && best[column] == Some(i)])
            };
            json!({
                "kind": row.kind(), "set": row.set.iter().map(|o| show_name(&o.value)).collect::<Vec<_>>(),
                "seeds": row.finished_of(seeds), "notes": row.notes(),
                "means": row.moments.iter().enumerate().map(mean).collect::<Value>(),
            })
        };
        let rows: Value = self.rows.iter().enumerate().take(MOST_ROWS).map(row).collect();
        let is_largest: Vec<bool> = self.columns.iter().map(|name| self.maximized.contains(name)).collect();
        json!({
            "names": self.names, "columns": self.columns, "largest": is_largest, "rows": rows,
            "left": self.rows.len().saturating_sub(MOST_ROWS),
        })
    }

    /// By the name of a run, its settings without the seed in words, and its numbers.
    pub fn by_run(&self) -> HashMap<String, (String, Vec<(String, f64)>)> {
        let of = |row: &Row| {
            let kind = row.kind();
            let one = move |(run, entry): &(Combination, Option<Entry>)| {
                let values = entry.as_ref().map(|entry| entry.values.clone()).unwrap_or_default();
                (run.name(), (kind.clone(), values))
            };
            row.runs.iter().map(one).collect::<Vec<_>>()
        };
        self.rows.iter().flat_map(of).collect()
    }

    /// Most runs of a row.
    fn seeds(&self) -> usize {
        self.rows.iter().map(|row| row.runs.len()).max().unwrap_or(0)
    }

    /// For other programs: a line for each row, with the numbers to their last digit.
    pub fn csv(&self) -> Result<Vec<u8>, Diagnostic> {
        let mut head = self.names.clone();
        head.extend(["finished", "diverged", "pruned", "error"].map(|end| format!("runs_{end}")));
        for column in &self.columns {
            head.extend([column.clone(), format!("{column}_error")]);
        }
        let line = |row: &Row| {
            let mut line: Vec<String> = row.set.iter().map(|o| o.value.clone()).collect();
            let ends = [End::Finished, End::Diverged, End::Pruned, End::Error];
            line.extend(ends.map(|end| row.count(end).to_string()));
            for moments in &row.moments {
                line.push(moments.mean().first().map_or(String::new(), f64::to_string));
                line.push(error_of(moments).map_or(String::new(), |x| x.to_string()));
            }
            line
        };
        let lines: Vec<Vec<String>> = self.rows.iter().map(line).collect();
        let head: Vec<&str> = head.iter().map(String::as_str).collect();
        table::encode(Some(&head), &lines).map_err(|why| Diagnostic::error("dscene::run::write", why))
    }

    /// For other programs: the same with every run.
    pub fn json(&self) -> String {
        let best = self.best();
        let rows: Vec<Value> = self.rows.iter().map(|row| row.json(&self.columns)).collect();
        let best: Map<String, Value> =
            self.columns.iter().cloned().zip(best.into_iter().map(|row| json!(row))).collect();
        let table = json!({ "columns": self.columns, "rows": rows, "best": best });
        format!("{}\n", serde_json::to_string_pretty(&table).unwrap_or_default())
    }
}

impl Row {
    fn moments_of(&self, column: &str) -> Moments {
        let mut moments = Moments::default();
        let finished = self.runs.iter().filter_map(|(_, entry)| entry.as_ref()).filter(|e| e.end == End::Finished);
        for (_, x) in finished.flat_map(|entry| &entry.values).filter(|(name, x)| name == column && x.is_finite()) {
            moments.add(&[*x]);
        }
        moments
    }

    fn count(&self, end: End) -> usize {
        self.runs.iter().filter(|(_, entry)| entry.as_ref().is_some_and(|entry| entry.end == end)).count()
    }

    /// How many runs have finished of those that most rows have, in words.
    fn finished_of(&self, seeds: usize) -> String {
        match self.count(End::Finished) {
            all if all == seeds => seeds.to_string(),
            some => format!("{some} of {seeds}"),
        }
    }

    /// What tells it from other rows, in words.
    fn kind(&self) -> String {
        let parts: Vec<String> = self.set.iter().map(|o| format!("{} = {}", o.name, show_name(&o.value))).collect();
        if parts.is_empty() { "all seeds".to_owned() } else { parts.join(", ") }
    }

    /// What is to be said of its runs beside their numbers.
    fn notes(&self) -> String {
        let mut notes = Vec::new();
        let ends = [(End::Diverged, "diverged"), (End::Pruned, "pruned"), (End::Error, "ended with an error")];
        for (end, word) in ends {
            notes.extend(Some(self.count(end)).filter(|n| *n > 0).map(|n| format!("{n} {word}")));
        }
        let entries = || self.runs.iter().filter_map(|(_, entry)| entry.as_ref());
        let expects = entries().filter(|entry| entry.failed_expects > 0).count();
        notes.extend((expects > 0).then(|| format!("an `expect` failed in {expects}")));
        let finished = entries().filter(|entry| entry.end == End::Finished);
        let broken = finished.filter(|entry| entry.values.iter().any(|(_, x)| !x.is_finite())).count();
        notes.extend((broken > 0).then(|| format!("{broken} with values that are not finite")));
        notes.join(", ")
    }

    fn json(&self, columns: &[String]) -> Value {
        let set: Map<String, Value> = self.set.iter().map(|o| (o.name.clone(), json!(o.value))).collect();
        let run = |(run, entry): &(Combination, Option<Entry>)| {
            let values =
                |entry: &Entry| entry.values.iter().map(|(n, x)| (n.clone(), number(*x))).collect::<Map<_, _>>();
            json!({
                "seed": run.seed, "folder": run.name(), "end": entry.as_ref().map(|entry| entry.end),
                "values": entry.as_ref().map(values), "why": entry.as_ref().and_then(|entry| entry.why.clone()),
            })
        };
        let column = |x: &dyn Fn(&Moments) -> Value| -> Map<String, Value> {
            columns.iter().cloned().zip(self.moments.iter().map(x)).collect()
        };
        let mean = column(&|moments| moments.mean().first().map_or(Value::Null, |x| number(*x)));
        let error = column(&|moments| error_of(moments).map_or(Value::Null, number));
        json!({ "set": set, "mean": mean, "std_error": error, "runs": self.runs.iter().map(run).collect::<Vec<_>>() })
    }
}

/// The standard error of a mean; one number has none that is known.
fn error_of(moments: &Moments) -> Option<f64> {
    moments.std_error().first().copied().filter(|_| moments.count() > 1)
}

fn shown(moments: &Moments) -> String {
    match (moments.mean().first(), error_of(moments)) {
        (Some(mean), Some(error)) => plus_minus(*mean, error),
        (Some(mean), None) => show::significant(*mean, 4),
        (None, _) => "–".to_owned(),
    }
}

/// On one line and of bearable length.
fn show_name(text: &str) -> String {
    let line = text.split_whitespace().collect::<Vec<&str>>().join(" ");
    if line.chars().count() <= 32 { line } else { format!("{}…", line.chars().take(31).collect::<String>()) }
}

#[cfg(test)]
mod tests {
    use super::super::{Axis, combinations};
    use super::*;

    fn entry(end: End, error: f64) -> Entry {
        let values = vec![("error".to_owned(), error), ("seconds".to_owned(), 2.0)];
        Entry { end, values, steps: 1, failed_expects: 0, why: None }
    }

    fn table(ends: &[(usize, Entry)], maximized: &[&str]) -> Table {
        let axes = [Axis { name: "lr".into(), values: vec!["0.1".into(), "0.2".into()] }];
        let runs = combinations(&axes, &[0, 1]).unwrap();
        let ended = ends.iter().map(|(i, entry)| (runs[*i].name(), entry.clone())).collect();
        Table::new(&runs, &ended, &maximized.iter().map(|name| (*name).to_owned()).collect(), false)
    }

    #[test]
    fn a_row_has_the_mean_over_seeds_and_its_error() {
        let all = [(0, 1.0), (1, 4.0), (2, 2.0), (3, 5.0)].map(|(i, x)| (i, entry(End::Finished, x)));
        let found = table(&all, &[]);
        assert!(found.is_success() && found.missing() == 0);
        let text = found.text();
        let words: Vec<&str> = text.split_whitespace().collect();
        let expected = [
            "lr", "seeds", "error", "seconds", "0.1", "2", "1.50", "±", "0.50", "*", "2", "*", "0.2", "2", "4.50", "±",
            "0.50", "2",
        ];
        assert_eq!(words, expected, "{text}");
        let csv = String::from_utf8(found.csv().unwrap()).unwrap();
        let head = "lr,runs_finished,runs_diverged,runs_pruned,runs_error,error,error_error,seconds,seconds_error";
        assert_eq!(csv, format!("{head}\n0.1,2,0,0,0,1.5,0.5,2,0\n0.2,2,0,0,0,4.5,0.5,2,0\n"));
        let json: Value = serde_json::from_str(&found.json()).unwrap();
        assert_eq!(
            (&json["best"]["error"], &json["rows"][1]["runs"][0]["folder"]),
            (&json!(0), &json!("lr=0.2,seed=0"))
        );
        // A page says the same.
        let page = found.for_page();
        let first = json!({
            "kind": "lr = 0.1", "set": ["0.1"], "seeds": "2", "notes": "",
            "means": [["1.50 ± 0.50", true], ["2", true]],
        });
        assert_eq!((&page["rows"][0], &page["left"]), (&first, &json!(0)), "{page}");
        assert_eq!(found.by_run()["lr=0.2,seed=1"].0, "lr = 0.2");
        // Where more is better, the larger mean is marked.
        let json: Value = serde_json::from_str(&table(&all, &["error"]).json()).unwrap();
        assert_eq!(json["best"], json!({ "error": 1, "seconds": 0 }));
    }

    #[test]
    fn what_has_no_value_is_told_and_spoils_no_mean() {
        let ends = [
            (0, entry(End::Diverged, 1e9)),
            (1, entry(End::Finished, 4.0)),
            (2, entry(End::Finished, 2.0)),
            (3, Entry { failed_expects: 1, ..entry(End::Finished, f64::NAN) }),
        ];
        let found = table(&ends, &[]);
        assert!(!found.is_success());
        let text = found.text();
        assert!(text.contains("1 of 2       2 *") && text.contains("1 diverged"), "{text}");
        assert!(text.contains("an `expect` failed in 1, 1 with values that are not finite"), "{text}");
        let part = table(&[(0, entry(End::Pruned, 1.0))], &[]);
        assert!(part.is_success() && part.missing() == 3 && part.text().contains("1 pruned"), "{}", part.text());
        assert_eq!(table(&[], &[]).text().lines().count(), 3);
        // Of one that was interrupted, what has begun is shown, and the rest counted.
        let runs = combinations(&[Axis { name: "a".into(), values: vec!["1".into(), "2".into()] }], &[0, 1]).unwrap();
        let ended = [(runs[2].name(), entry(End::Finished, 1.0))].into();
        let short = Table::new(&runs, &ended, &HashSet::new(), true);
        assert_eq!((short.rows.len(), short.missing(), &short.names[..]), (1, 3, &["a".to_owned()][..]));
        assert_eq!(Table::new(&runs, &HashMap::new(), &HashSet::new(), true).text().lines().count(), 1);
    }
}
