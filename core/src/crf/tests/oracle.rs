//! Against the dense solution over all pairs of pixels.
use super::super::exact::Dense;
use super::super::solver::{VECTORS, solve};
use super::super::{Energy, Options, refine};
use super::{Scene, relative_error, workspace};
use crate::base::arena::Arena;
use crate::base::exec::Inline;
use std::vec;
use std::vec::Vec;

/// The refined map with the product's filters and default options, and the oracle's.
fn both<E: Energy<N>, const N: usize>(energy: &E, coefficients: &[f32; N]) -> (Vec<f32>, Vec<f32>) {
    let mut bytes = workspace::<E, N>(energy.size());
    let mut ours = energy.unary(0).to_vec();
    refine(energy, coefficients, &Options::default(), &mut ours, &Inline, &mut Arena::new(&mut bytes))
        .expect("refined");
    let mut exact: Vec<f32> = Dense::new(energy, coefficients).solve().iter().map(|&v| v as f32).collect();
    energy.project(&mut exact);
    (ours, exact)
}

fn check<E: Energy<N>, const N: usize>(name: &str, energy: &E, sets: &[[f32; N]]) {
    for coefficients in sets {
        let (ours, exact) = both(energy, coefficients);
        let error = relative_error(&ours, &exact);
        let moved = relative_error(energy.unary(0), &exact);
        std::println!("{name} {coefficients:?}: error {error:.2e}, refinement {moved:.2e}");
        assert!(error <= 2e-2, "{name} {coefficients:?}: {error}");
    }
}

/// With the first `sets` of some sets of coefficients: the default one, strong ones, one with nothing but a kernel.
fn check_scene(name: &str, scene: &Scene, sets: usize) {
    let albedo = [[1.0, 0.01, 0.005, 0.02, 0.03], [0.5, 0.1, 0.1, 0.5, 0.0], [0.2, 0.01, 0.4, 0.4, 0.4]];
    check(&std::format!("{name} albedo"), &scene.albedo(), &albedo[..sets]);
    let normal = [[1.0, 0.01, 0.03], [0.2, 0.5, 0.5], [0.1, 0.0, 1.0]];
    check(&std::format!("{name} normal"), &scene.normal(), &normal[..sets]);
    let roughness = [[1.0, 0.25, 0.05, 0.2], [0.1, 0.3, 0.5, 0.5], [0.1, 0.0, 0.0, 1.0]];
    check(&std::format!("{name} roughness"), &scene.roughness(), &roughness[..sets]);
}

#[test]
fn random_inputs_at_32_agree_with_the_dense_solution() {
    check_scene("random 32, seed 11", &Scene::random(32, 11), 3);
}

#[test]
fn real_like_inputs_at_32_agree_with_the_dense_solution() {
    check_scene("tiles 32, seed 12", &Scene::tiles(32, 12), 3);
}

#[test]
fn random_inputs_at_48_agree_with_the_dense_solution() {
    check_scene("random 48, seed 13", &Scene::random(48, 13), 2);
}

#[test]
fn real_like_inputs_at_48_agree_with_the_dense_solution() {
    check_scene("tiles 48, seed 14", &Scene::tiles(48, 14), 2);
}

#[test]
fn exact_kernels_in_the_same_solver_agree_to_1e_5() {
    for scene in [Scene::random(32, 21), Scene::tiles(48, 23)] {
        let mut dense = Dense::new(&scene.albedo(), &[0.3, 0.02, 0.2, 0.4, 0.3]);
        let exact: Vec<f32> = dense.solve().iter().map(|&v| v as f32).collect();
        let mut x = scene.albedo.clone();
        let mut vectors = vec![0.0; VECTORS * x.len()];
        let options = Options { tolerance: 1e-6, max_iterations: 200 };
        let rhs = dense.rhs.clone();
        let report = solve(&mut dense, &rhs, &mut x, &options, &Inline, &mut vectors).expect("solved");
        let error = relative_error(&x, &exact);
        std::println!("{} {report:?}: {error:.2e}", scene.size);
        assert!(error <= 1e-5, "{error}");
    }
}
