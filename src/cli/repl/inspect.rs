//! Commands that look at the program and change nothing.

use std::time::Instant;

use serde_json::json;

use super::commands::{NAMES, usage};
use super::{Repl, repeat_seed};
use crate::check::hir;
use crate::diag::{self, Diagnostic};
use crate::eval;
use crate::ide::describe;
use crate::session::clock::{Stopwatch, human_seconds};
use crate::session::show;
use crate::source::SourceMap;
use crate::syntax;
use crate::tape::Tensor;

impl Repl<'_> {
    /// A name with its documentation, or a command: `:doc render` is the function, `:doc :render` the command.
    pub(super) fn doc(&mut self, name: &str) -> Result<(), Diagnostic> {
        if name.is_empty() {
            return Err(usage("`:doc` needs a name", "type `:doc sphere`"));
        }
        let program = self.living.engine.program();
        let found = program.find(name);
        let bare = name.trim_start_matches(':');
        if let (None, Some((name, args, what))) = (found, NAMES.iter().find(|(n, ..)| *n == bare)) {
            let head = format!(":{name} {args}");
            self.world.print(&format!("{}\n  {what}", head.trim_end()));
            return Ok(());
        }
        let Some(id) = found else { return Err(self.unknown(name)) };
        let decl = program.decl(id);
        let head = describe::head(program, decl);
        let text = if decl.doc.trim().is_empty() { head } else { format!("{head}\n\n{}", decl.doc.trim_end()) };
        self.world.print(&text);
        Ok(())
    }

    pub(super) fn unknown(&self, name: &str) -> Diagnostic {
        let program = self.living.engine.program();
        let names = program.ids().map(|id| program.decl(id).name.as_str());
        Diagnostic::error("dscene::name::unknown", format!("there is no `{name}`"))
            .help_opt(diag::suggest(name, names).map(|n| format!("did you mean `{n}`?")))
    }

    pub(super) fn type_of(&mut self, text: &str) -> Result<(), Diagnostic> {
        let Some(expr) = self.expression(text)? else { return Ok(()) };
        let space = self.space_of(&expr);
        self.tell(|| format!("{}{space}", expr.ty), || json!({ "type": expr.ty.to_string() }));
        Ok(())
    }

    /// What is declared by the script and by hand, and the values that were shown. Nothing is evaluated for it.
    pub(super) fn list_variables(&mut self) -> Result<(), Diagnostic> {
        let mut rows = vec![["name", "type", "value"].map(str::to_owned).to_vec()];
        let engine = &self.living.engine;
        let program = engine.program();
        for decl in program.ids().map(|id| program.decl(id)).filter(|d| d.user && !self.is_shown_value(&d.name)) {
            let value = match &decl.kind {
                hir::DeclKind::Fn(_) => describe::head(program, decl),
                _ => match engine.known_value(decl.id) {
                    Some(value) => eval::brief(&value, &decl.ty),
                    None => "not evaluated yet".to_owned(),
                },
            };
            rows.push(vec![decl.name.clone(), decl.ty.to_string(), crate::session::run::shortened(&value)]);
        }
        for kept in self.values.all() {
            let value = kept.value.as_ref().map_or("not kept".to_owned(), |value| eval::brief(value, &kept.ty));
            rows.push(vec![kept.name.clone(), kept.ty.to_string(), crate::session::run::shortened(&value)]);
        }
        if rows.len() == 1 {
            self.world.note("nothing is declared: type `let name = value`, or `:load FILE`");
        } else {
            self.world.print(&show::list(&rows));
        }
        Ok(())
    }

    fn is_shown_value(&self, name: &str) -> bool {
        self.values.all().any(|kept| kept.name == name)
    }

    /// What a declaration says of a param beside its type.
    fn space_of(&self, expr: &hir::Expr) -> String {
        let hir::ExprKind::Decl(id) = expr.kind else { return String::new() };
        let program = self.living.engine.program();
        let hir::DeclKind::Param(param) = &program.decl(id).kind else { return String::new() };
        describe::beside(program, param)
    }

    pub(super) fn list_params(&mut self) -> Result<(), Diagnostic> {
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
            self.world.print(&show::list(&rows));
        }
        Ok(())
    }

    pub(super) fn time(&mut self, text: &str) -> Result<(), Diagnostic> {
        let Some(expr) = self.expression(text)? else { return Ok(()) };
        let watch = Stopwatch::start();
        let value = self.living.engine.eval(&expr)?;
        let elapsed = watch.elapsed();
        let text = eval::brief(&value, &expr.ty);
        self.world.print(&format!("{text}\n{} (CPU {})", human_seconds(elapsed.wall), human_seconds(elapsed.cpu)));
        Ok(())
    }

    pub(super) fn finite_differences(&mut self, text: &str) -> Result<(), Diagnostic> {
        let text = if text.is_empty() {
            let program = self.living.engine.program();
            match program.losses().next() {
                Some(id) => program.decl(id).name.clone(),
                None => return Err(usage("the script has no loss", "type `:fd EXPR`")),
            }
        } else {
            text.to_owned()
        };
        match self.expression(&text)? {
            Some(expr) => self.gradients(&text, &expr, Some(0.01)),
            None => Ok(()),
        }
    }

    /// Evaluates an expression with new samples, as a step of an optimisation does: what no param reaches stays as it was computed.
    pub(super) fn profile(&mut self, text: &str) -> Result<(), Diagnostic> {
        let mut sources = SourceMap::new();
        let source = sources.add("<line>", None, text);
        let begun = Instant::now();
        let _ = syntax::parse_expr(&sources, source);
        let parse = begun.elapsed().as_secs_f64();
        let begun = Instant::now();
        let Some(expr) = self.expression(text)? else { return Ok(()) };
        let check = (begun.elapsed().as_secs_f64() - parse).max(0.0);

        let engine = &mut self.living.engine;
        let seed = self.living.common.seed;
        let before = engine.statistics();
        engine.set_sample_seed(repeat_seed(seed, PROFILED));
        let begun = Instant::now();
        let value = match &expr.kind {
            hir::ExprKind::Derivative(derivative) if derivative.is_by_all() => {
                // `grad(loss)` is by all params that reach it.
                let target = |decl: hir::DeclId| hir::Target { decl, path: Vec::new() };
                let wrt: Vec<hir::Target> = engine.reaching_params(&derivative.of)?.into_iter().map(target).collect();
                engine.gradient(&derivative.of, &wrt).map(|_| None)
            }
            _ => engine.eval(&expr).map(Some),
        };
        let whole = begun.elapsed().as_secs_f64();
        let after = engine.statistics();
        engine.set_sample_seed(repeat_seed(seed, 0));
        let value = value?;
        let scene = (after.scenes_took - before.scenes_took).as_secs_f64();
        let render = (after.renders_took - before.renders_took).as_secs_f64();
        let derivative = (after.derivatives_took - before.derivatives_took).as_secs_f64();
        let rest = (whole - scene - render - derivative).max(0.0);
        let total = parse + check + whole;
        let parts = [
            ("parse", parse, String::new()),
            ("check", check, String::new()),
            ("eval", rest, format!("{} evaluated", after.declarations - before.declarations)),
            ("scene", scene, format!("{} built", after.scenes - before.scenes)),
            ("render", render, format!("{} rendered", after.renders - before.renders)),
            ("derivative", derivative, String::new()),
        ];
        let row = |(name, seconds, what): &(&str, f64, String)| {
            vec![(*name).to_owned(), human_seconds(*seconds), format!("{:.0} %", 100.0 * seconds / total), what.clone()]
        };
        let mut rows: Vec<Vec<String>> = parts.iter().map(row).collect();
        rows.push(vec!["whole".to_owned(), human_seconds(total), String::new(), String::new()]);
        let shown = value.map_or(String::new(), |value| format!("{}\n", eval::brief(&value, &expr.ty)));
        let fields = || {
            let mut seconds: serde_json::Map<_, _> =
                parts.iter().map(|(n, s, _)| ((*n).to_owned(), json!(s))).collect();
            seconds.insert("whole".to_owned(), json!(total));
            json!({ "profile": seconds, "type": expr.ty.to_string() })
        };
        self.tell(|| format!("{shown}{}", show::table(&rows)), fields);
        Ok(())
    }
}

/// The repeat whose samples a profile draws: none that was shown has them.
const PROFILED: u64 = 1 << 20;
