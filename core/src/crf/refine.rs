//! From an energy and its coefficients to the refined map, and to the derivative by the coefficients.
use super::coefficients::{normalised, through_normalisation};
use super::feature::SIGMA_POSITION;
use super::pairs::{Kernel, MAX_KERNELS};
use super::solver::{Options, Report, VECTORS, solve, solve_watched};
use super::system::{Kernels, System};
use super::vectors::dot;
use crate::Error;
use crate::base::arena::{Arena, bytes_for};
use crate::base::exec::{Executor, Inline, Watch, within};
use crate::base::planes::check_planes;
use core::ops::ControlFlow;

/// Added to every pixel's unary weight (the coefficients' sum is 1), so that a pixel without a say of its own still
/// has one solution.
pub const UNARY_FLOOR: f32 = 1e-4;

/// What one of the paper's CRFs is made of. Its `N` coefficients are [`Energy::UNARIES`] unary ones, then kappa_1's,
/// then one for each bilateral kernel.
pub trait Energy<const N: usize>: Sync {
    /// Planes of the map.
    const CHANNELS: usize;
    /// Unary terms, at least 1.
    const UNARIES: usize;
    /// Sigma of kappa_1 in units of p.
    const SIGMA_SPATIAL: f32;
    /// Sigma of the positions in the bilateral kernels.
    const SIGMA_POSITION: f32 = SIGMA_POSITION;
    /// Feature planes of each bilateral kernel.
    const FEATURES: [usize; MAX_KERNELS];

    /// Pixels per side.
    fn size(&self) -> usize;
    /// Checks the lengths of the inputs.
    ///
    /// # Errors
    /// [`Error::PlaneLength`], [`Error::Size`].
    fn check(&self) -> Result<(), Error>;
    /// What unary `term` pulls the map to.
    fn unary(&self, term: usize) -> &[f32];
    /// The weight map of unary `term`, one plane, values in [0,1].
    fn unary_map(&self, term: usize, exec: &dyn Executor, out: &mut [f32]);
    /// The features of bilateral kernel `kernel`, each divided by twice its sigma.
    fn features(&self, kernel: usize, exec: &dyn Executor, out: &mut [f32]);
    /// Puts the solution, or a map of any other size, where maps live.
    fn project(&self, map: &mut [f32]);
}

/// Bytes of workspace that [`refine`] and [`derivative`] need for a map of `size` x `size`.
#[must_use]
pub fn workspace_bytes<E: Energy<N>, const N: usize>(size: usize) -> usize {
    if size > crate::base::planes::MAX_SIZE {
        return usize::MAX;
    }
    let n2 = size.saturating_mul(size);
    bytes_for::<f32>(n2)
        .saturating_add(bytes_for::<f32>(n2.saturating_mul(E::CHANNELS)).saturating_mul(2))
        .saturating_add(bytes_for::<f32>(vectors_len::<E, N>(n2)))
        .saturating_add(System::bytes(size, E::SIGMA_SPATIAL, E::SIGMA_POSITION))
}

/// Vectors serve the weight maps and features first, the solver afterwards.
fn vectors_len<E: Energy<N>, const N: usize>(n2: usize) -> usize {
    let features: usize = E::FEATURES.iter().sum();
    n2.saturating_mul((VECTORS * E::CHANNELS).max(features).max(1))
}

/// Minimises the energy: the refined map goes to `out`.
///
/// Without pairwise weight this is the unary itself; an input that is constant comes back constant. Coefficients need
/// not be normalised.
///
/// # Errors
/// [`Error::PlaneLength`] or [`Error::Size`] when a slice has the wrong length, [`Error::CrfInput`] when an input is
/// not finite, [`Error::WorkspaceTooSmall`].
pub fn refine<E: Energy<N>, const N: usize>(
    energy: &E,
    coefficients: &[f32; N],
    options: &Options,
    out: &mut [f32],
    exec: &dyn Executor,
    arena: &mut Arena<'_>,
) -> Result<Report, Error> {
    refine_watched(energy, coefficients, options, out, exec, arena, &mut |_| ControlFlow::Continue(()))
}

/// Share of the progress that the matrix takes.
const ASSEMBLED: f32 = 0.4;

/// [`refine`], which tells `watch` how far it is before every step of the solver.
///
/// # Errors
/// As [`refine`], and [`Error::Cancelled`].
pub fn refine_watched<E: Energy<N>, const N: usize>(
    energy: &E,
    coefficients: &[f32; N],
    options: &Options,
    out: &mut [f32],
    exec: &dyn Executor,
    arena: &mut Arena<'_>,
    watch: Watch<'_>,
) -> Result<Report, Error> {
    energy.check()?;
    check_planes(energy.size(), E::CHANNELS, out.len())?;
    let mut arena = arena.scope();
    let theta = normalised(coefficients);
    let vectors = arena.take(vectors_len::<E, N>(energy.size() * energy.size()))?;
    let unary = arena.take(energy.size() * energy.size())?;
    let rhs = arena.take(out.len())?;
    within(exec, || {
        unaries(energy, &theta, unary, vectors, out, exec);
        multiply(unary, out, rhs);
        Ok(())
    })?;
    let unary = &*unary;
    let mut system = within(exec, || {
        let mut system = assemble(energy, unary, pairwise::<E, N>(&theta), vectors, exec, &mut arena)?;
        if system.has_pairwise() {
            system.add_coarse(exec, &mut arena)?;
        }
        Ok(system)
    })?;
    let report = if system.has_pairwise() {
        let mut watch = |part: f32| watch(ASSEMBLED + (1.0 - ASSEMBLED) * part);
        solve_watched(&mut system, (rhs, out), options, exec, vectors, &mut watch)?
    } else {
        Report::default()
    };
    energy.project(out);
    Ok(report)
}

/// The derivative of a loss by the (raw) coefficients, given the minimum `solution` (not projected) and the loss's
/// gradient by it.
///
/// The minimum solves A x = r; with A l = `loss_gradient` (the same symmetric system) the derivative is
/// l^T (dr/dtheta - dA/dtheta x).
///
/// # Errors
/// As [`refine`].
pub fn derivative<E: Energy<N>, const N: usize>(
    energy: &E,
    coefficients: &[f32; N],
    options: &Options,
    [solution, loss_gradient]: [&[f32]; 2],
    exec: &dyn Executor,
    arena: &mut Arena<'_>,
) -> Result<[f32; N], Error> {
    energy.check()?;
    let n2 = energy.size() * energy.size();
    check_planes(energy.size(), E::CHANNELS, solution.len())?;
    check_planes(energy.size(), E::CHANNELS, loss_gradient.len())?;
    let mut arena = arena.scope();
    let theta = normalised(coefficients);
    let vectors = arena.take(vectors_len::<E, N>(n2))?;
    let unary = arena.take(n2)?;
    let adjoint = arena.take(solution.len())?;
    unaries(energy, &theta, unary, vectors, adjoint, exec);
    let mut scope = arena.scope();
    let mut system = assemble(energy, unary, pairwise::<E, N>(&theta), vectors, exec, &mut scope)?;
    adjoint.fill(0.0);
    system.add_coarse(exec, &mut scope)?;
    solve(&mut system, loss_gradient, adjoint, options, exec, vectors)?;

    let mut gradient = [0.0_f32; N];
    for (term, gradient) in gradient.iter_mut().enumerate().take(E::UNARIES) {
        let Some(map) = vectors.get_mut(..n2) else { continue };
        energy.unary_map(term, exec, map);
        let mut sum = 0.0_f64;
        let values = energy.unary(term).iter().zip(solution);
        for ((weight, adjoint), (u, x)) in map.iter().cycle().zip(&*adjoint).zip(values) {
            sum += f64::from(weight * adjoint) * f64::from(u - x);
        }
        *gradient = sum as f32;
    }
    for (term, gradient) in gradient.iter_mut().enumerate().skip(E::UNARIES) {
        let mut only = [0.0; 1 + MAX_KERNELS];
        if let Some(weight) = only.get_mut(term - E::UNARIES) {
            *weight = 1.0;
        }
        let mut scope = arena.scope();
        let mut system = assemble(energy, unary, only, vectors, exec, &mut scope)?;
        let Some(scratch) = vectors.get_mut(..n2) else { continue };
        let mut sum = 0.0_f64;
        for (l, x) in adjoint.chunks_exact(n2).zip(solution.chunks_exact(n2)) {
            sum -= system.pairwise_form(l, x, scratch, exec);
        }
        *gradient = sum as f32;
    }
    Ok(through_normalisation(coefficients, &gradient))
}

/// The pairwise coefficients: kappa_1's and the bilateral kernels'.
fn pairwise<E: Energy<N>, const N: usize>(theta: &[f32; N]) -> [f32; 1 + MAX_KERNELS] {
    let mut weights = [0.0; 1 + MAX_KERNELS];
    weights.iter_mut().zip(theta.iter().skip(E::UNARIES)).for_each(|(weight, b)| *weight = *b);
    weights
}

/// The sum of the unary weights to `weights`, and the map that the unaries alone ask for to `start`.
fn unaries<E: Energy<N>, const N: usize>(
    energy: &E,
    theta: &[f32; N],
    weights: &mut [f32],
    scratch: &mut [f32],
    start: &mut [f32],
    exec: &dyn Executor,
) {
    weights.fill(UNARY_FLOOR);
    start.copy_from_slice(energy.unary(0));
    let Some(map) = scratch.get_mut(..weights.len()) else { return };
    for (term, &theta) in theta.iter().enumerate().take(E::UNARIES) {
        energy.unary_map(term, exec, map);
        for (weight, m) in weights.iter_mut().zip(&*map) {
            *weight += theta * m;
        }
        if term == 0 || theta == 0.0 {
            continue;
        }
        // The running mean: exactly the value itself where both unaries agree.
        let shares = weights.iter().zip(&*map).cycle();
        for ((start, value), (weight, m)) in start.iter_mut().zip(energy.unary(term)).zip(shares) {
            *start += theta * m / weight * (value - *start);
        }
    }
}

/// rhs = weights x, plane by plane.
fn multiply(weights: &[f32], x: &[f32], rhs: &mut [f32]) {
    for (rhs, x) in rhs.chunks_exact_mut(weights.len()).zip(x.chunks_exact(weights.len())) {
        rhs.iter_mut().zip(weights.iter().zip(x)).for_each(|(rhs, (a, x))| *rhs = a * x);
    }
}

/// The matrix with the kernels' weights `pairwise`; features are made in `scratch`.
fn assemble<'a, E: Energy<N>, const N: usize>(
    energy: &E,
    unary: &'a [f32],
    pairwise: [f32; 1 + MAX_KERNELS],
    scratch: &mut [f32],
    exec: &dyn Executor,
    arena: &mut Arena<'a>,
) -> Result<System<'a>, Error> {
    let n2 = energy.size() * energy.size();
    let lengths = E::FEATURES.map(|planes| planes * n2);
    let given = scratch.len();
    let Some((first, rest)) = scratch.split_at_mut_checked(lengths[0]) else {
        return Err(Error::PlaneLength { needed: lengths[0], given });
    };
    let Some(second) = rest.get_mut(..lengths[1]) else {
        return Err(Error::PlaneLength { needed: lengths[1], given });
    };
    let [spatial, b2, b3] = pairwise;
    if b2 > 0.0 {
        energy.features(0, exec, first);
    }
    if b3 > 0.0 {
        energy.features(1, exec, second);
    }
    let kernels = Kernels {
        spatial: (E::SIGMA_SPATIAL, spatial),
        sigma: E::SIGMA_POSITION,
        bilateral: [Kernel { features: first, weight: b2 }, Kernel { features: second, weight: b3 }],
    };
    System::new(energy.size(), unary, &kernels, exec, arena)
}

/// a^T b over whole planes of `size` x `size`.
#[must_use]
pub fn inner(a: &[f32], b: &[f32], size: usize) -> f64 {
    dot(a, b, size, &Inline)
}
