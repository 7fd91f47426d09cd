//! What the targets share: bytes turned into numbers, photos and options, most of them sensible enough to get past the
//! door. A decoder never fails: where bytes run out it reads zeros.
mod photo;

pub use photo::{Photo, fov};

/// The core's names, imported once.
pub mod core {
    pub use flashmat_core::base::arena::Arena;
    pub use flashmat_core::base::exec::{At, Inline};
    pub use flashmat_core::base::simd::{Level, Simd};
    pub use flashmat_core::capture::{CaptureOptions, Pipeline};
    pub use flashmat_core::frame::{
        Encoding, FieldOfView, Frame, PhotoFov, Range, Rotation, YuvMatrix, YuvPlanes, prepare, prepare_bytes,
    };
    pub use flashmat_core::kernels::Kernels;
    pub use flashmat_core::net::format::crc32;
    pub use flashmat_core::net::{Class, Model};
    pub use flashmat_core::{Error, Session, SessionOptions, Silent};
}

/// The toy model of the golden tests: small, fast, every kind of layer.
pub const TOY: &[u8] = include_bytes!("../../tests/golden/toy.fmat");

/// Bytes read as numbers.
pub struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    /// Reads `data` from its start.
    pub fn new(data: &'a [u8]) -> Self {
        Self(data)
    }

    fn array<const N: usize>(&mut self) -> [u8; N] {
        let (head, rest) = self.0.split_at(N.min(self.0.len()));
        self.0 = rest;
        let mut array = [0; N];
        array[..head.len()].copy_from_slice(head);
        array
    }

    /// A byte.
    pub fn u8(&mut self) -> u8 {
        self.array::<1>()[0]
    }

    /// Two bytes, little-endian.
    pub fn u16(&mut self) -> u16 {
        u16::from_le_bytes(self.array())
    }

    /// Four bytes, little-endian.
    pub fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.array())
    }

    /// Eight bytes, little-endian.
    pub fn u64(&mut self) -> u64 {
        u64::from_le_bytes(self.array())
    }

    /// Any float: NaN, infinities, subnormal ones.
    pub fn bits(&mut self) -> f32 {
        f32::from_bits(self.u32())
    }

    /// One of `values`.
    pub fn pick<T: Copy>(&mut self, values: &[T]) -> T {
        values[usize::from(self.u8()) % values.len()]
    }

    /// `usual`, or something near it, or anything.
    pub fn amount(&mut self, usual: usize) -> usize {
        match self.u8() {
            0..=199 => usual,
            near @ 200..=219 => usual.wrapping_add(usize::from(near - 199)),
            near @ 220..=239 => usual.saturating_sub(usize::from(near - 219)),
            240..=247 => usize::from(self.u16()),
            248..=251 => 0,
            252 => usize::MAX,
            _ => self.u64() as usize,
        }
    }

    /// A code: mostly one of `known`, else anything.
    pub fn code(&mut self, known: &[u32]) -> u32 {
        match self.u8() {
            255 => self.u32(),
            at => known[usize::from(at) % known.len()],
        }
    }

    /// A float in `low..=high`, or any other.
    pub fn real(&mut self, low: f32, high: f32) -> f32 {
        match self.u8() {
            0..=223 => low + (high - low) * f32::from(self.u16()) / 65535.0,
            224..=239 => 0.0,
            _ => self.bits(),
        }
    }

    /// `len` bytes of a kind that a byte chooses: flat, a pattern, noise, extremes, light that falls off.
    pub fn fill(&mut self, len: usize) -> Vec<u8> {
        let kind = self.u8();
        let pattern: [u8; 16] = self.array();
        let mut state = u64::from_le_bytes(pattern[..8].try_into().expect("8 bytes")) | 1;
        let mut random = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 56) as u8
        };
        let value = |i: usize| match kind % 5 {
            0 => pattern[0],
            1 => pattern[i % 16],
            2 => random(),
            3 => [0, 255][usize::from(random() & 1)],
            _ => {
                let off = (2 * i).abs_diff(len) as u64 * 200 / len.max(1) as u64;
                (230 - off as u8).saturating_sub(random() % (1 + pattern[0] % 64))
            }
        };
        (0..len).map(value).collect()
    }

    /// What is left.
    pub fn rest(self) -> &'a [u8] {
        self.0
    }

    /// Whether nothing is left.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// Writes the checksum that a model file should have, so that mutations get past it.
pub fn fix_checksum(file: &mut [u8]) {
    if let Some((head, body)) = file.split_at_mut_checked(64) {
        head[24..28].copy_from_slice(&core::crc32(body).to_le_bytes());
    }
}
