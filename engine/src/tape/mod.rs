//! Reverse and forward mode over one recorded graph of tensor operations.
//!
//! A [`Var`] is a value together with the operation and the inputs that it was computed from. A value that depends on no leaf is stored as
//! a constant, without its inputs. [`backward`] and [`forward`] visit the same nodes: the one applies the transpose of every operation's
//! Jacobian, the other the Jacobian.
//!
//! # Derivatives at edges
//!
//! Where a value is finite, so is its derivative. At the edge of its domain, or where it is not differentiable, an operation has as its
//! derivative the limit from within the domain if that is finite, and otherwise 0: an infinite slope times a zero adjoint (as of a black
//! pixel under `gamma`) would make the whole gradient NaN. Only where the value itself is infinite or NaN may the derivative be so.
//! Every row of this table is tested by `tape::tests::edges`.
//!
//! | operation | edge | derivative | because |
//! | --- | --- | --- | --- |
//! | `sqrt(x)` | x = 0 | 0 | the slope is infinite |
//! | `x ^ p` | x = 0, 0 < p < 1 | 0 in x | the slope is infinite |
//! | `x ^ 1`, `x ^ p` | x = 0, p > 1 | 1; 0 in x | the limits |
//! | `x ^ 0` | every x | 0 in x; at x = 0 also 0 in the exponent | it is 1; in the exponent the slope is infinite |
//! | `x ^ p` | x = 0, p > 0 | 0 in p | the limit of x^p log x |
//! | `x ^ n` | x < 0, whole n | n x^(n − 1) in x, 0 in n | beside a whole exponent there is no value |
//! | `x ^ p` | x = 0, p < 0 | infinite | so is the value |
//! | `log(x)`, `1 / x` | x = 0 | infinite | so is the value |
//! | `asin(x)`, `acos(x)` | x = ±1 | 0 | the slope is infinite |
//! | `atan2(y, x)` | y = x = 0 | 0, 0 | there is no direction |
//! | `abs(x)`, `sign(x)` | x = 0 | 0 | the middle of both sides |
//! | `floor`, `ceil`, `round` | everywhere | 0 | steps have no slope, and their jumps are left out |
//! | `min(x, y)`, `max(x, y)` | x = y | 1 in x, 0 in y | one of both sides; so `clamp` lets a value at its bound come back |
//! | `min(v)`, `max(v)` | two are equal | 1 in the first | the same |
//! | `x mod y` | x = n y | 1 in x, −n in y | the limit from above |
//! | `norm(v)`, `length(v)` | v = 0 | 0 | the middle of all sides |
//! | `normalize(v)` | v = 0 | 0 | the value stays 0; the slope is infinite |
//! | `sigmoid(x)`, `tanh(x)` | x → ±∞ | 0 | the limits |

mod linalg;
mod op;
mod recorded;
mod rotation;
mod squares;
mod structure;
mod tensor;

use std::collections::{HashMap, HashSet};
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::memory::{self, Shortage};
use crate::stop;

pub use op::{AxisFilter, Binary, CustomOp, Op, ROUNDING, Unary, invert};
pub use recorded::{DeferredDerivative, help};
pub use squares::{Squares, squares};
pub use structure::{Group, Slice, crop_table};
pub use tensor::{Broadcast, Tensor, broadcast_shapes};

/// Operands that do not fit each other.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct TapeError(pub String);

/// What an operation gives, or why its operands do not fit.
pub type Result<T, E = TapeError> = std::result::Result<T, E>;

impl From<Shortage> for TapeError {
    fn from(e: Shortage) -> TapeError {
        TapeError(e.to_string())
    }
}

/// Checks that there is memory for a tensor of that shape.
pub(crate) fn ask_for_tensor(shape: &[usize]) -> Result<()> {
    Ok(memory::ask_for::<f64>(shape.iter().fold(1, |n: usize, side| n.saturating_mul(*side)))?)
}

pub(crate) fn fail<T>(message: impl Into<String>) -> Result<T> {
    Err(TapeError(message.into()))
}

/// A node of the graph; cloning shares it.
#[derive(Clone)]
pub struct Var(Arc<Node>);

struct Node {
    id: u64,
    value: Arc<Tensor>,
    op: Op,
    inputs: Vec<Var>,
    /// It depends on a leaf.
    live: bool,
}

static NEXT_ID: AtomicU64 = AtomicU64::new(0);

impl Var {
    fn node(value: Arc<Tensor>, op: Op, inputs: Vec<Var>, live: bool) -> Var {
        Var(Arc::new(Node { id: NEXT_ID.fetch_add(1, Ordering::Relaxed), value, op, inputs, live }))
    }

    /// A value without derivatives.
    pub fn constant(value: impl Into<Tensor>) -> Var {
        Var::node(Arc::new(value.into()), Op::Leaf, vec![], false)
    }

    /// A variable: a value with respect to which derivatives can be taken.
    pub fn leaf(value: impl Into<Tensor>) -> Var {
        Var::node(Arc::new(value.into()), Op::Leaf, vec![], true)
    }

    /// The result of an operation; a constant if it depends on no leaf.
    fn record(op: Op, inputs: Vec<Var>, value: Tensor) -> Var {
        if op.is_flat() || !inputs.iter().any(Var::is_live) {
            return Var::constant(value);
        }
        Var::node(Arc::new(value), op, inputs, true)
    }

    fn apply(op: Op, inputs: Vec<Var>, shape: Vec<usize>) -> Var {
        stop::check();
        let values: Vec<&Tensor> = inputs.iter().map(Var::value).collect();
        let value = op.forward(&values, shape);
        Var::record(op, inputs, value)
    }

    /// An operation defined elsewhere, with its value already computed.
    pub fn custom(op: Arc<dyn CustomOp>, inputs: Vec<Var>, value: Tensor) -> Var {
        Var::record(Op::Custom(op), inputs, value)
    }

    /// The value itself.
    pub fn value(&self) -> &Tensor {
        &self.0.value
    }

    /// The value, shared.
    pub fn tensor(&self) -> Arc<Tensor> {
        self.0.value.clone()
    }

    /// The lengths of the value's axes; none for a single number.
    pub fn shape(&self) -> &[usize] {
        &self.0.value.shape
    }

    /// How many numbers it has.
    pub fn len(&self) -> usize {
        self.0.value.len()
    }

    /// Whether it has no numbers at all.
    pub fn is_empty(&self) -> bool {
        self.0.value.is_empty()
    }

    /// The value of one that has a single number, whatever its axes.
    pub fn item(&self) -> Option<f64> {
        self.0.value.item()
    }

    /// Whether it depends on a leaf.
    pub fn is_live(&self) -> bool {
        self.0.live
    }

    fn op(&self) -> &Op {
        &self.0.op
    }

    /// The nodes that this one is computed from: its inputs or, for a derivative that was recorded as a graph, that graph's root alone.
    fn sources(&self) -> &[Var] {
        match &self.0.op {
            Op::Deferred(later) => later.recorded().map_or(&self.0.inputs, std::slice::from_ref),
            _ => &self.0.inputs,
        }
    }

    /// Number of nodes of its graph, itself and recorded derivatives included.
    pub fn nodes(&self) -> usize {
        let (mut seen, mut waiting) = (HashSet::new(), vec![self]);
        while let Some(var) = waiting.pop() {
            if seen.insert(var.id()) {
                waiting.extend(var.sources());
            }
        }
        seen.len()
    }

    /// Identity of the node.
    pub fn id(&self) -> u64 {
        self.0.id
    }

    /// A function of each number.
    pub fn unary(&self, f: Unary) -> Var {
        Var::apply(Op::Unary(f), vec![self.clone()], self.shape().to_vec())
    }

    /// An operation between numbers of both, whose shapes are broadcast to one another; an error if they do not fit.
    pub fn binary(&self, f: Binary, other: &Var) -> Result<Var> {
        let Some(shape) = broadcast_shapes(self.shape(), other.shape()) else {
            return fail(format!(
                "shapes {} and {} do not fit each other",
                Tensor::shape_text(self.shape()),
                Tensor::shape_text(other.shape())
            ));
        };
        // A constant square is by far the most common power, and has an operation of its own.
        if f == Binary::Pow && !other.is_live() && other.item() == Some(2.0) && other.shape().is_empty() {
            return Ok(self.unary(Unary::Square));
        }
        ask_for_tensor(&shape)?;
        Ok(Var::apply(Op::Binary(f), vec![self.clone(), other.clone()], shape))
    }

    /// Sum, with broadcasting.
    pub fn add(&self, other: &Var) -> Result<Var> {
        self.binary(Binary::Add, other)
    }

    /// Difference, with broadcasting.
    pub fn sub(&self, other: &Var) -> Result<Var> {
        self.binary(Binary::Sub, other)
    }

    /// Product number by number, with broadcasting.
    pub fn mul(&self, other: &Var) -> Result<Var> {
        self.binary(Binary::Mul, other)
    }

    /// Quotient number by number, with broadcasting.
    pub fn div(&self, other: &Var) -> Result<Var> {
        self.binary(Binary::Div, other)
    }

    /// Each number with the other sign.
    pub fn neg(&self) -> Var {
        self.unary(Unary::Neg)
    }

    /// Each number times `s`.
    pub fn scale(&self, s: f64) -> Var {
        if s == 1.0 {
            return self.clone();
        }
        let s = Var::constant(s);
        Var::apply(Op::Binary(Binary::Mul), vec![self.clone(), s], self.shape().to_vec())
    }

    /// Each number plus `s`.
    pub(crate) fn shift(&self, s: f64) -> Var {
        let s = Var::constant(s);
        Var::apply(Op::Binary(Binary::Add), vec![self.clone(), s], self.shape().to_vec())
    }
}

impl fmt::Debug for Var {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Var{:?}{}", self.shape(), if self.is_live() { "*" } else { "" })
    }
}

impl From<f64> for Var {
    fn from(x: f64) -> Var {
        Var::constant(x)
    }
}

// Without this a long chain of nodes would be dropped recursively and overflow the stack.
impl Drop for Node {
    fn drop(&mut self) {
        let mut pending = std::mem::take(&mut self.inputs);
        while let Some(var) = pending.pop() {
            if let Ok(mut node) = Arc::try_unwrap(var.0) {
                pending.append(&mut node.inputs);
            }
        }
    }
}

/// The nodes from the leaves `wrt` to `roots` that depend on `wrt`, inputs before outputs; and the ids of all that depend on `wrt`.
fn order(roots: &[Var], wrt: &HashSet<u64>) -> (Vec<Var>, HashSet<u64>) {
    let mut sorted = Vec::new();
    let mut seen = HashSet::new();
    let mut stack: Vec<(Var, usize)> = roots.iter().rev().map(|root| (root.clone(), 0)).collect();
    while let Some((var, next)) = stack.pop() {
        if next == 0 && !seen.insert(var.id()) {
            continue;
        }
        // The search ends at the nodes of `wrt`, whose own inputs do not matter.
        let stop = wrt.contains(&var.id());
        match var.sources().get(next).filter(|_| !stop) {
            Some(input) => {
                let input = input.clone();
                stack.push((var, next + 1));
                if input.is_live() && !seen.contains(&input.id()) {
                    stack.push((input, 0));
                }
            }
            None => sorted.push(var),
        }
    }
    let mut reached = wrt.clone();
    for var in &sorted {
        if var.sources().iter().any(|i| reached.contains(&i.id())) {
            reached.insert(var.id());
        }
    }
    sorted.retain(|v| reached.contains(&v.id()));
    (sorted, reached)
}

/// [`order`], but first records the derivatives among the nodes as graphs, so that they can be differentiated again.
fn plan(roots: &[Var], wrt: &HashSet<u64>) -> Result<(Vec<Var>, HashSet<u64>)> {
    loop {
        let (sorted, reached) = order(roots, wrt);
        let mut complete = true;
        for var in sorted.iter().filter(|v| !wrt.contains(&v.id())) {
            if let Op::Deferred(later) = var.op()
                && later.recorded().is_none()
            {
                later.record(&var.0.inputs)?;
                complete = false;
            }
        }
        if complete {
            return Ok((sorted, reached));
        }
    }
}

/// Makes the derivatives of `outputs` in `wrt` those of one matrix: see [`CustomOp::fix`].
pub fn fix(outputs: &[Var], wrt: &[Var], room: usize) -> Result<()> {
    let ids: HashSet<u64> = wrt.iter().map(Var::id).collect();
    let (sorted, reached) = plan(outputs, &ids)?;
    let mut room = room;
    for var in sorted.iter().filter(|v| !ids.contains(&v.id())) {
        if let Op::Custom(op) = var.op() {
            let wants: Vec<bool> = var.sources().iter().map(|i| reached.contains(&i.id())).collect();
            stop::check();
            op.fix(&wants, &mut room).map_err(TapeError)?;
        }
    }
    Ok(())
}

/// Reverse mode: the derivative of ⟨`seed`, `output`⟩ with respect to each of `wrt`; zeros where `output` does not depend on it.
pub fn backward_with(output: &Var, seed: Tensor, wrt: &[Var]) -> Result<Vec<Tensor>> {
    backward_from(std::slice::from_ref(output), vec![seed], wrt)
}

/// The same for the sum of ⟨seed, output⟩ over several outputs.
pub fn backward_from(outputs: &[Var], seeds: Vec<Tensor>, wrt: &[Var]) -> Result<Vec<Tensor>> {
    let ids: HashSet<u64> = wrt.iter().map(Var::id).collect();
    let (sorted, reached) = plan(outputs, &ids)?;
    let mut adjoints: HashMap<u64, Tensor> = HashMap::new();
    for (output, seed) in outputs.iter().zip(seeds) {
        match adjoints.get_mut(&output.id()) {
            Some(sum) => sum.accumulate(&seed),
            None => {
                adjoints.insert(output.id(), seed);
            }
        }
    }
    for var in sorted.iter().rev() {
        if ids.contains(&var.id()) || var.sources().is_empty() {
            continue;
        }
        let Some(g) = adjoints.remove(&var.id()) else { continue };
        stop::check();
        pull_back(var, g, &reached, &mut adjoints)?;
    }
    // The same node may be in `wrt` several times. Its adjoint is moved out at its last place and cloned before.
    let mut left: HashMap<u64, usize> = HashMap::new();
    wrt.iter().for_each(|v| *left.entry(v.id()).or_default() += 1);
    let found = |v: &Var| {
        let again = left.get_mut(&v.id()).is_some_and(|left| {
            *left -= 1;
            *left > 0
        });
        let adjoint = if again { adjoints.get(&v.id()).cloned() } else { adjoints.remove(&v.id()) };
        adjoint.unwrap_or_else(|| Tensor::zeros(v.shape()))
    };
    Ok(wrt.iter().map(found).collect())
}

/// Adds a node's contribution to the adjoints of its inputs; `g` is the adjoint of the node.
fn pull_back(var: &Var, g: Tensor, reached: &HashSet<u64>, adjoints: &mut HashMap<u64, Tensor>) -> Result<()> {
    let inputs = var.sources();
    if let (Op::Gather(table), [x]) = (&var.0.op, inputs) {
        // Added in place. If a long array is indexed item by item, each item writes its own numbers only.
        if !adjoints.contains_key(&x.id()) {
            ask_for_tensor(x.shape())?;
        }
        let sum = adjoints.entry(x.id()).or_insert_with(|| Tensor::zeros(x.shape()));
        table.iter().zip(&g.data).for_each(|(&i, g)| sum.data[i as usize] += g);
        return Ok(());
    }
    let values: Vec<&Tensor> = inputs.iter().map(Var::value).collect();
    let wants: Vec<bool> = inputs.iter().map(|i| reached.contains(&i.id())).collect();
    let wanted = values.iter().zip(&wants).filter(|(_, w)| **w);
    ask_for_tensor(&[wanted.map(|(v, _)| v.len()).sum()])?;
    let d = var.0.op.vjp_in_place(&values, var.value(), g, &wants).map_err(TapeError)?;
    for ((input, wanted), d) in inputs.iter().zip(wants).zip(d) {
        let (true, Some(d)) = (wanted, d) else { continue };
        match adjoints.get_mut(&input.id()) {
            Some(sum) => sum.accumulate(&d),
            None => {
                adjoints.insert(input.id(), d);
            }
        }
    }
    Ok(())
}

/// Reverse mode of a scalar.
pub fn backward(loss: &Var, wrt: &[Var]) -> Result<Vec<Tensor>> {
    if loss.len() != 1 {
        return fail(format!("a derivative needs a number, this is a {}", Tensor::shape_text(loss.shape())));
    }
    backward_with(loss, Tensor::full(loss.shape(), 1.0), wrt)
}

/// Forward mode: the derivative of `output` along a direction, given by the tangents of some leaves.
pub fn forward(output: &Var, tangents: &[(Var, Tensor)]) -> Result<Tensor> {
    let mut found = jacobian(std::slice::from_ref(output), &[tangents.to_vec()])?;
    Ok(found.pop().and_then(|mut along| along.pop()).unwrap_or_else(|| Tensor::zeros(output.shape())))
}

/// Forward mode: the derivatives of `outputs` along several directions, each given by the tangents of some leaves. Every operation is
/// visited once, for all directions on which it depends. The result is indexed by output and then by direction.
pub fn jacobian(outputs: &[Var], directions: &[Vec<(Var, Tensor)>]) -> Result<Vec<Vec<Tensor>>> {
    let ids: HashSet<u64> = directions.iter().flatten().map(|(v, _)| v.id()).collect();
    let sorted = plan(outputs, &ids)?.0;
    // By node: index and tangent of each direction in which it changes.
    let mut at: HashMap<u64, Vec<(usize, Tensor)>> = HashMap::new();
    for (k, (leaf, t)) in directions.iter().enumerate().flat_map(|(k, d)| d.iter().map(move |t| (k, t))) {
        if leaf.len() != t.len() {
            return fail(format!(
                "a direction of shape {} for a value of shape {}",
                Tensor::shape_text(&t.shape),
                Tensor::shape_text(leaf.shape())
            ));
        }
        let t = Tensor { shape: leaf.shape().to_vec(), data: t.data.clone() };
        let along = at.entry(leaf.id()).or_default();
        match along.last_mut() {
            Some((last, sum)) if *last == k => sum.accumulate(&t),
            _ => along.push((k, t)),
        }
    }
    // Tangents are dropped after their last use.
    let mut uses: HashMap<u64, usize> = HashMap::new();
    for var in sorted.iter().filter(|v| !ids.contains(&v.id())).flat_map(|v| v.sources()).chain(outputs) {
        *uses.entry(var.id()).or_default() += 1;
    }
    for var in sorted.iter().filter(|v| !ids.contains(&v.id())) {
        let inputs = var.sources();
        let mut reached: Vec<usize> =
            inputs.iter().filter_map(|i| at.get(&i.id())).flatten().map(|(k, _)| *k).collect();
        reached.sort_unstable();
        reached.dedup();
        let tangent = |input: &Var, k: usize| {
            let along = at.get(&input.id())?;
            along.binary_search_by_key(&k, |(k, _)| *k).ok().map(|i| &along[i].1)
        };
        let along: Vec<Vec<Option<&Tensor>>> =
            reached.iter().map(|&k| inputs.iter().map(|i| tangent(i, k)).collect()).collect();
        let values: Vec<&Tensor> = inputs.iter().map(Var::value).collect();
        ask_for_tensor(&[var.len(), along.len()])?;
        stop::check();
        let found = var.0.op.jvps(&values, var.value(), &along).map_err(TapeError)?;
        at.insert(var.id(), reached.into_iter().zip(found).collect());
        for input in inputs {
            if let Some(left) = uses.get_mut(&input.id()) {
                *left -= 1;
                if *left == 0 {
                    at.remove(&input.id());
                }
            }
        }
    }
    let of = |output: &Var| {
        let mut found = vec![Tensor::zeros(output.shape()); directions.len()];
        for (k, t) in at.get(&output.id()).into_iter().flatten() {
            found[*k] = t.clone();
        }
        found
    };
    Ok(outputs.iter().map(of).collect())
}

/// The direction in which one element of a leaf grows.
pub fn unit(leaf: &Var, element: usize) -> Vec<(Var, Tensor)> {
    let mut t = Tensor::zeros(leaf.shape());
    t.data[element] = 1.0;
    vec![(leaf.clone(), t)]
}

/// The first function on the way from `wrt` to `output` whose slope is infinite where it stands, so that its derivative counts as 0: in
/// words that follow "through".
pub fn edge(output: &Var, wrt: &Var) -> Option<&'static str> {
    let (sorted, _) = order(std::slice::from_ref(output), &HashSet::from([wrt.id()]));
    sorted.iter().filter(|var| var.id() != wrt.id()).find_map(|var| {
        let inputs: Vec<&Tensor> = var.sources().iter().map(Var::value).collect();
        var.op().edge(&inputs)
    })
}

/// Whether `output` depends on the node `wrt`.
pub fn depends(output: &Var, wrt: &Var) -> bool {
    order(std::slice::from_ref(output), &HashSet::from([wrt.id()])).1.contains(&output.id())
}

#[cfg(test)]
mod tests;
