//! The oracle: the same energies with every kernel summed over all pairs of pixels, in f64. O(N²) memory and O(N³)
//! time: for images of some 50 x 50. It shares nothing with the product but the features and the weight maps.
use super::coefficients::normalised;
use super::refine::{Energy, UNARY_FLOOR};
use super::solver::Operator;
use crate::base::exec::{Executor, Inline};
use alloc::vec;
use alloc::vec::Vec;

/// The dense matrix A = diag(a) + 2 sum_k b_k (rowsum(Kn_k) - Kn_k) and the right-hand side of a CRF.
#[derive(Clone, Debug)]
pub struct Dense {
    size: usize,
    matrix: Vec<f64>,
    diagonal: Vec<f32>,
    /// Right-hand side, planes one after the other.
    pub rhs: Vec<f32>,
}

impl Dense {
    /// The system of an energy with (raw) coefficients.
    #[must_use]
    pub fn new<E: Energy<N>, const N: usize>(energy: &E, coefficients: &[f32; N]) -> Self {
        let size = energy.size();
        let n = size * size;
        let theta = normalised(coefficients);
        let mut matrix = vec![0.0_f64; n * n];
        let mut rhs: Vec<f32> = energy.unary(0).iter().map(|u| UNARY_FLOOR * u).collect();
        let mut map = vec![0.0; n];
        for (term, theta) in theta.iter().enumerate().take(E::UNARIES) {
            energy.unary_map(term, &Inline, &mut map);
            for (i, m) in map.iter().enumerate() {
                matrix[i * n + i] += f64::from(theta * m);
            }
            for (i, (rhs, u)) in rhs.iter_mut().zip(energy.unary(term)).enumerate() {
                *rhs += theta * map[i % n] * u;
            }
        }
        for i in 0..n {
            matrix[i * n + i] += f64::from(UNARY_FLOOR);
        }
        for (k, b) in theta.iter().skip(E::UNARIES).enumerate() {
            let (sigma, planes) = match k {
                0 => (E::SIGMA_SPATIAL, 0),
                _ => (E::SIGMA_POSITION, E::FEATURES[k - 1]),
            };
            let mut features = vec![0.0; planes * n];
            if planes > 0 {
                energy.features(k - 1, &Inline, &mut features);
            }
            add_laplacian(&mut matrix, size, f64::from(sigma), &features, 2.0 * f64::from(*b));
        }
        let diagonal = (0..n).map(|i| matrix[i * n + i] as f32).collect();
        Self { size, matrix, diagonal, rhs }
    }

    /// The solution by Cholesky's factorisation.
    #[must_use]
    pub fn solve(&self) -> Vec<f64> {
        let n = self.size * self.size;
        let mut l = self.matrix.clone();
        // Rows in blocks, so that an earlier row is read once for all of a block.
        for start in (0..n).step_by(BLOCK) {
            let (above, rest) = l.split_at_mut(start * n);
            let rows = BLOCK.min(n - start);
            for (j, other) in above.chunks_exact(n).enumerate() {
                for row in rest.chunks_exact_mut(n).take(rows) {
                    row[j] = (row[j] - dot(&row[..j], &other[..j])) / other[j];
                }
            }
            for i in 0..rows {
                let (above, rest) = rest.split_at_mut(i * n);
                let row = &mut rest[..n];
                for (j, other) in (start..).zip(above.chunks_exact(n)) {
                    row[j] = (row[j] - dot(&row[..j], &other[..j])) / other[j];
                }
                let j = start + i;
                row[j] = libm::sqrt(row[j] - dot(&row[..j], &row[..j]));
            }
        }
        let mut x: Vec<f64> = self.rhs.iter().map(|&b| f64::from(b)).collect();
        for x in x.chunks_exact_mut(n) {
            for i in 0..n {
                x[i] = (x[i] - dot(&l[i * n..i * n + i], &x[..i])) / l[i * n + i];
            }
            for i in (0..n).rev() {
                x[i] /= l[i * n + i];
                let (before, after) = x.split_at_mut(i);
                for (x, l) in before.iter_mut().zip(&l[i * n..i * n + i]) {
                    *x -= l * after[0];
                }
            }
        }
        x
    }
}

impl Operator for Dense {
    fn size(&self) -> usize {
        self.size
    }

    fn diagonal(&self) -> &[f32] {
        &self.diagonal
    }

    fn apply(&mut self, x: &[f32], out: &mut [f32], _exec: &dyn Executor) {
        let n = self.size * self.size;
        for (x, out) in x.chunks_exact(n).zip(out.chunks_exact_mut(n)) {
            for (row, out) in self.matrix.chunks_exact(n).zip(out) {
                *out = row.iter().zip(x).map(|(a, x)| a * f64::from(*x)).sum::<f64>() as f32;
            }
        }
    }
}

/// Rows that the factorisation works on together.
const BLOCK: usize = 16;

/// A dot product in eight running sums.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0_f64; 8];
    for (a, b) in a.chunks(8).zip(b.chunks(8)) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    sums.iter().sum()
}

/// Adds weight (rowsum(Kn) - Kn), Kn = D^-1/2 K D^-1/2, K a Gaussian of position and features (divided by 2 sigma).
fn add_laplacian(matrix: &mut [f64], size: usize, sigma: f64, features: &[f32], weight: f64) {
    let n = size * size;
    let step = 2.0 / size as f64;
    let mut kernel = vec![0.0_f64; n * n];
    for i in 0..n {
        for j in 0..n {
            let dx = step * ((i % size) as f64 - (j % size) as f64);
            let dy = step * ((i / size) as f64 - (j / size) as f64);
            let mut exponent = (dx * dx + dy * dy) / (2.0 * sigma * sigma);
            for plane in features.chunks_exact(n) {
                let d = f64::from(plane[i]) - f64::from(plane[j]);
                exponent += 2.0 * d * d;
            }
            kernel[i * n + j] = libm::exp(-exponent);
        }
    }
    let scale: Vec<f64> =
        kernel.chunks_exact(n).map(|row| 1.0 / libm::sqrt(row.iter().sum::<f64>())).collect();
    for i in 0..n {
        let mut sum = 0.0;
        for j in 0..n {
            let value = weight * scale[i] * kernel[i * n + j] * scale[j];
            sum += value;
            matrix[i * n + j] -= value;
        }
        matrix[i * n + i] += sum;
    }
}
