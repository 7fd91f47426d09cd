//! What the CRFs promise whatever the input.
use super::super::pairs::{Kernel, Pairs};
use super::super::pattern::{SAMPLES, pattern};
use super::super::solver::Operator;
use super::super::system::{Kernels, System};
use super::super::{Albedo, Coefficients, Energy, Options, Report, max_workspace_bytes, refine};
use super::{Random, Scene, workspace};
use crate::Error;
use crate::base::arena::Arena;
use crate::base::exec::{At, Inline};
use crate::base::simd::{Level, Simd};
use proptest::prelude::*;
use std::vec;
use std::vec::Vec;

fn run<E: Energy<N>, const N: usize>(energy: &E, coefficients: &[f32; N]) -> (Vec<f32>, Report) {
    let mut bytes = workspace::<E, N>(energy.size());
    let mut out = vec![f32::NAN; energy.unary(0).len()];
    let mut arena = Arena::new(&mut bytes);
    let report =
        refine(energy, coefficients, &Options::default(), &mut out, &Inline, &mut arena).expect("refined");
    (out, report)
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|v| v.to_bits()).collect()
}

#[test]
fn no_pairwise_weight_gives_the_input_back_bit_for_bit() {
    for scene in [Scene::random(24, 31), Scene::tiles(33, 32)] {
        assert_eq!(bits(&run(&scene.albedo(), &[0.7, 0.3, 0.0, 0.0, 0.0]).0), bits(&scene.albedo));
        assert_eq!(bits(&run(&scene.normal(), &[0.7, 0.0, 0.0]).0), bits(&scene.normal));
        assert_eq!(bits(&run(&scene.roughness(), &[0.7, 0.0, 0.0, 0.0]).0), bits(&scene.roughness));
    }
}

#[test]
fn two_roughness_unaries_alone_give_their_weighted_mean() {
    let mut scene = Scene::random(8, 33);
    scene.photo.fill(1.0);
    scene.observability.fill(0.5);
    let (mean, _) = run(&scene.roughness(), &[1.0, 2.0, 0.0, 0.0]);
    for ((mean, network), search) in mean.iter().zip(&scene.roughness).zip(&scene.search) {
        assert!((mean - 0.5 * (network + search)).abs() < 1e-3);
    }
}

#[test]
fn constant_input_stays_constant_bit_for_bit() {
    for size in [1, 2, 17, 48, 100] {
        let scene = Scene::constant(size, 34);
        let (albedo, report) = run(&scene.albedo(), &[0.2, 0.1, 1.0, 1.0, 1.0]);
        assert_eq!((bits(&albedo), report.iterations), (bits(&scene.albedo), 0), "{size}");
        let (normal, report) = run(&scene.normal(), &[0.2, 1.0, 1.0]);
        assert_eq!((bits(&normal), report.iterations), (bits(&scene.normal), 0), "{size}");
        let (roughness, report) = run(&scene.roughness(), &[0.2, 0.3, 1.0, 1.0]);
        assert_eq!((bits(&roughness), report.iterations), (bits(&scene.roughness), 0), "{size}");
    }
}

#[test]
fn refinement_takes_noise_out_and_leaves_detail_in() {
    let size = 64;
    let clean = {
        let mut scene = Scene::tiles(size, 35);
        // Nothing burnt out.
        scene.photo.iter_mut().for_each(|v| *v *= 0.7);
        scene.albedo.clone_from(&scene.photo);
        scene
    };
    let mut noisy =
        Scene { albedo: clean.albedo.clone(), photo: clean.photo.clone(), ..Scene::tiles(size, 35) };
    let mut random = Random(36);
    for value in &mut noisy.albedo {
        *value = (*value + 0.2 * (random.unit() - 0.5)).clamp(0.0, 1.0);
    }
    let defaults = Coefficients::default().albedo;
    let error = |map: &[f32]| super::relative_error(map, &clean.albedo);
    let (refined, report) = run(&noisy.albedo(), &defaults);
    assert!(error(&refined) < 0.97 * error(&noisy.albedo), "{} {}", error(&refined), error(&noisy.albedo));
    assert!(report.iterations > 0 && report.residual <= 1e-3);
    let (untouched, _) = run(&clean.albedo(), &defaults);
    assert!(error(&untouched) < 0.02, "{}", error(&untouched));
}

#[test]
fn the_solution_stays_within_the_unarys_range() {
    let mut scene = Scene::random(32, 37);
    scene.albedo.iter_mut().for_each(|v| *v = 0.3 + 0.4 * *v);
    let (albedo, _) = run(&scene.albedo(), &[0.1, 0.05, 1.0, 1.0, 1.0]);
    assert!(albedo.iter().all(|v| (0.298..=0.702).contains(v)));
}

/// The matrix of a random problem: its dense form, column by column, and its diagonal.
fn columns(size: usize, samples: usize, seed: u64) -> (Vec<Vec<f32>>, Vec<f32>) {
    let n = size * size;
    let mut random = Random(seed);
    let (unary, first, second) = (random.plane(n), random.plane(3 * n), random.plane(2 * n));
    let kernels = [Kernel { features: &first, weight: 0.4 }, Kernel { features: &second, weight: 0.9 }];
    let mut bytes = vec![0x7f_u8; 1 << 24];
    let mut arena = Arena::new(&mut bytes);
    if samples < SAMPLES {
        let graph = Pairs::build(size, &pattern(4.0, samples), &kernels, &Inline, &mut arena).expect("built");
        let plane = |i: usize| (0..n).map(|j| f32::from(u8::from(i == j))).collect::<Vec<f32>>();
        let columns = (0..n).map(|i| {
            let x = plane(i);
            let mut out = vec![0.0; n];
            for (y, row) in out.chunks_exact_mut(size).enumerate() {
                graph.add_laplacian_row(y, [&x], [row]);
            }
            out
        });
        return (columns.collect(), vec![]);
    }
    let kernels = Kernels { spatial: (0.3, 0.2), sigma: 0.06, bilateral: kernels };
    let mut system = System::new(size, &unary, &kernels, &Inline, &mut arena).expect("built");
    let mut columns = Vec::new();
    for i in 0..n {
        let mut x = vec![0.0; n];
        x[i] = 1.0;
        let mut out = vec![f32::NAN; n];
        system.apply(&x, &mut out, &Inline);
        columns.push(out);
    }
    let diagonal = system.diagonal().to_vec();
    (columns, diagonal)
}

#[test]
fn the_matrix_is_symmetric_and_diagonally_dominant() {
    for seed in [41, 42, 43] {
        let (a, diagonal) = columns(20, SAMPLES, seed);
        for (i, column) in a.iter().enumerate() {
            let mut sum = 0.0_f64;
            for (j, &value) in column.iter().enumerate() {
                assert!((value - a[j][i]).abs() <= 1e-6, "seed {seed}: ({i}, {j}) {value} {}", a[j][i]);
                assert!(i == j || value <= 1e-6, "seed {seed}: positive off the diagonal, {value}");
                sum += f64::from(value);
            }
            // Row sums are the unary weights: positive, so A is a positive definite M-matrix.
            assert!(sum >= -1e-5, "seed {seed}: {sum}");
            assert!(diagonal[i] >= column[i] - 1e-5, "seed {seed}: {} {}", diagonal[i], column[i]);
        }
    }
}

#[test]
fn a_sampled_graph_is_symmetric_with_zero_row_sums() {
    let (a, _) = columns(24, 20, 44);
    for (i, column) in a.iter().enumerate() {
        let sum: f64 = column.iter().map(|&v| f64::from(v)).sum();
        assert!(sum.abs() < 1e-6);
        assert!(column.iter().enumerate().all(|(j, &v)| v == a[j][i] && (i == j || v <= 0.0)));
    }
}

/// Sizes below, at and between the runs that the loops are cut into.
#[test]
fn the_cpu_level_does_not_change_a_bit() {
    for size in [40, 100, 128, 256] {
        let scene = Scene::tiles(size, 50);
        let (reference, report) = run(&scene.albedo(), &[0.3, 0.02, 0.2, 0.4, 0.3]);
        let (rough, rough_report) = run(&scene.roughness(), &[0.5, 0.3, 0.2, 0.4]);
        for simd in Level::ALL.into_iter().filter_map(|level| Simd::for_level(level).ok()) {
            let exec = At::new(&Inline, simd);
            let mut bytes = workspace::<Albedo<'_>, 5>(size);
            let mut out = scene.albedo.clone();
            let mut arena = Arena::new(&mut bytes);
            let coefficients = [0.3, 0.02, 0.2, 0.4, 0.3];
            let again =
                refine(&scene.albedo(), &coefficients, &Options::default(), &mut out, &exec, &mut arena);
            assert_eq!(again, Ok(report), "{simd:?} {size}");
            assert_eq!(bits(&out), bits(&reference), "{simd:?} {size}");
            let mut out = scene.roughness.clone();
            let coefficients = [0.5, 0.3, 0.2, 0.4];
            let again =
                refine(&scene.roughness(), &coefficients, &Options::default(), &mut out, &exec, &mut arena);
            assert_eq!(again, Ok(rough_report), "{simd:?} {size}");
            assert_eq!(bits(&out), bits(&rough), "{simd:?} {size}");
        }
    }
}

#[cfg(feature = "parallel")]
#[test]
fn threads_do_not_change_a_bit() {
    let scene = Scene::tiles(100, 51);
    let (reference, report) = run(&scene.albedo(), &[0.3, 0.02, 0.2, 0.4, 0.3]);
    for threads in [1, 2, 5] {
        let pool = crate::base::exec::Pool::new(threads).expect("threads");
        let mut bytes = workspace::<Albedo<'_>, 5>(100);
        let mut out = scene.albedo.clone();
        let again = refine(
            &scene.albedo(),
            &[0.3, 0.02, 0.2, 0.4, 0.3],
            &Options::default(),
            &mut out,
            &pool,
            &mut Arena::new(&mut bytes),
        );
        assert_eq!(again, Ok(report));
        assert_eq!(bits(&out), bits(&reference));
    }
}

#[test]
fn bad_input_is_an_error() {
    let scene = Scene::random(8, 61);
    let coefficients = Coefficients::default().albedo;
    let mut bytes = workspace::<Albedo<'_>, 5>(8);
    let mut call = |energy: &Albedo<'_>, out: &mut [f32], short: usize| {
        let len = bytes.len() - short;
        let mut arena = Arena::new(&mut bytes[..len]);
        refine(energy, &coefficients, &Options::default(), out, &Inline, &mut arena)
    };
    let mut out = scene.albedo.clone();
    assert!(call(&scene.albedo(), &mut out, 0).is_ok());
    let half = workspace::<Albedo<'_>, 5>(8).len() / 2;
    assert!(matches!(call(&scene.albedo(), &mut out, half), Err(Error::WorkspaceTooSmall { .. })));
    assert!(matches!(call(&scene.albedo(), &mut out[1..], 0), Err(Error::PlaneLength { .. })));
    let short = Albedo { photo: &scene.photo[1..], ..scene.albedo() };
    assert!(matches!(call(&short, &mut out, 0), Err(Error::PlaneLength { .. })));
    assert!(matches!(call(&Albedo { size: 0, ..scene.albedo() }, &mut [], 0), Err(Error::Size { .. })));
    let mut albedo = scene.albedo.clone();
    for bad in [f32::NAN, f32::INFINITY, f32::MAX] {
        albedo[77] = bad;
        assert_eq!(call(&Albedo { albedo: &albedo, ..scene.albedo() }, &mut out, 0), Err(Error::CrfInput));
    }
    let mut photo = scene.photo.clone();
    (photo[5], photo[80], photo[190]) = (f32::NAN, f32::INFINITY, -3.0);
    let odd = call(&Albedo { photo: &photo, ..scene.albedo() }, &mut out, 0);
    assert!(odd.is_ok() || odd == Err(Error::CrfInput));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]

    /// No panic, finite maps in range, for any size and coefficients.
    #[test]
    fn any_input_gives_maps(size in 1_usize..40, seed in any::<u64>(), raw in prop::array::uniform12(-0.2_f32..1.0)) {
        let (scene, options) = (Scene::random(size, seed), Options::default());
        let coefficients = Coefficients::from_array(&raw);
        let (albedo, report) = run(&scene.albedo(), &coefficients.albedo);
        let done = report.residual <= options.tolerance || report.iterations == options.max_iterations;
        prop_assert!(done && albedo.iter().all(|v| (0.0..=1.0).contains(v)), "seed {seed}");
        let (normal, _) = run(&scene.normal(), &coefficients.normal);
        for i in 0..size * size {
            let [x, y, z] = [0, 1, 2].map(|c| normal[c * size * size + i]);
            prop_assert!((x * x + y * y + z * z - 1.0).abs() < 1e-5, "seed {seed}");
        }
        let (roughness, _) = run(&scene.roughness(), &coefficients.roughness);
        prop_assert!(roughness.iter().all(|v| (0.0..=1.0).contains(v)), "seed {seed}");
        prop_assert!(max_workspace_bytes(size) < 4096 * size * size + 65536);
    }
}
