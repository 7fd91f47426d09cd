//! A whole capture on one thread and on several, in turn: `cargo run --release -p flashmat-tests --example threads [SIZE
//! [THREADS [LEVEL [SECONDS]]]]`. Prints each stage's best wall-clock times and their ratio; a busy machine needs many
//! seconds until both were undisturbed once.
use cpu_time::ThreadTime;
use flashmat_core::base::exec::{Executor, Inline, Pool};
use flashmat_core::base::simd::Level;
use flashmat_core::capture::{CaptureOptions, Pipeline};
use flashmat_core::frame::Frame;
use flashmat_core::kernels::Kernels;
use flashmat_core::net::Model;
use flashmat_core::{Observer, Stage};
use std::ops::ControlFlow;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Milliseconds of each stage, and of all.
type Times = [f64; ALL + 1];
/// Where the time of all stages together stands.
const ALL: usize = Stage::ALL.len();

/// Notes when stages begin and end.
struct Clock<'h> {
    start: Instant,
    times: Times,
    halves: &'h Halves,
}

impl Observer for Clock<'_> {
    fn progress(&mut self, stage: Stage, fraction: f32) -> ControlFlow<()> {
        let index = Stage::ALL.iter().position(|&s| s == stage).unwrap_or(0);
        if fraction == 0.0 {
            self.start = Instant::now();
            self.halves.begin();
        }
        if fraction == 1.0 {
            self.halves.end(index);
        }
        self.times[index] = self.start.elapsed().as_secs_f64() * 1e3;
        ControlFlow::Continue(())
    }
}

/// One thread that works out what two would take if handing over work cost nothing: of each outermost join the longer half.
#[derive(Default)]
struct Halves(Mutex<Tally>);

#[derive(Default)]
struct Tally {
    inside: bool,
    /// CPU time of the stage so far, and what two threads would save of it; nanoseconds.
    start: Duration,
    saved: u64,
    joins: u64,
    /// Of each stage, over all runs.
    stages: [(u64, u64, u64); ALL],
}

impl Halves {
    fn with<T>(&self, work: impl FnOnce(&mut Tally) -> T) -> T {
        work(&mut self.0.lock().expect("one thread"))
    }

    fn begin(&self) {
        let start = ThreadTime::now().as_duration();
        self.with(|tally| (tally.start, tally.saved, tally.joins) = (start, 0, 0));
    }

    fn end(&self, stage: usize) {
        let now = ThreadTime::now().as_duration();
        self.with(|tally| {
            if tally.joins > 0 {
                let (total, saved, joins) = &mut tally.stages[stage];
                *total += (now - tally.start).as_nanos() as u64;
                *saved += tally.saved;
                *joins = tally.joins;
            }
        });
    }
}

impl Executor for Halves {
    fn join(&self, a: &mut (dyn FnMut() + Send), b: &mut (dyn FnMut() + Send)) {
        if self.with(|tally| std::mem::replace(&mut tally.inside, true)) {
            a();
            return b();
        }
        let time = |half: &mut (dyn FnMut() + Send)| {
            let start = ThreadTime::now();
            half();
            start.elapsed().as_nanos() as u64
        };
        let shorter = time(a).min(time(b));
        self.with(|tally| {
            tally.inside = false;
            tally.saved += shorter;
            tally.joins += 1;
        });
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number =
        |index: usize, default| arguments.get(index).map_or(default, |text| text.parse().expect("a number"));
    let (size, threads) = (number(0, 256), number(1, 2));
    let level = arguments.get(2).map_or_else(Level::detect, |name| Level::from_name(name).expect("a level"));
    let seconds = number(3, 10);
    let file =
        std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../models/phone.fmat")).expect("the model");
    let kernels = Kernels::for_level(level).expect("a level of this CPU");
    let pipeline = Pipeline::new(Model::from_bytes(&file).expect("a model"), size, kernels).expect("a plan");
    let mut work = vec![0; pipeline.workspace_bytes()];
    let (width, height) = (4032_usize, 3024_usize);
    let data: Vec<u8> = (0..3 * width * height)
        .map(|i| {
            let (x, y) = (i / 3 % width, i / 3 / width);
            let tile = if (x / 300 + y / 300) % 2 == 0 { 150 } else { 90 };
            let fall = (x.abs_diff(width / 2).pow(2) + y.abs_diff(height / 2).pow(2)) / 90_000;
            (tile + i * 7919 % 24_usize).saturating_sub(fall) as u8
        })
        .collect();
    let frame = Frame::rgb8(&data, width, height, 3 * width).expect("a frame");
    let pool = Pool::new(threads).expect("threads");
    let halves = Halves::default();
    let executors: [&dyn Executor; 3] = [&Inline, &pool, &halves];
    let mut best = [[f64::INFINITY; ALL + 1]; 3];
    let begin = Instant::now();
    while begin.elapsed().as_secs() < seconds as u64 {
        for (exec, best) in executors.into_iter().zip(&mut best) {
            let mut clock = Clock { start: Instant::now(), times: [0.0; ALL + 1], halves: &halves };
            let start = Instant::now();
            pipeline.run(&frame, &CaptureOptions::default(), exec, &mut work, &mut clock).expect("a capture");
            clock.times[ALL] = start.elapsed().as_secs_f64() * 1e3;
            best.iter_mut().zip(clock.times).for_each(|(best, time)| *best = best.min(time));
        }
    }
    println!(
        "{size}, {}, best of each, ms; halves: two threads whose hand-overs cost nothing, by CPU time",
        level.name()
    );
    println!("{:>14} {:>8} {:>8} {:>6} {:>7} {:>6}", "", "one", threads, "ratio", "halves", "joins");
    let stages = halves.with(|tally| tally.stages);
    for (i, stage) in Stage::ALL.into_iter().enumerate() {
        let (one, many, (total, saved, joins)) = (best[0][i], best[1][i], stages[i]);
        println!(
            "{:>14} {one:8.2} {many:8.2} {:6.2} {:7.2} {joins:6}",
            stage.name(),
            one / many,
            total as f64 / (total - saved) as f64
        );
    }
    println!("{:>14} {:8.2} {:8.2} {:6.2}", "all", best[0][ALL], best[1][ALL], best[0][ALL] / best[1][ALL]);
}
