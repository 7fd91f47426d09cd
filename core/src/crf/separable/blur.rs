//! A separable Gaussian blur of a plane on a grid of cells, without normalisation. Planes are `size` x `size`; sigma in
//! pixels.
//!
//! A wide Gaussian runs on a coarser grid: pixels are spread on cells of `cell` pixels with linear weights (a tent of
//! variance cell²/6 both ways, taken off the blur's own variance), blurred there and read back with the same weights, so
//! the operator S^T B S stays symmetric and positive, and its cost per pixel does not grow with the image.
use super::cells::{slice_row, splat_row};
use crate::base::exec::{Executor, Plane, for_each_row};
use crate::base::math::{ceilf, expf, sqrtf};
use crate::base::planes::plane_row;
use heapless::Vec;

/// Where the Gaussian ends, in sigmas.
const RADIUS: f32 = 3.5;

/// Narrowest Gaussian on a coarse grid, in cells.
const MIN_SIGMA: f32 = 1.9;

/// Also the zeros between two rows of cells.
const MAX_TAPS: usize = 16;

/// Rows of cells are as long as a multiple of this.
const LANES: usize = 16;

/// A separable Gaussian blur of a plane, without normalisation.
#[derive(Debug)]
pub(super) struct Blur {
    pub(super) size: usize,
    /// Pixels per cell, a power of two.
    cell: usize,
    /// Cells per side, one of margin on each side included.
    cells: usize,
    /// Values from one row of cells to the next: at least [`MAX_TAPS`] zeros lie between.
    stride: usize,
    /// Tap k and -k.
    taps: Vec<f32, MAX_TAPS>,
}

impl Blur {
    /// A blur of `sigma` pixels over `size` x `size` pixels.
    #[must_use]
    pub(super) fn new(size: usize, sigma: f32) -> Self {
        let mut cell = 1;
        while sigma >= MIN_SIGMA * 2.0 * cell as f32 && cell < size {
            cell *= 2;
        }
        let mut variance = sigma * sigma;
        if cell > 1 {
            variance -= (cell * cell) as f32 / 3.0;
        }
        variance /= (cell * cell) as f32;
        let mut taps = Vec::new();
        let _ = taps.push(1.0);
        let radius = ceilf(RADIUS * sqrtf(variance.max(0.0))) as usize;
        for k in 1..=radius {
            // 3.5 sigmas of at most 2 MIN_SIGMA cells fit; what would not is far out on the tail.
            let _ = taps.push(expf(-((k * k) as f32) / (2.0 * variance)));
        }
        let cells = size.div_ceil(cell).saturating_add(2);
        let stride = cells.saturating_add(MAX_TAPS).next_multiple_of(LANES);
        Self { size, cell, cells, stride, taps }
    }

    /// Values in the two buffers of [`Blur::spread`].
    #[must_use]
    pub(super) fn buffer_lens(&self) -> [usize; 2] {
        let grid = self.cells.saturating_mul(self.stride);
        [self.cells.saturating_mul(self.stride.max(self.size)), grid.saturating_add(MAX_TAPS)]
    }

    /// Spreads scale (x - base) on the cells, blurs there and reads back along the rows: `a` then holds
    /// `cells` rows of `size` values, two of which make a row of pixels ([`Blur::between`]).
    pub(super) fn spread(
        &self,
        [x, scale]: [&[f32]; 2],
        base: f32,
        a: &mut [f32],
        b: &mut [f32],
        exec: &dyn Executor,
    ) {
        let (front, rows) = b.split_at_mut(MAX_TAPS.min(b.len()));
        front.fill(0.0);
        self.splat_columns([x, scale], base, a, exec);
        self.splat_rows(a, rows, exec);
        self.blur_rows(b, a, exec);
        self.blur_columns(a, b.get_mut(MAX_TAPS..).unwrap_or(&mut []), exec);
        self.slice_rows(b.get(MAX_TAPS..).unwrap_or(&[]), a, exec);
    }

    /// What [`Blur::spread`] left in `a`, read back to pixels.
    pub(super) fn read(&self, a: &[f32], out: &mut [f32], exec: &dyn Executor) {
        for_each_row(
            exec,
            self.size,
            Plane::new(out, self.size),
            #[inline(always)]
            |y, out| {
                let ([above, below], second) = self.between(a, y);
                for ((out, above), below) in out.iter_mut().zip(above).zip(below) {
                    *out = (1.0 - second) * above + second * below;
                }
            },
        );
    }

    /// The two rows of cells that pixels of row `y` lie between, and the second one's weight.
    #[inline(always)]
    pub(super) fn between<'r>(&self, rows: &'r [f32], y: usize) -> ([&'r [f32]; 2], f32) {
        let n = self.size;
        let (first, second) = self.cell_of(y);
        let row = |c: usize| rows.get(c * n..(c + 1) * n).unwrap_or(&[]);
        ([row(first), row(first + 1)], second)
    }

    /// The first of the two cells of pixel `i` along an axis, and the second one's weight.
    #[inline(always)]
    fn cell_of(&self, i: usize) -> (usize, f32) {
        // Cell c's centre is at pixel coordinate (c - 1/2) cell: one cell of margin on each side.
        let twice = 2 * i + 1 + self.cell;
        let first = twice / (2 * self.cell);
        (first, (twice - 2 * self.cell * first) as f32 / (2 * self.cell) as f32)
    }

    /// Weight of pixel `i` in `cell`.
    #[inline(always)]
    fn weight(&self, i: usize, cell: usize) -> f32 {
        let (first, second) = self.cell_of(i);
        if cell == first {
            1.0 - second
        } else if cell == first + 1 {
            second
        } else {
            0.0
        }
    }

    /// `size` x `size` pixels to `cells` rows of `size`.
    fn splat_columns(&self, [x, scale]: [&[f32]; 2], base: f32, out: &mut [f32], exec: &dyn Executor) {
        let (n, h) = (self.size, self.cell);
        for_each_row(
            exec,
            self.cells,
            Plane::new(out, n),
            #[inline(always)]
            |c, out| {
                out.fill(0.0);
                for y in (c * h).saturating_sub(2 * h)..((c + 1) * h).min(n) {
                    let weight = self.weight(y, c);
                    if weight > 0.0 {
                        add_scaled(weight, plane_row(x, n, y), base, plane_row(scale, n, y), out);
                    }
                }
            },
        );
    }

    /// `cells` rows of `size` to `cells` x `cells`, with zeros up to the stride.
    fn splat_rows(&self, input: &[f32], out: &mut [f32], exec: &dyn Executor) {
        for_each_row(
            exec,
            self.cells,
            Plane::new(out, self.stride),
            #[inline(always)]
            |y, out| {
                out.fill(0.0);
                let row = plane_row(input, self.size, y);
                match self.cell {
                    1 => out.iter_mut().skip(1).zip(row).for_each(|(out, value)| *out = *value),
                    2 => splat_row::<2, 4>(row, out),
                    4 => splat_row::<4, 8>(row, out),
                    8 => splat_row::<8, 16>(row, out),
                    _ => {
                        for (x, value) in row.iter().enumerate() {
                            let (first, second) = self.cell_of(x);
                            if let Some([a, b]) = out.get_mut(first..first + 2) {
                                *a += (1.0 - second) * value;
                                *b += second * value;
                            }
                        }
                    }
                }
            },
        );
    }

    /// Rows of cells, [`MAX_TAPS`] zeros before the first and between any two.
    fn blur_rows(&self, input: &[f32], out: &mut [f32], exec: &dyn Executor) {
        for_each_row(
            exec,
            self.cells,
            Plane::new(out, self.stride),
            #[inline(always)]
            |y, out| {
                let start = MAX_TAPS + y * self.stride;
                let row = |start: usize| input.get(start..start + self.stride).unwrap_or(&[]);
                out.copy_from_slice(row(start));
                // The last row's end has no zeros behind it: what a tap misses there are zeros of its own.
                for (k, &tap) in self.taps.iter().enumerate().skip(1) {
                    let right = input.get(start + k..).unwrap_or(&[]);
                    add_pair(tap, row(start - k), right, out);
                }
            },
        );
    }

    fn blur_columns(&self, input: &[f32], out: &mut [f32], exec: &dyn Executor) {
        for_each_row(
            exec,
            self.cells,
            Plane::new(out, self.stride),
            #[inline(always)]
            |y, out| {
                let row = |y: usize| plane_row(input, self.stride, y);
                out.copy_from_slice(row(y));
                for (k, &tap) in self.taps.iter().enumerate().skip(1) {
                    match (y >= k, y + k < self.cells) {
                        (true, true) => add_pair(tap, row(y - k), row(y + k), out),
                        (true, false) => add_one(tap, row(y - k), out),
                        (false, true) => add_one(tap, row(y + k), out),
                        (false, false) => break,
                    }
                }
            },
        );
    }

    /// `cells` x `cells` to `cells` rows of `size`.
    fn slice_rows(&self, input: &[f32], out: &mut [f32], exec: &dyn Executor) {
        for_each_row(
            exec,
            self.cells,
            Plane::new(out, self.size),
            #[inline(always)]
            |y, out| {
                let row = plane_row(input, self.stride, y);
                match self.cell {
                    1 => out.iter_mut().zip(row.iter().skip(1)).for_each(|(out, value)| *out = *value),
                    2 => slice_row::<2>(row, out),
                    4 => slice_row::<4>(row, out),
                    8 => slice_row::<8>(row, out),
                    _ => {
                        for (x, out) in out.iter_mut().enumerate() {
                            let (first, second) = self.cell_of(x);
                            if let Some(&[a, b]) = row.get(first..first + 2) {
                                *out = (1.0 - second) * a + second * b;
                            }
                        }
                    }
                }
            },
        );
    }
}

/// out += weight scale (x - base).
#[inline(always)]
fn add_scaled(weight: f32, x: &[f32], base: f32, scale: &[f32], out: &mut [f32]) {
    for ((out, x), scale) in out.iter_mut().zip(x).zip(scale) {
        *out += weight * (scale * (x - base));
    }
}

/// out += tap (a + b).
#[inline(always)]
fn add_pair(tap: f32, a: &[f32], b: &[f32], out: &mut [f32]) {
    for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
        *out += tap * (a + b);
    }
}

/// out += tap a.
#[inline(always)]
fn add_one(tap: f32, a: &[f32], out: &mut [f32]) {
    for (out, a) in out.iter_mut().zip(a) {
        *out += tap * a;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::exec::Inline;
    use std::vec;
    use std::vec::Vec;

    fn impulse_response(size: usize, sigma: f32, x: usize, y: usize) -> Vec<f32> {
        let blur = Blur::new(size, sigma);
        let mut plane = vec![0.0; size * size];
        plane[y * size + x] = 1.0;
        let [mut a, mut b] = blur.buffer_lens().map(|len| vec![f32::NAN; len]);
        blur.spread([&plane, &vec![1.0; size * size]], 0.0, &mut a, &mut b, &Inline);
        blur.read(&a, &mut plane, &Inline);
        plane
    }

    #[test]
    fn narrow_blurs_are_gaussians() {
        for sigma in [0.48_f32, 0.96, 2.3, 3.7] {
            let (size, cx, cy) = (33, 12, 20);
            let plane = impulse_response(size, sigma, cx, cy);
            for y in 0..size {
                for x in 0..size {
                    let d2 = (x.abs_diff(cx).pow(2) + y.abs_diff(cy).pow(2)) as f32;
                    let exact = (-d2 / (2.0 * sigma * sigma)).exp();
                    assert!((plane[y * size + x] - exact).abs() < 3e-3, "{sigma} {x} {y}");
                }
            }
        }
    }

    #[test]
    fn wide_blurs_on_a_coarse_grid_are_gaussians_to_two_percent_of_their_peak() {
        for (size, sigma) in [(64, 3.84_f32), (65, 5.12), (128, 9.0), (130, 10.24)] {
            assert!(Blur::new(size, sigma).cell > 1);
            for (cx, cy) in [(31, 32), (30, 33), (0, size - 1)] {
                let plane = impulse_response(size, sigma, cx, cy);
                let peak = plane[cy * size + cx];
                let blur = Blur::new(size, sigma);
                // Of the same mass as the exact one, up to the cell's area.
                let unit = (blur.cell * blur.cell) as f32;
                let mut worst = 0.0_f32;
                for y in 0..size {
                    for x in 0..size {
                        let d2 = (x.abs_diff(cx).pow(2) + y.abs_diff(cy).pow(2)) as f32;
                        let exact = (-d2 / (2.0 * sigma * sigma)).exp();
                        worst = worst.max((plane[y * size + x] / peak - exact).abs());
                    }
                }
                assert!(worst < 0.03, "{size} {sigma} {cx} {cy} {unit}: {worst}");
            }
        }
    }

    #[test]
    fn the_blur_is_symmetric() {
        for (size, sigma) in [(20, 1.3_f32), (40, 5.0)] {
            let ab = impulse_response(size, sigma, 7, 9)[11 * size + 3];
            let ba = impulse_response(size, sigma, 3, 11)[9 * size + 7];
            assert!((ab - ba).abs() < 1e-6);
        }
    }

    #[test]
    fn tiny_images_are_blurred_too() {
        for size in 1..6 {
            for sigma in [0.3, 1.0, 4.0, 50.0] {
                let plane = impulse_response(size, sigma, 0, 0);
                assert!(plane.iter().all(|v| v.is_finite() && *v >= 0.0) && plane[0] > 0.0, "{size} {sigma}");
            }
        }
    }
}
