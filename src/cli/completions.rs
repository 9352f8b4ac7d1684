//! `dsl completions` and `dsl man`: what shells and `man` know of the command line.

use std::fs;
use std::io;

use clap::CommandFactory;

use super::args::{Cli, CompletionsArgs, ManArgs};
use super::{EXIT_WRONG, Terminal, out};
use crate::diag::Diagnostic;
use crate::files::{describe_io, write_atomically};
use crate::session::World;
use crate::source::SourceMap;

/// Writes a shell's script to standard output.
pub fn completions(args: &CompletionsArgs) -> u8 {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "dsl", &mut script);
    out::print(&String::from_utf8_lossy(&script));
    0
}

/// Writes a page for the program and one for each command.
pub fn man(args: &ManArgs) -> u8 {
    let mut command = Cli::command();
    command.build();
    let pages = |command: &clap::Command| -> io::Result<()> {
        fs::create_dir_all(&args.folder)?;
        for command in std::iter::once(command).chain(command.get_subcommands().filter(|c| c.get_name() != "help")) {
            let name = command.get_display_name().unwrap_or_else(|| command.get_name()).to_owned();
            let mut page = Vec::new();
            clap_mangen::Man::new(command.clone()).title(&name).render(&mut page)?;
            write_atomically(&args.folder.join(format!("{name}.1")), &page)?;
        }
        Ok(())
    };
    let Err(error) = pages(&command) else { return 0 };
    let message = format!("cannot write pages to `{}`: {}", args.folder.display(), describe_io(&error));
    let diagnostic = Diagnostic::error("dscene::file::unwritable", message);
    Terminal::new(&args.common).diagnostic(&diagnostic, &SourceMap::default());
    EXIT_WRONG
}
