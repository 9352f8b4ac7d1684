//! The REPL: declarations, expressions and actions against a living program.

mod answer;
mod commands;
mod editor;
pub mod input;
mod inspect;
pub mod picture;
mod show;
mod undo;
mod values;

use std::collections::HashMap;
use std::io::{BufRead, IsTerminal};
use std::path::{Path, PathBuf};

use serde_json::json;

use super::args::{Common, ReplArgs};
use super::living::Living;
use super::{EXIT_WRONG, Terminal, choose_camera, out};
use crate::check::hir::{Action, DeclId, DeclKind};
use crate::check::{Line, hir};
use crate::diag::Diagnostic;
use crate::eval;
use crate::ide::Analysis;
use crate::session::line::check_line;
use crate::session::measure::repeat_seed;
use crate::session::world::{EXIT_INTERRUPTED, clear_interrupt, interrupt_flag, interrupted, listening};
use crate::session::{Runner, World};
use crate::source::SourceId;
use crate::syntax;

use answer::{Answering, Shared};
use editor::{Input, LineEditor, Words};
use picture::Protocol;
use undo::Before;
use values::Values;

/// Repeats behind the standard errors of `grad(loss)` and of noisy numbers.
const REPEATS: u32 = 8;
/// Noisy numbers are not repeated for longer than this (seconds).
const PATIENCE: f64 = 2.0;

/// Whether to read another line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    Read,
    Quit,
}

/// A living program with its world.
pub struct Repl<'w> {
    living: Living,
    world: &'w mut dyn World,
    /// Lines with declarations, for `:save`.
    typed: Vec<SourceId>,
    /// What this session has saved, by its path.
    saved: HashMap<PathBuf, String>,
    /// What `_` and `_1` stand for.
    values: Values,
    /// The entries that can be undone, the last one last.
    undone_by: Vec<Before>,
    /// People look at the output: images are drawn, values have their names.
    is_terminal: bool,
    /// How the terminal wants its images.
    protocol: Protocol,
    /// What a program gets in place of text.
    answer: Option<Shared>,
    /// What was typed last, but for commands.
    last_entry: String,
    /// Entries so far.
    entries: u64,
    /// The present entry did not do what it was to do.
    entry_failed: bool,
    failed: bool,
}

/// `dsl repl`
pub fn run(args: &ReplArgs) -> u8 {
    if args.common.json {
        let answer = Shared::default();
        let mut world = Answering(answer.clone());
        let mut repl = Repl::new(args.common.clone(), &mut world);
        repl.answer = Some(answer);
        if let Some(file) = &args.file {
            repl.load(file);
            repl.undone_by.clear();
            repl.end_entry();
        }
        return repl.read_piped();
    }
    let mut terminal = Terminal::new(&args.common);
    let is_interactive = std::io::stdin().is_terminal();
    let mut repl = Repl::new(args.common.clone(), &mut terminal);
    repl.is_terminal = std::io::stdout().is_terminal();
    repl.protocol = Protocol::of_terminal(|name| std::env::var(name).ok());
    if let Some(file) = &args.file {
        repl.load(file);
        // There is nothing before the script to go back to.
        repl.undone_by.clear();
    }
    if is_interactive { repl.interact() } else { repl.read_piped() }
}

impl<'w> Repl<'w> {
    /// An empty program: only the standard library.
    pub fn new(common: Common, world: &'w mut dyn World) -> Repl<'w> {
        Repl {
            living: Living::new(common, interrupt_flag()),
            world,
            typed: Vec::new(),
            saved: HashMap::new(),
            values: Values::default(),
            undone_by: Vec::new(),
            is_terminal: false,
            protocol: Protocol::Blocks,
            answer: None,
            last_entry: String::new(),
            entries: 0,
            entry_failed: false,
            failed: false,
        }
    }

    fn interact(&mut self) -> u8 {
        let mut editor = match LineEditor::new() {
            Ok(editor) => editor,
            Err(error) => {
                out::error_line(&format!("cannot read from this terminal: {error}"));
                return EXIT_WRONG;
            }
        };
        self.world.note(&format!("dscene {} · :help for help, Ctrl-D to leave", env!("CARGO_PKG_VERSION")));
        loop {
            editor.set_words(self.words());
            match editor.read() {
                Ok(Input::Text(text)) => {
                    clear_interrupt();
                    let next = listening(|| self.line(&text));
                    editor.keep_history();
                    if next == Next::Quit {
                        break;
                    }
                }
                Ok(Input::Interrupted) => {}
                Ok(Input::End) => break,
                Err(error) => {
                    out::error_line(&format!("cannot read: {error}"));
                    break;
                }
            }
        }
        0
    }

    /// Input from a pipe: each complete piece of text as soon as it is there; fails if any of them did.
    fn read_piped(&mut self) -> u8 {
        let mut inputs = input::Inputs::default();
        let mut stdin = std::io::stdin().lock();
        loop {
            let mut bytes = Vec::new();
            let is_end = match stdin.read_until(b'\n', &mut bytes) {
                Ok(count) => count == 0,
                Err(error) => {
                    out::error_line(&format!("cannot read standard input: {error}"));
                    return EXIT_WRONG;
                }
            };
            // Answered at once: a program may wait for it before it writes the next line.
            let text = if is_end {
                inputs.rest()
            } else {
                inputs.line(String::from_utf8_lossy(&bytes).trim_end_matches(['\n', '\r']))
            };
            let next = text.map_or(Next::Read, |text| listening(|| self.line(&text)));
            if interrupted() && self.answer.is_none() {
                return EXIT_INTERRUPTED;
            }
            if is_end || next == Next::Quit {
                break;
            }
        }
        if self.failed || self.entry_failed { EXIT_WRONG } else { 0 }
    }

    fn words(&mut self) -> Words {
        if Analysis::of_program(self.living.engine.program()).is_none() {
            // Nothing was typed yet: what the program sees is found out by an empty line.
            let _ = check_line(&mut self.living.engine, "");
        }
        let mut known = Analysis::of_program(self.living.engine.program());
        if let Some(known) = &mut known {
            let shown = self.values.all().map(|kept| (kept.name.clone(), kept.ty.clone()));
            let last = self.values.all().last().map(|kept| ("_".to_owned(), kept.ty.clone()));
            known.shown = shown.chain(last).collect();
        }
        Words { known, commands: commands::NAMES }
    }

    /// One complete input: a `:command`, declarations, actions or an expression.
    pub fn line(&mut self, text: &str) -> Next {
        let text = text.trim();
        if text.is_empty() {
            return Next::Read;
        }
        self.entries += 1;
        let next = match text.strip_prefix(':') {
            Some(command) => self.command(command),
            None => {
                self.last_entry = text.to_owned();
                let outcome = self.enter(text);
                self.report(outcome);
                Next::Read
            }
        };
        self.end_entry();
        next
    }

    /// Answers the entry, if a program waits for it.
    fn end_entry(&mut self) {
        let failed = std::mem::take(&mut self.entry_failed);
        self.failed |= failed;
        if let Some(answer) = &self.answer {
            out::line(&answer.borrow_mut().take_line(self.entries, !failed));
            // Ctrl-C ends an evaluation, which its answer tells, and not the session.
            clear_interrupt();
        }
    }

    /// Declarations, actions or an expression.
    fn enter(&mut self, text: &str) -> Result<(), Diagnostic> {
        let before = syntax::is_statement(text).then(|| self.before(text));
        let text = self.spelled_out(text)?;
        let Some(line) = self.check(&text) else { return Ok(()) };
        if let (Line::Statements { declared, actions }, Some(before)) = (&line, before) {
            let moves = |action: &Action| matches!(action, Action::Optimize(_));
            if !declared.is_empty() || actions.is_empty() || actions.iter().any(moves) {
                self.can_undo(before, None);
            }
        }
        let program = self.living.engine.program();
        let is_loss = |id: &DeclId| matches!(program.decl(*id).kind, DeclKind::Loss);
        let has_loss = matches!(&line, Line::Statements { declared, .. } if declared.iter().any(is_loss));
        let outcome = self.evaluate(line);
        if has_loss {
            self.name_the_loss();
        }
        outcome
    }

    /// Makes `loss` mean the script's first loss, unless it means something else already.
    fn name_the_loss(&mut self) {
        let program = self.living.engine.program();
        let is_taken = program.ids().any(|id| program.decl(id).name == "loss");
        let first = program.losses().next().map(|id| program.decl(id).name.clone());
        if let (false, Some(first)) = (is_taken, first) {
            let _ = check_line(&mut self.living.engine, &format!("let loss = {first}"));
        }
    }

    fn report(&mut self, outcome: Result<(), Diagnostic>) {
        crate::session::run::tell_warnings(&mut self.living.engine, self.world);
        if let Err(diagnostic) = outcome {
            self.world.progress_done();
            if diagnostic.code == eval::INTERRUPTED {
                self.world.note("interrupted");
                if let Some(answer) = &self.answer {
                    self.entry_failed = true;
                    answer.borrow_mut().add(json!({ "interrupted": true }));
                }
                return;
            }
            self.entry_failed = true;
            let sources = self.living.engine.program().sources.clone();
            self.world.diagnostic(&diagnostic, &sources);
        }
    }

    /// Checks a line against the program and reports what is wrong with it.
    fn check(&mut self, text: &str) -> Option<Line> {
        let (line, mut diagnostics) = check_line(&mut self.living.engine, text);
        let program = self.living.engine.program();
        // `place = 4`, where `place` is a param.
        if let (None, [told], Some((name, value))) = (&line, &mut diagnostics[..], text.split_once('='))
            && let (name, value) = (name.trim(), value.trim())
            && program.find(name).is_some_and(|id| matches!(program.decl(id).kind, DeclKind::Param(_)))
        {
            told.helps =
                vec![format!("`:set {name} {value}` moves the param, `param {name} = {value}` declares it anew")];
        }
        if let (None, [told]) = (&line, &mut diagnostics[..])
            && ["quit", "exit", "quit()", "exit()", "q", "bye"].contains(&text.trim_end_matches(';'))
        {
            told.helps = vec!["`:quit` leaves, and so does Ctrl-D".to_owned()];
        }
        let sources = program.sources.clone();
        for diagnostic in &diagnostics {
            self.world.diagnostic(diagnostic, &sources);
        }
        self.entry_failed |= line.is_none();
        line
    }

    /// The expression that a command's argument is.
    fn expression(&mut self, text: &str) -> Result<Option<hir::Expr>, Diagnostic> {
        let text = self.spelled_out(text)?;
        match self.check(&text) {
            None => Ok(None),
            Some(Line::Expr(expr)) => Ok(Some(expr)),
            Some(_) => Err(Diagnostic::error("dscene::repl::expression", "expected an expression")),
        }
    }

    fn evaluate(&mut self, line: Line) -> Result<(), Diagnostic> {
        match line {
            Line::Statements { declared, actions } => {
                if !declared.is_empty() || actions.is_empty() {
                    let line = self.living.engine.program().origin.lines.last();
                    self.typed.extend(line);
                    // What is being optimised may have changed its meaning.
                    self.living.optimization = None;
                }
                self.tell_declared(&declared);
                self.evaluate_again(&declared)?;
                let mut runner = Runner::new(&mut self.living.engine, &mut *self.world);
                runner.outputs = self.living.common.out.clone().unwrap_or_default();
                runner.histories = std::mem::take(&mut self.living.histories);
                let flow = runner.run(&actions);
                self.entry_failed |= !runner.report.is_success();
                self.living.histories = std::mem::take(&mut runner.histories);
                flow.map(|_| ())
            }
            Line::Expr(expr) => self.show(&expr),
            Line::Empty => Ok(()),
        }
    }

    fn tell_declared(&mut self, declared: &[DeclId]) {
        let program = self.living.engine.program();
        let named = |id: &DeclId| (program.decl(*id).name.clone(), program.decl(*id).ty.to_string());
        let declared: Vec<(String, String)> = declared.iter().map(named).collect();
        if let (Some(answer), false) = (&self.answer, declared.is_empty()) {
            let all: Vec<_> = declared.iter().map(|(name, ty)| json!({ "name": name, "type": ty })).collect();
            return answer.borrow_mut().add(json!({ "declared": all }));
        }
        declared.iter().for_each(|(name, ty)| self.world.print(&format!("{name} : {ty}")));
    }

    /// Evaluates what was known before and has changed with the program, and says so. The names in `declared` were told already.
    fn evaluate_again(&mut self, declared: &[DeclId]) -> Result<(), Diagnostic> {
        let changed = self.living.engine.take_dropped();
        let program = self.living.engine.program();
        let others = changed.iter().filter(|id| !declared.contains(id));
        let names: Vec<String> = others.map(|id| program.decl(*id).name.clone()).collect();
        if changed.is_empty() {
            return Ok(());
        }
        self.living.engine.set_sample_seed(repeat_seed(self.living.common.seed, 0));
        for id in changed {
            self.living.engine.eval_decl(id)?;
        }
        if names.is_empty() {
            return Ok(());
        }
        match &self.answer {
            Some(answer) => answer.borrow_mut().add(json!({ "evaluated_again": names })),
            None => self.world.note(&format!("evaluated again: {}", names.join(", "))),
        }
        Ok(())
    }

    /// Replaces the program by a file's; keeps the old one if the file is wrong.
    fn load(&mut self, file: &Path) -> bool {
        let before = self.before(&format!(":load {}", file.display()));
        let Some(engine) = self.living.load(file, &mut *self.world) else {
            self.entry_failed = true;
            return false;
        };
        self.can_undo(before, Some(engine));
        self.typed.clear();
        self.name_the_loss();
        let program = self.living.engine.program();
        let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
        let params = count(program.params().count(), "param");
        let losses = program.losses().count();
        let losses = if losses == 1 { "1 loss".to_owned() } else { format!("{losses} losses") };
        self.world.note(&format!(
            "loaded {}: {params}, {losses}, {}",
            file.display(),
            count(program.actions.len(), "action")
        ));
        true
    }
}

/// What stands beside the answer: grey, if the terminal has colours.
fn dim(text: &str) -> String {
    if out::colors_on_stdout() { format!("\x1b[2m{text}\x1b[0m") } else { text.to_owned() }
}
