//! `flashmat capture`: photos in, a folder of maps for each out.
use super::{complain, say, workers};
use crate::engine::{Engine, EngineKind, ModelFile, Settings};
use crate::failure::{Failure, one_line};
use crate::interrupt;
use crate::material::Material;
use crate::output::files::{self, System};
use crate::output::owner::Stamp;
use crate::output::places::{Place, Places};
use crate::output::{self, png::Depth};
use crate::photo;
use flashmat_core::base::simd::Level;
use flashmat_core::frame;
use flashmat_core::net::Class;
use flashmat_core::{Error, Stage};
use indicatif::{ProgressBar, ProgressStyle};
use std::fs;
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Steps of the progress bar for one photo.
const STEPS: u64 = 100;

/// How each photo is taken to maps.
#[derive(clap::Args)]
pub(crate) struct CaptureArgs {
    /// Flash photos of flat materials: PNG, JPEG, TIFF or WebP.
    #[arg(required = true, value_name = "PHOTO")]
    photos: Vec<PathBuf>,
    /// Folder for the results; each photo gets a folder in it, named like the photo.
    #[arg(long, value_name = "DIR", default_value = "out")]
    out: PathBuf,
    /// What the photos' values mean, whatever the files say [default: by their colour profiles, else srgb].
    #[arg(long, value_enum)]
    encoding: Option<Encoding>,
    /// Angle of view over the photos' shorter side, in degrees [default: from EXIF, else 43.35].
    #[arg(long, value_name = "DEG", value_parser = degrees)]
    fov: Option<f32>,
    /// Pixels per side of the maps, a multiple of 128.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = map_size)]
    size: usize,
    /// The material class, when you know better than the network.
    #[arg(long, value_name = "NAME", value_parser = clap::builder::PossibleValuesParser::new(Class::ALL.map(Class::name)))]
    class: Option<String>,
    /// Linear value that a flat white surface at the centre has in these photos (same exposure, same distance), if
    /// known: measure it once with a sheet of white paper. Without it the albedo's brightness is a guess.
    #[arg(long, value_name = "S", value_parser = light_scale, allow_negative_numbers = true)]
    light_scale: Option<f32>,
    #[command(flatten)]
    run: RunArgs,
    /// Leave out the refinement after the network.
    #[arg(long)]
    no_refine: bool,
    /// Bits per channel of the maps.
    #[arg(long, value_name = "8|16", default_value = "8", value_parser = bit_depth)]
    bit_depth: Depth,
    /// Say nothing but errors.
    #[arg(long, short)]
    quiet: bool,
}

/// Options of all commands that run the network.
#[derive(clap::Args, Clone)]
pub(crate) struct RunArgs {
    /// A model file in place of the embedded model.
    #[arg(long, value_name = "FILE")]
    pub(crate) model: Option<PathBuf>,
    /// Arithmetic of the network.
    #[arg(long, value_enum, default_value_t)]
    pub(crate) engine: EngineKind,
    /// CPU level of the integer kernels; all give the same maps.
    #[arg(long, value_name = "LEVEL", default_value = "auto", value_parser = level_names())]
    level: String,
    /// Threads in all [default: one for each CPU].
    #[arg(long, value_name = "N", value_parser = thread_count)]
    pub(crate) threads: Option<usize>,
}

impl RunArgs {
    /// The CPU level asked for; none: the fastest.
    pub(crate) fn level(&self) -> Option<Level> {
        Level::from_name(&self.level)
    }

    /// Threads in all.
    pub(crate) fn threads(&self) -> usize {
        self.threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from))
    }
}

/// What the photos' values mean.
#[derive(Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Encoding {
    /// sRGB.
    Srgb,
    /// Linear light, sRGB primaries.
    Linear,
    /// Display P3.
    DisplayP3,
}

impl From<Encoding> for frame::Encoding {
    fn from(encoding: Encoding) -> Self {
        match encoding {
            Encoding::Srgb => Self::Srgb,
            Encoding::Linear => Self::Linear,
            Encoding::DisplayP3 => Self::DisplayP3,
        }
    }
}

fn level_names() -> clap::builder::PossibleValuesParser {
    std::iter::once("auto").chain(Level::ALL.map(Level::name)).collect::<Vec<_>>().into()
}

fn bit_depth(text: &str) -> Result<Depth, String> {
    match text {
        "8" => Ok(Depth::Eight),
        "16" => Ok(Depth::Sixteen),
        _ => Err("must be 8 or 16".to_owned()),
    }
}

fn degrees(text: &str) -> Result<f32, String> {
    let in_range = |d: &f32| (1.0..=170.0).contains(d);
    text.parse().ok().filter(in_range).ok_or_else(|| "must be 1 to 170 degrees".to_owned())
}

pub(crate) fn light_scale(text: &str) -> Result<f32, String> {
    let in_range = |s: &f32| (1e-3..=1e3).contains(s);
    text.parse().ok().filter(in_range).ok_or_else(|| "must be 0.001 to 1000".to_owned())
}

pub(crate) fn map_size(text: &str) -> Result<usize, String> {
    let fits = |n: &usize| (128..=2048).contains(n) && n.is_multiple_of(128);
    text.parse().ok().filter(fits).ok_or_else(|| "must be a multiple of 128, from 128 to 2048".to_owned())
}

fn thread_count(text: &str) -> Result<usize, String> {
    let fits = |n: &usize| (1..=1024).contains(n);
    text.parse().ok().filter(fits).ok_or_else(|| "must be 1 to 1024".to_owned())
}

/// Runs the command; `false` when a photo gave no maps.
pub(crate) fn run(args: &CaptureArgs) -> bool {
    let settings = Settings {
        size: args.size,
        engine: args.run.engine,
        level: args.run.level(),
        threads: 1,
        refine: !args.no_refine,
        class: args.class.as_deref().and_then(Class::from_name),
        fov_deg: args.fov,
        light_scale: args.light_scale,
    };
    let prepared = fs::create_dir_all(&args.out)
        .map_err(|e| Failure::writing(&args.out, &e))
        .and_then(|()| ModelFile::load(args.run.model.as_deref()));
    let planned = prepared.as_ref().map_err(Clone::clone).and_then(|file| {
        let model = file.parse()?;
        let (workers, settings) = workers::plan(args.run.threads(), args.photos.len(), &model, settings)?;
        Ok((model, workers, settings))
    });
    let (model, workers, settings) = match planned {
        Ok(planned) => planned,
        Err(failure) => {
            args.photos.iter().for_each(|photo| complain(&failure.at(photo)));
            return false;
        }
    };
    files::sweep(&System, &args.out);
    let mut places = Places::new(&args.out);
    let jobs: Vec<_> = places.plan(&args.photos).into_iter().map(Mutex::new).collect();
    let places = Mutex::new(places);
    let bar = progress_bar(jobs.len(), args.quiet);
    let bad = AtomicUsize::new(0);
    let printing = Mutex::new(());
    workers::run(workers, jobs.len(), &model, &settings, |engine, i| {
        let Some(job) = jobs.get(i) else { return };
        let mut place = job.lock().unwrap_or_else(PoisonError::into_inner);
        let result = match engine {
            Ok(engine) => one_photo(engine, &mut place, &places, args, &bar),
            Err(failure) => Err(failure.at(&place.photo)),
        };
        let _turn = printing.lock();
        bar.suspend(|| match result {
            Ok(material) if !args.quiet => {
                notes(&place, &material).iter().for_each(|line| complain(line));
                say(&summary(&place, &material, args));
            }
            Ok(_) => {}
            Err(failure) => {
                bad.fetch_add(1, Ordering::Relaxed);
                complain(&failure);
            }
        });
    });
    bar.finish_and_clear();
    bad.load(Ordering::Relaxed) == 0
}

fn progress_bar(photos: usize, quiet: bool) -> ProgressBar {
    if quiet {
        return ProgressBar::hidden();
    }
    // Draws on stderr, and only on a terminal.
    let bar = ProgressBar::new(photos as u64 * STEPS);
    let style = ProgressStyle::with_template("{bar:32} {percent:>3} %  {msg}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}

fn one_photo(
    engine: &mut Engine<'_>,
    place: &mut Place,
    places: &Mutex<Places>,
    args: &CaptureArgs,
    bar: &ProgressBar,
) -> Result<Material, Failure> {
    let path = place.photo.clone();
    let interrupted = || Failure::new(&path, "interrupted before its maps were ready", "run it again");
    if interrupt::asked() {
        return Err(interrupted());
    }
    bar.set_message(place.name.clone());
    let mut share = Share { bar, done: 0 };
    let before = Stamp::of(&path).ok();
    let photo = photo::read_as(&path, args.encoding.map(Into::into))?;
    let source = place.source().map_err(|e| Failure::reading(&path, &e))?.clone();
    let mut observer = |stage: Stage, fraction: f32| {
        let before = Stage::ALL.iter().position(|&s| s == stage).unwrap_or(0) as f32;
        share.reach((before + fraction.clamp(0.0, 1.0)) / Stage::ALL.len() as f32);
        interrupt::flow()
    };
    let material = engine.capture(&photo, &mut observer).map_err(|error| match error {
        Error::Cancelled => interrupted(),
        error => Failure::core(&path, &error),
    });
    drop(photo);
    let material = material?;
    if [before, Stamp::of(&path).ok()] != [source.stamp; 2] {
        return Err(Failure::new(&path, "has changed while it was read", "run it again"));
    }
    loop {
        let target = args.out.join(&place.name);
        let written =
            output::write_all(&target, &place.name, &material, engine.facts(), args.bit_depth, &source);
        match written {
            Ok(true) => return Ok(material),
            // Another process was there first.
            Ok(false) => places.lock().unwrap_or_else(PoisonError::into_inner).change(place),
            Err(_) if interrupt::asked() => return Err(interrupted()),
            Err(failure) => return Err(failure.at(&path)),
        }
    }
}

/// One photo's share of the progress bar, full when dropped.
struct Share<'a> {
    bar: &'a ProgressBar,
    done: u64,
}

impl Share<'_> {
    fn reach(&mut self, part: f32) {
        let now = (part * STEPS as f32) as u64;
        self.bar.inc(now.min(STEPS).saturating_sub(self.done));
        self.done = self.done.max(now.min(STEPS));
    }
}

impl Drop for Share<'_> {
    fn drop(&mut self) {
        self.reach(1.0);
    }
}

/// What a user should know besides the result.
fn notes(place: &Place, material: &Material) -> Vec<String> {
    let photo = one_line(&place.photo);
    let warnings = material.warnings.iter().map(|warning| format!("{photo}: warning: {warning}"));
    let elsewhere =
        place.in_the_way.iter().map(|what| format!("{photo}: {what}; this result goes elsewhere"));
    warnings.chain(elsewhere).collect()
}

fn summary(place: &Place, material: &Material, args: &CaptureArgs) -> String {
    let (photo, folder) = (place.photo.display(), args.out.join(&place.name));
    let (class, residual) = (material.class_line(), material.residual);
    format!("{photo}: {class}, residual {residual:.3} -> {}", folder.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_outside_their_range_are_refused() {
        assert_eq!(map_size("384"), Ok(384));
        for bad in ["0", "100", "-128", "4096", "x"] {
            assert!(map_size(bad).is_err(), "{bad}");
        }
        assert!(degrees("43.35").is_ok() && degrees("NaN").is_err() && degrees("180").is_err());
        assert!(thread_count("0").is_err() && bit_depth("12").is_err());
    }
}
