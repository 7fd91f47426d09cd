//! Times the network on every level: `cargo run --release -p flashmat-tests --example net_speed [SIZE [LEVEL]]`.
use flashmat_core::exec::Inline;
use flashmat_core::kernels::ALL;
use flashmat_core::net::graph::Tensor;
use flashmat_core::net::{Model, Network, Tap};
use flashmat_tests::models::{Widths, random_model};
use flashmat_tests::runs::{NetRun, smooth_photo};
use std::time::Instant;

/// Times each layer by when its output is there.
struct Clock {
    last: Instant,
    layers: Vec<(String, f64)>,
}

impl Tap for Clock {
    fn image(&mut self, _: usize, tensor: &Tensor, _: &[i8]) {
        self.layers.push((tensor.name.as_str().to_owned(), self.last.elapsed().as_secs_f64() * 1e3));
        self.last = Instant::now();
    }

    fn vector(&mut self, _: usize, tensor: &Tensor, _: &[f32]) {
        self.image(0, tensor, &[]);
    }
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let size: usize = arguments.next().and_then(|s| s.parse().ok()).unwrap_or(256);
    let only = arguments.next();
    let file = random_model(&Widths::phone(), 1);
    let start = Instant::now();
    let model = Model::from_bytes(&file).expect("a model");
    let load = start.elapsed().as_secs_f64() * 1e3;
    let gmacs = model.graph().macs(size) as f64 / 1e9;
    println!("{:.2} MB, loaded in {load:.2} ms; {gmacs:.3} GMAC at {size}", file.len() as f64 / 1e6);
    for kernels in ALL.iter().filter(|k| k.level().is_supported()) {
        if only.as_ref().is_some_and(|name| name != kernels.level().name()) {
            continue;
        }
        let network = Network::new(model.clone(), size, kernels).expect("a multiple of 128");
        let mut run = NetRun::new(&network, size, smooth_photo(size));
        let mut times = Vec::new();
        let begin = Instant::now();
        while times.len() < 3 || (begin.elapsed().as_secs_f64() < 3.0 && times.len() < 200) {
            let start = Instant::now();
            run.run(&network, None, &Inline, None).expect("a run");
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        times.sort_by(f64::total_cmp);
        let (best, median) = (times[0], times[times.len() / 2]);
        let rate = gmacs / best * 1e3;
        println!("{:22} best {best:8.2} ms, median {median:8.2} ms, {rate:6.1} GMAC/s", kernels.name());
        let mut clock = Clock { last: Instant::now(), layers: Vec::new() };
        run.run(&network, None, &Inline, Some(&mut clock)).expect("a run");
        let mut line = String::new();
        for (name, ms) in clock.layers {
            line += &format!(" {name} {ms:.2}");
        }
        println!("   ms to each tensor (heads count to the next):{line}");
    }
}
