//! The program's writers, read back: every PNG and GLB by somebody else's reader, every report by `render`'s; and
//! reports that are just bytes.
#![no_main]

use flashmat_cli::fuzzing::{self, Sample};
use flashmat_fuzz::Bytes;
use libfuzzer_sys::fuzz_target;

fn sample(bytes: &mut Bytes<'_>) -> Sample {
    let size = 1 + usize::from(bytes.u8()) % 16;
    let codes = bytes.fill(7 * size * size);
    let mut planes: Vec<f32> = codes.iter().map(|&v| f32::from(v) / 255.0).collect();
    for normal in &mut planes[3 * size * size..6 * size * size] {
        *normal = *normal * 2.0 - 1.0;
    }
    // A value that no map should have: it may be written as anything, but the file stays whole.
    for _ in 0..bytes.u8() % 3 {
        let at = usize::from(bytes.u16()) % planes.len();
        planes[at] = bytes.bits();
    }
    let facts = [
        bytes.real(0.05, 0.5),
        bytes.real(1.0, 170.0),
        bytes.real(1e-3, 1e3),
        bytes.real(0.0, 1.0),
        bytes.real(0.0, 1.0),
        bytes.real(0.0, 1e6),
    ];
    // The core gives none that is not finite.
    let facts = facts.map(|v| if v.is_finite() { v } else { 0.5 });
    let facts =
        [facts[0].clamp(0.0, 0.9), facts[1].clamp(1.0, 170.0), facts[2], facts[3], facts[4], facts[5]];
    let mut text = || {
        let len = usize::from(bytes.u8()) % 48;
        let raw: Vec<u8> = (0..len).map(|_| bytes.u8()).collect();
        String::from_utf8_lossy(&raw).into_owned()
    };
    Sample { name: text(), size, planes, facts, warnings: vec![text(), text()] }
}

fn check_glb(file: &[u8], sample: &Sample) {
    let read = gltf::Gltf::from_slice(file).expect("a valid GLB");
    let blob = read.blob.as_ref().expect("a binary chunk");
    let mesh = read.meshes().next().expect("a mesh");
    assert_eq!(mesh.name(), Some(sample.name.as_str()));
    let primitive = mesh.primitives().next().expect("a primitive");
    let reader = primitive.reader(|_| Some(blob));
    assert_eq!(reader.read_positions().expect("positions").count(), 4);
    assert!(reader.read_indices().expect("indices").into_u32().all(|i| i < 4));
    assert!(primitive.material().ior().is_some_and(|ior| ior.is_finite() && ior >= 1.0));
    for picture in read.images() {
        let gltf::image::Source::View { view, .. } = picture.source() else { panic!("not embedded") };
        let png = &blob[view.offset()..view.offset() + view.length()];
        assert_eq!(image::load_from_memory(png).expect("a PNG").width() as usize, sample.size);
    }
}

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes::new(data);
    if bytes.u8() % 4 == 0 {
        if let Some(again) = fuzzing::rewrite_report(bytes.rest()) {
            assert_eq!(fuzzing::rewrite_report(&again).as_deref(), Some(&again[..]), "read, written, read");
        }
        return;
    }
    // The sheet takes longer than all the rest.
    let sheet = bytes.u8() == 7;
    let sample = sample(&mut bytes);
    for (name, file) in fuzzing::write(&sample, sheet).expect("memory does not fail") {
        match name {
            "material.glb" => check_glb(&file, &sample),
            "report.json" => assert_eq!(fuzzing::rewrite_report(&file), Some(file)),
            _ => {
                let picture = image::load_from_memory(&file).expect("a PNG");
                assert!(name == "sheet.png" || picture.width() as usize == sample.size);
            }
        }
    }
});
