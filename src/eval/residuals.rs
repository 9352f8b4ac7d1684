//! Losses that are sums of squares, for the solvers that use it.

use std::cell::Cell;
use std::time::{Duration, Instant};

use crate::check::hir::{Expr, Target};
use crate::diag::Diagnostic;
use crate::stop;
use crate::tape::{self, TapeError, Tensor, Var};

use super::{Engine, Result, error, mix};

/// Most numbers of the derivatives of residuals that are computed one by one.
const MAX_NUMBERS: usize = 1 << 26;
/// Most numbers that the renderings of one measurement store of their derivatives, 12 bytes each.
const ROOM: usize = 1 << 25;

/// A loss Σ r², up to a constant.
pub struct Residuals {
    /// The loss itself.
    pub loss: f64,
    /// The residuals r, each times the root of its weight.
    pub values: Vec<f64>,
    nodes: Vec<Var>,
    /// Roots of weights.
    roots: Vec<Vec<f64>>,
    leaves: Vec<Var>,
    /// Wall time of products that the engine has not counted yet.
    took: Cell<Duration>,
}

impl Residuals {
    /// Numbers of each param; a rotation has 3.
    pub fn unknowns(&self) -> impl Iterator<Item = usize> {
        self.leaves.iter().map(Var::len)
    }

    /// J `direction`, which has a number for each number of each param; a rotation has 3.
    pub fn along(&self, direction: &[f64]) -> Result<Vec<f64>, TapeError> {
        self.timed(|| self.product_along(direction))
    }

    /// Jᵀ `weights`, which has a number for each residual.
    pub fn against(&self, weights: &[f64]) -> Result<Vec<f64>, TapeError> {
        self.timed(|| self.product_against(weights))
    }

    fn timed<T>(&self, work: impl FnOnce() -> T) -> T {
        let begun = Instant::now();
        let done = work();
        self.took.set(self.took.get() + begun.elapsed());
        done
    }

    fn product_along(&self, direction: &[f64]) -> Result<Vec<f64>, TapeError> {
        let mut rest = direction;
        let mut tangents = Vec::with_capacity(self.leaves.len());
        for leaf in &self.leaves {
            let Some((own, others)) = rest.split_at_checked(leaf.len()) else { break };
            tangents.push((leaf.clone(), Tensor { shape: leaf.shape().to_vec(), data: own.to_vec() }));
            rest = others;
        }
        let found = tape::jacobian(&self.nodes, &[tangents])?;
        stop::check();
        let parts = found.iter().flatten().zip(&self.roots);
        Ok(parts.flat_map(|(along, roots)| along.data.iter().zip(roots).map(|(x, root)| x * root)).collect())
    }

    fn product_against(&self, weights: &[f64]) -> Result<Vec<f64>, TapeError> {
        let mut rest = weights;
        let mut seeds = Vec::with_capacity(self.nodes.len());
        for (node, roots) in self.nodes.iter().zip(&self.roots) {
            let Some((own, others)) = rest.split_at_checked(roots.len()) else { break };
            let data = own.iter().zip(roots).map(|(x, root)| x * root).collect();
            seeds.push(Tensor { shape: node.shape().to_vec(), data });
            rest = others;
        }
        let found = tape::backward_from(&self.nodes, seeds, &self.leaves)?;
        stop::check();
        Ok(found.into_iter().flat_map(|t| t.data).collect())
    }
}

impl Engine {
    /// The residuals of a loss.
    pub fn residuals(&mut self, of: &Expr, wrt: &[Target]) -> Result<Residuals> {
        self.on_stack(|e| e.fresh_frame(|e| e.residuals_here(of, wrt)))
    }

    /// Runs `f` with samples that are independent of the usual ones.
    pub fn with_other_samples<T>(&mut self, f: impl FnOnce(&mut Engine) -> T) -> T {
        let seed = self.sample_seed;
        self.set_sample_seed(mix(seed, 0x6F_7468_6572));
        let result = f(self);
        self.set_sample_seed(seed);
        result
    }

    /// Their derivatives, from samples of their own: a row for each number of each of `wrt`, in order; a rotation has 3.
    pub fn residual_rows(&mut self, of: &Expr, residuals: &Residuals) -> Result<Vec<Vec<f64>>> {
        let failed = |e: tape::TapeError| error::gradient(e.0, of.span);
        let elements: Vec<(&Var, usize)> =
            residuals.leaves.iter().flat_map(|l| (0..l.len()).map(move |i| (l, i))).collect();
        let numbers = elements.len().saturating_mul(residuals.values.len());
        if numbers > MAX_NUMBERS {
            let (n, m) = (elements.len(), residuals.values.len());
            let message = format!("{n} unknowns and {m} residuals are too many for a solver of least squares");
            return Err(error::gradient(message, of.span).help("take `adam`, or render a smaller film"));
        }
        self.fresh_frame(|engine| {
            let begun = Instant::now();
            let mut rows = Vec::with_capacity(elements.len());
            for group in elements.chunks(crate::grad::MAX_DIRECTIONS) {
                let directions: Vec<_> = group.iter().map(|(leaf, i)| tape::unit(leaf, *i)).collect();
                let found = tape::jacobian(&residuals.nodes, &directions);
                stop::check();
                let found = found.map_err(failed)?;
                rows.extend((0..group.len()).map(|k| -> Vec<f64> {
                    let parts = found.iter().zip(&residuals.roots);
                    parts.flat_map(|(along, roots)| along[k].data.iter().zip(roots).map(|(x, root)| x * root)).collect()
                }));
            }
            engine.statistics.derivatives_took += begun.elapsed();
            Ok(rows)
        })
    }

    /// Makes the derivatives of residuals those of one matrix, J: their samples are drawn here, and [`Residuals::along`] and
    /// [`Residuals::against`] compute products with it and with its transpose.
    pub fn fix(&mut self, of: &Expr, residuals: &Residuals) -> Result<()> {
        self.fresh_frame(|engine| {
            let begun = Instant::now();
            let fixed = tape::fix(&residuals.nodes, &residuals.leaves, ROOM);
            engine.statistics.derivatives_took += begun.elapsed();
            stop::check();
            fixed.map_err(|e| error::gradient(e.0, of.span))
        })
    }

    /// Counts the time that products with the derivatives of residuals took since they were counted last.
    pub fn count_products(&mut self, residuals: &[Residuals]) {
        self.statistics.derivatives_took += residuals.iter().map(|residuals| residuals.took.take()).sum::<Duration>();
    }

    fn residuals_here(&mut self, of: &Expr, wrt: &[Target]) -> Result<Residuals> {
        self.with_leaves(wrt, of.span, |engine, leaves| {
            let (begun, before) = (Instant::now(), engine.statistics);
            let (_, loss) = engine.numbers(of)?;
            engine.valued(begun, before);
            stop::check();
            if loss.len() != 1 {
                let found = Tensor::shape_text(loss.shape());
                return Err(error::gradient(format!("a loss is a number, this is a {found}"), of.span));
            }
            let squares = tape::squares(&loss, leaves).map_err(|e| not_squares(&e.0, of))?;
            let roots: Vec<Vec<f64>> =
                squares.iter().map(|s| s.weights.data.iter().map(|w| w.sqrt()).collect()).collect();
            let weighted = squares.iter().zip(&roots);
            let values =
                weighted.flat_map(|(s, r)| s.residual.value().data.iter().zip(r).map(|(x, r)| x * r)).collect();
            let nodes = squares.iter().map(|s| s.residual.clone()).collect();
            let loss = loss.item().unwrap_or(f64::NAN);
            Ok(Residuals { loss, values, nodes, roots, leaves: leaves.to_vec(), took: Cell::default() })
        })
    }
}

fn not_squares(why: &str, of: &Expr) -> Diagnostic {
    Diagnostic::error("dscene::run::squares", format!("this loss is not a sum or mean of squares: {why}"))
        .label(of.span, "needed by a solver of least squares")
        .help("`mse`, `l2`, `pyramid_loss` and sums of such are; `adam` takes any loss")
}
