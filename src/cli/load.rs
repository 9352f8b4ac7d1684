//! From a file on the command line to an engine.

use std::mem::ManuallyDrop;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::args::Common;
use crate::check::{self, Checked, Line, hir};
use crate::diag::Diagnostic;
use crate::eval::{Engine, EngineOptions};
use crate::session::line::check_line;
use crate::session::{World, world};
use crate::source::SourceMap;

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
    check_file_by(file, common, &check::Disk)
}

/// The same with another way to read files.
pub fn check_file_by(file: &Path, common: &Common, loader: &(dyn check::Loader + Sync)) -> Checked {
    let overrides: Vec<(String, String)> = common.set.iter().map(|o| (o.name.clone(), o.value.clone())).collect();
    if file != Path::new(STDIN) {
        return check::check(file, &overrides, loader);
    }
    // What it imports lies in the working directory.
    let name = "<stdin>";
    match std::io::read_to_string(std::io::stdin()) {
        Ok(text) => check::check_text(name, Some(Path::new(name)), text, &overrides, loader),
        Err(error) => {
            let message = format!("cannot read standard input: {}", crate::files::describe_io(&error));
            let diagnostic = Diagnostic::error("dscene::file::unreadable", message);
            Checked { program: None, diagnostics: vec![diagnostic], sources: SourceMap::new() }
        }
    }
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

/// Checks a file and reports what is wrong; `None` if it cannot run.
pub fn load(file: &Path, common: &Common, world: &mut dyn World) -> Option<Loaded> {
    load_stopped_by(world::interrupt_flag(), file, common, world)
}

/// The same with another flag that ends evaluations.
pub fn load_stopped_by(flag: Arc<AtomicBool>, file: &Path, common: &Common, world: &mut dyn World) -> Option<Loaded> {
    let checked = check_file(file, common);
    for diagnostic in &checked.diagnostics {
        world.diagnostic(diagnostic, &checked.sources);
    }
    if checked.diagnostics.iter().any(Diagnostic::is_error) {
        return None;
    }
    let options = EngineOptions { interrupt: Some(flag), ..engine_options(common, file) };
    Some(Loaded { warnings: checked.diagnostics, engine: ManuallyDrop::new(Engine::new(checked.program?, options)) })
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
