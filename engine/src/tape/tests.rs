use super::*;

/// Numbers in (−1, 1), the same at every run.
fn numbers(shape: &[usize], seed: u64) -> Tensor {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let n: usize = shape.iter().product();
    let data = (0..n)
        .map(|_| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        })
        .collect();
    Tensor::new(shape.to_vec(), data)
}

/// Kept away from zero, where a quotient is steep.
fn away(x: &Tensor) -> Tensor {
    x.map(|x| x + 0.5 * x.signum())
}

/// ⟨Jv, w⟩ = ⟨v, Jᵀw⟩, and Jv agrees with central differences.
fn check(name: &str, inputs: &[Tensor], f: impl Fn(&[Var]) -> Var) {
    let leaves: Vec<Var> = inputs.iter().cloned().map(Var::leaf).collect();
    let y = f(&leaves);
    let w = numbers(y.shape(), 77);
    let grads = backward_with(&y, w.clone(), &leaves).unwrap();
    let v: Vec<Tensor> = inputs.iter().enumerate().map(|(i, x)| numbers(&x.shape, 100 + i as u64)).collect();
    let tangents: Vec<(Var, Tensor)> = leaves.iter().cloned().zip(v.iter().cloned()).collect();
    let jv = forward(&y, &tangents).unwrap();
    assert_eq!(jv.shape, y.shape(), "{name}");
    let (left, right) = (jv.dot(&w), grads.iter().zip(&v).map(|(g, v)| g.dot(v)).sum::<f64>());
    assert!((left - right).abs() < 1e-9 * (1.0 + left.abs()), "{name}: forward {left}, reverse {right}");
    let h = 1e-5;
    let at = |s: f64| {
        let moved: Vec<Var> = inputs
            .iter()
            .zip(&v)
            .map(|(x, v)| {
                let mut x = x.clone();
                x.accumulate(&v.scaled(s * h));
                Var::constant(x)
            })
            .collect();
        f(&moved).value().dot(&w)
    };
    let fd = (at(1.0) - at(-1.0)) / (2.0 * h);
    assert!((left - fd).abs() < 1e-6 * (1.0 + fd.abs()), "{name}: forward {left}, differences {fd}");
}

#[test]
fn every_unary_has_its_derivative() {
    use Unary::*;
    for f in [Neg, Sin, Cos, Tan, Asin, Acos, Atan, Tanh, Exp, Square, Abs, Recip, Sigmoid, Sign, Floor, Ceil, Round] {
        check(&format!("{f:?}"), &[numbers(&[7], 3)], |x| x[0].unary(f));
    }
    for f in [Log, Sqrt] {
        check(&format!("{f:?}"), &[numbers(&[7], 3).map(|x| x + 1.5)], |x| x[0].unary(f));
    }
    let x = Var::leaf(2.0);
    assert!(!x.unary(Stop).is_live());
}

#[test]
fn every_binary_has_its_derivative_and_broadcasts() {
    use Binary::*;
    for f in [Add, Sub, Mul, Div, Min, Max, Atan2, Lt] {
        for (a, b) in [
            (vec![2, 3, 3], vec![3]),
            (vec![2, 3, 3], vec![2, 3, 1]),
            (vec![], vec![4]),
            (vec![3, 1], vec![1, 2]),
            (vec![5], vec![5]),
        ] {
            check(&format!("{f:?} {a:?} {b:?}"), &[numbers(&a, 5), away(&numbers(&b, 6))], |x| {
                x[0].binary(f, &x[1]).unwrap()
            });
        }
    }
    let positive = numbers(&[4], 1).map(|x| x + 1.5);
    check("pow", &[positive.clone(), numbers(&[4], 2)], |x| x[0].binary(Pow, &x[1]).unwrap());
    check("mod", &[numbers(&[4], 9), positive], |x| x[0].binary(Mod, &x[1]).unwrap());
    check("cube", &[numbers(&[4], 2)], |x| x[0].binary(Pow, &Var::from(3.0)).unwrap());
    check("square", &[numbers(&[4], 2)], |x| x[0].binary(Pow, &Var::from(2.0)).unwrap());
}

#[test]
fn a_square_has_a_derivative_at_zero() {
    let x = Var::leaf(Tensor::vector(vec![0.0, 3.0]));
    let y = x.binary(Binary::Pow, &Var::from(2.0)).unwrap().sum();
    assert_eq!(backward(&y, &[x]).unwrap()[0].data, [0.0, 6.0]);
}

#[test]
fn reductions() {
    let x = numbers(&[3, 4, 2], 8);
    check("sum", std::slice::from_ref(&x), |x| x[0].sum());
    check("mean", std::slice::from_ref(&x), |x| x[0].mean().unwrap());
    check("min", std::slice::from_ref(&x), |x| x[0].min().unwrap());
    check("max", std::slice::from_ref(&x), |x| x[0].max().unwrap());
    check("norm", std::slice::from_ref(&x), |x| x[0].norm());
    for axes in [vec![0], vec![1], vec![2], vec![0, 2], vec![0, 1, 2]] {
        check("sum_axes", std::slice::from_ref(&x), |x| x[0].sum_axes(&axes).unwrap());
        check("max_axes", std::slice::from_ref(&x), |x| x[0].max_axes(&axes).unwrap());
        check("mean_axes", std::slice::from_ref(&x), |x| x[0].mean_axes(&axes).unwrap());
    }
    let t = Var::constant(Tensor::new(vec![2, 2], vec![1.0, 2.0, 3.0, 4.0]));
    assert_eq!(t.sum_axes(&[0]).unwrap().value().data, [4.0, 6.0]);
    assert_eq!(t.max_axes(&[1]).unwrap().value().data, [2.0, 4.0]);
}

#[test]
fn rearrangements() {
    let x = numbers(&[3, 4, 2], 8);
    let one = std::slice::from_ref(&x);
    check("slice", one, |x| x[0].slice(&[Slice::Range(1, -1), Slice::At(-1), Slice::List(vec![1, 0, 1])]).unwrap());
    check("rows", one, |x| x[0].rows(&[2, 0, 2]).unwrap());
    check("reshape", one, |x| x[0].reshape(vec![6, 4]).unwrap());
    check("permute", one, |x| x[0].permute(&[2, 0, 1]).unwrap());
    check("broadcast", &[numbers(&[2], 1)], |x| x[0].broadcast_to(&[3, 2]).unwrap());
    check("concat", &[x.clone(), numbers(&[3, 1, 2], 4)], |x| Var::concat(x, 1).unwrap());
    check("concat 0", &[x.clone(), numbers(&[1, 4, 2], 4)], |x| Var::concat(x, 0).unwrap());
    check("stack", &[x.clone(), numbers(&[3, 4, 2], 4)], |x| Var::stack(x).unwrap());
    let table = std::sync::Arc::new((0..24u32).map(|i| i % 5).collect::<Vec<_>>());
    check("scatter", one, |x| x[0].scatter(table.clone(), vec![5]));
    check("select", &[x.clone(), numbers(&[2], 9)], |v| {
        Var::select(&Var::constant(x.map(|x| f64::from(x > 0.0))), &v[0], &v[1]).unwrap()
    });
    let taps = vec![vec![(0, 0.25), (1, 0.75)], vec![(3, 2.0)], vec![]];
    check("filter", one, |x| x[0].filter(AxisFilter::new(1, taps.clone())).unwrap());
    let t = Var::constant(Tensor::new(vec![2, 3], (0..6).map(f64::from).collect()));
    assert_eq!(t.transpose().unwrap().value().data, [0.0, 3.0, 1.0, 4.0, 2.0, 5.0]);
    assert!(t.slice(&[Slice::At(2)]).is_err());
    assert!(t.slice(&[Slice::Range(1, 5)]).is_err());
}

#[test]
fn linear_algebra() {
    let (m, n) = (numbers(&[3, 3], 1), numbers(&[3, 3], 2));
    check("matmul", &[numbers(&[5, 3], 3), m.clone()], |x| x[0].matmul(&x[1]).unwrap());
    check("matrix vector", &[m.clone(), numbers(&[3], 3)], |x| x[0].matmul(&x[1]).unwrap());
    check("vector matrix", &[numbers(&[3], 3), n], |x| x[0].matmul(&x[1]).unwrap());
    check("inverse", std::slice::from_ref(&m), |x| x[0].inverse().unwrap());
    check("determinant", std::slice::from_ref(&m), |x| x[0].determinant().unwrap());
    check("cross", &[numbers(&[4, 3], 3), numbers(&[3], 4)], |x| x[0].cross(&x[1]).unwrap());
    check("dot", &[numbers(&[4, 3], 3), numbers(&[3], 4)], |x| x[0].dot(&x[1]).unwrap());
    check("normalize", &[numbers(&[4, 3], 3)], |x| x[0].normalize().unwrap());
    check("exp", &[numbers(&[3], 3)], |x| Var::rotation_exp(&x[0]).unwrap());
    check("exp at 0", &[numbers(&[3], 3).scaled(1e-9)], |x| Var::rotation_exp(&x[0]).unwrap());
    check("about", &[numbers(&[3], 3), Tensor::scalar(0.7)], |x| Var::rotation_about(&x[0], &x[1]).unwrap());
    check("affine", &[m, numbers(&[3], 7)], |x| Var::affine(&x[0], &x[1]).unwrap());
    let x = Var::constant(Tensor::vector(vec![1.0, 0.0, 0.0]));
    let y = Var::constant(Tensor::vector(vec![0.0, 1.0, 0.0]));
    assert_eq!(x.cross(&y).unwrap().value().data, [0.0, 0.0, 1.0]);
    let quarter = Var::rotation_about(
        &Var::constant(Tensor::vector(vec![0.0, 0.0, 2.0])),
        &Var::from(std::f64::consts::FRAC_PI_2),
    );
    let turned = quarter.unwrap().matmul(&x).unwrap();
    assert!((turned.value().data[1] - 1.0).abs() < 1e-12);
    assert!(Var::constant(Tensor::zeros(&[3, 3])).inverse().is_err());
}

/// Twice the input; notes what it was asked for.
struct Twice(std::sync::Mutex<Vec<Vec<bool>>>);

impl CustomOp for Twice {
    fn name(&self) -> &str {
        "twice"
    }

    fn vjp(&self, _: &[&Tensor], _: &Tensor, g: &Tensor, wants: &[bool]) -> Result<Vec<Option<Tensor>>, String> {
        self.0.lock().unwrap().push(wants.to_vec());
        Ok(wants.iter().map(|w| w.then(|| g.scaled(2.0))).collect())
    }

    fn jvp(&self, _: &[&Tensor], y: &Tensor, t: &[Option<&Tensor>]) -> Result<Tensor, String> {
        let mut out = Tensor::zeros(&y.shape);
        t.iter().flatten().for_each(|t| out.accumulate(&t.scaled(2.0)));
        Ok(out)
    }
}

#[test]
fn custom_operations_are_asked_only_for_what_is_wanted() {
    let op = std::sync::Arc::new(Twice(std::sync::Mutex::new(vec![])));
    let make = |x: &[Var]| {
        let value = x[0].add(&x[1]).unwrap().value().scaled(2.0);
        Var::custom(op.clone(), x.to_vec(), value)
    };
    check("twice", &[numbers(&[3], 1), numbers(&[3], 2)], make);
    let (a, b) = (Var::leaf(1.0), Var::leaf(2.0));
    let y = make(&[a, b.clone()]);
    assert_eq!(backward(&y, &[b]).unwrap()[0], Tensor::scalar(2.0));
    assert_eq!(op.0.lock().unwrap().last().unwrap(), &vec![false, true]);
}

/// Counts how often it is asked, and for how many directions.
struct Asked(std::sync::Mutex<Vec<usize>>);

impl CustomOp for Asked {
    fn name(&self) -> &str {
        "asked"
    }

    fn vjp(&self, _: &[&Tensor], _: &Tensor, g: &Tensor, _: &[bool]) -> Result<Vec<Option<Tensor>>, String> {
        Ok(vec![Some(g.clone())])
    }

    fn jvp(&self, _: &[&Tensor], y: &Tensor, t: &[Option<&Tensor>]) -> Result<Tensor, String> {
        Ok(t[0].cloned().unwrap_or_else(|| Tensor::zeros(&y.shape)))
    }

    fn jvps(&self, x: &[&Tensor], y: &Tensor, along: &[Vec<Option<&Tensor>>]) -> Result<Vec<Tensor>, String> {
        self.0.lock().unwrap().push(along.len());
        along.iter().map(|t| self.jvp(x, y, t)).collect()
    }
}

#[test]
fn a_jacobian_visits_every_operation_once_with_the_directions_that_reach_it() {
    let op = std::sync::Arc::new(Asked(std::sync::Mutex::new(vec![])));
    let (a, b) = (Var::leaf(numbers(&[12], 1)), Var::leaf(numbers(&[3], 2)));
    let seen = Var::custom(op.clone(), vec![a.unary(Unary::Sin)], a.unary(Unary::Sin).value().clone());
    let (y, z) = (seen.mul(&b.sum()).unwrap(), b.unary(Unary::Exp));
    let directions: Vec<Vec<(Var, Tensor)>> = (0..12).map(|i| unit(&a, i)).chain((0..3).map(|i| unit(&b, i))).collect();
    let found = jacobian(&[y.clone(), z.clone()], &directions).unwrap();
    assert_eq!(*op.0.lock().unwrap(), [12]);
    for (output, rows) in [y, z].iter().zip(found) {
        for (direction, row) in directions.iter().zip(rows) {
            assert_eq!(row, forward(output, direction).unwrap());
        }
    }
}

#[test]
fn sums_of_squares_are_recognised_and_nothing_else() {
    let (x, y) = (Var::leaf(numbers(&[2, 3], 1)), Var::leaf(2.0));
    let r = x.shift(0.5).mul(&y).unwrap();
    let sum = r.unary(Unary::Square).mean().unwrap().add(&y.mul(&y).unwrap().scale(3.0)).unwrap().shift(7.0);
    let both = [x.clone(), y.clone()];
    let found = squares(&sum, &both).unwrap();
    let term = |s: &Squares| s.residual.value().data.iter().zip(&s.weights.data).map(|(r, w)| w * r * r).sum::<f64>();
    assert_eq!(found.len(), 2);
    assert!((found.iter().map(term).sum::<f64>() + 7.0 - sum.item().unwrap()).abs() < 1e-12);
    // To whom y is a constant, its square is one too.
    assert_eq!(squares(&sum, std::slice::from_ref(&x)).unwrap().len(), 1);
    let squared = || r.unary(Unary::Square).sum();
    for (loss, why) in [
        (r.unary(Unary::Abs).sum(), "`abs`"),
        (squared().unary(Unary::Sqrt), "`sqrt`"),
        (squared().neg(), "subtracted"),
        (squared().add(&y).unwrap(), "linear"),
        (squared().mul(&y).unwrap(), "product"),
    ] {
        assert!(squares(&loss, &both).is_err_and(|e| e.0.contains(why)), "{why}");
    }
}

#[test]
fn constants_are_folded_and_shared_nodes_counted_once() {
    assert!(!Var::from(1.0).add(&Var::from(2.0)).unwrap().is_live());
    let x = Var::leaf(3.0);
    let y = x.mul(&x).unwrap();
    let z = y.add(&y).unwrap();
    assert_eq!(backward(&z, std::slice::from_ref(&x)).unwrap()[0], Tensor::scalar(12.0));
    assert!(depends(&z, &x));
    assert!(!depends(&z, &Var::leaf(1.0)));
    assert!(backward(&Var::leaf(Tensor::vector(vec![1.0, 2.0])), &[x]).is_err());
}

#[test]
fn a_very_long_chain_neither_overflows_nor_leaks() {
    let x = Var::leaf(1.0);
    let mut y = x.clone();
    for _ in 0..200_000 {
        y = y.shift(1.0);
    }
    assert_eq!(backward(&y, &[x]).unwrap()[0], Tensor::scalar(1.0));
}

/// The rows of the table in the docs of `tape`: an operation at an edge, and its derivative in each input.
#[test]
fn edges() {
    use Binary::{Atan2, Max, Min, Mod, Pow};
    use Unary::{Abs, Acos, Asin, Ceil, Floor, Log, Recip, Round, Sigmoid, Sign, Sqrt, Tanh};
    let inf = f64::INFINITY;
    for (f, x, slope) in [
        (Sqrt, 0.0, 0.0),
        (Log, 0.0, inf),
        (Recip, 0.0, -inf),
        (Asin, 1.0, 0.0),
        (Asin, -1.0, 0.0),
        (Acos, 1.0, 0.0),
        (Acos, -1.0, 0.0),
        (Acos, 1.0 + 1e-15, 0.0),
        (Abs, 0.0, 0.0),
        (Sign, 0.0, 0.0),
        (Floor, 2.0, 0.0),
        (Ceil, 2.0, 0.0),
        (Round, 2.5, 0.0),
        (Sigmoid, -1e4, 0.0),
        (Sigmoid, 1e4, 0.0),
        (Tanh, 1e4, 0.0),
    ] {
        edge(&format!("{f:?} at {x}"), &[Tensor::scalar(x)], &[slope], |v| v[0].unary(f));
    }
    for (f, x, y, dx, dy) in [
        (Pow, 0.0, 0.45, 0.0, 0.0),
        (Pow, 0.0, 1.0, 1.0, 0.0),
        (Pow, 0.0, 1.5, 0.0, 0.0),
        (Pow, 0.0, 2.0, 0.0, 0.0),
        (Pow, 0.0, 3.0, 0.0, 0.0),
        (Pow, 0.0, 0.0, 0.0, 0.0),
        (Pow, 5.0, 0.0, 0.0, 5f64.ln()),
        (Pow, -2.0, 3.0, 12.0, 0.0),
        (Pow, -2.0, 0.0, 0.0, 0.0),
        (Pow, 0.0, -1.0, -inf, 0.0),
        (Atan2, 0.0, 0.0, 0.0, 0.0),
        (Atan2, 1e-200, 0.0, 0.0, -1e200),
        (Min, 2.0, 2.0, 1.0, 0.0),
        (Max, 2.0, 2.0, 1.0, 0.0),
        (Mod, 6.0, 2.0, 1.0, -3.0),
    ] {
        let inputs = [Tensor::scalar(x), Tensor::scalar(y)];
        edge(&format!("{f:?} at {x}, {y}"), &inputs, &[dx, dy], |v| v[0].binary(f, &v[1]).unwrap());
    }
    let equal = [Tensor::vector(vec![3.0, 3.0])];
    edge("min of equals", &equal, &[1.0, 0.0], |v| v[0].min().unwrap());
    edge("max of equals", &equal, &[1.0, 0.0], |v| v[0].max().unwrap());
    let zero = [Tensor::zeros(&[3])];
    edge("norm at 0", &zero, &[0.0; 3], |v| v[0].norm());
    edge("length at 0", &zero, &[0.0; 3], |v| v[0].length().unwrap());
    edge("normalize at 0", &zero, &[0.0; 3], |v| v[0].normalize().unwrap().sum());
    let beside = [Tensor::new(vec![2, 3], vec![0.0, 0.0, 0.0, 0.0, 2.0, 0.0])];
    edge("normalize beside 0", &beside, &[0.0, 0.0, 0.0, 0.5, 0.0, 0.5], |v| v[0].normalize().unwrap().sum());
}

/// Both modes give `slopes`; next to a derivative of 0 nothing becomes a NaN.
fn edge(name: &str, inputs: &[Tensor], slopes: &[f64], f: impl Fn(&[Var]) -> Var) {
    let leaves: Vec<Var> = inputs.iter().cloned().map(Var::leaf).collect();
    let y = f(&leaves);
    let reverse = backward(&y, &leaves).unwrap();
    let reverse: Vec<f64> = reverse.into_iter().flat_map(|t| t.data).collect();
    let near = |a: f64, b: f64| a == b || (a - b).abs() <= 1e-12 * b.abs();
    assert!(reverse.iter().zip(slopes).all(|(a, b)| near(*a, *b)), "{name}: reverse {reverse:?}, not {slopes:?}");
    let elements = leaves.iter().flat_map(|l| (0..l.len()).map(move |i| (l, i)));
    let along: Vec<f64> = elements.map(|(l, i)| forward(&y, &unit(l, i)).unwrap().data[0]).collect();
    assert!(along.iter().zip(slopes).all(|(a, b)| near(*a, *b)), "{name}: forward {along:?}, not {slopes:?}");
    let still = backward(&y.scale(0.0), &leaves).unwrap();
    assert!(still.iter().all(|t| t.data.iter().all(|x| *x == 0.0)), "{name}: {still:?}");
    let nothing: Vec<(Var, Tensor)> = leaves.iter().map(|l| (l.clone(), Tensor::zeros(l.shape()))).collect();
    assert_eq!(forward(&y, &nothing).unwrap().data, [0.0], "{name}");
}

#[test]
fn nan_passes_through_minima_and_maxima() {
    let nan = Var::from(f64::NAN);
    for f in [Binary::Min, Binary::Max] {
        for (x, y) in [(nan.clone(), Var::from(1.0)), (Var::from(1.0), nan.clone())] {
            assert!(x.binary(f, &y).unwrap().value().data[0].is_nan(), "{f:?}");
        }
    }
    for place in 0..3 {
        let mut data = vec![1.0, 2.0, 3.0];
        data[place] = f64::NAN;
        let v = Var::constant(Tensor::vector(data));
        assert!(v.min().unwrap().value().data[0].is_nan() && v.max().unwrap().value().data[0].is_nan(), "{place}");
    }
}

/// The gradient of ⟨w, gradient of f⟩, which is its second derivatives along w: as differences of gradients have it, for
/// the nodes of reverse mode and of forward mode.
fn check_twice(name: &str, inputs: &[Tensor], f: impl Fn(&[Var]) -> Var) {
    let leaves: Vec<Var> = inputs.iter().cloned().map(Var::leaf).collect();
    let directions: Vec<Tensor> = inputs.iter().enumerate().map(|(i, x)| numbers(&x.shape, 500 + i as u64)).collect();
    let scalar = |x: &[Var]| {
        let y = f(x);
        let w = numbers(y.shape(), 77);
        y.mul(&Var::constant(w)).unwrap().sum()
    };
    let h = 1e-5;
    let gradients_at = |s: f64| {
        let moved = inputs.iter().zip(&directions).map(|(x, v)| {
            let mut x = x.clone();
            x.accumulate(&v.scaled(s * h));
            Var::leaf(x)
        });
        let moved: Vec<Var> = moved.collect();
        backward(&scalar(&moved), &moved).unwrap()
    };
    let (up, down) = (gradients_at(1.0), gradients_at(-1.0));
    let y = scalar(&leaves);
    let constants: Vec<Var> = directions.iter().cloned().map(Var::constant).collect();
    let first = backward(&y, &leaves).unwrap();
    let mut along = Var::from(0.0);
    for ((leaf, g), v) in leaves.iter().zip(first).zip(&constants) {
        along = along.add(&Var::gradient_of(&y, leaf, g).mul(v).unwrap().sum()).unwrap();
    }
    let tangents: Vec<(Var, Tensor)> = leaves.iter().cloned().zip(directions.iter().cloned()).collect();
    let tangent = forward(&y, &tangents).unwrap();
    for (way, twice) in [("reverse", along), ("forward", Var::derivative_along(&y, &leaves, &constants, tangent))] {
        let found = backward(&twice, &leaves).unwrap();
        for ((found, up), down) in found.iter().zip(&up).zip(&down) {
            for ((x, u), d) in found.data.iter().zip(&up.data).zip(&down.data) {
                let difference = (u - d) / (2.0 * h);
                assert!((x - difference).abs() < 1e-5 * (1.0 + x.abs()), "{name}, {way}: {x} is {difference}");
            }
        }
    }
}

#[test]
fn every_operation_has_its_second_derivatives() {
    use Unary::*;
    for f in [Neg, Sin, Cos, Tan, Asin, Acos, Atan, Tanh, Exp, Square, Abs, Recip, Sigmoid] {
        check_twice(&format!("{f:?}"), &[numbers(&[7], 3).map(|x| 0.9 * x)], |x| x[0].unary(f));
    }
    for f in [Log, Sqrt] {
        check_twice(&format!("{f:?}"), &[numbers(&[7], 3).map(|x| x + 1.5)], |x| x[0].unary(f));
    }
    for f in [Binary::Add, Binary::Sub, Binary::Mul, Binary::Div, Binary::Min, Binary::Max, Binary::Atan2] {
        for (a, b) in [(vec![2, 3, 3], vec![3]), (vec![2, 3], vec![2, 1]), (vec![], vec![4]), (vec![3, 1], vec![1, 2])]
        {
            check_twice(&format!("{f:?} {a:?} {b:?}"), &[numbers(&a, 5), away(&numbers(&b, 6))], |x| {
                // Squared, so that what is linear has second derivatives too.
                x[0].binary(f, &x[1]).unwrap().unary(Square)
            });
        }
    }
    let positive = numbers(&[4], 1).map(|x| x + 1.5);
    check_twice("pow", &[positive.clone(), numbers(&[4], 2)], |x| x[0].binary(Binary::Pow, &x[1]).unwrap());
    check_twice("mod", &[numbers(&[4], 9), positive], |x| x[0].binary(Binary::Mod, &x[1]).unwrap().unary(Square));
    check_twice("cube", &[numbers(&[4], 2)], |x| x[0].binary(Binary::Pow, &Var::from(3.0)).unwrap());
    let x = numbers(&[3, 4, 2], 8);
    let one = std::slice::from_ref(&x);
    check_twice("mean", one, |x| x[0].mean().unwrap().unary(Exp));
    check_twice("max", one, |x| x[0].max_axes(&[1]).unwrap().unary(Exp));
    check_twice("sums", one, |x| x[0].sum_axes(&[0, 2]).unwrap().unary(Exp));
    check_twice("norm", one, |x| x[0].norm());
    check_twice("normalize", one, |x| x[0].normalize().unwrap());
    check_twice("concat", &[x.clone(), numbers(&[3, 1, 2], 4)], |x| Var::concat(x, 1).unwrap().unary(Square));
    check_twice("select", &[x.clone(), numbers(&[2], 9)], |v| {
        Var::select(&Var::constant(x.map(|x| f64::from(x > 0.0))), &v[0], &v[1]).unwrap().unary(Square)
    });
    let taps = vec![vec![(0, 0.25), (1, 0.75)], vec![(3, 2.0)], vec![]];
    check_twice("filter", one, |x| x[0].filter(AxisFilter::new(1, taps.clone())).unwrap().unary(Square));
    let m = numbers(&[3, 3], 1);
    check_twice("matmul", &[numbers(&[5, 3], 3), m.clone()], |x| x[0].matmul(&x[1]).unwrap());
    check_twice("inverse", std::slice::from_ref(&m), |x| x[0].inverse().unwrap());
    check_twice("determinant", std::slice::from_ref(&m), |x| x[0].determinant().unwrap());
    check_twice("exp", &[numbers(&[3], 3)], |x| Var::rotation_exp(&x[0]).unwrap());
    check_twice("exp at 0", &[numbers(&[3], 3).scaled(1e-9)], |x| Var::rotation_exp(&x[0]).unwrap());
}

#[test]
fn derivatives_of_any_order_and_of_aliases() {
    let q = Var::leaf(2.0);
    let power = |x: &Var, p: f64| x.binary(Binary::Pow, &Var::from(p)).unwrap();
    let mut y = power(&q, 5.0);
    for expected in [80.0, 160.0, 240.0, 240.0, 120.0, 0.0] {
        let g = backward(&y, std::slice::from_ref(&q)).unwrap().swap_remove(0);
        assert!((g.data[0] - expected).abs() < 1e-9, "{g:?} is not {expected}");
        y = Var::gradient_of(&y, &q, g);
    }
    // The derivative of s³ in s = q², as a function of q: 3 q⁴.
    let s = q.unary(Unary::Square).alias();
    let cube = power(&s, 3.0);
    let in_s = Var::gradient_of(&cube, &s, backward(&cube, std::slice::from_ref(&s)).unwrap().swap_remove(0));
    assert_eq!(in_s.item(), Some(48.0));
    assert!((backward(&in_s, std::slice::from_ref(&q)).unwrap()[0].data[0] - 96.0).abs() < 1e-9);
    // At edges no derivative of a finite one is a NaN.
    for f in [Unary::Sqrt, Unary::Abs, Unary::Asin, Unary::Acos] {
        for x in [0.0, 1.0] {
            let x = Var::leaf(x);
            let y = x.unary(f);
            let g = Var::gradient_of(&y, &x, backward(&y, std::slice::from_ref(&x)).unwrap().swap_remove(0));
            let twice = backward(&g, std::slice::from_ref(&x)).unwrap();
            assert!(twice[0].is_finite(), "{f:?}: {twice:?}");
        }
    }
    // What is measured, and an operation that says nothing of it, are refused.
    let op = std::sync::Arc::new(Twice(std::sync::Mutex::new(vec![])));
    let y = Var::custom(op, vec![q.clone()], Tensor::scalar(4.0)).unary(Unary::Square);
    let g = backward(&y, std::slice::from_ref(&q)).unwrap().swap_remove(0);
    for (node, name) in [
        (Var::gradient_of(&y, &q, g), "`twice` has first derivatives only"),
        (Var::measured("fd", vec![q.clone()], Tensor::scalar(1.0)), "`fd` has first derivatives only"),
    ] {
        let refused = backward(&node, std::slice::from_ref(&q)).unwrap_err();
        assert!(refused.0.contains(name) && help(&refused.0).is_some(), "{refused}");
    }
}
