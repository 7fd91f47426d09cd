//! The one door to the core: photos in, materials out. Nothing else in this program runs the pipeline.
mod clock;
pub(crate) mod light;
mod model;
pub(crate) mod net;
pub(crate) mod rewrite;

pub(crate) use clock::Timings;
pub(crate) use model::{Loaded, ModelFile};

use crate::exposure;
use crate::failure::Failure;
use crate::material::{Material, OwnedMaps};
use crate::photo::{Photo, Pixels};
use clock::StageClock;
use flashmat_core::base::simd::Level;
use flashmat_core::capture::CaptureOptions;
use flashmat_core::frame::{Encoding, Exposure, FieldOfView, Frame};
use flashmat_core::net::Class;
use flashmat_core::{Error, Session, SessionOptions, Stage};
use std::ops::ControlFlow;
use std::path::Path;

/// How captures are to run.
#[derive(Clone, Debug)]
pub(crate) struct Settings {
    pub(crate) size: usize,
    pub(crate) engine: EngineKind,
    /// CPU level; none: the fastest.
    pub(crate) level: Option<Level>,
    /// Threads of one engine.
    pub(crate) threads: usize,
    pub(crate) refine: bool,
    /// The class that the user insists on.
    pub(crate) class: Option<Class>,
    /// The user's word on the angle of view over the photo's shorter side, in degrees.
    pub(crate) fov_deg: Option<f32>,
    /// The user's word on the light's scale in the photo.
    pub(crate) light_scale: Option<f32>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            size: 256,
            engine: EngineKind::default(),
            level: None,
            threads: 1,
            refine: true,
            class: None,
            fov_deg: None,
            light_scale: None,
        }
    }
}

/// The arithmetic of the network.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum EngineKind {
    /// 8-bit integers, as on the phone.
    #[default]
    Int8,
    /// 32-bit floats, for comparison.
    Float,
}

impl EngineKind {
    /// The name that the command line and reports use.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Int8 => "int8",
            Self::Float => "float",
        }
    }
}

/// What reports say about the engine.
#[derive(Clone, Debug)]
pub(crate) struct Facts {
    pub(crate) model_name: String,
    /// SHA-256 of the model file.
    pub(crate) model_hash: String,
    pub(crate) engine: &'static str,
    pub(crate) level: &'static str,
}

/// One session: a model and its workspace.
pub(crate) struct Engine<'m> {
    session: Session<'m>,
    settings: Settings,
    facts: Facts,
}

impl<'m> Engine<'m> {
    /// Takes all memory that captures need.
    pub(crate) fn new(model: &Loaded<'m>, settings: &Settings) -> Result<Self, Failure> {
        let options =
            SessionOptions { size: settings.size, level: settings.level, threads: settings.threads };
        let session = match settings.engine {
            EngineKind::Int8 => Session::new(model.model.clone(), &options),
            EngineKind::Float => float_session(model, &options)?,
        };
        let session = session.map_err(|e| refusal(&e, model))?;
        let facts = Facts {
            model_name: model.name.clone(),
            model_hash: model.hash.clone(),
            engine: settings.engine.name(),
            level: session.level().name(),
        };
        Ok(Self { session, settings: settings.clone(), facts })
    }

    pub(crate) fn facts(&self) -> &Facts {
        &self.facts
    }

    /// Bytes that the engine keeps.
    pub(crate) fn workspace_bytes(&self) -> usize {
        self.session.workspace_bytes()
    }

    /// One photo through the pipeline.
    pub(crate) fn capture(
        &mut self,
        photo: &Photo,
        observer: &mut dyn FnMut(Stage, f32) -> ControlFlow<()>,
    ) -> Result<Material, Error> {
        let settings = &self.settings;
        let fov = field_of_view(photo, settings);
        let options = CaptureOptions {
            fov,
            class: settings.class,
            light_scale: settings.light_scale,
            refine: settings.refine,
            ..CaptureOptions::default()
        };
        let workspace_bytes = self.session.workspace_bytes();
        let mut clock = StageClock::new();
        let frame = photo.frame(photo.encoding)?;
        let mut warnings = photo.warnings.clone();
        let side = frame.crop(&fov)?.side;
        if side < settings.size as f64 {
            warnings.push(format!("only {side:.0} pixels of the photo span the maps: they are interpolated"));
        }
        let mut watch = |stage, fraction| {
            clock.note(stage, fraction);
            observer(stage, fraction)
        };
        let capture = self.session.capture(&frame, &options, &mut watch)?;
        let timings_ms = clock.finish();
        warnings.extend(exposure_warning(&capture.photo.exposure));
        warnings.extend(exposure::dark_warning(capture.photo.rgb));
        Ok(Material {
            maps: OwnedMaps {
                size: capture.maps.size,
                albedo: capture.maps.albedo.to_vec(),
                normal: capture.maps.normal.to_vec(),
                roughness: capture.maps.roughness.to_vec(),
            },
            photo: capture.photo.rgb.to_vec(),
            render: capture.render.to_vec(),
            fov_deg: capture.photo.fov_deg,
            class: capture.class,
            class_given: settings.class.is_some(),
            probabilities: capture.probabilities.0,
            f0: capture.f0,
            light_scale: capture.light_scale,
            flash: capture.photo.flash,
            room_light: capture.room_light,
            residual: capture.residual,
            timings_ms,
            workspace_bytes,
            warnings,
        })
    }
}

/// Why no engine could be made, by the option that would mend it.
fn refusal(error: &Error, model: &Loaded<'_>) -> Failure {
    let (option, help) = match error {
        Error::LevelUnsupported { .. } => ("--level", "use --level auto"),
        Error::NetworkSize { .. } => ("--size", "choose another --size"),
        Error::Float => {
            let what = "is no model that the float engine can run";
            return Failure::new(&model.path, what, "use --engine int8");
        }
        Error::Threads => ("--threads", "use fewer --threads"),
        Error::WorkspaceTooSmall { needed, .. } => {
            let what = format!("{} MiB of memory cannot be had", needed >> 20);
            return Failure::new(Path::new("--size"), what, "choose a smaller --size or fewer --threads");
        }
        _ => return Failure::core(&model.path, error),
    };
    Failure::new(Path::new(option), error.to_string(), help)
}

#[cfg(feature = "float")]
fn float_session<'m>(
    model: &Loaded<'m>,
    options: &SessionOptions,
) -> Result<Result<Session<'m>, Error>, Failure> {
    Ok(Session::float(model.model.clone(), options))
}

#[cfg(not(feature = "float"))]
fn float_session<'m>(
    model: &Loaded<'m>,
    _options: &SessionOptions,
) -> Result<Result<Session<'m>, Error>, Failure> {
    let what = "cannot run: this build has no float engine";
    Err(Failure::new(&model.path, what, "use --engine int8, or build with `--features float`"))
}

/// A word on a photo of which so much is overexposed that the maps suffer.
fn exposure_warning(exposure: &Exposure) -> Option<String> {
    let share = 100.0 * exposure.clipped_share();
    let text = format!("{share:.0} % of the photo's pixels are overexposed: take it with less exposure");
    exposure.is_overexposed().then_some(text)
}

impl Photo {
    /// The pixels as a frame of the core.
    pub(crate) fn frame(&self, encoding: Encoding) -> Result<Frame<'_>, Error> {
        let (width, height) = (self.width as usize, self.height as usize);
        let frame = match &self.pixels {
            Pixels::Rgb8(p) => Frame::rgb8(p, width, height, 3 * width),
            Pixels::Rgb16(p) => Frame::rgb16(p, width, height, 3 * width),
            Pixels::RgbF32(p) => Frame::rgb_f32(p, width, height, 3 * width),
        };
        Ok(frame?.encoded(encoding).rotated(self.rotation))
    }
}

fn field_of_view(photo: &Photo, settings: &Settings) -> FieldOfView {
    match (settings.fov_deg, photo.focal_35mm) {
        (Some(degrees), _) => FieldOfView::shorter_side(degrees),
        (None, Some(mm)) => FieldOfView::focal_35mm(mm),
        (None, None) => FieldOfView::default(),
    }
}

/// Names of the levels that this CPU has, slowest first.
pub(crate) fn levels() -> Vec<Level> {
    let fastest = Level::detect();
    Level::ALL.into_iter().filter(|&level| fastest.lowered_to(level).is_ok()).collect()
}
