//! The operations of the graph: each with its forward rule, its transpose (`vjp`) and its tangent (`jvp`).

use std::sync::Arc;

use super::recorded::DeferredDerivative;
use super::tensor::{Broadcast, CHUNK, Tensor, for_each_pair, mapped};
use super::{TapeError, Var};
use crate::stop::{self, Pace, paced};

/// An operation defined outside the tape: a mesh operation, an image operation, rendering.
pub trait CustomOp: Send + Sync {
    /// What it is called in messages.
    fn name(&self) -> &str;

    /// Σ d_output · ∂output/∂input for each input with `wants`; `None` stands for zero.
    fn vjp(
        &self,
        inputs: &[&Tensor],
        output: &Tensor,
        d_output: &Tensor,
        wants: &[bool],
    ) -> Result<Vec<Option<Tensor>>, String>;

    /// The same operation composed of operations of the tape, for second derivatives; `None` if that is not possible.
    fn composed(&self, _inputs: &[Var]) -> Option<Result<Var, TapeError>> {
        None
    }

    /// Σ ∂output/∂input · tangent over the inputs that have one.
    fn jvp(&self, inputs: &[&Tensor], output: &Tensor, tangents: &[Option<&Tensor>]) -> Result<Tensor, String>;

    /// From now on all derivatives in the inputs with `wants` are of one matrix, and those of [`CustomOp::vjp`] of its transpose, whatever
    /// the adjoint or the direction. Takes memory for at most `room` numbers, and what it takes from `room`. An operation whose
    /// derivatives are exact has nothing to do.
    fn fix(&self, _wants: &[bool], _room: &mut usize) -> Result<(), String> {
        Ok(())
    }

    /// [`CustomOp::jvp`] along each of several directions, for operations that are cheaper for all directions at once.
    fn jvps(
        &self,
        inputs: &[&Tensor],
        output: &Tensor,
        directions: &[Vec<Option<&Tensor>>],
    ) -> Result<Vec<Tensor>, String> {
        directions.iter().map(|tangents| self.jvp(inputs, output, tangents)).collect()
    }
}

/// `asin` and `acos` take a number that is larger than 1 by less than this for 1.
pub const ROUNDING: f64 = 1e-12;

/// Functions of one number. What they do at the edges of their domains says the table of [`crate::tape`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unary {
    /// `−x`.
    Neg,
    /// Sine of radians.
    Sin,
    /// Cosine of radians.
    Cos,
    /// Tangent of radians.
    Tan,
    /// Arcsine, from −π/2 to π/2; NaN where |x| is larger than 1 by more than [`ROUNDING`].
    Asin,
    /// Arccosine, from 0 to π; NaN where |x| is larger than 1 by more than [`ROUNDING`].
    Acos,
    /// Arctangent, from −π/2 to π/2.
    Atan,
    /// Hyperbolic tangent.
    Tanh,
    /// `eˣ`.
    Exp,
    /// The natural logarithm.
    Log,
    /// The square root.
    Sqrt,
    /// `x²`.
    Square,
    /// `|x|`.
    Abs,
    /// `1 / x`.
    Recip,
    /// `1 / (1 + e⁻ˣ)`.
    Sigmoid,
    /// −1, 0 or 1.
    Sign,
    /// The largest whole number that is not above.
    Floor,
    /// The smallest whole number that is not below.
    Ceil,
    /// The nearest whole number; of two that are equally near the one farther from 0.
    Round,
    /// Copies the value and cuts the derivative.
    Stop,
}

impl Unary {
    /// The function's value.
    pub fn value(self, x: f64) -> f64 {
        match self {
            Unary::Neg => -x,
            Unary::Sin => x.sin(),
            Unary::Cos => x.cos(),
            Unary::Tan => x.tan(),
            Unary::Asin => rounded_into_unit(x).asin(),
            Unary::Acos => rounded_into_unit(x).acos(),
            Unary::Atan => x.atan(),
            Unary::Tanh => x.tanh(),
            Unary::Exp => x.exp(),
            Unary::Log => x.ln(),
            Unary::Sqrt => x.sqrt(),
            Unary::Square => x * x,
            Unary::Abs => x.abs(),
            Unary::Recip => x.recip(),
            Unary::Sigmoid => 1.0 / (1.0 + (-x).exp()),
            Unary::Sign => {
                if x == 0.0 {
                    0.0
                } else {
                    x.signum()
                }
            }
            Unary::Floor => x.floor(),
            Unary::Ceil => x.ceil(),
            Unary::Round => x.round(),
            Unary::Stop => x,
        }
    }

    /// dy/dx at `x`, where the value is `y`. The table in [`crate::tape`] says what it is where there is no derivative.
    pub fn slope(self, x: f64, y: f64) -> f64 {
        match self {
            Unary::Neg => -1.0,
            Unary::Sin => x.cos(),
            Unary::Cos => -x.sin(),
            Unary::Tan => 1.0 + y * y,
            Unary::Asin => arc_slope(x),
            Unary::Acos => -arc_slope(x),
            Unary::Atan => (1.0 + x * x).recip(),
            Unary::Tanh => 1.0 - y * y,
            Unary::Exp => y,
            Unary::Log => x.recip(),
            Unary::Sqrt => {
                if y == 0.0 {
                    0.0
                } else {
                    0.5 / y
                }
            }
            Unary::Square => 2.0 * x,
            Unary::Abs => Unary::Sign.value(x),
            Unary::Recip => -y * y,
            Unary::Sigmoid => y * (1.0 - y),
            Unary::Sign | Unary::Floor | Unary::Ceil | Unary::Round | Unary::Stop => 0.0,
        }
    }

    /// Whether the slope is infinite although the value is not, so that it counts as 0.
    fn is_steep(self, x: f64) -> bool {
        match self {
            Unary::Sqrt => x == 0.0,
            Unary::Asin | Unary::Acos => x.abs() >= 1.0,
            _ => false,
        }
    }

    fn is_flat(self) -> bool {
        matches!(self, Unary::Sign | Unary::Floor | Unary::Ceil | Unary::Round | Unary::Stop)
    }
}

/// Operations between two numbers. Comparisons give 1 where they hold and 0 where they do not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Binary {
    /// `x + y`.
    Add,
    /// `x − y`.
    Sub,
    /// `x · y`.
    Mul,
    /// `x / y`.
    Div,
    /// `x` to the power of `y`.
    Pow,
    /// The smaller one; NaN if either is.
    Min,
    /// The larger one; NaN if either is.
    Max,
    /// The angle of a point, from −π to π, whose height is the first operand and whose distance to the right is the second.
    Atan2,
    /// Remainder with the sign of the divisor.
    Mod,
    /// `x = y`.
    Eq,
    /// `x ≠ y`.
    Ne,
    /// `x < y`.
    Lt,
    /// `x ≤ y`.
    Le,
    /// `x > y`.
    Gt,
    /// `x ≥ y`.
    Ge,
}

impl Binary {
    /// The operation's value.
    #[inline]
    pub fn value(self, x: f64, y: f64) -> f64 {
        let truth = |b: bool| if b { 1.0 } else { 0.0 };
        match self {
            Binary::Add => x + y,
            Binary::Sub => x - y,
            Binary::Mul => x * y,
            Binary::Div => x / y,
            Binary::Pow => power(x, y),
            // Unlike `f64::min` and `f64::max` these return NaN if an operand is NaN.
            Binary::Min => {
                if x <= y || x.is_nan() {
                    x
                } else {
                    y
                }
            }
            Binary::Max => {
                if x >= y || x.is_nan() {
                    x
                } else {
                    y
                }
            }
            Binary::Atan2 => x.atan2(y),
            Binary::Mod => x - y * (x / y).floor(),
            Binary::Eq => truth(x == y),
            Binary::Ne => truth(x != y),
            Binary::Lt => truth(x < y),
            Binary::Le => truth(x <= y),
            Binary::Gt => truth(x > y),
            Binary::Ge => truth(x >= y),
        }
    }

    /// (∂z/∂x, ∂z/∂y) at value `z`.
    #[inline]
    fn slopes(self, x: f64, y: f64, z: f64) -> (f64, f64) {
        match self {
            Binary::Add => (1.0, 1.0),
            Binary::Sub => (1.0, -1.0),
            Binary::Mul => (y, x),
            Binary::Div => (y.recip(), -z / y),
            Binary::Pow => {
                // At x = 0 the slope is infinite although the value is not, between the exponents 0 and 1.
                let steep = x == 0.0 && y < 1.0 && z.is_finite();
                let dx = if y == 0.0 || steep { 0.0 } else { y * power(x, y - 1.0) };
                // For x ≤ 0 there is no derivative in y; whole exponents need none there.
                (dx, if x > 0.0 { z * x.ln() } else { 0.0 })
            }
            Binary::Min => {
                if x <= y {
                    (1.0, 0.0)
                } else {
                    (0.0, 1.0)
                }
            }
            Binary::Max => {
                if x >= y {
                    (1.0, 0.0)
                } else {
                    (0.0, 1.0)
                }
            }
            Binary::Atan2 => {
                // Divides twice, because the square of a small number may underflow to 0.
                let r = x.hypot(y);
                if r == 0.0 { (0.0, 0.0) } else { (y / r / r, -(x / r / r)) }
            }
            Binary::Mod => (1.0, -(x / y).floor()),
            Binary::Eq | Binary::Ne | Binary::Lt | Binary::Le | Binary::Gt | Binary::Ge => (0.0, 0.0),
        }
    }

    /// Whether the slope by a first operand is infinite although the value is not, so that it counts as 0.
    fn is_steep(self, x: f64, y: f64) -> bool {
        match self {
            Binary::Pow => x == 0.0 && 0.0 < y && y < 1.0,
            Binary::Atan2 => x == 0.0 && y == 0.0,
            _ => false,
        }
    }

    /// Whether it is a comparison, whose derivatives are 0.
    pub fn is_comparison(self) -> bool {
        matches!(self, Binary::Eq | Binary::Ne | Binary::Lt | Binary::Le | Binary::Gt | Binary::Ge)
    }
}

/// Clamps a sine or cosine to −1..1 if rounding took it out of that range, such as the scalar product of a unit vector with itself.
fn rounded_into_unit(x: f64) -> f64 {
    if x.abs() > 1.0 && x.abs() <= 1.0 + ROUNDING { x.signum() } else { x }
}

/// The slope of `asin`; it is infinite at ±1, where the value is not.
fn arc_slope(x: f64) -> f64 {
    let squared = (1.0 - x) * (1.0 + x);
    if squared <= 0.0 { 0.0 } else { squared.sqrt().recip() }
}

fn power(x: f64, y: f64) -> f64 {
    // To the processor NaN to the power of 0 is 1, and so is 1 to that of NaN: what is unknown would be known again.
    if x.is_nan() || y.is_nan() {
        f64::NAN
    } else if y == 2.0 {
        x * x
    } else if y == 1.0 {
        x
    } else if y.fract() == 0.0 && y.abs() <= 32.0 {
        x.powi(y as i32)
    } else {
        x.powf(y)
    }
}

/// A linear filter along one axis: `y[j] = Σ_k weights[k] · x[sources[k]]`, k in `starts[j]..starts[j+1]`.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisFilter {
    pub(crate) axis: usize,
    pub(crate) starts: Vec<u32>,
    pub(crate) sources: Vec<u32>,
    pub(crate) weights: Vec<f64>,
}

impl AxisFilter {
    /// From the taps (source, weight) of each output.
    pub fn new(axis: usize, taps: impl IntoIterator<Item = Vec<(usize, f64)>>) -> Self {
        let mut filter = AxisFilter { axis, starts: vec![0], sources: vec![], weights: vec![] };
        for tap in taps {
            for (source, weight) in tap {
                filter.sources.push(source as u32);
                filter.weights.push(weight);
            }
            filter.starts.push(filter.sources.len() as u32);
        }
        filter
    }

    pub(crate) fn outputs(&self) -> usize {
        self.starts.len() - 1
    }

    fn visit(&self, shape: &[usize], mut f: impl FnMut(usize, usize, usize, f64)) {
        // (outer, source or output, inner): contiguous runs of `inner` elements move together.
        let outer: usize = shape[..self.axis].iter().product();
        let inner: usize = shape[self.axis + 1..].iter().product();
        let mut pace = Pace::default();
        for o in 0..outer {
            for j in 0..self.outputs() {
                pace.step(inner * (self.starts[j + 1] - self.starts[j]) as usize);
                for k in self.starts[j] as usize..self.starts[j + 1] as usize {
                    let from = (o * shape[self.axis] + self.sources[k] as usize) * inner;
                    let to = (o * self.outputs() + j) * inner;
                    f(to, from, inner, self.weights[k]);
                }
            }
        }
    }
}

/// How a node was made from its inputs.
#[derive(Clone)]
pub enum Op {
    /// A constant, or a leaf that derivatives are asked for.
    Leaf,
    /// A function of each element.
    Unary(Unary),
    /// An operation between elements of both inputs, broadcast to one another.
    Binary(Binary),
    /// Sum of all elements.
    Sum,
    /// `y[i] = x[table[i]]`: indexing, slicing, transposing, repeating, minima.
    Gather(Arc<Vec<u32>>),
    /// `y[table[i]] += x[i]`: sums over axes, accumulation over faces.
    Scatter(Arc<Vec<u32>>),
    /// The same elements with other axes.
    Reshape,
    /// The inputs' elements one after the other.
    Concat,
    /// `[n, k] × [k, m]`.
    MatMul,
    /// Inverse of an `[n, n]` matrix.
    Inverse,
    /// Elements of the first input where the mask is set, of the second elsewhere; all of one shape.
    Select(Arc<Vec<bool>>),
    /// A linear filter along one axis.
    Filter(Arc<AxisFilter>),
    /// An operation that is defined elsewhere.
    Custom(Arc<dyn CustomOp>),
    /// A derivative. To differentiate it, it is recorded first, and then equals the root of its recorded graph.
    Deferred(Arc<DeferredDerivative>),
}

impl Op {
    /// What is infinitely steep at all elements of these inputs, so that the derivative counts as 0: in words that follow "through".
    pub(super) fn edge(&self, inputs: &[&Tensor]) -> Option<&'static str> {
        let all = |is_steep: &dyn Fn(f64, f64) -> bool| -> bool {
            let [x, others @ ..] = inputs else { return false };
            let second = |i: usize| others.first().map_or(0.0, |y| y.data[if y.len() == x.len() { i } else { 0 }]);
            !x.is_empty()
                && others.iter().all(|y| y.len() == x.len() || y.len() == 1)
                && x.data.iter().enumerate().all(|(i, x)| is_steep(*x, second(i)))
        };
        match self {
            Op::Unary(f) if all(&|x, _| f.is_steep(x)) => Some(match f {
                Unary::Sqrt => "a square root of 0 (as in `sqrt`, `norm`, `length`, `distance` and `std`)",
                Unary::Asin => "the arcsine of 1 or -1",
                _ => "the arccosine of 1 or -1",
            }),
            Op::Binary(f) if all(&|x, y| f.is_steep(x, y)) => Some(match f {
                Binary::Pow => "a power of 0 with an exponent below 1",
                _ => "the `atan2` of 0 and 0",
            }),
            _ => None,
        }
    }

    /// Whether the derivative is 0 everywhere, so that nothing needs to be recorded.
    pub fn is_flat(&self) -> bool {
        match self {
            Op::Unary(f) => f.is_flat(),
            Op::Binary(f) => f.is_comparison(),
            _ => false,
        }
    }

    /// The value, in the given output shape. Shapes have been checked by the builders.
    pub(super) fn forward(&self, inputs: &[&Tensor], shape: Vec<usize>) -> Tensor {
        let n: usize = shape.iter().product();
        let data = match self {
            Op::Leaf | Op::Reshape => inputs[0].data.clone(),
            Op::Custom(_) | Op::Deferred(_) => unreachable!("their values are computed by their builders"),
            Op::Unary(f) => {
                let f = *f;
                mapped(&inputs[0].data, |x| f.value(x))
            }
            Op::Binary(f) => {
                let (a, b) = (inputs[0], inputs[1]);
                let mut out = vec![0.0; n];
                let (sa, sb) = (Broadcast::new(&a.shape, &shape), Broadcast::new(&b.shape, &shape));
                // The match on `f` is hoisted out of the loops that matter.
                macro_rules! run {
                    ($f:expr) => {
                        for_each_pair(n, &sa, &sb, |i, p, q| out[i] = $f(a.data[p], b.data[q]))
                    };
                }
                match f {
                    Binary::Add => run!(|x, y| x + y),
                    Binary::Sub => run!(|x, y| x - y),
                    Binary::Mul => run!(|x, y| x * y),
                    Binary::Div => run!(|x, y| x / y),
                    other => run!(|x, y| other.value(x, y)),
                }
                out
            }
            Op::Sum => vec![inputs[0].data.iter().sum()],
            Op::Gather(table) => mapped(table, |i| inputs[0].data[i as usize]),
            Op::Scatter(table) => {
                let mut out = vec![0.0; n];
                for (table, data) in table.chunks(CHUNK).zip(inputs[0].data.chunks(CHUNK)) {
                    stop::check();
                    table.iter().zip(data).for_each(|(&i, &x)| out[i as usize] += x);
                }
                out
            }
            Op::Concat => {
                let mut out = Vec::with_capacity(n);
                let mut pace = Pace::default();
                for part in inputs {
                    pace.step(part.len());
                    out.extend_from_slice(&part.data);
                }
                out
            }
            Op::MatMul => matmul(inputs[0], inputs[1]),
            Op::Inverse => invert(&inputs[0].data, inputs[0].shape[0]).unwrap_or_else(|| vec![f64::NAN; n]),
            Op::Select(mask) => {
                paced(mask.iter(), 1).enumerate().map(|(i, &m)| inputs[usize::from(!m)].data[i]).collect()
            }
            Op::Filter(filter) => {
                let mut out = vec![0.0; n];
                filter.visit(&inputs[0].shape, |to, from, run, w| {
                    for c in 0..run {
                        out[to + c] += w * inputs[0].data[from + c];
                    }
                });
                out
            }
        };
        Tensor { shape, data }
    }

    /// [`Op::vjp`], but reuses the memory of the output's adjoint if an input's adjoint has the same size.
    pub(super) fn vjp_in_place(
        &self,
        inputs: &[&Tensor],
        output: &Tensor,
        mut g: Tensor,
        wants: &[bool],
    ) -> Result<Vec<Option<Tensor>>, String> {
        match self {
            Op::Reshape | Op::Deferred(_) => {
                g.shape = inputs[0].shape.clone();
                Ok(vec![Some(g)])
            }
            Op::Unary(f) => {
                let mut pace = Pace::default();
                for ((g, x), y) in g.data.iter_mut().zip(&inputs[0].data).zip(&output.data) {
                    pace.step(1);
                    // An adjoint of zero stays zero next to an infinite slope.
                    if *g != 0.0 {
                        *g *= f.slope(*x, *y);
                    }
                }
                Ok(vec![Some(g)])
            }
            Op::Binary(f @ (Binary::Add | Binary::Sub | Binary::Mul)) if wants.iter().filter(|w| **w).count() == 1 => {
                let first = wants[0];
                let (own, other) = if first { (inputs[0], inputs[1]) } else { (inputs[1], inputs[0]) };
                if own.len() != output.len() {
                    return self.vjp(inputs, output, &g, wants);
                }
                match f {
                    Binary::Sub if !first => g.data.iter_mut().for_each(|g| *g = -*g),
                    Binary::Mul => {
                        let spread = Broadcast::new(&other.shape, &output.shape);
                        for_each_pair(output.len(), &Broadcast::Same, &spread, |i, _, q| {
                            if g.data[i] != 0.0 {
                                g.data[i] *= other.data[q];
                            }
                        });
                    }
                    _ => {}
                }
                g.shape = own.shape.clone();
                Ok(if first { vec![Some(g), None] } else { vec![None, Some(g)] })
            }
            _ => self.vjp(inputs, output, &g, wants),
        }
    }

    /// Derivatives of the inputs that are wanted, from the output's derivative.
    fn vjp(
        &self,
        inputs: &[&Tensor],
        output: &Tensor,
        g: &Tensor,
        wants: &[bool],
    ) -> Result<Vec<Option<Tensor>>, String> {
        let like = |i: usize, data: Vec<f64>| Some(Tensor { shape: inputs[i].shape.clone(), data });
        Ok(match self {
            Op::Leaf => vec![],
            Op::Custom(op) => op.vjp(inputs, output, g, wants)?,
            Op::Reshape | Op::Deferred(_) | Op::Unary(_) => return self.vjp_in_place(inputs, output, g.clone(), wants),
            Op::Binary(f) => {
                let (a, b) = (inputs[0], inputs[1]);
                let (sa, sb) = (Broadcast::new(&a.shape, &output.shape), Broadcast::new(&b.shape, &output.shape));
                // One side after the other; the match on `f` is hoisted out of the loops that matter.
                let side = |first: bool| {
                    let mut d = vec![0.0; if first { a.len() } else { b.len() }];
                    macro_rules! run {
                        ($slope:expr) => {
                            for_each_pair(output.len(), &sa, &sb, |i, p, q| {
                                let at = if first { p } else { q };
                                // An adjoint of zero stays zero next to an infinite slope.
                                if g.data[i] != 0.0 {
                                    d[at] += g.data[i] * $slope(a.data[p], b.data[q], output.data[i]);
                                }
                            })
                        };
                    }
                    match (f, first) {
                        (Binary::Add, _) | (Binary::Sub, true) => run!(|_, _, _| 1.0),
                        (Binary::Sub, false) => run!(|_, _, _| -1.0),
                        (Binary::Mul, true) => run!(|_, y: f64, _| y),
                        (Binary::Mul, false) => run!(|x: f64, _, _| x),
                        (_, true) => run!(|x, y, z| f.slopes(x, y, z).0),
                        (_, false) => run!(|x, y, z| f.slopes(x, y, z).1),
                    }
                    d
                };
                vec![wants[0].then(|| like(0, side(true))).flatten(), wants[1].then(|| like(1, side(false))).flatten()]
            }
            Op::Sum => vec![like(0, vec![g.data[0]; inputs[0].len()])],
            Op::Gather(table) => {
                let mut d = vec![0.0; inputs[0].len()];
                for (&i, &x) in table.iter().zip(&g.data) {
                    d[i as usize] += x;
                }
                vec![like(0, d)]
            }
            Op::Scatter(table) => vec![like(0, table.iter().map(|&i| g.data[i as usize]).collect())],
            Op::Concat => {
                let mut at = 0;
                (0..inputs.len())
                    .map(|k| {
                        let d = g.data[at..at + inputs[k].len()].to_vec();
                        at += inputs[k].len();
                        like(k, d)
                    })
                    .collect()
            }
            Op::MatMul => {
                let (a, b) = (inputs[0], inputs[1]);
                vec![
                    wants[0].then(|| like(0, matmul(g, &transposed(b)))).flatten(),
                    wants[1].then(|| like(1, matmul(&transposed(a), g))).flatten(),
                ]
            }
            Op::Inverse => {
                // dX = −Yᵀ G Yᵀ
                let yt = transposed(output);
                let left = Tensor { shape: yt.shape.clone(), data: matmul(&yt, g) };
                vec![like(0, matmul(&left, &yt).iter().map(|x| -x).collect())]
            }
            Op::Select(mask) => (0..2)
                .map(|k| {
                    let keep = |(m, x): (&bool, &f64)| if *m == (k == 0) { *x } else { 0.0 };
                    like(k, mask.iter().zip(&g.data).map(keep).collect())
                })
                .collect(),
            Op::Filter(filter) => {
                let mut d = vec![0.0; inputs[0].len()];
                filter.visit(&inputs[0].shape, |to, from, run, w| {
                    for c in 0..run {
                        d[from + c] += w * g.data[to + c];
                    }
                });
                vec![like(0, d)]
            }
        })
    }

    /// The output's tangent along each of several directions.
    pub(super) fn jvps(
        &self,
        inputs: &[&Tensor],
        output: &Tensor,
        directions: &[Vec<Option<&Tensor>>],
    ) -> Result<Vec<Tensor>, String> {
        match self {
            Op::Custom(op) => op.jvps(inputs, output, directions),
            _ => directions.iter().map(|t| self.jvp(inputs, output, t)).collect(),
        }
    }

    /// The output's tangent, from the inputs' (missing ones are zero).
    pub(super) fn jvp(&self, inputs: &[&Tensor], output: &Tensor, t: &[Option<&Tensor>]) -> Result<Tensor, String> {
        let shape = output.shape.clone();
        let zero = || Tensor::zeros(&output.shape);
        Ok(match self {
            Op::Leaf => zero(),
            Op::Custom(op) => op.jvp(inputs, output, t)?,
            Op::Unary(f) => match t[0] {
                Some(t) => {
                    let x = inputs[0];
                    // A tangent of zero stays zero next to an infinite slope.
                    let mut pace = Pace::default();
                    let along = |i: usize| {
                        pace.step(1);
                        match t.data[i] {
                            0.0 => 0.0,
                            t => t * f.slope(x.data[i], output.data[i]),
                        }
                    };
                    let d = (0..x.len()).map(along).collect();
                    Tensor { shape, data: d }
                }
                None => zero(),
            },
            Op::Binary(f) => {
                let (a, b) = (inputs[0], inputs[1]);
                let (sa, sb) = (Broadcast::new(&a.shape, &shape), Broadcast::new(&b.shape, &shape));
                let mut d = zero();
                for_each_pair(output.len(), &sa, &sb, |i, p, q| {
                    let (dx, dy) = f.slopes(a.data[p], b.data[q], output.data[i]);
                    let (ta, tb) = (t[0].map_or(0.0, |t| t.data[p]), t[1].map_or(0.0, |t| t.data[q]));
                    if ta != 0.0 {
                        d.data[i] += ta * dx;
                    }
                    if tb != 0.0 {
                        d.data[i] += tb * dy;
                    }
                });
                d
            }
            Op::Deferred(_) => match t[0] {
                Some(t) => Tensor { shape, data: t.data.clone() },
                None => zero(),
            },
            // These are linear in their only input: the tangent is mapped like the value.
            Op::Sum | Op::Gather(_) | Op::Scatter(_) | Op::Reshape | Op::Filter(_) => match t[0] {
                Some(t) => self.forward(&[t], shape),
                None => zero(),
            },
            Op::Concat | Op::Select(_) => {
                let filled: Vec<Tensor> =
                    t.iter().zip(inputs).map(|(t, x)| t.cloned().unwrap_or_else(|| Tensor::zeros(&x.shape))).collect();
                self.forward(&filled.iter().collect::<Vec<_>>(), shape)
            }
            Op::MatMul => {
                let mut d = zero();
                for (k, x) in t.iter().enumerate() {
                    let Some(x) = x else { continue };
                    let data = if k == 0 { matmul(x, inputs[1]) } else { matmul(inputs[0], x) };
                    d.accumulate(&Tensor { shape: shape.clone(), data });
                }
                d
            }
            Op::Inverse => match t[0] {
                Some(t) => {
                    let left = Tensor { shape: shape.clone(), data: matmul(output, t) };
                    Tensor { data: matmul(&left, output).iter().map(|x| -x).collect(), shape }
                }
                None => zero(),
            },
        })
    }
}

fn matmul(a: &Tensor, b: &Tensor) -> Vec<f64> {
    let (n, k, m) = (a.shape[0], a.shape[1], b.shape[1]);
    let mut out = vec![0.0; n * m];
    let mut pace = Pace::default();
    for i in 0..n {
        for l in 0..k {
            pace.step(m);
            let x = a.data[i * k + l];
            for j in 0..m {
                out[i * m + j] += x * b.data[l * m + j];
            }
        }
    }
    out
}

fn transposed(a: &Tensor) -> Tensor {
    let (n, m) = (a.shape[0], a.shape[1]);
    let mut out = Tensor::zeros(&[m, n]);
    for i in 0..n {
        for j in 0..m {
            out.data[j * n + i] = a.data[i * m + j];
        }
    }
    out
}

/// Gauss–Jordan with partial pivoting; `None` for a singular matrix.
pub fn invert(a: &[f64], n: usize) -> Option<Vec<f64>> {
    let mut a = a.to_vec();
    let mut out = Tensor::identity(n).data;
    let size = a.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let mut pace = Pace::default();
    for col in 0..n {
        let pivot = (col..n).max_by(|&i, &j| a[i * n + col].abs().total_cmp(&a[j * n + col].abs()))?;
        let p = a[pivot * n + col];
        if p.is_nan() || p.abs() <= 1e-14 * size {
            return None;
        }
        for j in 0..n {
            a.swap(pivot * n + j, col * n + j);
            out.swap(pivot * n + j, col * n + j);
        }
        for j in 0..n {
            a[col * n + j] /= p;
            out[col * n + j] /= p;
        }
        for i in (0..n).filter(|&i| i != col) {
            pace.step(n);
            let f = a[i * n + col];
            for j in 0..n {
                a[i * n + j] -= f * a[col * n + j];
                out[i * n + j] -= f * out[col * n + j];
            }
        }
    }
    Some(out)
}
