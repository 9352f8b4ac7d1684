//! Coarse to fine: the `blur` of a stage smooths the pictures that a loss compares.
//!
//! Where an edge of a rendering is further from that of a photograph than it is wide, the difference of the two does not say which way to go.
//! The difference of blurred pictures does, from as far away as the blur is wide.

use crate::check::hir::{BinaryOp, DeclId, FnDecl};
use crate::natives::{self, Args, value::Value};
use crate::source::Span;
use crate::tape::Tensor;

use super::expr::arithmetic;
use super::{Engine, Result, error};

/// Added to blurred weights, so that pixels far from all that count are 0 and not 0 / 0.
const NO_WEIGHT: f64 = 1e-12;

impl Engine {
    /// The arguments of a loss of two pictures, as the stage's `blur` has them: both blurred, in calls that the user wrote (what the library
    /// does within a loss is done with blurred pictures already). Pixels that a `weight` hides are not blurred into others: weighted pictures
    /// are divided by the blurred weight (Knutsson & Westin 1993).
    pub(super) fn blur_compared(
        &mut self,
        function: DeclId,
        f: &FnDecl,
        args: &mut [Option<Value>],
        span: Span,
    ) -> Result<()> {
        let [Some(Value::Image(_)), Some(Value::Image(_)), ..] = args else { return Ok(()) };
        if self.is_library(span) || !self.program.compares(function) {
            return Ok(());
        }
        self.depends(|d| d.settings.blur = true);
        let Some(sigma) = self.overrides.blur.filter(|sigma| *sigma > 0.0) else { return Ok(()) };
        let weight = f.params.iter().zip(args.iter()).find(|(param, _)| param.name == "weight");
        let weight = weight.and_then(|(_, weight)| weight.clone());
        for picture in args.iter_mut().take(2).flatten() {
            *picture = match &weight {
                Some(weight) if fits(weight, picture) => {
                    let nothing = Value::tensor(Tensor::scalar(NO_WEIGHT));
                    let op = |op, x: &Value, y: &Value| arithmetic(op, x, y).map_err(|e| error::shape(e, span));
                    let below = op(BinaryOp::Add, &self.blurred(weight, sigma, span)?, &nothing)?;
                    let weighted = op(BinaryOp::Mul, picture, weight)?;
                    op(BinaryOp::Div, &self.blurred(&weighted, sigma, span)?, &below)?
                }
                _ => self.blurred(picture, sigma, span)?,
            };
        }
        Ok(())
    }

    fn blurred(&self, picture: &Value, sigma: f64, span: Span) -> Result<Value> {
        let blur = natives::find("blur").ok_or_else(|| error::internal("there is no `blur`".to_owned(), span))?;
        let values = [picture.clone(), Value::tensor(Tensor::scalar(sigma))];
        let args = Args { names: &["image", "sigma"], values: &values, context: &self.context() };
        blur(&args).map_err(|e| error::native(&e, span, &[], "blur"))
    }
}

/// Whether a weight is one for each pixel of a picture, or for each of its numbers.
fn fits(weight: &Value, picture: &Value) -> bool {
    let (Value::Image(weight), Value::Image(picture)) = (weight, picture) else { return false };
    let (weight, picture) = (weight.shape(), picture.shape());
    weight[..2] == picture[..2] && (weight[2] == 1 || weight[2] == picture[2])
}
