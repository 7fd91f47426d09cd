//! Kernels too wide for every offset, against all pairs within four sigma: what the sampled pattern costs.
use super::super::coefficients::normalised;
use super::super::pattern::{MAX_OFFSETS, SAMPLES, for_each_in_half_disc, pattern};
use super::super::solver::{Operator, VECTORS, solve};
use super::super::system::pixels;
use super::super::{Energy, Options, UNARY_FLOOR, refine};
use super::{Scene, relative_error, workspace};
use crate::base::arena::Arena;
use crate::base::exec::{Executor, Inline};
use std::vec;
use std::vec::Vec;

/// The matrix of an energy's bilateral kernels over all pairs within four sigma; kappa_1 is left out.
struct Near {
    size: usize,
    offsets: Vec<(isize, isize)>,
    /// A weight for each pixel and offset, 0 where the partner is no pixel.
    weights: Vec<f32>,
    unary: Vec<f32>,
    diagonal: Vec<f32>,
}

impl Near {
    fn new<E: Energy<N>, const N: usize>(energy: &E, theta: &[f32; N]) -> Self {
        let (size, n2) = (energy.size(), energy.size() * energy.size());
        let sigma = pixels(E::SIGMA_POSITION, size);
        let reach = (4.0 * sigma) as isize;
        let offsets: Vec<(isize, isize)> = (-reach..=reach)
            .flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy)))
            .filter(|&(dx, dy)| (dx, dy) != (0, 0) && dx * dx + dy * dy <= reach * reach)
            .collect();
        let mut near =
            Self { size, offsets, weights: vec![], unary: vec![UNARY_FLOOR; n2], diagonal: vec![] };
        let mut map = vec![0.0; n2];
        for (term, theta) in theta.iter().enumerate().take(E::UNARIES) {
            energy.unary_map(term, &Inline, &mut map);
            near.unary.iter_mut().zip(&map).for_each(|(sum, m)| *sum += theta * m);
        }
        near.weights = vec![0.0; n2 * near.offsets.len()];
        for (kernel, b) in theta.iter().skip(E::UNARIES + 1).enumerate() {
            let mut features = vec![0.0; E::FEATURES[kernel] * n2];
            energy.features(kernel, &Inline, &mut features);
            let affinity = |i: usize, j: usize, (dx, dy): (isize, isize)| {
                let unlike: f32 = features.chunks_exact(n2).map(|f| (f[i] - f[j]) * (f[i] - f[j])).sum();
                (-((dx * dx + dy * dy) as f32) / (2.0 * sigma * sigma) - 2.0 * unlike).exp()
            };
            let partners =
                |i: usize| near.offsets.iter().filter_map(move |&o| Some((partner(size, i, o)?, o)));
            let scale: Vec<f32> = (0..n2)
                .map(|i| 1.0 / (1.0 + partners(i).map(|(j, o)| affinity(i, j, o)).sum::<f32>()).sqrt())
                .collect();
            let mut more = Vec::new();
            for i in 0..n2 {
                more.extend(near.offsets.iter().map(|&o| {
                    partner(size, i, o).map_or(0.0, |j| 2.0 * b * scale[i] * scale[j] * affinity(i, j, o))
                }));
            }
            near.weights.iter_mut().zip(more).for_each(|(sum, w)| *sum += w);
        }
        let sums = near.weights.chunks_exact(near.offsets.len()).map(|row| row.iter().sum::<f32>());
        near.diagonal = near.unary.iter().zip(sums).map(|(a, sum)| a + sum).collect();
        near
    }
}

fn partner(size: usize, i: usize, (dx, dy): (isize, isize)) -> Option<usize> {
    let x = (i % size).checked_add_signed(dx).filter(|x| *x < size)?;
    let y = (i / size).checked_add_signed(dy).filter(|y| *y < size)?;
    Some(y * size + x)
}

impl Operator for Near {
    fn size(&self) -> usize {
        self.size
    }

    fn diagonal(&self) -> &[f32] {
        &self.diagonal
    }

    fn apply(&mut self, x: &[f32], out: &mut [f32], _exec: &dyn Executor) {
        let n2 = self.size * self.size;
        for (x, out) in x.chunks_exact(n2).zip(out.chunks_exact_mut(n2)) {
            for (i, (out, row)) in
                out.iter_mut().zip(self.weights.chunks_exact(self.offsets.len())).enumerate()
            {
                let differences = self
                    .offsets
                    .iter()
                    .zip(row)
                    .filter_map(|(&o, w)| Some(w * (x[i] - x[partner(self.size, i, o)?])));
                *out = self.unary[i] * x[i] + differences.sum::<f32>();
            }
        }
    }
}

fn check<E: Energy<N>, const N: usize>(name: &str, energy: &E, raw: &[f32; N], bound: f64) {
    let mut near = Near::new(energy, &normalised(raw));
    let n2 = energy.size() * energy.size();
    // One unary alone, so that it is the start and the right-hand side's map.
    let mut exact = energy.unary(0).to_vec();
    let rhs: Vec<f32> = exact.iter().enumerate().map(|(i, u)| near.unary[i % n2] * u).collect();
    let options = Options { tolerance: 1e-5, max_iterations: 200 };
    let mut vectors = vec![0.0; VECTORS * exact.len()];
    solve(&mut near, &rhs, &mut exact, &options, &Inline, &mut vectors).expect("solved");
    energy.project(&mut exact);
    let mut ours = energy.unary(0).to_vec();
    let mut bytes = workspace::<E, N>(energy.size());
    refine(energy, raw, &Options::default(), &mut ours, &Inline, &mut Arena::new(&mut bytes))
        .expect("refined");
    let error = relative_error(&ours, &exact);
    let moved = relative_error(energy.unary(0), &exact);
    std::println!("{name}: error {error:.2e}, refinement {moved:.2e}");
    assert!(error <= bound, "{name}: {error} over {bound}");
}

#[test]
fn sampled_kernels_agree_with_all_pairs() {
    let size = 80;
    let sigma = pixels(super::super::feature::SIGMA_POSITION, size);
    let mut all = 0;
    for_each_in_half_disc(sigma, |_, _, _| {
        all += 1;
        true
    });
    assert!(all > MAX_OFFSETS && pattern(sigma, SAMPLES).len() <= SAMPLES, "{all}: not sampled");
    let scene = Scene::tiles(size, 98);
    check("albedo, mild", &scene.albedo(), &[1.0, 0.01, 0.0, 0.02, 0.03], 1.6e-3);
    check("albedo, strong", &scene.albedo(), &[0.2, 0.01, 0.0, 0.5, 0.5], 7e-3);
    check("normal, strong", &scene.normal(), &[0.2, 0.0, 1.0], 2e-3);
    check("roughness, strong", &scene.roughness(), &[0.1, 0.0, 0.0, 1.0], 5e-3);
}
