//! The coarse part of the preconditioner: the matrix over a few square cells of pixels, solved directly.
//!
//! The diagonal's inverse puts right what varies within a kernel's width. What is smoother it leaves alone, and where the
//! neighbourhood has much more say than the unaries, most steps of conjugate gradients go into that. So the
//! preconditioner becomes diag(A)^-1 + P C^-1 P^T, P constant over each cell and C = P^T A P (a coarse space correction, or
//! two-level additive Schwarz method). Kernels reach as far in cells at every size, and there are at most [`MAX_CELLS`]
//! cells to a side, so C does not grow with the image. A's rows sum to the unary weights, and C's to their sums over
//! cells: only the weights between different cells are needed, and C is an M-matrix like A.
//!
//! C is stored and solved as `banded` says, a row per cell.
use super::pairs::Pairs;
use super::pattern::RADIUS;
use super::vectors::MAX_CHANNELS;
use crate::Error;
use crate::base::arena::{Arena, bytes_for};
use crate::base::exec::{Executor, Plane, for_each_row};
use crate::base::lanes::{LANES, Lanes, load};
use crate::base::math::banded;
use crate::base::math::{expf, floorf, sqrtf};
use crate::base::planes::plane_row;

/// Narrowest cell, in pixels.
const MIN_WIDTH: usize = 4;

/// Most cells to a side. The CRFs' kernels then reach two cells far; a third would double the factor's work.
const MAX_CELLS: usize = 20;

/// Square cells of pixels.
#[derive(Clone, Copy, Debug)]
pub struct Cells {
    /// Pixels per side of the image.
    pub size: usize,
    /// Pixels per side of a cell; the last cells may be narrower.
    pub width: usize,
    /// Cells per side.
    pub count: usize,
}

impl Cells {
    /// The cells of an image of `size` x `size` pixels.
    #[must_use]
    pub fn new(size: usize) -> Self {
        let width = size.div_ceil(MAX_CELLS).max(MIN_WIDTH);
        Self { size, width, count: size.div_ceil(width) }
    }

    /// Row `y` of a plane of cells, as the run of pixels that starts at `start`.
    #[inline(always)]
    pub(super) fn expanded(&self, cells: &[f32], y: usize, start: usize) -> Lanes {
        let mut run = [0.0; LANES];
        let row = plane_row(cells, self.count, y / self.width);
        let (first, skipped) = (start / self.width, start % self.width);
        let mut at = 0;
        for (c, value) in row.iter().skip(first).enumerate() {
            let end = ((c + 1) * self.width - skipped).min(LANES);
            run.get_mut(at..end).unwrap_or(&mut []).fill(*value);
            at = end;
            if end == LANES {
                break;
            }
        }
        run
    }

    /// Sums over cells: one plane of pixels to one of cells.
    fn sums(&self, plane: &[f32], out: &mut [f32], exec: &dyn Executor) {
        for_each_row(
            exec,
            self.count,
            Plane::new(out, self.count),
            #[inline(always)]
            |cell, out| {
                out.fill(0.0);
                for start in (0..self.size).step_by(LANES) {
                    let mut sums = [0.0; LANES];
                    for y in cell * self.width..((cell + 1) * self.width).min(self.size) {
                        let row = load(plane_row(plane, self.size, y), start);
                        for (sum, value) in sums.iter_mut().zip(&row) {
                            *sum += value;
                        }
                    }
                    for (x, sum) in (start..self.size).zip(&sums) {
                        if let Some(out) = out.get_mut(x / self.width) {
                            *out += sum;
                        }
                    }
                }
            },
        );
    }
}

/// The weights between cells, before they become the matrix C.
#[derive(Debug)]
pub struct Weights<'w> {
    /// The cells.
    pub cells: Cells,
    /// Cells behind one that its row holds.
    pub band: usize,
    /// Values from one row to the next.
    pub stride: usize,
    /// The rows.
    pub rows: &'w mut [f32],
}

/// The coarse part of a preconditioner.
#[derive(Debug)]
pub struct Coarse<'a> {
    cells: Cells,
    band: usize,
    stride: usize,
    factor: &'a mut [f32],
    /// The corrections, a plane of cells for each channel.
    corrections: &'a mut [f32],
}

/// Cells, their band and the length of a row, for kernels of at most `sigma` pixels.
fn shape(size: usize, sigma: f32) -> (Cells, usize, usize) {
    let cells = Cells::new(size);
    let reach = (floorf(RADIUS * sigma) as usize).min(size).saturating_add(cells.width - 1) / cells.width;
    let band = (reach * cells.count + reach).min((cells.count * cells.count).saturating_sub(1));
    (cells, band, banded::stride(band))
}

impl<'a> Coarse<'a> {
    /// Bytes that [`Coarse::new`] takes for kernels of at most `sigma` pixels.
    #[must_use]
    pub fn bytes(size: usize, sigma: f32) -> usize {
        let (cells, _, stride) = shape(size, sigma);
        let count = cells.count * cells.count;
        bytes_for::<f32>(count.saturating_mul(stride)).saturating_add(bytes_for::<f32>(MAX_CHANNELS * count))
    }

    /// The coarse matrix of unary weights, a graph and kappa_1, given as its sigma in pixels and its weight.
    ///
    /// # Errors
    /// [`Error::WorkspaceTooSmall`].
    pub fn new(
        unary: &[f32],
        pairs: Option<&Pairs<'_>>,
        spatial: Option<(f32, f32)>,
        (size, sigma): (usize, f32),
        exec: &dyn Executor,
        arena: &mut Arena<'a>,
    ) -> Result<Self, Error> {
        let (cells, band, stride) = shape(size, sigma);
        let count = cells.count * cells.count;
        let factor = arena.zeroed(count * stride)?;
        let corrections = arena.take(MAX_CHANNELS * count)?;
        let mut weights = Weights { cells, band, stride, rows: &mut *factor };
        if let Some(pairs) = pairs {
            pairs.add_between_cells(&mut weights, exec);
        }
        if let Some((sigma, weight)) = spatial {
            weights.add_spatial(sigma, weight);
        }
        let diagonal = corrections.get_mut(..count).unwrap_or(&mut []);
        cells.sums(unary, diagonal, exec);
        let simd = exec.simd();
        simd.run(
            #[inline(always)]
            || weights.into_matrix(diagonal),
        );
        simd.run(
            #[inline(always)]
            || banded::factorise(factor, stride, band),
        );
        Ok(Self { cells, band, stride, factor, corrections })
    }

    /// Works out the correction C^-1 P^T r of `channel`; returns r^T P C^-1 P^T r.
    pub(super) fn correct(&mut self, channel: usize, r: &[f32], exec: &dyn Executor) -> f64 {
        let count = self.cells.count * self.cells.count;
        let Some(values) = self.corrections.get_mut(channel * count..(channel + 1) * count) else {
            return 0.0;
        };
        self.cells.sums(r, values, exec);
        exec.simd().run(
            #[inline(always)]
            || banded::solve(self.factor, self.stride, self.band, values),
        )
    }

    /// The last correction of `channel`, a plane of cells.
    #[must_use]
    pub(super) fn correction(&self, channel: usize) -> (Cells, &[f32]) {
        let count = self.cells.count * self.cells.count;
        (self.cells, self.corrections.get(channel * count..(channel + 1) * count).unwrap_or(&[]))
    }
}

impl Weights<'_> {
    /// Adds kappa_1's weights, with its normalisation taken as constant over each cell.
    fn add_spatial(&mut self, sigma: f32, weight: f32) {
        let Cells { width, count, .. } = self.cells;
        // The Gaussian summed over the pixels of two cells `k` apart along an axis.
        let along: [f32; MAX_CELLS] = core::array::from_fn(|k| {
            let term = |t: usize, sign: f32| {
                let distance = (k * width) as f32 + sign * t as f32;
                (width - t) as f32 * expf(-distance * distance / (2.0 * sigma * sigma))
            };
            term(0, 1.0) + (1..width).map(|t| term(t, 1.0) + term(t, -1.0)).sum::<f32>()
        });
        let at = |i: usize, j: usize| along.get(i.abs_diff(j)).copied().unwrap_or(0.0);
        let scale: [f32; MAX_CELLS] = core::array::from_fn(|i| {
            let mean = (0..count).map(|j| at(i, j)).sum::<f32>() / width as f32;
            1.0 / sqrtf(mean)
        });
        let between = |i: usize, j: usize| {
            let scale = |i: usize| scale.get(i).copied().unwrap_or(0.0);
            scale(i) * scale(j) * at(i, j)
        };
        for (i, row) in self.rows.chunks_exact_mut(self.stride).enumerate() {
            for (j, value) in (i..count * count).zip(row).take(1 + self.band).skip(1) {
                *value += weight * between(i % count, j % count) * between(i / count, j / count);
            }
        }
    }

    /// Turns the weights into the matrix; `diagonal` holds the unaries' sums.
    #[inline(always)]
    fn into_matrix(self, diagonal: &mut [f32]) {
        for (i, row) in self.rows.chunks_exact_mut(self.stride).enumerate() {
            let Some([own, behind @ ..]) = diagonal.get_mut(i..) else { return };
            let Some((first, row)) = row.split_first_mut() else { return };
            for (other, value) in behind.iter_mut().zip(row) {
                *own += *value;
                *other += *value;
                *value = -*value;
            }
            *first = *own;
        }
    }
}
