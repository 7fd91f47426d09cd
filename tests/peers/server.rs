//! Runs the network when told to, for `peers.py`: one process per engine, so that engines can take turns.
//!
//! `peer MODEL SIZE PHOTO OUT ENGINE`: ENGINE is a level's name, or `float` (tract, feature `tract`); PHOTO holds planar
//! linear f32. Prints `ready GMAC PROBABILITIES...` and the maps to OUT; then for each line of standard input one run
//! (`run`: wall-clock and CPU milliseconds) or one measurement of the level's peak (`peak`: multiply-accumulates a second).
use cpu_time::ThreadTime;
use flashmat_core::base::arena::Arena;
use flashmat_core::base::exec::Inline;
use flashmat_core::base::simd::Level;
use flashmat_core::frame::LinearImage;
use flashmat_core::kernels::{Kernels, peak};
use flashmat_core::maps::MapsMut;
use flashmat_core::net::Inference;
use flashmat_core::net::{Mixing, Model, Network};
use flashmat_core::{Error, Silent};
use std::io::{BufRead, Write};
use std::time::Instant;

fn peak_rate(level: Option<Level>) -> f64 {
    const ROUNDS: u32 = 1 << 17;
    let start = ThreadTime::now();
    let done = level.and_then(|level| peak::multiply_accumulates(level, ROUNDS)).unwrap_or(0);
    done as f64 / start.elapsed().as_secs_f64()
}

#[cfg(feature = "tract")]
fn float<'m>(model: Model<'m>, size: usize) -> Result<Box<dyn Inference + 'm>, Error> {
    Ok(Box::new(flashmat_core::net::tract::FloatNetwork::new(model, size)?))
}

#[cfg(not(feature = "tract"))]
fn float<'m>(_: Model<'m>, _: usize) -> Result<Box<dyn Inference + 'm>, Error> {
    Err(Error::Float)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, size, photo, out, engine] = arguments.as_slice() else {
        return Err("usage: peer MODEL SIZE PHOTO OUT ENGINE".into());
    };
    let (bytes, size) = (std::fs::read(model)?, size.parse::<usize>()?);
    let model = Model::from_bytes(&bytes)?;
    let gmacs = model.graph().macs(size) as f64 * 1e-9;
    let level = Level::from_name(engine);
    let engine: Box<dyn Inference> = match level {
        Some(level) => Box::new(Network::new(model, size, Kernels::for_level(level)?)?),
        None => float(model, size)?,
    };
    let file = std::fs::read(photo)?;
    let rgb: Vec<f32> = file.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    let (pixels, clipped) = (size * size, vec![0; size * size]);
    let photo = LinearImage::new(size, &rgb, &clipped, 43.35);
    let mut workspace = vec![0; engine.workspace_bytes()];
    let mut planes = vec![0.0_f32; 7 * pixels];
    let mut run = |planes: &mut [f32]| {
        let (albedo, rest) = planes.split_at_mut(3 * pixels);
        let (normal, roughness) = rest.split_at_mut(3 * pixels);
        let mut maps = MapsMut { size, albedo, normal, roughness };
        engine.infer(
            &photo,
            Mixing::default(),
            &Inline,
            &mut Arena::new(&mut workspace),
            &mut maps,
            &mut Silent,
        )
    };
    let first = run(&mut planes)?;
    std::fs::write(out, planes.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>())?;
    print!("ready {gmacs}");
    first.predicted.0.iter().for_each(|p| print!(" {p}"));
    println!();
    std::io::stdout().flush()?;
    for line in std::io::stdin().lock().lines() {
        if line? == "peak" {
            println!("{}", peak_rate(level));
        } else {
            let (start, cpu) = (Instant::now(), ThreadTime::now());
            run(&mut planes)?;
            println!("{} {}", start.elapsed().as_secs_f64() * 1e3, cpu.elapsed().as_secs_f64() * 1e3);
        }
        std::io::stdout().flush()?;
    }
    Ok(())
}
