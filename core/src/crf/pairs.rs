//! The bilateral kernels of a CRF as one sparse graph of weighted pixel pairs.
//!
//! Edge (i, j) of the graph carries sum_k w_k Kn_k(i, j), where K_k is a Gaussian of the distance in pixels (its
//! offsets from [`pattern`](super::pattern)) times a Gaussian of the distance in features, and Kn_k =
//! D^-1/2 K_k D^-1/2 with D the row sums of K_k, a pixel's own 1 included. One graph serves every kernel of the same
//! spatial sigma, so a solver step costs the same for one kernel as for two. The graph's Laplacian
//! (L x)_i = sum_j W_ij (x_i - x_j) is symmetric, positive semi-definite and exactly 0 for constants by construction.
//!
//! Storage: `weights[pad + row * row_len + k * size + x]` is the edge from pixel (x, row) along offset k, as the upper
//! half of an f32 (8 bits of precision); 0 where it leaves the image. Each edge is stored once. Offsets are sorted by
//! falling dx and every row ends with `pad` zeros, so that an edge that would leave the image sideways reads a 0 also
//! when it is looked up from its far end: loops run over whole rows, whose length is a multiple of any vector's.
//! Where the weight is 0 the partner's value is another pixel's, and must be finite.
use super::pattern::{Offset, Pattern};
use crate::Error;
use crate::arena::{Arena, bytes_for};
use crate::exec::{Executor, Plane, ROWS_PER_BLOCK, for_each_row_block};
use crate::kernels::prefetch;
use crate::math::sqrtf;
use core::ops::Range;

/// Pixels of a row that are worked on together; [`WIDE`] where the size is a multiple of that.
const TILE: usize = 128;
const WIDE: usize = 256;

/// On the boundary of a vector register and a cache line.
#[repr(align(64))]
struct Aligned<T>(T);

/// Most kernels in one graph: their values share 16 bits while the graph is built.
pub const MAX_KERNELS: usize = 2;

/// One bilateral kernel.
#[derive(Clone, Copy, Debug)]
pub struct Kernel<'f> {
    /// Feature planes, one after the other, each divided by twice its sigma.
    pub features: &'f [f32],
    /// What the normalised kernel is multiplied by, at least 0.
    pub weight: f32,
}

/// A graph of weighted pixel pairs.
#[derive(Debug)]
pub struct Pairs<'a> {
    shape: Shape,
    weights: &'a mut [u16],
}

impl<'a> Pairs<'a> {
    /// Bytes that stay taken after [`Pairs::build`].
    #[must_use]
    pub fn bytes(size: usize, pattern: &Pattern) -> usize {
        bytes_for::<u16>(Shape::new(size, pattern).len())
    }

    /// Bytes that [`Pairs::build`] needs beyond [`Pairs::bytes`] while it runs.
    #[must_use]
    pub fn build_bytes(size: usize) -> usize {
        MAX_KERNELS.saturating_mul(bytes_for::<f32>(size.saturating_mul(size)))
    }

    /// Builds the graph of `kernels` (at most [`MAX_KERNELS`] count) over `size` x `size` pixels.
    ///
    /// # Errors
    /// [`Error::WorkspaceTooSmall`]; [`Error::PlaneLength`] when features are not whole planes.
    pub fn build(
        size: usize,
        pattern: &Pattern,
        kernels: &[Kernel<'_>],
        exec: &dyn Executor,
        arena: &mut Arena<'a>,
    ) -> Result<Self, Error> {
        let n2 = size.saturating_mul(size);
        for kernel in kernels {
            if n2 == 0 || kernel.features.len() % n2 != 0 {
                return Err(Error::PlaneLength { needed: n2, given: kernel.features.len() });
            }
        }
        let shape = Shape::new(size, pattern);
        let weights = arena.take(shape.len())?;
        let mut graph = Pairs { shape, weights };
        if graph.shape.pattern.is_empty() {
            return Ok(graph);
        }
        let mut scratch = arena.scope();
        let (first, second) = (scratch.take::<f32>(n2)?, scratch.take::<f32>(n2)?);
        graph.affinities(kernels, exec);
        graph.scales(kernels, [&mut *first, &mut *second], exec);
        graph.merge(kernels, [first, second], exec);
        Ok(graph)
    }

    /// First pass: the square root of every kernel's feature part, in 8 bits, one kernel per byte.
    fn affinities(&mut self, kernels: &[Kernel<'_>], exec: &dyn Executor) {
        let shape = &self.shape;
        let (pad, weights) = self.weights.split_at_mut(shape.pad);
        pad.fill(0);
        let rows = Plane::new(weights, shape.row_len());
        for_each_row_block(exec, shape.size, ROWS_PER_BLOCK, rows, &|rows, mut block| {
            exec.simd().run(
                #[inline(always)]
                || {
                    for (y, row) in rows.zip(block.rows()) {
                        let (lines, pad) = row.split_at_mut(shape.row_len() - shape.pad);
                        pad.fill(0);
                        let lines = lines.chunks_exact_mut(shape.size);
                        for ((k, offset), codes) in shape.pattern.iter().enumerate().zip(lines) {
                            codes.fill(0);
                            let Some(line) = shape.forward(k, offset, y) else { continue };
                            let Some(inside) = codes.get_mut(line.columns.clone()) else { continue };
                            for (shift, kernel) in [0, 8].into_iter().zip(kernels) {
                                affinity_row(kernel.features, shape.size, &line, y, shift, inside);
                            }
                            let shift = offset.dx.unsigned_abs() as usize;
                            let outside =
                                if offset.dx > 0 { shape.size - shift..shape.size } else { 0..shift };
                            codes.get_mut(outside).unwrap_or(&mut []).fill(0);
                        }
                    }
                },
            );
        });
    }

    /// Second pass: 1 / sqrt(D) of both kernels; 1 for a kernel that there is not.
    fn scales(&self, kernels: &[Kernel<'_>], scales: [&mut [f32]; 2], exec: &dyn Executor) {
        let size = self.shape.size;
        let two = kernels.len() > 1;
        let [first, second] = scales;
        let out = (Plane::new(first, size), Plane::new(second, size));
        for_each_row_block(exec, size, ROWS_PER_BLOCK, out, &|rows, (mut first, mut second)| {
            exec.simd().run(
                #[inline(always)]
                || {
                    for (y, (first, second)) in rows.zip(first.rows().zip(second.rows())) {
                        // In units of the code's square, a pixel's own affinity is 255².
                        first.fill(65025.0);
                        second.fill(if two { 65025.0 } else { 1.0 });
                        self.shape.for_each_line(
                            y,
                            #[inline(always)]
                            |line, offset| {
                                let Some(codes) = line.weights(self.weights, line.columns.clone()) else {
                                    return;
                                };
                                add_squares(first, line.columns.clone(), codes, 0, offset.weight);
                                if two {
                                    add_squares(second, line.columns.clone(), codes, 8, offset.weight);
                                }
                            },
                        );
                        for sum in first.iter_mut().chain(second.iter_mut()) {
                            *sum = 1.0 / sqrtf(*sum);
                        }
                    }
                },
            );
        });
    }

    /// Third pass: codes become the merged weights, in place.
    fn merge(&mut self, kernels: &[Kernel<'_>], scales: [&[f32]; 2], exec: &dyn Executor) {
        let weight = |k: usize| kernels.get(k).map_or(0.0, |kernel| kernel.weight);
        let b = [weight(0), weight(1)];
        let shape = &self.shape;
        let rows = Plane::new(self.weights.get_mut(shape.pad..).unwrap_or(&mut []), shape.row_len());
        for_each_row_block(exec, shape.size, ROWS_PER_BLOCK, rows, &|rows, mut block| {
            exec.simd().run(
                #[inline(always)]
                || {
                    for (y, row) in rows.zip(block.rows()) {
                        let lines = row.chunks_exact_mut(shape.size);
                        for ((k, offset), codes) in shape.pattern.iter().enumerate().zip(lines) {
                            let Some(line) = shape.forward(k, offset, y) else { continue };
                            let Some(codes) = codes.get_mut(line.columns.clone()) else { continue };
                            let [Some((i0, j0)), Some((i1, j1))] =
                                scales.map(|s| line.pair(s, shape.size, y))
                            else {
                                continue;
                            };
                            if kernels.len() > 1 {
                                merge_two(b.map(|b| b * offset.weight), [i0, j0], [i1, j1], codes);
                            } else {
                                merge_one(b[0] * offset.weight, i0, j0, codes);
                            }
                        }
                    }
                },
            );
        });
    }

    /// Adds every pixel's sum of weights, the graph's part of the diagonal, to `out` (one plane).
    pub fn add_row_sums(&self, out: &mut [f32], exec: &dyn Executor) {
        let size = self.shape.size;
        for_each_row_block(exec, size, ROWS_PER_BLOCK, Plane::new(out, size), &|rows, mut block| {
            exec.simd().run(
                #[inline(always)]
                || {
                    for (y, row) in rows.zip(block.rows()) {
                        self.shape.for_each_line(
                            y,
                            #[inline(always)]
                            |line, _| {
                                let Some(weights) = line.weights(self.weights, line.columns.clone()) else {
                                    return;
                                };
                                let row = row.get_mut(line.columns.clone()).unwrap_or(&mut []);
                                for (sum, &w) in row.iter_mut().zip(weights) {
                                    *sum += decode(w);
                                }
                            },
                        );
                    }
                },
            );
        });
    }

    /// Adds row `y` of L x to `out` (a row each) for the `C` planes `x`. To be called within `Simd::run`.
    #[inline(always)]
    pub(super) fn add_laplacian_row<const C: usize>(&self, y: usize, x: [&[f32]; C], out: [&mut [f32]; C]) {
        // Wide tiles read the weights in the order in which they lie in memory.
        if self.shape.size.is_multiple_of(WIDE) {
            self.add_laplacian_tiles::<C, WIDE>(y, x, out);
        } else {
            self.add_laplacian_tiles::<C, TILE>(y, x, out);
        }
    }

    #[inline(always)]
    fn add_laplacian_tiles<const C: usize, const T: usize>(
        &self,
        y: usize,
        x: [&[f32]; C],
        out: [&mut [f32]; C],
    ) {
        let size = self.shape.size;
        let row_len = self.shape.row_len() as isize;
        let mut out = out;
        let mut start = 0;
        while start < size {
            let len = T.min(size - start);
            let mut own = Aligned([[0.0_f32; T]; C]);
            let mut sum = Aligned([[0.0_f32; T]; C]);
            for (own, plane) in own.0.iter_mut().zip(&x) {
                let row = plane.get(y * size + start..y * size + start + len).unwrap_or(&[]);
                own.get_mut(..row.len()).unwrap_or(&mut []).copy_from_slice(row);
            }
            self.shape.for_each_line(
                y,
                #[inline(always)]
                |line, _| {
                    if line.forward && start == 0 {
                        // The next row's, which nothing has read for a whole step.
                        prefetch(part(self.weights, line.weights + row_len, 0..size).unwrap_or(&[]));
                    }
                    let (from, to) = (line.columns.start.max(start), line.columns.end.min(start + len));
                    let Some(weights) = line.weights(self.weights, from..to) else { return };
                    let others = x.map(|plane| line.others(plane, from..to).unwrap_or(&[]));
                    add_differences(weights, &own.0, others, from - start, &mut sum.0);
                },
            );
            for (row, sum) in out.iter_mut().zip(&sum.0) {
                let row = row.get_mut(start..start + len).unwrap_or(&mut []);
                for (out, &value) in row.iter_mut().zip(sum) {
                    *out += value;
                }
            }
            start += len;
        }
    }

    /// a^T L b for planes `a` and `b`: sum over edges of W_ij (a_i - a_j) (b_i - b_j), row by row.
    #[must_use]
    pub fn form(&self, a: &[f32], b: &[f32]) -> f64 {
        let size = self.shape.size;
        let mut total = 0.0_f64;
        for y in 0..size {
            let mut row = 0.0_f64;
            for (k, offset) in self.shape.pattern.iter().enumerate() {
                let Some(line) = self.shape.forward(k, offset, y) else { continue };
                let Some(weights) = line.weights(self.weights, line.columns.clone()) else { continue };
                let (Some((ai, aj)), Some((bi, bj))) = (line.pair(a, size, y), line.pair(b, size, y)) else {
                    continue;
                };
                for ((((&w, ai), aj), bi), bj) in weights.iter().zip(ai).zip(aj).zip(bi).zip(bj) {
                    row += f64::from(decode(w)) * f64::from(ai - aj) * f64::from(bi - bj);
                }
            }
            total += row;
        }
        total
    }
}

/// The edges of one row along one offset or its opposite.
struct Line {
    /// Columns whose partner can be looked up: all, but in the image's first and last row.
    columns: Range<usize>,
    /// Where the weight of column 0 is stored, and where its partner lies in a plane; may lie before the start.
    weights: isize,
    other: isize,
    forward: bool,
}

/// The part of `values` that belongs to `columns`, column 0 being at `start`.
#[inline(always)]
fn part<T>(values: &[T], start: isize, columns: Range<usize>) -> Option<&[T]> {
    values.get(columns.start.checked_add_signed(start)?..columns.end.checked_add_signed(start)?)
}

impl Line {
    #[inline(always)]
    fn weights<'w>(&self, weights: &'w [u16], columns: Range<usize>) -> Option<&'w [u16]> {
        part(weights, self.weights, columns)
    }

    #[inline(always)]
    fn others<'p>(&self, plane: &'p [f32], columns: Range<usize>) -> Option<&'p [f32]> {
        part(plane, self.other, columns)
    }

    /// The values of row `y` and of their partners.
    #[inline(always)]
    fn pair<'p>(&self, plane: &'p [f32], size: usize, y: usize) -> Option<(&'p [f32], &'p [f32])> {
        let own = plane.get(y * size + self.columns.start..y * size + self.columns.end)?;
        Some((own, self.others(plane, self.columns.clone())?))
    }
}

/// Where a graph's weights lie.
#[derive(Debug)]
struct Shape {
    size: usize,
    pad: usize,
    /// Sorted by falling dx, all less than `size` away.
    pattern: Pattern,
}

impl Shape {
    fn new(size: usize, pattern: &Pattern) -> Self {
        let mut sorted = Pattern::new();
        for offset in pattern {
            if (offset.dx.unsigned_abs() as usize) < size && offset.dy < size {
                // Room for every offset: both hold as many.
                let _ = sorted.push(*offset);
            }
        }
        sorted.sort_unstable_by_key(|offset| (-offset.dx, offset.dy));
        let pad = sorted.iter().map(|offset| offset.dx.unsigned_abs() as usize).max().unwrap_or(0);
        Self { size, pad, pattern: sorted }
    }

    /// Values of a row.
    #[inline(always)]
    fn row_len(&self) -> usize {
        self.size.saturating_mul(self.pattern.len()).saturating_add(self.pad)
    }

    /// Values in all.
    fn len(&self) -> usize {
        self.row_len().saturating_mul(self.size).saturating_add(self.pad)
    }

    /// From row `y` along offset `k`.
    #[inline(always)]
    fn forward(&self, k: usize, offset: &Offset, y: usize) -> Option<Line> {
        let n = self.size;
        let row = y + offset.dy;
        if row >= n {
            return None;
        }
        let right = offset.dx.max(0) as usize;
        Some(Line {
            columns: 0..if row + 1 == n { n - right } else { n },
            weights: (self.pad + y * self.row_len() + k * n) as isize,
            other: (row * n) as isize + offset.dx as isize,
            forward: true,
        })
    }

    /// From row `y` against offset `k`.
    #[inline(always)]
    fn backward(&self, k: usize, offset: &Offset, y: usize) -> Option<Line> {
        let n = self.size;
        let row = y.checked_sub(offset.dy)?;
        let right = offset.dx.max(0) as usize;
        Some(Line {
            columns: if row == 0 { right } else { 0 }..n,
            weights: (self.pad + row * self.row_len() + k * n) as isize - offset.dx as isize,
            other: (row * n) as isize - offset.dx as isize,
            forward: false,
        })
    }

    /// Visits all lines of row `y`, both directions.
    #[inline(always)]
    fn for_each_line(&self, y: usize, mut visit: impl FnMut(&Line, &Offset)) {
        for (k, offset) in self.pattern.iter().enumerate() {
            if let Some(line) = self.forward(k, offset, y) {
                visit(&line, offset);
            }
            if let Some(line) = self.backward(k, offset, y) {
                visit(&line, offset);
            }
        }
    }
}

/// sum += w (own - other) for `weights.len()` pixels from `at` in the tile.
#[inline(always)]
fn add_differences<const C: usize, const T: usize>(
    weights: &[u16],
    own: &[[f32; T]; C],
    others: [&[f32]; C],
    at: usize,
    sum: &mut [[f32; T]; C],
) {
    if let Ok(weights) = <&[u16; T]>::try_from(weights) {
        let others = others.map(|other| <&[f32; T]>::try_from(other).unwrap_or(&[0.0; T]));
        for i in 0..T {
            let w = decode(weights[i]);
            for c in 0..C {
                sum[c][i] += w * (own[c][i] - others[c][i]);
            }
        }
        return;
    }
    for ((own, other), sum) in own.iter().zip(others).zip(sum) {
        let places = sum.iter_mut().zip(own).skip(at);
        for (((sum, own), other), &w) in places.zip(other).zip(weights) {
            *sum += decode(w) * (own - other);
        }
    }
}

/// Adds the codes of exp(-|f_i - f_j|²) = sqrt(K) of one line, shifted to their byte, to `codes`.
#[inline(always)]
fn affinity_row(features: &[f32], size: usize, line: &Line, y: usize, shift: u32, codes: &mut [u16]) {
    for (tile, codes) in codes.chunks_mut(TILE).enumerate() {
        let mut distance = [0.0_f32; TILE];
        for plane in features.chunks_exact(size * size) {
            let Some((own, other)) = line.pair(plane, size, y) else { continue };
            let columns = tile * TILE..tile * TILE + codes.len();
            let (Some(own), Some(other)) = (own.get(columns.clone()), other.get(columns)) else { continue };
            for ((sum, a), b) in distance.iter_mut().zip(own).zip(other) {
                let d = a - b;
                *sum += d * d;
            }
        }
        for (code, &d) in codes.iter_mut().zip(&distance) {
            // Adding 2^23 rounds to the nearest integer and leaves it in the lowest bits.
            let byte = (exp_minus(d) * 255.0 + 8_388_608.0).to_bits() & 0xff;
            *code |= (byte << shift) as u16;
        }
    }
}

/// Adds weight code² to the sums of `columns`.
#[inline(always)]
fn add_squares(row: &mut [f32], columns: Range<usize>, codes: &[u16], shift: u32, weight: f32) {
    let row = row.get_mut(columns).unwrap_or(&mut []);
    for (sum, &code) in row.iter_mut().zip(codes) {
        *sum += weight * squared_code(code, shift);
    }
}

/// The weights of one kernel.
#[inline(always)]
fn merge_one(b: f32, i: &[f32], j: &[f32], codes: &mut [u16]) {
    for ((code, i), j) in codes.iter_mut().zip(i).zip(j) {
        *code = encode(b * (i * j) * squared_code(*code, 0));
    }
}

/// The weights of two kernels.
#[inline(always)]
fn merge_two(b: [f32; 2], [i0, j0]: [&[f32]; 2], [i1, j1]: [&[f32]; 2], codes: &mut [u16]) {
    for ((((code, i0), j0), i1), j1) in codes.iter_mut().zip(i0).zip(j0).zip(i1).zip(j1) {
        let first = b[0] * (i0 * j0) * squared_code(*code, 0);
        let second = b[1] * (i1 * j1) * squared_code(*code, 8);
        *code = encode(first + second);
    }
}

/// e^-t for t >= 0 to a relative 3e-5, by basic operations only, so that it vectorises and has the same bits
/// everywhere; 0 or nearly so from t = 80 on.
#[inline(always)]
fn exp_minus(t: f32) -> f32 {
    const SHIFT: f32 = 12_582_912.0;
    let t = if t < 80.0 { t } else { 80.0 };
    let scaled = t * -core::f32::consts::LOG2_E;
    let shifted = scaled + SHIFT;
    let f = scaled - (shifted - SHIFT);
    // 2^f on [-1/2, 1/2]: Taylor with the last coefficient a little larger.
    let p = 1.0 + f * (core::f32::consts::LN_2 + f * (0.240_226_5 + f * (0.055_504_1 + f * 0.009_7)));
    f32::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 23))
}

#[inline(always)]
fn squared_code(codes: u16, shift: u32) -> f32 {
    let code = f32::from(((codes >> shift) & 0xff) as u8);
    code * code
}

/// An f32 from its upper half.
#[inline(always)]
fn decode(half: u16) -> f32 {
    f32::from_bits(u32::from(half) << 16)
}

/// The upper half of a finite f32, rounded to nearest.
#[inline(always)]
fn encode(value: f32) -> u16 {
    let bits = value.to_bits();
    ((bits.wrapping_add(0x7fff + ((bits >> 16) & 1))) >> 16) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_close_over_its_whole_range() {
        for i in 0..8000 {
            let t = i as f32 * 0.01;
            let (ours, exact) = (f64::from(exp_minus(t)), (-f64::from(t)).exp());
            assert!((ours / exact - 1.0).abs() < 1e-4, "{t}: {ours} {exact}");
        }
        assert_eq!(exp_minus(0.0), 1.0);
        assert!(exp_minus(1e30) < 1e-30 && exp_minus(f32::INFINITY) < 1e-30);
    }

    #[test]
    fn halves_round_to_nearest_even() {
        for value in [0.0_f32, 1.0, 0.5, 1e-3, 0.333, 7.1e-6] {
            assert!((decode(encode(value)) - value).abs() <= value / 256.0, "{value}");
        }
        assert_eq!(decode(encode(1.0)), 1.0);
    }
}
