//! The loss of a refined map and its gradient by every class's coefficients.
//!
//! Loss: mean squared error over pixels and channels in the paper's convention (albedo and roughness on [-1,1]). The
//! gradient goes through the projection to unit normals, the adjoint solve (`crf::derivative`), the mixture by class
//! probabilities and the division by the sum.
use super::sample::{Sample, Sets, Stage};
use flashmat_core::Error;
use flashmat_core::base::arena::Arena;
use flashmat_core::crf::coefficients::{COUNT, through_normalisation};
use flashmat_core::crf::{self, Coefficients, Energy, Unprojected};
use flashmat_core::net::Class;

/// A value for each coefficient of each class, in the model file's order.
pub(super) type Values = [[f64; COUNT]; Class::ALL.len()];

/// Mean squared error in the paper's convention.
pub(super) fn loss(stage: Stage, found: &[f32], truth: &[f32]) -> f64 {
    let sum: f64 = found.iter().zip(truth).map(|(x, t)| f64::from(x - t).powi(2)).sum();
    weight(stage) * sum / found.len().max(1) as f64
}

fn weight(stage: Stage) -> f64 {
    if stage == Stage::Normal { 1.0 } else { 4.0 }
}

/// The loss of one sample, and its gradient added to `gradient`.
pub(super) fn accumulate(
    sample: &Sample,
    stage: Stage,
    sets: &Sets,
    options: &crf::Options,
    workspace: &mut [u8],
    gradient: &mut Values,
) -> Result<f64, Error> {
    let mixed = Coefficients::mixed(sets, &sample.probabilities);
    let total: f32 = sample.probabilities.iter().filter(|p| **p > 0.0).sum();
    let truth = &sample.truth;
    let mut add = |first: usize, of_class: &dyn Fn(&Coefficients) -> Vec<f32>| {
        for ((sums, set), &p) in gradient.iter_mut().zip(sets).zip(&sample.probabilities) {
            if p > 0.0 && total > 0.0 {
                for (sum, value) in sums.iter_mut().skip(first).zip(of_class(set)) {
                    *sum += f64::from(p / total * value);
                }
            }
        }
    };
    match stage {
        Stage::Albedo => {
            let energy = sample.albedo_energy();
            let (loss, g) = of_mixed(&energy, &mixed.albedo, stage, &truth.albedo, options, workspace)?;
            add(0, &|set| through_normalisation(&set.albedo, &g).to_vec());
            Ok(loss)
        }
        Stage::Normal => {
            let energy = sample.normal_energy();
            let (loss, g) = of_mixed(&energy, &mixed.normal, stage, &truth.normal, options, workspace)?;
            add(5, &|set| through_normalisation(&set.normal, &g).to_vec());
            Ok(loss)
        }
        Stage::Roughness => {
            let energy = sample.roughness_energy();
            let (loss, g) = of_mixed(&energy, &mixed.roughness, stage, &truth.roughness, options, workspace)?;
            add(8, &|set| through_normalisation(&set.roughness, &g).to_vec());
            Ok(loss)
        }
    }
}

/// The loss and its gradient by the mixed coefficients.
fn of_mixed<E: Energy<N>, const N: usize>(
    energy: &E,
    theta: &[f32; N],
    stage: Stage,
    truth: &[f32],
    options: &crf::Options,
    workspace: &mut [u8],
) -> Result<(f64, [f32; N]), Error> {
    let energy = Unprojected(energy);
    let mut solution = energy.unary(0).to_vec();
    crf::refine(&energy, theta, options, &mut solution, &super::fast(), &mut Arena::new(workspace))?;
    let mut found = solution.clone();
    energy.0.project(&mut found);
    // Tiny per-pixel values would be lost beside the solver's tolerance were they smaller still: the mean comes last.
    let mut by_solution: Vec<f32> =
        found.iter().zip(truth).map(|(x, t)| 2.0 * weight(stage) as f32 * (x - t)).collect();
    if stage == Stage::Normal {
        through_unit_length(&solution, &found, &mut by_solution);
    }
    let pair = [solution.as_slice(), by_solution.as_slice()];
    let gradient =
        crf::derivative(&energy, theta, options, pair, &super::fast(), &mut Arena::new(workspace))?;
    let values = found.len().max(1) as f32;
    Ok((loss(stage, &found, truth), gradient.map(|g| g / values)))
}

/// The gradient by vectors from that by their directions: its part across the direction, over the length.
fn through_unit_length(vectors: &[f32], directions: &[f32], gradient: &mut [f32]) {
    let n = vectors.len() / 3;
    let dot = |a: &[f32], b: &[f32], i: usize| -> f32 {
        (0..3).map(|c| a.get(c * n + i).unwrap_or(&0.0) * b.get(c * n + i).unwrap_or(&0.0)).sum()
    };
    for i in 0..n {
        let length = dot(vectors, vectors, i).sqrt().max(1e-6);
        let along = dot(gradient, directions, i);
        for c in 0..3 {
            if let (Some(g), Some(d)) = (gradient.get_mut(c * n + i), directions.get(c * n + i)) {
                *g = (*g - along * d) / length;
            }
        }
    }
}
