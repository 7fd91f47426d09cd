//! Golden files: what the numpy reference executors make of one photo (`train/tests/make_golden.py`).
use flashmat_core::frame::transfer::srgb_to_linear;
use flashmat_core::net::format::crc32;
use std::collections::BTreeMap;

/// The toy model's file.
pub const TOY_MODEL: &[u8] = include_bytes!("../golden/toy.fmat");
/// Pixels per side of the golden photo.
pub const TOY_SIZE: usize = 128;
const TOY_GOLDEN: &[u8] = include_bytes!("../golden/toy.golden");

/// Expected values: every `step`-th, and the checksum of all.
#[derive(Clone, Debug)]
pub struct Expected {
    /// 0: i8, 1: f32, 2: u8.
    pub kind: u32,
    /// Values in all.
    pub len: usize,
    /// CRC-32 of all values' little-endian bytes.
    pub crc: u32,
    step: usize,
    samples: Vec<u8>,
}

impl Expected {
    /// Panics unless the codes are the expected ones, all of them.
    pub fn assert_codes(&self, name: &str, codes: &[i8]) {
        assert_eq!((self.kind, self.len), (0, codes.len()), "{name}: kind and length");
        let kept = codes.iter().step_by(self.step).zip(&self.samples);
        let wrong = kept.filter(|(a, b)| **a != b.cast_signed()).count();
        assert_eq!(wrong, 0, "{name}: {wrong} of {} samples differ", self.samples.len());
        let bytes: Vec<u8> = codes.iter().map(|q| q.cast_unsigned()).collect();
        assert_eq!(crc32(&bytes), self.crc, "{name}: the samples agree, other values do not");
    }

    /// The sampled values as floats.
    pub fn floats(&self) -> impl Iterator<Item = f32> {
        self.samples.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b))
    }

    /// Largest difference of the sampled values; panics when lengths differ.
    #[must_use]
    pub fn distance(&self, name: &str, values: &[f32]) -> f32 {
        assert_eq!((self.kind, self.len), (1, values.len()), "{name}: kind and length");
        let kept = values.iter().step_by(self.step).zip(self.floats());
        kept.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    /// The values as bytes, for records that are kept whole.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.samples
    }
}

/// All records by name.
#[must_use]
pub fn toy() -> BTreeMap<String, Expected> {
    let number = |at: usize| u32::from_le_bytes(TOY_GOLDEN[at..at + 4].try_into().expect("4 bytes"));
    assert_eq!(&TOY_GOLDEN[..8], b"FMGOLD01");
    let mut at = 12;
    let mut records = BTreeMap::new();
    for _ in 0..number(8) {
        let name = String::from_utf8(TOY_GOLDEN[at..at + 32].to_vec()).expect("ASCII");
        let (kind, step, len, crc) = (number(at + 32), number(at + 36), number(at + 40), number(at + 48));
        let bytes = number(at + 52) as usize * if kind == 1 { 4 } else { 1 };
        let samples = TOY_GOLDEN[at + 56..at + 56 + bytes].to_vec();
        let expected = Expected { kind, len: len as usize, crc, step: step as usize, samples };
        records.insert(name.trim_end_matches('\0').to_owned(), expected);
        at += 56 + bytes;
    }
    assert_eq!(at, TOY_GOLDEN.len());
    records
}

/// The golden photo, linear, planar.
#[must_use]
pub fn toy_photo() -> Vec<f32> {
    toy()["photo"].bytes().iter().map(|&code| srgb_to_linear(f32::from(code) / 255.0)).collect()
}
