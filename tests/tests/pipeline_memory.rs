//! A whole capture allocates nothing, at the training size, above it (where the network runs thrice), and above
//! the CRFs' grid.
use flashmat_core::Silent;
use flashmat_core::base::exec::Inline;
use flashmat_core::capture::{CaptureOptions, Pipeline};
use flashmat_core::frame::Frame;
use flashmat_core::kernels::Kernels;
use flashmat_core::net::Model;
use flashmat_tests::counting::{Counting, calls};
use flashmat_tests::golden::TOY_MODEL;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// One test only: others in this program would be counted too.
#[test]
fn a_capture_allocates_nothing() {
    let side = 300;
    let photo: Vec<u8> = (0..3 * side * side).map(|i| (60 + i * 7 % 120) as u8).collect();
    let fastest = Kernels::supported().next_back().expect("a level");
    for kernels in [Kernels::scalar(), fastest] {
        for size in [128, 256, 640] {
            let model = Model::from_bytes(TOY_MODEL).expect("the toy model");
            assert_eq!(model.defaults().base_size, 128);
            let pipeline = Pipeline::new(model, size, kernels).expect("a plan");
            let mut work = vec![0; pipeline.workspace_bytes()];
            let frame = Frame::rgb8(&photo, side, side, 3 * side).expect("a frame");
            let before = calls();
            let capture = pipeline.run(&frame, &CaptureOptions::default(), &Inline, &mut work, &mut Silent);
            let during = calls() - before;
            assert!(capture.is_ok());
            assert_eq!(during, 0, "{} at {size}", kernels.level().name());
        }
    }
    assert!(calls() > 0, "the counter counts");
}
