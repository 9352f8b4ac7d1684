//! A value whose derivative can be taken later, by whoever knows its adjoint: a program that computes a loss of its own from an image.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use super::derivative::{columns, rows};
use super::{Engine, Result, error, until};
use crate::check::hir::{Expr, Target};
use crate::natives::value::Value;
use crate::source::Span;
use crate::stop;
use crate::tape::{self, Tensor, Var};

/// The value of an expression at params, with the graph that it was computed by. The params may move on: what was recorded stays.
pub struct Linear {
    /// The value itself.
    pub value: Value,
    output: Var,
    leaves: Vec<Var>,
    span: Span,
    interrupt: Option<Arc<AtomicBool>>,
}

impl Engine {
    /// An expression made of numbers, such as an image, to be differentiated with respect to `wrt`.
    pub fn linear(&mut self, of: &Expr, wrt: &[Target]) -> Result<Linear> {
        let (span, interrupt) = (of.span, self.options.interrupt.clone());
        self.on_stack(|e| {
            e.fresh_frame(|e| {
                e.with_leaves(wrt, span, |engine, leaves| {
                    let (value, output) = engine.numbers(of)?;
                    Ok(Linear { value, output, leaves: leaves.to_vec(), span, interrupt })
                })
            })
        })
    }

    /// Sets the seed from which samples of derivatives are drawn, where it is another than that of the values. (Even from the same seed,
    /// values and derivatives share no samples; with another one, several derivatives of one value are independent of one another.)
    pub fn set_derivative_seed(&mut self, seed: Option<u64>) {
        if seed != self.derivative_seed {
            self.derivative_seed = seed;
            self.forget(|d| d.sample);
        }
    }
}

impl Linear {
    /// Shape of the value.
    pub fn shape(&self) -> &[usize] {
        self.output.shape()
    }

    /// Shapes of the derivatives by each of the targets: those of the targets, but 3 for a rotation.
    pub fn leaf_shapes(&self) -> impl Iterator<Item = &[usize]> {
        self.leaves.iter().map(Var::shape)
    }

    /// The derivative of ⟨`adjoint`, value⟩ with respect to each target, in reverse mode.
    pub fn pull_back(&self, adjoint: Tensor) -> Result<Vec<Tensor>> {
        self.assert_fits(&adjoint, self.output.shape(), "the adjoint", "the value")?;
        self.differentiated(|| tape::backward_with(&self.output, adjoint, &self.leaves))
    }

    /// The derivative of the value as the targets move along `tangents`, in forward mode; those that are `None` stay.
    pub fn push_forward(&self, tangents: Vec<Option<Tensor>>) -> Result<Tensor> {
        let mut moving = Vec::with_capacity(tangents.len());
        for (leaf, tangent) in self.leaves.iter().zip(tangents) {
            let Some(tangent) = tangent else { continue };
            self.assert_fits(&tangent, leaf.shape(), "the tangent", "what moves along it")?;
            moving.push((leaf.clone(), tangent));
        }
        self.differentiated(|| tape::forward(&self.output, &moving))
    }

    /// All derivatives, by target: the shape of each is that of the value followed by that of the target.
    pub fn jacobian(&self) -> Result<Vec<Tensor>> {
        let found = until(self.interrupt.clone(), || rows(&self.output, &self.leaves, self.span)).and_then(|x| x)?;
        let mut found = found.into_iter();
        let of_leaf = |leaf: &Var| {
            let rows: Vec<Tensor> = found.by_ref().take(leaf.len()).collect();
            columns(&rows, self.output.shape(), leaf.shape())
        };
        Ok(self.leaves.iter().map(of_leaf).collect())
    }

    fn differentiated<T>(&self, work: impl FnOnce() -> tape::Result<T>) -> Result<T> {
        let work = || {
            let found = work();
            // An interrupted rendering leaves meaningless numbers.
            stop::check();
            found.map_err(|e| error::gradient(e.0, self.span))
        };
        until(self.interrupt.clone(), work).and_then(|found| found)
    }

    fn assert_fits(&self, given: &Tensor, shape: &[usize], what: &str, like: &str) -> Result<()> {
        if given.shape == shape {
            return Ok(());
        }
        let (found, wanted) = (Tensor::shape_text(&given.shape), Tensor::shape_text(shape));
        Err(error::shape(format!("{what} is a {found}, {like} a {wanted}"), self.span))
    }
}
