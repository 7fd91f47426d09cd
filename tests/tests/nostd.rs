//! Proof of no_std: a program with its own panic handler and no heap links core and runs the whole pipeline.
use std::path::Path;
use std::process::Command;

#[test]
fn the_pipeline_runs_without_std_from_static_memory() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let smoke = root.join("nostd-smoke");
    let target = Path::new(env!("CARGO_TARGET_TMPDIR")).join("nostd-smoke");
    let built = Command::new(env!("CARGO"))
        .args(["build", "--manifest-path"])
        .arg(smoke.join("Cargo.toml"))
        .arg("--target-dir")
        .arg(&target)
        .output()
        .expect("cargo runs");
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    let program = target.join("debug").join("nostd-smoke");
    let symbols = std::fs::read(&program).expect("the program");
    for name in ["__rust_alloc", "__rdl_alloc", "malloc"] {
        let found = symbols.windows(name.len()).any(|w| w == name.as_bytes());
        assert!(!found, "the program has {name}: it can allocate");
    }
    let status = Command::new(&program).status().expect("the program runs");
    assert_eq!(status.code(), Some(0), "see nostd-smoke/src/main.rs for the number's meaning");
}
