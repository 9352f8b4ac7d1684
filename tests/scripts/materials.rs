//! Materials through text: what their numbers do, and what derivatives they lack.

use dscene::diag::Diagnostic;
use dscene::eval::brief;

use super::language::{engine, eval, expr, numbers};

/// A coat's numbers can be read, replaced and differentiated, beside those of what is under it.
#[test]
fn coats_lie_over_materials() {
    let mut e = engine(
        "camera eye { position: [0, 0, 5], look_at: [0, 0, 0], fov: 20deg, film: [4, 4] }
param cover = 0.5
material paint = coated(diffuse(reflectance: 0), coat: cover, coat_roughness: 0.4)
shape plate { mesh: rectangle(width: 9, depth: 9) |> rotate(x: 90deg), material: paint }
light sky = constant(1)
let seen = mean(render(eye, spp: 4096, max_bounces: 1))",
    );
    let whole = numbers(&mut e, "seen with { cover: 1 }")[0];
    // A black plate shows its coat alone, which reflects 4 % head on, less what is lost between facets.
    assert!((0.036..0.0405).contains(&whole), "{whole}");
    for (text, expected, allowed) in [
        ("seen", 0.5 * whole, 0.001),
        ("seen with { paint.coat: 0 }", 0.0, 0.0),
        ("grad(seen, cover)", whole, 0.002),
        ("paint.coat_roughness", 0.4, 1e-9),
        ("paint.reflectance", 0.0, 0.0),
    ] {
        let found = numbers(&mut e, text)[0];
        assert!((found - expected).abs() <= allowed, "{text} is {found}, not {expected}");
    }
    let x = expr(&e, "paint");
    let shown = brief(&eval(&mut e, "paint"), &x.ty);
    assert_eq!(shown, "coated(diffuse(reflectance: 0), coat: 0.5, coat_roughness: 0.4)");
}

/// A sheen's numbers can be read, replaced and differentiated, beside those of what is under it and of the coat above.
#[test]
fn sheens_lie_over_materials() {
    let mut e = engine(
        "camera eye { position: [0, 0, 5], look_at: [0, 0, 0], fov: 20deg, film: [4, 4] }
param tone = 0.5
material dusty = sheened(conductor(reflectance: 0.8, roughness: 0.4), sheen: tone, sheen_roughness: 0.625)
shape plate { mesh: rectangle(width: 9, depth: 9) |> rotate(x: 30deg), material: dusty }
light sky = constant(1)
let seen = mean(render(eye, spp: 4096, max_bounces: 1))
let bare = seen with { plate.material: conductor(reflectance: 0.8, roughness: 0.4) }
let cloth_alone = seen with { plate.material: cloth(diffuse: 0, sheen: tone, roughness: 0.625) }
let rougher = seen with { dusty.sheen_roughness: 0.645 }
let finer = seen with { dusty.sheen_roughness: 0.605 }
let by_differences = (rougher - finer) / 0.04",
    );
    let [bare, cloth] = ["bare", "cloth_alone"].map(|text| numbers(&mut e, text)[0]);
    // In even light what is seen is linear in the colour of the sheen.
    let [without, half, all] =
        ["seen with { tone: 0 }", "seen", "seen with { tone: 1 }"].map(|text| numbers(&mut e, text)[0]);
    for (text, expected, allowed) in [
        ("seen with { tone: 0 }", bare, 0.001),
        ("seen", 0.5 * (without + all), 0.001),
        ("grad(seen, tone)", all - without, 0.001),
        ("by_differences - grad(seen, dusty.sheen_roughness)", 0.0, 0.002),
        ("seen with { plate.material: coated(dusty, coat: 0) }", half, 0.001),
        ("dusty.sheen", 0.5, 0.0),
        ("dusty.sheen_roughness", 0.625, 1e-9),
        ("dusty.roughness", 0.4, 1e-9),
    ] {
        let found = numbers(&mut e, text)[0];
        assert!((found - expected).abs() <= allowed, "{text} is {found}, not {expected}");
    }
    assert!(cloth > 0.03 && half > bare.min(all) && half < bare.max(all), "{cloth} {bare} {half} {all}");
    let x = expr(&e, "dusty");
    let shown = brief(&eval(&mut e, "dusty"), &x.ty);
    assert_eq!(shown, "sheened(conductor(reflectance: 0.8, roughness: 0.4), sheen: 0.5, sheen_roughness: 0.625)");
}

/// A leaf lets its share of the light through, by which it can be differentiated, and reflects the rest.
#[test]
fn blends_with_panes_let_their_share_through() {
    let mut e = engine(
        "camera eye { position: [0, 0, 5], look_at: [0, 0, 0], fov: 20deg, film: [4, 4] }
param share = 0.3
param tone: color = [0.8, 0.5, 0.2]
material leaf = blend(diffuse(reflectance: tone), thin_dielectric(tint: tone, roughness: 0.4), weight: share)
shape plate { mesh: rectangle(width: 9, depth: 9) |> rotate(x: 80deg), material: leaf }
light behind = area(rectangle(width: 90, depth: 90) |> rotate(x: 90deg) |> translate([0, 0, -9]), radiance: 2)
let through = mean(render(eye, spp: 1024, max_bounces: 1).r)
let whole = through with { share: 1 }",
    );
    let whole = numbers(&mut e, "whole")[0];
    // Of what a pane does not reflect, and its facets do not lose, the tint is left.
    assert!((1.3..1.6).contains(&whole), "{whole}");
    for (text, expected, allowed) in [
        ("through", 0.3 * whole, 0.01),
        ("through with { share: 0 }", 0.0, 0.0),
        ("grad(through, share)", whole, 0.02),
        ("grad(through, tone).r", 0.3 * whole / 0.8, 0.02),
        ("through with { plate.material: blend(leaf.b, leaf.a, weight: 0.7) }", 0.3 * whole, 0.01),
        ("through with { leaf.b.tint: 0 }", 0.0, 0.0),
        ("leaf.b.roughness", 0.4, 1e-9),
    ] {
        let found = numbers(&mut e, text)[0];
        assert!((found - expected).abs() <= allowed, "{text} is {found}, not {expected}");
    }
}

/// A grain spreads a highlight along itself: head on it reflects in proportion to the density of facets that lie flat, which is 1 / (π αx αy). Its
/// numbers can be read, replaced and differentiated.
#[test]
fn grains_draw_highlights_out() {
    let mut e = engine(
        "camera eye { position: [0, 0, 5], look_at: [0, 0, 0], fov: 0.1deg, film: [1, 1] }
camera aside { position: [0, 0, 5], look_at: [1.5, 0, 0], fov: 0.1deg, film: [1, 1] }
camera above { position: [0, 0, 5], look_at: [0, 1.5, 0], fov: 0.1deg, film: [1, 1] }
param grain = 0.6
param lie = 0deg
material steel = brushed(conductor(roughness: 0.5, reflectance: 0.9), anisotropy: grain, turn: lie)
shape plate { mesh: rectangle(width: 9, depth: 9) |> rotate(x: 90deg), material: steel }
light lamp = point(position: [0, 0, 5], intensity: 100)
let seen = mean(render(eye, spp: 4, max_bounces: 1))
let beside = mean(render(aside, spp: 4, max_bounces: 1))
let over = mean(render(above, spp: 4, max_bounces: 1))",
    );
    // I F D / (4 r²) with αx = α + (1 − α) s².
    let [across, distance2] = [0.25, 25.0];
    let along = across + (1.0 - across) * 0.36;
    let peak = 100.0 * 0.9 / (4.0 * std::f64::consts::PI * along * across * distance2);
    let by_grain = -peak * 2.0 * 0.6 * (1.0 - across) / along;
    for (text, expected, allowed) in [
        ("seen", peak, 1e-3),
        ("seen with { steel.anisotropy: 0 }", peak * along / across, 1e-3),
        ("seen with { lie: 77deg }", peak, 1e-3),
        ("grad(seen, grain)", by_grain, 2e-3),
        ("steel.anisotropy", 0.6, 1e-9),
        ("steel.turn / 1deg + 90", 90.0, 1e-9),
        ("(beside with { lie: 90deg }) / over", 1.0, 1e-2),
        ("(over with { lie: 90deg }) / beside", 1.0, 1e-2),
    ] {
        let found = numbers(&mut e, text)[0];
        assert!((found - expected).abs() <= allowed * expected.abs(), "{text} is {found}, not {expected}");
    }
    let [beside, over] = ["beside", "over"].map(|text| numbers(&mut e, text)[0]);
    assert!(beside > 2.0 * over, "{beside} along the grain and {over} across");
    let [turned, differed] = ["grad(beside, lie)", "fd(beside, lie, 1e-2)"]
        .map(|t| numbers(&mut e, &t.replace("beside", "(beside with { steel.turn: lie + 20deg })"))[0]);
    assert!((turned - differed).abs() < 2e-3 * differed.abs() && turned < 0.0, "{turned} {differed}");
    let x = expr(&e, "steel");
    let shown = brief(&eval(&mut e, "steel with { lie: 30deg }"), &x.ty);
    assert_eq!(shown, "brushed(conductor(reflectance: 0.9, roughness: 0.5), anisotropy: 0.6, turn: 30deg)");
}

/// A blend is between its materials, in proportion to the weight; their numbers can be read, replaced and differentiated through it.
#[test]
fn blends_are_between_their_materials() {
    let mut e = engine(
        "camera eye { position: [0, 0, 5], look_at: [0, 0, 0], fov: 20deg, film: [4, 4] }
param rust = 0.25
param grey = 0.5
material soot = diffuse(reflectance: 0)
material paint = blend(soot, diffuse(reflectance: grey), weight: rust)
shape plate { mesh: rectangle(width: 9, depth: 9) |> rotate(x: 90deg), material: paint }
light sky = constant(1)
let seen = mean(render(eye, spp: 1024, max_bounces: 1))",
    );
    for (text, expected) in [
        ("seen", 0.125),
        ("seen with { rust: 1 }", 0.5),
        ("seen with { paint.weight: 0 }", 0.0),
        ("seen with { paint.b.reflectance: 0.8 }", 0.2),
        ("seen with { soot.reflectance: 1 }", 0.875),
        ("seen with { paint.a: diffuse(reflectance: 1) }", 0.875),
        ("seen with { plate.material: mask(one_sided(paint), opacity: 0.5) }", 0.5625),
        ("seen with { paint: blend(soot, coated(diffuse(reflectance: 0.4), coat: 0), weight: 0.5) }", 0.2),
        ("seen with { paint.weight: texture([[0, 1]]) }", 0.25),
        ("grad(seen, rust)", 0.5),
        ("grad(seen, grey)", 0.25),
        ("paint.a.reflectance", 0.0),
        ("paint.weight", 0.25),
        ("mask(paint, opacity: 0.75).opacity", 0.75),
        ("mask(paint, opacity: 0.75).b.reflectance", 0.5),
    ] {
        let found = numbers(&mut e, text)[0];
        assert!((found - expected).abs() <= 0.004, "{text} is {found}, not {expected}");
    }
    let x = expr(&e, "paint");
    let mut shown = |text: &str| brief(&eval(&mut e, text), &x.ty);
    let paint = "blend(diffuse(reflectance: 0), diffuse(reflectance: 0.5), weight: 0.25)";
    assert_eq!(shown("paint"), paint);
    assert_eq!(shown("mask(paint, opacity: 0.5)"), format!("mask({paint}, opacity: 0.5)"));
}

/// A mask shows its opacity's share; its opacity can be read and replaced; an image brings its alpha channel.
#[test]
fn masks_show_what_is_behind() {
    let mut e = engine(
        "camera eye { position: [0, 0, 5], look_at: [0, 0, 0], fov: 20deg, film: [4, 4] }
material glass = mask(one_sided(diffuse(reflectance: 0.5)), opacity: 0.25)
shape screen { mesh: rectangle(width: 9, depth: 9) |> rotate(x: 90deg), material: glass }
light wall = area(rectangle(width: 20, depth: 20) |> rotate(x: 90deg) |> translate([0, 0, -2]), radiance: 4)
let picture = image([[[1, 1, 1, 0.75]]])",
    );
    for (text, expected, allowed) in [
        ("mean(render(eye, spp: 4096, max_bounces: 0))", 3.0, 0.03),
        (
            "mean(render(eye, spp: 4096, max_bounces: 0)) with { glass: mask(diffuse(), opacity: texture(picture.a)) }",
            1.0,
            0.03,
        ),
        ("mean(render(eye, spp: 4096, max_bounces: 0)) with { glass.opacity: 1 }", 0.0, 0.0),
        ("mean(alpha(eye, spp: 4096)) with { wall: constant(1) }", 0.25, 0.005),
        ("glass.opacity", 0.25, 0.0),
    ] {
        let found = numbers(&mut e, text)[0];
        assert!((found - expected).abs() <= allowed, "{text} is {found}, not {expected}");
    }
    let x = expr(&e, "glass");
    let shown = brief(&eval(&mut e, "glass"), &x.ty);
    assert_eq!(shown, "mask(one_sided(diffuse(reflectance: 0.5)), opacity: 0.25)");
}

/// A step in a texture under a surface that moves has no derivative, and that is said; a smooth one has.
#[test]
fn steps_between_texels_are_reported() {
    let texture = |filter: &str| format!("opacity: texture([[0, 1], [1, 0]], filter: {filter})");
    let [nearest, bilinear] = ["nearest", "bilinear"].map(texture);
    for (mesh, grey, opacity, expected) in [
        ("rectangle(width: p)", "0.5", &nearest, true),
        ("rectangle(width: p)", "0.5", &bilinear, false),
        ("rectangle()", "p", &nearest, false),
        ("rectangle(width: p)", "checkerboard()", &bilinear, true),
    ] {
        let mut e = engine(&format!(
            "param p = 0.5
camera eye {{ position: [0, 0, 5], look_at: [0, 0, 0], fov: 20deg, film: [4, 4] }}
shape a {{ mesh: {mesh} |> rotate(x: 90deg), material: mask(diffuse(reflectance: {grey}), {opacity}) }}
light sky = constant(1)"
        ));
        eval(&mut e, "grad(mean(render(eye, spp: 1, max_bounces: 1)), p)");
        let is_step = |w: &Diagnostic| w.code == "dscene::gradient::incomplete" && w.message.contains("nearest");
        assert_eq!(e.take_warnings().iter().any(is_step), expected, "{mesh}, {grey}, {opacity}");
    }
}

/// What the camera sees in mirrors has derivatives; what surfaces see in one mirror by way of another has not, and that is said.
#[test]
fn what_mirrors_lack_is_reported() {
    let [lamp, card] = ["light b = area(MESH)", "shape b { mesh: MESH }"]
        .map(|text| text.replace("MESH", "rectangle() |> translate([p, 2, 2])"));
    let wall = "shape wall { mesh: rectangle(), material: mirror() }";
    for (ball, other, more, bounces, expected) in [
        ("sphere()", &lamp, "", 2, None),
        ("sphere()", &card, "", 2, None),
        ("sphere()", &lamp, wall, 1, None),
        ("sphere()", &lamp, wall, 3, None),
        ("sphere()", &card, wall, 2, None),
        ("sphere()", &card, wall, 3, Some("by way of another")),
        ("torus()", &card, "", 3, Some("by way of another")),
        ("sphere(subdivisions: 6)", &lamp, "", 2, None),
        ("sphere(subdivisions: 6)", &lamp, "", 3, Some("so coarse")),
        ("sphere()", &lamp, "", 3, None),
    ] {
        let mut e = engine(&format!(
            "param p = 0.5
camera eye {{ position: [0, 0, 5], look_at: [0, 0, 0], fov: 20deg, film: [4, 4] }}
shape a {{ mesh: {ball}, material: mirror() }}
{other}
{more}
light sky = constant(1)"
        ));
        eval(&mut e, &format!("grad(mean(render(eye, spp: 1, max_bounces: {bounces})), p)"));
        let warnings = e.take_warnings();
        let gap = warnings.iter().find(|w| w.code == "dscene::gradient::incomplete");
        let said = |text: &str| gap.is_some_and(|w| w.message.contains(text));
        assert!(expected.map_or(gap.is_none(), said), "{ball}, {other}, {more}, {bounces}: {gap:?}");
    }
}

/// What the camera sees through glass has derivatives; what reaches other surfaces through it has not, nor where there are masks.
#[test]
fn what_glass_lacks_is_reported() {
    let lamp = "light b = area(rectangle() |> translate([p, 2, 2]))";
    let card = "shape b { mesh: rectangle() |> translate([p, 2, 2]) }";
    let net = "shape net { mesh: rectangle(), material: mask(diffuse(), 0.5) }";
    let sun = "light sun = directional(direction: [0, -1, 0])";
    for (glass, other, more, bounces, expected) in [
        ("", lamp, "", 4, &[][..]),
        ("", card, "", 1, &[]),
        ("", card, "", 4, &["other surfaces than the camera see through smooth glass"]),
        ("", card, sun, 4, &["through smooth glass", "shadows of `point`"]),
        ("", lamp, net, 1, &["masks"]),
        // Rough glass has lobes, as other surfaces have.
        ("roughness: 0.3", card, sun, 4, &[]),
        ("roughness: 0.3", card, net, 4, &[]),
    ] {
        let mut e = engine(&format!(
            "param p = 0.5
camera eye {{ position: [0, 0, 5], look_at: [0, 0, 0], fov: 20deg, film: [4, 4] }}
shape a {{ mesh: sphere(), material: dielectric({glass}) }}\n{other}\n{more}\nlight sky = constant(1)"
        ));
        eval(&mut e, &format!("grad(mean(render(eye, spp: 1, max_bounces: {bounces})), p)"));
        let warnings = e.take_warnings();
        let gaps = warnings.iter().filter(|w| w.code == "dscene::gradient::incomplete");
        let said: String = gaps.map(|w| w.message.as_str()).collect();
        let right = expected.iter().all(|text| said.contains(text)) && said.is_empty() == expected.is_empty();
        assert!(right, "{glass}, {other}, {more}, {bounces}: {said}");
    }
}
