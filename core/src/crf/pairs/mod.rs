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
mod build;
mod cells;
mod codes;
mod laplacian;
mod layout;

use super::pattern::Pattern;
use crate::Error;
use crate::base::arena::{Arena, bytes_for};
use crate::base::exec::{Executor, Plane, for_each_row};
use codes::decode;
use layout::Shape;

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

    /// Adds every pixel's sum of weights, the graph's part of the diagonal, to `out` (one plane).
    pub fn add_row_sums(&self, out: &mut [f32], exec: &dyn Executor) {
        let size = self.shape.size;
        for_each_row(
            exec,
            size,
            Plane::new(out, size),
            #[inline(always)]
            |y, row| {
                self.shape.for_each_line(
                    y,
                    self.weights,
                    #[inline(always)]
                    |line, _| {
                        let Some(weights) = line.weights(self.weights, line.columns.clone()) else { return };
                        let row = row.get_mut(line.columns.clone()).unwrap_or(&mut []);
                        for (sum, &w) in row.iter_mut().zip(weights) {
                            *sum += decode(w);
                        }
                    },
                );
            },
        );
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
