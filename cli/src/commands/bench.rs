//! `flashmat bench`: how long each stage takes at several sizes, CPU levels and thread counts.
use super::capture::{RunArgs, map_size};
use super::{complain, say};
use crate::engine::{self, Engine, Loaded, ModelFile, Settings, Timings};
use crate::failure::Failure;
use crate::interrupt;
use crate::photo::{Photo, Pixels};
use std::path::Path;

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
    say(&format!(
        "{:>5} {:>11} {:>7} | {:>7} {:>8} {:>10} {:>10} {:>8} {:>13} {:>9} | {:>9}",
        "size",
        "level",
        "threads",
        "frame",
        "net",
        "crf_albedo",
        "crf_normal",
        "search",
        "crf_roughness",
        "total",
        "workspace"
    ));
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
    let median = |stage: fn(&Timings) -> f64| {
        let mut times: Vec<f64> = runs.iter().map(stage).collect();
        times.sort_by(f64::total_cmp);
        times.get(times.len() / 2).copied().unwrap_or(0.0)
    };
    say(&format!(
        "{:>5} {:>11} {:>7} | {:>7.1} {:>8.1} {:>10.1} {:>10.1} {:>8.1} {:>13.1} {:>9.1} | {:>5.1} MiB",
        settings.size,
        engine.facts().level,
        settings.threads,
        median(|t| t.frame),
        median(|t| t.net),
        median(|t| t.crf_albedo),
        median(|t| t.crf_normal),
        median(|t| t.search),
        median(|t| t.crf_roughness),
        median(|t| t.total),
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
