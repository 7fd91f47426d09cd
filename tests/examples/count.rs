//! Runs the network and nothing else, for a counter of instructions around it (the count of two runs less that of one):
//! `net_count SIZE LEVEL RUNS`.
use flashmat_core::exec::Inline;
use flashmat_core::kernels::{Kernels, Level};
use flashmat_core::net::{Model, Network};
use flashmat_tests::models::{Widths, random_model};
use flashmat_tests::runs::{NetRun, smooth_photo};

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [size, level, runs] = &arguments[..] else { panic!("net_count SIZE LEVEL RUNS") };
    let (size, runs): (usize, usize) = (size.parse().expect("a size"), runs.parse().expect("a number"));
    let level = Level::from_name(level).expect("a level's name");
    let file = random_model(&Widths::phone(), 1);
    let model = Model::from_bytes(&file).expect("a model");
    let macs = model.graph().macs(size);
    let network = Network::new(model, size, Kernels::for_level(level).expect("a level of this CPU"));
    let network = network.expect("a multiple of 128");
    let mut run = NetRun::new(&network, size, smooth_photo(size));
    for _ in 0..runs {
        run.run(&network, None, &Inline, None).expect("a run");
    }
    println!("{macs} products in each run");
}
