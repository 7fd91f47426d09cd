//! `flashmat eval`: the error table over materials whose maps are known.
//!
//! Each material is photographed by the core's own renderer (flash of strength 1 at the camera, 8-bit sRGB), captured,
//! and compared with its maps. Beside it stands a guess that needs no network: the photo's mean colour, flat normals,
//! roughness 0.5, the commonest class.
use super::capture::{RunArgs, map_size};
use super::{complain, say, workers};
use crate::engine::{Engine, ModelFile, Settings, light};
use crate::failure::Failure;
use crate::material::OwnedMaps;
use crate::metrics::{MapErrors, mean};
use crate::output::files;
use crate::photo::Photo;
use crate::{interrupt, mapset};
use flashmat_core::brdf::{self, F0_DIELECTRIC};
use flashmat_core::frame::FieldOfView;
use flashmat_core::net::Class;
use glam::Vec3;
use indicatif::ProgressBar;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Lights of the re-rendering error, in plane units, none of them the flash.
const UNSEEN_LIGHTS: [Vec3; 6] = [
    Vec3::new(0.8, 0.0, 0.8),
    Vec3::new(-0.8, 0.0, 0.8),
    Vec3::new(0.0, 0.8, 0.8),
    Vec3::new(0.0, -0.8, 0.8),
    Vec3::new(0.3, 0.3, 1.2),
    Vec3::new(-1.0, 1.0, 0.5),
];
const FOV: f32 = FieldOfView::TARGET_DEG;

/// What to evaluate on.
#[derive(clap::Args)]
pub(crate) struct EvalArgs {
    /// A folder of CLASS/NAME/ with albedo, normal and roughness maps.
    #[arg(value_name = "DATASET")]
    dataset: PathBuf,
    /// Also write one line for each material to this file.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Only materials of this split, by `splits.tsv` (class, name, split) in DATASET or beside it.
    #[arg(long, value_name = "NAME")]
    split: Option<String>,
    /// Pixels per side, a multiple of 128.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = map_size)]
    size: usize,
    /// Leave out the refinement after the network.
    #[arg(long)]
    no_refine: bool,
    #[command(flatten)]
    run: RunArgs,
}

/// One ground-truth material.
struct Item {
    class: Class,
    name: String,
    folder: PathBuf,
}

/// Errors of one way to get at the maps.
#[derive(Clone, Copy, Default)]
struct Errors {
    maps: MapErrors,
    /// RMSE of re-renderings under the unseen lights, gamma 2.2.
    relit: f64,
    /// Right classes: 0 or 1, or a share.
    class: f64,
}

/// One material's result.
struct Row {
    class: Class,
    name: String,
    captured: Errors,
    guessed: Errors,
    /// Of the re-render against the photo.
    residual: f64,
    found: Class,
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
    let items = items(&args.dataset, args.split.as_deref())?;
    let settings = Settings {
        size: args.size,
        engine: args.run.engine,
        level: args.run.level(),
        refine: !args.no_refine,
        ..Settings::default()
    };
    let file = ModelFile::load(args.run.model.as_deref())?;
    let model = file.parse()?;
    let (workers, settings) = workers::plan(args.run.threads(), items.len(), &model, settings)?;
    let facts = Engine::new(&model, &settings)?.facts().clone();
    let commonest = commonest_class(&items);
    let bar = ProgressBar::new(items.len() as u64);
    let results: Mutex<Vec<(usize, Result<Row, Failure>)>> = Mutex::new(Vec::new());
    workers::run(workers, items.len(), &model, &settings, |engine, i| {
        let Some(item) = items.get(i) else { return };
        let row = match engine {
            Ok(_) if interrupt::asked() => Err(Failure::new(&item.folder, "interrupted", "run it again")),
            Ok(engine) => one_material(engine, item, args.size, commonest),
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
    say(&format!(
        "{} materials of {}, {} px, model {} ({}), engine {}, level {}{}\n",
        rows.len(),
        args.dataset.display(),
        args.size,
        facts.model_name,
        facts.model_hash.get(..12).unwrap_or(&facts.model_hash),
        facts.engine,
        facts.level,
        if args.no_refine { ", no refinement" } else { "" }
    ));
    say(&table(&rows));
    if let Some(path) = &args.csv {
        files::write_file(path, |f| f.write_all(csv(&rows).as_bytes()))?;
    }
    Ok(whole && !rows.is_empty())
}

/// The materials of `dataset`, sorted by class and name.
fn items(dataset: &Path, split: Option<&str>) -> Result<Vec<Item>, Failure> {
    let wanted = split.map(|split| names_of_split(dataset, split)).transpose()?;
    // Reading the folder itself first tells a wrong path from an empty data set.
    fs::read_dir(dataset).map_err(|e| Failure::reading(dataset, &e))?;
    let mut items = Vec::new();
    for class in Class::ALL {
        let class_name = class.name();
        let Ok(entries) = fs::read_dir(dataset.join(class_name)) else { continue };
        for entry in entries {
            let folder = entry.map_err(|e| Failure::reading(dataset, &e))?.path();
            let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
            let in_split = wanted.as_ref().is_none_or(|w| w.contains(&format!("{class_name}\t{name}")));
            if folder.is_dir() && in_split {
                items.push(Item { class, name, folder });
            }
        }
    }
    items.sort_by(|a, b| (a.class as usize, &a.name).cmp(&(b.class as usize, &b.name)));
    if items.is_empty() {
        let help = format!(
            "give a folder of CLASS/NAME/ folders, the classes being {}",
            Class::ALL.map(Class::name).join(", ")
        );
        return Err(Failure::new(dataset, "holds no materials", help));
    }
    Ok(items)
}

/// "class<tab>name" of each material of a split.
fn names_of_split(dataset: &Path, split: &str) -> Result<Vec<String>, Failure> {
    let beside = dataset.join("splits.tsv");
    let above = dataset.join("..").join("splits.tsv");
    let path = if beside.is_file() { beside } else { above };
    let text = fs::read_to_string(&path).map_err(|e| Failure::reading(&path, &e))?;
    let ends = format!("\t{split}");
    Ok(text.lines().filter_map(|line| line.trim_end().strip_suffix(&ends).map(str::to_owned)).collect())
}

fn commonest_class(items: &[Item]) -> Class {
    let count = |class: &Class| items.iter().filter(|item| item.class == *class).count();
    Class::ALL.into_iter().max_by_key(count).unwrap_or(Class::Wood)
}

fn one_material(engine: &mut Engine<'_>, item: &Item, size: usize, commonest: Class) -> Result<Row, Failure> {
    let truth = mapset::read(&item.folder, Some(size))?;
    let failed = |e: flashmat_core::Error| Failure::core(&item.folder, &e);
    let f0 = brdf::f0(if item.class == Class::Metal { 1.0 } else { 0.0 });
    let radiance = light::relight(&truth, f0, FOV, Vec3::Z, 1.0).map_err(failed)?;
    let photo = Photo::of_radiance(&radiance, size).map_err(failed)?;
    let found = engine.capture(&photo, &mut |_, _| interrupt::flow()).map_err(failed)?;
    let guess = guess(&radiance, size);
    let relit = |maps: &OwnedMaps, its_f0: f32| -> Result<f64, Failure> {
        let mut squares = Vec::new();
        for place in UNSEEN_LIGHTS {
            let strength = light::strength_at_centre(place);
            let wanted = light::relight(&truth, f0, FOV, place, strength).map_err(failed)?;
            let got = light::relight(maps, its_f0, FOV, place, strength).map_err(failed)?;
            let rmse = light::picture_error(&wanted, &got, size, FOV).map_err(failed)?;
            squares.push(f64::from(rmse).powi(2));
        }
        Ok(mean(squares.into_iter()).sqrt())
    };
    let right = |class| if class == item.class { 1.0 } else { 0.0 };
    Ok(Row {
        class: item.class,
        name: item.name.clone(),
        captured: Errors {
            maps: MapErrors::between(&truth, &found.maps),
            relit: relit(&found.maps, found.f0)?,
            class: right(found.class),
        },
        guessed: Errors {
            maps: MapErrors::between(&truth, &guess),
            relit: relit(&guess, F0_DIELECTRIC)?,
            class: right(commonest),
        },
        residual: f64::from(found.residual),
        found: found.class,
    })
}

/// What one would say without a network.
fn guess(photo: &[f32], size: usize) -> OwnedMaps {
    let pixels = size * size;
    let albedo = photo.chunks_exact(pixels).flat_map(|plane| {
        let colour = mean(plane.iter().map(|&v| f64::from(v.min(1.0)))) as f32;
        std::iter::repeat_n(colour, pixels)
    });
    OwnedMaps {
        size,
        albedo: albedo.collect(),
        normal: [vec![0.0; 2 * pixels], vec![1.0; pixels]].concat(),
        roughness: vec![0.5; pixels],
    }
}

fn mean_errors<'a>(errors: impl Iterator<Item = &'a Errors> + Clone) -> Errors {
    let of = |f: fn(&Errors) -> f64| mean(errors.clone().map(f));
    Errors {
        maps: MapErrors {
            albedo: of(|e| e.maps.albedo),
            normal: of(|e| e.maps.normal),
            roughness: of(|e| e.maps.roughness),
            angle_deg: of(|e| e.maps.angle_deg),
        },
        relit: of(|e| e.relit),
        class: of(|e| e.class),
    }
}

/// The table: each class, all, and the guess over all.
fn table(rows: &[Row]) -> String {
    let mut text = format!(
        "{:<12} {:>4} | {:>8} {:>8} {:>8} | {:>7} {:>7} {:>7} | {:>7} {:>7} | {:>7}\n",
        "", "", "paper's", "MSE", "", "RMSE", "", "mean", "class", "relit", "photo"
    );
    text += &format!(
        "{:<12} {:>4} | {:>8} {:>8} {:>8} | {:>7} {:>7} {:>7} | {:>7} {:>7} | {:>7}\n",
        "class", "n", "albedo", "normal", "rough", "albedo", "rough", "angle", "right", "RMSE", "resid."
    );
    let mut line = |name: &str, n: usize, e: Errors, residual: Option<f64>| {
        let [albedo, normal, roughness] = e.maps.paper();
        let residual = residual.map_or_else(|| "-".to_owned(), |r| format!("{r:.3}"));
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{name:<12} {n:>4} | {albedo:>8.4} {normal:>8.4} {roughness:>8.4} | {:>7.3} {:>7.3} {:>6.1}° | {:>5.0} % {:>7.3} | {residual:>7}",
            e.maps.albedo.sqrt(),
            e.maps.roughness.sqrt(),
            e.maps.angle_deg,
            100.0 * e.class,
            e.relit,
        );
    };
    for class in Class::ALL {
        let of_class = rows.iter().filter(|r| r.class == class);
        let n = of_class.clone().count();
        if n > 0 {
            let residual = mean(of_class.clone().map(|r| r.residual));
            line(class.name(), n, mean_errors(of_class.map(|r| &r.captured)), Some(residual));
        }
    }
    let residual = mean(rows.iter().map(|r| r.residual));
    line("all", rows.len(), mean_errors(rows.iter().map(|r| &r.captured)), Some(residual));
    line("plain guess", rows.len(), mean_errors(rows.iter().map(|r| &r.guessed)), None);
    text += "\npaper's MSE: albedo and roughness on [-1,1], unit normals; RMSE: linear albedo, roughness in [0,1];\n";
    text += "relit: lights not seen, gamma 2.2; plain guess: the photo's mean colour, flat, roughness 0.5, commonest class";
    text
}

fn csv(rows: &[Row]) -> String {
    let mut text =
        "class,name,found,albedo_mse_paper,normal_mse_paper,roughness_mse_paper,albedo_rmse,roughness_rmse,\
                    angle_deg,relit_rmse,residual,guess_albedo_mse_paper,guess_normal_mse_paper,\
                    guess_roughness_mse_paper,guess_relit_rmse\n"
            .to_owned();
    for row in rows {
        let ([a, n, r], [ga, gn, gr]) = (row.captured.maps.paper(), row.guessed.maps.paper());
        let maps = &row.captured.maps;
        let name = format!("\"{}\"", row.name.replace('"', "\"\""));
        let _ = writeln!(
            text,
            "{},{name},{},{a:.6},{n:.6},{r:.6},{:.6},{:.6},{:.4},{:.6},{:.6},{ga:.6},{gn:.6},{gr:.6},{:.6}",
            row.class.name(),
            row.found.name(),
            maps.albedo.sqrt(),
            maps.roughness.sqrt(),
            maps.angle_deg,
            row.captured.relit,
            row.residual,
            row.guessed.relit,
        );
    }
    text
}
