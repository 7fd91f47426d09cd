//! A network run allocates nothing, and its workspace is as large as it said before.
use flashmat_core::Error;
use flashmat_core::base::arena::Arena;
use flashmat_core::base::exec::Inline;
use flashmat_core::kernels::Kernels;
use flashmat_core::net::{Mixing, Model, Network};
use flashmat_tests::counting::{Counting, calls};
use flashmat_tests::models::{Widths, random_model};
use flashmat_tests::runs::{NetRun, smooth_photo};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// One test only: others in this program would be counted too.
#[test]
fn a_run_allocates_nothing_and_keeps_to_its_workspace() {
    let file = random_model(&Widths::phone(), 3);
    let size = 128;
    let before = calls();
    let model = Model::from_bytes(&file).expect("a model");
    assert_eq!(calls(), before, "loading allocates nothing either");
    for kernels in Kernels::supported() {
        let network = Network::new(model.clone(), size, kernels).expect("128 suits");
        let mut run = NetRun::new(&network, size, smooth_photo(size));
        let before = calls();
        run.run(&network, None, &Inline, None).expect("a run");
        assert_eq!(calls(), before, "{}", kernels.name());
    }

    for size in [128, 256, 1024, 2048] {
        let network = Network::new(model.clone(), size, Kernels::scalar()).expect("multiples of 128 suit");
        let bytes = network.workspace_bytes();
        println!("{size}: workspace {:.2} MiB", bytes as f64 / f64::from(1 << 20));
        assert!(size > 256 || bytes < 16 << 20);
    }
    for size in [0, 64, 100, 129, 1 << 30, usize::MAX & !127] {
        let error = Network::new(model.clone(), size, Kernels::scalar()).expect_err("an unsuitable size");
        assert_eq!(error, Error::NetworkSize { size, multiple: 128 });
    }

    let network = Network::new(model, size, Kernels::scalar()).expect("128 suits");
    let mut run = NetRun::new(&network, size, smooth_photo(size));
    let photo = smooth_photo(size);
    let clipped = vec![0; size * size];
    let photo = flashmat_core::frame::LinearImage::new(size, &photo, &clipped, 43.35);
    let mut workspace = vec![0; network.workspace_bytes() / 2];
    let mut maps = flashmat_core::maps::MapsMut {
        size,
        albedo: &mut run.albedo,
        normal: &mut run.normal,
        roughness: &mut run.roughness,
    };
    let mut arena = Arena::new(&mut workspace);
    let short =
        network.run(&photo, Mixing::default(), &Inline, &mut arena, &mut maps, &mut flashmat_core::Silent);
    assert!(matches!(short, Err(Error::WorkspaceTooSmall { .. })));
}
