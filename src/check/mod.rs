//! From trees to a typed program: names, imports, types, units, shapes, dataflow.
//!
//! Types are inferred by running the program on types: every declaration is checked when it is first needed, and the
//! body of a function once for each combination of argument types.

pub(crate) mod actions;
mod apply;
mod arguments;
mod arith;
mod arrays;
mod asked;
mod call;
mod camera;
mod counts;
mod declare;
mod declared;
mod derivative;
mod domains;
mod fields;
mod flow;
pub mod hir;
mod infer;
mod inputs;
mod items;
mod kinds;
mod known;
mod library;
mod lines;
mod lints;
mod loaded;
mod log;
mod misfits;
mod modules;
mod near;
mod operands;
mod other_files;
pub(crate) mod params;
mod paths;
pub(crate) mod plot;
mod record;
mod rendered;
mod replaced;
mod results;
mod schedules;
mod shapes;
mod signature;
pub(crate) mod stages;
mod sweep;
mod targets;
mod test;
pub(crate) mod text;
mod trial;
pub mod types;
mod understanding;
mod unknown;

use std::io;
use std::path::Path;
use std::sync::Arc;

use crate::diag::{self, Diagnostic};
use crate::source::{SourceId, SourceMap};

pub(crate) use arrays::MAX_ITEMS;
pub(crate) use domains::domain_of_field;
pub use domains::{Reached, domains, kept_inside};
pub(crate) use fields::{field_type, fields_of, type_of};
pub(crate) use flow::{children, walk};
pub(crate) use known::READERS;
pub(crate) use library::{library_modules, library_text};
use lines::Known;
pub(crate) use lines::check_given;
pub use lines::{LINE, Line, check_expression, check_line};
pub use lints::LINTS;
pub(crate) use lints::{
    FACING_AWAY, INSIDE_OUT, MISSING_CAUSTIC, NO_BOUNDARY, OPEN_BODY, SHARED_FACE, is_allowed, without_boundary,
};
use modules::Checker;
pub use modules::ModuleId;
pub(crate) use modules::{PRELUDE, is_private};
pub(crate) use paths::normal;
pub(crate) use signature::Sig;
pub use signature::TYPE_NAMES;
pub(crate) use sweep::{SEED, unused};
pub use understanding::{Understanding, understand};

/// The outside world as the checker sees it.
pub trait Loader {
    /// The text of a file. An error of kind `InvalidData` if it is not UTF-8.
    fn read(&self, path: &Path) -> io::Result<String>;
    /// Whether there is a file of that path. Nothing is read of it.
    fn exists(&self, path: &Path) -> bool;
}

/// Files on disk.
#[derive(Clone, Copy, Debug, Default)]
pub struct Disk;

impl Loader for Disk {
    fn read(&self, path: &Path) -> io::Result<String> {
        let bytes = crate::files::read(path)?;
        // A byte order mark, which some editors write, is not part of the text.
        let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
        let text = std::str::from_utf8(bytes).map_err(|e| io::Error::new(io::ErrorKind::InvalidData, e.to_string()))?;
        Ok(with_line_ends(text))
    }

    fn exists(&self, path: &Path) -> bool {
        // Files that a script names are read when their values are needed.
        crate::files::note_input(path);
        crate::files::exists(path)
    }
}

/// A text whose lines end as those of old Macintosh computers do, with line ends of today: to the end of a comment all would be one line.
pub fn with_line_ends(text: &str) -> String {
    if text.contains('\n') { text.to_owned() } else { text.replace('\r', "\n") }
}

/// The result of checking: the program if there are no errors, all diagnostics in source order, and the sources that they refer to.
pub struct Checked {
    /// The program; `None` if there are errors.
    pub program: Option<hir::Program>,
    /// Errors and warnings, in source order and each once.
    pub diagnostics: Vec<Diagnostic>,
    /// The texts to which the diagnostics refer.
    pub sources: SourceMap,
    /// The file or text itself: other sources are of the library, and imported ones.
    pub main: SourceId,
}

impl Checked {
    /// Of a text that could not be read.
    pub fn unread(why: Diagnostic) -> Checked {
        let mut sources = library::sources();
        let main = sources.add("", None, "");
        Checked { program: None, diagnostics: vec![why], sources, main }
    }
}

/// What a script is checked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// The program is run as it is.
    Run,
    /// Expressions and lines are to be checked against it ([`check_line`]). What the check knows beside the program is kept for them; otherwise
    /// the first of them has everything checked again.
    Lines,
}

/// Checks a file. `overrides` are `--set NAME=EXPR`: they replace the values of declarations of the file.
pub fn check(path: &Path, overrides: &[(String, String)], loader: &(dyn Loader + Sync)) -> Checked {
    check_for(Purpose::Run, path, overrides, loader)
}

/// The same for a given purpose.
pub fn check_for(
    purpose: Purpose,
    path: &Path,
    overrides: &[(String, String)],
    loader: &(dyn Loader + Sync),
) -> Checked {
    match read_script(path, loader) {
        Ok(text) => check_text_for(purpose, &path.display().to_string(), Some(path), text, overrides, loader),
        Err(why) => Checked::unread(why),
    }
}

/// The text of a script, or why it is none.
pub fn read_script(path: &Path, loader: &dyn Loader) -> Result<String, Diagnostic> {
    match loader.read(path) {
        Err(error) if error.kind() != io::ErrorKind::InvalidData => Err(unreadable(path, &error)),
        read => match other_files::no_script(path) {
            Some(why) => Err(why),
            None => read.map_err(|error| unreadable(path, &error)),
        },
    }
}

fn unreadable(path: &Path, error: &io::Error) -> Diagnostic {
    let shown = path.display();
    let reason = match error.kind() {
        io::ErrorKind::NotFound => "there is no such file".to_owned(),
        io::ErrorKind::InvalidData => "it is not a text (not valid UTF-8)".to_owned(),
        _ => crate::files::describe_io(error),
    };
    Diagnostic::error("dscene::file::unreadable", format!("cannot read `{shown}`: {reason}"))
}

/// Checks a text. `path` is where it lies, if it does: imports and files are looked up beside it.
pub fn check_text(
    name: &str,
    path: Option<&Path>,
    text: impl Into<String>,
    overrides: &[(String, String)],
    loader: &(dyn Loader + Sync),
) -> Checked {
    check_text_for(Purpose::Run, name, path, text, overrides, loader)
}

/// The same for a given purpose.
pub fn check_text_for(
    purpose: Purpose,
    name: &str,
    path: Option<&Path>,
    text: impl Into<String>,
    overrides: &[(String, String)],
    loader: &(dyn Loader + Sync),
) -> Checked {
    let mut sources = library::sources();
    let main = sources.add(name, path, text);
    let overrides = overrides
        .iter()
        .map(|(name, expr)| (name.clone(), sources.add(format!("--set {name}"), path, expr.as_str())))
        .collect();
    let origin = hir::Origin { main: Some(main), overrides, ..Default::default() };
    with_room(move || {
        let mut checker = Checker::new(sources, loader);
        checker.run(origin);
        let known = match purpose {
            Purpose::Run => Known::default(),
            Purpose::Lines => Known::of(Arc::new(checker.knowledge())),
        };
        let (mut program, mut diagnostics, sources) = checker.finish();
        program.known = known;
        diag::sort(&mut diagnostics);
        let failed = diagnostics.iter().any(Diagnostic::is_error);
        Checked { program: (!failed).then_some(program), diagnostics, sources, main }
    })
}

/// The declarations of the standard library (and nothing else), for documentation and completion.
pub fn library() -> hir::Program {
    let checked = check_text("<empty>", None, "", &[], &Disk);
    checked.program.unwrap_or_default()
}

/// Runs `work`, growing the stack if necessary: each declaration is checked within the one that needs it, and such chains may be as long
/// as a script.
fn with_room<R>(work: impl FnOnce() -> R) -> R {
    const NEEDED: usize = 256 << 10;
    const GROWN: usize = 8 << 20;
    stacker::maybe_grow(NEEDED, GROWN, work)
}

#[cfg(test)]
mod tests;
