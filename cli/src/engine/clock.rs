//! Stage times, by the observer's calls: the core itself has no clock.
use flashmat_core::Stage;
use std::collections::BTreeMap;
use std::time::Instant;

/// Milliseconds that each stage took, in the order of [`Stage::ALL`].
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Deserialize)]
#[serde(try_from = "BTreeMap<String, f64>")]
pub(crate) struct Timings {
    pub(crate) stages: [f64; Stage::ALL.len()],
    /// The whole, with what lies between the stages.
    pub(crate) total: f64,
}

impl Timings {
    /// Each name with its milliseconds, the whole last.
    pub(crate) fn named(&self) -> impl Iterator<Item = (&'static str, f64)> {
        let stages = Stage::ALL.map(Stage::name).into_iter().zip(self.stages);
        stages.chain([("total", self.total)])
    }
}

impl TryFrom<BTreeMap<String, f64>> for Timings {
    type Error = String;

    fn try_from(named: BTreeMap<String, f64>) -> Result<Self, String> {
        let of = |name: &str| named.get(name).copied().ok_or_else(|| format!("no time of {name}"));
        let mut timings = Self { total: of("total")?, ..Self::default() };
        for (stage, spent) in Stage::ALL.into_iter().zip(&mut timings.stages) {
            *spent = of(stage.name())?;
        }
        Ok(timings)
    }
}

impl serde::Serialize for Timings {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.named())
    }
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
        let at = Stage::ALL.iter().position(|&s| s == stage);
        let Some(spent) = at.and_then(|at| self.spent.stages.get_mut(at)) else { return };
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Names in the order of the stages, each with its own time; a file that lacks one is refused.
    #[test]
    fn timings_are_written_by_name_and_read_again() {
        let stages = std::array::from_fn(|i| i as f64 + 0.5);
        let timings = Timings { stages, total: 99.0 };
        let text = serde_json::to_string(&timings).expect("written");
        assert!(text.starts_with(r#"{"frame":0.5,"global":1.5,"flash":2.5,"#), "{text}");
        assert_eq!(serde_json::from_str::<Timings>(&text).expect("read"), timings);
        assert!(serde_json::from_str::<Timings>(&text.replace("flash", "flush")).is_err());
    }
}
