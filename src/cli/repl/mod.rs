//! The REPL: declarations, expressions and actions against a living program.

mod commands;
mod editor;
pub mod input;
pub mod picture;

use std::io::{BufRead, IsTerminal};
use std::path::Path;

use super::args::{Common, ReplArgs};
use super::living::Living;
use super::{EXIT_WRONG, Terminal, choose_camera, out};
use crate::check::{Line, hir};
use crate::diag::Diagnostic;
use crate::eval;
use crate::ide::Analysis;
use crate::session::line::check_line;
use crate::session::measure::repeat_seed;
use crate::session::stats::Moments;
use crate::session::world::{EXIT_INTERRUPTED, clear_interrupt, interrupt_flag, interrupted, listening};
use crate::session::{MeasureOptions, Runner, World, measure, show};
use crate::source::SourceId;

use editor::{Input, LineEditor, Words};

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
    /// Draw images as characters.
    pictures: bool,
    failed: bool,
}

/// `dsl repl`
pub fn run(args: &ReplArgs) -> u8 {
    let mut terminal = Terminal::new(&args.common);
    let is_interactive = std::io::stdin().is_terminal();
    let mut repl = Repl::new(args.common.clone(), &mut terminal);
    repl.pictures = std::io::stdout().is_terminal();
    if let Some(file) = &args.file {
        repl.load(file);
    }
    if is_interactive { repl.interact() } else { repl.read_piped() }
}

impl<'w> Repl<'w> {
    /// An empty program: only the standard library.
    pub fn new(common: Common, world: &'w mut dyn World) -> Repl<'w> {
        let living = Living::new(common, interrupt_flag());
        Repl { living, world, typed: Vec::new(), pictures: false, failed: false }
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
                    if listening(|| self.line(&text)) == Next::Quit {
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
        editor.save_history();
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
            if interrupted() {
                return EXIT_INTERRUPTED;
            }
            if is_end || next == Next::Quit {
                break;
            }
        }
        if self.failed { EXIT_WRONG } else { 0 }
    }

    fn words(&mut self) -> Words {
        if Analysis::of_program(self.living.engine.program()).is_none() {
            // Nothing was typed yet: what the program sees is found out by an empty line.
            let _ = check_line(&mut self.living.engine, "");
        }
        let known = Analysis::of_program(self.living.engine.program());
        Words { known, commands: commands::NAMES.iter().map(|(name, ..)| format!(":{name}")).collect() }
    }

    /// One complete input: a `:command`, declarations, actions or an expression.
    pub fn line(&mut self, text: &str) -> Next {
        let text = text.trim();
        if text.is_empty() {
            return Next::Read;
        }
        if let Some(command) = text.strip_prefix(':') {
            return self.command(command);
        }
        if let Some(line) = self.check(text) {
            let outcome = self.evaluate(line);
            self.report(outcome);
            self.name_the_loss();
        }
        Next::Read
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
            if diagnostic.code == eval::INTERRUPTED {
                self.world.progress_done();
                self.world.note("interrupted");
                return;
            }
            self.failed = true;
            self.world.progress_done();
            let sources = self.living.engine.program().sources.clone();
            self.world.diagnostic(&diagnostic, &sources);
        }
    }

    /// Checks a line against the program and reports what is wrong with it.
    fn check(&mut self, text: &str) -> Option<Line> {
        let (line, diagnostics) = check_line(&mut self.living.engine, text);
        let sources = self.living.engine.program().sources.clone();
        for diagnostic in &diagnostics {
            self.world.diagnostic(diagnostic, &sources);
        }
        self.failed |= line.is_none();
        line
    }

    /// The expression that a command's argument is.
    fn expression(&mut self, text: &str) -> Option<hir::Expr> {
        match self.check(text)? {
            Line::Expr(expr) => Some(expr),
            _ => {
                self.report(Err(Diagnostic::error("dscene::repl::expression", "expected an expression")));
                None
            }
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
                for id in declared {
                    let decl = self.living.engine.program().decl(id);
                    let text = format!("{} : {}", decl.name, decl.ty);
                    self.world.print(&text);
                }
                let mut runner = Runner::new(&mut self.living.engine, &mut *self.world);
                runner.outputs = self.living.common.out.clone().unwrap_or_default();
                runner.histories = std::mem::take(&mut self.living.histories);
                let flow = runner.run(&actions);
                self.failed |= !runner.report.is_success();
                self.living.histories = std::mem::take(&mut runner.histories);
                flow.map(|_| ())
            }
            Line::Expr(expr) => self.show(&expr),
            Line::Empty => Ok(()),
        }
    }

    /// Prints an expression's value and type.
    fn show(&mut self, expr: &hir::Expr) -> Result<(), Diagnostic> {
        if let hir::ExprKind::Derivative(derivative) = &expr.kind
            && derivative.kind == hir::DerivativeKind::Grad
            && derivative.wrt.is_empty()
        {
            let name = self.living.engine.program().sources.text(derivative.of.span).to_owned();
            return self.gradients(&name, &derivative.of, None);
        }
        self.living.engine.set_sample_seed(repeat_seed(self.living.common.seed, 0));
        let started = std::time::Instant::now();
        let value = self.living.engine.eval(expr)?;
        if self.pictures
            && let Some(image) = crate::session::save::image_of(&value)
            && matches!(value, crate::natives::value::Value::Image(_))
        {
            self.world.print(picture::half_blocks(&image, 64).trim_end());
        }
        let text = match value.number() {
            Some(first) if expr.ty.is_scalar() => {
                let seconds = started.elapsed().as_secs_f64();
                self.noisy(expr, first, seconds)?.unwrap_or_else(|| eval::show(&value, &expr.ty))
            }
            _ => eval::show(&value, &expr.ty),
        };
        self.world.print(&format!("{text}   : {}", expr.ty));
        Ok(())
    }

    /// A number that depends on the seed, as mean and standard error; `None` if it does not.
    fn noisy(&mut self, expr: &hir::Expr, first: f64, seconds: f64) -> Result<Option<String>, Diagnostic> {
        let affordable = (PATIENCE / seconds.max(1e-9)).min(f64::from(REPEATS)) as u64;
        let mut moments = Moments::default();
        moments.add(&[first]);
        for repeat in 1..affordable.max(2) {
            if interrupted() || (repeat == 1 && seconds > 2.0 * PATIENCE) {
                break;
            }
            self.living.engine.set_sample_seed(repeat_seed(self.living.common.seed, repeat));
            let Some(x) = self.living.engine.eval(expr)?.number() else {
                break;
            };
            if repeat == 1 && x.to_bits() == first.to_bits() {
                break;
            }
            moments.add(&[x]);
        }
        self.living.engine.set_sample_seed(repeat_seed(self.living.common.seed, 0));
        let error = moments.std_error().first().copied().unwrap_or(0.0);
        Ok((error > 0.0).then(|| show::plus_minus(moments.mean()[0], error)))
    }

    /// The table of all params that reach a scalar.
    fn gradients(&mut self, name: &str, of: &hir::Expr, fd_step: Option<f64>) -> Result<(), Diagnostic> {
        let ids = self.living.engine.reaching_params(of)?;
        let program = self.living.engine.program();
        let target = |id: &hir::DeclId| hir::Target { decl: *id, path: Vec::new() };
        let wrt: Vec<(String, hir::Target)> =
            ids.iter().map(|id| (program.decl(*id).name.clone(), target(id))).collect();
        if wrt.is_empty() {
            return Err(Diagnostic::error("dscene::repl::gradient", format!("no param reaches `{name}`"))
                .label(of.span, "does not depend on any param"));
        }
        let options = MeasureOptions { repeats: REPEATS, seed: self.living.common.seed, fd_step, warm: false };
        match measure(&mut self.living.engine, of, &wrt, options, &interrupted)? {
            Some(measurement) => self.world.print(&measurement.to_text(name, false)),
            None => self.world.note("interrupted"),
        }
        Ok(())
    }

    /// Replaces the program by a file's; keeps the old one if the file is wrong.
    fn load(&mut self, file: &Path) -> bool {
        if !self.living.load(file, &mut *self.world) {
            self.failed = true;
            return false;
        }
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
