//! How the REPL shows values: with their types, noisy numbers with their errors, images as pictures.

use std::path::Path;

use serde_json::{Value as Json, json};

use super::{PATIENCE, REPEATS, Repl, answer, picture};
use crate::check::hir;
use crate::cli::render::{cannot_save, in_folder};
use crate::diag::Diagnostic;
use crate::eval;
use crate::natives::value::Value;
use crate::session::measure::repeat_seed;
use crate::session::save::{image_of, save_value};
use crate::session::stats::Moments;
use crate::session::world::interrupted;
use crate::session::{MeasureOptions, measure, show};
use crate::tape::{Tensor, Var};

/// A number that depends on the seed.
struct Noisy {
    mean: f64,
    std_error: f64,
    repeats: u64,
}

impl Repl<'_> {
    /// What an entry has found: to people as text, to programs as fields of the answer.
    pub(super) fn tell(&mut self, text: impl FnOnce() -> String, fields: impl FnOnce() -> Json) {
        match &self.answer {
            Some(answer) => answer.borrow_mut().add(fields()),
            None => self.world.print(&text()),
        }
    }

    /// Shows an expression's value and type, and keeps it as `_`.
    pub(super) fn show(&mut self, expr: &hir::Expr) -> Result<(), Diagnostic> {
        let text = self.living.engine.program().sources.text(expr.span).to_owned();
        if let hir::ExprKind::Derivative(derivative) = &expr.kind
            && derivative.is_by_all()
        {
            let name = self.living.engine.program().sources.text(derivative.of.span).to_owned();
            return self.gradients(&name, &derivative.of, None);
        }
        self.living.engine.set_sample_seed(repeat_seed(self.living.common.seed, 0));
        let started = std::time::Instant::now();
        let mut value = self.living.engine.eval(expr)?;
        let seconds = started.elapsed().as_secs_f64();
        let noisy = match value.number() {
            Some(first) if expr.ty.is_scalar() => self.noisy(expr, first, seconds)?,
            _ => None,
        };
        if let Some(noisy) = &noisy {
            value = value.with_var(Var::constant(Tensor::scalar(noisy.mean)));
        }
        let name = self.keep(&text, &expr.ty, &value);
        if self.answer.is_some() {
            return self.answer_value(expr, &value, noisy, &name, seconds);
        }
        let is_signed = is_signed(self.living.engine.program(), expr);
        self.draw(&value, is_signed);
        let shown = match &noisy {
            Some(Noisy { mean, std_error, .. }) => show::plus_minus(*mean, *std_error),
            None => eval::show(&value, &expr.ty),
        };
        let name = if self.is_terminal { format!("   {}", super::dim(&name)) } else { String::new() };
        let unit = eval::unit_of_slope(self.living.engine.program(), expr);
        self.world.print(&format!("{shown}{unit}   : {}{name}", expr.ty));
        Ok(())
    }

    /// An image as a picture, if the output is a terminal.
    fn draw(&mut self, value: &Value, is_signed: bool) {
        let Value::Image(_) = value else { return };
        let Some(image) = image_of(value).filter(|_| self.is_terminal) else { return };
        if !is_signed {
            return self.world.print(picture::drawn(&image, self.protocol).trim_end());
        }
        let (image, legend) = picture::signed(&image);
        self.world.print(picture::drawn(&image, self.protocol).trim_end());
        self.world.print(&legend);
    }

    fn answer_value(
        &mut self,
        expr: &hir::Expr,
        value: &Value,
        noisy: Option<Noisy>,
        name: &str,
        seconds: f64,
    ) -> Result<(), Diagnostic> {
        let mut fields = answer::of_value(value, &expr.ty);
        if let Some(Noisy { std_error, repeats, .. }) = noisy {
            fields["std_error"] = json!(std_error);
            fields["repeats"] = json!(repeats);
        }
        fields["name"] = json!(name);
        fields["seconds"] = json!(seconds);
        if let (Value::Image(_), Some(folder)) = (value, &self.living.common.out) {
            let path = in_folder(Some(folder), Path::new(&format!("{name}.exr")))?;
            save_value(value, &expr.ty, &path).map_err(|e| cannot_save(&path, e))?;
            fields["image"]["file"] = json!(path.display().to_string());
        }
        self.tell(String::new, || fields);
        Ok(())
    }

    /// Evaluates a number with other seeds; `None` if it does not depend on them.
    fn noisy(&mut self, expr: &hir::Expr, first: f64, seconds: f64) -> Result<Option<Noisy>, Diagnostic> {
        let affordable = (PATIENCE / seconds.max(1e-9)).min(f64::from(REPEATS)) as u64;
        let mut moments = Moments::default();
        moments.add(&[first]);
        let mut repeats = 1;
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
            repeats += 1;
        }
        self.living.engine.set_sample_seed(repeat_seed(self.living.common.seed, 0));
        let std_error = moments.std_error().first().copied().unwrap_or(0.0);
        Ok((std_error > 0.0).then(|| Noisy { mean: moments.mean()[0], std_error, repeats }))
    }

    /// The table of all params that reach a scalar.
    pub(super) fn gradients(&mut self, name: &str, of: &hir::Expr, fd_step: Option<f64>) -> Result<(), Diagnostic> {
        let ids = self.living.engine.reaching_params(of)?;
        let program = self.living.engine.program();
        let target = |id: &hir::DeclId| hir::Target { decl: *id, path: Vec::new() };
        let wrt: Vec<(String, hir::Target)> =
            ids.iter().map(|id| (program.decl(*id).name.clone(), target(id))).collect();
        if wrt.is_empty() {
            return Err(Diagnostic::error("dscene::repl::gradient", format!("no param reaches `{name}`"))
                .label(of.span, "does not depend on any param"));
        }
        let seed = self.living.common.seed;
        let options = MeasureOptions { repeats: REPEATS, seed, fd_step, warm: false };
        let Some(measured) = measure(&mut self.living.engine, of, &wrt, options, &interrupted)? else {
            return Err(Diagnostic::error(eval::INTERRUPTED, "stopped"));
        };
        let file = self.living.file.as_ref().map(|f| f.display().to_string()).unwrap_or_default();
        self.tell(
            || measured.to_text(name, false),
            || json!({ "gradient": measured.to_json(&file, name, seed, rayon::current_num_threads()) }),
        );
        Ok(())
    }
}

/// Whether an image has values on both sides of zero by what it is: a derivative or a difference, perhaps by another name.
fn is_signed(program: &hir::Program, expr: &hir::Expr) -> bool {
    let mut expr = expr;
    loop {
        match &expr.kind {
            hir::ExprKind::Derivative(d) if d.kind == hir::DerivativeKind::Estimate => expr = &d.of,
            hir::ExprKind::Derivative(_) | hir::ExprKind::Binary { op: hir::BinaryOp::Sub, .. } => return true,
            hir::ExprKind::Decl(id) => match &program.decl(*id).body {
                Some(body) => expr = body,
                None => return false,
            },
            _ => return false,
        }
    }
}
