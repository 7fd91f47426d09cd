//! `material.glb` is valid glTF: by the `gltf` crate, and by the Khronos validator where it is installed.

use crate::common::{Folder, capture, photo, stderr};
use flashmat_core::capture::CaptureOptions;
use flashmat_core::frame::Frame;
use flashmat_core::net::{Class, Model};
use flashmat_core::{Session, SessionOptions, Silent};
use flashmat_export::{Pictures, glb};
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

/// A photo that is said to be of a metal: the file is the one that the exporter makes of the core's capture, to the
/// byte, as it is in C (`ffi/tests/parity.rs`) and in Java (`FormatsTest`); and it is of a metal.
#[test]
fn a_class_given_counts_and_the_bytes_are_the_exporters() {
    let folder = Folder::new();
    let out = folder.path("out");
    let toy = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/toy.fmat");
    let model = toy.to_str().expect("a path");
    let run = capture(&[&folder.photo("a.png")], &out, &["--class", "metal", "--model", model]);
    assert!(run.status.success(), "{}", stderr(&run));
    let written = std::fs::read(out.join("a/material.glb")).expect("a file");

    let picture = photo(160, 144);
    let frame = Frame::rgb8(picture.as_raw(), 160, 144, 3 * 160).expect("a frame");
    let bytes = std::fs::read(&toy).expect("the toy model");
    let options = SessionOptions { size: 128, level: None, threads: 1 };
    let mut session = Session::new(Model::from_bytes(&bytes).expect("a model"), &options).expect("a session");
    let options = CaptureOptions { class: Some(Class::Metal), ..CaptureOptions::default() };
    let capture = session.capture(&frame, &options, &mut Silent).expect("a capture");
    assert!(capture.probabilities.0[Class::Metal as usize] < 0.5, "the classifier would not have said so");
    let (f0, fov_deg) = (capture.f0, capture.photo.fov_deg);
    let material = glb::Material { name: "a", pictures: Pictures::Planes(capture.maps), f0, fov_deg };
    assert!(written == glb::file(&material).expect("a file").to_vec(), "the bytes differ");

    let (_, _, images) = gltf::import(out.join("a/material.glb")).expect("glTF");
    assert!(images[1].pixels.chunks_exact(3).all(|orm| orm[2] == 255), "metallic");
}
