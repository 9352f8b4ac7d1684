//! The lints about what is read from a file of data, as far as the file can be read before the program runs: fields that it does not have, and
//! its numbers, which have no unit, where angles are expected.

use std::collections::HashMap;
use std::path::Path;
use std::rc::Rc;

use serde_json::Value as Json;

use super::Loader;
use super::flow::below;
use super::hir::*;
use super::signature::Sig;
use super::targets::native_call;
use crate::data::table;
use crate::diag::{Diagnostic, did_you_mean};
use crate::files;
use crate::source::Span;

/// Larger files are not read for it: editors check with every key.
const MAX_BYTES: u64 = 1 << 20;
/// Items of lists that are looked at, and records whose fields are compared.
const MOST: usize = 4096;
/// How deeply declarations are followed.
const DEPTH: usize = 32;

/// Warnings about what `load_json` and `load_table` give to these expressions.
pub fn check(program: &Program, roots: &[&Expr], loader: &dyn Loader) -> Vec<Diagnostic> {
    let mut reader = Reader { program, loader, files: HashMap::new(), told: Vec::new() };
    roots.iter().for_each(|root| reader.look(root, &Names::new()));
    // `param tilt: angle = data.tilt`
    for decl in program.ids().map(|id| program.decl(id)).filter(|decl| decl.user && decl.ty.is_angle()) {
        decl.body.iter().for_each(|body| reader.ask_for_unit(body, &Names::new()));
    }
    reader.told
}

/// What an expression may be: one of these parts of the file that is read at a place.
#[derive(Clone)]
struct Part {
    file: Rc<File>,
    /// Ways from the top of the file to its parts: the indices of lists and of a record's fields.
    ways: Vec<Vec<usize>>,
}

struct File {
    name: String,
    place: Span,
    content: Json,
}

type Names = HashMap<LocalId, Part>;

struct Reader<'p> {
    program: &'p Program,
    loader: &'p dyn Loader,
    /// By the place of their names; `None` if they cannot be read.
    files: HashMap<Span, Option<Rc<File>>>,
    told: Vec<Diagnostic>,
}

impl Part {
    fn values(&self) -> impl Iterator<Item = &Json> {
        self.ways.iter().filter_map(|way| self.file.at(way))
    }

    /// The items of what must be lists; all of them, or the one of an index.
    fn items(&self, index: Option<f64>) -> Option<Part> {
        let mut ways = Vec::new();
        for way in &self.ways {
            let Json::Array(items) = self.file.at(way)? else { return None };
            let of = |i: usize| [&way[..], &[i]].concat();
            match index {
                None => ways.extend((0..items.len().min(MOST)).map(of)),
                Some(i) => {
                    let at = if i < 0.0 { i + items.len() as f64 } else { i };
                    ways.extend((at >= 0.0 && at < items.len() as f64).then(|| of(at as usize)));
                }
            }
        }
        (!ways.is_empty() && ways.len() <= MOST).then(|| Part { file: self.file.clone(), ways })
    }

    /// The values of a field, where it is.
    fn field(&self, name: &str) -> Option<Part> {
        let of = |way: &Vec<usize>| match self.file.at(way)? {
            Json::Object(fields) => Some([&way[..], &[fields.keys().position(|key| key == name)?]].concat()),
            _ => None,
        };
        let ways: Vec<Vec<usize>> = self.ways.iter().filter_map(of).collect();
        (!ways.is_empty()).then(|| Part { file: self.file.clone(), ways })
    }
}

impl File {
    fn at(&self, way: &[usize]) -> Option<&Json> {
        way.iter().try_fold(&self.content, |json, &i| match json {
            Json::Array(items) => items.get(i),
            Json::Object(fields) => fields.values().nth(i),
            _ => None,
        })
    }
}

impl Reader<'_> {
    /// Looks at all fields and angles in an expression.
    fn look(&mut self, e: &Expr, names: &Names) {
        match &e.kind {
            ExprKind::Field { base, name } => {
                self.look(base, names);
                if let Some(part) = self.part(base, names, DEPTH) {
                    self.compare(&part, e, name);
                }
            }
            ExprKind::Comprehension(c) => {
                let mut inner = names.clone();
                for clause in &c.clauses {
                    self.look(&clause.items, &inner);
                    self.bind(clause, &mut inner);
                    clause.condition.iter().for_each(|condition| self.look(condition, &inner));
                }
                self.look(&c.element, &inner);
            }
            ExprKind::Let { lets, body } => {
                let mut inner = names.clone();
                for (local, value) in lets {
                    self.look(value, &inner);
                    inner.extend(self.part(value, &inner, DEPTH).map(|part| (*local, part)));
                }
                self.look(body, &inner);
            }
            _ => {
                angles(self.program, e).into_iter().for_each(|angle| self.ask_for_unit(angle, names));
                below(e).into_iter().for_each(|child| self.look(child, names));
            }
        }
    }

    /// Notes what the names of a clause stand for: one name takes an item, several take those of zipped lists.
    fn bind(&mut self, clause: &ForClause, names: &mut Names) {
        let lists: Vec<&Expr> = match (&clause.locals[..], native_call(self.program, &clause.items, "zip")) {
            ([_], _) => vec![&clause.items],
            (_, Some(call)) => call.args.iter().flatten().collect(),
            _ => Vec::new(),
        };
        for (local, list) in clause.locals.iter().zip(lists) {
            if let Some(part) = self.part(list, names, DEPTH).and_then(|part| part.items(None)) {
                names.insert(*local, part);
            }
        }
    }

    /// The part of a file that an expression is.
    fn part(&mut self, e: &Expr, names: &Names, depth: usize) -> Option<Part> {
        let depth = depth.checked_sub(1)?;
        match &e.kind {
            ExprKind::Local(local) => names.get(local).cloned(),
            ExprKind::Decl(id) => {
                let program = self.program;
                let decl = program.decl(*id);
                // What is declared as an angle is one, and was told of there.
                let passed_on = matches!(decl.kind, DeclKind::Let) && !decl.ty.is_angle();
                let body = decl.body.as_deref().filter(|_| passed_on)?;
                self.part(body, &Names::new(), depth)
            }
            ExprKind::Declared(declared) => self.part(&declared.value, names, depth),
            ExprKind::Field { base, name } => self.part(base, names, depth)?.field(name),
            ExprKind::Slice { base, .. } => {
                let part = self.part(base, names, depth)?;
                let are_lists = part.values().all(Json::is_array);
                are_lists.then_some(part)
            }
            ExprKind::Index { base, index } => {
                let at = match &index.kind {
                    ExprKind::Number(x) => Some(*x),
                    ExprKind::Unary { op: UnaryOp::Neg, operand } => match operand.kind {
                        ExprKind::Number(x) => Some(-x),
                        _ => None,
                    },
                    _ => None,
                };
                self.part(base, names, depth)?.items(at)
            }
            ExprKind::Call(call) => {
                let reads_json = native_call(self.program, e, "load_json").is_some();
                if !reads_json && native_call(self.program, e, "load_table").is_none() {
                    return None;
                }
                let path = call.args.first()?.as_ref()?;
                let ExprKind::Str(parts) = &path.kind else { return None };
                let [StrPart::Text(name)] = &parts[..] else { return None };
                if !self.files.contains_key(&path.span) {
                    let content = self.read(name, reads_json);
                    let file = content.map(|content| Rc::new(File { name: name.clone(), place: path.span, content }));
                    self.files.insert(path.span, file);
                }
                let file = self.files.get(&path.span)?.clone()?;
                Some(Part { file, ways: vec![Vec::new()] })
            }
            _ => None,
        }
    }

    /// What a file holds; a table is a record of its columns.
    fn read(&self, name: &str, is_json: bool) -> Option<Json> {
        let main = self.program.origin.main?;
        let folder = self.program.sources.get(main)?.path.as_deref().and_then(Path::parent).unwrap_or(Path::new(""));
        let path = folder.join(name);
        if !files::is_ordinary_up_to(&path, MAX_BYTES) {
            return None;
        }
        let text = self.loader.read(&path).ok()?;
        if is_json {
            return serde_json::from_str(&text).ok();
        }
        match table::decode(text.as_bytes()).ok()?.0 {
            table::Table::Rows(_) => None,
            table::Table::Columns(columns) => {
                let content = |column| match column {
                    table::Column::Numbers(numbers) => Json::from(numbers),
                    table::Column::Words(words) => Json::from(words),
                };
                Some(Json::Object(columns.into_iter().map(|(name, column)| (name, content(column))).collect()))
            }
        }
    }

    /// Tells of numbers of a file that count as radians where an angle is expected.
    fn ask_for_unit(&mut self, e: &Expr, names: &Names) {
        let Some(part) = self.part(e, names, DEPTH).filter(|part| part.values().all(are_numbers)) else { return };
        let name = &part.file.name;
        let text = self.program.sources.text(e.span);
        let message = format!("numbers of `{name}` have no unit: where an angle is expected they are radians");
        self.tell(
            Diagnostic::warning("dscene::lint::missing_unit", message)
                .label(e.span, "radians")
                .label(part.file.place, "read from this file")
                .help(format!("say what they are: `{text} * 1deg`, or `{text} * 1rad`")),
        );
    }

    /// Each place is told of once.
    fn tell(&mut self, warning: Diagnostic) {
        if !self.told.iter().any(|told| told.span() == warning.span()) {
            self.told.push(warning);
        }
    }

    /// Tells of a field that none of the records has.
    fn compare(&mut self, part: &Part, e: &Expr, name: &str) {
        let mut known: Vec<&str> = Vec::new();
        for value in part.values() {
            let Json::Object(fields) = value else { return };
            if fields.contains_key(name) {
                return;
            }
            known.extend(fields.keys().map(String::as_str).filter(|key| !known.contains(key)).collect::<Vec<_>>());
        }
        let length = u32::try_from(name.len()).unwrap_or(0);
        let own = Span { start: e.span.end.saturating_sub(length), ..e.span };
        let place = if self.program.sources.text(own) == name { own } else { e.span };
        let file = &part.file;
        let what = if file.name.to_lowercase().ends_with(".json") { "has no field" } else { "has no column" };
        self.tell(
            Diagnostic::warning("dscene::lint::missing_field", format!("`{}` {what} `{name}` here", file.name))
                .label(place, "not in the file")
                .label(file.place, "read from this file")
                .help_opt(did_you_mean(name, "it has", known)),
        );
    }
}

/// The operands of an expression that must be angles.
fn angles<'p>(program: &'p Program, e: &'p Expr) -> Vec<&'p Expr> {
    use BinaryOp::*;
    match &e.kind {
        ExprKind::Call(call) => {
            let (Callee::Native(id) | Callee::Decl(id)) = call.callee else { return Vec::new() };
            let takes: Vec<&Sig> = match &program.decl(id).kind {
                DeclKind::Native(native) => native.params.iter().map(|param| &param.takes).collect(),
                DeclKind::Fn(function) => function.params.iter().map(|param| &param.takes).collect(),
                _ => Vec::new(),
            };
            takes
                .iter()
                .zip(&call.args)
                .filter(|(takes, _)| takes.wants_angles())
                .filter_map(|(_, arg)| arg.as_ref())
                .collect()
        }
        ExprKind::Binary { op: Add | Sub | Eq | Ne | Lt | Le | Gt | Ge, left, right } => {
            match (left.ty.is_angle(), right.ty.is_angle()) {
                (true, false) => vec![right],
                (false, true) => vec![left],
                _ => Vec::new(),
            }
        }
        _ => Vec::new(),
    }
}

fn are_numbers(value: &Json) -> bool {
    match value {
        Json::Number(_) => true,
        Json::Array(items) => !items.is_empty() && items.iter().all(are_numbers),
        _ => false,
    }
}
