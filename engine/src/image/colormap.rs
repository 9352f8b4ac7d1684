//! False colours: maps from a number in 0..1 to a colour.

use super::filter::srgb_to_linear;

/// A way from numbers to colours. All but `Turbo` rise evenly in lightness, or fall from the middle to both ends, and can be told apart
/// by colour-blind readers and in grey prints.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colormap {
    /// From violet over green to yellow (Smith & van der Walt 2015).
    Viridis,
    /// From black over red to pale yellow (Smith & van der Walt 2015).
    Inferno,
    /// A rainbow with more detail than other maps and no even lightness (Mikhailov 2019).
    Turbo,
    /// Blue below the middle, red above it.
    Diverging,
}

impl Colormap {
    /// With their names in the language.
    pub const ALL: [(&str, Colormap); 4] = [
        ("viridis", Colormap::Viridis),
        ("inferno", Colormap::Inferno),
        ("turbo", Colormap::Turbo),
        ("diverging", Colormap::Diverging),
    ];

    /// The map with that name in the language.
    pub fn named(name: &str) -> Option<Colormap> {
        Self::ALL.iter().find(|(n, _)| *n == name).map(|(_, map)| *map)
    }

    /// Linear colours at even distances from 0 to 1; between two of them colours are linear.
    pub fn colours(self) -> Vec<[f64; 3]> {
        const STEPS: usize = 255;
        let at = |i: usize| self.encoded(i as f64 / STEPS as f64).map(srgb_to_linear);
        (0..=STEPS).map(at).collect()
    }

    /// The sRGB-encoded colour of `t` in 0..1.
    fn encoded(self, t: f64) -> [f64; 3] {
        match self {
            Colormap::Viridis => between(&VIRIDIS, t),
            Colormap::Inferno => between(&INFERNO, t),
            Colormap::Diverging => between(&DIVERGING, t),
            Colormap::Turbo => TURBO.map(|c| c.iter().rev().fold(0.0, |sum, c| sum * t + c).clamp(0.0, 1.0)),
        }
    }
}

const VIRIDIS: [u32; 10] =
    [0x440154, 0x482878, 0x3e4989, 0x31688e, 0x26828e, 0x1f9e89, 0x35b779, 0x6ece58, 0xb5de2b, 0xfde725];
const INFERNO: [u32; 10] =
    [0x000004, 0x1b0c41, 0x4a0c6b, 0x781c6d, 0xa52c60, 0xcf4446, 0xed6925, 0xfb9b06, 0xf7d13d, 0xfcffa4];
/// That of differences in a run's report.
const DIVERGING: [u32; 7] = [0x213c8c, 0x4382c4, 0xa0cbe5, 0xf7f7f7, 0xf4b28a, 0xd1543e, 0x7b0f26];

/// Coefficients of polynomials for red, green and blue, from the constant on.
const TURBO: [[f64; 6]; 3] = [
    [0.13572138, 4.61539260, -42.66032258, 132.13108234, -152.94239396, 59.28637943],
    [0.09140261, 2.19418839, 4.84296658, -14.18503333, 4.27729857, 2.82956604],
    [0.10667330, 12.64194608, -60.58204836, 110.36276771, -89.90310912, 27.34824973],
];

/// The colour at `t` between colours at even distances.
fn between(colours: &[u32], t: f64) -> [f64; 3] {
    let at = t.clamp(0.0, 1.0) * (colours.len() - 1) as f64;
    let first = (at as usize).min(colours.len() - 2);
    let channel = |colour: u32, shift: u32| f64::from((colour >> shift) & 0xff) / 255.0;
    [16, 8, 0].map(|shift| {
        let (a, b) = (channel(colours[first], shift), channel(colours[first + 1], shift));
        a + (b - a) * (at - first as f64)
    })
}

#[cfg(test)]
mod tests {
    use super::super::filter::linear_to_srgb;
    use super::*;

    fn luminance(c: &[f64; 3]) -> f64 {
        0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]
    }

    #[test]
    fn maps_pass_through_their_published_colours() {
        let bytes = |map: Colormap, i: usize| map.colours()[i].map(|c| (linear_to_srgb(c) * 255.0).round() as u32);
        assert_eq!((bytes(Colormap::Viridis, 0), bytes(Colormap::Viridis, 255)), ([68, 1, 84], [253, 231, 37]));
        assert_eq!((bytes(Colormap::Inferno, 0), bytes(Colormap::Inferno, 255)), ([0, 0, 4], [252, 255, 164]));
        // A third of the way: the fourth of ten colours.
        assert_eq!(bytes(Colormap::Viridis, 85), [0x31, 0x68, 0x8e]);
        // Turbo's look-up table begins and ends with these, which its polynomials meet to within a few steps.
        for (found, table) in [(bytes(Colormap::Turbo, 0), [48, 18, 59]), (bytes(Colormap::Turbo, 255), [122, 4, 3])] {
            let near = found.iter().zip(table).all(|(a, b)| a.abs_diff(b) <= 32);
            assert!(near, "{found:?} {table:?}");
        }
    }

    #[test]
    fn lightness_tells_the_order() {
        for map in [Colormap::Viridis, Colormap::Inferno] {
            assert!(map.colours().windows(2).all(|w| luminance(&w[0]) < luminance(&w[1])), "{map:?}");
        }
        let colours = Colormap::Diverging.colours();
        let (below, above) = colours.split_at(128);
        assert!(below.windows(2).all(|w| luminance(&w[0]) < luminance(&w[1])));
        assert!(above.windows(2).all(|w| luminance(&w[0]) > luminance(&w[1])));
    }

    #[test]
    fn differences_have_the_colours_of_the_report() {
        let bytes = |c: u32| format!("[{}, {}, {}]", c >> 16, (c >> 8) & 0xff, c & 0xff);
        let table = DIVERGING.map(bytes).join(", ");
        assert!(
            include_str!("../../../src/report/pictures.js").contains(&format!("const DIVERGING = [{table}];")),
            "{table}"
        );
    }
}
