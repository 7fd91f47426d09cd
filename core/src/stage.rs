//! The stages of a capture by name, and what a caller sees of a run while it goes on.
use core::ops::ControlFlow;

/// The stages of a capture, in the order in which they run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// Photo to linear RGB at the maps' size; its exposure is checked.
    Frame,
    /// The network: class probabilities and first maps.
    Global,
    /// Where the flash is beside the camera.
    Flash,
    /// Albedo below highlights, filled in from around them.
    Highlight,
    /// Refinement of the albedo.
    Albedo,
    /// Texture of the albedo that a highlight burnt out.
    Texture,
    /// Refinement of the normals.
    Normal,
    /// Light scale and per-pixel roughness search.
    Search,
    /// Refinement of the roughness.
    Roughness,
    /// Roughness below highlights, filled in from around them.
    Level,
    /// Re-render, lights and residual.
    Relight,
}

impl Stage {
    /// All stages, in order.
    pub const ALL: [Self; 11] = [
        Self::Frame,
        Self::Global,
        Self::Flash,
        Self::Highlight,
        Self::Albedo,
        Self::Texture,
        Self::Normal,
        Self::Search,
        Self::Roughness,
        Self::Level,
        Self::Relight,
    ];

    /// The name that reports use (`timings_ms` of the command line's `report.json`).
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Frame => "frame",
            Self::Global => "global",
            Self::Flash => "flash",
            Self::Highlight => "highlight",
            Self::Albedo => "albedo",
            Self::Texture => "texture",
            Self::Normal => "normal",
            Self::Search => "search",
            Self::Roughness => "roughness",
            Self::Level => "level",
            Self::Relight => "relight",
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
