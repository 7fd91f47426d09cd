//! Model files that lie: each broken rule has its error, and nothing panics.
use flashmat_core::Error;
use flashmat_core::ModelError;
use flashmat_core::base::exec::Inline;
use flashmat_core::kernels::Kernels;
use flashmat_core::net::{Model, Network};
use flashmat_tests::golden::{TOY_MODEL, TOY_SIZE, toy_photo};
use flashmat_tests::models::fix_checksum;
use flashmat_tests::runs::NetRun;
use std::collections::BTreeSet;

fn error_of(bytes: &[u8]) -> ModelError {
    match Model::from_bytes(bytes) {
        Err(Error::Model(error)) => error,
        Err(other) => panic!("not a model error: {other}"),
        Ok(_) => panic!("accepted"),
    }
}

/// The golden model with bytes overwritten and the checksum set right.
fn with(at: usize, bytes: &[u8]) -> Vec<u8> {
    let mut file = TOY_MODEL.to_vec();
    file[at..at + bytes.len()].copy_from_slice(bytes);
    fix_checksum(&mut file);
    file
}

/// Start and length of a section.
fn section(kind: &[u8; 4]) -> (usize, usize) {
    let entry = TOY_MODEL[64..].chunks_exact(32).find(|entry| entry.starts_with(kind)).expect("the section");
    let number = |at: usize| u64::from_le_bytes(entry[at..at + 8].try_into().expect("8 bytes")) as usize;
    (number(8), number(16))
}

fn entry(kind: &[u8; 4]) -> usize {
    64 + 32 * TOY_MODEL[64..].chunks_exact(32).position(|entry| entry.starts_with(kind)).expect("the section")
}

/// Offset of a layer's field.
fn field(layer: usize, field: usize) -> usize {
    let (graph, _) = section(b"GRPH");
    let tensors = u32::from_le_bytes(TOY_MODEL[graph..graph + 4].try_into().expect("4 bytes")) as usize;
    graph + 16 + 64 * tensors + 160 * layer + 4 * field
}

/// A layer's field.
fn value(layer: usize, number: usize) -> usize {
    let at = field(layer, number);
    u32::from_le_bytes(TOY_MODEL[at..at + 4].try_into().expect("4 bytes")) as usize
}

fn tensor(index: usize, offset: usize) -> usize {
    section(b"GRPH").0 + 16 + 64 * index + offset
}

#[test]
fn each_broken_rule_has_its_error() {
    use ModelError as E;
    let huge = u32::MAX.to_le_bytes();
    let (graph, _) = section(b"GRPH");
    let (params, _) = section(b"PARM");
    let (weights, _) = section(b"WGT8");
    let (floats, _) = section(b"WGTF");
    let (bias, scale) = (value(0, 19), value(0, 20));
    let cases: Vec<(Vec<u8>, ModelError)> = vec![
        (with(0, b"f"), E::NotAModel),
        (with(8, &1_u32.to_le_bytes()), E::Version { found: 1 }),
        (with(12, &huge), E::SectionCount { found: u32::MAX }),
        (with(16, &u64::MAX.to_le_bytes()), E::Length { needed: u64::MAX, given: TOY_MODEL.len() as u64 }),
        (with(40, &[1]), E::Reserved),
        (with(entry(b"META"), b"WHAT"), E::SectionKind { kind: *b"WHAT" }),
        (with(entry(b"GRPH"), b"META"), E::SectionTwice { kind: *b"META" }),
        (with(12, &1_u32.to_le_bytes()), E::SectionMissing { kind: *b"GRPH" }),
        (with(entry(b"GRPH") + 8, &u64::MAX.to_le_bytes()), E::SectionBounds { kind: *b"GRPH" }),
        (with(entry(b"GRPH") + 16, &u64::MAX.to_le_bytes()), E::SectionBounds { kind: *b"GRPH" }),
        (with(entry(b"GRPH") + 8, &64_u64.to_le_bytes()), E::SectionBounds { kind: *b"GRPH" }),
        (with(entry(b"GRPH") + 16, &100_u64.to_le_bytes()), E::SectionLength { kind: *b"GRPH" }),
        (with(entry(b"CRFC") + 16, &8_u64.to_le_bytes()), E::SectionLength { kind: *b"CRFC" }),
        (with(section(b"META").0, &[0xFF]), E::Text),
        (with(graph, &huge), E::Count { found: u32::MAX, limit: 80 }),
        (with(graph + 4, &0_u32.to_le_bytes()), E::Count { found: 0, limit: 80 }),
        (with(graph + 8, &1_u32.to_le_bytes()), E::Input),
        (with(graph + 12, &huge), E::Logits),
        (with(tensor(1, 0), &huge), E::Tensor { tensor: 1 }),
        (with(tensor(1, 4), &3_u32.to_le_bytes()), E::Tensor { tensor: 1 }),
        (with(tensor(1, 8), &f32::NAN.to_le_bytes()), E::Tensor { tensor: 1 }),
        (with(tensor(1, 12), &500_i32.to_le_bytes()), E::Tensor { tensor: 1 }),
        (with(tensor(1, 16), &[1]), E::Reserved),
        (with(tensor(1, 32), &[7]), E::Text),
        (with(tensor(0, 8), &0.5_f32.to_le_bytes()), E::Input),
        (with(field(1, 0), &9_u32.to_le_bytes()), E::LayerKind { layer: 1 }),
        (with(field(1, 1), &huge), E::LayerSource { layer: 1 }),
        (with(field(1, 1), &5_u32.to_le_bytes()), E::LayerSource { layer: 1 }),
        (with(field(1, 2), &2_u32.to_le_bytes()), E::LayerShape { layer: 1 }),
        (with(field(1, 5), &1_u32.to_le_bytes()), E::LayerOutput { layer: 1 }),
        (with(field(1, 6), &huge), E::LayerShape { layer: 1 }),
        (with(field(1, 8), &0_u32.to_le_bytes()), E::LayerShape { layer: 1 }),
        (with(field(1, 9), &huge), E::LayerShape { layer: 1 }),
        (with(field(1, 13), &7_u32.to_le_bytes()), E::LayerShape { layer: 1 }),
        (with(field(1, 17), &huge), E::LayerOutput { layer: 1 }),
        (with(field(1, 18), &huge), E::LayerBounds { layer: 1 }),
        (with(field(1, 19), &huge), E::LayerBounds { layer: 1 }),
        (with(field(1, 22), &0xFFFF_FF00_u32.to_le_bytes()), E::LayerBounds { layer: 1 }),
        (with(field(1, 30), &[1]), E::Reserved),
        (with(params + bias, &i32::MIN.to_le_bytes()), E::LayerValue { layer: 0 }),
        (with(params + scale, &f32::INFINITY.to_le_bytes()), E::LayerValue { layer: 0 }),
        (with(params + scale, &(-1.0_f32).to_le_bytes()), E::LayerValue { layer: 0 }),
        (with(weights, &[0x80]), E::LayerValue { layer: 0 }),
        (with(weights, &[TOY_MODEL[weights] ^ 1]), E::LayerSums { layer: 0 }),
        // Layer 3: depthwise, between tensors 2 and 4.
        (with(field(3, 1), &5_u32.to_le_bytes()), E::LayerSource { layer: 3 }),
        (with(field(3, 1), &3_u32.to_le_bytes()), E::LayerShape { layer: 3 }),
        (with(field(3, 5), &3_u32.to_le_bytes()), E::LayerOutput { layer: 3 }),
        (with(field(3, 2), &1_u32.to_le_bytes()), E::LayerShape { layer: 3 }),
        (with(field(3, 3), &2_u32.to_le_bytes()), E::LayerShape { layer: 3 }),
        (with(field(3, 6), &9_u32.to_le_bytes()), E::LayerShape { layer: 3 }),
        (with(field(3, 8), &3_u32.to_le_bytes()), E::LayerShape { layer: 3 }),
        (with(field(3, 10), &5_u32.to_le_bytes()), E::LayerShape { layer: 3 }),
        (with(field(3, 13), &7_u32.to_le_bytes()), E::LayerShape { layer: 3 }),
        (with(field(3, 17), &12_u32.to_le_bytes()), E::LayerShape { layer: 3 }),
        (with(field(3, 18), &huge), E::LayerBounds { layer: 3 }),
        (with(field(3, 19), &huge), E::LayerBounds { layer: 3 }),
        (with(field(3, 20), &huge), E::LayerBounds { layer: 3 }),
        (with(field(3, 21), &64_u32.to_le_bytes()), E::Reserved),
        (with(field(3, 23), &huge), E::LayerBounds { layer: 3 }),
        (with(weights + value(3, 18), &[0x80]), E::LayerValue { layer: 3 }),
        (with(params + value(3, 19), &i32::MAX.to_le_bytes()), E::LayerValue { layer: 3 }),
        (with(params + value(3, 20), &0_u32.to_le_bytes()), E::LayerValue { layer: 3 }),
        (with(floats + value(3, 22), &f32::NAN.to_le_bytes()), E::LayerValue { layer: 3 }),
        (with(section(b"CRFC").0, &(-1.0_f32).to_le_bytes()), E::Crf),
        (with(section(b"DFLT").0, &f32::NAN.to_le_bytes()), E::Defaults),
    ];
    let mut messages = BTreeSet::new();
    for (number, (bytes, error)) in cases.iter().enumerate() {
        assert_eq!(error_of(bytes), *error, "case {number}");
        messages.insert(error.to_string());
    }
    assert!(messages.len() > 25, "messages tell causes apart");
}

#[test]
fn truncation_anywhere_is_an_error() {
    let mut cuts = vec![0, 1, 7, 8, 16, 63, 64, 65, TOY_MODEL.len() - 1];
    for kind in [b"META", b"GRPH", b"WGT8", b"PARM", b"CRFC", b"DFLT", b"CARD", b"WGTF"] {
        let (start, length) = section(kind);
        cuts.extend([start - 1, start, start + 1, start + length / 2, start + length - 1]);
    }
    for cut in cuts {
        let mut file = TOY_MODEL[..cut].to_vec();
        error_of(&file);
        // The same with a header that tells the new length and checksum.
        if cut >= 64 {
            file[16..24].copy_from_slice(&(cut as u64).to_le_bytes());
            fix_checksum(&mut file);
            error_of(&file);
        }
    }
}

#[test]
fn every_flipped_bit_is_seen() {
    for at in (0..TOY_MODEL.len()).step_by(97).chain(0..64) {
        let mut file = TOY_MODEL.to_vec();
        file[at] ^= 1 << (at % 8);
        error_of(&file);
    }
}

/// Mutations with the checksum set right: no panic at load, and what still loads also runs.
#[test]
fn mutated_files_never_panic() {
    let seed: u64 = std::env::var("FLASHMAT_SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(1);
    println!("FLASHMAT_SEED={seed}");
    let mut state = seed;
    let mut random = move |limit: usize| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % limit
    };
    let interesting =
        [0_u32, 1, 2, 3, 4, 5, 7, 8, 16, 64, 127, 128, 255, 256, 4096, 65535, 1 << 31, u32::MAX];
    let (graph, graph_len) = section(b"GRPH");
    let (mut accepted, mut runs) = (0, 0);
    let photo = toy_photo();
    let fastest: Vec<_> = Kernels::supported().rev().take(2).collect();
    for round in 0..20_000 {
        let mut file = TOY_MODEL.to_vec();
        for _ in 0..=random(3) {
            let at = match random(8) {
                0 => random(file.len() - 4),
                1 => 8 + 4 * random((graph - 12) / 4),
                _ => graph + 4 * random(graph_len / 4 - 1),
            };
            let value = match random(3) {
                0 => interesting[random(interesting.len())],
                1 => (random(1 << 16) as u32) << random(17),
                _ => u32::from_le_bytes(file[at..at + 4].try_into().expect("4 bytes")) ^ (1 << random(32)),
            };
            file[at..at + 4].copy_from_slice(&value.to_le_bytes());
        }
        if random(20) == 0 {
            file.truncate(random(file.len()));
        }
        fix_checksum(&mut file);
        let Ok(model) = Model::from_bytes(&file) else { continue };
        accepted += 1;
        if accepted % 8 != 1 {
            continue;
        }
        let kernels = fastest[round % fastest.len()];
        let Ok(network) = Network::new(model, TOY_SIZE, kernels) else { continue };
        let mut run = NetRun::new(&network, TOY_SIZE, photo.clone());
        let answer = run.run(&network, None, &Inline, None).expect("a checked model runs");
        assert!(answer.used.0.iter().all(|p| p.is_finite()));
        assert!(run.normal.iter().chain(&run.albedo).all(|v| v.is_finite()), "round {round}");
        runs += 1;
    }
    println!("{accepted} of 20000 accepted, {runs} run");
    assert!(accepted > 100 && runs > 10, "the mutations are too wild to test anything");
}
