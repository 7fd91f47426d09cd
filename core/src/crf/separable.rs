//! kappa_1: a Gaussian of the distance in pixels only, as a separable blur, symmetrically normalised.
//!
//! Pixels beyond the border do not exist: sums run over the image only, and D^-1/2 G D^-1/2 makes up for it. A wide
//! Gaussian runs on a coarser grid: pixels are spread on cells of `cell` pixels with linear weights (a tent of variance
//! cell²/6 both ways, taken off the blur's own variance), blurred there and read back with the same weights, so the
//! operator S^T B S stays symmetric and positive, and its cost per pixel does not grow with the image.
//! Planes are `size` x `size`; sigma in pixels.
use super::solver::{dot, tail};
use crate::Error;
use crate::arena::{Arena, bytes_for};
use crate::exec::{Executor, Plane, ROWS_PER_BLOCK, for_each_row_block};
use crate::math::{ceilf, expf, sqrtf};
use heapless::Vec;

/// Where the Gaussian ends, in sigmas.
const RADIUS: f32 = 3.5;

/// Narrowest Gaussian on a coarse grid, in cells.
const MIN_SIGMA: f32 = 1.9;

const MAX_TAPS: usize = 16;

/// A separable Gaussian blur of a plane, without normalisation.
#[derive(Debug)]
pub struct Blur {
    size: usize,
    cell: usize,
    cells: usize,
    /// Tap k and -k.
    taps: Vec<f32, MAX_TAPS>,
}

impl Blur {
    /// A blur of `sigma` pixels over `size` x `size` pixels.
    #[must_use]
    pub fn new(size: usize, sigma: f32) -> Self {
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
        let cells = if cell == 1 { size } else { size.div_ceil(cell) + 2 };
        Self { size, cell, cells, taps }
    }

    /// Values in the two buffers of [`Blur::run`].
    #[must_use]
    pub fn buffer_lens(&self) -> [usize; 2] {
        if self.cell == 1 {
            return [self.size * self.size, 0];
        }
        [self.cells * self.cells.max(self.size), self.cells * self.cells]
    }

    /// Blurs `plane` in place; `a` and `b` are buffers of [`Blur::buffer_lens`] values.
    pub fn run(&self, plane: &mut [f32], a: &mut [f32], b: &mut [f32], exec: &dyn Executor) {
        let (n, m) = (self.size, self.cells);
        if self.cell == 1 {
            self.blur_rows(plane, a, n, exec);
            self.blur_columns(a, plane, n, exec);
            return;
        }
        self.splat_columns(plane, a, exec);
        self.splat_rows(a, b, exec);
        self.blur_rows(b, a, m, exec);
        self.blur_columns(a, b, m, exec);
        self.slice_rows(b, a, exec);
        self.slice_columns(a, plane, exec);
    }

    fn blur_rows(&self, input: &[f32], out: &mut [f32], width: usize, exec: &dyn Executor) {
        let out = Plane::new(out.get_mut(..width * width).unwrap_or(&mut []), width);
        for_each_row_block(exec, width, ROWS_PER_BLOCK, out, &|rows, mut block| {
            for (y, out) in rows.zip(block.rows()) {
                let row = input.get(y * width..(y + 1) * width).unwrap_or(&[]);
                out.copy_from_slice(row);
                for (k, &tap) in self.taps.iter().enumerate().skip(1).take_while(|&(k, _)| k < width) {
                    for (out, value) in out.iter_mut().zip(row.get(k..).unwrap_or(&[])) {
                        *out += tap * value;
                    }
                    for (out, value) in out.get_mut(k..).unwrap_or(&mut []).iter_mut().zip(row) {
                        *out += tap * value;
                    }
                }
            }
        });
    }

    fn blur_columns(&self, input: &[f32], out: &mut [f32], width: usize, exec: &dyn Executor) {
        let out = Plane::new(out.get_mut(..width * width).unwrap_or(&mut []), width);
        for_each_row_block(exec, width, ROWS_PER_BLOCK, out, &|rows, mut block| {
            for (y, out) in rows.zip(block.rows()) {
                let row = |y: usize| input.get(y * width..(y + 1) * width).unwrap_or(&[]);
                out.copy_from_slice(row(y));
                for (k, &tap) in self.taps.iter().enumerate().skip(1) {
                    if y >= k {
                        out.iter_mut().zip(row(y - k)).for_each(|(out, value)| *out += tap * value);
                    }
                    if y + k < width {
                        out.iter_mut().zip(row(y + k)).for_each(|(out, value)| *out += tap * value);
                    }
                }
            }
        });
    }

    /// The first of the two cells of pixel `i` along an axis, and the second one's weight.
    fn cell_of(&self, i: usize) -> (usize, f32) {
        // Cell c's centre is at pixel coordinate (c - 1/2) cell: one cell of margin on each side.
        let twice = 2 * i + 1 + self.cell;
        let first = twice / (2 * self.cell);
        (first, (twice - 2 * self.cell * first) as f32 / (2 * self.cell) as f32)
    }

    /// Weight of pixel `i` in `cell`.
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
    fn splat_columns(&self, plane: &[f32], out: &mut [f32], exec: &dyn Executor) {
        let (n, h) = (self.size, self.cell);
        for_each_row_block(exec, self.cells, ROWS_PER_BLOCK, Plane::new(out, n), &|rows, mut block| {
            for (c, out) in rows.zip(block.rows()) {
                out.fill(0.0);
                for y in (c * h).saturating_sub(2 * h)..((c + 1) * h).min(n) {
                    let weight = self.weight(y, c);
                    if weight > 0.0 {
                        let row = plane.get(y * n..(y + 1) * n).unwrap_or(&[]);
                        out.iter_mut().zip(row).for_each(|(out, value)| *out += weight * value);
                    }
                }
            }
        });
    }

    /// `cells` rows of `size` to `cells` x `cells`.
    fn splat_rows(&self, input: &[f32], out: &mut [f32], exec: &dyn Executor) {
        let n = self.size;
        for_each_row_block(
            exec,
            self.cells,
            ROWS_PER_BLOCK,
            Plane::new(out, self.cells),
            &|rows, mut block| {
                for (c, out) in rows.zip(block.rows()) {
                    out.fill(0.0);
                    let row = input.get(c * n..(c + 1) * n).unwrap_or(&[]);
                    for (x, value) in row.iter().enumerate() {
                        let (first, second) = self.cell_of(x);
                        if let Some([a, b]) = out.get_mut(first..first + 2) {
                            *a += (1.0 - second) * value;
                            *b += second * value;
                        }
                    }
                }
            },
        );
    }

    /// `cells` x `cells` to `cells` rows of `size`.
    fn slice_rows(&self, input: &[f32], out: &mut [f32], exec: &dyn Executor) {
        let m = self.cells;
        for_each_row_block(exec, m, ROWS_PER_BLOCK, Plane::new(out, self.size), &|rows, mut block| {
            for (c, out) in rows.zip(block.rows()) {
                let row = input.get(c * m..(c + 1) * m).unwrap_or(&[]);
                for (x, out) in out.iter_mut().enumerate() {
                    let (first, second) = self.cell_of(x);
                    if let Some(&[a, b]) = row.get(first..first + 2) {
                        *out = (1.0 - second) * a + second * b;
                    }
                }
            }
        });
    }

    /// `cells` rows of `size` to `size` x `size` pixels.
    fn slice_columns(&self, input: &[f32], plane: &mut [f32], exec: &dyn Executor) {
        let n = self.size;
        for_each_row_block(exec, n, ROWS_PER_BLOCK, Plane::new(plane, n), &|rows, mut block| {
            for (y, out) in rows.zip(block.rows()) {
                let (first, second) = self.cell_of(y);
                let row = |c: usize| input.get(c * n..(c + 1) * n).unwrap_or(&[]);
                for ((out, a), b) in out.iter_mut().zip(row(first)).zip(row(first + 1)) {
                    *out = (1.0 - second) * a + second * b;
                }
            }
        });
    }
}

/// The Laplacian of the normalised blur: L x = rho x - s G (s x), with s = 1/sqrt(G 1) and rho = s G s.
#[derive(Debug)]
pub struct Spatial<'a> {
    blur: Blur,
    weight: f32,
    scale: &'a mut [f32],
    row_sum: &'a mut [f32],
    plane: &'a mut [f32],
    buffers: [&'a mut [f32]; 2],
}

impl<'a> Spatial<'a> {
    /// Bytes that stay taken after [`Spatial::new`].
    #[must_use]
    pub fn bytes(size: usize, sigma: f32) -> usize {
        let plane = bytes_for::<f32>(size.saturating_mul(size));
        let [a, b] = Blur::new(size, sigma).buffer_lens().map(bytes_for::<f32>);
        plane.saturating_mul(3).saturating_add(a).saturating_add(b)
    }

    /// The normalised blur of `sigma` pixels over `size` x `size` pixels, its Laplacian multiplied by `weight`.
    ///
    /// # Errors
    /// [`Error::WorkspaceTooSmall`].
    pub fn new(
        size: usize,
        sigma: f32,
        weight: f32,
        exec: &dyn Executor,
        arena: &mut Arena<'a>,
    ) -> Result<Self, Error> {
        let blur = Blur::new(size, sigma);
        let n2 = size.saturating_mul(size);
        let [scale, row_sum, plane] = [arena.take(n2)?, arena.take(n2)?, arena.take::<f32>(n2)?];
        let [a, b] = blur.buffer_lens();
        let [a, b] = [arena.take(a)?, arena.take(b)?];
        plane.fill(1.0);
        blur.run(plane, a, b, exec);
        for (scale, &sum) in scale.iter_mut().zip(&*plane) {
            *scale = 1.0 / sqrtf(sum);
        }
        plane.copy_from_slice(scale);
        blur.run(plane, a, b, exec);
        for ((sum, &blurred), &scale) in row_sum.iter_mut().zip(&*plane).zip(&*scale) {
            *sum = scale * blurred;
        }
        Ok(Self { blur, weight, scale, row_sum, plane, buffers: [a, b] })
    }

    /// Adds the row sums of the weighted kernel to `out`: a bound of its part of the diagonal.
    pub fn add_row_sums(&self, out: &mut [f32]) {
        for (out, sum) in out.iter_mut().zip(&*self.row_sum) {
            *out += self.weight * sum;
        }
    }

    /// Adds weight L x to `out` for one plane `x`.
    pub fn add_laplacian(&mut self, x: &[f32], out: &mut [f32], exec: &dyn Executor) {
        let n = self.blur.size;
        // L is 0 on constants, so any may be taken off first: a constant x gives exactly 0.
        let base = x.first().copied().unwrap_or(0.0);
        for ((value, x), scale) in self.plane.iter_mut().zip(x).zip(&*self.scale) {
            *value = scale * (x - base);
        }
        let [a, b] = &mut self.buffers;
        self.blur.run(self.plane, a, b, exec);
        let (plane, scale, row_sum, weight) = (&*self.plane, &*self.scale, &*self.row_sum, self.weight);
        for_each_row_block(exec, n, ROWS_PER_BLOCK, Plane::new(out, n), &|rows, mut block| {
            let at = rows.start * n;
            let rows = tail(x, at).iter().zip(tail(plane, at)).zip(tail(scale, at)).zip(tail(row_sum, at));
            for (out, (((x, blurred), scale), sum)) in block.values().iter_mut().zip(rows) {
                *out += weight * (sum * (x - base) - scale * blurred);
            }
        });
    }

    /// a^T (weight L) b for planes `a` and `b`; `scratch` is one plane.
    #[must_use]
    pub fn form(&mut self, a: &[f32], b: &[f32], scratch: &mut [f32], exec: &dyn Executor) -> f64 {
        scratch.fill(0.0);
        self.add_laplacian(b, scratch, exec);
        dot(a, scratch, self.blur.size)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exec::Inline;
    use std::vec;
    use std::vec::Vec;

    fn impulse_response(size: usize, sigma: f32, x: usize, y: usize) -> Vec<f32> {
        let blur = Blur::new(size, sigma);
        let mut plane = vec![0.0; size * size];
        plane[y * size + x] = 1.0;
        let [mut a, mut b] = blur.buffer_lens().map(|len| vec![0.0; len]);
        blur.run(&mut plane, &mut a, &mut b, &Inline);
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
