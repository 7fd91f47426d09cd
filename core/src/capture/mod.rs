//! A capture: the stages of [`Stage::ALL`] in their order. [`run`] has a line for each, and `chain` a method.
//!
//! Everything lies in the caller's workspace, whose size [`Pipeline::workspace_bytes`] tells before the run; a run allocates nothing and does
//! not panic, and its bits depend on neither level nor threads.
mod chain;
mod reduced;

use crate::base::arena::{Arena, bytes_for};
use crate::base::exec::{At, Executor, within};
use crate::base::simd::Simd;
use crate::crf::{self, Albedo, Normal, Roughness};
use crate::frame::{self, FieldOfView, Frame, LinearImage};
use crate::highlight;
use crate::kernels::Kernels;
use crate::maps::Maps;
use crate::net::scales::Scales;
use crate::net::{Class, ClassProbabilities, Inference, Model, Network};
use crate::search;
use crate::{Error, Observer, Stage};
use chain::Chain;
use core::ops::ControlFlow;

/// What a caller may choose for one capture.
#[derive(Clone, Copy, Debug)]
pub struct CaptureOptions {
    /// The photo's field of view, if known, and the one to crop to.
    pub fov: FieldOfView,
    /// The class the caller insists on; the classifier decides otherwise.
    pub class: Option<Class>,
    /// Linear value that a flat white surface at the centre has at this exposure under the flash alone, if known, 0.001 to
    /// 1000. Without it the albedo's brightness is the network's guess: an exposure that the camera chose hides it.
    pub light_scale: Option<f32>,
    /// Whether the CRFs refine the network's maps.
    pub refine: bool,
    /// When the CRFs' solver stops.
    pub solver: crf::Options,
}

impl Default for CaptureOptions {
    fn default() -> Self {
        Self {
            fov: FieldOfView::default(),
            class: None,
            light_scale: None,
            refine: true,
            solver: crf::Options::default(),
        }
    }
}

/// What the CRFs did, in order albedo, normal, roughness; zeros where nothing was refined.
pub type SolverReports = [crf::Report; 3];

/// A capture: all slices lie in the workspace.
#[derive(Clone, Copy, Debug)]
pub struct Capture<'a> {
    /// The material.
    pub maps: Maps<'a>,
    /// The photo as the pipeline saw it: square, upright, linear.
    pub photo: LinearImage<'a>,
    /// The maps re-rendered under the estimated flash and room: 3 planes, linear, as bright as the photo.
    pub render: &'a [f32],
    /// How much the photo says about the roughness at each pixel, one plane in [0,1]; zeros without refinement.
    pub observability: &'a [f32],
    /// The class: the caller's, or the most probable one.
    pub class: Class,
    /// What the classifier believes (also when the caller insisted on a class).
    pub probabilities: ClassProbabilities,
    /// Specular reflectance at normal incidence that the re-render used (paper: 0.05, metal 0.5).
    pub f0: f32,
    /// The photo's exposure times the flash's strength: the re-render with light strength 1 is multiplied by it.
    pub light_scale: f32,
    /// Even light that the re-render adds to the flash's, as a share of the flash's at the centre, [0,1]
    /// ([`search::Lights`]): fitted, no measurement of the room.
    pub room_light: f32,
    /// RMSE of re-render against the photo, gamma 2.2, clipped values left out.
    pub residual: f32,
    /// What the CRFs' solvers did.
    pub solver: SolverReports,
}

/// The int8 network at one size, with the stages around it.
#[derive(Clone, Debug)]
pub struct Pipeline<'m> {
    network: Scales<Network<'m>>,
    simd: Simd,
}

impl<'m> Pipeline<'m> {
    /// Plans `model` for maps of `size` x `size` on `kernels`.
    ///
    /// # Errors
    /// As [`Network::new`].
    pub fn new(model: Model<'m>, size: usize, kernels: &'static Kernels) -> Result<Self, Error> {
        let simd = Simd::for_level(kernels.level())?;
        Scales::new(&model, size, |size| Network::new(model.clone(), size, kernels))
            .map(|network| Self { network, simd })
    }

    /// Bytes of workspace that [`Pipeline::run`] needs.
    #[must_use]
    pub fn workspace_bytes(&self) -> usize {
        workspace_bytes(&self.network)
    }

    /// One photo through all stages; float loops use the vector registers of the kernels' level.
    ///
    /// # Errors
    /// As [`run`].
    pub fn run<'a>(
        &self,
        frame: &Frame<'_>,
        options: &CaptureOptions,
        exec: &dyn Executor,
        workspace: &'a mut [u8],
        observer: &mut dyn Observer,
    ) -> Result<Capture<'a>, Error> {
        run(&self.network, frame, options, &At::new(exec, self.simd), workspace, observer)
    }
}

/// Known light scales that a capture takes.
const LIGHT_SCALES: core::ops::RangeInclusive<f32> = 1e-3..=1e3;

/// Bytes of workspace that [`run`] needs with `engine`.
#[must_use]
pub fn workspace_bytes(engine: &dyn Inference) -> usize {
    let size = engine.size();
    let plane = bytes_for::<f32>(size.saturating_mul(size));
    // What lies there when a stage runs, in planes beside the photo's, and what the stage itself takes: the first maps
    // are 7 planes, refined albedo and normals 3 each, the search's roughness and observability 1 each, the refined
    // roughness 1, a render 3.
    let stages = [
        (7, engine.workspace_bytes()),
        (7, search::flash_position_bytes(size)),
        (7, highlight::workspace_bytes(size)),
        (7 + 3, reduced::workspace_bytes::<Albedo<'_>, 5>(size, 6)),
        (7 + 3, highlight::retexture_bytes(size)),
        (7 + 6, reduced::workspace_bytes::<Normal<'_>, 3>(size, 6)),
        (7 + 6 + 2, plane.saturating_mul(3)),
        (7 + 6 + 3, reduced::workspace_bytes::<Roughness<'_>, 4>(size, 9)),
        (7 + 6 + 3, highlight::level_roughness_bytes(size)),
        (7 + 6 + 3, plane.saturating_mul(3)),
    ];
    let needed = stages.map(|(planes, more)| plane.saturating_mul(planes).saturating_add(more));
    frame::prepare_bytes(size)
        .saturating_add(needed.into_iter().max().unwrap_or(0))
        .saturating_add(crate::base::arena::ALIGN)
}

/// One photo through all stages, its first maps from `inference`; the capture lies in `workspace`.
///
/// # Errors
/// [`Error::Cancelled`] when the observer says so, [`Error::LightScale`], [`Error::WorkspaceTooSmall`],
/// [`Error::NoUsablePixels`] when the photo is clipped all over in every channel, [`Error::PhotoBlack`], and what the
/// stages say of wrong sizes.
pub fn run<'a>(
    inference: &dyn Inference,
    frame: &Frame<'_>,
    options: &CaptureOptions,
    exec: &dyn Executor,
    workspace: &'a mut [u8],
    observer: &mut dyn Observer,
) -> Result<Capture<'a>, Error> {
    if options.light_scale.is_some_and(|scale| !LIGHT_SCALES.contains(&scale)) {
        return Err(Error::LightScale);
    }
    let (size, arena) = (inference.size(), &mut Arena::new(workspace));
    let mut chain = stage(Stage::Frame, observer, exec, || Chain::frame(frame, size, options, exec, arena))?;
    staged(Stage::Global, observer, |steps| chain.global(inference, exec, arena, steps.observer))?;
    stage(Stage::Flash, observer, exec, || chain.flash(exec, arena))?;
    stage(Stage::Highlight, observer, exec, || chain.highlight(exec, arena))?;
    staged(Stage::Albedo, observer, |steps| chain.albedo(exec, arena, steps))?;
    stage(Stage::Texture, observer, exec, || chain.texture(exec, arena))?;
    staged(Stage::Normal, observer, |steps| chain.normal(exec, arena, steps))?;
    staged(Stage::Search, observer, |steps| chain.search(exec, arena, steps))?;
    staged(Stage::Roughness, observer, |steps| chain.roughness(exec, arena, steps))?;
    stage(Stage::Level, observer, exec, || chain.level(exec, arena))?;
    staged(Stage::Relight, observer, |steps| chain.relight(exec, arena, steps))?;
    Ok(chain.capture())
}

/// Runs a stage that is one step: many joins, and nothing told on its way.
fn stage<T: Send>(
    stage: Stage,
    observer: &mut dyn Observer,
    exec: &dyn Executor,
    work: impl FnOnce() -> Result<T, Error> + Send,
) -> Result<T, Error> {
    staged(stage, observer, |_| within(exec, work))
}

/// Runs one stage between its two progress calls.
fn staged<T>(
    stage: Stage,
    observer: &mut dyn Observer,
    work: impl FnOnce(&mut Steps<'_>) -> Result<T, Error>,
) -> Result<T, Error> {
    let mut steps = Steps { observer, stage };
    steps.at(0.0)?;
    let result = work(&mut steps)?;
    steps.at(1.0)?;
    Ok(result)
}

/// Tells the observer, within one stage, what is done of it; asks it, on the thread that runs the capture, whether to
/// go on. No step takes longer than some hundredths of a second at 1024² on one core.
struct Steps<'o> {
    observer: &'o mut dyn Observer,
    stage: Stage,
}

impl Steps<'_> {
    /// `fraction` of the stage is done.
    ///
    /// # Errors
    /// [`Error::Cancelled`].
    fn at(&mut self, fraction: f32) -> Result<(), Error> {
        if self.observer.progress(self.stage, fraction).is_break() { Err(Error::Cancelled) } else { Ok(()) }
    }

    /// The progress of the stage's last part, which begins when `done` of it is done.
    fn rest(&mut self, done: f32) -> impl FnMut(f32) -> ControlFlow<()> {
        move |part| self.observer.progress(self.stage, done + (1.0 - done) * part)
    }
}
