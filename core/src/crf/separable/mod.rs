//! kappa_1: a Gaussian of the distance in pixels only, as a separable blur, symmetrically normalised.
//!
//! Pixels beyond the border do not exist: sums run over the image only, and D^-1/2 G D^-1/2 makes up for it. Planes are
//! `size` x `size`; sigma in pixels.
mod blur;
mod cells;

use super::vectors::dot;
use crate::Error;
use crate::base::arena::{Arena, bytes_for};
use crate::base::exec::{Executor, Plane, for_each_row};
use crate::base::planes::plane_row;
use blur::Blur;

/// The Laplacian of the normalised blur: L x = rho x - s G (s x), with s = 1/sqrt(G 1) and rho = s G s.
#[derive(Debug)]
pub struct Spatial<'a> {
    blur: Blur,
    weight: f32,
    scale: &'a mut [f32],
    row_sum: &'a mut [f32],
    buffers: [&'a mut [f32]; 2],
}

impl<'a> Spatial<'a> {
    /// Bytes that stay taken after [`Spatial::new`].
    #[must_use]
    pub fn bytes(size: usize, sigma: f32) -> usize {
        let plane = bytes_for::<f32>(size.saturating_mul(size));
        let [a, b] = Blur::new(size, sigma).buffer_lens().map(bytes_for::<f32>);
        plane.saturating_mul(2).saturating_add(a).saturating_add(b)
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
        let (scale, row_sum) = (arena.take::<f32>(n2)?, arena.take::<f32>(n2)?);
        let [a, b] = blur.buffer_lens();
        let [a, b] = [arena.take(a)?, arena.take(b)?];
        scale.fill(1.0);
        row_sum.fill(1.0);
        blur.spread([&*row_sum, &*scale], 0.0, a, b, exec);
        blur.read(a, scale, exec);
        for_each_row(
            exec,
            size,
            Plane::new(scale, size),
            #[inline(always)]
            |_, scale| {
                exec.simd().sqrt(scale);
                scale.iter_mut().for_each(|root| *root = 1.0 / *root);
            },
        );
        blur.spread([&*row_sum, &*scale], 0.0, a, b, exec);
        blur.read(a, row_sum, exec);
        row_sum.iter_mut().zip(&*scale).for_each(|(sum, scale)| *sum *= scale);
        Ok(Self { blur, weight, scale, row_sum, buffers: [a, b] })
    }

    /// Adds the row sums of the weighted kernel to `out`: a bound of its part of the diagonal.
    pub fn add_row_sums(&self, out: &mut [f32]) {
        for (out, sum) in out.iter_mut().zip(&*self.row_sum) {
            *out += self.weight * sum;
        }
    }

    /// Adds weight L x to `out` for one plane `x`.
    pub fn add_laplacian(&mut self, x: &[f32], out: &mut [f32], exec: &dyn Executor) {
        // L is 0 on constants, so any may be taken off first: a constant x gives exactly 0.
        let base = x.first().copied().unwrap_or(0.0);
        let [a, b] = &mut self.buffers;
        self.blur.spread([x, &*self.scale], base, a, b, exec);
        let n = self.blur.size;
        let (blur, a, scale, row_sum, weight) = (&self.blur, &**a, &*self.scale, &*self.row_sum, self.weight);
        for_each_row(
            exec,
            n,
            Plane::new(out, n),
            #[inline(always)]
            |y, out| {
                let (cells, second) = blur.between(a, y);
                let planes = [x, scale, row_sum].map(|plane| plane_row(plane, n, y));
                add_row(weight, planes, base, cells, second, out);
            },
        );
    }

    /// a^T (weight L) b for planes `a` and `b`; `scratch` is one plane.
    #[must_use]
    pub fn form(&mut self, a: &[f32], b: &[f32], scratch: &mut [f32], exec: &dyn Executor) -> f64 {
        scratch.fill(0.0);
        self.add_laplacian(b, scratch, exec);
        dot(a, scratch, self.blur.size, exec)
    }
}

/// out += weight (row_sum (x - base) - scale blurred), blurred lying between two rows of cells.
#[inline(always)]
fn add_row(
    weight: f32,
    [x, scale, row_sum]: [&[f32]; 3],
    base: f32,
    [above, below]: [&[f32]; 2],
    second: f32,
    out: &mut [f32],
) {
    let planes = x.iter().zip(scale).zip(row_sum);
    for (((out, ((x, scale), sum)), above), below) in out.iter_mut().zip(planes).zip(above).zip(below) {
        let blurred = (1.0 - second) * above + second * below;
        *out += weight * (sum * (x - base) - scale * blurred);
    }
}
