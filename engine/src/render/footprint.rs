//! Which pixels a film position counts for, and which part of the film an image sees.

use glam::Vec2;

use super::pixel_filter::PixelFilter;
use super::scene::Camera;

/// The pixels whose filters cover a film position, with the filters' values there.
#[derive(Clone, Copy, Debug)]
pub struct Footprint {
    pixels: [(u32, f32); Footprint::MOST],
    len: usize,
}

impl Footprint {
    /// Most pixels: four rows and four columns.
    const MOST: usize = 16;

    /// Pairs of a pixel's index in the image and the value of its filter.
    pub fn pixels(&self) -> &[(u32, f32)] {
        &self.pixels[..self.len]
    }
}

impl Camera {
    /// How far, in pixels, the filter reaches beyond the borders of the image.
    pub fn margin(&self) -> f32 {
        self.filter.radius() - 0.5
    }

    /// The lower and the upper corner of what the image's pixels see of the film.
    pub fn seen_film(&self) -> [Vec2; 2] {
        let size = Vec2::new(self.width as f32, self.height as f32);
        [self.corner() - self.margin(), self.corner() + size + self.margin()]
    }

    /// Whether a film position is seen by a pixel.
    pub fn on_film(&self, position: Vec2) -> bool {
        let [low, high] = self.seen_film();
        position.cmpge(low).all() && position.cmplt(high).all()
    }

    /// How the weight of a pixel that sees a film position changes with the position.
    pub fn slope(&self, pixel: u32, position: Vec2) -> Vec2 {
        let (x, y) = (pixel as usize % self.width, pixel as usize / self.width);
        self.filter.slope(position - self.corner() - Vec2::new(x as f32, y as f32) - 0.5)
    }

    /// The pixels that see a film position.
    pub fn footprint(&self, position: Vec2) -> Footprint {
        let mut footprint = Footprint { pixels: [(0, 0.0); Footprint::MOST], len: 0 };
        if !self.on_film(position) {
            return footprint;
        }
        let position = position - self.corner();
        if self.filter == PixelFilter::Box {
            let pixel = position.y as usize * self.width + position.x as usize;
            return Footprint { pixels: [(pixel as u32, 1.0); Footprint::MOST], len: 1 };
        }
        let around = |x: f32, size: usize| {
            let first = (x - 0.5 - self.filter.radius()).ceil().max(0.0) as usize;
            first..((x - 0.5 + self.filter.radius()).floor() as usize + 1).min(size)
        };
        for y in around(position.y, self.height) {
            for x in around(position.x, self.width) {
                let weight = self.filter.weight(position - Vec2::new(x as f32, y as f32) - 0.5);
                if weight != 0.0
                    && let Some(next) = footprint.pixels.get_mut(footprint.len)
                {
                    *next = ((y * self.width + x) as u32, weight);
                    footprint.len += 1;
                }
            }
        }
        footprint
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Pcg32;
    use glam::Vec3;

    fn camera(filter: PixelFilter) -> Camera {
        Camera { filter, ..Camera::look_at(Vec3::ZERO, Vec3::Z, Vec3::Y, 1.0, [9, 7]) }
    }

    /// A footprint has all pixels whose filter is not zero, and its weights are those of the filter.
    #[test]
    fn footprints_are_complete() {
        let mut rng = Pcg32::new(3);
        for (_, filter) in PixelFilter::NAMES {
            let camera = camera(filter);
            for _ in 0..2000 {
                let position = Vec2::new(rng.next_f32() * 15.0 - 3.0, rng.next_f32() * 13.0 - 3.0);
                let footprint = camera.footprint(position);
                for pixel in 0..63u32 {
                    let centre = Vec2::new((pixel % 9) as f32, (pixel / 9) as f32) + 0.5;
                    let expected = filter.weight(position - centre);
                    let found: f32 = footprint.pixels().iter().filter(|(p, _)| *p == pixel).map(|(_, w)| w).sum();
                    assert!(
                        (found - expected).abs() < 1e-6,
                        "{filter:?}, {pixel} at {position}: {found} of {expected}"
                    );
                }
            }
        }
    }
}
