//! The bilateral kernels of a CRF as one sparse graph of weighted pixel pairs.
//!
//! Edge (i, j) of the graph carries sum_k w_k Kn_k(i, j), where K_k is a Gaussian of the distance in pixels (its
//! offsets from [`pattern`](super::pattern)) times a Gaussian of the distance in features, and Kn_k =
//! D^-1/2 K_k D^-1/2 with D the row sums of K_k, a pixel's own 1 included. One graph serves every kernel of the same
//! spatial sigma, so a solver step costs the same for one kernel as for two. The graph's Laplacian
//! (L x)_i = sum_j W_ij (x_i - x_j) is symmetric, positive semi-definite and exactly 0 for constants by construction.
//!
//! Storage: `weights[(row * offsets + k) * size + x]` is the edge from pixel (x, row) along offset k, as the upper
//! half of an f32 (8 bits of precision); 0 where it leaves the image. Each edge is stored once.
use super::pattern::{Offset, Pattern};
use crate::Error;
use crate::arena::{Arena, bytes_for};
use crate::exec::{Executor, Plane, ROWS_PER_BLOCK, for_each_row_block};
use crate::math::sqrtf;

/// Pixels of a row that are worked on together.
const TILE: usize = 32;

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
    size: usize,
    pattern: Pattern,
    weights: &'a mut [u16],
}

impl<'a> Pairs<'a> {
    /// Bytes that stay taken after [`Pairs::build`].
    #[must_use]
    pub fn bytes(size: usize, offsets: usize) -> usize {
        bytes_for::<u16>(size.saturating_mul(size).saturating_mul(offsets))
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
        pattern: Pattern,
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
        let weights = arena.take(n2.saturating_mul(pattern.len()))?;
        let mut graph = Pairs { size, pattern, weights };
        if graph.pattern.is_empty() {
            return Ok(graph);
        }
        let mut scratch = arena.scope();
        let (first, second) = (scratch.take::<f32>(n2)?, scratch.take::<f32>(n2)?);
        graph.affinities(kernels, exec);
        graph.scales([&mut *first, &mut *second], exec);
        graph.merge(kernels, [first, second], exec);
        Ok(graph)
    }

    fn shape(&self) -> Shape<'_> {
        Shape { size: self.size, pattern: &self.pattern }
    }

    /// First pass: the square root of every kernel's feature part, in 8 bits, one kernel per byte.
    fn affinities(&mut self, kernels: &[Kernel<'_>], exec: &dyn Executor) {
        let shape = Shape { size: self.size, pattern: &self.pattern };
        let planes = Plane::new(&mut *self.weights, shape.row_len());
        for_each_row_block(exec, shape.size, ROWS_PER_BLOCK, planes, &|rows, mut block| {
            for (y, row) in rows.zip(block.rows()) {
                for (offset, codes) in shape.pattern.iter().zip(row.chunks_exact_mut(shape.size)) {
                    codes.fill(0);
                    let Some(span) = shape.forward(offset, y) else { continue };
                    let Some(codes) = codes.get_mut(span.start..span.start + span.len) else { continue };
                    for (k, kernel) in kernels.iter().take(MAX_KERNELS).enumerate() {
                        affinity_row(kernel.features, shape.size, &span, 8 * k as u32, codes);
                    }
                }
            }
        });
    }

    /// Second pass: 1 / sqrt(D) of both kernels.
    fn scales(&self, scales: [&mut [f32]; 2], exec: &dyn Executor) {
        let size = self.size;
        let [first, second] = scales;
        let out = (Plane::new(first, size), Plane::new(second, size));
        for_each_row_block(exec, size, ROWS_PER_BLOCK, out, &|rows, (mut first, mut second)| {
            for (y, (first, second)) in rows.zip(first.rows().zip(second.rows())) {
                // In units of the code's square, a pixel's own affinity is 255².
                first.fill(65025.0);
                second.fill(65025.0);
                self.for_each_span(y, |offset, at, codes, _| {
                    let own = |row: &mut [f32], shift: u32| {
                        if let Some(row) = row.get_mut(at..at + codes.len()) {
                            for (sum, &code) in row.iter_mut().zip(codes) {
                                *sum += offset.weight * squared_code(code, shift);
                            }
                        }
                    };
                    own(first, 0);
                    own(second, 8);
                });
                for sum in first.iter_mut().chain(second.iter_mut()) {
                    *sum = 1.0 / sqrtf(*sum);
                }
            }
        });
    }

    /// Third pass: codes become the merged weights, in place.
    fn merge(&mut self, kernels: &[Kernel<'_>], scales: [&[f32]; 2], exec: &dyn Executor) {
        let weight = |k: usize| kernels.get(k).map_or(0.0, |kernel| kernel.weight);
        let b = [weight(0), weight(1)];
        let shape = Shape { size: self.size, pattern: &self.pattern };
        let planes = Plane::new(&mut *self.weights, shape.row_len());
        for_each_row_block(exec, shape.size, ROWS_PER_BLOCK, planes, &|rows, mut block| {
            for (y, row) in rows.zip(block.rows()) {
                for (offset, codes) in shape.pattern.iter().zip(row.chunks_exact_mut(shape.size)) {
                    let Some(span) = shape.forward(offset, y) else { continue };
                    let Some(codes) = codes.get_mut(span.start..span.start + span.len) else { continue };
                    let [Some((i0, j0)), Some((i1, j1))] = scales.map(|s| span.pair(s)) else { continue };
                    let b = b.map(|b| b * offset.weight);
                    for ((((code, &i0), &j0), &i1), &j1) in codes.iter_mut().zip(i0).zip(j0).zip(i1).zip(j1) {
                        let first = b[0] * (i0 * j0) * squared_code(*code, 0);
                        let second = b[1] * (i1 * j1) * squared_code(*code, 8);
                        *code = encode(first + second);
                    }
                }
            }
        });
    }

    /// Adds every pixel's sum of weights, the graph's part of the diagonal, to `out` (one plane).
    pub fn add_row_sums(&self, out: &mut [f32], exec: &dyn Executor) {
        let size = self.size;
        for_each_row_block(exec, size, ROWS_PER_BLOCK, Plane::new(out, size), &|rows, mut block| {
            for (y, row) in rows.zip(block.rows()) {
                self.for_each_span(y, |_, at, weights, _| {
                    if let Some(row) = row.get_mut(at..at + weights.len()) {
                        for (sum, &w) in row.iter_mut().zip(weights) {
                            *sum += decode(w);
                        }
                    }
                });
            }
        });
    }

    /// Adds row `y` of L x to `out` (a row each) for the `C` planes `x`.
    pub fn add_laplacian_row<const C: usize>(&self, y: usize, x: [&[f32]; C], out: [&mut [f32]; C]) {
        let size = self.size;
        let mut out = out;
        let mut start = 0;
        while start < size {
            let len = TILE.min(size - start);
            let mut own = [[0.0_f32; TILE]; C];
            let mut sum = [[0.0_f32; TILE]; C];
            for (own, plane) in own.iter_mut().zip(&x) {
                let row = plane.get(y * size + start..y * size + start + len).unwrap_or(&[]);
                own.iter_mut().zip(row).for_each(|(own, &value)| *own = value);
            }
            for (k, offset) in self.pattern.iter().enumerate() {
                for span in self.shape().both(offset, y).into_iter().flatten() {
                    let (from, to) = (span.start.max(start), (span.start + span.len).min(start + len));
                    if from >= to {
                        continue;
                    }
                    let Some(weights) = self.weights_of(&span, k, from, to) else { continue };
                    let others = x.map(|plane| {
                        let j = span.other + (from - span.start);
                        plane.get(j..j + (to - from)).unwrap_or(&[])
                    });
                    add_differences(weights, &own, others, from - start, &mut sum);
                }
            }
            for (row, sum) in out.iter_mut().zip(&sum) {
                let row = row.get_mut(start..start + len).unwrap_or(&mut []);
                row.iter_mut().zip(sum).for_each(|(out, &value)| *out += value);
            }
            start += len;
        }
    }

    /// a^T L b for planes `a` and `b`: sum over edges of W_ij (a_i - a_j) (b_i - b_j), row by row.
    #[must_use]
    pub fn form(&self, a: &[f32], b: &[f32]) -> f64 {
        let mut total = 0.0_f64;
        for y in 0..self.size {
            let mut row = 0.0_f64;
            for (k, offset) in self.pattern.iter().enumerate() {
                let Some(span) = self.shape().forward(offset, y) else { continue };
                let Some(weights) = self.weights_of(&span, k, span.start, span.start + span.len) else {
                    continue;
                };
                let (Some((ai, aj)), Some((bi, bj))) = (span.pair(a), span.pair(b)) else { continue };
                for ((((&w, ai), aj), bi), bj) in weights.iter().zip(ai).zip(aj).zip(bi).zip(bj) {
                    row += f64::from(decode(w)) * f64::from(ai - aj) * f64::from(bi - bj);
                }
            }
            total += row;
        }
        total
    }

    /// The stored values of both directions of every offset at row `y`: `visit(offset, first column, values, k)`.
    fn for_each_span(&self, y: usize, mut visit: impl FnMut(&Offset, usize, &[u16], usize)) {
        for (k, offset) in self.pattern.iter().enumerate() {
            for span in self.shape().both(offset, y).into_iter().flatten() {
                if let Some(values) = self.weights_of(&span, k, span.start, span.start + span.len) {
                    visit(offset, span.start, values, k);
                }
            }
        }
    }

    /// The stored values of columns `from..to` of a span along offset `k`.
    fn weights_of(&self, span: &Span, k: usize, from: usize, to: usize) -> Option<&[u16]> {
        let at = (span.stored_row * self.pattern.len() + k) * self.size + span.stored + (from - span.start);
        self.weights.get(at..at + (to - from))
    }
}

/// The pixels of one row whose partner along an offset lies in the image.
struct Span {
    /// First column, and how many.
    start: usize,
    len: usize,
    /// Index of the first pixel and of its partner in a plane.
    own: usize,
    other: usize,
    /// Where the first edge is stored: row and column of the pixel that owns it.
    stored_row: usize,
    stored: usize,
}

impl Span {
    /// The pixels' and their partners' values.
    fn pair<'p>(&self, plane: &'p [f32]) -> Option<(&'p [f32], &'p [f32])> {
        Some((plane.get(self.own..self.own + self.len)?, plane.get(self.other..self.other + self.len)?))
    }
}

#[derive(Clone, Copy)]
struct Shape<'p> {
    size: usize,
    pattern: &'p Pattern,
}

impl Shape<'_> {
    fn row_len(&self) -> usize {
        self.size * self.pattern.len()
    }

    fn forward(&self, offset: &Offset, y: usize) -> Option<Span> {
        let n = self.size;
        let shift = offset.dx.unsigned_abs() as usize;
        let row = y + offset.dy;
        if row >= n || shift >= n {
            return None;
        }
        let (start, first) = if offset.dx < 0 { (shift, 0) } else { (0, shift) };
        Some(Span {
            start,
            len: n - shift,
            own: y * n + start,
            other: row * n + first,
            stored_row: y,
            stored: start,
        })
    }

    fn backward(&self, offset: &Offset, y: usize) -> Option<Span> {
        let n = self.size;
        let shift = offset.dx.unsigned_abs() as usize;
        if offset.dy > y || shift >= n {
            return None;
        }
        let row = y - offset.dy;
        let (start, first) = if offset.dx < 0 { (0, shift) } else { (shift, 0) };
        Some(Span {
            start,
            len: n - shift,
            own: y * n + start,
            other: row * n + first,
            stored_row: row,
            stored: first,
        })
    }

    fn both(&self, offset: &Offset, y: usize) -> [Option<Span>; 2] {
        [self.forward(offset, y), self.backward(offset, y)]
    }
}

/// sum += w (own - other) for `weights.len()` pixels from `at` in the tile.
#[inline]
fn add_differences<const C: usize>(
    weights: &[u16],
    own: &[[f32; TILE]; C],
    others: [&[f32]; C],
    at: usize,
    sum: &mut [[f32; TILE]; C],
) {
    if let Ok(weights) = <&[u16; TILE]>::try_from(weights) {
        // A loop: the standard array map is not vectorised.
        let mut decoded = [0.0_f32; TILE];
        for i in 0..TILE {
            decoded[i] = decode(weights[i]);
        }
        for ((own, other), sum) in own.iter().zip(others).zip(sum) {
            let Ok(other) = <&[f32; TILE]>::try_from(other) else { continue };
            for i in 0..TILE {
                sum[i] += decoded[i] * (own[i] - other[i]);
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

/// Adds the codes of exp(-|f_i - f_j|²) = sqrt(K) of one span, shifted to their byte, to `codes`.
fn affinity_row(features: &[f32], size: usize, span: &Span, shift: u32, codes: &mut [u16]) {
    for (tile, codes) in codes.chunks_mut(TILE).enumerate() {
        let mut distance = [0.0_f32; TILE];
        for plane in features.chunks_exact(size * size) {
            let Some((own, other)) = span.pair(plane) else { continue };
            let (own, other) =
                (own.get(tile * TILE..).unwrap_or(&[]), other.get(tile * TILE..).unwrap_or(&[]));
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

/// e^-t for t >= 0 to a relative 3e-5, by basic operations only, so that it vectorises and has the same bits
/// everywhere; 0 or nearly so from t = 80 on.
#[inline]
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

#[inline]
fn squared_code(codes: u16, shift: u32) -> f32 {
    let code = f32::from(((codes >> shift) & 0xff) as u8);
    code * code
}

/// An f32 from its upper half.
#[inline]
fn decode(half: u16) -> f32 {
    f32::from_bits(u32::from(half) << 16)
}

/// The upper half of a finite f32, rounded to nearest.
#[inline]
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
