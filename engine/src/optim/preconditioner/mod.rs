//! A linear change of variables in which an optimisation of many numbers takes steps that hang together.
//!
//! The derivative of an image in a vertex or a texel says nothing about its neighbours: steps along it crumple meshes and fill textures with
//! noise. A preconditioner is a matrix M. The param is M u, the solver moves u: it is given Mᵀ g for the gradient g, and its update Δu
//! changes the param by M Δu. Bounds, rates and scales stay those of the param.

mod laplacian;
mod pyramid;

pub use laplacian::Laplacian;
pub use pyramid::Pyramid;

/// The matrix M of one param.
#[derive(Debug, PartialEq)]
pub enum Preconditioner {
    /// For meshes: smooth steps.
    Laplacian(Laplacian),
    /// For grids: steps of every size of detail.
    Pyramid(Pyramid),
}

impl Preconditioner {
    /// Number of variables u for a param of `len` numbers.
    pub fn variables(&self, len: usize) -> usize {
        match self {
            Preconditioner::Laplacian(_) => len,
            Preconditioner::Pyramid(pyramid) => pyramid.variables(),
        }
    }

    /// M Δu: how the param changes with the variables.
    pub fn change(&self, update: &[f64]) -> Vec<f64> {
        match self {
            Preconditioner::Laplacian(laplacian) => laplacian.apply(update),
            Preconditioner::Pyramid(pyramid) => pyramid.change(update),
        }
    }

    /// Mᵀ g: the gradient in the variables, for `gradient` in the param.
    pub fn gradient(&self, gradient: &[f64]) -> Vec<f64> {
        match self {
            Preconditioner::Laplacian(laplacian) => laplacian.apply(gradient),
            Preconditioner::Pyramid(pyramid) => pyramid.gradient(gradient),
        }
    }
}

#[cfg(test)]
mod tests {
    pub fn dot(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }

    /// Numbers without a pattern.
    pub fn numbers(count: usize) -> Vec<f64> {
        (0..count).map(|i| ((i * 7919 + 13) % 101) as f64 / 50.0 - 1.0).collect()
    }
}
