//! The run folder: what was run, how each step went, what was saved.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Component, Path, PathBuf};

use serde::Serialize;
use serde_json::{Map, Value, json};

use super::clock::Date;

/// Params with more numbers than this are left out of the log.
pub const LOGGED_NUMBERS: usize = 64;

/// What `run.json` says.
#[derive(Clone, Debug, Serialize)]
pub struct RunInfo {
    /// The version of dscene.
    pub version: &'static str,
    /// The script's name without folder and extension.
    pub name: String,
    pub file: String,
    pub command: Vec<String>,
    pub seed: u64,
    pub threads: usize,
    /// UTC.
    pub started: String,
    pub overrides: Vec<Override>,
    /// The script and its imports, as run.
    pub sources: Vec<SourceText>,
}

/// `--set NAME=EXPR`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Override {
    pub name: String,
    pub value: String,
}

#[derive(Clone, Debug, Serialize)]
pub struct SourceText {
    pub file: String,
    pub text: String,
}

/// One line of `log.jsonl`. Everything but `seconds` is the same for each run with the same seed.
#[derive(Clone, Debug)]
pub struct LogEntry<'a> {
    /// Counts over all optimisations of the run.
    pub step: u64,
    /// The loss's name.
    pub of: &'a str,
    pub stage: Option<&'a str>,
    pub loss: f64,
    pub lr: f64,
    pub grad_norm: f64,
    pub skipped: bool,
    pub seconds: f64,
    /// Values at which the loss was taken: name, shape, numbers.
    pub params: &'a [(String, Vec<usize>, Vec<f64>)],
}

impl LogEntry<'_> {
    pub fn to_json(&self) -> Value {
        let mut line = Map::new();
        line.insert("step".into(), json!(self.step));
        line.insert("of".into(), json!(self.of));
        if let Some(stage) = self.stage {
            line.insert("stage".into(), json!(stage));
        }
        line.insert("loss".into(), number(self.loss));
        line.insert("lr".into(), number(self.lr));
        line.insert("grad_norm".into(), number(self.grad_norm));
        if self.skipped {
            line.insert("skipped".into(), json!(true));
        }
        line.insert("seconds".into(), number(self.seconds));
        let small = self.params.iter().filter(|(_, _, data)| data.len() <= LOGGED_NUMBERS);
        let params: Map<String, Value> = small.map(|(name, shape, data)| (name.clone(), nested(shape, data))).collect();
        line.insert("params".into(), Value::Object(params));
        Value::Object(line)
    }
}

/// A number for JSON, which has no infinities: those become strings (`"inf"`, `"-inf"`, `"nan"`).
pub fn number(x: f64) -> Value {
    match serde_json::Number::from_f64(x) {
        Some(n) => Value::Number(n),
        None if x.is_nan() => json!("nan"),
        None if x > 0.0 => json!("inf"),
        None => json!("-inf"),
    }
}

/// Row-major numbers as nested arrays; a scalar (`[]`) is a bare number.
pub fn nested(shape: &[usize], data: &[f64]) -> Value {
    let Some((first, rest)) = shape.split_first() else {
        return data.first().map_or(Value::Null, |x| number(*x));
    };
    let stride: usize = rest.iter().product();
    let row = |i: usize| nested(rest, data.get(i * stride..(i + 1) * stride).unwrap_or(&[]));
    Value::Array((0..*first).map(row).collect())
}

/// An existing folder that one run writes into.
#[derive(Debug)]
pub struct RunFolder {
    path: PathBuf,
    log: BufWriter<File>,
}

impl RunFolder {
    /// `runs/NAME-TIMESTAMP` below the current folder; a run in the same second gets a number.
    pub fn fresh_path(name: &str, date: Date) -> PathBuf {
        let base = Path::new("runs").join(format!("{name}-{}", date.stamp()));
        let numbered = (2..1000).map(|n| PathBuf::from(format!("{}-{n}", base.display())));
        let free = std::iter::once(base.clone()).chain(numbered).find(|p| !p.exists());
        free.unwrap_or(base)
    }

    /// Makes the folder (it may exist), writes `run.json` and starts an empty log.
    pub fn create(path: &Path, info: &RunInfo) -> io::Result<RunFolder> {
        fs::create_dir_all(path)?;
        let text = serde_json::to_string_pretty(info).map_err(io::Error::other)?;
        write_atomically(&path.join("run.json"), format!("{text}\n").as_bytes())?;
        let log = BufWriter::new(File::create(path.join("log.jsonl"))?);
        Ok(RunFolder { path: path.to_path_buf(), log })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Appends a line; flushed at once, so that a killed run keeps its log.
    pub fn log(&mut self, entry: &LogEntry<'_>) -> io::Result<()> {
        writeln!(self.log, "{}", entry.to_json())?;
        self.log.flush()
    }

    /// Where a script's `save … to "name"` goes, its folders made. Only below the run folder.
    pub fn output_path(&self, name: &str) -> io::Result<PathBuf> {
        output_path(&self.path, name)
    }
}

/// `name` below `folder`, with the folders between them made. Absolute names and `..` are refused.
pub fn output_path(folder: &Path, name: &str) -> io::Result<PathBuf> {
    let relative = Path::new(name);
    let is_inside = relative.components().all(|c| matches!(c, Component::Normal(_) | Component::CurDir));
    if name.is_empty() || !is_inside || relative.file_name().is_none() {
        let message = "outputs are written into the run folder: give a relative path without `..`";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, message));
    }
    let path = folder.join(relative);
    if let Some(parent) = path.parent() {
        fs::create_dir_all(parent)?;
    }
    Ok(path)
}

/// Writes beside the place and renames: a full disk or a crash leaves no half file.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".part");
    let part = path.with_file_name(name);
    let written = File::create(&part).and_then(|mut file| file.write_all(bytes));
    let renamed = written.and_then(|()| fs::rename(&part, path));
    if renamed.is_err() {
        // The error at hand is the one worth telling.
        let _ = fs::remove_file(&part);
    }
    renamed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tensors_nest_and_scalars_are_bare() {
        assert_eq!(nested(&[], &[0.5]), json!(0.5));
        assert_eq!(nested(&[2], &[1.0, f64::NAN]), json!([1.0, "nan"]));
        assert_eq!(nested(&[2, 2], &[1.0, 2.0, 3.0, 4.0]), json!([[1.0, 2.0], [3.0, 4.0]]));
        assert_eq!(nested(&[0, 3], &[]), json!([]));
    }

    #[test]
    fn a_log_line_has_the_promised_fields_in_order() {
        let big = ("texels".to_owned(), vec![100], vec![0.0; 100]);
        let params = [("x".to_owned(), vec![], vec![1.5]), big];
        let entry = LogEntry {
            step: 3,
            of: "fit",
            stage: None,
            loss: 0.25,
            lr: 0.01,
            grad_norm: 2.0,
            skipped: false,
            seconds: 0.5,
            params: &params,
        };
        let expected =
            r#"{"step":3,"of":"fit","loss":0.25,"lr":0.01,"grad_norm":2.0,"seconds":0.5,"params":{"x":1.5}}"#;
        assert_eq!(entry.to_json().to_string(), expected);
    }

    #[test]
    fn outputs_stay_inside_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        assert!(output_path(folder.path(), "frames/0001.png").unwrap().parent().unwrap().is_dir());
        for name in ["", "..", "../x.png", "/etc/x.png", "a/../../x.png", "."] {
            assert!(output_path(folder.path(), name).is_err(), "{name:?}");
        }
    }

    #[test]
    fn a_run_folder_holds_the_run_and_the_log() {
        let folder = tempfile::tempdir().unwrap();
        let info = RunInfo {
            version: "1",
            name: "x".into(),
            file: "x.dscene".into(),
            command: vec!["dsl".into()],
            seed: 7,
            threads: 2,
            started: Date::from_unix(0).iso(),
            overrides: vec![Override { name: "a".into(), value: "1".into() }],
            sources: vec![SourceText { file: "x.dscene".into(), text: "let a = 0".into() }],
        };
        let run = RunFolder::create(&folder.path().join("deep/er"), &info).unwrap();
        let read: Value = serde_json::from_slice(&fs::read(run.path().join("run.json")).unwrap()).unwrap();
        assert_eq!(read["seed"], 7);
        assert_eq!(read["sources"][0]["text"], "let a = 0");
        assert!(run.path().join("log.jsonl").is_file());
    }
}
