//! Conjugate gradients for several right-hand sides at once, preconditioned with the diagonal and, where the operator
//! has one, a coarse correction ([`Operator::correct`]).
//!
//! Sums run row by row in a fixed order, so the result does not depend on the executor. Vectors hold `channels` planes
//! one after the other; every channel has its own step sizes and stops on its own.
use super::coarse::Cells;
use super::vectors::{MAX_CHANNELS, dot, tail, weighted_square};
use crate::Error;
use crate::base::exec::{Executor, Plane, ROWS_PER_BLOCK, Watch, for_each_row, for_each_row_block, within};
use crate::base::lanes::LANES;
use core::ops::ControlFlow;

/// A symmetric positive definite matrix over the pixels of a square image, the same for every channel.
pub trait Operator: Send {
    /// Pixels per side.
    fn size(&self) -> usize;
    /// `out` = A `x`, plane by plane.
    fn apply(&mut self, x: &[f32], out: &mut [f32], exec: &dyn Executor);
    /// The diagonal of A, or something near it: positive, one plane.
    fn diagonal(&self) -> &[f32];
    /// Makes the coarse correction c of a residual `r` of `channel`, constant over cells, and returns r^T c; nothing
    /// and 0 where there is none.
    fn correct(&mut self, _channel: usize, _r: &[f32], _exec: &dyn Executor) -> f64 {
        0.0
    }
    /// The last correction of `channel`, if there are any: the cells and their values.
    fn correction(&self, _channel: usize) -> Option<(Cells, &[f32])> {
        None
    }
}

/// When to stop.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// The residual (see [`Report`]) that is good enough.
    pub tolerance: f32,
    /// Steps after which to stop all the same.
    pub max_iterations: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self { tolerance: 2e-4, max_iterations: 50 }
    }
}

/// What a solver did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Report {
    /// Steps taken.
    pub iterations: usize,
    /// |A x - b| / |b|, the largest of the channels', with |v|² = v^T M^-1 v, M being the preconditioner: diag(A), so that
    /// pixels with little say of their own count as much as others, or that with a coarse correction, which comes near
    /// the energy of the error in proportion to the solution's.
    pub residual: f32,
}

/// Values of working memory that [`solve`] needs for each value of the unknown.
pub const VECTORS: usize = 3;

/// Improves `x` until A `x` = `rhs` within the tolerance. `vectors` is working memory, [`VECTORS`] times as long.
///
/// A start that already is a solution comes back bit for bit, with 0 iterations.
///
/// # Errors
/// [`Error::PlaneLength`] when `rhs` or `x` are not 1 to 3 planes, [`Error::CrfInput`] when the start's
/// residual is not finite.
pub fn solve(
    operator: &mut dyn Operator,
    rhs: &[f32],
    x: &mut [f32],
    options: &Options,
    exec: &dyn Executor,
    vectors: &mut [f32],
) -> Result<Report, Error> {
    solve_watched(operator, (rhs, x), options, exec, vectors, &mut |_| ControlFlow::Continue(()))
}

/// [`solve`], which tells `watch` after each of its steps; with many joins each, they run by [`within`].
pub(super) fn solve_watched(
    operator: &mut dyn Operator,
    (rhs, x): (&[f32], &mut [f32]),
    options: &Options,
    exec: &dyn Executor,
    vectors: &mut [f32],
    watch: Watch<'_>,
) -> Result<Report, Error> {
    let size = operator.size();
    let n2 = size.saturating_mul(size);
    let channels = x.len().checked_div(n2).unwrap_or(0);
    if channels == 0 || channels > MAX_CHANNELS || x.len() != channels * n2 || operator.diagonal().len() != n2
    {
        return Err(Error::PlaneLength { needed: n2, given: x.len() });
    }
    if rhs.len() != x.len() {
        return Err(Error::PlaneLength { needed: x.len(), given: rhs.len() });
    }
    let mut parts = vectors.chunks_exact_mut(x.len());
    let (Some(r), Some(p), Some(q)) = (parts.next(), parts.next(), parts.next()) else {
        return Err(Error::PlaneLength { needed: VECTORS * x.len(), given: vectors.len() });
    };

    let mut state = [Channel::default(); MAX_CHANNELS];
    within(exec, || {
        operator.apply(x, q, exec);
        for (r, (b, q)) in r.chunks_exact_mut(n2).zip(rhs.chunks_exact(n2).zip(q.chunks_exact(n2))) {
            difference(b, q, r, size, exec);
        }
        for (index, (channel, (r, b))) in
            state.iter_mut().zip(r.chunks_exact(n2).zip(rhs.chunks_exact(n2))).enumerate()
        {
            channel.rhs = square(operator, index, b, exec);
            channel.residual = square(operator, index, r, exec);
            if !channel.residual.is_finite() || !channel.rhs.is_finite() {
                return Err(Error::CrfInput);
            }
        }
        for (index, (channel, (r, p))) in
            state.iter().zip(r.chunks_exact(n2).zip(p.chunks_exact_mut(n2))).enumerate()
        {
            if channel.active(options) {
                direction(r, operator, index, 0.0, p, exec);
            } else {
                p.fill(0.0);
            }
        }
        Ok(())
    })?;
    let mut iterations = 0;
    while iterations < options.max_iterations && state.iter().any(|c| c.active(options)) {
        // How many there will be nobody knows: eight are half of it.
        if watch(iterations as f32 / (iterations + 8) as f32).is_break() {
            return Err(Error::Cancelled);
        }
        iterations += 1;
        within(exec, || {
            operator.apply(p, q, exec);
            let planes = p.chunks_exact_mut(n2).zip(q.chunks_exact(n2));
            let unknowns = x.chunks_exact_mut(n2).zip(r.chunks_exact_mut(n2));
            for (index, (channel, ((p, q), (x, r)))) in state.iter_mut().zip(planes.zip(unknowns)).enumerate()
            {
                if !channel.active(options) {
                    continue;
                }
                let curvature = dot(p, q, size, exec);
                let step = (channel.residual / curvature) as f32;
                // Rounding alone can bring this about; the channel's best solution so far stands.
                channel.stuck = curvature.is_nan() || curvature <= 0.0 || !step.is_finite();
                if !channel.stuck {
                    advance(step, p, q, x, r, size, exec);
                    let before = channel.residual;
                    channel.residual = square(operator, index, r, exec);
                    if channel.active(options) {
                        direction(r, operator, index, (channel.residual / before) as f32, p, exec);
                        continue;
                    }
                }
                p.fill(0.0);
            }
            Ok(())
        })?;
    }
    let residual = state.iter().map(Channel::relative).fold(0.0, f64::max);
    Ok(Report { iterations, residual: residual as f32 })
}

#[derive(Clone, Copy, Debug, Default)]
struct Channel {
    /// Squares of the norms of the right-hand side and the residual.
    rhs: f64,
    residual: f64,
    stuck: bool,
}

impl Channel {
    fn active(&self, options: &Options) -> bool {
        let tolerance = f64::from(options.tolerance);
        !self.stuck && self.residual > tolerance * tolerance * self.rhs
    }

    fn relative(&self) -> f64 {
        if self.residual > 0.0 {
            f64::from(crate::base::math::sqrtf((self.residual / self.rhs) as f32))
        } else {
            0.0
        }
    }
}

/// r^T M^-1 r, M being the preconditioner; the correction that this makes stays for [`direction`].
fn square(operator: &mut dyn Operator, channel: usize, r: &[f32], exec: &dyn Executor) -> f64 {
    let fine = weighted_square(r, operator.diagonal(), operator.size(), exec);
    fine + operator.correct(channel, r, exec)
}

/// p = M^-1 r + beta p, M being the preconditioner.
fn direction(
    r: &[f32],
    operator: &dyn Operator,
    channel: usize,
    beta: f32,
    p: &mut [f32],
    exec: &dyn Executor,
) {
    let (size, diagonal, correction) = (operator.size(), operator.diagonal(), operator.correction(channel));
    for_each_row(
        exec,
        size,
        Plane::new(p, size),
        #[inline(always)]
        |y, p| {
            for ((p, r), d) in p.iter_mut().zip(tail(r, y * size)).zip(tail(diagonal, y * size)) {
                *p = if beta == 0.0 { r / d } else { r / d + beta * *p };
            }
            let Some((cells, values)) = correction else { return };
            for (run, p) in p.chunks_mut(LANES).enumerate() {
                for (p, value) in p.iter_mut().zip(&cells.expanded(values, y, run * LANES)) {
                    *p += value;
                }
            }
        },
    );
}

/// r = b - q.
fn difference(b: &[f32], q: &[f32], r: &mut [f32], size: usize, exec: &dyn Executor) {
    for_each_row_block(exec, size, ROWS_PER_BLOCK, Plane::new(r, size), &|rows, mut block| {
        let (b, q) = (tail(b, rows.start * size), tail(q, rows.start * size));
        exec.simd().run(
            #[inline(always)]
            || {
                for ((r, b), q) in block.values().iter_mut().zip(b).zip(q) {
                    *r = b - q;
                }
            },
        );
    });
}

/// x += step p, r -= step q.
fn advance(step: f32, p: &[f32], q: &[f32], x: &mut [f32], r: &mut [f32], size: usize, exec: &dyn Executor) {
    let out = (Plane::new(x, size), Plane::new(r, size));
    for_each_row_block(exec, size, ROWS_PER_BLOCK, out, &|rows, (mut x, mut r)| {
        let (p, q) = (tail(p, rows.start * size), tail(q, rows.start * size));
        exec.simd().run(
            #[inline(always)]
            || {
                for (x, p) in x.values().iter_mut().zip(p) {
                    *x += step * p;
                }
                for (r, q) in r.values().iter_mut().zip(q) {
                    *r -= step * q;
                }
            },
        );
    });
}
