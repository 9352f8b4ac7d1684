//! Letters made of strokes, for words in pictures without a font.
//!
//! A glyph is a list of strokes separated by blanks, each a list of points of two digits (base 36): to the right, and upward, where 4 is
//! the baseline, e (14) the height of small letters and i (18) that of capitals. A stroke is straight from point to point; with `~` it is
//! a quadratic spline with these control points from the first to the last, and with `@` a closed one.

/// Units of a glyph in the height of a line.
const UNITS: f64 = 20.0;
/// Units between two letters.
const GAP: f64 = 3.6;
/// Units of a blank.
const BLANK: f64 = 6.0;
/// Pieces of a spline between two control points.
const PIECES: usize = 6;

/// The width of a text in a line of that height.
pub(super) fn width(text: &str, size: f64) -> f64 {
    let units: f64 = text.chars().map(|c| Glyph::of(c).advance()).sum();
    (units - GAP).max(0.0) * size / UNITS
}

/// The room for a text, in a font of whoever shows the SVG too.
pub(super) fn room(text: &str, size: f64) -> f64 {
    if text.is_empty() { 0.0 } else { 1.1 * width(text, size) + 0.3 * size }
}

/// The strokes of a text that begins at the origin, with y upward from the baseline.
pub(super) fn strokes(text: &str, size: f64) -> Vec<Vec<[f64; 2]>> {
    let scale = size / UNITS;
    let mut found = Vec::new();
    let mut x = 0.0;
    for c in text.chars() {
        let glyph = Glyph::of(c);
        for line in glyph.lines() {
            let place = |[dx, dy]: [f64; 2]| {
                [(x + dx * glyph.scale) * scale, ((dy - 4.0) * glyph.scale + glyph.raised) * scale]
            };
            found.push(line.into_iter().map(place).collect());
        }
        x += glyph.advance();
    }
    found
}

struct Glyph {
    strokes: &'static str,
    /// Smaller than others, and raised by so many units: exponents and indices.
    scale: f64,
    raised: f64,
}

impl Glyph {
    /// What is not known is a box.
    fn of(c: char) -> Glyph {
        const RAISED: &str = "⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻";
        const LOWERED: &str = "₀₁₂₃₄₅₆₇₈₉₊₋";
        const BASE: &str = "0123456789+-";
        let base = |of: &str| of.chars().position(|x| x == c).and_then(|at| BASE.chars().nth(at));
        let (c, scale, raised) = match (base(RAISED), base(LOWERED)) {
            (Some(base), _) => (base, 0.65, 7.5),
            (_, Some(base)) => (base, 0.65, -2.5),
            _ => (c, 1.0, 0.0),
        };
        let found = GLYPHS.iter().find(|(signs, _)| signs.contains(c));
        Glyph { strokes: found.map_or("040i8i8404", |(_, strokes)| strokes), scale, raised }
    }

    fn advance(&self) -> f64 {
        let right = self.lines().iter().flatten().map(|p| p[0]).fold(f64::NAN, f64::max);
        if right.is_nan() { BLANK } else { right * self.scale + GAP * (0.5 + 0.5 * self.scale) }
    }

    fn lines(&self) -> Vec<Vec<[f64; 2]>> {
        self.strokes.split_whitespace().map(line).collect()
    }
}

/// The points of a stroke.
fn line(stroke: &str) -> Vec<[f64; 2]> {
    let digits: Vec<f64> = stroke.chars().filter_map(|c| c.to_digit(36)).map(f64::from).collect();
    let points: Vec<[f64; 2]> = digits.chunks_exact(2).map(|p| [p[0], p[1]]).collect();
    let middle = |a: [f64; 2], b: [f64; 2]| [(a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0];
    let n = points.len();
    match stroke.chars().next() {
        Some('@') => {
            let arcs = (0..n).map(|i| {
                let (before, at, after) = (points[(i + n - 1) % n], points[i], points[(i + 1) % n]);
                [middle(before, at), at, middle(at, after)]
            });
            arcs.flat_map(spline).collect()
        }
        Some('~') if n > 2 => {
            let arcs = (1..n - 1).map(|i| {
                let from = if i == 1 { points[0] } else { middle(points[i - 1], points[i]) };
                let to = if i == n - 2 { points[n - 1] } else { middle(points[i], points[i + 1]) };
                [from, points[i], to]
            });
            arcs.flat_map(spline).collect()
        }
        _ => points,
    }
}

/// Points of a quadratic Bézier curve.
fn spline([a, b, c]: [[f64; 2]; 3]) -> Vec<[f64; 2]> {
    let point = |t: f64| {
        let s = 1.0 - t;
        [0, 1].map(|axis| s * s * a[axis] + 2.0 * s * t * b[axis] + t * t * c[axis])
    };
    (0..=PIECES).map(|i| point(i as f64 / PIECES as f64)).collect()
}

const GLYPHS: &[(&str, &str)] = &[
    (" \u{a0}\u{202f}\u{2009}", ""),
    ("A", "045ia4 2989"),
    ("B", "4i0i0454 ~4i8i8b4b 0b5b ~5b9b9454"),
    ("C", "~9f8i0i048497"),
    ("D", "4i0i0444 ~4iaia444"),
    ("E", "9i0i0494 0b8b"),
    ("F", "9i0i04 0b7b"),
    ("G", "~9f8i0i04949a 9a5a"),
    ("H", "040i 949i 0b9b"),
    ("I", "040i"),
    ("J", "6i68 ~68640408"),
    ("K", "040i 9i0a 3d94"),
    ("L", "0i0484"),
    ("M", "040i58aia4"),
    ("N", "040i949i"),
    ("O", "@0iaia404"),
    ("P", "040i5i ~5i9i9a5a 5a0a"),
    ("Q", "@0iaia404 68b3"),
    ("R", "040i5i ~5i9i9a5a 5a0a 5a94"),
    ("S", "~8f7i0i0b9b941407"),
    ("T", "0iai 5i54"),
    ("U", "0i09 ~09049499 999i"),
    ("V", "0i54ai"),
    ("W", "0i347gb4ei"),
    ("X", "049i 0i94"),
    ("Y", "0i5bai 5b54"),
    ("Z", "0i9i0494"),
    ("a", "@0e8e8404 8e84"),
    ("b", "0i04 @0e8e8404"),
    ("c", "~7c6e0e046476"),
    ("d", "8i84 @0e8e8404"),
    ("e", "0989 ~898e0e046476"),
    ("f", "~6i2i2d 2d24 0e5e"),
    ("g", "8e83 ~83801002 @0e8e8404"),
    ("h", "0i04 ~0a0e8e8a 8a84"),
    ("i", "040e 0i0i"),
    ("j", "2e22 ~222000 2i2i"),
    ("k", "0i04 7e08 3b84"),
    ("l", "0i04"),
    ("m", "040e ~0a0e6e6a 6a64 ~6a6ececa cac4"),
    ("n", "040e ~0a0e8e8a 8a84"),
    ("o", "@0e8e8404"),
    ("p", "000e @0e8e8404"),
    ("q", "808e @0e8e8404"),
    ("r", "040e ~0a0e5e"),
    ("s", "~6c6e0e0979740406"),
    ("t", "2h27 ~272464 0e5e"),
    ("u", "0e08 ~08048488 8e84"),
    ("v", "0e448e"),
    ("w", "0e346d94ce"),
    ("x", "047e 0e74"),
    ("y", "0e44 8e20"),
    ("z", "0e7e0474"),
    ("0", "@0i8i8404"),
    ("1", "1f4i44"),
    ("2", "~0e0i8i8d04 0484"),
    ("3", "~0f0i8i8b3b ~3b8b840407"),
    ("4", "646i0888"),
    ("5", "7i1i0b ~0b2d8d840406"),
    ("6", "@0c8c8404 ~7i0i08"),
    ("7", "0i8i34"),
    ("8", "@1i7i7b1b @0b8b8404"),
    ("9", "@0i8i8a0a ~8e8414"),
    (".", "0404"),
    (",", "1402"),
    (":", "0404 0d0d"),
    (";", "1402 1d1d"),
    ("…", "0404 4444 8484"),
    ("·", "0a0a"),
    ("-‐", "0a5a"),
    ("−–—", "0a8a"),
    ("_", "0282"),
    ("+", "0a8a 4e46"),
    ("±", "0c8c 4g48 0585"),
    ("×", "077d 0d77"),
    ("÷", "0a8a 4e4e 4646"),
    ("=", "0c8c 0888"),
    ("≈~", "~092c688b"),
    ("*∗", "4f47 0d89 8d09"),
    ("/", "027j"),
    ("\\", "0j72"),
    ("|", "020k"),
    ("(", "~3k0f0732"),
    (")", "~0k3f3702"),
    ("[", "3k0k0232"),
    ("]", "0k3k3202"),
    ("{", "~4k2k2b0b ~0b2b2242"),
    ("}", "~0k2k2b4b ~4b2b2202"),
    ("<", "8e0a86"),
    (">", "0e8a06"),
    ("≤", "8f0b87 0484"),
    ("≥", "0f8b07 0484"),
    ("%", "049i @0i4i4d0d @59999454"),
    ("^", "0e4i8e"),
    ("!", "0i09 0404"),
    ("?", "~0e0i7i7d3b38 3434"),
    ("'’‘`", "0i0e"),
    ("\"“”", "0i0e 3i3e"),
    ("#", "244i 648i 0d9d 0898"),
    ("$", "~8f7i0i0b9b941407 4k42"),
    ("&", "~943e2i7i6d0b045489"),
    ("@", "~d5a4040ididc d9a8a9ad @4d9d9747"),
    ("°", "@0i4i4e0e"),
    ("α", "~8e64040e6e84"),
    ("β", "000e ~0e0i7i7c2c ~2c8c840406"),
    ("γ", "0e448e 4440"),
    ("δ", "@0c8c8404 ~6i1i2e7b"),
    ("ε", "~6d5e0e0949 ~4909045465"),
    ("η", "040e ~0a0e8e8a 8a80"),
    ("θ", "@0i7i7404 0b7b"),
    ("κ", "0e04 7e08 3b84"),
    ("λ", "0i2i84 5b04"),
    ("µμ", "000e 0e08 ~08048488 8e84"),
    ("ν", "0e448e"),
    ("π", "0e9e 2e24 7e74"),
    ("ρ", "@0e8e8404 0900"),
    ("σ", "@0e8e8404 4e9e"),
    ("τ", "0e7e 3e37 ~373464"),
    ("φ", "@0e8e8404 4h41"),
    ("ω", "~0e04444b ~4b44848e"),
    ("Δ", "045ia404"),
    ("Σ", "9i0i5b0494"),
    ("Ω", "0434 ~34080iaia874 74a4"),
    ("∂", "@0c8c8404 ~888i1h"),
    ("√", "0b349k"),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sign_of_a_keyboard_has_strokes_within_its_line() {
        for c in (' '..='~').chain("±×°µ⁻³₂π".chars()) {
            let lines = strokes(&c.to_string(), UNITS);
            assert_eq!(lines.is_empty(), c == ' ', "{c}");
            let inside = |p: &[f64; 2]| (0.0..=16.0).contains(&p[0]) && (-4.0..=17.0).contains(&p[1]);
            assert!(lines.iter().flatten().all(inside), "{c}: {lines:?}");
            let known = GLYPHS.iter().any(|(signs, _)| signs.contains(c)) || "⁻³₂".contains(c);
            assert!(known, "{c} is a box");
        }
        for (signs, strokes) in GLYPHS {
            let digits = strokes.chars().filter(char::is_ascii_alphanumeric).count();
            assert!(digits % 2 == 0, "{signs}: half a point");
        }
    }

    #[test]
    fn widths_add_up() {
        let gap = GAP * 0.5;
        assert!((width("H", 10.0) - 4.5).abs() < 1e-9);
        assert!((width("HH", 10.0) - 9.0 - gap).abs() < 1e-9);
        assert_eq!(width("", 10.0), 0.0);
        // An O is round: as high as wide are the middles of its sides.
        let o = &strokes("O", UNITS)[0];
        assert!(o.iter().all(|p| ((p[0] - 5.0) / 5.0).hypot((p[1] - 7.0) / 7.0) < 1.1), "{o:?}");
    }
}
