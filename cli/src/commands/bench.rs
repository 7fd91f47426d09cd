//! `flashmat bench`: how long each stage takes at several sizes, CPU levels and thread counts; the network against the
//! peak of its instructions, measured in the same run; the start.
use super::capture::{RunArgs, map_size};
use super::{complain, say};
use crate::engine::{self, Engine, Loaded, ModelFile, Settings, Timings};
use crate::failure::Failure;
use crate::interrupt;
use crate::photo::{Photo, Pixels};
use flashmat_core::base::simd::Level;
use std::path::Path;
use std::time::Instant;

/// What to time.
#[derive(clap::Args)]
pub(crate) struct BenchArgs {
    /// Pixels per side, multiples of 128.
    #[arg(long, value_name = "N,...", value_delimiter = ',', default_values_t = [128, 256, 512], value_parser = map_size)]
    size: Vec<usize>,
    /// Runs of each; the median counts.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u16).range(1..=1000))]
    runs: u16,
    #[command(flatten)]
    run: RunArgs,
}

/// Runs the command; `false` when it failed.
pub(crate) fn run(args: &BenchArgs) -> bool {
    match bench(args) {
        Ok(()) => true,
        Err(failure) => {
            complain(&failure);
            false
        }
    }
}

fn bench(args: &BenchArgs) -> Result<(), Failure> {
    let file = ModelFile::load(args.run.model.as_deref())?;
    let model = file.parse()?;
    let levels = args.run.level().map_or_else(engine::levels, |level| vec![level]);
    let mut threads = vec![1, args.run.threads()];
    threads.dedup();
    say(&format!(
        "median of {} runs, milliseconds; levels on this CPU: {}\n",
        args.runs,
        engine::levels().iter().map(|l| l.name()).collect::<Vec<_>>().join(", ")
    ));
    let names: String = Timings::default().named().map(|(name, _)| format!(" {name:>9}")).collect();
    say(&format!("{:>5} {:>11} {:>7} |{names} | {:>9}", "size", "level", "threads", "workspace"));
    let photo = photo();
    for &size in &args.size {
        for &level in &levels {
            for &threads in &threads {
                let settings = Settings {
                    size,
                    engine: args.run.engine,
                    level: Some(level),
                    threads,
                    ..Settings::default()
                };
                one(args, &model, &settings, &photo)?;
            }
        }
    }
    network(args, &model, &levels, &threads)?;
    if args.run.level().is_none() {
        start(args, &photo)?;
    }
    Ok(())
}

/// The network alone: work per second, as a share of what the level's instructions can do on registers.
fn network(args: &BenchArgs, model: &Loaded<'_>, levels: &[Level], threads: &[usize]) -> Result<(), Failure> {
    say(&format!(
        "\nnetwork alone; moved: every layer's sources, weights and result once; {}\n",
        "peak: dot products on registers, one thread"
    ));
    say(&format!(
        "{:>5} {:>11} {:>7} | {:>9} {:>9} {:>7} {:>9} {:>9} {:>6} {:>9} | {:>9}",
        "size",
        "level",
        "threads",
        "median",
        "best",
        "GMAC",
        "GMAC/s",
        "peak",
        "share",
        "MB moved",
        "workspace"
    ));
    let graph = model.model.graph();
    for &size in &args.size {
        let work = graph.macs(size) as f64 * 1e-9;
        for &level in levels {
            let peak = engine::net::peak_rate(level).map(|rate| rate * 1e-9);
            for &threads in threads {
                if interrupt::flow().is_break() {
                    return Ok(());
                }
                let runs = usize::from(args.runs).max(if level == Level::Scalar { 1 } else { 7 });
                let times = engine::net::time(&model.model, size, level, threads, runs)
                    .map_err(|e| Failure::core(Path::new("bench"), &e))?;
                let rate = work / times.best * 1e3;
                let of = |peak: f64| format!("{:.0} %", 100.0 * rate / (peak * threads as f64));
                say(&format!(
                    "{size:>5} {:>11} {threads:>7} | {:>9.2} {:>9.2} {work:>7.3} {rate:>9.1} {:>9} {:>6} {:>9.1} | {:>5.1} MiB",
                    level.name(),
                    times.median,
                    times.best,
                    peak.map_or_else(|| "-".to_owned(), |peak| format!("{peak:.1}")),
                    peak.map_or_else(|| "-".to_owned(), of),
                    graph.bytes_moved(size) as f64 * 1e-6,
                    times.workspace as f64 / f64::from(1 << 20),
                ));
            }
        }
    }
    Ok(())
}

/// From a model's bytes to the first material, against a capture of a running engine.
fn start(args: &BenchArgs, photo: &Photo) -> Result<(), Failure> {
    let ms = |since: Instant| since.elapsed().as_secs_f64() * 1e3;
    let settings = Settings { engine: args.run.engine, ..Settings::default() };
    let begin = Instant::now();
    let file = ModelFile::load(args.run.model.as_deref())?;
    let model = file.parse()?;
    let loaded = ms(begin);
    let mut engine = Engine::new(&model, &settings)?;
    let mut capture = || {
        let begin = Instant::now();
        let done = engine.capture(photo, &mut |_, _| interrupt::flow());
        done.map(|_| ms(begin)).map_err(|e| Failure::core(Path::new("bench"), &e))
    };
    capture()?;
    let first = ms(begin);
    let mut warm = (0..args.runs.max(3)).map(|_| capture()).collect::<Result<Vec<f64>, Failure>>()?;
    warm.sort_by(f64::total_cmp);
    let warm = warm.get(warm.len() / 2).copied().unwrap_or(0.0);
    say(&format!(
        "\nstart at {}: model loaded after {loaded:.1} ms, first material after {first:.1} ms; warm {warm:.1} ms, {:.2} times that",
        settings.size,
        first / warm.max(1e-9)
    ));
    Ok(())
}

fn one(args: &BenchArgs, model: &Loaded<'_>, settings: &Settings, photo: &Photo) -> Result<(), Failure> {
    let mut engine = Engine::new(model, settings)?;
    let (mut runs, mut workspace) = (Vec::new(), 0);
    for _ in 0..args.runs {
        let material = engine
            .capture(photo, &mut |_, _| interrupt::flow())
            .map_err(|e| Failure::core(Path::new("bench"), &e))?;
        workspace = material.workspace_bytes;
        runs.push(material.timings_ms);
    }
    let median = |column: usize| {
        let mut times: Vec<f64> =
            runs.iter().filter_map(|t| t.named().nth(column)).map(|(_, ms)| ms).collect();
        times.sort_by(f64::total_cmp);
        times.get(times.len() / 2).copied().unwrap_or(0.0)
    };
    let columns = 0..Timings::default().named().count();
    let times: String = columns.map(|column| format!(" {:>9.1}", median(column))).collect();
    say(&format!(
        "{:>5} {:>11} {:>7} |{times} | {:>5.1} MiB",
        settings.size,
        engine.facts().level,
        settings.threads,
        workspace as f64 / f64::from(1 << 20),
    ));
    Ok(())
}

/// A photo like a phone's: 12 megapixels of tiles with grain, bright in the middle.
fn photo() -> Photo {
    const WIDTH: u32 = 4032;
    const HEIGHT: u32 = 3024;
    let mut noise = 0x1234_5678_u32;
    let mut pixels = Vec::with_capacity(3 * (WIDTH * HEIGHT) as usize);
    for y in 0..HEIGHT {
        for x in 0..WIDTH {
            noise ^= noise << 13;
            noise ^= noise >> 17;
            noise ^= noise << 5;
            let tile = if (x / 300 + y / 300) % 2 == 0 { 150 } else { 90 };
            let fall = (x.abs_diff(WIDTH / 2).pow(2) + y.abs_diff(HEIGHT / 2).pow(2)) / 90_000;
            let value = (tile + noise % 24).saturating_sub(fall) as u8;
            pixels.extend([value, value - value / 8, value - value / 5]);
        }
    }
    Photo::plain(WIDTH, HEIGHT, Pixels::Rgb8(pixels))
}
