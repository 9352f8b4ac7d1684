//! The `:commands` of the REPL.

use std::path::{Path, PathBuf};

use super::{Next, Repl};
use crate::check::hir;
use crate::cli::living::set_param;
use crate::cli::script::script_with_values;
use crate::diag::{self, Diagnostic};
use crate::eval;
use crate::files::write_atomically;
use crate::ide::describe;
use crate::session::clock::{Stopwatch, human_seconds};
use crate::session::folder::{cannot_write, spare_inputs};
use crate::session::{Optimization, show};
use crate::tape::Tensor;

/// Name, arguments and what it does, in the order of `:help`.
pub const NAMES: &[(&str, &str, &str)] = &[
    ("help", "[NAME]", "this list, or what is known of a name"),
    ("params", "", "every param: value, bounds, prior, space, rate"),
    ("set", "NAME EXPR", "gives a param a value, or replaces a declaration"),
    ("step", "[N]", "N steps (default 1) of the script's first `optimize`"),
    ("reset", "", "params back to their initial values"),
    ("render", "[CAMERA] [SPP]", "a picture from a camera"),
    ("type", "EXPR", "the type of an expression, without evaluating it; the prior and the space of a param"),
    ("time", "EXPR", "evaluates an expression and says how long it took"),
    ("fd", "[EXPR]", "gradient of a scalar beside finite differences"),
    ("load", "FILE", "starts over with a script"),
    ("reload", "", "reads the script again"),
    ("save", "FILE", "writes the script with your declarations and the params' values"),
    ("quit", "", "leaves (also Ctrl-D)"),
];

impl Repl<'_> {
    pub(super) fn command(&mut self, text: &str) -> Next {
        let (name, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
        let rest = rest.trim();
        let outcome = match name {
            "quit" | "q" | "exit" => return Next::Quit,
            "help" | "h" | "?" => self.help(rest),
            "params" => self.list_params(),
            "set" => self.set(rest),
            "step" => self.step(rest),
            "reset" => self.reset(),
            "render" => self.render(rest),
            "type" | "t" => {
                if let Some(expr) = self.expression(rest) {
                    let text = format!("{}{}", expr.ty, self.space_of(&expr));
                    self.world.print(&text);
                }
                Ok(())
            }
            "time" => self.time(rest),
            "fd" => self.finite_differences(rest),
            "load" => self.load_file(rest),
            "reload" => match self.living.file.clone() {
                Some(file) => {
                    self.load(&file);
                    Ok(())
                }
                None => Err(usage("there is no file to read again", "start with `:load FILE`")),
            },
            "save" => self.save(rest),
            _ => {
                let names: Vec<&str> = NAMES.iter().map(|(name, ..)| *name).collect();
                let error = Diagnostic::error("dscene::repl::command", format!("there is no command `:{name}`"));
                Err(error
                    .help_opt(diag::suggest(name, names).map(|n| format!("did you mean `:{n}`?")))
                    .help("`:help` lists them"))
            }
        };
        self.report(outcome);
        Next::Read
    }

    fn help(&mut self, name: &str) -> Result<(), Diagnostic> {
        if name.is_empty() {
            let rows: Vec<String> =
                NAMES.iter().map(|(name, args, what)| format!("  {:<24} {what}", format!(":{name} {args}"))).collect();
            let text = format!(
                "Type an expression to see its value, a declaration to add or replace it, an action to run it.\n\
                 `grad(loss)` shows the derivative with respect to every param.\n\n{}",
                rows.join("\n")
            );
            self.world.print(&text);
            return Ok(());
        }
        let program = self.living.engine.program();
        let found = program.find(name);
        // `:help render` is the function, `:help :render` the command.
        let bare = name.trim_start_matches(':');
        if let (None, Some((name, args, what))) = (found, NAMES.iter().find(|(n, ..)| *n == bare)) {
            self.world.print(&format!(":{name} {args}\n  {what}"));
            return Ok(());
        }
        let Some(id) = found else {
            let names = program.ids().map(|id| program.decl(id).name.as_str());
            return Err(Diagnostic::error("dscene::name::unknown", format!("there is no `{name}`"))
                .help_opt(diag::suggest(name, names).map(|n| format!("did you mean `{n}`?"))));
        };
        let decl = program.decl(id);
        let head = describe::head(program, decl);
        let text = if decl.doc.trim().is_empty() { head } else { format!("{head}\n\n{}", decl.doc.trim_end()) };
        self.world.print(&text);
        Ok(())
    }

    /// What a declaration says of a param beside its type.
    fn space_of(&self, expr: &hir::Expr) -> String {
        let hir::ExprKind::Decl(id) = expr.kind else { return String::new() };
        let program = self.living.engine.program();
        let hir::DeclKind::Param(param) = &program.decl(id).kind else { return String::new() };
        describe::beside(program, param)
    }

    fn list_params(&mut self) -> Result<(), Diagnostic> {
        let mut rows = vec![["param", "type", "bounds", "", "value"].map(str::to_owned).to_vec()];
        for info in self.living.engine.params()? {
            let value = self.living.engine.param_value(info.id)?;
            let ty = self.living.engine.program().decl(info.id).ty.clone();
            let shown = |t: &Tensor| show::with_unit(t, &ty);
            let bounds = info.bounds.as_ref().map_or(String::new(), |bounds| show::bounds(bounds, &ty));
            let mut notes = Vec::new();
            notes.extend(info.prior.map(|(_, span)| format!("~ {}", self.living.engine.program().sources.text(span))));
            notes.extend(info.space.map(|space| format!("space {}", space.word())));
            notes.extend(info.frozen.then(|| "frozen".to_owned()));
            notes.extend(info.lr.map(|lr| format!("lr × {}", show::digits(lr))));
            notes.extend(info.scale.map(|scale| format!("scale {}", show::digits(scale))));
            rows.push(vec![
                info.name.clone(),
                ty.to_string(),
                bounds,
                notes.join(", "),
                crate::session::run::shortened(&shown(&value)),
            ]);
        }
        if rows.len() == 1 {
            self.world.note("no params: declare one with `param name = value`");
        } else {
            self.world.print(&show::table(&rows));
        }
        Ok(())
    }

    /// `:set NAME EXPR` or `:set NAME = EXPR`.
    fn set(&mut self, text: &str) -> Result<(), Diagnostic> {
        let end = text.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(text.len());
        let (name, rest) = text.split_at(end);
        let value = rest.trim_start().strip_prefix('=').unwrap_or(rest).trim();
        if name.is_empty() || value.is_empty() {
            return Err(usage("`:set` needs a name and a value", "type `:set NAME EXPR`"));
        }
        let program = self.living.engine.program();
        let param = program.params().find(|&id| program.decl(id).name == name);
        let Some(id) = param else {
            let own = || program.ids().map(|id| program.decl(id)).filter(|d| d.user).map(|d| d.name.as_str());
            if !own().any(|n| n == name) {
                return Err(Diagnostic::error("dscene::name::unknown", format!("there is no `{name}` to set"))
                    .help_opt(diag::suggest(name, own()).map(|n| format!("did you mean `{n}`?")))
                    .help(format!("a new value is declared: `let {name} = {value}`")));
            }
            // Anything else is replaced by a declaration of the same name.
            self.line(&format!("let {name} = {value}"));
            return Ok(());
        };
        let Some(expr) = self.expression(value) else {
            return Ok(());
        };
        let found = self.living.engine.eval(&expr)?;
        let current = self.living.engine.param_value(id)?;
        let tensor = found.var().map(|v| v.value().clone()).map(|t| match t.item() {
            // One number for all, as in `with`.
            Some(x) => Tensor::full(&current.shape, x),
            None => t,
        });
        let Some(tensor) = tensor.filter(|t| t.shape == current.shape) else {
            let declared = self.living.engine.program().decl(id).ty.to_string();
            let message = format!("`{name}` is of type {declared}, this is of type {}", expr.ty);
            return Err(Diagnostic::error("dscene::type::mismatch", message).label(expr.span, expr.ty.to_string()));
        };
        let set = set_param(&mut self.living.engine, id, tensor);
        set.map_err(|refused| match refused.code {
            "dscene::type::bounds" => refused.label(expr.span, "out of its bounds"),
            _ => refused,
        })?;
        let value = self.living.engine.param_value(id)?;
        let text = show::with_unit(&value, &self.living.engine.program().decl(id).ty);
        self.world.print(&format!("{name} = {text}"));
        Ok(())
    }

    fn step(&mut self, text: &str) -> Result<(), Diagnostic> {
        let count = match text {
            "" => 1,
            n => match n.parse::<u64>() {
                Ok(n) if n > 0 => n,
                _ => return Err(usage("`:step` needs a number of steps", "type `:step 10`")),
            },
        };
        if self.living.optimization.is_none() {
            let Some(optimize) = self.living.optimizations().next().cloned() else {
                return Err(usage("the script has no `optimize`", "type one: `optimize loss { steps: 10 }`"));
            };
            self.living.optimization = Some(Optimization::new(&mut self.living.engine, &optimize, None)?);
        }
        if self.living.optimization.as_ref().is_some_and(|o| o.done() >= o.total()) {
            self.world.note("the optimisation is complete; `:reset` starts it again");
            return Ok(());
        }
        let flow = self.living.advance(count, &mut *self.world);
        if let Some(optimization) = &self.living.optimization {
            let (done, total) = (optimization.done(), optimization.total());
            let loss = optimization.last_loss().map_or("–".to_owned(), show::digits);
            self.world.print(&format!("step {done} of {total}: {} = {loss}", optimization.name()));
        }
        flow.map(|_| ())
    }

    fn reset(&mut self) -> Result<(), Diagnostic> {
        self.living.reset();
        self.world.note("params are back at their initial values");
        Ok(())
    }

    fn render(&mut self, text: &str) -> Result<(), Diagnostic> {
        let mut words = text.split_whitespace().peekable();
        let camera = match words.next_if(|w| w.parse::<u32>().is_err()) {
            Some(name) => name.to_owned(),
            None => super::choose_camera(self.living.engine.program(), None)?,
        };
        let camera = super::choose_camera(self.living.engine.program(), Some(&camera))?;
        let spp = words.next().map(|n| n.parse::<u32>());
        let call = match spp {
            None => format!("render({camera})"),
            Some(Ok(spp)) if spp > 0 => format!("render({camera}, spp: {spp})"),
            Some(_) => return Err(usage("samples are a positive number", "type `:render eye 16`")),
        };
        match self.expression(&call) {
            Some(expr) => self.show(&expr),
            None => Ok(()),
        }
    }

    fn time(&mut self, text: &str) -> Result<(), Diagnostic> {
        let Some(expr) = self.expression(text) else {
            return Ok(());
        };
        let watch = Stopwatch::start();
        let value = self.living.engine.eval(&expr)?;
        let elapsed = watch.elapsed();
        let text = eval::brief(&value, &expr.ty);
        self.world.print(&format!("{text}\n{} (CPU {})", human_seconds(elapsed.wall), human_seconds(elapsed.cpu)));
        Ok(())
    }

    fn finite_differences(&mut self, text: &str) -> Result<(), Diagnostic> {
        let text = if text.is_empty() {
            let program = self.living.engine.program();
            match program.losses().next() {
                Some(id) => program.decl(id).name.clone(),
                None => return Err(usage("the script has no loss", "type `:fd EXPR`")),
            }
        } else {
            text.to_owned()
        };
        match self.expression(&text) {
            Some(expr) => self.gradients(&text, &expr, Some(0.01)),
            None => Ok(()),
        }
    }

    fn load_file(&mut self, text: &str) -> Result<(), Diagnostic> {
        if text.is_empty() {
            return Err(usage("`:load` needs a file", "type `:load scene.dscene`"));
        }
        self.load(Path::new(text.trim_matches('"')));
        Ok(())
    }

    /// The script's text with the params' initial values replaced by the present ones, and what was typed.
    fn save(&mut self, text: &str) -> Result<(), Diagnostic> {
        if text.is_empty() {
            return Err(usage(
                "`:save` needs a file",
                "type `:save found.dscene`; `save EXPR to \"x.png\"` saves a value",
            ));
        }
        let path = PathBuf::from(text.trim_matches('"'));
        // The script itself may be replaced by what became of it, other files that it reads may not.
        if self.living.file.as_ref() != Some(&path) {
            spare_inputs(&path)?;
        }
        let sources = &self.living.engine.program().sources;
        let root = sources.iter().find(|(_, f)| f.path.is_some() && f.path == self.living.file).map(|(id, _)| id);
        let script = script_with_values(&mut self.living.engine, root, &self.typed, Vec::new())?;
        write_atomically(&path, script.as_bytes()).map_err(|e| cannot_write(&path, &e))?;
        self.world.note(&format!("saved {}", path.display()));
        Ok(())
    }
}

fn usage(message: &str, help: &str) -> Diagnostic {
    Diagnostic::error("dscene::repl::usage", message).help(help)
}
