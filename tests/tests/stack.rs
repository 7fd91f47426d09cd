//! The C header promises that no function needs 384 KiB of stack: everything between a model's bytes and a material runs
//! on a thread that has no more. An overflow ends the test's program. `FLASHMAT_STACK_KIB` tries another limit.
use flashmat_core::Silent;
use flashmat_core::base::exec::Inline;
use flashmat_core::capture::{CaptureOptions, Pipeline};
use flashmat_core::frame::Frame;
use flashmat_core::kernels::Kernels;
use flashmat_core::net::Model;
use std::hint::black_box;

const KIB: usize = 384;

fn capture(kernels: &'static Kernels, file: &[u8], photo: &[u8], side: usize) -> f32 {
    let model = Model::from_bytes(file).expect("the model");
    let pipeline = Pipeline::new(model, 256, kernels).expect("a plan");
    let mut work = vec![0; pipeline.workspace_bytes()];
    let frame = Frame::rgb8(photo, side, side, 3 * side).expect("a frame");
    let options = CaptureOptions::default();
    let capture = pipeline.run(&frame, &options, &Inline, &mut work, &mut Silent);
    capture.expect("a capture").residual
}

#[test]
fn a_capture_runs_on_the_stack_that_the_header_promises() {
    let kib = std::env::var("FLASHMAT_STACK_KIB").ok().map_or(KIB, |text| text.parse().expect("a number"));
    let file =
        std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../models/phone.fmat")).expect("the model");
    let side = 300;
    let photo: Vec<u8> = (0..3 * side * side).map(|i| (60 + i * 7 % 120) as u8).collect();
    std::thread::scope(|scope| {
        for kernels in Kernels::supported() {
            let thread = std::thread::Builder::new().stack_size(kib << 10);
            let run = || black_box(capture(kernels, &file, &photo, side));
            let residual = thread.spawn_scoped(scope, run).expect("a thread").join().expect("no panic");
            assert!(residual.is_finite());
            println!("{}: {kib} KiB are enough", kernels.level().name());
        }
    });
}
