//! The network alone: `cargo bench -p flashmat-tests --bench network [-- FILTER]`. Items are multiply-accumulates, so
//! Gitem/s are GMAC/s; of the phone network's shape, random weights.
//!
//! "fastest" is the figure that other programs on the machine disturb least.
use divan::Bencher;
use divan::counter::ItemsCount;
use flashmat_core::base::exec::{Executor, Inline, Pool};
use flashmat_core::base::simd::Level;
use flashmat_core::kernels::Kernels;
use flashmat_core::net::{Model, Network};
use flashmat_tests::models::{Widths, random_model};
use flashmat_tests::runs::{NetRun, smooth_photo};

fn main() {
    divan::main();
}

fn run(bencher: Bencher<'_, '_>, level: Level, size: usize, exec: &dyn Executor) {
    let file = random_model(&Widths::phone(), 1);
    let model = Model::from_bytes(&file).expect("a model");
    let macs = model.graph().macs(size);
    let kernels = Kernels::for_level(level).expect("a supported level");
    let network = Network::new(model, size, kernels).expect("a multiple of 128");
    let mut run = NetRun::new(&network, size, smooth_photo(size));
    bencher
        .counter(ItemsCount::new(macs))
        .bench_local(|| run.run(&network, None, exec, None).expect("a run"));
}

/// Every level that this CPU has, at 256².
#[divan::bench(args = Kernels::supported().map(|kernels| kernels.level().name()), sample_count = 20)]
fn levels(bencher: Bencher<'_, '_>, level: &str) {
    run(bencher, Level::from_name(level).expect("a level's name"), 256, &Inline);
}

/// The fastest level at every size.
#[divan::bench(args = [128, 256, 512, 1024, 2048], sample_count = 10)]
fn sizes(bencher: Bencher<'_, '_>, size: usize) {
    run(bencher, Level::detect(), size, &Inline);
}

/// The fastest level on several threads, at 256² and 512².
#[divan::bench(args = [1, 2, 4], consts = [256, 512], sample_count = 20)]
fn threads<const SIZE: usize>(bencher: Bencher<'_, '_>, threads: usize) {
    run(bencher, Level::detect(), SIZE, &Pool::new(threads).expect("threads"));
}

/// From the model file's bytes to a model.
#[divan::bench]
fn load(bencher: Bencher<'_, '_>) {
    let file = random_model(&Widths::phone(), 1);
    bencher.bench_local(|| Model::from_bytes(&file).expect("a model").checksum());
}
