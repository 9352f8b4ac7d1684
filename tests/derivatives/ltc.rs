//! The table of transformed cosines is what its fit gives, and close to the lobe it stands for.

#[path = "../../benches/ltc/fit.rs"]
mod fit;

use crate::common::long;
use dscene::math::Pcg32;
use dscene::render::ltc::{Lobe, SIZE};
use dscene::render::ltc_table::TABLE;
use fit::Samples;
use glam::{Quat, Vec3};

/// In the long statistics only: the fit takes longer than all else that is asked of the table.
#[test]
fn the_table_is_what_the_fit_gives() {
    if !long() {
        return;
    }
    for (i, (ours, fitted)) in TABLE.iter().zip(fit::table()).enumerate() {
        for (a, b) in ours.iter().zip(fitted) {
            // Minima are flat: another machine's rounding moves them a little.
            assert!((a - b).abs() < 2e-3 * b.abs().max(1.0), "row {}, α {}: {a} {b}", i / SIZE, i % SIZE);
        }
    }
}

#[test]
fn fits_are_close_to_the_lobe_at_nodes_and_between() {
    // Below the table's least α of 0.002 as well.
    for i in 0..=75 {
        let alpha = 0.002f32.powf(i as f32 / 60.0);
        for (angle, most) in [(0.0f32, 0.025), (20.0, 0.035), (40.0, 0.045), (55.0, 0.075), (80.0, 0.19)] {
            let samples = Samples::new(angle.to_radians().cos(), alpha);
            let lobe = Lobe::new(alpha, Vec3::Z, samples.wi);
            let distance = samples.distance(&lobe);
            assert!(distance < most, "α {alpha}, {angle}°: {distance}");
            assert!((f64::from(lobe.albedo) - samples.albedo()).abs() < 0.03, "α {alpha}, {angle}°: {}", lobe.albedo);
        }
    }
}

#[test]
fn lobes_turn_with_their_surface_and_their_mirror_image() {
    let mut rng = Pcg32::new(3);
    let mut unit = || (Vec3::from_array(rng.next_3d()) * 2.0 - 1.0).normalize();
    for i in 0..100 {
        let alpha = [0.5, 0.1, 0.02][i % 3];
        let (wi, across, by) = (unit().with_z(0.5).normalize(), unit(), unit());
        let near_mirror = (Vec3::new(-wi.x, -wi.y, wi.z) + 2.0 * alpha * across).normalize();
        let turn = Quat::from_rotation_arc(Vec3::Z, by);
        let lobe = Lobe::new(alpha, Vec3::Z, wi);
        let turned = Lobe::new(alpha, turn * Vec3::Z, turn * wi);
        let reflect = |v: Vec3| v - by * (2.0 * by.dot(v));
        let expected = lobe.density(near_mirror);
        for density in [turned.density(turn * near_mirror), lobe.reflected(reflect).density(reflect(near_mirror))] {
            assert!((density - expected).abs() < 2e-3 * (expected + 0.01), "{alpha}: {density} {expected}");
        }
    }
}
