//! A table of what each of the 256 bytes stands for, digit by digit: see `columns`.

/// Digits of a value.
pub(super) const DIGITS: usize = 5;
/// Each digit's first bit and number of bits. A pair of 7 and 8 bits shares a sum: its weights, 1 and 128, fit into bytes.
const BITS: [(u32, u32); DIGITS] = [(0, 7), (7, 8), (15, 7), (22, 8), (30, 8)];
/// How far ahead rows are asked for, in bytes: of their first ones nobody has asked for.
pub(crate) const AHEAD: usize = 512;
/// The bit of a sum from which on its marked bytes are counted.
pub(crate) const MARK_BIT: u32 = 49;

/// What each byte stands for, digit by digit, and which bytes are counted as marked.
#[derive(Clone, Debug)]
#[cfg_attr(not(target_arch = "x86_64"), expect(dead_code))]
pub(crate) struct ByteTable {
    pub(super) digits: [[u8; 256]; DIGITS],
    pub(super) marked_from: u8,
}

impl ByteTable {
    /// Bytes stand for the lower 38 bits of `values`. Bytes of `marked_from` or more are counted from [`MARK_BIT`] on.
    pub(crate) fn new(values: &[u64; 256], marked_from: u8) -> Self {
        let mut digits = [[0; 256]; DIGITS];
        for (digits, (first, count)) in digits.iter_mut().zip(BITS) {
            for (digit, value) in digits.iter_mut().zip(values) {
                *digit = ((value >> first) & ((1 << count) - 1)) as u8;
            }
        }
        Self { digits, marked_from }
    }
}
