//! The network alone, for benches: one run after the other over a made-up photo.
use flashmat_core::base::arena::Arena;
use flashmat_core::base::exec::{Executor, Inline, Pool};
use flashmat_core::base::simd::Level;
use flashmat_core::frame::LinearImage;
use flashmat_core::kernels::{Kernels, peak};
use flashmat_core::maps::MapsMut;
use flashmat_core::net::{Mixing, Model, Network};
use flashmat_core::{Error, Silent};
use std::time::Instant;

/// What the runs of one network say.
pub(crate) struct NetTimes {
    /// Milliseconds of the run in the middle.
    pub(crate) median: f64,
    /// Of the fastest run: other programs on the machine can only slow a run down.
    pub(crate) best: f64,
    /// Bytes of workspace.
    pub(crate) workspace: usize,
}

/// Times `runs` runs after one that warms up.
pub(crate) fn time(
    model: &Model<'_>,
    size: usize,
    level: Level,
    threads: usize,
    runs: usize,
) -> Result<NetTimes, Error> {
    let network = Network::new(model.clone(), size, Kernels::for_level(level)?)?;
    let exec: Box<dyn Executor> = if threads == 1 { Box::new(Inline) } else { Box::new(Pool::new(threads)?) };
    let pixels = size * size;
    let rgb: Vec<f32> = (0..3 * pixels).map(|i| 0.1 + ((i * 7919) % 1009) as f32 / 1500.0).collect();
    let clipped = vec![0; pixels];
    let photo = LinearImage::new(size, &rgb, &clipped, 43.35);
    let (mut albedo, mut normal, mut roughness) =
        (vec![0.0; 3 * pixels], vec![0.0; 3 * pixels], vec![0.0; pixels]);
    let mut workspace = vec![0; network.workspace_bytes()];
    let mut times = Vec::with_capacity(runs + 1);
    for _ in 0..=runs {
        let mut maps = MapsMut { size, albedo: &mut albedo, normal: &mut normal, roughness: &mut roughness };
        let start = Instant::now();
        network.run(
            &photo,
            Mixing::default(),
            &*exec,
            &mut Arena::new(&mut workspace),
            &mut maps,
            &mut Silent,
        )?;
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    let mut times = times.split_off(1);
    times.sort_by(f64::total_cmp);
    let at = |index: usize| times.get(index).copied().unwrap_or(0.0);
    Ok(NetTimes { median: at(times.len() / 2), best: at(0), workspace: workspace.len() })
}

/// The level's peak on one core, multiply-accumulates a second: the best of a few short tries.
pub(crate) fn peak_rate(level: Level) -> Option<f64> {
    const ROUNDS: u32 = 1 << 17;
    let rates = (0..20).map(|_| {
        let start = Instant::now();
        let done = peak::multiply_accumulates(level, ROUNDS)?;
        Some(done as f64 / start.elapsed().as_secs_f64())
    });
    rates.collect::<Option<Vec<f64>>>()?.into_iter().max_by(f64::total_cmp)
}
