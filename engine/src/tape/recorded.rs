//! Derivatives as nodes of the graph, so that they can be differentiated again.
//!
//! A derivative that a program asks for becomes a node ([`DeferredDerivative`]). Its value is computed by [`super::backward`] or [`super::forward`] on
//! plain numbers. If the derivative of that node is asked for, the first derivative is computed again, this time recorded as operations
//! of the tape ([`gradient`]), and the node is then differentiated through that record. So first derivatives cost no more than without
//! this, and second derivatives follow from the rules of the recorded operations. Renderings have first derivatives only; asking for
//! second ones is an error.

use std::collections::hash_map::Entry;
use std::collections::{HashMap, HashSet};
use std::sync::{Arc, OnceLock};

use super::op::{AxisFilter, Binary, Op, Unary};
use super::{Broadcast, Result, Slice, TapeError, Tensor, Var, fail, plan};

/// Most numbers in a Jacobian that is differentiated again. Each row of it is recorded as a graph of its own.
const MAX_ROWS: usize = 4096;

/// The message about an operation without second derivatives, after its name.
const FIRST_ONLY: &str = "has first derivatives only, and this asks for the derivative of one";

/// Advice for a message of this module.
pub fn help(message: &str) -> Option<&'static str> {
    message.contains(FIRST_ONLY).then_some(
        "take differences of the derivative: `fd(grad(loss, x), x)`; or, to treat it as a constant, `stop_gradient(grad(…))`",
    )
}

pub(super) fn first_only(name: &str) -> TapeError {
    TapeError(format!("`{name}` {FIRST_ONLY}"))
}

/// A derivative that is recorded only when its own derivative is asked for. The inputs of its node are first the function, then the
/// variables, then the directions (in forward mode).
pub struct DeferredDerivative {
    kind: Kind,
    /// The same derivative computed by operations of the tape, once it has been recorded.
    recorded: OnceLock<Result<Var>>,
}

enum Kind {
    /// In reverse mode, in one variable.
    Gradient,
    /// Along the directions of as many variables.
    Along,
    /// The output's dimensions, then the variable's.
    Jacobian,
    /// A value without a derivative, by its name for messages.
    Measured(&'static str),
}

impl DeferredDerivative {
    pub(super) fn recorded(&self) -> Option<&Var> {
        self.recorded.get().and_then(|r| r.as_ref().ok())
    }

    /// Computes the derivative again as a graph of nodes.
    pub(super) fn record(&self, inputs: &[Var]) -> Result<()> {
        self.recorded.get_or_init(|| self.derived(inputs)).clone().map(|_| ())
    }

    fn derived(&self, inputs: &[Var]) -> Result<Var> {
        let Some((output, rest)) = inputs.split_first() else { return fail("a derivative of nothing") };
        match &self.kind {
            Kind::Gradient => {
                let ones = Var::constant(Tensor::full(output.shape(), 1.0));
                first(gradient(output, &ones, rest)?)
            }
            Kind::Along => {
                let (wrt, directions) = rest.split_at(rest.len() / 2);
                along(output, wrt, directions)
            }
            Kind::Jacobian => {
                if output.len() > MAX_ROWS {
                    return fail(format!(
                        "the derivative of a Jacobian of {} numbers is too much: at most {MAX_ROWS} are allowed",
                        output.len()
                    ));
                }
                let row = |k: usize| {
                    let mut seed = Tensor::zeros(output.shape());
                    seed.data[k] = 1.0;
                    first(gradient(output, &Var::constant(seed), rest)?)
                };
                let rows = (0..output.len()).map(row).collect::<Result<Vec<Var>>>()?;
                let shape = output.shape().iter().chain(rest.iter().flat_map(|v| v.shape())).copied().collect();
                Var::stack(&rows)?.reshape(shape)
            }
            Kind::Measured(what) => Err(first_only(what)),
        }
    }
}

fn first(mut all: Vec<Var>) -> Result<Var> {
    if all.is_empty() { fail("a derivative in nothing") } else { Ok(all.swap_remove(0)) }
}

impl Var {
    /// The same value as a new node, with respect to which derivatives can be taken. It still depends on this node.
    pub fn alias(&self) -> Var {
        if self.is_live() {
            Var::node(self.tensor(), Op::Reshape, vec![self.clone()], true)
        } else {
            Var::leaf(self.value().clone())
        }
    }

    fn later(kind: Kind, inputs: Vec<Var>, value: Tensor) -> Var {
        Var::record(Op::Deferred(Arc::new(DeferredDerivative { kind, recorded: OnceLock::new() })), inputs, value)
    }

    /// A node for `value`, the gradient of the number `of` with respect to `wrt`.
    pub fn gradient_of(of: &Var, wrt: &Var, value: Tensor) -> Var {
        Var::later(Kind::Gradient, vec![of.clone(), wrt.clone()], value)
    }

    /// A node for `value`, the derivative of `of` along a direction in the space of all of `wrt`.
    pub fn derivative_along(of: &Var, wrt: &[Var], directions: &[Var], value: Tensor) -> Var {
        let inputs = std::iter::once(of).chain(wrt).chain(directions).cloned().collect();
        Var::later(Kind::Along, inputs, value)
    }

    /// A node for `value`, the Jacobian of `of` with respect to `wrt`; its shape is that of `of` followed by that of `wrt`.
    pub fn jacobian_of(of: &Var, wrt: &Var, value: Tensor) -> Var {
        Var::later(Kind::Jacobian, vec![of.clone(), wrt.clone()], value)
    }

    /// A node for `value`, which the function `what` computed from `from`, and which cannot be differentiated.
    pub fn measured(what: &'static str, from: Vec<Var>, value: Tensor) -> Var {
        Var::later(Kind::Measured(what), from, value)
    }
}

/// [`super::backward_with`], but recorded: seed and results are nodes.
fn gradient(output: &Var, seed: &Var, wrt: &[Var]) -> Result<Vec<Var>> {
    let ids: HashSet<u64> = wrt.iter().map(Var::id).collect();
    let (sorted, reached) = plan(std::slice::from_ref(output), &ids)?;
    let mut adjoints = Adjoints::default();
    adjoints.whole.insert(output.id(), seed.clone());
    for var in sorted.iter().rev() {
        if ids.contains(&var.id()) || var.sources().is_empty() {
            continue;
        }
        let Some(g) = adjoints.take(var)? else { continue };
        if let (Op::Gather(table), [x]) = (var.op(), var.sources()) {
            adjoints.taken.entry(x.id()).or_default().push((table.clone(), g));
            continue;
        }
        let wants: Vec<bool> = var.sources().iter().map(|i| reached.contains(&i.id())).collect();
        for (input, d) in var.sources().iter().zip(transposed(var, &g, &wants)?) {
            if let Some(d) = d {
                adjoints.add(input, d)?;
            }
        }
    }
    let zero = |v: &Var| Var::constant(Tensor::zeros(v.shape()));
    // The same variable may be in `wrt` twice.
    let mut found: HashMap<u64, Var> = HashMap::new();
    for v in wrt {
        if let Entry::Vacant(place) = found.entry(v.id()) {
            place.insert(adjoints.take(v)?.unwrap_or_else(|| zero(v)));
        }
    }
    Ok(wrt.iter().map(|v| found[&v.id()].clone()).collect())
}

/// The index table of a gather from a node, and the derivative of its result.
type Taken = (Arc<Vec<u32>>, Var);

/// Adjoints of nodes, summed up while going back from the output.
#[derive(Default)]
struct Adjoints {
    whole: HashMap<u64, Var>,
    /// Gathers from each node. They are scattered together in one operation, because a long array may have been indexed item by item.
    taken: HashMap<u64, Vec<Taken>>,
}

impl Adjoints {
    fn add(&mut self, to: &Var, d: Var) -> Result<()> {
        let sum = match self.whole.get(&to.id()) {
            Some(sum) => sum.add(&d)?,
            None => d,
        };
        self.whole.insert(to.id(), sum);
        Ok(())
    }

    /// The sum of a node's adjoint; `None` if it is zero.
    fn take(&mut self, of: &Var) -> Result<Option<Var>> {
        let put_back = match self.taken.remove(&of.id()).as_deref() {
            None => None,
            Some([(table, g)]) => Some(g.scatter(table.clone(), of.shape().to_vec())),
            Some(parts) => {
                let flat = parts.iter().map(|(_, g)| g.reshape(vec![g.len()])).collect::<Result<Vec<Var>>>()?;
                let table = parts.iter().flat_map(|(table, _)| table.iter().copied()).collect();
                Some(Var::concat(&flat, 0)?.scatter(Arc::new(table), of.shape().to_vec()))
            }
        };
        if let Some(d) = put_back {
            self.add(of, d)?;
        }
        Ok(self.whole.remove(&of.id()))
    }
}

/// Forward mode by using reverse mode twice: ⟨u, J v⟩ = ⟨Jᵀ u, v⟩ is linear in u, and its gradient with respect to u is J v.
fn along(output: &Var, wrt: &[Var], directions: &[Var]) -> Result<Var> {
    let u = Var::leaf(Tensor::zeros(output.shape()));
    let mut sum = Var::from(0.0);
    for (row, direction) in gradient(output, &u, wrt)?.iter().zip(directions) {
        sum = sum.add(&row.mul(direction)?.sum())?;
    }
    first(gradient(&sum, &Var::from(1.0), &[u])?)
}

/// `g · slope`, where a slope that is not finite counts as 0.
fn times(g: &Var, slope: &Var) -> Result<Var> {
    if slope.value().is_finite() {
        return g.mul(slope);
    }
    let finite = Var::constant(slope.value().map(|x| f64::from(u8::from(x.is_finite()))));
    g.mul(&Var::select(&finite, slope, &Var::from(0.0))?)
}

/// Adjoint of broadcasting: sums over the axes along which elements were repeated.
fn summed_to(g: &Var, shape: &[usize]) -> Result<Var> {
    if g.shape() == shape {
        return Ok(g.clone());
    }
    if g.len() == shape.iter().product::<usize>() {
        return g.reshape(shape.to_vec());
    }
    let spread = Broadcast::new(shape, g.shape());
    Ok(g.scatter(Arc::new((0..g.len()).map(|i| spread.at(i) as u32).collect()), shape.to_vec()))
}

/// `Op::vjp`, but recorded: the adjoints of the sources that are wanted, from the adjoint of the node.
fn transposed(var: &Var, g: &Var, wants: &[bool]) -> Result<Vec<Option<Var>>> {
    let sources = var.sources();
    let x = &sources[0];
    let one = |d: Result<Var>| d.map(|d| vec![Some(d)]);
    match var.op() {
        Op::Leaf => Ok(vec![]),
        // A recorded derivative equals its only source.
        Op::Deferred(_) => one(Ok(g.clone())),
        Op::Reshape => one(g.reshape(x.shape().to_vec())),
        Op::Unary(f) => one(slope(*f, x, var).and_then(|s| times(g, &s))),
        Op::Binary(f) => {
            let y = &sources[1];
            let side = |first: bool| -> Result<Var> {
                let d = if first { slope_left(*f, x, y)? } else { slope_right(*f, x, y, var)? };
                let d = match d {
                    Some(d) => times(g, &d)?,
                    None => g.clone(),
                };
                summed_to(&d, if first { x.shape() } else { y.shape() })
            };
            let found = [true, false].into_iter().zip(wants).map(|(first, w)| w.then(|| side(first)).transpose());
            found.collect()
        }
        Op::Sum => one(g.broadcast_to(x.shape())),
        Op::Gather(table) => one(Ok(g.scatter(table.clone(), x.shape().to_vec()))),
        Op::Scatter(table) => one(Ok(Var::apply(Op::Gather(table.clone()), vec![g.clone()], x.shape().to_vec()))),
        Op::Concat => {
            let flat = g.reshape(vec![g.len()])?;
            let mut at = 0;
            let part = |(input, wanted): (&Var, &bool)| -> Result<Option<Var>> {
                let range = Slice::Range(at, at + input.len() as i64);
                at += input.len() as i64;
                wanted.then(|| flat.slice(&[range])?.reshape(input.shape().to_vec())).transpose()
            };
            sources.iter().zip(wants).map(part).collect()
        }
        Op::MatMul => {
            let y = &sources[1];
            let left = wants[0].then(|| g.matmul(&y.transpose()?)).transpose()?;
            Ok(vec![left, wants[1].then(|| x.transpose()?.matmul(g)).transpose()?])
        }
        Op::Inverse => {
            let across = var.transpose()?;
            one(across.matmul(g)?.matmul(&across).map(|d| d.neg()))
        }
        Op::Select(chosen) => {
            let keep = |first: bool| -> Result<Var> {
                let kept = chosen.iter().map(|m| f64::from(u8::from(*m == first))).collect();
                g.mul(&Var::constant(Tensor::new(var.shape().to_vec(), kept)))
            };
            [true, false].into_iter().zip(wants).map(|(first, w)| w.then(|| keep(first)).transpose()).collect()
        }
        Op::Filter(filter) => one(g.filter(backwards(filter, x.shape()[filter.axis]))),
        Op::Custom(op) => {
            // The same operation composed of operations of the tape, if that is possible.
            let inputs: Vec<Var> = sources.iter().map(Var::alias).collect();
            let composed = op.composed(&inputs).ok_or_else(|| first_only(op.name()))??;
            let found = gradient(&composed, g, &inputs)?;
            Ok(found.into_iter().zip(wants).map(|(d, wanted)| wanted.then_some(d)).collect())
        }
    }
}

/// The transpose of a filter of `n` inputs.
fn backwards(filter: &AxisFilter, n: usize) -> AxisFilter {
    let mut taps = vec![Vec::new(); n];
    for j in 0..filter.outputs() {
        for k in filter.starts[j] as usize..filter.starts[j + 1] as usize {
            taps[filter.sources[k] as usize].push((j, filter.weights[k]));
        }
    }
    AxisFilter::new(filter.axis, taps)
}

/// [`Unary::slope`] at `x` with value `y`.
fn slope(f: Unary, x: &Var, y: &Var) -> Result<Var> {
    let unit = |v: &Var| v.neg().shift(1.0);
    Ok(match f {
        Unary::Neg => Var::from(-1.0),
        Unary::Sin => x.unary(Unary::Cos),
        Unary::Cos => x.unary(Unary::Sin).neg(),
        Unary::Tan => y.unary(Unary::Square).shift(1.0),
        Unary::Asin | Unary::Acos => {
            let root = unit(x).mul(&x.shift(1.0))?.unary(Unary::Sqrt).unary(Unary::Recip);
            if f == Unary::Asin { root } else { root.neg() }
        }
        Unary::Atan => x.unary(Unary::Square).shift(1.0).unary(Unary::Recip),
        Unary::Tanh => unit(&y.unary(Unary::Square)),
        Unary::Exp => y.clone(),
        Unary::Log => x.unary(Unary::Recip),
        Unary::Sqrt => y.unary(Unary::Recip).scale(0.5),
        Unary::Square => x.scale(2.0),
        Unary::Abs => x.unary(Unary::Sign),
        Unary::Recip => y.unary(Unary::Square).neg(),
        Unary::Sigmoid => y.mul(&unit(y))?,
        Unary::Sign | Unary::Floor | Unary::Ceil | Unary::Round | Unary::Stop => Var::from(0.0),
    })
}

/// ∂z/∂x; `None` is 1.
fn slope_left(f: Binary, x: &Var, y: &Var) -> Result<Option<Var>> {
    Ok(Some(match f {
        Binary::Add | Binary::Sub | Binary::Mod => return Ok(None),
        Binary::Mul => y.clone(),
        Binary::Div => y.unary(Unary::Recip),
        Binary::Pow => y.mul(&x.binary(Binary::Pow, &y.shift(-1.0))?)?,
        Binary::Min => x.binary(Binary::Le, y)?,
        Binary::Max => x.binary(Binary::Ge, y)?,
        Binary::Atan2 => y.div(&squared_length(x, y)?)?,
        Binary::Eq | Binary::Ne | Binary::Lt | Binary::Le | Binary::Gt | Binary::Ge => Var::from(0.0),
    }))
}

/// ∂z/∂y at value `z`; `None` is 1.
fn slope_right(f: Binary, x: &Var, y: &Var, z: &Var) -> Result<Option<Var>> {
    Ok(Some(match f {
        Binary::Add => return Ok(None),
        Binary::Sub => Var::from(-1.0),
        Binary::Mul => x.clone(),
        Binary::Div => z.div(y)?.neg(),
        Binary::Pow => {
            // Only above 0 is there a derivative in the exponent.
            let positive = Var::constant(x.value().map(|x| f64::from(u8::from(x > 0.0))));
            z.mul(&Var::select(&positive, x, &Var::from(1.0))?.unary(Unary::Log))?
        }
        Binary::Min => x.binary(Binary::Gt, y)?,
        Binary::Max => x.binary(Binary::Lt, y)?,
        Binary::Atan2 => x.div(&squared_length(x, y)?)?.neg(),
        Binary::Mod => x.div(y)?.unary(Unary::Floor).neg(),
        Binary::Eq | Binary::Ne | Binary::Lt | Binary::Le | Binary::Gt | Binary::Ge => Var::from(0.0),
    }))
}

fn squared_length(x: &Var, y: &Var) -> Result<Var> {
    x.unary(Unary::Square).add(&y.unary(Unary::Square))
}
