//! The coarse correction: that it solves what it says, and that it saves the steps it is there for.
use super::super::coarse::{Cells, Coarse};
use super::super::feature;
use super::super::pairs::Kernel;
use super::super::solver::{Operator, Report, VECTORS, solve};
use super::super::system::{Kernels, System};
use super::super::{Energy, Options};
use super::{Random, Scene};
use crate::base::arena::Arena;
use crate::base::exec::Inline;
use std::vec;
use std::vec::Vec;

const SIGMA: f32 = feature::SIGMA_POSITION;

/// What r = A P v needs for a correction: v itself, as far as the coarse matrix is P^T A P. The greatest error of any
/// cell, and the relative one of r^T P v.
fn errors(size: usize, seed: u64, [spatial, first, second]: [f32; 3]) -> (f32, f64) {
    let n2 = size * size;
    let mut random = Random(seed);
    let unary: Vec<f32> = random.plane(n2).iter().map(|a| 0.02 + 0.1 * a).collect();
    // Unlike, but not so much that no neighbour counts.
    let [colours, gradients] =
        [3, 2].map(|planes| random.plane(planes * n2).iter().map(|f| 0.4 * f).collect::<Vec<f32>>());
    let bilateral =
        [Kernel { features: &colours, weight: first }, Kernel { features: &gradients, weight: second }];
    let kernels = Kernels { spatial: (0.04, spatial), sigma: SIGMA, bilateral };
    let mut bytes = vec![0x7f_u8; System::bytes(size, 0.04, SIGMA) + 64];
    let mut arena = Arena::new(&mut bytes);
    let mut system = System::new(size, &unary, &kernels, &Inline, &mut arena).expect("built");
    system.add_coarse(&Inline, &mut arena).expect("built");

    let cells = Cells::new(size);
    let values = random.plane(cells.count * cells.count);
    let smooth: Vec<f32> =
        (0..n2).map(|i| values[i / size / cells.width * cells.count + i % size / cells.width]).collect();
    let mut r = vec![0.0; n2];
    system.apply(&smooth, &mut r, &Inline);
    let product = system.correct(1, &r, &Inline);
    let direct: f64 = r.iter().zip(&smooth).map(|(r, v)| f64::from(r * v)).sum();
    let (_, found) = system.correction(1).expect("much pairwise weight");
    assert_eq!(found.len(), values.len());
    let error = found.iter().zip(&values).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    (error, (product / direct - 1.0).abs())
}

/// Sizes with whole cells and with narrower last ones.
#[test]
fn a_residual_of_cells_is_put_right_at_once() {
    for (size, seed) in [(13, 91), (20, 92), (50, 93), (100, 94), (130, 95)] {
        let (cell, product) = errors(size, seed, [0.0, 0.6, 0.9]);
        std::println!("{size}: {cell:.1e} {product:.1e}");
        assert!(cell < 2e-4 && product < 1e-5, "{size}, seed {seed}: {cell} {product}");
        // kappa_1's part takes the normalisation as constant over a cell and the blur as the Gaussian itself.
        let (cell, product) = errors(size, seed, [0.5, 0.6, 0.9]);
        std::println!("{size}, with kappa_1: {cell:.1e} {product:.1e}");
        assert!(cell < 0.15 && product < 0.05, "{size}, seed {seed}: {cell} {product}");
    }
}

/// Steps to the default tolerance with and without the correction.
fn steps<E: Energy<N>, const N: usize>(energy: &E, theta: [f32; 3], coarse: bool) -> Report {
    let (size, n2) = (energy.size(), energy.size() * energy.size());
    let unary = vec![0.08; n2];
    let mut features = vec![0.0; E::FEATURES[0] * n2];
    energy.features(0, &Inline, &mut features);
    let unused = Kernel { features: &[], weight: 0.0 };
    let bilateral = [Kernel { features: &features, weight: theta[1] }, unused];
    let kernels = Kernels { spatial: (E::SIGMA_SPATIAL, theta[0]), sigma: SIGMA, bilateral };
    let mut bytes = vec![0; System::bytes(size, E::SIGMA_SPATIAL, SIGMA) + 64];
    let mut arena = Arena::new(&mut bytes);
    let mut system = System::new(size, &unary, &kernels, &Inline, &mut arena).expect("built");
    if coarse {
        system.add_coarse(&Inline, &mut arena).expect("built");
        assert!(system.correction(0).is_some());
    }
    let mut x = energy.unary(0).to_vec();
    let rhs: Vec<f32> = x.iter().map(|x| 0.08 * x).collect();
    let mut vectors = vec![f32::NAN; VECTORS * x.len()];
    solve(&mut system, &rhs, &mut x, &Options::default(), &Inline, &mut vectors).expect("solved")
}

#[test]
fn strong_neighbourhoods_take_two_thirds_of_the_steps_at_most() {
    for (size, seed) in [(128, 96), (200, 97)] {
        let scene = Scene::tiles(size, seed);
        let [without, with] = [false, true].map(|c| steps(&scene.albedo(), [0.4, 0.5, 0.0], c).iterations);
        assert!(3 * with <= 2 * without && with > 2, "{size} albedo: {with} of {without}");
        let [without, with] = [false, true].map(|c| steps(&scene.roughness(), [0.4, 0.5, 0.0], c).iterations);
        assert!(3 * with <= 2 * without && with > 2, "{size} roughness: {with} of {without}");
    }
}

#[test]
fn mild_neighbourhoods_have_no_correction() {
    let mut bytes = vec![0; System::bytes(16, 0.04, SIGMA) + 64];
    let mut arena = Arena::new(&mut bytes);
    let (unary, features) = (vec![0.5; 256], vec![0.0; 256]);
    let kernel = Kernel { features: &features, weight: 0.1 };
    let kernels =
        Kernels { spatial: (0.04, 0.1), sigma: SIGMA, bilateral: [kernel, Kernel { weight: 0.0, ..kernel }] };
    let mut system = System::new(16, &unary, &kernels, &Inline, &mut arena).expect("built");
    system.add_coarse(&Inline, &mut arena).expect("nothing to build");
    assert!(system.correction(0).is_none() && system.correct(0, &unary, &Inline) == 0.0);
}

/// The matrix does not grow with the image.
#[test]
fn memory_is_bounded() {
    let at = |size: usize| Coarse::bytes(size, 0.5 * SIGMA * size as f32);
    assert!(at(4096) <= at(640) && at(640) < 120_000, "{} {}", at(4096), at(640));
}
