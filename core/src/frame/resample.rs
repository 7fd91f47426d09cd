//! Area resampling of a square window of the photo to n x n, in linear light, source row by source row.
//!
//! Shrinking: every output pixel is the mean over the box that it covers, with exact weights for the source pixels at
//! the box's border. Growing (window smaller than n): bilinear between source pixel centres. At equal size and whole
//! borders both copy. Sums run in a fixed order: column by column within a row, then row by row.
use super::Crop;
use super::pixels::{Source, Sum};
use crate::exec::{Executor, Plane, ROWS_PER_BLOCK, for_each_row_block, planes3};

/// Source pixels with less weight than this are rounding, not part of a box.
const SLIVER: f64 = 1e-6;

/// A square window of a photo and the pixels to make of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window {
    x: f64,
    y: f64,
    width: usize,
    height: usize,
    step: f64,
    size: usize,
}

impl Window {
    pub(super) fn new(crop: &Crop, width: usize, height: usize, size: usize) -> Self {
        Self { x: crop.x, y: crop.y, width, height, step: crop.side / size as f64, size }
    }
}

/// Consecutive source pixels: the first and last count in part, those between in full.
#[derive(Clone, Copy, Debug)]
struct Cell {
    first: usize,
    last: usize,
    first_weight: f32,
    last_weight: f32,
}

impl Cell {
    /// The box `index` of boxes `step` wide from `origin`, within 0..`limit`.
    fn of_box(origin: f64, step: f64, index: usize, limit: usize) -> Self {
        let start = (origin + step * index as f64).max(0.0);
        let end = (origin + step * (index + 1) as f64).min(limit as f64);
        let mut first = start as usize;
        let mut first_weight = first as f64 + 1.0 - start;
        if first_weight < SLIVER {
            (first, first_weight) = (first + 1, 1.0);
        }
        let mut last = end as usize;
        let mut last_weight = end - last as f64;
        if last_weight < SLIVER {
            (last, last_weight) = (last.saturating_sub(1), 1.0);
        }
        if first >= last {
            let first = first.min(limit - 1);
            return Self { first, last: first, first_weight: (end - start) as f32, last_weight: 0.0 };
        }
        Self { first, last, first_weight: first_weight as f32, last_weight: last_weight as f32 }
    }

    /// The two pixels whose centres lie around the centre of box `index`, at the border the border pixel twice.
    fn between_centres(origin: f64, step: f64, index: usize, limit: usize) -> Self {
        let last = limit - 1;
        let at = (origin + step * (index as f64 + 0.5) - 0.5).clamp(0.0, last as f64);
        let first = (at as usize).min(last);
        let part = (at - first as f64) as f32;
        if part < SLIVER as f32 {
            return Self { first, last: first, first_weight: 1.0, last_weight: 0.0 };
        }
        Self { first, last: (first + 1).min(last), first_weight: 1.0 - part, last_weight: part }
    }
}

/// Fills `rgb` (3 planes of n x n) and `clipped` (1 plane) from the window of `source`.
pub(super) fn run<S: Source>(
    source: &S,
    window: &Window,
    exec: &dyn Executor,
    rgb: &mut [f32],
    clipped: &mut [u8],
) {
    let n = window.size;
    let out = (planes3(rgb, n, n), Plane::new(clipped, n));
    let shrink = window.step >= 1.0;
    let cell = if shrink { Cell::of_box } else { Cell::between_centres };
    let norm = if shrink { (1.0 / (window.step * window.step)) as f32 } else { 1.0 };
    for_each_row_block(exec, n, ROWS_PER_BLOCK, out, &|range, ([mut r, mut g, mut b], mut clipped)| {
        let rows = r.rows().zip(g.rows()).zip(b.rows()).zip(clipped.rows());
        for (i, (((r, g), b), clipped)) in range.zip(rows) {
            clipped.fill(0);
            let rows = cell(window.y, window.step, i, window.height);
            for y in rows.first..=rows.last {
                let weight = if y == rows.first {
                    rows.first_weight
                } else if y == rows.last {
                    rows.last_weight
                } else {
                    1.0
                };
                let pixels = r.iter_mut().zip(g.iter_mut()).zip(b.iter_mut()).zip(clipped.iter_mut());
                for (j, (((r, g), b), clipped)) in pixels.enumerate() {
                    let sum = row_sum(source, y, &cell(window.x, window.step, j, window.width));
                    if y == rows.first {
                        [*r, *g, *b] = sum.rgb.map(|v| v * weight);
                    } else {
                        *r += sum.rgb[0] * weight;
                        *g += sum.rgb[1] * weight;
                        *b += sum.rgb[2] * weight;
                    }
                    *clipped |= u8::from(sum.clipped);
                }
            }
            for value in r.iter_mut().chain(g).chain(b) {
                *value = (*value * norm).min(1.0);
            }
        }
    });
}

/// The weighted sum over a cell's columns of one row.
#[inline]
fn row_sum<S: Source>(source: &S, y: usize, cell: &Cell) -> Sum {
    let first = source.sum(y, cell.first, cell.first + 1);
    let mut sum = Sum { rgb: first.rgb.map(|v| v * cell.first_weight), clipped: first.clipped };
    if cell.last > cell.first {
        let middle = source.sum(y, cell.first + 1, cell.last);
        let last = source.sum(y, cell.last, cell.last + 1);
        for ((sum, m), l) in sum.rgb.iter_mut().zip(middle.rgb).zip(last.rgb) {
            *sum += m + l * cell.last_weight;
        }
        sum.clipped |= middle.clipped | last.clipped;
    }
    sum
}
