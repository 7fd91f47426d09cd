//! `flashmat eval`: the error table over materials whose maps are known.
//!
//! A folder that holds `photo.png` is captured from it (`python -m flashmat_train testset` makes such folders with
//! Mitsuba); others are photographed by the core's own renderer (flash of strength 1 at the camera, 8-bit sRGB).
//! Beside the capture stand guesses and a classical estimate that need no network, and, if asked for, the capture
//! without refinement, by the float engine, and by other models.
mod baselines;
mod table;

use super::capture::{RunArgs, light_scale, map_size};
use super::{complain, say, workers};
use crate::dataset::{self, FOV, Item};
use crate::engine::{Engine, EngineKind, Facts, ModelFile, Settings, light};
use crate::failure::Failure;
use crate::interrupt;
use crate::material::OwnedMaps;
use crate::metrics::{MapErrors, mean};
use crate::output::files;
use baselines::Baseline;
use flashmat_core::brdf::F0_DIELECTRIC;
use glam::Vec3;
use indicatif::ProgressBar;
use std::path::PathBuf;
use std::sync::Mutex;
use table::{Errors, Method, Row};

/// Lights of the re-rendering error, in plane units, none of them the flash.
const UNSEEN_LIGHTS: [Vec3; 6] = [
    Vec3::new(0.8, 0.0, 0.8),
    Vec3::new(-0.8, 0.0, 0.8),
    Vec3::new(0.0, 0.8, 0.8),
    Vec3::new(0.0, -0.8, 0.8),
    Vec3::new(0.3, 0.3, 1.2),
    Vec3::new(-1.0, 1.0, 0.5),
];

/// Strengths of the environment in the sweep, the flash being 1: the paper's figure has them from 0 to 0.8.
const SWEEP: [f32; 9] = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8];

/// What to evaluate on.
#[derive(clap::Args)]
pub(crate) struct EvalArgs {
    /// A folder of CLASS/NAME/ with albedo, normal and roughness maps, and perhaps photo.png.
    #[arg(value_name = "DATASET")]
    dataset: PathBuf,
    /// Also write one line for each method and photo to this file.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Also write the tables in Markdown to this file.
    #[arg(long, value_name = "FILE")]
    markdown: Option<PathBuf>,
    /// Only materials of this split, by `splits.tsv` (class, name, split) in DATASET or beside it.
    #[arg(long, value_name = "NAME")]
    split: Option<String>,
    /// Only every Nth photo.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// Pixels per side, a multiple of 128.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = map_size)]
    size: usize,
    /// Leave out the refinement after the network.
    #[arg(long)]
    no_refine: bool,
    /// Linear value that a flat white surface at the centre has in these photos, told to the network; 1 in photos of
    /// `testset` and those made here. Without it the albedo's brightness is a guess.
    #[arg(long, value_name = "S", value_parser = light_scale, allow_negative_numbers = true)]
    light_scale: Option<f32>,
    /// Also without refinement, both by the float engine, and without the light scale.
    #[arg(long, conflicts_with = "no_refine")]
    compare: bool,
    /// Also another model, without refinement: the ablations.
    #[arg(long, value_name = "LABEL=FILE", value_parser = labelled)]
    also: Vec<(String, PathBuf)>,
    /// Environment of this strength (flash = 1) in place of the photo's own; needs environment.png.
    #[arg(long, value_name = "S", value_parser = strength)]
    environment: Option<f32>,
    /// Also write the errors at environment strengths 0 to 0.8 to this file (CSV).
    #[arg(long, value_name = "FILE")]
    sweep: Option<PathBuf>,
    #[command(flatten)]
    run: RunArgs,
}

fn labelled(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((label, file)) if !label.is_empty() && !file.is_empty() => Ok((label.to_owned(), file.into())),
        _ => Err("must be LABEL=FILE".to_owned()),
    }
}

fn strength(text: &str) -> Result<f32, String> {
    let in_range = |s: &f32| (0.0..=10.0).contains(s);
    text.parse().ok().filter(in_range).ok_or_else(|| "must be 0 to 10".to_owned())
}

/// One way to run the network.
struct Variant<'f> {
    name: String,
    file: &'f ModelFile,
    engine: EngineKind,
    refine: bool,
    light_scale: Option<f32>,
}

/// What all methods are measured on.
struct Data<'a> {
    items: &'a [Item],
    args: &'a EvalArgs,
}

/// Runs the command; `false` when a material could not be evaluated.
pub(crate) fn run(args: &EvalArgs) -> bool {
    match evaluate(args) {
        Ok(whole) => whole,
        Err(failure) => {
            complain(&failure);
            false
        }
    }
}

fn evaluate(args: &EvalArgs) -> Result<bool, Failure> {
    let items = dataset::items(&args.dataset, args.split.as_deref())?;
    let items: Vec<Item> = items.into_iter().step_by(args.every as usize).collect();
    let data = Data { items: &items, args };
    let file = ModelFile::load(args.run.model.as_deref())?;
    let others = args.also.iter().map(|(label, path)| Ok((label, ModelFile::load(Some(path))?)));
    let others = others.collect::<Result<Vec<_>, Failure>>()?;
    let variants = variants(args, &file, &others);

    let (mut methods, mut whole, mut title) = (Vec::new(), true, String::new());
    for variant in &variants {
        let (rows, facts, complete) = data.captured(variant, args.environment)?;
        if title.is_empty() {
            title = heading(args, rows.len(), &facts);
        }
        // Each later method fails on what the first one failed on.
        whole &= complete || !methods.is_empty();
        methods.push(Method { name: variant.name.clone(), rows });
    }
    methods.extend(data.guessed(methods.first()));
    say(&format!("{title}\n\n{}", table::text(&methods)));
    if let Some(path) = &args.csv {
        files::write_file(path, |f| f.write_all(table::csv(&methods).as_bytes()))?;
    }
    if let Some(path) = &args.markdown {
        files::write_file(path, |f| f.write_all(table::markdown(&methods, &title).as_bytes()))?;
    }
    if let (Some(path), Some(variant)) = (&args.sweep, variants.first()) {
        let mut points = Vec::new();
        for strength in SWEEP {
            let (rows, _, complete) = data.captured(variant, Some(strength))?;
            whole &= complete;
            points.push((strength, Method { name: String::new(), rows }.means(None).1));
        }
        files::write_file(path, |f| f.write_all(table::sweep_csv(&points).as_bytes()))?;
    }
    Ok(whole && methods.first().is_some_and(|m| !m.rows.is_empty()))
}

/// The capture as asked for, then what it is to be compared with.
fn variants<'f>(
    args: &EvalArgs,
    file: &'f ModelFile,
    others: &'f [(&String, ModelFile)],
) -> Vec<Variant<'f>> {
    let refined = |refine| if refine { "refined" } else { "not refined" };
    let own = |engine: EngineKind, refine| Variant {
        name: format!("{}, {}", engine.name(), refined(refine)),
        file,
        engine,
        refine,
        light_scale: args.light_scale,
    };
    let mut variants = vec![own(args.run.engine, !args.no_refine)];
    if args.compare {
        variants.push(own(args.run.engine, false));
        // A build without the float engine compares what it has.
        if cfg!(feature = "float") && args.run.engine != EngineKind::Float {
            variants.extend([own(EngineKind::Float, true), own(EngineKind::Float, false)]);
        }
        if args.light_scale.is_some() {
            let known = own(args.run.engine, true);
            variants.push(Variant {
                name: format!("{}, light scale not told", known.name),
                light_scale: None,
                ..known
            });
        }
    }
    variants.extend(others.iter().map(|(label, file)| Variant {
        name: format!("{label}, not refined"),
        file,
        engine: args.run.engine,
        refine: false,
        light_scale: args.light_scale,
    }));
    variants
}

fn heading(args: &EvalArgs, photos: usize, facts: &Facts) -> String {
    let environment = args.environment.map_or_else(String::new, |s| format!(", environment {s}"));
    let told = args.light_scale.map_or_else(String::new, |s| format!(", light scale {s} told"));
    format!(
        "{photos} photos of {}, {} px, model {} ({}), level {}{environment}{told}",
        args.dataset.display(),
        args.size,
        facts.model_name,
        facts.model_hash.get(..12).unwrap_or(&facts.model_hash),
        facts.level,
    )
}

impl Data<'_> {
    /// Every item through the engine; items that fail are complained about, and the last value is then `false`.
    fn captured(
        &self,
        variant: &Variant<'_>,
        environment: Option<f32>,
    ) -> Result<(Vec<Row>, Facts, bool), Failure> {
        let args = self.args;
        let settings = Settings {
            size: args.size,
            engine: variant.engine,
            level: args.run.level(),
            refine: variant.refine,
            light_scale: variant.light_scale,
            ..Settings::default()
        };
        let model = variant.file.parse()?;
        let (workers, settings) = workers::plan(args.run.threads(), self.items.len(), &model, settings)?;
        let facts = Engine::new(&model, &settings)?.facts().clone();
        let bar = ProgressBar::new(self.items.len() as u64);
        let results: Mutex<Vec<(usize, Result<Row, Failure>)>> = Mutex::new(Vec::new());
        workers::run(workers, self.items.len(), &model, &settings, |engine, i| {
            let Some(item) = self.items.get(i) else { return };
            let row = match engine {
                Ok(_) if interrupt::asked() => Err(Failure::new(&item.folder, "interrupted", "run it again")),
                Ok(engine) => self.capture(engine, item, environment),
                Err(failure) => Err(failure.clone()),
            };
            results.lock().unwrap_or_else(std::sync::PoisonError::into_inner).push((i, row));
            bar.inc(1);
        });
        bar.finish_and_clear();
        let mut results = results.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
        // In the data set's order, whichever thread was first.
        results.sort_by_key(|(i, _)| *i);
        let (mut rows, mut whole) = (Vec::new(), true);
        for (_, result) in results {
            match result {
                Ok(row) => rows.push(row),
                Err(failure) => {
                    complain(&failure);
                    whole = false;
                }
            }
        }
        Ok((rows, facts, whole))
    }

    fn capture(
        &self,
        engine: &mut Engine<'_>,
        item: &Item,
        environment: Option<f32>,
    ) -> Result<Row, Failure> {
        let shot = dataset::shot(item, self.args.size, environment)?;
        let failed = |e: flashmat_core::Error| Failure::core(&item.folder, &e);
        let found = engine.capture(&shot.photo, &mut |_, _| interrupt::flow()).map_err(failed)?;
        let wanted = relit(item, &shot.truth, item.f0())?;
        let mut errors = errors(item, (&shot.truth, &wanted), &found.maps, found.f0)?;
        errors.class = if found.class == item.class { 1.0 } else { 0.0 };
        errors.residual = Some(f64::from(found.residual));
        Ok(Row { class: item.class, name: item.name.clone(), errors, found: found.class })
    }

    /// The baselines, on the photos that `captured` has too: all methods are measured on the same ones.
    fn guessed(&self, captured: Option<&Method>) -> Vec<Method> {
        let found = baselines::commonest(self.items.iter().map(|item| item.class));
        let mut methods =
            Baseline::ALL.map(|baseline| Method { name: baseline.name().to_owned(), rows: Vec::new() });
        let known = |item: &&Item| {
            let mut rows = captured.into_iter().flat_map(|method| &method.rows);
            rows.any(|row| (row.class, &row.name) == (item.class, &item.name))
        };
        for item in self.items.iter().filter(known) {
            let size = self.args.size;
            let Ok(shot) = dataset::shot(item, size, self.args.environment) else { continue };
            let Ok(wanted) = relit(item, &shot.truth, item.f0()) else { continue };
            for (method, baseline) in methods.iter_mut().zip(Baseline::ALL) {
                let Ok(maps) = baseline.maps(&shot.photo, size) else { continue };
                let Ok(mut errors) = errors(item, (&shot.truth, &wanted), &maps, F0_DIELECTRIC) else {
                    continue;
                };
                errors.class = if found == item.class { 1.0 } else { 0.0 };
                method.rows.push(Row { class: item.class, name: item.name.clone(), errors, found });
            }
        }
        methods.into()
    }
}

/// The maps under each of the unseen lights.
fn relit(item: &Item, maps: &OwnedMaps, f0: f32) -> Result<Vec<Vec<f32>>, Failure> {
    let render = |place: Vec3| light::relight(maps, f0, FOV, place, light::strength_at_centre(place));
    let renders = UNSEEN_LIGHTS.into_iter().map(render).collect::<Result<_, _>>();
    renders.map_err(|e| Failure::core(&item.folder, &e))
}

/// Errors of the maps and of their renders under the unseen lights, against the truth and its renders; class and
/// residual are left to the caller.
fn errors(
    item: &Item,
    (truth, wanted): (&OwnedMaps, &[Vec<f32>]),
    found: &OwnedMaps,
    found_f0: f32,
) -> Result<Errors, Failure> {
    let mut squares = Vec::new();
    for (wanted, got) in wanted.iter().zip(relit(item, found, found_f0)?) {
        let rmse = light::picture_error(wanted, &got, truth.size, FOV)
            .map_err(|e| Failure::core(&item.folder, &e))?;
        squares.push(f64::from(rmse).powi(2));
    }
    Ok(Errors {
        maps: MapErrors::between(truth, found),
        relit: mean(squares.into_iter()).sqrt(),
        ..Errors::default()
    })
}
