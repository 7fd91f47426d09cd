//! Stage times, by the observer's calls: the core itself has no clock.
use flashmat_core::Stage;
use std::time::Instant;

/// Milliseconds that each stage took.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Timings {
    pub(crate) frame: f64,
    pub(crate) net: f64,
    pub(crate) crf_albedo: f64,
    pub(crate) crf_normal: f64,
    pub(crate) search: f64,
    pub(crate) crf_roughness: f64,
    /// The whole, with what lies between the stages.
    pub(crate) total: f64,
}

/// Runs from its making on.
pub(super) struct StageClock {
    start: Instant,
    current: Option<(Stage, Instant)>,
    spent: Timings,
}

impl StageClock {
    pub(super) fn new() -> Self {
        Self { start: Instant::now(), current: None, spent: Timings::default() }
    }

    /// `stage` goes on now, or ends with `fraction` 1.
    pub(super) fn note(&mut self, stage: Stage, fraction: f32) {
        if self.current.is_none_or(|(current, _)| current != stage) {
            self.close();
            self.current = Some((stage, Instant::now()));
        }
        if fraction >= 1.0 {
            self.close();
        }
    }

    fn close(&mut self) {
        let Some((stage, since)) = self.current.take() else { return };
        let spent = match stage {
            Stage::Frame => &mut self.spent.frame,
            Stage::Net => &mut self.spent.net,
            Stage::CrfAlbedo => &mut self.spent.crf_albedo,
            Stage::CrfNormal => &mut self.spent.crf_normal,
            Stage::Search => &mut self.spent.search,
            Stage::CrfRoughness => &mut self.spent.crf_roughness,
        };
        *spent += milliseconds(since);
    }

    /// The times up to now.
    pub(super) fn finish(mut self) -> Timings {
        self.close();
        self.spent.total = milliseconds(self.start);
        self.spent
    }
}

/// Whole microseconds since `since`, in milliseconds.
fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_micros() as f64 / 1000.0
}
