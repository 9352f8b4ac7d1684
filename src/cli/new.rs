//! `dsl new`: a project that runs.

use std::fs;
use std::io;
use std::path::Path;

use serde_json::json;

use super::args::NewArgs;
use super::out::typed;
use super::{EXIT_WRONG, Terminal, out};
use crate::diag::Diagnostic;
use crate::files::{describe_io, write_atomically};
use crate::session::World;
use crate::source::SourceMap;

/// The files of a project, by their paths in its folder.
const FILES: [(&str, &str); 4] = [
    ("README.md", include_str!("new/README.md")),
    ("main.dscene", include_str!("new/main.dscene")),
    ("lib/room.dscene", include_str!("new/room.dscene")),
    ("assets/block.obj", include_str!("new/block.obj")),
];

pub fn run(args: &NewArgs) -> u8 {
    let mut terminal = Terminal::new(&args.common);
    match create(&args.folder) {
        Ok(()) => {
            let script = args.folder.join("main.dscene");
            let files = FILES.map(|(path, _)| path).join(", ");
            let next = format!("dsl run {}", typed(&script));
            if args.common.json {
                let paths = FILES.map(|(path, _)| path);
                out::line(
                    &json!({ "folder": args.folder.display().to_string(), "files": paths, "next": next }).to_string(),
                );
            } else {
                out::line(&format!("{}: {files}\nnext: {next}", args.folder.display()));
            }
            0
        }
        Err(diagnostic) => {
            terminal.diagnostic(&diagnostic, &SourceMap::default());
            EXIT_WRONG
        }
    }
}

/// Writes the files. A folder that has anything in it is left as it is.
fn create(folder: &Path) -> Result<(), Diagnostic> {
    let shown = folder.display();
    let failed = |error: &io::Error| {
        Diagnostic::error("dscene::file::unwritable", format!("cannot make `{shown}`: {}", describe_io(error)))
    };
    match fs::read_dir(folder) {
        Ok(mut entries) => {
            if entries.next().is_some() {
                return Err(Diagnostic::error("dscene::file::unwritable", format!("`{shown}` has files in it"))
                    .help("give a folder that is empty or not there yet"));
            }
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => {}
        Err(error) => return Err(failed(&error)),
    }
    for (path, text) in FILES {
        let path = folder.join(path);
        path.parent().map_or(Ok(()), fs::create_dir_all).map_err(|e| failed(&e))?;
        write_atomically(&path, text.as_bytes()).map_err(|e| failed(&e))?;
    }
    Ok(())
}
