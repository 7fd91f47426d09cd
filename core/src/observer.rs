//! What a caller sees of a run while it goes on, and how it stops one.
use core::ops::ControlFlow;

/// The stages of a capture, in the order in which they run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// Photo to linear RGB at the network's size.
    Frame,
    /// Class probabilities and first maps.
    Net,
    /// Refinement of the albedo.
    CrfAlbedo,
    /// Refinement of the normals.
    CrfNormal,
    /// Light scale and per-pixel roughness search.
    Search,
    /// Refinement of the roughness.
    CrfRoughness,
}

impl Stage {
    /// All stages, in order.
    pub const ALL: [Self; 6] =
        [Self::Frame, Self::Net, Self::CrfAlbedo, Self::CrfNormal, Self::Search, Self::CrfRoughness];

    /// The name that reports use (`timings_ms` of the command line's `report.json`).
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Frame => "frame",
            Self::Net => "net",
            Self::CrfAlbedo => "crf_albedo",
            Self::CrfNormal => "crf_normal",
            Self::Search => "search",
            Self::CrfRoughness => "crf_roughness",
        }
    }
}

/// Told about progress; may stop the run.
pub trait Observer {
    /// `fraction` of `stage` is done: 0 at its start, 1 at its end, never falling within a stage.
    ///
    /// [`ControlFlow::Break`] makes the run return [`Error::Cancelled`](crate::Error::Cancelled) at its next step.
    fn progress(&mut self, stage: Stage, fraction: f32) -> ControlFlow<()>;
}

/// An observer that says nothing and never stops a run.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Observer for Silent {
    fn progress(&mut self, _stage: Stage, _fraction: f32) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}

impl<F: FnMut(Stage, f32) -> ControlFlow<()>> Observer for F {
    fn progress(&mut self, stage: Stage, fraction: f32) -> ControlFlow<()> {
        self(stage, fraction)
    }
}
