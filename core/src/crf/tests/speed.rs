//! Measurements for docs/crf.md; run with `cargo test -p flashmat-core --release crf::tests::speed -- --ignored
//! --nocapture --test-threads 1`.
use super::super::pairs::{Kernel, Pairs};
use super::super::pattern::{SAMPLES, pattern};
use super::super::separable::Spatial;
use super::super::solver::Operator;
use super::super::system::{Kernels, System, pixels};
use super::super::{Albedo, Coefficients, Energy, Options, feature, refine, workspace_bytes};
use super::{Scene, workspace};
use crate::base::arena::Arena;
use crate::base::exec::{At, Inline};
use crate::base::simd::{Level, Simd};
use std::time::Instant;
use std::vec;

/// Coefficients that let the neighbourhood decide.
const STRONG: Coefficients = Coefficients {
    albedo: [0.2, 0.01, 0.4, 0.4, 0.4],
    normal: [0.2, 0.5, 0.5],
    roughness: [0.1, 0.3, 0.5, 0.5],
};

/// On this CPU's widest registers.
fn exec() -> At<'static> {
    let level = [Level::Avx512Vnni, Level::Avx2].into_iter().find(|level| level.is_supported());
    At::new(&Inline, Simd::for_level(level.unwrap_or(Level::Scalar)).expect("supported"))
}

fn time<E: Energy<N>, const N: usize>(name: &str, energy: &E, coefficients: &[f32; N]) {
    let mut bytes = workspace::<E, N>(energy.size());
    let mut out = energy.unary(0).to_vec();
    let mut best = f64::INFINITY;
    let mut report = None;
    for _ in 0..5 {
        let start = Instant::now();
        report = Some(
            refine(energy, coefficients, &Options::default(), &mut out, &exec(), &mut Arena::new(&mut bytes))
                .expect("refined"),
        );
        best = best.min(start.elapsed().as_secs_f64());
    }
    let mib = workspace_bytes::<E, N>(energy.size()) as f64 / 1_048_576.0;
    std::println!("{name} {0}: {1:.1} ms, {mib:.1} MiB, {report:?}", energy.size(), best * 1e3);
}

#[test]
#[ignore = "a measurement"]
fn times() {
    for size in [128, 256, 512, 1024, 2048] {
        let scene = Scene::tiles(size, 81);
        for (name, set) in [("default", Coefficients::default()), ("strong", STRONG)] {
            time(&std::format!("albedo, {name}"), &scene.albedo(), &set.albedo);
            time(&std::format!("normal, {name}"), &scene.normal(), &set.normal);
            time(&std::format!("roughness, {name}"), &scene.roughness(), &set.roughness);
        }
    }
}

fn best(name: &str, mut body: impl FnMut()) {
    let mut best = f64::INFINITY;
    for _ in 0..20 {
        let start = Instant::now();
        body();
        best = best.min(start.elapsed().as_secs_f64());
    }
    std::println!("{name}: {:.2} ms", best * 1e3);
}

#[test]
#[ignore = "a measurement"]
fn parts() {
    let size = 256;
    let n2 = size * size;
    let scene = Scene::tiles(size, 82);
    let mut bytes = workspace::<Albedo<'_>, 5>(size);
    let mut features = vec![0.0; 6 * n2];
    best("features", || {
        scene.albedo().features(0, &Inline, &mut features[..3 * n2]);
        scene.albedo().features(1, &Inline, &mut features[3 * n2..]);
    });
    let mut map = vec![0.0; n2];
    best("weight map", || scene.albedo().unary_map(0, &Inline, &mut map));
    let kernels = [
        Kernel { features: &features[..3 * n2], weight: 0.1 },
        Kernel { features: &features[3 * n2..], weight: 0.2 },
    ];
    let sigma = pixels(feature::SIGMA_POSITION, size);
    best("pattern", || assert!(!pattern(sigma, SAMPLES).is_empty()));
    best("graph", || {
        Pairs::build(size, &pattern(sigma, SAMPLES), &kernels, &Inline, &mut Arena::new(&mut bytes))
            .expect("built");
    });
    best("spatial", || {
        let sigma = pixels(feature::SIGMA_SPATIAL, size);
        Spatial::new(size, sigma, 1.0, &Inline, &mut Arena::new(&mut bytes)).expect("built");
    });
    let mut arena = Arena::new(&mut bytes);
    let mut out = vec![0.0; 3 * n2];
    for spatial in [0.0, 0.1] {
        let kernels = Kernels { spatial: (0.04, spatial), sigma: 0.06, bilateral: kernels };
        let mut scope = arena.scope();
        let mut system = System::new(size, &map, &kernels, &Inline, &mut scope).expect("built");
        best("apply, 3 channels", || system.apply(&scene.albedo, &mut out, &Inline));
        best("apply, 1 channel", || system.apply(&map, &mut out[..n2], &Inline));
    }
}
