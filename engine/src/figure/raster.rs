//! Marks as pixels, with soft edges: how much of a pixel a mark covers is how much of its colour the pixel takes.

use super::letters;
use super::{Anchor, Colour, INK, Mark, Words};
use crate::image::{ImageError, file};

/// Pixels of the picture for each of the SVG.
const SCALE: f64 = 2.0;

/// Rows of samples in a row of pixels, in which areas are cut exactly.
const ROWS: usize = 4;

/// Colours as sRGB stores them, from 0 to 1.
pub(super) struct Picture {
    width: usize,
    height: usize,
    pixels: Vec<[f64; 3]>,
}

pub(super) fn draw(size: [f64; 2], marks: &[Mark]) -> Picture {
    let [width, height] = size.map(|side| (side * SCALE).ceil() as usize);
    let mut picture = Picture { width, height, pixels: vec![[1.0; 3]; width * height] };
    for mark in marks {
        match mark {
            Mark::Line { points, colour, width, dashed, .. } => {
                let points = scaled(points);
                let pieces = if *dashed { dashes(&points, 6.0 * SCALE, 4.0 * SCALE) } else { vec![points] };
                picture.strokes(&pieces, width * SCALE, *colour);
            }
            Mark::Area { points, colour, opacity } => picture.area(&scaled(points), *colour, *opacity),
            Mark::Dot { at, radius, colour } => picture.strokes(&[scaled(&[*at])], 2.0 * radius * SCALE, *colour),
            Mark::Words(words) => picture.words(words),
        }
    }
    picture
}

fn scaled(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    points.iter().map(|p| p.map(|x| x * SCALE)).collect()
}

impl Picture {
    pub(super) fn encoded(&self) -> Result<Vec<u8>, ImageError> {
        let bytes: Vec<u8> = self.pixels.iter().flatten().map(|c| (c * 255.0).round() as u8).collect();
        file::encode_bytes(self.width, self.height, 3, &bytes)
    }

    /// Draws lines through points, with round ends and corners. Where they meet or cross they are no darker.
    fn strokes(&mut self, lines: &[Vec<[f64; 2]>], width: f64, colour: Colour) {
        let reach = width / 2.0 + 1.0;
        let Some(mut cover) = Cover::around(lines.iter().flatten(), reach, [self.width, self.height]) else { return };
        for line in lines {
            match line[..] {
                [point] => cover.segment(point, point, width),
                _ => line.windows(2).for_each(|w| cover.segment(w[0], w[1], width)),
            }
        }
        self.blend(&cover, colour, 1.0);
    }

    fn area(&mut self, corners: &[[f64; 2]], colour: Colour, opacity: f64) {
        let Some(mut cover) = Cover::around(corners.iter(), 1.0, [self.width, self.height]) else { return };
        cover.polygon(corners);
        self.blend(&cover, colour, opacity);
    }

    fn words(&mut self, words: &Words) {
        let size = words.size * SCALE;
        let back = match words.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => 0.5,
            Anchor::End => 1.0,
        } * letters::width(&words.text, size);
        let [x, y] = words.at.map(|x| x * SCALE);
        let place = |[dx, dy]: [f64; 2]| {
            let along = dx - back;
            if words.upright { [x - dy, y - along] } else { [x + along, y - dy] }
        };
        let lines = letters::strokes(&words.text, size);
        let lines: Vec<Vec<[f64; 2]>> = lines.into_iter().map(|line| line.into_iter().map(place).collect()).collect();
        self.strokes(&lines, 0.085 * size, INK);
    }

    fn blend(&mut self, cover: &Cover, colour: Colour, opacity: f64) {
        for (row, covers) in cover.shares.chunks_exact(cover.width).enumerate() {
            let start = (cover.top + row) * self.width + cover.left;
            for (pixel, share) in self.pixels[start..start + cover.width].iter_mut().zip(covers) {
                let share = f64::from(*share).min(1.0) * opacity;
                for (own, new) in pixel.iter_mut().zip(colour) {
                    *own += (f64::from(new) / 255.0 - *own) * share;
                }
            }
        }
    }
}

/// How much of each pixel of a rectangle is covered.
struct Cover {
    left: usize,
    top: usize,
    width: usize,
    shares: Vec<f32>,
}

impl Cover {
    /// The pixels within `reach` of points, if there are some in the picture.
    fn around<'a>(
        points: impl Iterator<Item = &'a [f64; 2]> + Clone,
        reach: f64,
        picture: [usize; 2],
    ) -> Option<Cover> {
        let side = |axis: usize| {
            let all = || points.clone().map(|p| p[axis]);
            let (low, high) = (all().fold(f64::INFINITY, f64::min), all().fold(f64::NEG_INFINITY, f64::max));
            let first = (low - reach).floor().clamp(0.0, picture[axis] as f64) as usize;
            let last = (high + reach).ceil().clamp(0.0, picture[axis] as f64) as usize;
            (first, last.saturating_sub(first))
        };
        let ((left, width), (top, height)) = (side(0), side(1));
        (width > 0 && height > 0).then(|| Cover { left, top, width, shares: vec![0.0; width * height] })
    }

    fn height(&self) -> usize {
        self.shares.len() / self.width
    }

    /// Covers what is within half a width of the straight line between two points.
    fn segment(&mut self, a: [f64; 2], b: [f64; 2], width: f64) {
        let reach = width / 2.0 + 0.5;
        let range = |from: f64, to: f64, first: usize, count: usize| {
            let low = (from.min(to) - reach - first as f64).floor().clamp(0.0, count as f64) as usize;
            let high = (from.max(to) + reach - first as f64).ceil().clamp(0.0, count as f64) as usize;
            low..high
        };
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let square = dx * dx + dy * dy;
        for row in range(a[1], b[1], self.top, self.height()) {
            for column in range(a[0], b[0], self.left, self.width) {
                let (x, y) = ((self.left + column) as f64 + 0.5 - a[0], (self.top + row) as f64 + 0.5 - a[1]);
                let t = if square > 0.0 { ((x * dx + y * dy) / square).clamp(0.0, 1.0) } else { 0.0 };
                let distance = (x - t * dx).hypot(y - t * dy);
                let share = &mut self.shares[row * self.width + column];
                *share = share.max((reach - distance).clamp(0.0, 1.0) as f32);
            }
        }
    }

    /// Covers the inside of a closed polygon, which is what it winds around.
    fn polygon(&mut self, corners: &[[f64; 2]]) {
        let edges = || corners.iter().zip(corners.iter().cycle().skip(1));
        let mut crossings: Vec<(f64, i32)> = Vec::new();
        for sample in 0..self.height() * ROWS {
            let y = self.top as f64 + (sample as f64 + 0.5) / ROWS as f64;
            crossings.clear();
            for ([ax, ay], [bx, by]) in edges() {
                if (*ay <= y) != (*by <= y) {
                    crossings.push((ax + (y - ay) / (by - ay) * (bx - ax), if ay < by { 1 } else { -1 }));
                }
            }
            crossings.sort_by(|a, b| a.0.total_cmp(&b.0));
            let row = sample / ROWS * self.width;
            let mut winding = 0;
            for pair in crossings.windows(2) {
                winding += pair[0].1;
                if winding == 0 {
                    continue;
                }
                let [from, to] = [pair[0].0, pair[1].0].map(|x| (x - self.left as f64).clamp(0.0, self.width as f64));
                for column in from.floor() as usize..(to.ceil() as usize).min(self.width) {
                    let within = to.min(column as f64 + 1.0) - from.max(column as f64);
                    self.shares[row + column] += (within.max(0.0) / ROWS as f64) as f32;
                }
            }
        }
    }
}

/// The parts of a line that are drawn where it is dashed.
fn dashes(points: &[[f64; 2]], on: f64, off: f64) -> Vec<Vec<[f64; 2]>> {
    let mut pieces: Vec<Vec<[f64; 2]>> = Vec::new();
    let mut current: Vec<[f64; 2]> = points.first().copied().into_iter().collect();
    let (mut drawn, mut left) = (true, on);
    for w in points.windows(2) {
        let (dx, dy) = (w[1][0] - w[0][0], w[1][1] - w[0][1]);
        let length = dx.hypot(dy);
        let mut at = 0.0;
        while length - at > left {
            at += left;
            let point = [w[0][0] + dx * at / length, w[0][1] + dy * at / length];
            if drawn {
                current.push(point);
                pieces.push(std::mem::take(&mut current));
            } else {
                current = vec![point];
            }
            (drawn, left) = (!drawn, if drawn { off } else { on });
        }
        left -= length - at;
        if drawn {
            current.push(w[1]);
        }
    }
    pieces.extend((!current.is_empty()).then_some(current));
    pieces
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cover() -> Cover {
        Cover { left: 2, top: 1, width: 6, shares: vec![0.0; 30] }
    }

    #[test]
    fn areas_cover_their_area() {
        let mut found = cover();
        // A parallelogram of 3 × 2 pixels.
        found.polygon(&[[3.25, 2.0], [6.25, 2.0], [6.75, 4.0], [3.75, 4.0]]);
        let sum: f32 = found.shares.iter().sum();
        assert!((sum - 6.0).abs() < 1e-5, "{sum}");
        assert_eq!(found.shares[6 + 2], 1.0);
    }

    #[test]
    fn lines_are_as_wide_as_they_say() {
        let mut found = cover();
        found.segment([0.0, 3.0], [20.0, 3.0], 2.0);
        let column: Vec<f32> = (0..5).map(|row| found.shares[row * 6 + 3]).collect();
        assert_eq!(column, [0.0, 1.0, 1.0, 0.0, 0.0]);
    }

    #[test]
    fn dashes_go_around_corners() {
        let pieces = dashes(&[[0.0, 0.0], [5.0, 0.0], [5.0, 5.0]], 3.0, 1.0);
        let expected =
            vec![vec![[0.0, 0.0], [3.0, 0.0]], vec![[4.0, 0.0], [5.0, 0.0], [5.0, 2.0]], vec![[5.0, 3.0], [5.0, 5.0]]];
        assert_eq!(pieces, expected);
    }
}
