//! The workspace that a phone has to give, bounded: it must not grow unseen.
use flashmat_core::kernels::Kernels;
use flashmat_core::net::Model;
use flashmat_core::pipeline::Pipeline;

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
