//! A script with the values that its params have now as their initial ones.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use crate::check::types::Ty;
use crate::check::{self, Line, hir};
use crate::diag::Diagnostic;
use crate::eval::{Engine, is_angle};
use crate::memory;
use crate::natives::value::Value;
use crate::report::LONGEST_SCRIPT;
use crate::session::Override;
use crate::session::folder::Nested;
use crate::session::line::check_line;
use crate::source::{SourceId, SourceMap, Span};
use crate::syntax::ast::{Expr, ExprKind, Import, ImportFrom, KindBody, StatementKind};
use crate::tape::{Tensor, Var};

/// A value for a declaration, or for a field of one, as text of the language.
pub struct Edit {
    pub name: String,
    pub path: Vec<String>,
    pub text: String,
}

/// A script for a file.
pub struct Script {
    pub text: String,
    /// Expressions of the script whose relative paths are not written out, so that they do not lead from the new file to where they led.
    pub lost: Vec<String>,
}

/// The script as it was run, with the present values as its initial ones. What it reads is found from the folder `to`, if one is given.
pub fn found_script(engine: &mut Engine, overrides: &[Override], to: Option<&Path>) -> Result<Script, Diagnostic> {
    let root = engine.program().origin.main;
    let mut edits = Vec::new();
    for set in overrides {
        let mut names = set.name.split('.').map(str::to_owned);
        let name = names.next().unwrap_or_default();
        edits.push(Edit { name, path: names.collect(), text: set.value.clone() });
    }
    let fields: Vec<_> = engine.placed_fields().collect();
    for field in fields {
        let ty = match check_line(engine, &field.shown).0 {
            Some(Line::Expr(hir::Expr { ty, .. })) => ty,
            _ => Ty::Any,
        };
        let text = as_script(&Tensor { shape: field.shape, data: field.data }, &ty);
        edits.push(Edit { name: field.name, path: field.path, text });
    }
    script_with_values(engine, root, &[], edits, to)
}

/// The same for a report, unless it is too long for one: then nothing is written that nobody would see.
pub fn script_of_report(engine: &mut Engine, overrides: &[Override]) -> Result<Option<String>, Diagnostic> {
    let params = moved(engine)?.iter().map(|(_, tensor)| tensor.data.len()).sum::<usize>();
    let fields = engine.placed_fields().map(|field| field.data.len()).sum::<usize>();
    let others = engine.renewed_values().iter().filter_map(|(_, value)| value.var()).map(Var::len).sum::<usize>();
    // Each number takes at least three bytes: `0, `.
    let is_short = params + fields + others <= LONGEST_SCRIPT / 3;
    if is_short { found_script(engine, overrides, None).map(|script| Some(script.text)) } else { Ok(None) }
}

/// The file `root` and the lines `typed` since, each with only what still holds. Params that moved have their present values, and what
/// `others` name has theirs; where that is not written in these texts, a comment at the end says it. If the text is to lie in the folder `to`,
/// its relative paths begin there.
pub fn script_with_values(
    engine: &mut Engine,
    root: Option<SourceId>,
    typed: &[SourceId],
    others: Vec<Edit>,
    to: Option<&Path>,
) -> Result<Script, Diagnostic> {
    let sources = engine.program().sources.clone();
    let edits = others.into_iter().chain(moved_params(engine)?).chain(given_values(engine, typed));
    let mut pending: Vec<(Edit, bool)> = edits.map(|edit| (edit, false)).collect();
    let way = to.and_then(|to| Way::between(to, &engine.options().base_dir));
    let mut paths = way.map_or(Paths::default(), |way| Paths::of(engine, way));
    let mut out = String::new();
    // What names stand for, as `Program::find` has it.
    let mut declared: HashMap<&str, SourceId> = HashMap::new();
    let program = engine.program();
    for id in program.ids().filter(|id| program.decl(*id).user) {
        let decl = program.decl(id);
        declared.entry(&decl.name).or_insert(decl.name_span.source);
    }
    for source in root.into_iter().chain(typed.iter().copied()) {
        let Some(file) = sources.get(source) else { continue };
        let mut edits: Vec<(usize, usize, String)> = Vec::new();
        // What a later line declares anew is left out here, and so is what a line did but not declare.
        for statement in crate::syntax::parse(&sources, source).0.statements {
            let holds = match statement.declares() {
                Some(name) => declared.get(name).is_none_or(|of| *of == source),
                None => Some(source) == root || matches!(statement.kind, StatementKind::Import(_)),
            };
            if !holds {
                edits.push((statement.span.start as usize, statement.span.end as usize, String::new()));
                continue;
            }
            if let StatementKind::Import(import) = &statement.kind {
                paths.add_import(import, &file.text);
            }
            for (edit, done) in &mut pending {
                if statement.declares() != Some(&edit.name) {
                    continue;
                }
                if let Some(span) = place(&statement.kind, &edit.path) {
                    *done |= put(&mut edits, span, &edit.text);
                } else if let Some(span) = before_prior(&statement.kind).filter(|_| edit.path.is_empty()) {
                    *done |= put(&mut edits, span, &format!(" = {}", edit.text));
                }
            }
        }
        paths.put(source, &mut edits);
        let mut text = file.text.clone();
        edits.sort_by_key(|edit| std::cmp::Reverse(edit.0));
        for (start, end, new) in edits {
            if text.get(start..end).is_some() {
                text.replace_range(start..end, &new);
            }
        }
        if !text.trim().is_empty() || Some(source) == root {
            out.push_str(text.trim_end());
            out.push('\n');
        }
    }
    let elsewhere: String = pending.iter().filter(|(_, done)| !done).map(|(edit, _)| edit.as_comment()).collect();
    if !elsewhere.is_empty() {
        out.push_str(&format!("\n// Values of what is not written above:\n{elsewhere}"));
    }
    let mut sources = SourceMap::new();
    let source = sources.add("script", None, out.as_str());
    // What cannot be laid out is still the script, and what is mostly numbers is not read for its layout.
    let lost = paths.lost;
    if out.len() > LONGEST_LAID_OUT {
        return Ok(Script { text: out, lost });
    }
    Ok(Script { text: crate::syntax::format(&sources, source).unwrap_or(out), lost })
}

/// The way from a folder to another one, as the beginning of a path: `../meshes/`.
struct Way(String);

impl Way {
    /// `None` if both are the same folder.
    fn between(from: &Path, to: &Path) -> Option<Way> {
        let (from, to) = (real(from), real(to));
        let same = from.components().zip(to.components()).take_while(|(a, b)| a == b).count();
        let up = from.components().skip(same).map(|_| "..".to_owned());
        let down = to.components().skip(same).map(|part| part.as_os_str().to_string_lossy().into_owned());
        // On another disk there is no way.
        let parts: Vec<String> = if same == 0 { vec![to.display().to_string()] } else { up.chain(down).collect() };
        let escaped = parts.join("/").replace('\\', "\\\\").replace('"', "\\\"").replace('{', "{{").replace('}', "}}");
        (!parts.is_empty()).then(|| Way(format!("{escaped}/")))
    }
}

/// The full path of a folder that may not be there yet, as the system has it.
fn real(path: &Path) -> PathBuf {
    let path = if path.as_os_str().is_empty() { Path::new(".") } else { path };
    let whole = check::normal(&std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf()));
    let there = whole.ancestors().find_map(|part| Some((part, part.canonicalize().ok()?)));
    let below = |(part, found): (&Path, PathBuf)| Some(found.join(whole.strip_prefix(part).ok()?));
    there.and_then(below).unwrap_or(whole)
}

/// The relative paths of a script that is written to another folder.
#[derive(Default)]
struct Paths {
    way: Option<Way>,
    /// By source, where paths begin.
    begins: HashMap<SourceId, Vec<usize>>,
    lost: Vec<String>,
}

impl Paths {
    /// Those that the natives of a program read which take paths to files.
    fn of(engine: &Engine, way: Way) -> Paths {
        let program = engine.program();
        // What is declared by means of another declaration is walked through once for each.
        let mut found: BTreeMap<(SourceId, u32), (Span, bool)> = BTreeMap::new();
        let mut look = |e: &hir::Expr| {
            check::walk(e, &mut |e| {
                for (path, is_written) in read_paths(program, e) {
                    let span = if is_written { path } else { e.span };
                    found.entry((span.source, span.start)).or_insert((span, is_written));
                }
            });
        };
        for decl in program.ids().map(|id| program.decl(id)).filter(|decl| decl.user) {
            decl.body.as_deref().into_iter().for_each(&mut look);
            if let hir::DeclKind::Fn(function) = &decl.kind {
                look(&function.body);
            }
        }
        program.actions.iter().flat_map(hir::Action::parts).for_each(&mut look);
        let mut paths = Paths { way: Some(way), ..Paths::default() };
        let is_own = |source| Some(source) == program.origin.main || program.origin.lines.contains(&source);
        for (span, is_written) in found.into_values().filter(|(span, _)| is_own(span.source)) {
            let text = program.sources.text(span);
            if is_written {
                paths.add(span, text);
            } else {
                paths.lost.push(text.split_whitespace().collect::<Vec<&str>>().join(" "));
            }
        }
        paths
    }

    /// A path between quotes.
    fn add(&mut self, span: Span, text: &str) {
        let is_relative = text.strip_prefix('"').is_some_and(|path| Path::new(path).is_relative());
        if self.way.is_some() && is_relative {
            self.begins.entry(span.source).or_default().push(span.start as usize + 1);
        }
    }

    fn add_import(&mut self, import: &Import, text: &str) {
        let written = text.get(import.span.start as usize..import.span.end as usize).unwrap_or("");
        if let (ImportFrom::File(_), Some(quote)) = (&import.from, written.find('"')) {
            let span = Span { start: import.span.start + quote as u32, ..import.span };
            self.add(span, &written[quote..]);
        }
    }

    /// Lets the paths of a source begin in the other folder, unless they are replaced as a whole.
    fn put(&self, source: SourceId, edits: &mut Vec<(usize, usize, String)>) {
        let Some(Way(way)) = &self.way else { return };
        for at in self.begins.get(&source).into_iter().flatten() {
            put(edits, Span::new(source, *at, *at), way);
        }
    }
}

/// The paths that a call reads: where they stand, and whether they begin as they are written.
fn read_paths(program: &hir::Program, e: &hir::Expr) -> Vec<(Span, bool)> {
    let hir::ExprKind::Call(call) = &e.kind else { return Vec::new() };
    let hir::Callee::Native(id) = call.callee else { return Vec::new() };
    if !check::READERS.contains(&program.decl(id).name.as_str()) {
        return Vec::new();
    }
    let Some(Some(path)) = call.args.first() else { return Vec::new() };
    match &path.kind {
        hir::ExprKind::Str(parts) => vec![(path.span, matches!(parts.first(), Some(hir::StrPart::Text(_))))],
        _ if path.ty == Ty::Str => vec![(path.span, false)],
        // Textures and environments are made of pictures too.
        _ => Vec::new(),
    }
}

/// Bytes of the longest script that is laid out, which takes many times its length of memory.
const LONGEST_LAID_OUT: usize = 1 << 20;

/// Memory that a number takes on its way into a script: some 20 bytes in each of the texts that it passes through.
const BYTES_OF_NUMBER: u64 = 100;

/// The most numbers of a given value that are written out.
const MOST_NUMBERS: usize = 4096;

/// What was given its value in the lines `typed`, as far as text can hold it; the rest stays the expression that it came from.
fn given_values(engine: &Engine, typed: &[SourceId]) -> Vec<Edit> {
    let program = engine.program();
    let is_typed = |id: hir::DeclId| typed.contains(&program.decl(id).span.source);
    let given = engine.given_values().into_iter().filter(|(id, _)| is_typed(*id));
    let edit = |(id, value): (hir::DeclId, Value)| {
        let decl = program.decl(id);
        let text = match &value {
            Value::Bool(b) => b.to_string(),
            Value::Transform(_) | Value::Texture(_) => return None,
            other => match other.var().filter(|v| v.len() <= MOST_NUMBERS && v.value().is_finite()) {
                Some(var) => as_script(var.value(), &decl.ty),
                None => return None,
            },
        };
        Some(Edit { name: decl.name.clone(), path: Vec::new(), text })
    };
    given.filter_map(edit).collect()
}

impl Edit {
    fn as_comment(&self) -> String {
        let name: Vec<&str> = std::iter::once(&self.name).chain(&self.path).map(String::as_str).collect();
        format!("// {} = {}\n", name.join("."), self.text)
    }
}

/// The params that have left their initial values, and where they are.
fn moved(engine: &mut Engine) -> Result<Vec<(hir::DeclId, Tensor)>, Diagnostic> {
    let mut found = Vec::new();
    for id in engine.program().params().collect::<Vec<_>>() {
        let present = engine.param_value(id)?;
        let Some(body) = engine.program().decl(id).body.clone() else { continue };
        let initial = engine.eval(&body)?;
        if !initial.var().is_some_and(|v| same_bits(v.value(), &present)) {
            found.push((id, present));
        }
    }
    Ok(found)
}

/// The values of what has moved, as texts.
fn moved_params(engine: &mut Engine) -> Result<Vec<Edit>, Diagnostic> {
    let mut found = Vec::new();
    for (id, present) in moved(engine)? {
        memory::ask(present.data.len() as u64 * BYTES_OF_NUMBER).map_err(|e| {
            let help = "`dsl export RUN --format npy` writes params as arrays, `--format safetensors` as one file";
            Diagnostic::error("dscene::run::memory", e.to_string()).help(help)
        })?;
        let decl = engine.program().decl(id);
        found.push(Edit { name: decl.name.clone(), path: Vec::new(), text: as_script(&present, &decl.ty) });
    }
    for (id, value) in engine.renewed_values() {
        let decl = engine.program().decl(id);
        let Some(var) = value.var() else {
            let message = format!("a script cannot hold {}, which a stage made of `{}`", value.kind(), decl.name);
            return Err(Diagnostic::error("dscene::run::export", message)
                .label(decl.name_span, "declared anew")
                .help("export what was found as arrays or meshes: `--format npy`, `--format obj`"));
        };
        found.push(Edit { name: decl.name.clone(), path: Vec::new(), text: as_script(var.value(), &decl.ty) });
    }
    Ok(found)
}

/// Where a param without an initial value has its prior: what it has found is written before that.
fn before_prior(statement: &StatementKind) -> Option<Span> {
    let StatementKind::Param(param) = statement else { return None };
    let end = param.ty.as_ref().map_or(param.name.span.end, |ty| ty.span.end);
    param.value.is_none().then_some(Span { start: end, end, ..param.name.span })
}

/// The span of the declared value in a statement, or of the field at `path`; `None` if the field is not written out.
fn place(statement: &StatementKind, path: &[String]) -> Option<Span> {
    match statement {
        StatementKind::Param(param) => within(param.value.as_ref()?, path),
        StatementKind::Let { value, .. }
        | StatementKind::Loss { value, .. }
        | StatementKind::Kind { body: KindBody::Value(value), .. } => within(value, path),
        StatementKind::Kind { body: KindBody::Fields(fields), .. } => {
            let (first, rest) = path.split_first()?;
            within(&fields.iter().find(|f| f.name.text == *first)?.value, rest)
        }
        StatementKind::Fn(_) | StatementKind::Import(_) | StatementKind::Action(_) | StatementKind::Test(_) => None,
    }
}

/// The field of what a call makes is an argument of that name.
fn within(value: &Expr, path: &[String]) -> Option<Span> {
    let Some((first, rest)) = path.split_first() else { return Some(value.span) };
    if let ExprKind::Record(fields) = &value.kind {
        let field = fields.iter().find(|f| f.name.text == *first)?;
        // `{ place }` has no place for another value of its own.
        return if field.name.span == field.value.span { None } else { within(&field.value, rest) };
    }
    let ExprKind::Call { args, .. } = &value.kind else { return None };
    let argument = args.iter().find(|a| a.name.as_ref().is_some_and(|name| name.text == *first))?;
    within(&argument.value, rest)
}

/// Adds an edit, or replaces the one of the same span. Returns false if it overlaps with another edit.
fn put(edits: &mut Vec<(usize, usize, String)>, span: Span, text: &str) -> bool {
    let (start, end) = (span.start as usize, span.end as usize);
    if let Some(same) = edits.iter_mut().find(|(s, e, _)| (*s, *e) == (start, end)) {
        text.clone_into(&mut same.2);
        return true;
    }
    let is_free = edits.iter().all(|(s, e, _)| end <= *s || *e <= start);
    if is_free {
        edits.push((start, end, text.to_owned()));
    }
    is_free
}

fn same_bits(a: &Tensor, b: &Tensor) -> bool {
    a.shape == b.shape && a.data.iter().zip(&b.data).all(|(x, y)| x.to_bits() == y.to_bits())
}

/// Numbers to their last bit, nested by their shape.
pub fn numbers(shape: &[usize], data: &[f64]) -> String {
    let text = serde_json::to_string(&Nested { shape, data }).unwrap_or_default();
    text.replace(',', ", ").replace('"', "")
}

/// A param's value to its last bit, as an expression of its type.
pub fn as_script(t: &Tensor, ty: &Ty) -> String {
    let numbers = || numbers(&t.shape, &t.data);
    match (ty, t.item()) {
        (Ty::Angle, Some(x)) => {
            // In degrees where that is the same number.
            let degrees = (x.to_degrees() * 1e9).round() / 1e9;
            if (degrees * std::f64::consts::PI / 180.0).to_bits() == x.to_bits() {
                format!("{degrees}deg")
            } else {
                format!("{}rad", self::numbers(&[], &[x]))
            }
        }
        // As an array of numbers it would have lost its unit.
        (ty, None) if is_angle(ty) => format!("{} * 1rad", numbers()),
        (Ty::Rotation, _) => format!("rotation(matrix: {})", numbers()),
        (Ty::Image { .. }, _) => format!("image({})", numbers()),
        _ => numbers(),
    }
}
