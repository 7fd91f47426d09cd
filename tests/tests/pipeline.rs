//! The whole chain on the toy model: same bits at every level and thread count, nothing allocated, nothing refused
//! that should run, nothing accepted that should not.
use flashmat_core::base::exec::{Inline, Pool};
use flashmat_core::capture::{Capture, CaptureOptions, Pipeline};
use flashmat_core::frame::Frame;
use flashmat_core::kernels::Kernels;
use flashmat_core::net::{Class, Model};
use flashmat_core::{Error, Silent, Stage};
use flashmat_tests::golden::{TOY_MODEL, TOY_SIZE};
use std::ops::ControlFlow;

const SIDE: usize = 200;

/// A tiled surface under a flash, 8-bit sRGB; not burnt out.
fn photo() -> Vec<u8> {
    let value = |i: usize| {
        let (c, x, y) = (i % 3, i / 3 % SIDE, i / 3 / SIDE);
        let (u, v) = (x as f32 / SIDE as f32 - 0.5, y as f32 / SIDE as f32 - 0.5);
        let tile = if (x / 25 + y / 25) % 2 == 0 { 1.0 } else { 0.6 };
        (220.0 * tile * (-2.0 * (u * u + v * v)).exp() * [1.0, 0.8, 0.6][c]) as u8
    };
    (0..3 * SIDE * SIDE).map(value).collect()
}

fn bits(capture: &Capture<'_>) -> Vec<u32> {
    let maps = capture.maps;
    let planes = [maps.albedo, maps.normal, maps.roughness, capture.render, capture.observability];
    let lights = [capture.light_scale, capture.room_light, capture.residual];
    let scalars = lights.into_iter().chain(capture.photo.flash.to_array());
    planes.into_iter().flatten().copied().chain(scalars).map(f32::to_bits).collect()
}

fn pipeline(kernels: &'static Kernels) -> Pipeline<'static> {
    Pipeline::new(Model::from_bytes(TOY_MODEL).expect("the toy model"), TOY_SIZE, kernels).expect("a plan")
}

#[test]
fn every_level_and_thread_count_gives_the_same_bits() {
    let data = photo();
    let frame = Frame::rgb8(&data, SIDE, SIDE, 3 * SIDE).expect("a frame");
    let mut first: Option<Vec<u32>> = None;
    for kernels in Kernels::supported() {
        let pipeline = pipeline(kernels);
        for threads in [1, 2, 3, 8] {
            // Other noise in the workspace each time: a run must not depend on what was there.
            let mut work = vec![(17 * threads) as u8; pipeline.workspace_bytes()];
            let pool = Pool::new(threads).expect("threads");
            let capture = pipeline
                .run(&frame, &CaptureOptions::default(), &pool, &mut work, &mut Silent)
                .expect("a capture");
            println!("{} with {threads} threads", kernels.level().name());
            let bits = bits(&capture);
            match &first {
                None => first = Some(bits),
                Some(first) => assert!(*first == bits, "{} with {threads} threads", kernels.level().name()),
            }
        }
    }
}

#[test]
fn maps_are_where_maps_live_with_and_without_refinement() {
    let data = photo();
    let frame = Frame::rgb8(&data, SIDE, SIDE, 3 * SIDE).expect("a frame");
    let pipeline = pipeline(Kernels::scalar());
    let mut work = vec![0; pipeline.workspace_bytes()];
    for refine in [false, true] {
        for class in [None, Some(Class::Metal)] {
            let options = CaptureOptions { refine, class, ..CaptureOptions::default() };
            let capture = pipeline.run(&frame, &options, &Inline, &mut work, &mut Silent).expect("a capture");
            let maps = capture.maps;
            assert!(maps.albedo.iter().chain(maps.roughness).all(|v| (0.0..=1.0).contains(v)));
            let plane = TOY_SIZE * TOY_SIZE;
            for i in 0..plane {
                let n = [0, 1, 2].map(|c| maps.normal[c * plane + i]);
                assert!((n.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-4 && n[2] > 0.0, "{n:?}");
            }
            assert!(capture.light_scale > 0.0 && capture.residual.is_finite());
            assert!((capture.probabilities.0.iter().sum::<f32>() - 1.0).abs() < 1e-5);
            if let Some(class) = class {
                assert_eq!(capture.class, class);
                assert_eq!(capture.f0, 0.5);
            }
            let solved = capture.solver.map(|report| report.iterations > 0);
            assert!(refine || solved == [false; 3], "{solved:?}");
        }
    }
}

#[test]
fn the_observer_sees_every_stage_in_order_and_can_stop_each() {
    let data = photo();
    let frame = Frame::rgb8(&data, SIDE, SIDE, 3 * SIDE).expect("a frame");
    let pipeline = pipeline(Kernels::scalar());
    let mut work = vec![0; pipeline.workspace_bytes()];
    let mut seen = Vec::new();
    let mut watch = |stage: Stage, fraction: f32| {
        assert!((0.0..=1.0).contains(&fraction));
        if seen.last() != Some(&stage) {
            seen.push(stage);
        }
        ControlFlow::Continue(())
    };
    pipeline.run(&frame, &CaptureOptions::default(), &Inline, &mut work, &mut watch).expect("a capture");
    assert_eq!(seen, Stage::ALL);
    for stop in Stage::ALL {
        let mut watch = |stage: Stage, _: f32| {
            if stage == stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let stopped = pipeline.run(&frame, &CaptureOptions::default(), &Inline, &mut work, &mut watch);
        assert_eq!(stopped.err(), Some(Error::Cancelled), "{}", stop.name());
    }
}

/// Between two calls nothing large is done, so that a cancel does not wait: the CRFs tell of every step of their solvers.
#[test]
fn a_run_can_be_stopped_at_every_gap_of_its_progress() {
    let data = photo();
    let frame = Frame::rgb8(&data, SIDE, SIDE, 3 * SIDE).expect("a frame");
    let pipeline = pipeline(Kernels::scalar());
    let mut work = vec![0; pipeline.workspace_bytes()];
    let mut calls: Vec<(Stage, f32)> = Vec::new();
    let mut watch = |stage: Stage, fraction: f32| {
        if let Some((last, before)) = calls.last() {
            assert!(
                stage > *last || stage == *last && fraction >= *before,
                "{stage:?} {fraction} after {before}"
            );
        }
        calls.push((stage, fraction));
        ControlFlow::Continue(())
    };
    let capture = pipeline.run(&frame, &CaptureOptions::default(), &Inline, &mut work, &mut watch);
    let steps = capture.expect("a capture").solver.map(|report| report.iterations);
    for (stage, steps) in [Stage::Albedo, Stage::Normal, Stage::Roughness].into_iter().zip(steps) {
        let told = calls.iter().filter(|(at, _)| *at == stage).count();
        assert!(steps > 0 && told >= steps + 2, "{}: {told} calls in {steps} steps", stage.name());
    }
    assert_eq!(calls.last(), Some(&(Stage::Relight, 1.0)));
    for (stop, call) in calls.iter().enumerate() {
        let mut seen = 0;
        let mut watch = |_: Stage, _: f32| {
            seen += 1;
            if seen > stop { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        };
        let stopped = pipeline.run(&frame, &CaptureOptions::default(), &Inline, &mut work, &mut watch);
        assert_eq!((stopped.err(), seen), (Some(Error::Cancelled), stop + 1), "{call:?}");
    }
}

/// Half white beside half black, a channel burnt out all over, glitter on two of three pixels: each still shows something.
#[test]
fn photos_with_anything_left_are_taken_and_say_what_is_overexposed() {
    let pipeline = pipeline(Kernels::scalar());
    let mut work = vec![0; pipeline.workspace_bytes()];
    let half = |i: usize, _: u8| if i / 3 % SIDE < SIDE / 2 { 0 } else { 255 };
    let red = |i: usize, value: u8| if i.is_multiple_of(3) { 255 } else { value };
    let glitter = |i: usize, value: u8| if (i / 3 * 7 + i / 300) % 3 < 2 { 255 } else { value };
    let changed = |change: &dyn Fn(usize, u8) -> u8| -> Vec<u8> {
        photo().into_iter().enumerate().map(|(i, value)| change(i, value)).collect()
    };
    let cases = [
        (changed(&half), [0.5; 3], 0.01),
        (changed(&red), [1.0, 0.0, 0.0], 0.01),
        (changed(&glitter), [0.667; 3], 0.02),
    ];
    for (data, shares, within) in cases {
        let frame = Frame::rgb8(&data, SIDE, SIDE, 3 * SIDE).expect("a frame");
        let run = pipeline.run(&frame, &CaptureOptions::default(), &Inline, &mut work, &mut Silent);
        let exposure = run.expect("a capture").photo.exposure;
        let near = exposure.clipped.iter().zip(shares).all(|(got, share)| (got - share).abs() < within);
        assert!(near && exposure.is_overexposed(), "{exposure:?}, {shares:?}");
    }
}

#[test]
fn a_workspace_one_byte_short_is_refused_and_the_stated_one_is_enough_at_any_address() {
    let data = photo();
    let frame = Frame::rgb8(&data, SIDE, SIDE, 3 * SIDE).expect("a frame");
    let pipeline = pipeline(Kernels::scalar());
    let needed = pipeline.workspace_bytes();
    let mut work = vec![0; needed + 64];
    for start in [0, 1, 3, 31, 63] {
        let part = &mut work[start..start + needed];
        pipeline
            .run(&frame, &CaptureOptions::default(), &Inline, part, &mut Silent)
            .expect("enough at any address");
    }
    for bytes in [0, 1, 1000, needed / 2] {
        let run = pipeline.run(&frame, &CaptureOptions::default(), &Inline, &mut work[..bytes], &mut Silent);
        assert!(matches!(run, Err(Error::WorkspaceTooSmall { .. })), "{bytes}");
    }
}

#[test]
fn black_and_burnt_out_photos_are_refused_with_their_reason() {
    let pipeline = pipeline(Kernels::scalar());
    let mut work = vec![0; pipeline.workspace_bytes()];
    for (value, error) in [(0_u8, Error::PhotoBlack), (255, Error::NoUsablePixels)] {
        let data = vec![value; 3 * SIDE * SIDE];
        let frame = Frame::rgb8(&data, SIDE, SIDE, 3 * SIDE).expect("a frame");
        let run = pipeline.run(&frame, &CaptureOptions::default(), &Inline, &mut work, &mut Silent);
        assert_eq!(run.err(), Some(error));
    }
}

#[test]
fn random_noise_and_extreme_shapes_give_maps_or_an_error_never_a_panic() {
    let pipeline = pipeline(Kernels::scalar());
    let mut work = vec![0; pipeline.workspace_bytes()];
    let mut state = 0x2545_F491_4F6C_DD1D_u64;
    println!("seed {state:#x}");
    for (width, height) in [(1, 1), (1, 300), (300, 1), (2, 2), (127, 129), (4000, 3)] {
        let mut noise = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 33) as u8
        };
        let data: Vec<u8> = (0..3 * width * height).map(|_| noise() / 2 + 20).collect();
        let frame = Frame::rgb8(&data, width, height, 3 * width).expect("a frame");
        let capture = pipeline.run(&frame, &CaptureOptions::default(), &Inline, &mut work, &mut Silent);
        let capture = capture.expect("maps");
        assert!(bits(&capture).iter().all(|&b| f32::from_bits(b).is_finite()), "{width} x {height}");
    }
}
