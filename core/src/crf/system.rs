//! The matrix of a CRF: A = diag(a) + b_1 L_1 + the graph of the bilateral kernels, see the [module](super).
use super::coarse::{Cells, Coarse};
use super::pairs::{Kernel, MAX_KERNELS, Pairs};
use super::pattern::{SAMPLES, pattern};
use super::separable::Spatial;
use super::solver::Operator;
use super::vectors::{sum, tail};
use crate::Error;
use crate::base::arena::{Arena, bytes_for};
use crate::base::exec::{Executor, ROWS_PER_BLOCK, for_each_row_block, planes3};

/// Sigma of a position kernel, position in [-1,1]: `sigma` in units of p to pixels.
#[must_use]
pub fn pixels(sigma: f32, size: usize) -> f32 {
    sigma * 0.5 * size as f32
}

/// Widths and weights of a CRF's kernels. Weights are those of the energy; A holds twice them, because the energy
/// sums over ordered pairs.
#[derive(Clone, Copy, Debug)]
pub struct Kernels<'f> {
    /// Sigma of kappa_1 in units of p, and its weight.
    pub spatial: (f32, f32),
    /// Sigma of the positions in the bilateral kernels.
    pub sigma: f32,
    /// The bilateral kernels; unused ones have weight 0.
    pub bilateral: [Kernel<'f>; MAX_KERNELS],
}

/// The matrix A.
#[derive(Debug)]
pub struct System<'a> {
    size: usize,
    unary: &'a [f32],
    diagonal: &'a mut [f32],
    spatial: Option<Spatial<'a>>,
    pairs: Option<Pairs<'a>>,
    /// Sigma in pixels and weight of kappa_1, and sigma of the graph.
    widths: ((f32, f32), f32),
    coarse: Option<Coarse<'a>>,
}

/// How many times the unary weights the diagonal must be, in sum over the pixels, for a coarse correction to save more
/// steps than it costs (docs/crf.md).
const COARSE_FROM: f64 = 5.0;

impl<'a> System<'a> {
    /// Bytes that [`System::new`] and [`System::add_coarse`] take, the most that they need while they run included.
    #[must_use]
    pub fn bytes(size: usize, spatial_sigma: f32, sigma: f32) -> usize {
        let pattern = pattern(pixels(sigma, size), SAMPLES);
        let widest = pixels(spatial_sigma.max(sigma), size);
        bytes_for::<f32>(size.saturating_mul(size))
            .saturating_add(Spatial::bytes(size, pixels(spatial_sigma, size)))
            .saturating_add(Pairs::bytes(size, &pattern))
            .saturating_add(Pairs::build_bytes(size).max(Coarse::bytes(size, widest)))
    }

    /// The matrix with the unary weights `unary` (one plane, each >= 0) and the kernels. Kernels of weight 0 cost
    /// nothing.
    ///
    /// # Errors
    /// [`Error::PlaneLength`], [`Error::WorkspaceTooSmall`].
    pub fn new(
        size: usize,
        unary: &'a [f32],
        kernels: &Kernels<'_>,
        exec: &dyn Executor,
        arena: &mut Arena<'a>,
    ) -> Result<Self, Error> {
        crate::base::planes::check_planes(size, 1, unary.len())?;
        let diagonal = arena.take::<f32>(unary.len())?;
        diagonal.copy_from_slice(unary);
        let (sigma, weight) = kernels.spatial;
        let spatial = if weight > 0.0 {
            let spatial = Spatial::new(size, pixels(sigma, size), 2.0 * weight, exec, arena)?;
            spatial.add_row_sums(diagonal);
            Some(spatial)
        } else {
            None
        };
        // Only the used kernels, first ones first.
        let used = |k: &Kernel<'_>| k.weight > 0.0;
        let doubled = kernels.bilateral.map(|k| Kernel { weight: 2.0 * k.weight, ..k });
        let [first, second] = &doubled;
        let list: &[Kernel<'_>] = match (used(first), used(second)) {
            (true, true) => &doubled,
            (true, false) => core::slice::from_ref(first),
            (false, true) => core::slice::from_ref(second),
            (false, false) => &[],
        };
        let pairs = if list.is_empty() {
            None
        } else {
            let pattern = pattern(pixels(kernels.sigma, size), SAMPLES);
            let pairs = Pairs::build(size, &pattern, list, exec, arena)?;
            pairs.add_row_sums(diagonal, exec);
            Some(pairs)
        };
        let widths = ((pixels(sigma, size), 2.0 * weight), pixels(kernels.sigma, size));
        Ok(Self { size, unary, diagonal, spatial, pairs, widths, coarse: None })
    }

    /// Adds a coarse correction to the preconditioner if it is worth its cost.
    ///
    /// # Errors
    /// [`Error::WorkspaceTooSmall`].
    pub fn add_coarse(&mut self, exec: &dyn Executor, arena: &mut Arena<'a>) -> Result<(), Error> {
        let [unary, diagonal] = [self.unary, &*self.diagonal].map(|plane| sum(plane, self.size, exec));
        if diagonal >= COARSE_FROM * unary {
            let (spatial, sigma) = self.widths;
            let widest = (self.size, sigma.max(spatial.0));
            let spatial = self.spatial.is_some().then_some(spatial);
            self.coarse = Some(Coarse::new(self.unary, self.pairs.as_ref(), spatial, widest, exec, arena)?);
        }
        Ok(())
    }

    /// Whether any kernel has weight: without, A is diagonal.
    #[must_use]
    pub fn has_pairwise(&self) -> bool {
        self.spatial.is_some() || self.pairs.is_some()
    }

    /// a^T (A - diag) b for one plane each: the pairwise part as a bilinear form. `scratch` is one plane.
    #[must_use]
    pub fn pairwise_form(&mut self, a: &[f32], b: &[f32], scratch: &mut [f32], exec: &dyn Executor) -> f64 {
        let spatial = self.spatial.as_mut().map_or(0.0, |s| s.form(a, b, scratch, exec));
        spatial + self.pairs.as_ref().map_or(0.0, |p| p.form(a, b))
    }
}

impl Operator for System<'_> {
    fn size(&self) -> usize {
        self.size
    }

    fn diagonal(&self) -> &[f32] {
        self.diagonal
    }

    fn correct(&mut self, channel: usize, r: &[f32], exec: &dyn Executor) -> f64 {
        self.coarse.as_mut().map_or(0.0, |coarse| coarse.correct(channel, r, exec))
    }

    fn correction(&self, channel: usize) -> Option<(Cells, &[f32])> {
        self.coarse.as_ref().map(|coarse| coarse.correction(channel))
    }

    fn apply(&mut self, x: &[f32], out: &mut [f32], exec: &dyn Executor) {
        let (size, n2) = (self.size, self.size * self.size);
        let (unary, pairs) = (self.unary, self.pairs.as_ref());
        let plane = |c: usize| x.get(c * n2..(c + 1) * n2).unwrap_or(&[]);
        let planes = [plane(0), plane(1), plane(2)];
        let blocks = planes3(&mut *out, size, size);
        for_each_row_block(exec, size, ROWS_PER_BLOCK, blocks, &|rows, mut block| {
            exec.simd().run(
                #[inline(always)]
                || {
                    let [first, second, third] = &mut block;
                    let (mut second, mut third) = (second.rows(), third.rows());
                    for (y, first) in rows.zip(first.rows()) {
                        let mut three =
                            [first, second.next().unwrap_or(&mut []), third.next().unwrap_or(&mut [])];
                        for (out, plane) in three.iter_mut().zip(&planes) {
                            let row = tail(plane, y * size).iter().zip(tail(unary, y * size));
                            for (out, (x, a)) in out.iter_mut().zip(row) {
                                *out = a * x;
                            }
                        }
                        let Some(pairs) = pairs else { continue };
                        let [first, second, third] = three;
                        if third.is_empty() {
                            pairs.add_laplacian_row(y, [planes[0]], [first]);
                            if !second.is_empty() {
                                pairs.add_laplacian_row(y, [planes[1]], [second]);
                            }
                        } else {
                            pairs.add_laplacian_row(y, planes, [first, second, third]);
                        }
                    }
                },
            );
        });
        if let Some(spatial) = &mut self.spatial {
            for (x, out) in x.chunks_exact(n2).zip(out.chunks_exact_mut(n2)) {
                spatial.add_laplacian(x, out, exec);
            }
        }
    }
}
