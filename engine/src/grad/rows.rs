//! The derivative of an image as a sparse matrix: a row for each number of the image, a column for each number of the requested slots.
//! Its samples are drawn once, and every product with the matrix or with its transpose is computed from the same numbers. Solvers that
//! ask for many products, such as conjugate gradients, need that: forward and reverse mode draw other samples, so that the one is not the
//! transpose of the other, and they draw them anew for every product.

use std::ops::Range;
use std::sync::atomic::AtomicBool;

use glam::Vec3;

use crate::grad::estimate::{Estimate, Pass, run};
use crate::grad::sink::{Adjoints, Layout, Sink};
use crate::memory::need;
use crate::ranks::{self, Packed};
use crate::render::Scene;
use crate::stop::Pace;

/// Items of a chunk, and chunks that are at work together. Both decide the order of entries, and so of sums.
const CHUNK: usize = 1024;
const TOGETHER: usize = 64;

/// Entries of one pixel and channel that are collected before those of the same column are added up.
const LOOSE: usize = 1 << 14;

/// A sparse matrix. Several runs of entries may belong to one row; they are added.
pub struct Rows {
    /// Numbers of the image, and of all slots.
    height: usize,
    width: usize,
    channels: usize,
    runs: Vec<Run>,
    columns: Vec<u32>,
    values: Vec<f32>,
    /// Most entries.
    room: usize,
}

/// Consecutive entries of the matrix.
#[derive(Clone, Copy)]
struct Run {
    /// The first of the rows that have these entries, and how many there are: where all is grey, the channels of a pixel have the same.
    row: u32,
    rows: u32,
    /// Where the entries end.
    end: u32,
}

impl Rows {
    /// A matrix without entries, for an image of so many pixels. It will not have more than about `room` entries.
    pub fn new(pixels: usize, channels: usize, width: usize, room: usize) -> Rows {
        let room = room.min(u32::MAX as usize);
        let (runs, columns, values) = (Vec::new(), Vec::new(), Vec::new());
        Rows { height: pixels * channels, width, channels, runs, columns, values, room }
    }

    /// Number of entries.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Whether there are no entries.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Whether there are more entries than there is room for. Then some are missing.
    pub fn is_full(&self) -> bool {
        self.values.len() > self.room
    }

    /// The matrix times `x`, which has a number for each number of the slots.
    pub fn times(&self, x: &[f64]) -> Vec<f64> {
        let mut product = vec![0.0; self.height];
        self.for_each_run(|rows, entries| {
            let (columns, values) = (&self.columns[entries.clone()], &self.values[entries]);
            let sum: f64 = columns.iter().zip(values).map(|(c, v)| f64::from(*v) * x[*c as usize]).sum();
            product[rows].iter_mut().for_each(|p| *p += sum);
        });
        product
    }

    /// The transposed matrix times `y`, which has a number for each number of the image.
    pub fn transposed_times(&self, y: &[f64]) -> Vec<f64> {
        let mut product = vec![0.0; self.width];
        self.for_each_run(|rows, entries| {
            let (columns, values) = (&self.columns[entries.clone()], &self.values[entries]);
            let weight: f64 = y[rows].iter().sum();
            columns.iter().zip(values).for_each(|(c, v)| product[*c as usize] += f64::from(*v) * weight);
        });
        product
    }

    fn for_each_run(&self, mut f: impl FnMut(Range<usize>, Range<usize>)) {
        let mut pace = Pace::default();
        let mut start = 0;
        for run in &self.runs {
            let (row, end) = (run.row as usize, run.end as usize);
            pace.step(end - start);
            f(row..row + run.rows as usize, start..end);
            start = end;
        }
    }

    /// Draws the samples of a pass and adds their derivatives, until `stop` is set or there is no room.
    pub(super) fn add(&mut self, scene: &Scene, layout: &Layout, pass: &dyn Pass, stop: &AtomicBool) {
        let channels = self.channels;
        self.add_parts(pass.items(), &|range| {
            let mut record = Record::new(scene, layout, channels);
            run(pass, range, &mut record, stop);
            record.finish();
            record.part
        });
    }

    /// Has all chunks of the items recorded in parallel and adds their entries, until there is no room.
    fn add_parts(&mut self, items: usize, recorded: &(dyn Fn(Range<usize>) -> Part + Sync)) {
        let len = items.div_ceil(TOGETHER).clamp(1, CHUNK);
        for start in (0..items).step_by(TOGETHER * len) {
            if self.is_full() {
                return;
            }
            let end = (start + TOGETHER * len).min(items);
            let chunk = |chunk: usize| {
                let first = start + chunk * len;
                recorded(first..(first + len).min(end))
            };
            let parts: Vec<Part> = ranks::map((end - start).div_ceil(len), &chunk);
            // Arrays that grow are twice as large for a moment.
            need(16 * parts.iter().map(|part| part.values.len() as u64).sum::<u64>());
            for part in parts {
                let before = self.values.len() as u32;
                self.runs.extend(part.runs.into_iter().map(|run| Run { end: before + run.end, ..run }));
                self.columns.extend(part.columns);
                self.values.extend(part.values);
                if self.is_full() {
                    return;
                }
            }
        }
    }
}

/// The entries of a chunk of samples.
#[derive(Default)]
struct Part {
    runs: Vec<Run>,
    columns: Vec<u32>,
    values: Vec<f32>,
}

impl Packed for Part {
    fn pack(&self, to: &mut Vec<u8>) {
        self.runs.iter().map(|run| [run.row, run.rows, run.end]).collect::<Vec<[u32; 3]>>().pack(to);
        self.columns.pack(to);
        self.values.pack(to);
    }

    fn unpack(from: &mut &[u8]) -> Option<Part> {
        let runs = Vec::<[u32; 3]>::unpack(from)?;
        let runs = runs.into_iter().map(|[row, rows, end]| Run { row, rows, end }).collect();
        Some(Part { runs, columns: Vec::unpack(from)?, values: Vec::unpack(from)? })
    }
}

/// Takes derivatives one by one, with the numbers that they are derivatives in.
#[derive(Default)]
struct Entries {
    loose: Vec<(u32, f64)>,
    /// Number of entries after the last [`Entries::merge`].
    merged: usize,
}

impl Sink for Entries {
    #[inline]
    fn add(&mut self, index: usize, value: f32) {
        if value != 0.0 {
            self.loose.push((index as u32, f64::from(value)));
            if self.loose.len() > self.merged + LOOSE {
                self.merge();
            }
        }
    }
}

impl Entries {
    /// Adds up the entries of each column, and sorts them by column.
    fn merge(&mut self) {
        // Whatever the order within a column, it is always the same one.
        self.loose.sort_unstable_by_key(|(column, _)| *column);
        self.loose.dedup_by(|next, first| {
            let same = next.0 == first.0;
            if same {
                first.1 += next.1;
            }
            same
        });
        self.merged = self.loose.len();
    }
}

/// Records the derivatives of pixels, channel by channel.
struct Record<'a> {
    scene: &'a Scene,
    layout: &'a Layout,
    channels: usize,
    /// The pixel of the latest samples, and the entries of its channels.
    pixel: usize,
    entries: [Entries; 3],
    part: Part,
}

impl<'a> Record<'a> {
    fn new(scene: &'a Scene, layout: &'a Layout, channels: usize) -> Record<'a> {
        Record { scene, layout, channels, pixel: 0, entries: Default::default(), part: Part::default() }
    }

    /// Writes the entries of the latest pixel down.
    fn finish(&mut self) {
        let entries = &mut self.entries[..self.channels];
        let row = (self.pixel * self.channels) as u32;
        let alike = entries.iter().all(|e| e.loose == entries[0].loose);
        let rows = if alike { self.channels as u32 } else { 1 };
        let written = if alike { 1 } else { self.channels };
        entries[..written].iter_mut().for_each(Entries::merge);
        for (channel, entries) in entries[..written].iter().enumerate().filter(|(_, e)| !e.loose.is_empty()) {
            self.part.columns.extend(entries.loose.iter().map(|(column, _)| *column));
            self.part.values.extend(entries.loose.iter().map(|(_, value)| *value as f32));
            self.part.runs.push(Run { row: row + channel as u32, rows, end: self.part.values.len() as u32 });
        }
        for entries in entries {
            entries.loose.clear();
            entries.merged = 0;
        }
    }
}

impl Estimate for Record<'_> {
    fn pixels(&mut self, pixels: &[(u32, f32)], f: &mut dyn FnMut(Vec3, &mut Adjoints)) {
        for &(pixel, weight) in pixels {
            if self.pixel != pixel as usize {
                self.finish();
                self.pixel = pixel as usize;
            }
            for channel in 0..self.channels {
                let mut out = Adjoints::new(self.scene, self.layout, &mut self.entries[channel]);
                f(Vec3::AXES[channel] * weight, &mut out);
                out.flush_camera();
            }
        }
    }

    fn skips(&self, _: &[(u32, f32)]) -> bool {
        false
    }
}
