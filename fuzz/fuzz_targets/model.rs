//! The model file: as bytes, and as changes to a good one with the checksum set right. What loads also runs.
#![no_main]

use flashmat_fuzz::core::{CaptureOptions, Frame, Inline, Kernels, Level, Model, Pipeline, Silent};
use flashmat_fuzz::{Bytes, TOY, fix_checksum};
use libfuzzer_sys::fuzz_target;

/// Workspace that a model may ask for here; more is honest, but slow.
const MEMORY: usize = 24 << 20;

fn file(data: &[u8]) -> Vec<u8> {
    let mut bytes = Bytes::new(data);
    let kind = bytes.u8();
    if kind % 4 == 0 {
        let mut file = bytes.rest().to_vec();
        if kind % 8 == 0 {
            fix_checksum(&mut file);
        }
        return file;
    }
    let mut file = TOY.to_vec();
    while !bytes.is_empty() {
        // Most changes go to the header, the sections' table and the graph, which lie first.
        let reach = if bytes.u8() < 230 { 16 << 10 } else { file.len() };
        let at = bytes.u32() as usize % reach.min(file.len());
        let value = match bytes.u8() {
            0..=127 => bytes.u32(),
            small @ 128..=250 => u32::from(small - 128),
            251 => u32::MAX,
            252 => 1 << 31,
            _ => f32::NAN.to_bits(),
        };
        let end = (at + 4).min(file.len());
        file[at..end].copy_from_slice(&value.to_le_bytes()[..end - at]);
    }
    fix_checksum(&mut file);
    file
}

fuzz_target!(|data: &[u8]| {
    let file = file(data);
    let Ok(model) = Model::from_bytes(&file) else { return };
    let _ = (model.meta(), model.card(), model.defaults(), model.checksum(), model.has_float());
    let kernels = Kernels::for_level(Level::detect()).expect("this CPU's own level");
    let Ok(pipeline) = Pipeline::new(model, 128, kernels) else { return };
    let needed = pipeline.workspace_bytes();
    if needed > MEMORY {
        return;
    }
    let mut workspace = vec![0xA5; needed];
    let pixels: Vec<u8> = (0..3 * 33 * 35).map(|i| (i * 37 % 240) as u8).collect();
    let frame = Frame::rgb8(&pixels, 33, 35, 99).expect("a good frame");
    let options = CaptureOptions { refine: data.len() % 32 == 0, ..CaptureOptions::default() };
    let captured = pipeline.run(&frame, &options, &Inline, &mut workspace, &mut Silent);
    let maps = captured.expect("a checked model runs").maps;
    assert!(maps.albedo.iter().chain(maps.roughness).all(|v| (0.0..=1.0).contains(v)), "outside [0,1]");
    assert!(maps.normal.iter().all(|v| v.is_finite()));
});
