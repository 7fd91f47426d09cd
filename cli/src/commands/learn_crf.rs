//! `flashmat learn-crf`: the CRFs' coefficients, learned through the solver that ships.
//!
//! Paper, "Details of Continuous DCRFs": one set per class, mixed with the classifier's output; Adam, 2e-4, halved every
//! 2000 iterations, batches of 32; 4000 iterations for albedo, 3000 for normals and for roughness. The network is
//! fixed: its int8 outputs on the data set are computed once. The CRFs are learned in the order in which they run, each on
//! what the ones before it, as learned, give. Of each CRF the coefficients of the epoch with the least error on the
//! validation photos are kept.
mod adam;
mod gradient;
mod sample;
#[cfg(test)]
mod tests;

use super::capture::{RunArgs, light_scale, map_size};
use super::{complain, say, workers};
use crate::dataset::{self, Item};
use crate::engine::{Engine, ModelFile, Settings, rewrite};
use crate::failure::Failure;
use crate::interrupt;
use crate::output::files;
use adam::Adam;
use flashmat_core::Error;
use flashmat_core::base::exec::{At, Inline};
use flashmat_core::base::simd::{Level, Simd};
use flashmat_core::crf::coefficients::{CLASSES, COUNT};
use flashmat_core::crf::{self, Coefficients};
use flashmat_core::net::Class;
use gradient::Values;
use indicatif::ProgressBar;
use rayon::prelude::*;
use sample::{Sample, Sets, Stage};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// One thread with this CPU's widest registers; the bits are those of any other.
fn fast() -> At<'static> {
    At::new(&Inline, Simd::for_level(Level::detect()).unwrap_or(Simd::BASELINE))
}

/// What to learn from, and how.
#[derive(clap::Args)]
pub(crate) struct LearnArgs {
    /// Photos of training materials: CLASS/NAME/ with maps and photo.png (`python -m flashmat_train testset`).
    #[arg(value_name = "DATASET")]
    dataset: PathBuf,
    /// Photos of other materials, to choose the best epoch by.
    #[arg(long, value_name = "DATASET")]
    val: PathBuf,
    /// Where the model with the learned coefficients goes.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Pixels per side, a multiple of 128.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = map_size)]
    size: usize,
    /// Linear value that a flat white surface at the centre has in these photos, told to the network.
    #[arg(long, value_name = "S", value_parser = light_scale, allow_negative_numbers = true)]
    light_scale: Option<f32>,
    /// Photos in a batch.
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u32).range(1..))]
    batch: u32,
    /// Adam's rate at the start.
    #[arg(long, value_name = "R", default_value_t = 2e-4, value_parser = rate, allow_negative_numbers = true)]
    rate: f64,
    /// Steps after which the rate is halved, again and again.
    #[arg(long, value_name = "N", default_value_t = 2000, value_parser = clap::value_parser!(u32).range(1..))]
    halve: u32,
    /// Steps for albedo, normals and roughness.
    #[arg(long, value_name = "A,N,R", default_value = "4000,3000,3000", value_parser = steps)]
    steps: [u32; 3],
    /// Of the order of the photos.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    run: RunArgs,
}

/// Coefficients are shares of 1: a larger rate throws them about.
fn rate(text: &str) -> Result<f64, String> {
    let in_range = |r: &f64| (1e-9..=1.0).contains(r);
    text.parse().ok().filter(in_range).ok_or_else(|| "must be 1e-9 to 1".to_owned())
}

fn steps(text: &str) -> Result<[u32; 3], String> {
    let steps: Result<Vec<u32>, _> = text.split(',').map(str::parse).collect();
    let steps = steps.ok().and_then(|steps| steps.try_into().ok());
    steps.ok_or_else(|| "must be three counts, as in 4000,3000,3000".to_owned())
}

/// Runs the command; `false` when it failed.
pub(crate) fn run(args: &LearnArgs) -> bool {
    match learn(args) {
        Ok(()) => true,
        Err(failure) => {
            complain(&failure);
            false
        }
    }
}

fn learn(args: &LearnArgs) -> Result<(), Failure> {
    let file = ModelFile::load(args.run.model.as_deref())?;
    let threads = rayon::ThreadPoolBuilder::new().num_threads(args.run.threads()).build();
    let Ok(threads) = threads else {
        return Err(Failure::new(Path::new("--threads"), "cannot be started", "use fewer --threads"));
    };
    let mut train = samples(args, &args.dataset, &file)?;
    let mut val = samples(args, &args.val, &file)?;
    say(&format!("{} photos to learn from, {} to validate on", train.len(), val.len()));
    let loaded = file.parse()?;
    let given: Sets = Class::ALL.map(|c| Coefficients::from_array(&loaded.model.crf(c)).normalised());
    let mut sets = given;
    let mut before = given;
    let mut summary = "\nmean squared error, paper's convention\n".to_owned();
    let failed = |e: Error| Failure::core(&args.dataset, &e);
    for (stage, &steps) in Stage::ALL.into_iter().zip(&args.steps) {
        let run = StageRun { stage, args, threads: &threads };
        // Where the photo says nothing of a class, its coefficients stay; `before` keeps the given ones of this stage.
        copy_stage(&given, &mut before, stage);
        let _ = write!(summary, "{}", run.row("train", &train, &before).map_err(failed)?);
        sets = run.learn(&train, &val, sets, steps).map_err(failed)?;
        let _ = writeln!(summary, "{:.6}", run.loss(&train, &sets).map_err(failed)?);
        let _ = write!(summary, "{}", run.row("val", &val, &before).map_err(failed)?);
        let _ = writeln!(summary, "{:.6}", run.loss(&val, &sets).map_err(failed)?);
        before = sets;
        run.advance(&mut train, &sets).map_err(failed)?;
        run.advance(&mut val, &sets).map_err(failed)?;
    }
    say(&summary);
    say(&listing(&sets));
    let values = sets.map(|set| set.to_array());
    let bytes = rewrite::with_crf(file.bytes(), &values).map_err(|e| Failure::core(&args.out, &e))?;
    files::write_file(&args.out, |f| f.write_all(&bytes))
}

/// The coefficients of `stage` from one collection of sets to another.
fn copy_stage(from: &Sets, to: &mut Sets, stage: Stage) {
    for (from, to) in from.iter().zip(to) {
        match stage {
            Stage::Albedo => to.albedo = from.albedo,
            Stage::Normal => to.normal = from.normal,
            Stage::Roughness => to.roughness = from.roughness,
        }
    }
}

/// Coefficients that belong to a stage, within a class's.
fn range(stage: Stage) -> std::ops::Range<usize> {
    match stage {
        Stage::Albedo => 0..5,
        Stage::Normal => 5..8,
        Stage::Roughness => 8..COUNT,
    }
}

/// Every photo of a data set through the network; photos that it cannot take are named and left out.
fn samples(args: &LearnArgs, dataset: &Path, file: &ModelFile) -> Result<Vec<Sample>, Failure> {
    let items: Vec<Item> = dataset::items(dataset, None)?;
    let settings = Settings {
        size: args.size,
        engine: args.run.engine,
        level: args.run.level(),
        refine: false,
        light_scale: args.light_scale,
        ..Settings::default()
    };
    let model = file.parse()?;
    let (workers, settings) = workers::plan(args.run.threads(), items.len(), &model, settings)?;
    let bar = ProgressBar::new(items.len() as u64);
    let results: Mutex<Vec<(usize, Result<Sample, Failure>)>> = Mutex::new(Vec::new());
    workers::run(workers, items.len(), &model, &settings, |engine: &mut Result<Engine<'_>, Failure>, i| {
        let Some(item) = items.get(i) else { return };
        let sample = match engine {
            Ok(engine) => Sample::new(engine, item, args.size, args.light_scale),
            Err(failure) => Err(failure.clone()),
        };
        results.lock().unwrap_or_else(PoisonError::into_inner).push((i, sample));
        bar.inc(1);
    });
    bar.finish_and_clear();
    let mut results = results.into_inner().unwrap_or_else(PoisonError::into_inner);
    results.sort_by_key(|(i, _)| *i);
    let mut samples = Vec::new();
    for (_, result) in results {
        match result {
            Ok(sample) => samples.push(sample),
            // A photo that shows nothing (overexposed all over) teaches nothing.
            Err(failure) => complain(&failure),
        }
    }
    if samples.is_empty() {
        return Err(Failure::new(dataset, "holds no photo that can be captured", "see the lines above"));
    }
    Ok(samples)
}

/// One CRF being learned.
struct StageRun<'a> {
    stage: Stage,
    args: &'a LearnArgs,
    threads: &'a rayon::ThreadPool,
}

impl StageRun<'_> {
    /// The start of a line of the summary: errors without the CRF and with the coefficients given.
    fn row(&self, split: &str, samples: &[Sample], given: &Sets) -> Result<String, Error> {
        let without: f64 = samples
            .iter()
            .map(|s| match self.stage {
                Stage::Albedo => gradient::loss(self.stage, &s.first.albedo, &s.truth.albedo),
                Stage::Normal => gradient::loss(self.stage, &s.first.normal, &s.truth.normal),
                Stage::Roughness => gradient::loss(self.stage, &s.first.roughness, &s.truth.roughness),
            })
            .sum::<f64>()
            / samples.len() as f64;
        let given = self.loss(samples, given)?;
        Ok(format!(
            "{:<10} {split:<5} without {without:.6}  as given {given:.6}  learned ",
            self.stage.name()
        ))
    }

    /// Mean loss over the samples.
    fn loss(&self, samples: &[Sample], sets: &Sets) -> Result<f64, Error> {
        let losses: Vec<f64> = self.threads.install(|| {
            let each = samples.par_iter().map_init(
                || Sample::workspace(self.args.size),
                |workspace, sample| {
                    let truth = match self.stage {
                        Stage::Albedo => &sample.truth.albedo,
                        Stage::Normal => &sample.truth.normal,
                        Stage::Roughness => &sample.truth.roughness,
                    };
                    Ok(gradient::loss(self.stage, &sample.crf(self.stage, sets, workspace)?, truth))
                },
            );
            each.collect::<Result<_, Error>>()
        })?;
        Ok(losses.iter().sum::<f64>() / losses.len().max(1) as f64)
    }

    /// Mean loss and gradient over the samples of a batch; the sum's order is the batch's.
    fn gradient(&self, batch: &[&Sample], sets: &Sets) -> Result<(f64, Values), Error> {
        let parts: Vec<(f64, Values)> = self.threads.install(|| {
            let each = batch.par_iter().map_init(
                || Sample::workspace(self.args.size),
                |workspace, sample| {
                    let mut sums = [[0.0; COUNT]; CLASSES];
                    let options = crf::Options::default();
                    let loss =
                        gradient::accumulate(sample, self.stage, sets, &options, workspace, &mut sums)?;
                    Ok((loss, sums))
                },
            );
            each.collect::<Result<_, Error>>()
        })?;
        let share = 1.0 / batch.len().max(1) as f64;
        let mut mean = (0.0, [[0.0; COUNT]; CLASSES]);
        for (loss, values) in parts {
            mean.0 += share * loss;
            mean.1.iter_mut().flatten().zip(values.iter().flatten()).for_each(|(m, v)| *m += share * v);
        }
        Ok(mean)
    }

    /// Adam over batches; a line for each epoch. Gives the coefficients of the epoch that was best on `val`.
    fn learn(&self, train: &[Sample], val: &[Sample], start: Sets, steps: u32) -> Result<Sets, Error> {
        let mut theta: Values = start.map(|set| set.to_array().map(f64::from));
        let mut adam = Adam::new(self.args.rate, self.args.halve);
        let mut order = Order::new(train.len(), self.args.seed);
        let mut best = (self.loss(val, &start)?, start);
        let (mut sum, mut count) = (0.0, 0_u32);
        say(&format!("{}: validation {:.6} as given", self.stage.name(), best.0));
        for step in 0..steps {
            if interrupt::asked() {
                return Err(Error::Cancelled);
            }
            let (batch, epoch_ends) = order.batch(self.args.batch as usize);
            let batch: Vec<&Sample> = batch.iter().filter_map(|&i| train.get(i)).collect();
            let (loss, gradient) = self.gradient(&batch, &sets(&theta))?;
            (sum, count) = (sum + loss, count + 1);
            adam.step(&mut theta, &gradient, range(self.stage));
            if epoch_ends || step + 1 == steps {
                let now = sets(&theta);
                let validation = self.loss(val, &now)?;
                let mark = if validation < best.0 { " *" } else { "" };
                say(&format!(
                    "{} step {}: train {:.6}, validation {validation:.6}{mark}",
                    self.stage.name(),
                    step + 1,
                    sum / f64::from(count)
                ));
                (sum, count) = (0.0, 0);
                if validation < best.0 {
                    best = (validation, now);
                }
            }
        }
        Ok(best.1)
    }

    /// Refines the map of this stage in every sample, for the stages after it.
    fn advance(&self, samples: &mut [Sample], sets: &Sets) -> Result<(), Error> {
        self.threads.install(|| {
            samples.par_iter_mut().try_for_each_init(
                || Sample::workspace(self.args.size),
                |workspace, sample| sample.advance(self.stage, sets, workspace),
            )
        })
    }
}

/// The coefficients as the model file will hold them: non-negative, each CRF's sum 1.
fn sets(theta: &Values) -> Sets {
    theta.map(|values| Coefficients::from_array(&values.map(|v| v as f32)).normalised())
}

/// Photos in a new order each epoch.
struct Order {
    indices: Vec<usize>,
    at: usize,
    state: u64,
}

impl Order {
    fn new(count: usize, seed: u64) -> Self {
        let mut order = Self { indices: (0..count).collect(), at: 0, state: seed };
        order.shuffle();
        order
    }

    /// The next photos, and whether they end an epoch; the last batch of an epoch may be shorter.
    fn batch(&mut self, count: usize) -> (Vec<usize>, bool) {
        let end = (self.at + count).min(self.indices.len());
        let batch = self.indices.get(self.at..end).unwrap_or(&[]).to_vec();
        self.at = end;
        let ends = end == self.indices.len();
        if ends {
            self.shuffle();
            self.at = 0;
        }
        (batch, ends)
    }

    /// Fisher and Yates, numbers from SplitMix64.
    fn shuffle(&mut self) {
        for i in (1..self.indices.len()).rev() {
            self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = self.state;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            self.indices.swap(i, ((z ^ (z >> 31)) % (i as u64 + 1)) as usize);
        }
    }
}

/// The coefficients as a table.
fn listing(sets: &Sets) -> String {
    let heads = ["a0", "a1", "b1", "b2", "b3", "a", "b1", "b2", "a0", "a1", "b1", "b2"];
    let mut text = format!("{:<11}| albedo{:31}| normal{:16}| roughness\n{:<11}", "", "", "", "class");
    let bar = |i: usize| if [0, 5, 8].contains(&i) { "|" } else { "" };
    for (i, head) in heads.iter().enumerate() {
        let _ = write!(text, "{}{head:>7} ", bar(i));
    }
    for (class, set) in Class::ALL.iter().zip(sets) {
        let _ = write!(text, "\n{:<11}", class.name());
        for (i, value) in set.to_array().iter().enumerate() {
            let _ = write!(text, "{}{value:>7.4} ", bar(i));
        }
    }
    text
}
