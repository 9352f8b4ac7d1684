//! `dsl compare`

use std::path::Path;

use serde_json::json;

use super::args::CompareArgs;
use super::render::in_folder;
use super::{EXIT_WRONG, Terminal, out};
use crate::diag::Diagnostic;
use crate::files::write_atomically;
use crate::report::Comparison;
use crate::session::folder::cannot_write;
use crate::session::{Run, World};
use crate::source::SourceMap;

pub fn run(args: &CompareArgs) -> u8 {
    let mut terminal = Terminal::new(&args.common);
    match compare(args, &mut terminal) {
        Ok(()) => 0,
        Err(diagnostic) => {
            terminal.diagnostic(&diagnostic, &SourceMap::default());
            EXIT_WRONG
        }
    }
}

fn compare(args: &CompareArgs, terminal: &mut Terminal) -> Result<(), Diagnostic> {
    let runs: Vec<Run> = args.runs.iter().map(|folder| Run::read(folder)).collect::<Result<_, _>>()?;
    let comparison = Comparison::new(&runs);
    let path = in_folder(args.out.as_deref(), args.output.as_deref().unwrap_or(Path::new("compare.html")))?;
    let page = comparison.page("Comparison of runs");
    write_atomically(&path, page.as_bytes()).map_err(|e| cannot_write(&path, &e))?;
    if args.common.json {
        out::line(&json!({ "saved": path.display().to_string(), "runs": comparison.json() }).to_string());
    } else {
        out::print(&comparison.table());
        terminal.note(&format!("saved {}", path.display()));
    }
    Ok(())
}
