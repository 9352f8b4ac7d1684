//! Bitmap textures with nearest, bilinear or trilinear lookup (in a mip map), and their derivatives in the texels and in uv.

use std::borrow::Cow;
use std::sync::Arc;

use glam::{Vec2, Vec3};

pub use crate::image::Wrap;
use crate::image::filter::Separable;
use crate::image::packed::Packed;

/// How a texture is interpolated between the centres of its texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Filter {
    /// Bilinear interpolation of the four texels around; continuous, so that it has derivatives in uv.
    Bilinear,
    /// The nearest texel; the derivatives in uv are zero.
    Nearest,
    /// Trilinear interpolation in a mip map (Williams 1983, "Pyramidal Parametrics"): between two levels of ever coarser bitmaps, each
    /// with half the texels a side of the one before, and bilinear in both. Which levels, `render::level` says.
    Trilinear,
}

/// A bitmap. Row 0 is the top (v = 0), and texel centres lie at (i + 0.5) / n. A bitmap of 1×1 is a constant.
#[derive(Clone, Debug, PartialEq)]
pub struct Texture {
    /// Texels along u.
    pub width: usize,
    /// Texels along v.
    pub height: usize,
    /// 1 or 3.
    pub channels: usize,
    /// `data[(y * width + x) * channels + c]`; of a mip map, all levels one after the other ([`mip_sizes`]), the finest first. Without
    /// that one if it is `packed`.
    pub data: Vec<f32>,
    /// The finest level, if it is held in bytes.
    pub packed: Option<Arc<Packed>>,
    /// How it continues outside of [0, 1]².
    pub wrap: Wrap,
    /// How it is interpolated.
    pub filter: Filter,
}

/// The reason why an array cannot be a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TextureError {
    /// It has no texels.
    #[error("a texture needs at least one texel, this one is {width}×{height}")]
    Empty {
        /// Texels along u.
        width: usize,
        /// Texels along v.
        height: usize,
    },
    /// It has neither 1 channel (a number) nor 3 (a colour).
    #[error("a texture has 1 or 3 channels, not {0}")]
    Channels(usize),
    /// The number of values does not fit its size.
    #[error("a {width}×{height} texture of {channels} channels holds {expected} numbers, not {found}")]
    Length {
        /// Texels along u.
        width: usize,
        /// Texels along v.
        height: usize,
        /// Channels per texel.
        channels: usize,
        /// width · height · channels.
        expected: usize,
        /// Number of values given.
        found: usize,
    },
}

/// Width and height of the levels of a mip map, from the finest to that of a single texel: halves, rounded up.
pub fn mip_sizes(width: usize, height: usize) -> impl Iterator<Item = [usize; 2]> {
    let next = |&[w, h]: &[usize; 2]| (w > 1 || h > 1).then(|| [w.div_ceil(2), h.div_ceil(2)]);
    std::iter::successors(Some([width, height]), next)
}

/// One level of a mip map, or all of another texture.
#[derive(Clone, Copy)]
struct Level {
    /// Index of its first number in [`Texture::data`].
    start: usize,
    width: usize,
    height: usize,
}

/// The texels that a lookup reads, with weights that sum to one and their derivatives in u and v.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Footprint {
    /// Index of the texel's first channel in [`Texture::data`].
    pub texels: [usize; 4],
    /// Weight of each texel in the value.
    pub weights: [f32; 4],
    /// Derivatives of the weights in u and v.
    pub d_weights: [Vec2; 4],
}

impl Texture {
    /// A constant colour.
    pub fn constant(rgb: Vec3) -> Texture {
        Texture {
            width: 1,
            height: 1,
            channels: 3,
            data: rgb.to_array().to_vec(),
            packed: None,
            wrap: Wrap::Repeat,
            filter: Filter::Bilinear,
        }
    }

    /// A constant number.
    pub fn constant_scalar(value: f32) -> Texture {
        Texture { channels: 1, data: vec![value], ..Texture::constant(Vec3::ZERO) }
    }

    /// A bitmap of `height × width × channels` numbers, to which the coarser levels of a mip map are added if it is to be one. Fails if it
    /// is empty, if its channels are not 1 or 3, or if `data` has another length.
    pub fn new(
        width: usize,
        height: usize,
        channels: usize,
        data: Vec<f32>,
        wrap: Wrap,
        filter: Filter,
    ) -> Result<Texture, TextureError> {
        if width == 0 || height == 0 {
            return Err(TextureError::Empty { width, height });
        }
        if channels != 1 && channels != 3 {
            return Err(TextureError::Channels(channels));
        }
        let expected = width.saturating_mul(height).saturating_mul(channels);
        if data.len() != expected {
            return Err(TextureError::Length { width, height, channels, expected, found: data.len() });
        }
        let data = if filter == Filter::Trilinear { pyramid(width, height, channels, data) } else { data };
        Ok(Texture { width, height, channels, data, packed: None, wrap, filter })
    }

    /// A bitmap in bytes, of 1 or 3 channels, with its [`coarser_levels`] if it is to be a mip map, and nothing else.
    pub fn from_packed(
        packed: Arc<Packed>,
        coarser: Vec<f32>,
        wrap: Wrap,
        filter: Filter,
    ) -> Result<Texture, TextureError> {
        let Packed { width, height, channels, .. } = *packed;
        if channels != 1 && channels != 3 {
            return Err(TextureError::Channels(channels));
        }
        let levels = mip_sizes(width, height).skip(1).map(|[w, h]| w * h * channels).sum();
        let expected = if filter == Filter::Trilinear { levels } else { 0 };
        if coarser.len() != expected {
            return Err(TextureError::Length { width, height, channels, expected, found: coarser.len() });
        }
        let data = coarser;
        Ok(Texture { width, height, channels, data, packed: Some(packed), wrap, filter })
    }

    /// The same texture with all its numbers in [`Texture::data`].
    pub fn unpacked(&self) -> Cow<'_, Texture> {
        match &self.packed {
            None => Cow::Borrowed(self),
            Some(_) => Cow::Owned(Texture { data: self.numbers().collect(), packed: None, ..self.clone() }),
        }
    }

    /// How many numbers it has.
    pub fn len(&self) -> usize {
        self.packed_len() + self.data.len()
    }

    /// Whether it has none, which no texture made by [`Texture::new`] has.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    #[inline]
    fn packed_len(&self) -> usize {
        self.packed.as_ref().map_or(0, |packed| packed.len())
    }

    /// All its numbers, level after level.
    pub fn numbers(&self) -> impl Iterator<Item = f32> + '_ {
        self.packed.iter().flat_map(|packed| packed.numbers()).chain(self.data.iter().copied())
    }

    /// The colour of a texel of the finest level.
    pub fn color_at(&self, x: usize, y: usize) -> Vec3 {
        self.texel((y * self.width + x) * self.channels)
    }

    /// The colours of its finest level; a single channel is repeated in all three.
    pub fn colors(&self) -> impl Iterator<Item = Vec3> + '_ {
        (0..self.width * self.height).map(|i| self.texel(i * self.channels))
    }

    /// Whether it has levels.
    #[inline]
    pub fn is_mipmapped(&self) -> bool {
        self.filter == Filter::Trilinear
    }

    /// The number of the coarsest level; 0 if there is but one.
    pub fn coarsest(&self) -> usize {
        if self.is_mipmapped() { mip_sizes(self.width, self.height).count() - 1 } else { 0 }
    }

    /// Whether it is a single texel, and so constant.
    #[inline]
    pub fn is_constant(&self) -> bool {
        self.width == 1 && self.height == 1
    }

    /// The colour of the first texel, which is the value of a constant texture.
    #[inline]
    pub fn color(&self) -> Vec3 {
        self.texel(0)
    }

    /// The colour at `uv`, of a mip map that on its finest level; a single channel is repeated in all three.
    pub fn eval(&self, uv: Vec2) -> Vec3 {
        if self.is_constant() {
            return self.texel(0);
        }
        self.value(&self.footprint(uv))
    }

    /// The colour at `uv` between the levels around `lod`; without a mip map, [`Texture::eval`].
    pub fn eval_at(&self, uv: Vec2, lod: f32) -> Vec3 {
        let between = self.footprints(uv, lod);
        between.iter().filter(|(_, w)| *w > 0.0).map(|(footprint, w)| self.value(footprint) * *w).sum()
    }

    /// The texels read at `uv` between the levels around `lod` (0 is the finest): those of each of two levels, with that level's weight.
    pub fn footprints(&self, uv: Vec2, lod: f32) -> [(Footprint, f32); 2] {
        let lod = lod.clamp(0.0, self.coarsest() as f32);
        let (level, share) = (lod as usize, lod.fract());
        let finer = self.footprint_wrapped(uv, self.level(level), self.wrap, self.wrap);
        let coarser = match share > 0.0 {
            true => self.footprint_wrapped(uv, self.level(level + 1), self.wrap, self.wrap),
            false => finer,
        };
        [(finer, 1.0 - share), (coarser, share)]
    }

    /// The colour and its derivatives in u and in v (of the bilinear surface; zero for nearest-texel lookups).
    pub fn eval_with_uv_gradient(&self, uv: Vec2) -> (Vec3, [Vec3; 2]) {
        if self.is_constant() {
            return (self.texel(0), [Vec3::ZERO; 2]);
        }
        let footprint = self.footprint(uv);
        (self.value(&footprint), self.uv_gradient(&footprint))
    }

    /// Visits the texels that a lookup reads: the index of the first channel in [`Texture::data`], and the weight.
    pub fn for_each_texel(&self, uv: Vec2, mut visit: impl FnMut(usize, f32)) {
        let footprint = self.footprint(uv);
        for (texel, weight) in footprint.texels.into_iter().zip(footprint.weights) {
            if weight != 0.0 {
                visit(texel, weight);
            }
        }
    }

    /// Adjoint of [`Texture::eval`] with respect to the texels: calls `add` with an index into `data` and a derivative, for the
    /// derivative `d` in the colour.
    pub fn scatter(&self, uv: Vec2, d: Vec3, add: impl FnMut(usize, f32)) {
        self.scatter_footprint(&self.footprint(uv), d, add);
    }

    /// [`Texture::scatter`] for a footprint.
    pub fn scatter_footprint(&self, footprint: &Footprint, d: Vec3, mut add: impl FnMut(usize, f32)) {
        for (texel, weight) in footprint.texels.into_iter().zip(footprint.weights) {
            if weight == 0.0 {
                continue;
            }
            if self.channels == 1 {
                add(texel, weight * d.element_sum());
            } else {
                for c in 0..3 {
                    add(texel + c, weight * d[c]);
                }
            }
        }
    }

    /// The texels read at `uv`.
    pub fn footprint(&self, uv: Vec2) -> Footprint {
        self.footprint_wrapped(uv, self.level(0), self.wrap, self.wrap)
    }

    /// The texels read at `uv` of an equirectangular map: repeats in u, clamps in v.
    pub fn environment_footprint(&self, uv: Vec2) -> Footprint {
        self.footprint_wrapped(uv, self.level(0), Wrap::Repeat, Wrap::Clamp)
    }

    /// The weighted colour of a footprint.
    pub fn value(&self, footprint: &Footprint) -> Vec3 {
        footprint.texels.iter().zip(footprint.weights).map(|(&texel, w)| self.texel(texel) * w).sum()
    }

    /// Derivatives of [`Texture::value`] in u and in v.
    pub fn uv_gradient(&self, footprint: &Footprint) -> [Vec3; 2] {
        let mut gradient = [Vec3::ZERO; 2];
        for (&texel, d) in footprint.texels.iter().zip(footprint.d_weights) {
            let color = self.texel(texel);
            gradient[0] += color * d.x;
            gradient[1] += color * d.y;
        }
        gradient
    }

    /// The colour whose first channel is `data[index]`.
    #[inline]
    fn texel(&self, index: usize) -> Vec3 {
        if let Some(packed) = &self.packed {
            return self.texel_beside(packed, index);
        }
        if self.channels == 1 { Vec3::splat(self.data[index]) } else { Vec3::from_slice(&self.data[index..index + 3]) }
    }

    /// The same of a texture whose finest level is in bytes.
    #[inline(never)]
    fn texel_beside(&self, packed: &Packed, index: usize) -> Vec3 {
        let number = |c: usize| match index < packed.len() {
            true => packed.number(index, c),
            false => self.data[index - packed.len() + c],
        };
        if self.channels == 1 { Vec3::splat(number(0)) } else { Vec3::new(number(0), number(1), number(2)) }
    }

    /// The level of a number that is at most [`Texture::coarsest`].
    fn level(&self, number: usize) -> Level {
        let mut level = Level { start: 0, width: self.width, height: self.height };
        for _ in 0..number {
            let start = level.start + level.width * level.height * self.channels;
            level = Level { start, width: level.width.div_ceil(2), height: level.height.div_ceil(2) };
        }
        level
    }

    fn footprint_wrapped(&self, uv: Vec2, level: Level, wrap_u: Wrap, wrap_v: Wrap) -> Footprint {
        let index = |x: usize, y: usize| level.start + (y * level.width + x) * self.channels;
        if self.filter == Filter::Nearest {
            let texel = index(nearest(uv.x, level.width, wrap_u), nearest(uv.y, level.height, wrap_v));
            return Footprint { texels: [texel; 4], weights: [1.0, 0.0, 0.0, 0.0], d_weights: [Vec2::ZERO; 4] };
        }
        let ([x0, x1], fx, dx) = neighbours(uv.x, level.width, wrap_u);
        let ([y0, y1], fy, dy) = neighbours(uv.y, level.height, wrap_v);
        Footprint {
            texels: [index(x0, y0), index(x1, y0), index(x0, y1), index(x1, y1)],
            weights: [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy],
            d_weights: [
                Vec2::new(-dx * (1.0 - fy), -dy * (1.0 - fx)),
                Vec2::new(dx * (1.0 - fy), -dy * fx),
                Vec2::new(-dx * fy, dy * (1.0 - fx)),
                Vec2::new(dx * fy, dy * fx),
            ],
        }
    }
}

/// The levels of a mip map of a bitmap.
fn pyramid(width: usize, height: usize, channels: usize, mut data: Vec<f32>) -> Vec<f32> {
    let mut level = 0;
    for [width, height] in mip_sizes(width, height) {
        let size = width * height * channels;
        // A bitmap of no texels was refused, and one of a single texel has no coarser level.
        if let Some(filter) = Separable::halve(width, height).ok().filter(|_| width > 1 || height > 1) {
            data.extend(filter.apply(&data[level..level + size], channels));
        }
        level += size;
    }
    data
}

/// The coarser levels of the mip map of a bitmap in bytes, one after the other.
pub fn coarser_levels(packed: &Packed) -> Vec<f32> {
    pyramid(packed.width, packed.height, packed.channels, packed.to_image().data).split_off(packed.len())
}

/// The coordinate `t`, moved by whole periods or clamped: to [0, 1], and to [0, 2] where the second half is the mirrored bitmap.
fn into_period(t: f32, wrap: Wrap) -> f32 {
    if !t.is_finite() {
        return 0.0;
    }
    match wrap {
        Wrap::Repeat => t - t.floor(),
        Wrap::Clamp => t.clamp(0.0, 1.0),
        Wrap::Mirror => t - 2.0 * (0.5 * t).floor(),
    }
}

/// The texel, of `n` along one axis, that stands at place `i` of the row that goes on in both directions.
fn texel_at(i: i64, n: usize, wrap: Wrap) -> usize {
    let n = n as i64;
    let texel = match wrap {
        Wrap::Repeat => i.rem_euclid(n),
        Wrap::Clamp => i.clamp(0, n - 1),
        Wrap::Mirror => {
            let place = i.rem_euclid(2 * n);
            place.min(2 * n - 1 - place)
        }
    };
    texel as usize
}

fn nearest(t: f32, n: usize, wrap: Wrap) -> usize {
    let x = into_period(t, wrap) * n as f32;
    // Rounding may bring a coordinate just below a whole period onto it.
    texel_at((x as i64).min(if wrap == Wrap::Mirror { 2 * n as i64 } else { n as i64 } - 1), n, wrap)
}

/// The two texels around `t` along one axis, the weight of the second, and that weight's derivative in `t`.
fn neighbours(t: f32, n: usize, wrap: Wrap) -> ([usize; 2], f32, f32) {
    let x = into_period(t, wrap) * n as f32 - 0.5;
    let floor = x.floor();
    let (i, f) = (floor as i64, x - floor);
    ([texel_at(i, n, wrap), texel_at(i + 1, n, wrap)], f, n as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::Image;
    use crate::math::Pcg32;

    fn random_texture(channels: usize, wrap: Wrap, filter: Filter) -> Texture {
        let mut rng = Pcg32::new(5);
        let data = (0..5 * 4 * channels).map(|_| rng.next_f32()).collect();
        Texture::new(5, 4, channels, data, wrap, filter).unwrap()
    }

    #[test]
    fn bad_shapes_are_refused() {
        let make = |w, h, c, n| Texture::new(w, h, c, vec![0.0; n], Wrap::Repeat, Filter::Bilinear).unwrap_err();
        assert_eq!(make(0, 2, 3, 0), TextureError::Empty { width: 0, height: 2 });
        assert_eq!(make(1, 1, 2, 2), TextureError::Channels(2));
        assert!(matches!(make(2, 2, 3, 11), TextureError::Length { expected: 12, found: 11, .. }));
    }

    #[test]
    fn texel_centres_return_their_texel_and_row_zero_is_at_v_zero() {
        for filter in [Filter::Bilinear, Filter::Nearest] {
            let texture = random_texture(3, Wrap::Repeat, filter);
            for y in 0..4 {
                for x in 0..5 {
                    let uv = Vec2::new((x as f32 + 0.5) / 5.0, (y as f32 + 0.5) / 4.0);
                    let expected = Vec3::from_slice(&texture.data[(y * 5 + x) * 3..][..3]);
                    assert!((texture.eval(uv) - expected).length() < 1e-5);
                    assert!((texture.eval(uv + Vec2::new(-3.0, 2.0)) - expected).length() < 1e-5);
                }
            }
        }
    }

    #[test]
    fn clamped_lookups_stay_inside_and_bad_numbers_do_not_panic() {
        let texture = random_texture(1, Wrap::Clamp, Filter::Bilinear);
        assert_eq!(texture.eval(Vec2::new(-9.0, 7.0)), Vec3::splat(texture.data[15]));
        for wrap in [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror] {
            for bad in [f32::NAN, f32::INFINITY, -1e30, 1e30, 1.0, 0.99999997] {
                for filter in [Filter::Bilinear, Filter::Nearest] {
                    assert!(random_texture(1, wrap, filter).eval(Vec2::splat(bad)).is_finite());
                }
            }
        }
    }

    #[test]
    fn mirrored_bitmaps_go_there_and_back() {
        for filter in [Filter::Bilinear, Filter::Nearest] {
            let texture = random_texture(3, Wrap::Mirror, filter);
            let mut rng = Pcg32::new(7);
            for _ in 0..200 {
                let inside = Vec2::from(rng.next_2d());
                let expected = texture.eval(inside);
                for (u, v) in [(-1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)] {
                    for (across, down) in [(0.0, 0.0), (2.0, -4.0), (-2.0, 2.0)] {
                        let mirrored = inside * Vec2::new(u, v) + Vec2::new(across, down);
                        assert!((texture.eval(mirrored) - expected).length() < 1e-4, "{inside} {mirrored}");
                    }
                }
            }
        }
        // Between the border and its mirrored self there is nothing to interpolate.
        let texture = random_texture(1, Wrap::Mirror, Filter::Bilinear);
        let (value, gradient) = texture.eval_with_uv_gradient(Vec2::new(1.02, 0.125));
        assert_eq!((value, gradient[0]), (Vec3::splat(texture.data[4]), Vec3::ZERO));
    }

    #[test]
    fn uv_gradient_matches_differences() {
        for (channels, wrap) in [(3, Wrap::Repeat), (1, Wrap::Repeat), (3, Wrap::Clamp), (3, Wrap::Mirror)] {
            let texture = random_texture(channels, wrap, Filter::Bilinear);
            let mut rng = Pcg32::new(9);
            for _ in 0..200 {
                let [u, v] = rng.next_2d().map(|x| 1.6 * x - 0.3);
                let h = 1e-3;
                // Keep away from the creases at texel centres and from the clamp.
                let near_crease = |t: f32, n: f32| {
                    let f = (t * n - 0.5).rem_euclid(1.0);
                    !(0.02..0.98).contains(&f) || (t.abs() < 5e-3) || (t - 1.0).abs() < 5e-3
                };
                if near_crease(u, 5.0) || near_crease(v, 4.0) {
                    continue;
                }
                let (value, gradient) = texture.eval_with_uv_gradient(Vec2::new(u, v));
                assert_eq!(value, texture.eval(Vec2::new(u, v)));
                for (axis, step) in [Vec2::new(h, 0.0), Vec2::new(0.0, h)].into_iter().enumerate() {
                    let uv = Vec2::new(u, v);
                    let fd = (texture.eval(uv + step) - texture.eval(uv - step)) / (2.0 * h);
                    assert!((fd - gradient[axis]).length() < 5e-3, "{wrap:?} {uv} {fd} {}", gradient[axis]);
                }
            }
        }
    }

    /// Every level of a mip map has the bitmap's mean, the coarsest is that mean, and between two levels lies what lies between their
    /// values. A linear ramp is itself on all levels, away from its ends.
    #[test]
    fn mip_maps_keep_the_mean_and_ramps() {
        for wrap in [Wrap::Repeat, Wrap::Clamp, Wrap::Mirror] {
            let texture = random_texture(3, wrap, Filter::Trilinear);
            assert_eq!(mip_sizes(5, 4).collect::<Vec<_>>(), [[5, 4], [3, 2], [2, 1], [1, 1]]);
            assert_eq!((texture.coarsest(), texture.data.len()), (3, (20 + 6 + 2 + 1) * 3));
            let mean = (0..20).map(|i| Vec3::from_slice(&texture.data[3 * i..])).sum::<Vec3>() / 20.0;
            let mut rng = Pcg32::new(3);
            for _ in 0..50 {
                let uv = Vec2::from(rng.next_2d()) * 3.0 - 1.0;
                for far in [3.0, 7.0, f32::INFINITY] {
                    assert!((texture.eval_at(uv, far) - mean).length() < 1e-5);
                }
                assert_eq!(texture.eval_at(uv, 0.0), texture.eval(uv));
                let [a, between, b] = [1.0, 1.25, 2.0].map(|lod| texture.eval_at(uv, lod));
                assert!((between - a.lerp(b, 0.25)).length() < 1e-5);
            }
        }
        let ramp = (0..32).map(|i| (i as f32 + 0.5) / 32.0).collect();
        let ramp = Texture::new(32, 1, 1, ramp, Wrap::Clamp, Filter::Trilinear).unwrap();
        for lod in [0.0, 1.0, 1.7, 2.5] {
            for u in [0.2, 0.37, 0.5, 0.8] {
                assert!((ramp.eval_at(Vec2::new(u, 0.5), lod).x - u).abs() < 1e-5, "{u} on {lod}");
            }
        }
    }

    /// In bytes a texture is the same to the bit, on all levels.
    #[test]
    fn packed_textures_are_the_same() {
        let mut rng = Pcg32::new(11);
        for (channels, filter) in
            [(1, Filter::Nearest), (3, Filter::Bilinear), (1, Filter::Trilinear), (3, Filter::Trilinear)]
        {
            let texture = random_texture(channels, Wrap::Repeat, filter);
            let image = Image { width: 5, height: 4, channels, data: texture.data[..20 * channels].to_vec() };
            let packed = Arc::new(Packed::of(&image).unwrap());
            let coarser = if filter == Filter::Trilinear { coarser_levels(&packed) } else { Vec::new() };
            let packed = Texture::from_packed(packed, coarser, Wrap::Repeat, filter).unwrap();
            assert_eq!((packed.len(), &*packed.unpacked()), (texture.len(), &texture));
            assert!(packed.colors().eq(texture.colors()));
            for _ in 0..50 {
                let (uv, lod) = (Vec2::from(rng.next_2d()), 4.0 * rng.next_f32());
                assert_eq!(packed.eval_with_uv_gradient(uv), texture.eval_with_uv_gradient(uv));
                assert_eq!(packed.eval_at(uv, lod), texture.eval_at(uv, lod));
            }
        }
        let two = Packed::of(&Image { width: 1, height: 1, channels: 2, data: vec![0.0; 2] }).unwrap();
        assert!(Texture::from_packed(Arc::new(two), Vec::new(), Wrap::Repeat, Filter::Nearest).is_err());
    }

    #[test]
    fn texel_adjoint_is_the_transpose_of_the_lookup() {
        for channels in [1, 3] {
            for filter in [Filter::Bilinear, Filter::Nearest] {
                let texture = random_texture(channels, Wrap::Repeat, filter);
                let (uv, d) = (Vec2::new(0.97, 0.36), Vec3::new(0.3, -1.0, 2.0));
                let (mut sum, mut weights) = (0.0, 0.0);
                texture.scatter(uv, d, |i, g| sum += g * texture.data[i]);
                texture.for_each_texel(uv, |_, w| weights += w);
                assert!((sum - d.dot(texture.eval(uv))).abs() < 1e-5);
                assert!((weights - 1.0).abs() < 1e-5);
            }
        }
    }
}
