//! The derivative by the coefficients against finite differences, on the product's own solver.
use super::super::{Energy, Options, Unprojected, derivative, refine};
use super::{Random, Scene, workspace};
use crate::base::arena::Arena;
use crate::base::exec::Inline;
use std::vec::Vec;

const TIGHT: Options = Options { tolerance: 1e-7, max_iterations: 200 };

fn check<E: Energy<N>, const N: usize>(name: &str, energy: &E, coefficients: &[f32; N]) {
    let mut bytes = workspace::<E, N>(energy.size());
    let mut solution = energy.unary(0).to_vec();
    let target = Random(72).plane(solution.len());
    // The loss is half the squared distance from a random target.
    let mut loss = |coefficients: &[f32; N], out: &mut [f32]| -> f64 {
        refine(energy, coefficients, &TIGHT, out, &Inline, &mut Arena::new(&mut bytes)).expect("refined");
        out.iter().zip(&target).map(|(x, t)| 0.5 * f64::from(x - t) * f64::from(x - t)).sum()
    };
    let mut scratch = solution.clone();
    let numeric: Vec<f64> = (0..N)
        .map(|k| {
            // Wide steps, so that the weights' 8 bits average out; the four points cancel the third order.
            let step = 0.12 * coefficients[k];
            let mut at = |steps: f32| {
                let mut moved = *coefficients;
                moved[k] += steps * step;
                loss(&moved, &mut scratch)
            };
            (8.0 * (at(1.0) - at(-1.0)) - (at(2.0) - at(-2.0))) / (12.0 * f64::from(step))
        })
        .collect();
    loss(coefficients, &mut solution);
    let gradient: Vec<f32> = solution.iter().zip(&target).map(|(x, t)| x - t).collect();
    let exact = derivative(
        energy,
        coefficients,
        &TIGHT,
        [&solution, &gradient],
        &Inline,
        &mut Arena::new(&mut bytes),
    )
    .expect("derivative");
    let scale = numeric.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
    for (k, (ours, numeric)) in exact.iter().zip(&numeric).enumerate() {
        std::println!("{name} {k}: {ours} {numeric}");
        assert!(
            (f64::from(*ours) - numeric).abs() <= 1e-2 * numeric.abs() + 1e-3 * scale,
            "{name} {k}: {ours} {numeric}"
        );
    }
}

#[test]
fn the_derivative_is_that_of_finite_differences() {
    for scene in [Scene::random(20, 71), Scene::tiles(40, 73)] {
        check("albedo", &scene.albedo(), &[1.0, 0.1, 0.3, 0.4, 0.5]);
        check("roughness", &scene.roughness(), &[0.5, 0.4, 0.2, 0.7]);
    }
}

/// The normals' energy without the projection, which is no part of the minimum.
#[test]
fn the_derivative_of_the_normals_is_too() {
    let scene = Scene::tiles(40, 74);
    check("normal", &Unprojected(&scene.normal()), &[0.6, 0.3, 0.5]);
}
