use glam::{Vec2, Vec3};

/// The angles between two directions and a normal on which an isotropic lobe depends.
///
/// A narrow lobe depends on the sine of the angle between normal and half vector, which is as small as α. Computed from the three cosines
/// between the directions, this sine would be the root of a difference of numbers near one, with an error of 3e-4 in single precision,
/// and far more where the directions are nearly opposite. So it is computed from the half vector, as the length of its component
/// perpendicular to the normal.
#[derive(Clone, Copy, Debug)]
pub struct Angles {
    /// |n·wi|: where n·wi < 0, `wi` is mirrored at the tangent plane.
    pub ci: f32,
    /// n·wo; of light that is refracted to the other side −n·wo.
    pub co: f32,
    /// wi·h with the half vector h. Of a reflection it equals |wi + wo| / 2.
    pub half: f32,
    /// sin² of the angle between n and h.
    pub sin2: f32,
    /// The unit half vector.
    h: Vec3,
    /// The half vector's component perpendicular to the normal.
    across: Vec3,
    /// n·wi before mirroring.
    signed_ci: f32,
    /// `wi` after mirroring, and `wo`.
    front: Vec3,
    wo: Vec3,
}

/// Derivatives of a scalar in [`Angles`].
#[derive(Clone, Copy, Debug, Default)]
pub struct AnglesAdjoint {
    pub ci: f32,
    pub co: f32,
    pub half: f32,
    pub sin2: f32,
}

/// Derivatives in the normal and both directions, with the three coordinates of each taken as independent. Only the components
/// perpendicular to each unit vector are meaningful.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DirectionsAdjoint {
    pub(crate) n: Vec3,
    pub(crate) wi: Vec3,
    pub(crate) wo: Vec3,
}

impl std::ops::Add for AnglesAdjoint {
    type Output = AnglesAdjoint;

    fn add(self, other: AnglesAdjoint) -> AnglesAdjoint {
        let (ci, co) = (self.ci + other.ci, self.co + other.co);
        AnglesAdjoint { ci, co, half: self.half + other.half, sin2: self.sin2 + other.sin2 }
    }
}

impl DirectionsAdjoint {
    pub(crate) fn add(&mut self, other: &DirectionsAdjoint) {
        self.n += other.n;
        self.wi += other.wi;
        self.wo += other.wo;
    }
}

impl Angles {
    #[inline]
    pub fn new(n: Vec3, wi: Vec3, wo: Vec3) -> Angles {
        let signed_ci = n.dot(wi);
        let front = if signed_ci < 0.0 { wi - n * (2.0 * signed_ci) } else { wi };
        let sum = front + wo;
        let length = sum.length().max(1e-6);
        let h = sum / length;
        let across = h - n * n.dot(h);
        let sin2 = across.length_squared().min(1.0);
        let half = (0.5 * length).min(1.0);
        Angles { ci: signed_ci.abs(), co: n.dot(wo), half, sin2, h, across, signed_ci, front, wo }
    }

    /// The same for the normal +z and a direction `wo` that was made by mirroring `wi`, which is in front, at the unit half vector `h`.
    #[inline]
    pub fn mirrored(wi: Vec3, h: Vec3, wo: Vec3) -> Angles {
        let across = h.with_z(0.0);
        let half = wi.dot(h).clamp(5e-7, 1.0);
        let sin2 = across.length_squared().min(1.0);
        Angles { ci: wi.z, co: wo.z, half, sin2, h, across, signed_ci: wi.z, front: wi, wo }
    }

    /// The same of light that is refracted to `wo`, below the surface, by the index `eta` of that side over that of `wi`: the half vector is the
    /// normal of the facet that does so, ±(wi + η wo) made of unit length, on the side of `n`.
    #[inline]
    pub fn refracted(n: Vec3, wi: Vec3, wo: Vec3, eta: f32) -> Angles {
        let signed_ci = n.dot(wi);
        let front = if signed_ci < 0.0 { wi - n * (2.0 * signed_ci) } else { wi };
        let h = ((front + wo * eta) * (1.0 - eta).signum()).normalize_or_zero();
        Angles { signed_ci, ..Angles::by_facet(n, front, wo, h) }
    }

    /// The same where the normal `h` of the facet is known, and `wi` is in front.
    #[inline]
    pub fn by_facet(n: Vec3, wi: Vec3, wo: Vec3, h: Vec3) -> Angles {
        let across = h - n * n.dot(h);
        let ci = n.dot(wi);
        let sin2 = across.length_squared().min(1.0);
        Angles { ci, co: -n.dot(wo), half: wi.dot(h).min(1.0), sin2, h, across, signed_ci: ci, front: wi, wo }
    }

    /// The unit half vector.
    pub fn facet(&self) -> Vec3 {
        self.h
    }

    /// The coordinates along two axes of `wi`, mirrored to the front, of `wo` and of the unit half vector.
    #[inline]
    pub fn along(&self, axes: [Vec3; 2]) -> [Vec2; 3] {
        [self.front, self.wo, self.h].map(|v| Vec2::from(axes.map(|axis| axis.dot(v))))
    }

    /// Adjoint of [`Angles::refracted`] and of −wo·h, of which `d_y` is the adjoint; also returns that of `eta`.
    pub fn d_refracted(
        &self,
        [n, wi, wo]: [Vec3; 3],
        eta: f32,
        d: &AnglesAdjoint,
        d_y: f32,
    ) -> (DirectionsAdjoint, f32) {
        let front = if self.signed_ci < 0.0 { wi - n * (2.0 * self.signed_ci) } else { wi };
        let d_across = self.across * (2.0 * d.sin2);
        let d_h = d_across + front * d.half - wo * d_y;
        // h = ±sum / |sum| with sum = wi + η wo
        let sum = front + wo * eta;
        let d_sum = (d_h - self.h * self.h.dot(d_h)) * ((1.0 - eta).signum() / sum.length().max(1e-6));
        let mut out = DirectionsAdjoint {
            n: front * d.ci - wo * d.co - d_across * n.dot(self.h),
            wi: n * d.ci + self.h * d.half + d_sum,
            wo: d_sum * eta - n * d.co - self.h * d_y,
        };
        self.unmirror(n, wi, &mut out);
        (out, wo.dot(d_sum))
    }

    /// Passes the adjoint of `wi` mirrored to the front on to `wi` and the normal.
    fn unmirror(&self, n: Vec3, wi: Vec3, d: &mut DirectionsAdjoint) {
        if self.signed_ci < 0.0 {
            let along = n.dot(d.wi);
            d.n -= (d.wi * self.signed_ci + wi * along) * 2.0;
            d.wi -= n * (2.0 * along);
        }
    }

    /// Adjoint of [`Angles::new`].
    pub fn adjoint(&self, n: Vec3, wi: Vec3, d: &AnglesAdjoint) -> DirectionsAdjoint {
        // sin² = |across|² with across = h − n (n·h).
        let d_across = self.across * (2.0 * d.sin2);
        let mut out = self.of_half_vector(n, d, d_across);
        out.n -= d_across * n.dot(self.h);
        self.unmirror(n, wi, &mut out);
        out
    }

    /// Adjoint of [`Angles::new`] and of [`Angles::along`] two axes that are perpendicular to the normal: `along` has the derivatives in these
    /// coordinates. The axes turn with the normal, by the smallest rotation. Also returns the derivative in their turn about it, from the first
    /// to the second.
    pub fn d_along(
        &self,
        [n, wi]: [Vec3; 2],
        axes: [Vec3; 2],
        d: &AnglesAdjoint,
        along: [Vec2; 3],
    ) -> (DirectionsAdjoint, f32) {
        let vector = |d: Vec2| axes[0] * d.x + axes[1] * d.y;
        let [d_front, d_wo, d_h] = along.map(vector);
        let mut out = self.of_half_vector(n, d, d_h);
        out.wi += d_front;
        out.wo += d_wo;
        // The adjoints of the axes: the normal's side of them turns the normal, the rest turns them about it.
        let seen = [self.front, self.wo, self.h];
        let d_axes = [0, 1].map(|k| (0..3).map(|i| seen[i] * along[i][k]).sum::<Vec3>());
        out.n -= vector(Vec2::from(d_axes.map(|d| n.dot(d))));
        self.unmirror(n, wi, &mut out);
        (out, d_axes[0].dot(axes[1]) - d_axes[1].dot(axes[0]))
    }

    /// The adjoint of both cosines, of the half vector and of its cosine; that of `wi` is of what was mirrored to the front.
    #[inline]
    fn of_half_vector(&self, n: Vec3, d: &AnglesAdjoint, d_h: Vec3) -> DirectionsAdjoint {
        // h = sum / |sum|
        let inv_length = 0.5 / self.half.max(5e-7);
        let d_sum = self.h * (0.5 * d.half) + (d_h - self.h * self.h.dot(d_h)) * inv_length;
        DirectionsAdjoint { n: self.front * d.ci + self.wo * d.co, wi: n * d.ci + d_sum, wo: n * d.co + d_sum }
    }
}
