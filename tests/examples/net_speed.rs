//! CPU time of the network on every level, and its share of the level's peak: `cargo run --release -p flashmat-tests --example net_speed [SIZE [LEVEL]]`.
use cpu_time::ThreadTime;
use flashmat_core::base::exec::Inline;
use flashmat_core::base::simd::Level;
use flashmat_core::kernels::Kernels;
use flashmat_core::kernels::peak::multiply_accumulates;
use flashmat_core::net::graph::Tensor;
use flashmat_core::net::{Model, Network, Tap};
use flashmat_tests::models::{Widths, random_model};
use flashmat_tests::runs::{NetRun, smooth_photo};
use std::time::Instant;

/// Milliseconds of this thread's time on the CPU: on a shared machine the wall clock says little.
fn ms(since: ThreadTime) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}

/// The level's dot products on registers, 10^9 multiply-accumulates a second: the best of a few tries.
fn peak(level: Level) -> Option<f64> {
    let rates = (0..20).map(|_| {
        let start = ThreadTime::now();
        Some(multiply_accumulates(level, 1 << 17)? as f64 / ms(start) * 1e-6)
    });
    rates.collect::<Option<Vec<f64>>>()?.into_iter().max_by(f64::total_cmp)
}

/// Each layer's shortest wall-clock time over all runs, taken when its output is there.
struct Clock {
    last: Instant,
    next: usize,
    layers: Vec<(String, f64)>,
}

impl Clock {
    fn tick(&mut self, name: &str) {
        let ms = self.last.elapsed().as_secs_f64() * 1e3;
        match self.layers.get_mut(self.next) {
            Some((_, best)) => *best = best.min(ms),
            None => self.layers.push((name.to_owned(), ms)),
        }
        self.next += 1;
        self.last = Instant::now();
    }
}

impl Tap for Clock {
    fn image(&mut self, _: usize, tensor: &Tensor<'_>, _: &[i8]) {
        self.tick(tensor.name.as_str());
    }

    fn vector(&mut self, _: usize, tensor: &Tensor<'_>, _: &[f32]) {
        self.tick(tensor.name.as_str());
    }
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let size: usize = arguments.next().and_then(|s| s.parse().ok()).unwrap_or(256);
    let only = arguments.next();
    let file = random_model(&Widths::phone(), 1);
    let start = ThreadTime::now();
    let model = Model::from_bytes(&file).expect("a model");
    let load = ms(start);
    let gmacs = model.graph().macs(size) as f64 / 1e9;
    println!("{:.2} MB, loaded in {load:.2} ms; {gmacs:.3} GMAC at {size}", file.len() as f64 / 1e6);
    for kernels in Kernels::supported() {
        if only.as_ref().is_some_and(|name| name != kernels.level().name()) {
            continue;
        }
        let network = Network::new(model.clone(), size, kernels).expect("a multiple of 128");
        let mut run = NetRun::new(&network, size, smooth_photo(size));
        let mut times = Vec::new();
        let mut clock = Clock { last: Instant::now(), next: 0, layers: Vec::new() };
        let begin = Instant::now();
        while times.len() < 3 || (begin.elapsed().as_secs_f64() < 3.0 && times.len() < 200) {
            let start = ThreadTime::now();
            (clock.last, clock.next) = (Instant::now(), 0);
            run.run(&network, None, &Inline, Some(&mut clock)).expect("a run");
            clock.tick("last head");
            times.push(ms(start));
        }
        times.sort_by(f64::total_cmp);
        let (best, median) = (times[0], times[times.len() / 2]);
        let rate = gmacs / best * 1e3;
        println!("{:22} best {best:8.2} ms, median {median:8.2} ms, {rate:6.1} GMAC/s", kernels.name());
        if let Some(peak) = peak(kernels.level()) {
            println!("   {:.0} % of the peak, {peak:.1} GMAC/s", 100.0 * rate / peak);
        }
        let mut line = String::new();
        let mut sum = 0.0;
        for (name, ms) in clock.layers {
            line += &format!(" {name} {ms:.2}");
            sum += ms;
        }
        println!("   sum of the shortest times {sum:.2} ms; each (a head counts to the next tensor):{line}");
    }
}
