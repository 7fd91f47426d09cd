//! What an app waits for besides the capture itself: `cargo bench -p flashmat-tests --bench gaps`. The phone model, one
//! thread, the fastest level; CPU time of the thread, the least of three runs.
//!
//! Gaps: the longest time between two calls of the observer, which is how long a cancel can wait. Codes: the six results as
//! bytes, against copying them as floats.
use cpu_time::ThreadTime;
use flashmat_core::base::exec::Inline;
use flashmat_core::capture::{Capture, CaptureOptions, Pipeline};
use flashmat_core::frame::Frame;
use flashmat_core::kernels::Kernels;
use flashmat_core::maps::{Coding, encode};
use flashmat_core::net::Model;
use flashmat_core::{Error, Stage};
use std::hint::black_box;
use std::ops::ControlFlow;
use std::time::Duration;

const SIDE: usize = 3024;
const RUNS: usize = 3;

fn main() -> Result<(), Error> {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/phone.fmat");
    let file = std::fs::read(file).expect("the model");
    let pixels: Vec<u8> = (0..3 * SIDE * SIDE)
        .map(|i| {
            let (x, y) = (i / 3 % SIDE, i / 3 / SIDE);
            (60 + (x / 40 + y / 56) % 3 * 40 + (i * 7919 % 23)) as u8
        })
        .collect();
    let frame = Frame::rgb8(&pixels, SIDE, SIDE, 3 * SIDE)?;
    for size in [256, 1024] {
        let kernels = Kernels::supported().last().expect("a level");
        let pipeline = Pipeline::new(Model::from_bytes(&file)?, size, kernels)?;
        let mut work = vec![0; pipeline.workspace_bytes()];
        // Gaps by their number, the least of the runs each: an interruption hits one run.
        let mut gaps: Vec<(Duration, Stage, f32)> = Vec::new();
        let (mut whole, mut codes, mut copies) = (Duration::MAX, Duration::MAX, Duration::MAX);
        for _ in 0..RUNS {
            let start = ThreadTime::now();
            let (mut last, mut at) = (ThreadTime::now(), 0);
            let mut watch = |stage: Stage, fraction: f32| {
                let gap = last.elapsed();
                match gaps.get_mut(at) {
                    Some((least, ..)) => *least = gap.min(*least),
                    None => gaps.push((gap, stage, fraction)),
                }
                at += 1;
                last = ThreadTime::now();
                ControlFlow::Continue(())
            };
            let capture = pipeline.run(&frame, &CaptureOptions::default(), &Inline, &mut work, &mut watch)?;
            whole = whole.min(start.elapsed());
            codes = codes.min(coded(&capture)?);
            copies = copies.min(copied(&capture));
        }
        gaps.sort_by_key(|gap| std::cmp::Reverse(gap.0));
        println!(
            "{size}: capture {whole:.1?}; {} calls of the observer; as bytes {codes:.2?}, as floats {copies:.2?}",
            gaps.len()
        );
        for (gap, stage, fraction) in gaps.iter().take(8) {
            println!("    {gap:.2?} before {} {fraction:.3}", stage.name());
        }
    }
    Ok(())
}

/// The six results.
fn results<'a>(capture: &'a Capture<'_>) -> [(&'a [f32], Coding); 6] {
    let maps = &capture.maps;
    [
        (maps.albedo, Coding::Srgb),
        (maps.normal, Coding::Signed),
        (maps.roughness, Coding::Linear),
        (capture.render, Coding::Srgb),
        (capture.photo.rgb, Coding::Srgb),
        (capture.observability, Coding::Linear),
    ]
}

fn coded(capture: &Capture<'_>) -> Result<Duration, Error> {
    let mut buffers = results(capture).map(|(planes, _)| vec![0_u8; planes.len()]);
    let start = ThreadTime::now();
    for (out, (planes, coding)) in buffers.iter_mut().zip(results(capture)) {
        encode(planes, capture.maps.size, coding, &Inline, out)?;
        black_box(&out[0]);
    }
    Ok(start.elapsed())
}

fn copied(capture: &Capture<'_>) -> Duration {
    let mut buffers = results(capture).map(|(planes, _)| vec![0_f32; planes.len()]);
    let start = ThreadTime::now();
    for (out, (planes, _)) in buffers.iter_mut().zip(results(capture)) {
        out.copy_from_slice(planes);
        black_box(&out[0]);
    }
    start.elapsed()
}
