//! `material.glb` is valid glTF: by the `gltf` crate, and by the Khronos validator where it is installed.

use crate::common::{Folder, capture, stderr};
use std::path::PathBuf;
use std::process::Command;

#[test]
fn the_file_is_valid_gltf() {
    let folder = Folder::new();
    let out = folder.path("out");
    let run = capture(&[&folder.photo("a.png")], &out, &[]);
    assert!(run.status.success(), "{}", stderr(&run));
    let file = out.join("a/material.glb");
    let (document, buffers, images) = gltf::import(&file).expect("the gltf crate reads it");
    assert_eq!((document.meshes().count(), document.materials().count(), buffers.len()), (1, 1, 1));
    assert_eq!(images.iter().map(|i| (i.width, i.height)).collect::<Vec<_>>(), [(128, 128); 3]);

    // `npm ci` in tests/viewer brings the validator.
    let viewer = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/viewer");
    if !viewer.join("node_modules/gltf-validator").is_dir() {
        println!("NOT RUN: the Khronos validator; `npm ci` in tests/viewer installs it");
        return;
    }
    let run = Command::new("node").arg(viewer.join("validate.mjs")).arg(&file).output().expect("node");
    assert!(run.status.success(), "{}{}", String::from_utf8_lossy(&run.stdout), stderr(&run));
}
