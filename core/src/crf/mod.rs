//! Dense continuous CRFs: the refinement of albedo, normals and roughness.
//!
//! Each minimises sum_i a_i (x_i - u_i)² + sum_k b_k sum_ij Kn_k(i,j) (x_i - x_j)², i and j over all pixels, with
//! Gaussian kernels of position (and colour) made symmetric and of row sums near 1, Kn = D^-1/2 K D^-1/2 with D the row
//! sums of K. The minimum solves (diag(a) + 2 sum_k b_k (rowsum(Kn_k) - Kn_k)) x = a u: symmetric, positive definite,
//! and an M-matrix, so x stays between the unaries' extremes. Sources: paper, "Designing DCRFs for Refinement" and
//! "Details of Continuous DCRFs"; docs/crf.md says why the kernels are filtered as they are, and how exact they are.
//!
//! Coefficients are normalised to sum 1. Planes are `size` x `size`; positions p in [-1,1].
//! Guarantees: constants stay constant; no pairwise weight gives the unary back bit for bit; the same bits on every
//! executor; no allocation, no panic.
pub mod albedo;
pub mod coarse;
pub mod coefficients;
#[cfg(any(test, feature = "reference"))]
pub mod exact;
pub mod feature;
pub mod normal;
pub mod pairs;
pub mod pattern;
mod refine;
pub mod roughness;
#[cfg(any(test, feature = "reference"))]
pub mod scenes;
pub mod separable;
pub mod solver;
pub mod system;
#[cfg(test)]
mod tests;
mod unprojected;
mod vectors;

pub use albedo::Albedo;
pub use coefficients::Coefficients;
pub use normal::Normal;
pub use refine::{Energy, UNARY_FLOOR, derivative, inner, refine, refine_watched, workspace_bytes};
pub use roughness::Roughness;
pub use solver::{Options, Report};
pub use unprojected::Unprojected;

/// Bytes of workspace that any of the three CRFs needs for maps of `size` x `size`.
#[must_use]
pub fn max_workspace_bytes(size: usize) -> usize {
    workspace_bytes::<Albedo<'_>, 5>(size)
        .max(workspace_bytes::<Normal<'_>, 3>(size))
        .max(workspace_bytes::<Roughness<'_>, 4>(size))
}
