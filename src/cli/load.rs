//! From a file on the command line to an engine.

use std::io::{self, Read};
use std::mem::ManuallyDrop;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, PoisonError};

use super::args::Common;
use crate::check::{self, Checked, Disk, Line, Loader, Purpose, hir};
use crate::diag::Diagnostic;
use crate::eval::{Engine, EngineOptions};
use crate::files::{Stamp, stamp};
use crate::ranks;
use crate::session::line::check_line;
use crate::session::{World, world};

/// A script that may run.
pub struct Loaded {
    /// What the check had to say.
    pub warnings: Vec<Diagnostic>,
    /// The process ends with it: to free millions of values one by one would only delay that.
    pub engine: ManuallyDrop<Engine>,
}

/// The file that stands for standard input.
pub const STDIN: &str = "-";

/// Reads and checks a file with the `--set` overrides.
pub fn check_file(file: &Path, common: &Common) -> Checked {
    check_file_by(Purpose::Run, file, common, &Disk)
}

/// The same for a file that expressions or lines are to be checked against.
pub fn check_file_for_lines(file: &Path, common: &Common) -> Checked {
    check_file_by(Purpose::Lines, file, common, &Disk)
}

/// The same with another way to read files.
pub fn check_file_by(purpose: Purpose, file: &Path, common: &Common, loader: &(dyn Loader + Sync)) -> Checked {
    let overrides: Vec<(String, String)> = common.set.iter().map(|o| (o.name.clone(), o.value.clone())).collect();
    if file != Path::new(STDIN) {
        return check::check_for(purpose, file, &overrides, loader);
    }
    // What it imports lies in the working directory.
    let name = "<stdin>";
    match read_stdin() {
        Ok(text) => check::check_text_for(purpose, name, Some(Path::new(name)), text, &overrides, loader),
        Err(diagnostic) => Checked::unread(diagnostic),
    }
}

/// The disk, which remembers what it was asked for, and how that was then.
#[derive(Default)]
pub struct Noting(Mutex<Vec<(PathBuf, Stamp)>>);

impl Noting {
    /// All of it, each once.
    pub fn asked(self) -> Vec<(PathBuf, Stamp)> {
        self.0.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    fn note(&self, path: &Path) {
        let mut asked = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if !asked.iter().any(|(known, _)| known == path) {
            asked.push((path.to_path_buf(), stamp(path)));
        }
    }
}

impl Loader for Noting {
    fn read(&self, path: &Path) -> io::Result<String> {
        self.note(path);
        Disk.read(path)
    }

    fn exists(&self, path: &Path) -> bool {
        self.note(path);
        Disk.exists(path)
    }
}

/// The script that comes from standard input.
pub fn read_stdin() -> Result<String, Diagnostic> {
    let read = |_: &Path| {
        let mut bytes = Vec::new();
        std::io::stdin().read_to_end(&mut bytes).map(|_| bytes)
    };
    let bytes = ranks::read_by_first(Path::new(STDIN), read);
    let text = bytes.and_then(|bytes| String::from_utf8(bytes).map_err(io::Error::other));
    text.map(|text| check::with_line_ends(&text)).map_err(|error| {
        let message = format!("cannot read standard input: {}", crate::files::describe_io(&error));
        Diagnostic::error("dscene::file::unreadable", message)
    })
}

/// An error if the script would come from standard input, for what reads it more than once or later.
pub fn require_file(file: &Path) -> Result<(), Diagnostic> {
    if file != Path::new(STDIN) {
        return Ok(());
    }
    Err(Diagnostic::error(
        "dscene::cli::stdin",
        "standard input can be read only once, and this needs the script again",
    )
    .help("write the script to a file"))
}

/// Checks a file, for expressions to be evaluated in it, and reports what is wrong; `None` if it cannot run.
pub fn load(file: &Path, common: &Common, world: &mut dyn World) -> Option<Loaded> {
    loaded(check_file_for_lines(file, common), world::interrupt_flag(), file, common, world)
}

/// The same for a file that is run as it is, with a flag that ends evaluations.
pub fn load_stopped_by(flag: Arc<AtomicBool>, file: &Path, common: &Common, world: &mut dyn World) -> Option<Loaded> {
    loaded(check_file(file, common), flag, file, common, world)
}

fn loaded(
    checked: Checked,
    flag: Arc<AtomicBool>,
    file: &Path,
    common: &Common,
    world: &mut dyn World,
) -> Option<Loaded> {
    for diagnostic in &checked.diagnostics {
        world.diagnostic(diagnostic, &checked.sources);
    }
    if checked.diagnostics.iter().any(Diagnostic::is_error) {
        return None;
    }
    let options = EngineOptions { interrupt: Some(flag), ..engine_options(common, file) };
    Some(Loaded { warnings: checked.diagnostics, engine: ManuallyDrop::new(Engine::new(checked.program?, options)) })
}

/// An error if several of the files are standard input, which the first of them takes whole.
pub fn require_one_stdin(files: &[PathBuf]) -> Result<(), Diagnostic> {
    if files.iter().filter(|file| *file == Path::new(STDIN)).count() < 2 {
        return Ok(());
    }
    Err(Diagnostic::error("dscene::cli::stdin", "standard input can be read only once").help("name `-` once"))
}

/// The files themselves, and the scripts in and below the folders among them, by name; not through links, which may lead back or
/// elsewhere, and not in what is hidden.
pub fn scripts(paths: &[PathBuf]) -> Result<Vec<PathBuf>, Diagnostic> {
    require_one_stdin(paths)?;
    let mut found = Vec::new();
    for path in paths {
        if path.is_dir() { below(path, &mut found)? } else { found.push(path.clone()) }
    }
    Ok(found)
}

fn below(folder: &Path, found: &mut Vec<PathBuf>) -> Result<(), Diagnostic> {
    let unreadable = |error: std::io::Error| {
        let (shown, why) = (folder.display(), crate::files::describe_io(&error));
        Diagnostic::error("dscene::file::unreadable", format!("cannot read the folder `{shown}`: {why}"))
    };
    let entries = std::fs::read_dir(folder).map_err(unreadable)?;
    let mut entries = entries.collect::<Result<Vec<_>, _>>().map_err(unreadable)?;
    entries.retain(|entry| !entry.file_name().to_string_lossy().starts_with('.'));
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let (path, kind) = (entry.path(), entry.file_type().map_err(unreadable)?);
        if kind.is_dir() {
            below(&path, found)?;
        } else if kind.is_file() && path.extension().is_some_and(|ending| ending == "dscene") {
            found.push(path);
        }
    }
    Ok(())
}

/// The seed, the folder that relative paths start from, and Ctrl-C.
pub fn engine_options(common: &Common, file: &Path) -> EngineOptions {
    let base_dir = file.parent().map(Path::to_path_buf).unwrap_or_default();
    EngineOptions { seed: common.seed, base_dir, interrupt: Some(world::interrupt_flag()) }
}

impl Loaded {
    /// An expression against the script; reports what is wrong with it.
    pub fn expression(&mut self, text: &str, name: &str, world: &mut dyn World) -> Option<hir::Expr> {
        let (line, diagnostics) = check_line(&mut self.engine, text);
        let sources = self.engine.program().sources.clone();
        for diagnostic in &diagnostics {
            world.diagnostic(diagnostic, &sources);
        }
        match line? {
            Line::Expr(expr) => Some(expr),
            _ => {
                let message = format!("{name} must be an expression");
                let diagnostic = Diagnostic::error("dscene::cli::expression", message)
                    .help("statements belong into the script, or into `dsl repl`");
                world.diagnostic(&diagnostic, &sources);
                None
            }
        }
    }
}
