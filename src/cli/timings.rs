//! `dsl run --timings`: where the time of a run went.

use std::fmt::Write as _;
use std::path::Path;

use serde_json::{Map, Value, json};

use super::out;
use crate::diag::Diagnostic;
use crate::files::write_atomically;
use crate::memory::size_text;
use crate::ranks::{self, Traffic};
use crate::session::clock::human_seconds;
use crate::session::folder::{cannot_write, spare_inputs};
use crate::session::show;
use crate::session::timings::{Timed, statement};
use crate::source::SourceMap;

/// The times of a run: before its actions, of each of them, and after them.
pub struct Timings<'a> {
    pub check: f64,
    pub actions: &'a [Timed],
    pub report: f64,
    pub sources: &'a SourceMap,
}

impl Timings<'_> {
    /// A table on standard error, or an object on standard output.
    pub fn tell(&self, is_json: bool) {
        if is_json {
            out::line(&self.to_json().to_string());
        } else {
            out::error_line(&self.to_text());
        }
    }

    fn whole(&self) -> f64 {
        self.check + self.report + self.actions.iter().map(|timed| timed.seconds).sum::<f64>()
    }

    fn to_text(&self) -> String {
        let names = ["load", "build", "render", "gradient", "loss", "save", "rest"];
        let mut rows =
            vec![["line", "statement", "time"].into_iter().chain(names).map(str::to_owned).collect::<Vec<_>>()];
        let blank = |seconds: f64| if seconds < 5e-5 { String::new() } else { human_seconds(seconds) };
        let mut sums = [0.0; 7];
        let plain = |name: &str, seconds| vec![String::new(), name.to_owned(), human_seconds(seconds)];
        rows.push(plain("check", self.check));
        for timed in self.actions {
            let (line, text) = statement(self.sources, timed.place);
            let parts: Vec<f64> = timed.parts.named().iter().map(|(_, s)| *s).chain([timed.rest()]).collect();
            sums.iter_mut().zip(&parts).for_each(|(sum, part)| *sum += part);
            let mut row = vec![line.to_string(), text, human_seconds(timed.seconds)];
            row.extend(parts.into_iter().map(blank));
            rows.push(row);
        }
        rows.push(plain("report.html", self.report));
        let mut last = plain("the whole run", self.whole());
        last.extend(sums.into_iter().map(blank));
        rows.push(last);
        let mut text = show::list(&rows);
        let place = ranks::place();
        if !place.is_alone() {
            let Traffic { exchanges, received, seconds } = ranks::traffic();
            let (count, size, waited) = (place.count, size_text(received), human_seconds(seconds));
            let _ = write!(
                text,
                "\n{exchanges} exchanges between {count} processes brought this one {size}; it waited {waited} for them"
            );
        }
        text
    }

    fn to_json(&self) -> Value {
        let action = |timed: &Timed| {
            let (line, text) = statement(self.sources, timed.place);
            let mut object = Map::new();
            object.insert("line".into(), json!(line));
            object.insert("statement".into(), json!(text));
            object.insert("seconds".into(), json!(timed.seconds));
            let parts = timed.parts.named().into_iter().chain([("rest", timed.rest())]);
            object.extend(parts.map(|(name, seconds)| (name.to_owned(), json!(seconds))));
            Value::Object(object)
        };
        let Traffic { exchanges, received, seconds } = ranks::traffic();
        json!({
            "event": "timings", "seconds": self.whole(), "check": self.check, "report": self.report,
            "processes": ranks::place().count,
            "messages": {"exchanges": exchanges, "bytes": received, "seconds": seconds},
            "actions": self.actions.iter().map(action).collect::<Vec<Value>>(),
        })
    }

    /// Writes the times as trace events, which Perfetto and Chromium's `about:tracing` draw: each statement, and beneath it its parts, one
    /// after the other however they were interleaved.
    pub fn write(&self, path: &Path) -> Result<(), Diagnostic> {
        let event = |name: &str, begun: f64, seconds: f64, thread: u32| json!({"name": name, "ph": "X", "ts": 1e6 * begun, "dur": 1e6 * seconds, "pid": 1, "tid": thread});
        let mut events = vec![event("check", 0.0, self.check, 1)];
        let mut end = self.check;
        for timed in self.actions {
            let (line, text) = statement(self.sources, timed.place);
            let mut at = self.check + timed.begun;
            let mut whole = event(&text, at, timed.seconds, 1);
            whole["args"] = json!({ "line": line });
            events.push(whole);
            end = at + timed.seconds;
            for (name, seconds) in timed.parts.named().into_iter().chain([("rest", timed.rest())]) {
                if seconds > 0.0 {
                    events.push(event(name, at, seconds, 2));
                }
                at += seconds;
            }
        }
        events.push(event("report.html", end, self.report, 1));
        // The script may have read it in the meantime.
        spare_inputs(path)?;
        let text = json!({ "traceEvents": events, "displayTimeUnit": "ms" }).to_string();
        write_atomically(path, text.as_bytes()).map_err(|error| cannot_write(path, &error))
    }
}
