//! Nothing reflects more light than it receives.

use super::*;

/// What a white surface reflects from `wi`, by samples in strata of the unit square (and of the choice between lobes).
fn furnace(bsdf: &Bsdf, wi: Vec3, strata: usize) -> f64 {
    let mut rng = Pcg32::new(71);
    let mut energy = 0.0;
    for i in 0..strata * strata {
        let jitter = rng.next_3d();
        let u = [(i % strata) as f32 + jitter[0], (i / strata) as f32 + jitter[1]].map(|x| x / strata as f32);
        if let Some(s) = bsdf.sample(wi, [u[0], u[1], jitter[2]]) {
            energy += f64::from(bsdf.eval(Vec3::Z, wi, s.wo).x / s.pdf);
        }
    }
    energy / (strata * strata) as f64
}

/// From the mirror to the roughest, head on and at grazing angles: nothing gains energy but `phong`, as its docs say; narrow lobes
/// lose none.
#[test]
fn no_lobe_reflects_more_than_it_receives() {
    let white = Vec3::ONE;
    let mut most_of_phong = 0.0f64;
    for roughness in [0.0, 0.02, 0.05, 0.1, 0.3, 0.6, 1.0] {
        let r = Vec3::splat(roughness);
        let principled = |metallic: f32, specular: f32| {
            let (metallic, specular) = (Vec3::splat(metallic), Vec3::splat(specular));
            (MaterialKind::Principled { base_color: white, metallic, roughness: r, specular }, 1.0)
        };
        let cloth = |diffuse: Vec3| (MaterialKind::Cloth { diffuse, sheen: white, roughness: r }, 1.0);
        let plastic = |ior: f32| (MaterialKind::Plastic { diffuse: white, ior: Vec3::splat(ior), roughness: r }, 1.0);
        let pane =
            |ior: f32| (MaterialKind::ThinDielectric { ior: Vec3::splat(ior), tint: white, roughness: Some(r) }, 1.0);
        let lobes = [
            pane(1.0),
            pane(1.5),
            pane(3.0),
            cloth(white),
            plastic(1.0),
            plastic(1.1),
            plastic(1.5),
            plastic(3.0),
            (MaterialKind::Diffuse { reflectance: white }, 1.0),
            (MaterialKind::Conductor { reflectance: white, roughness: r }, 1.0),
            (MaterialKind::ConductorIor { eta: white, k: white * 100.0, roughness: r }, 1.0),
            (MaterialKind::Phong { diffuse: Vec3::ZERO, specular: white, roughness: r }, 1.3),
            principled(1.0, 0.5),
            principled(0.0, 0.0),
            principled(0.0, 0.1),
            principled(0.0, 0.5),
            principled(0.0, 1.0),
            principled(0.5, 0.5),
        ];
        for (values, limit) in lobes {
            let bsdf = Bsdf::new(&values);
            for cos in [1.0, 0.98, 0.7, 0.3, 0.2, 0.1, 0.05, 0.02] {
                let energy = furnace(&bsdf, direction(cos, 0.4), 128);
                assert!(energy < limit + 4e-3, "{bsdf:?} at {cos}: {energy}");
                // Single scattering loses energy between rough facets, but not most of it; without roughness there is no between.
                let least = if matches!(bsdf, Bsdf::Layer(Layer::Bare(Lobes::Phong(_)))) {
                    0.3
                } else if roughness <= 0.05 && cos >= 0.1 {
                    0.99
                } else {
                    0.3
                };
                assert!(energy > least, "{bsdf:?} at {cos}: {energy}");
                if matches!(bsdf, Bsdf::Layer(Layer::Bare(Lobes::Phong(_)))) {
                    most_of_phong = most_of_phong.max(energy);
                }
            }
        }
    }
    assert!(most_of_phong > 1.08, "{most_of_phong}");
}

/// As for the dielectric; and under white light that is even, white cloth cannot be seen but for what the table has too much.
#[test]
fn the_sheen_reflects_what_its_table_says() {
    for roughness in [0.0, 0.02, 0.12, 0.37, 0.61, 1.0] {
        let cloth = |diffuse: f32| {
            let (diffuse, sheen) = (Vec3::splat(diffuse), Vec3::ONE);
            Bsdf::new(&MaterialKind::Cloth { diffuse, sheen, roughness: Vec3::splat(roughness) })
        };
        for cos in [0.01, 0.05, 0.11, 0.27, 0.6, 1.0] {
            let lobe = furnace(&cloth(0.0), direction(cos, 0.4), 256);
            let table = f64::from(REFLECTED.directional(cos, roughness).value);
            let slack = if cos < 2.0 / 24.0 { 0.14 } else { 0.012 };
            assert!(lobe < table + 4e-3 && table < lobe + slack, "{roughness} at {cos}: {lobe} {table}");
            let white = furnace(&cloth(1.0), direction(cos, 0.4), 256);
            assert!(white < 1.004 && white > 0.99 - slack, "{roughness} at {cos}: {white}");
        }
    }
}

/// What a coat takes from the material under it is what it reflects, or a little more: white metal and white paint stay white, but for what the
/// facets of a rough coat lose and what goes to and fro under it.
#[test]
fn a_coat_takes_what_it_reflects() {
    let white = Vec3::ONE;
    for (under, least) in [
        (MaterialKind::Conductor { reflectance: white, roughness: Vec3::ZERO }, 0.97),
        (MaterialKind::Conductor { reflectance: white, roughness: Vec3::splat(0.4) }, 0.92),
        (MaterialKind::Diffuse { reflectance: white }, 0.93),
    ] {
        for roughness in [0.0, 0.05, 0.2, 0.45, 1.0] {
            for weight in [0.0, 0.5, 1.0] {
                let coat = ClearCoat { weight: Vec3::splat(weight), roughness: Vec3::splat(roughness) };
                let bsdf = Bsdf::new(&under).coated(&coat);
                let bare = Bsdf::new(&under);
                for cos in [1.0, 0.7, 0.3, 0.1, 0.02] {
                    let wi = direction(cos, 0.4);
                    let energy = furnace(&bsdf, wi, 160);
                    assert!(energy < 1.004, "{bsdf:?} at {cos}: {energy}");
                    assert!(energy > least || cos < 0.5 || roughness > 0.3, "{bsdf:?} at {cos}: {energy}");
                    if weight == 0.0 {
                        assert!((energy - furnace(&bare, wi, 160)).abs() < 0.01, "{bsdf:?} at {cos}: {energy}");
                    }
                }
            }
        }
    }
}

/// What a sheen takes from the material under it is what it reflects, or a little more: white metal and white paint stay white, but for what goes
/// to and fro under it, and never gain light.
#[test]
fn a_sheen_takes_what_it_reflects() {
    let white = Vec3::ONE;
    let metal = |r: f32| (MaterialKind::Conductor { reflectance: white, roughness: Vec3::splat(r) }, Some(r));
    let paint = (MaterialKind::Diffuse { reflectance: white }, None);
    for (kind, metal_roughness) in [metal(0.0), metal(0.4), metal(1.0), paint] {
        for roughness in [0.0, 0.05, 0.2, 0.45, 0.7, 1.0] {
            for color in [0.0, 0.5, 1.0] {
                let sheen = SheenLayer { color: Vec3::splat(color), roughness: Vec3::splat(roughness) };
                let bare = Bsdf::new(&kind);
                let bsdf = bare.sheened(&sheen);
                for cos in [1.0, 0.7, 0.3, 0.1, 0.02] {
                    let wi = direction(cos, 0.4);
                    let (energy, alone) = (furnace(&bsdf, wi, 160), furnace(&bare, wi, 160));
                    assert!(energy < 1.004, "{bsdf:?} at {cos}: {energy}");
                    // Polished metal reflects at one angle: nothing is lost but what the table has too much.
                    let least = if metal_roughness == Some(0.0) { 0.97 } else { 0.7 };
                    assert!(energy > least * alone || cos < 0.1, "{bsdf:?} at {cos}: {energy} of {alone}");
                    assert!(color > 0.0 || (energy - alone).abs() < 0.01, "{bsdf:?} at {cos}: {energy} of {alone}");
                    let coat = ClearCoat { weight: white, roughness: Vec3::splat(roughness) };
                    let coated = furnace(&bsdf.coated(&coat), wi, 64);
                    assert!(coated < 1.01, "{bsdf:?} under a coat at {cos}: {coated}");
                }
            }
        }
    }
}

/// The table of what the dielectric reflects never has less than its lobe, so that no energy is gained, and little more.
#[test]
fn the_dielectric_reflects_what_its_table_says() {
    for roughness in [0.0, 0.02, 0.04, 0.08, 0.12, 0.22, 0.37, 0.5, 0.61, 0.83, 0.99] {
        // Without F0 what is left of Schlick's term is (1 − wi·h)⁵.
        let bsdf = Bsdf::new(&MaterialKind::Conductor { reflectance: Vec3::ZERO, roughness: Vec3::splat(roughness) });
        for cos in [0.01, 0.02, 0.05, 0.11, 0.19, 0.27, 0.4, 0.6, 0.8, 1.0] {
            let (lobe, table) =
                (furnace(&bsdf, direction(cos, 0.4), 128), f64::from(SCHLICK.directional(cos, roughness).value));
            let slack = if cos < 1.0 / 24.0 { 0.15 } else { 0.025 };
            assert!(lobe < table + 4e-3 && table < lobe + slack, "{roughness} at {cos}: {lobe} {table}");
        }
        let steps = 4000;
        let mean: f32 = (0..steps)
            .map(|i| (i as f32 + 0.5) / steps as f32)
            .map(|c| 2.0 * c * SCHLICK.directional(c, roughness).value)
            .sum();
        assert!((mean / steps as f32 - SCHLICK.mean(roughness).value).abs() < 1e-4);
    }
}
