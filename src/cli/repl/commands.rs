//! The `:commands` of the REPL.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::{Next, Repl};
use crate::cli::export::tell_lost;
use crate::cli::live::watch;
use crate::cli::living::set_param;
use crate::cli::script::{Script, script_with_values};
use crate::diag::{self, Diagnostic};
use crate::files::write_atomically;
use crate::session::folder::{cannot_write, spare_inputs};
use crate::session::world::clear_interrupt;
use crate::session::{Optimization, show};
use crate::tape::Tensor;

/// Name, arguments and what it does, in the order of `:help`.
pub const NAMES: &[(&str, &str, &str)] = &[
    ("help", "[NAME]", "this list, or what is known of a name or a command"),
    ("doc", "NAME", "what a name is, with its documentation"),
    ("vars", "", "what is declared, with values as far as they are known"),
    ("params", "", "every param: value, bounds, prior, space, rate"),
    ("type", "EXPR", "the type of an expression, without evaluating it; the prior and the space of a param"),
    ("time", "EXPR", "evaluates an expression and says how long it took"),
    ("profile", "EXPR", "evaluates an expression and says where the time went"),
    ("fd", "[EXPR]", "gradient of a scalar beside finite differences"),
    ("render", "[CAMERA] [SPP]", "a picture from a camera"),
    ("watch", "[CAMERA]", "shows the picture in a browser, params as sliders; Ctrl-C comes back with what was moved"),
    ("set", "NAME EXPR", "gives a param a value, or replaces a declaration"),
    ("step", "[N]", "N steps (default 1) of the script's first `optimize`"),
    ("reset", "", "params back to their initial values"),
    ("undo", "", "takes back the last entry that changed something; again for the one before"),
    ("edit", "[NAME]", "opens a declaration, or the last entry, in $VISUAL or $EDITOR"),
    ("load", "FILE", "starts over with a script"),
    ("reload", "", "reads the script again"),
    ("save", "FILE", "writes the script with your declarations and the params' values, formatted"),
    ("quit", "", "leaves (also Ctrl-D)"),
];

impl Repl<'_> {
    pub(super) fn command(&mut self, text: &str) -> Next {
        let (name, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
        let rest = rest.trim();
        let outcome = match name {
            "quit" | "q" | "exit" => return Next::Quit,
            "help" | "h" | "?" if rest.is_empty() => {
                self.help();
                Ok(())
            }
            "help" | "h" | "?" | "doc" => self.doc(rest),
            "vars" => self.list_variables(),
            "params" => self.list_params(),
            "type" | "t" => self.type_of(rest),
            "time" => self.time(rest),
            "profile" => self.profile(rest),
            "fd" => self.finite_differences(rest),
            "render" => self.render(rest),
            "watch" => self.watch(rest),
            "set" => self.set(rest),
            "step" => self.step(rest),
            "reset" => self.reset(),
            "undo" => self.undo(),
            "edit" => self.edit(rest),
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

    fn help(&mut self) {
        let rows: Vec<String> =
            NAMES.iter().map(|(name, args, what)| format!("  {:<24} {what}", format!(":{name} {args}"))).collect();
        let text = format!(
            "Type an expression to see its value, a declaration to add or replace it, an action to run it.\n\
             `grad(loss)` shows the derivative with respect to every param; `_` is the last value, `_1`, `_2`, … all of them.\n\n{}",
            rows.join("\n")
        );
        self.world.print(&text);
    }

    /// `:set NAME EXPR` or `:set NAME = EXPR`.
    fn set(&mut self, text: &str) -> Result<(), Diagnostic> {
        let end = text.find(|c: char| !(c.is_alphanumeric() || c == '_')).unwrap_or(text.len());
        let (name, rest) = text.split_at(end);
        let value = rest.trim_start().strip_prefix('=').unwrap_or(rest).trim();
        if name.is_empty() || value.is_empty() {
            return Err(usage("`:set` needs a name and a value", "type `:set NAME EXPR`"));
        }
        if rest.starts_with(['[', '.']) {
            let message = format!(
                "`:set` moves a whole param, and `{}` is part of one",
                text.split_whitespace().next().unwrap_or("")
            );
            return Err(usage(&message, &format!("type `:set {name} EXPR` with all of it")));
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
            return self.enter(&format!("let {name} = {value}"));
        };
        let before = self.before(&format!(":set {text}"));
        let Some(expr) = self.expression(value)? else { return Ok(()) };
        let declared = &self.living.engine.program().decl(id).ty;
        let (wants, has) = (declared.without_unit(), expr.ty.without_unit());
        if let (Some((_, wants)), Some((_, has))) = (wants, has)
            && wants != has
        {
            let message = format!("`{name}` is of type {declared}, this is of type {}", expr.ty);
            let help = if wants { "angles have a unit: `30deg`" } else { "it has no unit" };
            return Err(Diagnostic::error("dscene::type::unit", message)
                .label(expr.span, expr.ty.to_string())
                .help(help));
        }
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
            "dscene::run::value" => refused.label(expr.span, "this is not"),
            _ => refused,
        })?;
        self.can_undo(before, None);
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
        let before = self.before(format!(":step {text}").trim_end());
        let flow = self.living.advance(count, &mut *self.world);
        self.can_undo(before, None);
        if let Some(optimization) = &self.living.optimization {
            let (done, total) = (optimization.done(), optimization.total());
            let loss = optimization.last_loss().map_or("–".to_owned(), show::digits);
            self.world.print(&format!("step {done} of {total}: {} = {loss}", optimization.name()));
        }
        flow.map(|_| ())
    }

    fn reset(&mut self) -> Result<(), Diagnostic> {
        let before = self.before(":reset");
        self.living.reset();
        self.can_undo(before, None);
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
        match self.expression(&call)? {
            Some(expr) => self.show(&expr),
            None => Ok(()),
        }
    }

    /// Shows the program on a live page until Ctrl-C.
    fn watch(&mut self, camera: &str) -> Result<(), Diagnostic> {
        let camera = Some(camera).filter(|name| !name.is_empty());
        super::choose_camera(self.living.engine.program(), camera)?;
        let before = self.before(format!(":watch {}", camera.unwrap_or("")).trim_end());
        watch::session(&mut self.living, camera)?;
        // It ends in no other way.
        clear_interrupt();
        self.can_undo(before, None);
        self.world.note("the page has ended; params are where it left them");
        Ok(())
    }

    /// Opens a declaration, or else the last entry, in an editor; what it is then is the next entry.
    fn edit(&mut self, name: &str) -> Result<(), Diagnostic> {
        let program = self.living.engine.program();
        let text = match name {
            "" => self.last_entry.clone(),
            name => match program.find(name) {
                Some(id) if program.decl(id).user => program.sources.text(program.decl(id).span).to_owned(),
                _ => return Err(self.unknown(name)),
            },
        };
        let variable = |name: &str| std::env::var(name).ok().filter(|value| !value.trim().is_empty());
        let Some(editor) = variable("VISUAL").or_else(|| variable("EDITOR")) else {
            return Err(usage("`:edit` does not know your editor", "set $EDITOR, as in `EDITOR=nano dsl repl`"));
        };
        let path = std::env::temp_dir().join(format!("dscene-{}.dscene", std::process::id()));
        write_atomically(&path, format!("{text}\n").as_bytes()).map_err(|e| cannot_write(&path, &e))?;
        let edited = edited(&editor, &path);
        // Nobody needs the file any more; that it cannot be removed is no reason to complain.
        let _ = std::fs::remove_file(&path);
        let edited = edited?;
        if edited.trim().is_empty() || edited.trim() == text.trim() {
            self.world.note("nothing was changed");
            return Ok(());
        }
        self.last_entry = edited.trim().to_owned();
        self.enter(edited.trim())
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
        self.spare(&path)?;
        let sources = &self.living.engine.program().sources;
        let root = sources.iter().find(|(_, f)| f.path.is_some() && f.path == self.living.file).map(|(id, _)| id);
        let folder = path.parent().unwrap_or(Path::new(""));
        let Script { text: script, lost } =
            script_with_values(&mut self.living.engine, root, &self.typed, Vec::new(), Some(folder))?;
        write_atomically(&path, script.as_bytes()).map_err(|e| cannot_write(&path, &e))?;
        self.world.note(&format!("saved {}", path.display()));
        tell_lost(&lost, self.world);
        self.saved.insert(path, script);
        Ok(())
    }

    /// Refuses to replace a text that this session has neither read as its script nor saved.
    fn spare(&self, path: &Path) -> Result<(), Diagnostic> {
        let there = match std::fs::read(path) {
            Ok(bytes) => bytes.strip_prefix("\u{feff}".as_bytes()).map_or(bytes.clone(), <[u8]>::to_vec),
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(()),
            Err(e) => return Err(cannot_write(path, &e)),
        };
        let is_script = self.living.file.as_deref() == Some(path);
        let mut sources = self.living.engine.program().sources.iter();
        let is_known = self.saved.get(path).is_some_and(|text| text.as_bytes() == there)
            || is_script
                && sources.any(|(_, file)| file.path.as_deref() == Some(path) && file.text.as_bytes() == there);
        if is_known {
            return Ok(());
        }
        let (why, help) = match is_script {
            true => ("it has changed since it was read", "`:reload` reads it again; or give the script another name"),
            false => ("there is a file of that name", "give the script another name, or remove that file first"),
        };
        let message = format!("cannot save `{}`: {why}, which would be lost", path.display());
        Err(Diagnostic::error("dscene::run::write", message).help(help))
    }
}

pub(super) fn usage(message: &str, help: &str) -> Diagnostic {
    Diagnostic::error("dscene::repl::usage", message).help(help)
}

/// What is in a file once the editor has ended. Its command may have arguments, as in `code --wait`.
fn edited(editor: &str, path: &Path) -> Result<String, Diagnostic> {
    let failed = |why: String| {
        Diagnostic::error("dscene::repl::editor", format!("the editor `{editor}` {why}"))
            .help("set $EDITOR to a command that waits until the file is closed, as `code --wait` does")
    };
    let mut words = editor.split_whitespace();
    let program = words.next().unwrap_or(editor);
    match Command::new(program).args(words).arg(path).status() {
        Err(error) => Err(failed(format!("cannot be started: {}", crate::files::describe_io(&error)))),
        Ok(status) if !status.success() => {
            Err(failed("has ended with an error: what was written is dropped".to_owned()))
        }
        Ok(_) => std::fs::read_to_string(path).map_err(|e| failed(format!("has left no text: {e}"))),
    }
}
