//! Chooses the model to embed: `models/phone.fmat`, or the tests' toy model in a checkout that has none yet.
use std::path::{Path, PathBuf};

fn main() {
    let root = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default()).join("..");
    let product = root.join("models/phone.fmat");
    let toy = root.join("tests/golden/toy.fmat");
    println!("cargo::rerun-if-changed={}", product.display());
    println!("cargo::rerun-if-changed={}", toy.display());
    let model: &Path = if product.is_file() {
        &product
    } else {
        println!(
            "cargo::warning=models/phone.fmat is missing: the tests' toy model is embedded in its place"
        );
        &toy
    };
    println!("cargo::rustc-env=FLASHMAT_EMBEDDED_MODEL={}", model.display());
}
