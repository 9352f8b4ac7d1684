//! Spaces by themselves, and what solvers make of them.

use super::super::{Lbfgs, LeastSquares, Optimizer, Solver, Twice};
use super::*;

#[test]
fn the_exponential_is_a_rotation_by_that_angle() {
    let quarter = exponential([0.0, std::f64::consts::FRAC_PI_2, 0.0]);
    // About y by 90 degrees: z → x.
    let expected = [0.0, 0.0, 1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 0.0];
    for (q, e) in quarter.iter().zip(expected) {
        assert!((q - e).abs() < 1e-12);
    }
    for scale in [1e-9, 1e-5, 9e-5, 1.1e-4, 0.3, 3.0] {
        assert!(orthonormality_error(&exponential([0.6 * scale, -0.3 * scale, 0.2 * scale])) < 1e-12);
    }
}

#[test]
fn the_tangent_gradient_is_the_derivative_along_the_exponential() {
    let r = rotation_about([1.0, 2.0, -0.5], 0.8);
    let g = [0.3, -1.0, 2.0, 0.7, 0.1, -0.4, 1.5, -0.2, 0.6];
    let value =
        |omega: [f64; 3]| -> f64 { multiplied(&exponential(omega), &r).iter().zip(g).map(|(a, b)| a * b).sum() };
    let space = Space { geometry: Geometry::Rotation, ..Space::plain() };
    let tangent = space.tangent_gradient(&r, &g);
    for k in 0..3 {
        let (mut plus, mut minus) = ([0.0; 3], [0.0; 3]);
        plus[k] = 1e-5;
        minus[k] = -1e-5;
        let difference = (value(plus) - value(minus)) / 2e-5;
        assert!((difference - tangent[k]).abs() < 1e-8, "{difference} against {}", tangent[k]);
    }
}

#[test]
fn what_has_both_bounds_is_drawn_between_them() {
    let space = Space { lower: Some(vec![0.0, -1.0]), upper: Some(vec![1.0, f64::INFINITY]), ..Space::plain() };
    let drawn: Vec<f64> = (0..50).flat_map(|seed| space.drawn(&[7.0, 8.0], 7919 * seed)).collect();
    let (some, others): (Vec<f64>, Vec<f64>) = drawn.chunks(2).map(|d| (d[0], d[1])).unzip();
    assert!(some.iter().all(|x| (0.0..=1.0).contains(x)) && some.iter().any(|x| *x < 0.2) && others == [8.0; 50]);
    assert!(space.can_be_drawn() && !Space::plain().can_be_drawn());
}

#[test]
fn bounds_are_elementwise_and_repeat() {
    let space = Space { lower: Some(vec![0.0, -1.0]), upper: Some(vec![1.0]), ..Space::plain() };
    let mut value = [-0.5, -0.5, 2.0, -3.0];
    assert_eq!(space.project(&mut value), [0, 2, 3]);
    assert_eq!(value, [0.0, -0.5, 1.0, -1.0]);
}

/// Spaces of two or three numbers with values in them.
fn spaces() -> Vec<(Space, Vec<f64>)> {
    let bounded = |geometry, lower, upper| Space { geometry, lower: Some(lower), upper: Some(upper), ..Space::plain() };
    let (none, all) = (f64::NEG_INFINITY, f64::INFINITY);
    vec![
        (Space { scale: 3.0, ..Space::plain() }, vec![0.3, -2.0]),
        (Space { geometry: Geometry::Positive, ..Space::plain() }, vec![0.3, 2.5]),
        (Space { scale: 0.5, ..bounded(Geometry::Positive, vec![0.1], vec![9.0]) }, vec![0.3, 5.0]),
        (bounded(Geometry::Interior, vec![-1.0, 2.0], vec![1.0, 7.0]), vec![0.8, 2.1]),
        (Space { scale: 2.0, ..bounded(Geometry::Interior, vec![-1.0, none], vec![all, 3.0]) }, vec![0.8, -4.0]),
        (Space { scale: 2.0, geometry: Geometry::Unit, ..Space::plain() }, vec![0.6, 0.0, 0.8, 0.0, -1.0, 0.0]),
    ]
}

#[test]
fn gradients_in_every_space_are_derivatives_along_its_steps() {
    let loss = |x: &[f64]| x.iter().enumerate().map(|(k, x)| (k as f64 + 0.7) * (1.3 * x - 0.4).sin()).sum::<f64>();
    for (space, value) in spaces() {
        let slopes: Vec<f64> =
            value.iter().enumerate().map(|(k, x)| 1.3 * (k as f64 + 0.7) * (1.3 * x - 0.4).cos()).collect();
        let gradient = space.tangent_gradient(&value, &slopes);
        let mut rows: Vec<Vec<f64>> = slopes.iter().map(|slope| vec![*slope, 2.0 * slope]).collect();
        space.turn_rows(&value, &mut rows);
        assert_eq!(gradient.len(), space.unknowns(value.len()));
        for k in 0..gradient.len() {
            let along = |step: f64| {
                let (mut moved, mut update) = (value.clone(), vec![0.0; gradient.len()]);
                update[k] = step;
                assert!(space.retract(&mut moved, &update).is_empty());
                moved
            };
            let difference = (loss(&along(1e-5)) - loss(&along(-1e-5))) / 2e-5;
            assert!(
                (difference - gradient[k]).abs() < 1e-8 * (1.0 + gradient[k].abs()),
                "{space:?}: {difference} against {}",
                gradient[k]
            );
            assert!((rows[k][0] - gradient[k]).abs() < 1e-14 && (rows[k][1] - 2.0 * gradient[k]).abs() < 1e-14);
            let mut unit = vec![0.0; gradient.len()];
            unit[k] = 1.0;
            let tangent = space.tangent(&value, &unit);
            let moved = along(1e-5).into_iter().zip(along(-1e-5)).map(|(a, b)| (a - b) / 2e-5);
            assert!(moved.zip(&tangent).all(|(m, t)| (m - t).abs() < 1e-8), "{space:?}: {tangent:?}");
            // A step of nothing changes nothing.
            assert_eq!(along(0.0).map_bits(), value.map_bits());
        }
    }
}

trait Bits {
    fn map_bits(&self) -> Vec<u64>;
}

impl Bits for Vec<f64> {
    fn map_bits(&self) -> Vec<u64> {
        self.iter().map(|x| x.to_bits()).collect()
    }
}

const RULES: [Solver; 5] = [
    Solver::Sgd { momentum: 0.9, nesterov: true },
    Solver::Adam { beta1: 0.9, beta2: 0.999, epsilon: 1e-8 },
    Solver::AdamUniform { beta1: 0.9, beta2: 0.999, epsilon: 1e-8 },
    Solver::RmsProp { decay: 0.99, epsilon: 1e-8, momentum: 0.5 },
    Solver::Sgd { momentum: 0.0, nesterov: false },
];

#[test]
fn no_rate_takes_numbers_to_bounds_of_an_interior() {
    let (lower, upper) = (vec![0.0, -3.0, 1e9, 0.0], vec![1.0, 180.0, 1e9 + 1.0, 1e30]);
    let space = Space {
        geometry: Geometry::Interior,
        lower: Some(lower.clone()),
        upper: Some(upper.clone()),
        ..Space::plain()
    };
    for solver in RULES {
        for rate in [0.3, 1e4, 1e300] {
            let mut optimizer = Optimizer::new(solver, vec![space.clone()]);
            let mut values = vec![vec![0.5, 0.0, 1e9 + 0.5, 4.0]];
            for step in 0..60 {
                let pull = if step / 20 % 2 == 0 { 1e6 } else { -1e6 };
                optimizer.step(&mut values, &[vec![pull, -pull, pull, -pull]], rate, None).unwrap();
                for (k, x) in values[0].iter().enumerate() {
                    // For a renderer too, which has single precision. Nothing lies between a billion and its successor there.
                    let single = if k == 2 { *x } else { f64::from(*x as f32) };
                    assert!(lower[k] < single && single < upper[k], "{solver:?} at {rate}, step {step}: {values:?}");
                }
            }
        }
    }
    // It comes back from where it was.
    let mut values = vec![vec![0.5, 0.0, 1e9 + 0.5, 4.0]];
    for (goal, steps) in [(9.0, 100), (0.3, 800)] {
        let mut optimizer = Optimizer::new(Solver::adam(), vec![space.clone()]);
        for _ in 0..steps {
            let pull = values[0][0] - goal;
            optimizer.step(&mut values, &[vec![pull, 0.0, 0.0, 0.0]], 0.1, None).unwrap();
        }
        assert!(goal < 1.0 || (0.98..1.0).contains(&values[0][0]), "{values:?}");
    }
    assert!((values[0][0] - 0.3).abs() < 0.01, "{values:?}");
    assert_eq!(values[0][1..], [0.0, 1e9 + 0.5, 4.0]);
}

#[test]
fn steps_of_logarithms_know_no_unit() {
    for solver in RULES {
        // Of (log(x / unit) − 1)², whose minimum is e units. A unit that is a power of two leaves all bits but the exponent's.
        let path = |unit: f64| -> Vec<f64> {
            let space = Space { geometry: Geometry::Positive, ..Space::plain() };
            let (mut optimizer, mut values) = (Optimizer::new(solver, vec![space]), vec![vec![0.2 * unit]]);
            let walk = (0..30).map(|_| {
                let x = values[0][0];
                optimizer.step(&mut values, &[vec![2.0 * ((x / unit).ln() - 1.0) / x]], 0.05, None).unwrap();
                values[0][0] / unit
            });
            walk.collect()
        };
        let own = path(1.0);
        assert!((own[29] - 0.2) > 0.1, "{solver:?}: {own:?}");
        for unit in [1024.0, 1.0 / 65536.0] {
            assert_eq!(path(unit).map_bits(), own.map_bits(), "{solver:?} in units of {unit}");
        }
    }
    // A step is a factor, and no rate leads to 0.
    let space = Space { geometry: Geometry::Positive, ..Space::plain() };
    let mut value = [5.0, 5.0, 5.0];
    space.retract(&mut value, &[2.0_f64.ln(), -1e9, 1e9]);
    assert!((value[0] - 10.0).abs() < 1e-14 && value[1] as f32 > 0.0 && value[2].is_infinite(), "{value:?}");
}

#[test]
fn unit_vectors_are_found_and_stay_unit_vectors() {
    let goal = [[0.6, 0.0, 0.8], [0.0, -0.8, 0.6]].concat();
    for solver in RULES {
        let space = Space { geometry: Geometry::Unit, ..Space::plain() };
        let (mut optimizer, mut values) =
            (Optimizer::new(solver, vec![space]), vec![vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0]]);
        for step in 0..600 {
            let pull = values[0].iter().zip(&goal).map(|(x, goal)| 2.0 * (x - goal)).collect();
            let rate = if matches!(solver, Solver::Sgd { .. }) { 0.05 } else { 0.02 * (1.0 - f64::from(step) / 600.0) };
            optimizer.step(&mut values, &[pull], rate, None).unwrap();
            assert!(values[0].chunks_exact(3).all(|v| (dot(v, v) - 1.0).abs() < 1e-14));
        }
        assert!(values[0].iter().zip(&goal).all(|(x, goal)| (x - goal).abs() < 1e-2), "{solver:?}: {values:?}");
    }
    // Draws cover all directions alike: the mean of z² is a third.
    let space = Space { geometry: Geometry::Unit, ..Space::plain() };
    let drawn: Vec<Vec<f64>> = (0..3000).map(|seed| space.drawn(&[0.0, 0.0, 1.0], 7919 * seed)).collect();
    for k in 0..3 {
        let mean = drawn.iter().map(|v| v[k] * v[k]).sum::<f64>() / 3000.0;
        assert!((mean - 1.0 / 3.0).abs() < 0.03, "{k}: {mean}");
    }
}

/// Residuals of Rosenbrock's function, and their derivatives by element.
fn banana(x: &[f64]) -> (Vec<f64>, Vec<Vec<f64>>) {
    (vec![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]], vec![vec![-20.0 * x[0], -1.0], vec![10.0, 0.0]])
}

#[test]
fn solvers_of_second_order_go_through_every_map() {
    let between = |geometry, upper: f64| Space {
        geometry,
        lower: Some(vec![0.01]),
        upper: Some(vec![upper]),
        scale: 2.0,
        ..Space::plain()
    };
    for geometry in [Geometry::Plain, Geometry::Positive, Geometry::Interior] {
        for (upper, best) in [(4.0, [1.0, 1.0]), (0.5, [0.5, 0.25])] {
            let near = |x: &[f64], what: &str| {
                let is_inside = geometry != Geometry::Interior || x.iter().all(|x| 0.01 < *x && *x < upper);
                let off = (x[0] - best[0]).hypot(x[1] - best[1]);
                assert!(is_inside && off < 1e-3, "{what} of {geometry:?} up to {upper}: {x:?}");
            };
            let mut solver = LeastSquares::new(vec![between(geometry, upper)], 1e-3);
            let mut x = vec![vec![0.2, 0.4]];
            for _ in 0..60 {
                let (r, rows) = banana(&x[0]);
                let base = solver.base().map(|base| base.to_vec());
                let fell = base.is_none_or(|base| {
                    let old = banana(&base[0]).0;
                    solver.accepts([&old, &old], [&r, &r])
                });
                if fell {
                    solver.rebase(&x, [&r, &r], [rows.clone(), rows]).unwrap();
                }
                x = solver.propose(1.0).unwrap();
            }
            near(&solver.base().unwrap()[0], "least squares");
            let mut lbfgs = Lbfgs::new(vec![between(geometry, upper)], 10, 0.1);
            let mut x = vec![vec![0.2, 0.4]];
            for _ in 0..120 {
                let measure = |x: &[Vec<f64>]| {
                    let (r, rows) = banana(&x[0]);
                    let loss = r.iter().map(|r| r * r).sum::<f64>();
                    let grad = vec![rows.iter().map(|row| 2.0 * dot(row, &r)).collect::<Vec<f64>>()];
                    Ok::<_, ()>(Twice { losses: [loss; 2], grads: [grad.clone(), grad] })
                };
                x = lbfgs.step(&x, 1.0, measure, |()| true).unwrap().unwrap().values;
            }
            near(&x[0], "lbfgs");
        }
    }
}

#[test]
fn what_cannot_start_in_a_space_is_told() {
    for ((space, value), bad) in spaces().into_iter().zip([f64::NAN, -1.0, 0.0, 7.0, -1.0, 0.5]) {
        assert!(space.may_start(&value));
        let mut other = value;
        other[usize::from(bad == 7.0)] = bad;
        assert_eq!(space.may_start(&other), space.geometry == Geometry::Plain, "{space:?} {other:?}");
    }
}

#[test]
fn numbers_next_to_a_bound_are_those_of_single_precision() {
    for (lower, upper) in [(0.0, 1.0), (-1.0, 0.0), (0.1, 0.3), (1e9, 1e9 + 1e-3), (-5e-324, 1e-40)] {
        let (least, most) = inside(lower, upper);
        assert!(lower < least && least <= most && most < upper, "{lower}..{upper}: {least}..{most}");
    }
    let (least, most) = inside(0.1, 1.0);
    assert!((least as f32) > 0.1_f32 - f32::EPSILON && least > 0.1 && most as f32 == 1.0_f32.next_down());
    assert_eq!(inside(f64::NEG_INFINITY, f64::INFINITY), (f64::NEG_INFINITY, f64::INFINITY));
}

#[test]
fn what_lies_between_two_values_is_one_of_the_space() {
    let shares = [0.25, 1.0, 0.0];
    assert_eq!(Space::plain().between(&[0.0, 1.0, 3.0], &[4.0, 0.1, 7.0], &shares), [1.0, 0.1, 3.0]);
    // Neither overflows, nor moves what stays.
    let (low, high) = (f64::MIN, f64::MAX);
    assert_eq!(Space::plain().between(&[low, 0.1], &[high, 0.1], &[0.5, 0.3]), [0.0, 0.1]);
    let rotation = Space { geometry: Geometry::Rotation, ..Space::plain() };
    let (from, to) = (rotation_about([0.0, 1.0, 0.0], 0.0), rotation_about([0.0, 1.0, 0.0], 1.0));
    let half = rotation.between(&from, &to, &[0.5; 9]);
    for (x, wanted) in half.iter().zip(rotation_about([0.0, 1.0, 0.0], 0.5)) {
        assert!((x - wanted).abs() < 1e-12, "{half:?}");
    }
    let unit = Space { geometry: Geometry::Unit, ..Space::plain() };
    let half = unit.between(&[1.0, 0.0, 0.0], &[0.0, 1.0, 0.0], &[0.5; 3]);
    assert!((half[0] - half[1]).abs() < 1e-12 && (dot(&half, &half) - 1.0).abs() < 1e-12, "{half:?}");
}
