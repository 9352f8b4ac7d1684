//! Converts an optimiser of the language (`adam(lr: 0.01)`) to a solver and its rate.

use glam::DVec3;

use crate::memory;
use crate::mesh::ops;
use crate::natives::distribution_of;
use crate::natives::value::{SettingsKind, SettingsValue, Value};
use crate::optim::{Laplacian, Preconditioner, Prior, Pyramid, Rule, Solver};
use crate::tape::Tensor;

/// The default rate.
pub const DEFAULT_RATE: f64 = 0.01;

/// The kind of solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// First-order: steps against the gradient.
    FirstOrder(Solver),
    /// L-BFGS with this memory, whose first step has the length `first`.
    QuasiNewton { memory: usize, first: f64 },
    /// Least squares, from the derivatives of the residuals: Levenberg-Marquardt, or Gauss-Newton if not `careful`.
    LeastSquares { damping: f64, careful: bool },
}

/// The method that a value describes, and its learning rate; an error says what is wrong with it.
pub fn solver_from(value: &Value) -> Result<(Method, f64), String> {
    let found = |what: &str| format!("`using` needs an optimizer such as `adam(lr: 0.01)`, this is {what}");
    let Value::Settings(settings) = value else { return Err(found(value.kind())) };
    let SettingsKind::Optimizer(rule) = settings.kind else { return Err(found(value.kind())) };
    let number = |name: &str, default: f64| settings.number(name).unwrap_or(default);
    let fraction = |name: &str, default: f64| {
        let x = number(name, default);
        if (0.0..1.0).contains(&x) { Ok(x) } else { Err(format!("`{name}` must be at least 0 and below 1, it is {x}")) }
    };
    let positive = |name: &str, default: f64| {
        let x = number(name, default);
        if x > 0.0 { Ok(x) } else { Err(format!("`{name}` must be positive, it is {x}")) }
    };
    let lr = number("lr", DEFAULT_RATE);
    if lr < 0.0 {
        return Err(format!("the rate `lr` must not be negative, it is {lr}"));
    }
    let solver = match rule {
        Rule::LevenbergMarquardt | Rule::GaussNewton => {
            let careful = rule == Rule::LevenbergMarquardt;
            let damping = if careful { positive("damping", 0.1)? } else { 0.0 };
            return Ok((Method::LeastSquares { damping, careful }, number("lr", 1.0)));
        }
        Rule::Lbfgs => {
            let memory = number("memory", 10.0);
            if !(1.0..=1e3).contains(&memory) || memory.fract() != 0.0 {
                return Err(format!("`memory` must be a whole number from 1 to 1000, it is {memory}"));
            }
            let method = Method::QuasiNewton { memory: memory as usize, first: positive("first", 0.01)? };
            return Ok((method, number("lr", 1.0)));
        }
        Rule::Sgd => Solver::Sgd {
            momentum: fraction("momentum", 0.0)?,
            nesterov: settings.boolean("nesterov").unwrap_or(false),
        },
        Rule::Adam => Solver::Adam {
            beta1: fraction("beta1", 0.9)?,
            beta2: fraction("beta2", 0.999)?,
            epsilon: positive("epsilon", 1e-8)?,
        },
        Rule::AdamUniform => Solver::AdamUniform {
            beta1: fraction("beta1", 0.9)?,
            beta2: fraction("beta2", 0.999)?,
            epsilon: positive("epsilon", 1e-8)?,
        },
        Rule::RmsProp => Solver::RmsProp {
            decay: fraction("decay", 0.99)?,
            epsilon: positive("epsilon", 1e-8)?,
            momentum: fraction("momentum", 0.0)?,
        },
    };
    Ok((Method::FirstOrder(solver), lr))
}

/// The distribution that a value describes, for each number of a param of this shape; an error says why there is none.
pub fn prior_from(value: &Value, shape: &[usize]) -> Result<Prior, String> {
    let Some((law, numbers)) = distribution_of(value) else { return Err(format!("this is {}", value.kind())) };
    let [first, second] = numbers.map(|x| x.broadcast_to(shape).map(|x| x.value().data.clone()));
    match (first, second) {
        (Ok(first), Ok(second)) => Ok(Prior { law, numbers: [first, second] }),
        _ => Err(format!("its numbers do not fit a {}", Tensor::shape_text(shape))),
    }
}

/// The preconditioner that a value describes for a param of this shape; an error says why there is none.
pub fn preconditioner_from(value: &Value, shape: &[usize]) -> Result<Preconditioner, String> {
    match value {
        Value::Settings(settings) if settings.kind == SettingsKind::Laplacian => {
            laplacian(settings, shape).map(Preconditioner::Laplacian)
        }
        Value::Settings(settings) if settings.kind == SettingsKind::Pyramid => {
            let numbers = shape.iter().product::<usize>();
            memory::ask(40 * numbers as u64).map_err(|e| e.to_string())?;
            let levels = settings.number("levels").map(|n| n as usize);
            let pyramid = Pyramid::new(shape, levels).ok_or_else(|| {
                let sides: Vec<String> = shape.iter().map(usize::to_string).collect();
                format!("a param of {} numbers is no grid", sides.join("×"))
            })?;
            Ok(Preconditioner::Pyramid(pyramid))
        }
        _ => Err(format!("this is {}", value.kind())),
    }
}

fn laplacian(settings: &SettingsValue, shape: &[usize]) -> Result<Laplacian, String> {
    let Some(Value::Mesh(mesh)) = settings.field("mesh") else {
        return Err("it needs a mesh".into());
    };
    let points: Vec<DVec3> = mesh.vertices.value().data.chunks_exact(3).map(DVec3::from_slice).collect();
    let numbers: usize = shape.iter().product();
    if shape.first() != Some(&points.len()) && numbers != points.len() {
        let rows = shape.first().copied().unwrap_or(0);
        let s = if rows == 1 { "" } else { "s" };
        return Err(format!("the param has {rows} row{s}, the mesh {} vertices", points.len()));
    }
    // Positions and edges in tables while they are counted, then for each vertex its neighbours.
    memory::ask(300 * points.len() as u64 + 200 * mesh.faces.len() as u64).map_err(|e| e.to_string())?;
    let (place, places) = ops::weld(&points);
    let edges: Vec<[u32; 2]> = ops::edges(&place, &mesh.faces).into_iter().map(|(ends, _)| ends).collect();
    Ok(Laplacian::new(place, places, &edges, settings.number("lambda").unwrap_or(19.0)))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    const ADAM: SettingsKind = SettingsKind::Optimizer(Rule::Adam);

    fn settings(kind: SettingsKind, fields: &[(&str, f64)]) -> Value {
        let fields = fields.iter().map(|(n, x)| ((*n).to_owned(), Value::scalar(*x))).collect();
        Value::Settings(Arc::new(SettingsValue { kind, fields }))
    }

    #[test]
    fn settings_become_solvers() {
        let (solver, lr) = solver_from(&settings(ADAM, &[("lr", 0.5), ("beta1", 0.8)])).unwrap();
        assert_eq!(solver, Method::FirstOrder(Solver::Adam { beta1: 0.8, beta2: 0.999, epsilon: 1e-8 }));
        assert_eq!(lr, 0.5);
        let damped =
            solver_from(&settings(SettingsKind::Optimizer(Rule::LevenbergMarquardt), &[("damping", 0.5)])).unwrap();
        assert_eq!(damped, (Method::LeastSquares { damping: 0.5, careful: true }, 1.0));
        assert_eq!(solver_from(&settings(SettingsKind::Optimizer(Rule::Sgd), &[])).unwrap().1, DEFAULT_RATE);
    }

    #[test]
    fn nonsense_is_refused() {
        for (kind, field, x) in [
            (ADAM, "beta1", 1.0),
            (SettingsKind::Optimizer(Rule::Sgd), "momentum", -0.1),
            (SettingsKind::Optimizer(Rule::Lbfgs), "memory", 2.5),
            (SettingsKind::Optimizer(Rule::Lbfgs), "first", 0.0),
            (SettingsKind::Optimizer(Rule::Sgd), "lr", -1.0),
            (SettingsKind::Optimizer(Rule::LevenbergMarquardt), "damping", 0.0),
            (SettingsKind::Integrator, "a", 1.0),
        ] {
            assert!(solver_from(&settings(kind, &[(field, x)])).is_err(), "{kind:?} {field}");
        }
        assert!(solver_from(&Value::scalar(1.0)).is_err());
    }
}
