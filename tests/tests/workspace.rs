//! The workspace that a phone has to give, bounded: it must not grow unseen.
use flashmat_core::capture::Pipeline;
use flashmat_core::kernels::Kernels;
use flashmat_core::net::Model;

#[test]
fn a_capture_at_256_takes_at_most_16_mib() {
    let file =
        std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/../models/phone.fmat")).expect("the model");
    for kernels in Kernels::supported() {
        let model = Model::from_bytes(&file).expect("a model");
        let bytes = Pipeline::new(model, 256, kernels).expect("a plan").workspace_bytes();
        println!("{}: {:.2} MiB", kernels.level().name(), bytes as f64 / f64::from(1 << 20));
        assert!(bytes <= 16 << 20, "{bytes}");
    }
}

/// Sizes that nothing supports take more than there is; none overflows on the way there.
#[test]
fn absurd_sizes_take_more_than_there_is() {
    use flashmat_core::base::planes::MAX_SIZE;
    use flashmat_core::{crf, frame, highlight, search};
    type Helper = fn(usize) -> usize;
    let helpers: [(&str, Helper); 6] = [
        ("frame", frame::prepare_bytes),
        ("flash", search::flash_position_bytes),
        ("highlight", highlight::workspace_bytes),
        ("texture", highlight::retexture_bytes),
        ("roughness", highlight::level_roughness_bytes),
        ("crf", crf::max_workspace_bytes),
    ];
    for (name, bytes) in helpers {
        for size in [MAX_SIZE + 1, 1 << 20, 1 << 31, 1 << 40, usize::MAX / 3, usize::MAX] {
            assert_eq!(bytes(size), usize::MAX, "{name} {size}");
        }
        assert!((1..1 << 40).contains(&bytes(256)), "{name}");
        assert!(bytes(MAX_SIZE) >= bytes(128), "{name}");
    }
}
