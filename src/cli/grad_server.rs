//! `dsl grad --serve`: values and derivatives for programs that compute the loss themselves, in any language. A line of JSON on standard input
//! is a question, a line on standard output its answer. The script is read once, and what no question moves is computed once.

use std::collections::BTreeMap;
use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::{Map, Value as Json, json};

use super::args::GradArgs;
use super::render::{cannot_save, interrupted, writable};
use super::{EXIT_WRONG, Loaded, Terminal, out};
use crate::diag::{self, Diagnostic};
use crate::eval;
use crate::image::file::{self, Encoding};
use crate::natives::value::Value;
use crate::session::clock::Stopwatch;
use crate::session::folder::{nested, number};
use crate::session::save::save_value;
use crate::session::script::{Refusal, Result, Script, Seeds, Values, losses};
use crate::session::{World, world};
use crate::source::SourceMap;
use crate::tape::Tensor;

/// A question.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Question {
    /// Comes back with the answer.
    #[serde(default)]
    id: Json,
    /// What is asked for: anything made of numbers. By default `--of`, or the first loss.
    of: Option<String>,
    /// By what it is differentiated: by default what `params` names, or else all params that reach it. `[]` asks for the value alone.
    wrt: Option<Vec<String>>,
    /// Values of params and fields, for this question.
    #[serde(default)]
    params: BTreeMap<String, Json>,
    seed: Option<u64>,
    grad_seed: Option<u64>,
    /// The derivative is that of the sum of this times the value: an image file, or numbers. By default 1.
    adjoint: Option<Json>,
    /// A file for the value, in place of its numbers in the answer.
    save: Option<PathBuf>,
}

/// Answers until standard input ends.
pub fn serve(args: &GradArgs, loaded: Loaded, terminal: &mut Terminal) -> u8 {
    let mut script = Script::new(ManuallyDrop::into_inner(loaded.engine));
    for line in std::io::stdin().lines() {
        let line = match line {
            Ok(line) => line,
            Err(error) => {
                let message = format!("cannot read standard input: {}", crate::files::describe_io(&error));
                let told = Diagnostic::error("dscene::file::unreadable", message);
                terminal.diagnostic(&told, &SourceMap::new());
                return EXIT_WRONG;
            }
        };
        if line.trim().is_empty() {
            continue;
        }
        let answer = world::listening(|| answer(&mut script, args, &line));
        if world::interrupted() {
            return interrupted(terminal);
        }
        out::line(&answer.to_string());
    }
    0
}

fn answer(script: &mut Script, args: &GradArgs, line: &str) -> Json {
    let watch = Stopwatch::start();
    let question: Question = match serde_json::from_str(line) {
        Ok(question) => question,
        Err(error) => return refused(&Json::Null, script, &wrong(format!("this is no question: {error}")).into()),
    };
    let id = question.id.clone();
    let mut answer = match answered(script, args, question) {
        Ok(answer) => answer,
        Err(refusal) => return refused(&id, script, &refusal),
    };
    let sources = &script.engine().program().sources.clone();
    let warnings: Vec<Json> = script.take_warnings().iter().map(|w| diag::to_json(w, sources)).collect();
    answer.insert("warnings".into(), warnings.into());
    answer.insert("seconds".into(), number(watch.elapsed().wall));
    let mut object = Map::from_iter([("id".to_owned(), id)]);
    object.extend(answer);
    Json::Object(object)
}

fn answered(script: &mut Script, args: &GradArgs, question: Question) -> Result<Map<String, Json>> {
    let of = match question.of.or_else(|| args.of.clone()) {
        Some(of) => of,
        None => losses(script.engine().program()).into_iter().next().ok_or_else(|| {
            let told = Diagnostic::error("dscene::cli::of", "the script declares no loss");
            told.help("say what to differentiate: {\"of\": \"mean(render(eye))\"}")
        })?,
    };
    let mut at = Values::new();
    for (name, numbers) in &question.params {
        at.insert(name.clone(), tensor(numbers, &format!("`params.{name}`"))?.into());
    }
    let base = script.engine().options().base_dir.clone();
    let seeds = Seeds { value: question.seed, derivative: question.grad_seed };
    let mut answer = Map::new();
    let is_value = question.wrt.as_ref().is_some_and(Vec::is_empty);
    let wrt = question.wrt.unwrap_or_else(|| match args.wrt.as_slice() {
        [] => question.params.keys().cloned().collect(),
        wrt => wrt.to_vec(),
    });
    let ty = script.expression(&of)?.ty;
    let saved = |script: &Script, value: &Value| match &question.save {
        Some(path) => save(script, value, &ty, path),
        None => Ok(eval::to_json(value)),
    };
    if is_value {
        // The samples of the value with its derivative.
        let seed = seeds.value.unwrap_or(script.engine().options().seed);
        let value = script.eval(&of, &at, Some(seed))?;
        answer.insert("value".into(), saved(script, &value)?);
        return Ok(answer);
    }
    let (linear, targets) = script.linear(&of, &at, &wrt, seeds)?;
    answer.insert("value".into(), saved(script, &linear.value)?);
    let adjoint = match &question.adjoint {
        None => Tensor::full(linear.shape(), 1.0),
        Some(Json::String(path)) => adjoint_image(&base.join(path))?,
        Some(numbers) => tensor(numbers, "`adjoint`")?,
    };
    let found = linear.pull_back(adjoint)?;
    let named = targets.iter().zip(found).map(|((name, _), d)| (name.clone(), nested(&d.shape, &d.data)));
    answer.insert("wrt".into(), Json::Object(named.collect()));
    Ok(answer)
}

/// Saves the value; the answer has the file's name in its place.
fn save(script: &Script, value: &Value, ty: &crate::check::types::Ty, path: &Path) -> Result<Json> {
    writable(path)?;
    let saved = script.engine().stoppable(|| save_value(value, ty, path))?;
    saved.map_err(|error| cannot_save(path, error))?;
    Ok(json!(path.display().to_string()))
}

/// The adjoint of an image, as the numbers of a file.
fn adjoint_image(path: &Path) -> Result<Tensor> {
    match file::load(path, Encoding::Linear, None) {
        Ok(decoded) => Ok(Tensor::from_image(&decoded.image)),
        Err(error) => Err(wrong(format!("cannot read `{}`: {error}", path.display())).into()),
    }
}

/// Numbers nested by their shape.
fn tensor(json: &Json, what: &str) -> Result<Tensor> {
    fn collect(json: &Json, shape: &mut Vec<usize>, depth: usize, data: &mut Vec<f64>) -> Option<()> {
        match json {
            Json::Number(number) if depth == shape.len() => data.push(number.as_f64()?),
            Json::Array(items) => {
                if depth == shape.len() && data.is_empty() {
                    shape.push(items.len());
                }
                let fits = shape.get(depth) == Some(&items.len());
                return if fits { items.iter().try_for_each(|i| collect(i, shape, depth + 1, data)) } else { None };
            }
            _ => return None,
        }
        Some(())
    }
    let (mut shape, mut data) = (Vec::new(), Vec::new());
    match collect(json, &mut shape, 0, &mut data) {
        Some(()) => Ok(Tensor { shape, data }),
        None => Err(wrong(format!("{what} must be a number, or an array of numbers in rows of one length")).into()),
    }
}

fn wrong(message: String) -> Diagnostic {
    Diagnostic::error("dscene::cli::request", message)
        .help("a question is one line such as {\"of\": \"render(eye)\", \"params\": {\"glow\": 2}, \"adjoint\": \"adjoint.exr\"}")
}

fn refused(id: &Json, script: &Script, refusal: &Refusal) -> Json {
    let sources = &script.engine().program().sources;
    let told: Vec<Json> = refusal.0.iter().map(|d| diag::to_json(d, sources)).collect();
    json!({"id": id, "error": told})
}
