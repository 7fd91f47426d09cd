//! Model files that are damaged, foreign or malicious: one line that names the file, nothing written.

use crate::common::{Folder, capture, flashmat, names, stderr, stdout};
use flashmat_core::net::format::crc32;

const TOY: &[u8] = include_bytes!("../../../tests/golden/toy.fmat");

/// The toy model with `bytes` at `at`; the checksum is made right again, so that later checks are reached.
fn patched(at: usize, bytes: &[u8]) -> Vec<u8> {
    patched_in(TOY, at, bytes)
}

/// [`patched`] of another model.
fn patched_in(model: &[u8], at: usize, bytes: &[u8]) -> Vec<u8> {
    let mut model = model.to_vec();
    model[at..at + bytes.len()].copy_from_slice(bytes);
    let checksum = crc32(&model[64..]);
    model[24..28].copy_from_slice(&checksum.to_le_bytes());
    model
}

/// Where a section's entry in the table starts.
fn entry(kind: &[u8; 4]) -> usize {
    64 + 32 * TOY[64..].chunks_exact(32).position(|entry| &entry[..4] == kind).expect("section")
}

/// Where a section starts.
fn section(kind: &[u8; 4]) -> usize {
    u64::from_le_bytes(TOY[entry(kind) + 8..][..8].try_into().expect("8 bytes")) as usize
}

#[test]
fn each_bad_model_is_told_apart() {
    let folder = Folder::new();
    let photo = folder.photo("a.png");
    let mut flipped = TOY.to_vec();
    flipped[TOY.len() / 2] ^= 0x40;
    let huge = u32::MAX.to_le_bytes();
    let graph = section(b"GRPH");
    let cases: [(&str, Vec<u8>, &str); 8] = [
        ("truncated", TOY[..TOY.len() - 1000].to_vec(), "cut short"),
        ("header_only", TOY[..20].to_vec(), "cut short"),
        ("flipped", flipped, "checksum differs"),
        ("version", patched(8, &77_u32.to_le_bytes()), "format version 77"),
        ("many_sections", patched(12, &huge), "sections"),
        ("many_tensors", patched(graph, &huge), "are possible"),
        ("many_layers", patched(graph + 4, &huge), "are possible"),
        ("foreign", b"\x89PNG\r\n\x1a\n and so on".to_vec(), "not a Flashmat model file"),
    ];
    for (name, bytes, part) in cases {
        let model = folder.file(&format!("{name}.fmat"), &bytes);
        let run = capture(&[&photo], &folder.path("out"), &["--model", model.to_str().expect("utf-8")]);
        let line = stderr(&run);
        assert_eq!((run.status.code(), line.lines().count()), (Some(1), 1), "{name}: {line}");
        assert!(line.starts_with(&format!("flashmat: {}: ", photo.display())), "{line}");
        assert!(line.contains(part) && line.contains(&format!("{name}.fmat")), "{name}: {line}");
        assert!(line.contains("get the file again"), "{line}");
        assert_eq!(names(&folder.path("out")), [""; 0]);

        let run = flashmat(["model"]).arg(&model).output().expect("run");
        assert_eq!(run.status.code(), Some(1));
        assert!(stderr(&run).contains(part), "{}", stderr(&run));
    }
    let missing = folder.path("none.fmat");
    let run = capture(&[&photo], &folder.path("out"), &["--model", missing.to_str().expect("utf-8")]);
    assert_eq!(run.status.code(), Some(1));
    assert!(stderr(&run).contains("none.fmat: cannot be read: no such file"), "{}", stderr(&run));
}

#[test]
fn a_level_of_another_cpu_is_refused() {
    let folder = Folder::new();
    let photo = folder.photo("a.png");
    let foreign: &[&str] =
        if cfg!(target_arch = "x86_64") { &["neon", "dotprod", "i8mm"] } else { &["avx2", "avx512vnni"] };
    for level in foreign {
        let run = capture(&[&photo], &folder.path("out"), &["--level", level]);
        assert_eq!(run.status.code(), Some(1));
        let message = stderr(&run);
        assert!(message.contains(level) && message.contains("use --level auto"), "{message}");
    }
}

#[test]
fn a_good_model_file_is_taken_and_shown() {
    let folder = Folder::new();
    let model = folder.file("toy.fmat", TOY);
    let photo = folder.photo("a.png");
    let run = capture(&[&photo], &folder.path("out"), &["--model", model.to_str().expect("utf-8")]);
    assert!(run.status.success(), "{}", stderr(&run));
    let report = std::fs::read_to_string(folder.path("out/a/report.json")).expect("report");
    let shown = stdout(&flashmat(["model"]).arg(&model).output().expect("run"));
    let hash = shown.lines().find_map(|l| l.strip_prefix("sha-256")).expect("hash").trim();
    assert_eq!(hash.len(), 64);
    assert!(report.contains(hash), "model and report name the same hash");
    for part in ["GMAC", "input", "mean over space", "albedo", "normal", "roughness"] {
        assert!(shown.contains(part), "{part}: {shown}");
    }
}

#[test]
fn the_embedded_model_is_shown_without_a_file() {
    let run = flashmat(["model", "--size", "512"]).output().expect("run");
    assert!(run.status.success());
    assert!(
        stdout(&run).contains("embedded model") && stdout(&run).contains("512 x 512"),
        "{}",
        stdout(&run)
    );
}

#[test]
fn the_sizes_of_the_training_photos_are_shown() {
    let folder = Folder::new();
    let longer = patched(entry(b"DFLT") + 16, &24_u64.to_le_bytes());
    let sizes = |base: u32, top: u32| {
        let numbers = [base.to_le_bytes(), top.to_le_bytes()].concat();
        let model = folder.file("sizes.fmat", &patched_in(&longer, section(b"DFLT") + 16, &numbers));
        stdout(&flashmat(["model"]).arg(&model).output().expect("run"))
    };
    assert!(sizes(0, 0).contains("43.35 degrees\n"));
    assert!(sizes(128, 0).contains("43.35 degrees, photos of 128 x 128\n"));
    assert!(sizes(128, 256).contains("43.35 degrees, photos of 128 x 128 and 256 x 256\n"));
}
