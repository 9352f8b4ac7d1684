//! `dsl report`

use std::path::{Path, PathBuf};

use serde_json::json;

use super::args::ReportArgs;
use super::export::script_of;
use super::render::in_folder;
use super::{EXIT_WRONG, Terminal, out};
use crate::diag::Diagnostic;
use crate::files::{rewrite, write_atomically};
use crate::report::report;
use crate::session::folder::{REPORT, cannot_write};
use crate::session::{Run, World, world};
use crate::source::SourceMap;

pub fn run(args: &ReportArgs) -> u8 {
    let mut terminal = Terminal::new(&args.common);
    match world::listening(|| write(args, &mut terminal)) {
        Ok(()) => 0,
        Err(diagnostic) => {
            terminal.diagnostic(&diagnostic, &SourceMap::default());
            EXIT_WRONG
        }
    }
}

fn write(args: &ReportArgs, terminal: &mut Terminal) -> Result<(), Diagnostic> {
    let path = match &args.output {
        Some(file) => {
            let page = page_of(&args.run, terminal)?;
            let path = in_folder(args.out.as_deref(), file)?;
            write_atomically(&path, page.as_bytes()).map_err(|e| cannot_write(&path, &e))?;
            path
        }
        None => make_again(&args.run, terminal)?,
    };
    if args.common.json {
        out::line(&json!({ "saved": path.display().to_string() }).to_string());
    } else {
        terminal.note(&format!("saved {}", path.display()));
    }
    Ok(())
}

/// Writes the page about a run into its folder; gives its path.
pub fn make_again(run: &Path, terminal: &mut Terminal) -> Result<PathBuf, Diagnostic> {
    let page = page_of(run, terminal)?;
    let path = run.join(REPORT);
    rewrite(&path, page.as_bytes()).map_err(|e| cannot_write(&path, &e))?;
    Ok(path)
}

fn page_of(folder: &Path, terminal: &mut Terminal) -> Result<String, Diagnostic> {
    let run = Run::read(folder)?;
    let script = match script_of(folder) {
        Ok(script) => script,
        Err(told) => {
            terminal.note(&format!("without the script with the found values: {}", told.0.message));
            None
        }
    };
    Ok(report(&run, script.as_deref()))
}
