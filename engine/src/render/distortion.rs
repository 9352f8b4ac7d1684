//! Lens distortion: the map from the film position of an ideal pinhole image to that in the image of a real lens.

use glam::Vec2;

/// Brown's model of radial and tangential distortion (Brown 1966, "Decentering distortion of lenses"), with OpenCV's coefficients in its
/// order k1, k2, p1, p2, k3. (In OpenCV y points down, here up.) An undistorted film position q, in units of the focal length, is moved
/// to q (1 + k1 r² + k2 r⁴ + k3 r⁶) with r = |q|; p1 and p2 add the tangential part. For a fisheye |q| is the angle from the axis in
/// radians: without p1 and p2 this is the model of Kannala and Brandt 2006.
///
/// "Folded" is the part of an image beyond the radius at which the polynomial stops growing with r: it shows points again, mirrored,
/// that no ray through those film positions reaches.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distortion {
    /// k1, k2, p1, p2 and k3, in this order.
    pub coefficients: [f32; 5],
}

impl Distortion {
    pub(crate) const NONE: Distortion = Distortion { coefficients: [0.0; 5] };

    #[inline(always)]
    pub(crate) fn is_none(&self) -> bool {
        self.coefficients == [0.0; 5]
    }

    /// The distorted position of an undistorted one.
    pub fn apply(&self, q: Vec2) -> Vec2 {
        let [k1, k2, p1, p2, k3] = self.coefficients;
        let r2 = q.length_squared();
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        q * radial + Vec2::new(p2, -p1) * r2 + q * (2.0 * Vec2::new(p2, -p1).dot(q))
    }

    /// The Jacobian of [`Distortion::apply`]: ∂x/∂x, ∂x/∂y = ∂y/∂x and ∂y/∂y. It is symmetric because the map is the gradient of a scalar.
    pub fn jacobian(&self, q: Vec2) -> [f32; 3] {
        let [k1, k2, p1, p2, k3] = self.coefficients;
        let r2 = q.length_squared();
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let bend = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3));
        let aside = Vec2::new(p2, -p1);
        let even = radial + 2.0 * aside.dot(q);
        [
            even + bend * q.x * q.x + 4.0 * aside.x * q.x,
            bend * q.x * q.y + 2.0 * (aside.x * q.y + aside.y * q.x),
            even + bend * q.y * q.y + 4.0 * aside.y * q.y,
        ]
    }

    /// Derivatives of [`Distortion::apply`] in the coefficients.
    pub fn coefficient_derivatives(&self, q: Vec2) -> [Vec2; 5] {
        let r2 = q.length_squared();
        let aside = |unit: Vec2| unit * r2 + q * (2.0 * unit.dot(q));
        [q * r2, q * (r2 * r2), aside(Vec2::NEG_Y), aside(Vec2::X), q * (r2 * r2 * r2)]
    }

    /// The undistorted position of a distorted one, by Newton's method. NaN where the image is folded.
    pub fn invert(&self, seen: Vec2) -> Vec2 {
        const STEPS: usize = 64;
        let mut q = seen;
        // Start inside the radius at which the image folds, and never step beyond it.
        while !self.preserves_orientation(q) {
            q *= 0.5;
            if q == Vec2::ZERO || q.is_nan() {
                return Vec2::NAN;
            }
        }
        for _ in 0..STEPS {
            let whole = self.solve_jacobian(q, self.apply(q) - seen);
            let mut step = whole;
            while !self.preserves_orientation(q - step) && step.length_squared() > 1e-12 * whole.length_squared() {
                step *= 0.5;
            }
            q -= step;
            // The relative step is below 1e-6. Newton's method converges quadratically, so the remaining error is about its square.
            if whole.length_squared() <= 1e-12 * q.length_squared() {
                return q;
            }
        }
        Vec2::NAN
    }

    /// Whether the Jacobian at `q` is positive definite, so that the image is not folded there.
    fn preserves_orientation(&self, q: Vec2) -> bool {
        let [a, b, c] = self.jacobian(q);
        a * c > b * b && a > 0.0
    }

    /// The inverse of the Jacobian at `q` times `v`: a step of Newton's method, and also the adjoint of [`Distortion::invert`], because the
    /// Jacobian is symmetric.
    pub fn solve_jacobian(&self, q: Vec2, v: Vec2) -> Vec2 {
        let [a, b, c] = self.jacobian(q);
        Vec2::new(c * v.x - b * v.y, a * v.y - b * v.x) / (a * c - b * b)
    }

    /// Whether a camera sees the undistorted position `q`: inverting its distorted position gives `q` again. It does not where the image
    /// is folded.
    pub fn is_visible(&self, q: Vec2) -> bool {
        self.invert(self.apply(q)).distance_squared(q) < 1e-6 * q.length_squared() + 1e-12
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Pcg32;

    const LENSES: [[f32; 5]; 5] = [
        [-0.2, 0.0, 0.0, 0.0, 0.0],
        [0.3, 0.0, 0.0, 0.0, 0.0],
        [-0.28, 0.07, 0.0, 0.0, -0.01],
        [0.0, 0.0, 0.02, -0.03, 0.0],
        [-0.25, 0.06, 0.01, 0.02, 0.01],
    ];

    #[test]
    fn undone_is_as_before() {
        let mut rng = Pcg32::new(3);
        for coefficients in LENSES {
            let lens = Distortion { coefficients };
            for _ in 0..2000 {
                let q = Vec2::new(rng.next_f32() * 2.0 - 1.0, rng.next_f32() * 2.0 - 1.0) * 0.8;
                assert!(lens.invert(lens.apply(q)).distance(q) < 1e-5, "{coefficients:?} at {q}");
                assert!(lens.is_visible(q));
            }
        }
    }

    #[test]
    fn folded_images_are_not_seen() {
        let lens = Distortion { coefficients: LENSES[0] };
        // r (1 − r² / 5) is largest at √(5/3) = 1.291.
        for (r, seen) in [(1.0, true), (1.25, true), (1.35, false), (1.6, false), (2.5, false)] {
            assert_eq!(lens.is_visible(Vec2::new(0.6, 0.8) * r), seen, "{r}");
        }
        assert!(lens.invert(Vec2::new(0.9, 0.0)).is_nan());
        // These images fold only beyond the radii tried here. But for the first polynomial the start value of Newton's method, the
        // distorted position, may lie in the folded part; the second one is steep.
        for (coefficients, widest) in [([0.588, -0.275, 0.0, 0.0, -0.061], 0.92), ([0.0, 0.0, 0.0, 0.0, 1.0], 2.4)] {
            let lens = Distortion { coefficients };
            for i in 0..=64 {
                let q = Vec2::new(0.6, -0.8) * (widest * i as f32 / 64.0);
                assert!(lens.invert(lens.apply(q)).distance(q) <= 1e-5 * (1.0 + q.length()), "{coefficients:?} at {q}");
            }
        }
    }

    /// One coefficient after the other against the formulas of the OpenCV manual, y down.
    #[test]
    fn opencv_means_the_same() {
        let (x, y) = (0.3f32, -0.4f32);
        let r2 = x * x + y * y;
        let expected = [
            (x * r2, y * r2),
            (x * r2 * r2, y * r2 * r2),
            (2.0 * x * y, r2 + 2.0 * y * y),
            (r2 + 2.0 * x * x, 2.0 * x * y),
            (x * r2.powi(3), y * r2.powi(3)),
        ];
        for (i, (dx, dy)) in expected.into_iter().enumerate() {
            let mut lens = Distortion::NONE;
            lens.coefficients[i] = 0.1;
            let seen = lens.apply(Vec2::new(x, -y));
            assert!(seen.distance(Vec2::new(x + 0.1 * dx, -(y + 0.1 * dy))) < 1e-6, "{i}: {seen}");
        }
    }

    #[test]
    fn derivatives_are_differences() {
        let q = Vec2::new(0.5, -0.3);
        for coefficients in LENSES {
            let lens = Distortion { coefficients };
            let h = 1e-2;
            let along = |d: Vec2| (lens.apply(q + d * h) - lens.apply(q - d * h)) / (2.0 * h);
            let [a, b, c] = lens.jacobian(q);
            assert!(along(Vec2::X).distance(Vec2::new(a, b)) < 1e-3);
            assert!(along(Vec2::Y).distance(Vec2::new(b, c)) < 1e-3);
            for (i, by) in lens.coefficient_derivatives(q).into_iter().enumerate() {
                let (mut up, mut down) = (lens, lens);
                up.coefficients[i] += h;
                down.coefficients[i] -= h;
                assert!(((up.apply(q) - down.apply(q)) / (2.0 * h)).distance(by) < 1e-3, "{i}");
            }
        }
    }
}
