//! The stages behind the network, per CPU level: `cargo bench -p flashmat-tests --bench crf [-- FILTER]`.
//!
//! One thread; "fastest" is the figure that other programs on the machine disturb least. `naive` is the same energy
//! without any of the product's filters: all pairs of pixels, at a small size (`pairs` is the product's there).
use divan::Bencher;
use divan::counter::ItemsCount;
use flashmat_core::base::arena::Arena;
use flashmat_core::base::exec::{At, Inline};
use flashmat_core::base::simd::{Level, Simd};
use flashmat_core::brdf::{self, Light};
use flashmat_core::crf::exact::Dense;
use flashmat_core::crf::scenes::{FOV, Scene};
use flashmat_core::crf::solver::{Operator, VECTORS, solve};
use flashmat_core::crf::{self, Coefficients, Energy, Options};
use flashmat_core::maps::Maps;
use flashmat_core::search;

fn main() {
    divan::main();
}

/// Coefficients that let the neighbourhood decide.
const STRONG: Coefficients = Coefficients {
    albedo: [0.2, 0.01, 0.4, 0.4, 0.4],
    normal: [0.2, 0.5, 0.5],
    roughness: [0.1, 0.3, 0.5, 0.5],
};

const SIZE: usize = 256;
/// Pixels per side at which all pairs are bearable.
const SMALL: usize = 48;

/// The levels whose float loops differ.
fn levels() -> impl Iterator<Item = &'static str> {
    let wanted = [Level::Scalar, Level::Avx2, Level::Avx512Vnni];
    wanted.into_iter().filter(|level| level.is_supported()).map(Level::name)
}

fn at(level: &str) -> At<'static> {
    let level = Level::from_name(level).expect("a level's name");
    At::new(&Inline, Simd::for_level(level).expect("a supported level"))
}

fn refine<E: Energy<N>, const N: usize>(bencher: Bencher<'_, '_>, energy: &E, raw: &[f32; N], level: &str) {
    let mut workspace = vec![0; crf::workspace_bytes::<E, N>(energy.size())];
    let mut out = energy.unary(0).to_vec();
    let exec = at(level);
    bencher.counter(ItemsCount::new(energy.size() * energy.size())).bench_local(|| {
        crf::refine(energy, raw, &Options::default(), &mut out, &exec, &mut Arena::new(&mut workspace))
            .expect("refined")
    });
}

/// Each CRF with either set of coefficients.
macro_rules! refinements {
    ($($name:ident: $map:ident, $coefficients:expr;)*) => {$(
        #[divan::bench(args = levels())]
        fn $name(bencher: Bencher<'_, '_>, level: &str) {
            refine(bencher, &Scene::tiles(SIZE, 81).$map(), &$coefficients.$map, level);
        }
    )*};
}

refinements! {
    albedo: albedo, Coefficients::default();
    albedo_strong: albedo, STRONG;
    normal: normal, Coefficients::default();
    normal_strong: normal, STRONG;
    roughness: roughness, Coefficients::default();
    roughness_strong: roughness, STRONG;
}

fn maps(scene: &Scene) -> Maps<'_> {
    Maps { size: scene.size, albedo: &scene.albedo, normal: &scene.normal, roughness: &scene.roughness }
}

#[divan::bench(args = levels())]
fn render(bencher: Bencher<'_, '_>, level: &str) {
    let (scene, exec) = (Scene::tiles(SIZE, 81), at(level));
    let mut out = vec![0.0; 3 * SIZE * SIZE];
    bencher.counter(ItemsCount::new(SIZE * SIZE)).bench_local(|| {
        brdf::render(&maps(&scene), 0.05, &brdf::Scene::flash(FOV, 1.0), &exec, &mut out).expect("rendered");
    });
}

#[divan::bench(args = levels())]
fn light_scale(bencher: Bencher<'_, '_>, level: &str) {
    let (scene, exec) = (Scene::tiles(SIZE, 81), at(level));
    let mut out = vec![0.0; 3 * SIZE * SIZE];
    brdf::render(&maps(&scene), 0.05, &brdf::Scene::flash(FOV, 1.0), &exec, &mut out).expect("rendered");
    bencher
        .counter(ItemsCount::new(SIZE * SIZE))
        .bench_local(|| search::light_scale(&scene.image(), &out, &exec).expect("usable"));
}

#[divan::bench(args = levels())]
fn residual(bencher: Bencher<'_, '_>, level: &str) {
    let (scene, exec) = (Scene::tiles(SIZE, 81), at(level));
    let render: Vec<f32> = scene.albedo.iter().map(|a| 0.9 * a).collect();
    bencher
        .counter(ItemsCount::new(SIZE * SIZE))
        .bench_local(|| search::residual(&scene.image(), &render, &exec).expect("planes"));
}

#[divan::bench(args = levels())]
fn search_roughness(bencher: Bencher<'_, '_>, level: &str) {
    let (scene, exec) = (Scene::tiles(SIZE, 81), at(level));
    let (mut found, mut seen) = (vec![0.0; SIZE * SIZE], vec![0.0; SIZE * SIZE]);
    bencher.counter(ItemsCount::new(SIZE * SIZE)).bench_local(|| {
        let (photo, light) = (scene.image(), Light::default());
        search::roughness(&photo, &scene.albedo, &scene.normal, 0.05, &light, &exec, &mut found, &mut seen)
            .expect("searched");
    });
}

/// The energy's matrix over all pairs, built and solved with the same solver.
#[divan::bench]
fn small_naive(bencher: Bencher<'_, '_>) {
    let (scene, theta) = (Scene::tiles(SMALL, 81), Coefficients::default().albedo);
    bencher.counter(ItemsCount::new(SMALL * SMALL)).bench_local(|| {
        let mut dense = Dense::new(&scene.albedo(), &theta);
        let (rhs, mut x) = (dense.rhs.clone(), scene.albedo.clone());
        let mut vectors = vec![0.0; VECTORS * x.len()];
        assert_eq!(dense.size(), SMALL);
        solve(&mut dense, &rhs, &mut x, &Options::default(), &Inline, &mut vectors).expect("solved")
    });
}

/// What `small_naive` is compared with.
#[divan::bench(args = levels())]
fn small_pairs(bencher: Bencher<'_, '_>, level: &str) {
    refine(bencher, &Scene::tiles(SMALL, 81).albedo(), &Coefficients::default().albedo, level);
}
