//! Sums over the rows of a picture of bytes, column by column, of what a table says of each byte.
//!
//! Where bytes can be looked up in registers (AVX-512 VBMI, [`Simd::has_byte_tables`]) that is several times as fast as a
//! load for every byte; elsewhere there is nothing to be had here. Sums are exact integers: the same as by any loop.
#![allow(unsafe_code)]
use super::byte_table::ByteTable;
use crate::base::simd::Simd;

/// Most rows that are added up at once: marks are counted in bytes.
const MOST_ROWS: usize = 255;

impl ByteTable {
    /// Sets `sums` to the sums over `rows` rows that start `stride` bytes apart in `data`, one for each byte of a row. Does
    /// nothing, and says so, where registers are no faster than loads ([`Simd::has_byte_tables`]), rows are too many
    /// or the data too short.
    #[must_use]
    pub(crate) fn column_sums(
        &self,
        data: &[u8],
        (rows, stride): (usize, usize),
        sums: &mut [u64],
        simd: Simd,
    ) -> bool {
        let needed = rows.saturating_sub(1).saturating_mul(stride).saturating_add(sums.len());
        let fits = (1..=MOST_ROWS).contains(&rows) && needed <= data.len();
        if !fits || !simd.has_byte_tables() {
            return false;
        }
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the CPU has byte tables, the rows are as many as it takes, and the last one ends within the data.
        unsafe {
            super::x86_64::avx512vbmi::column_sums(self, data, (rows, stride), sums);
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::super::byte_table::MARK_BIT;
    use super::*;
    use crate::base::simd::Level;
    use crate::base::testing::property;
    use proptest::prelude::*;
    use std::vec;
    use std::vec::Vec;

    /// The definition: one byte after the other.
    fn plain(
        values: &[u64; 256],
        from: u8,
        data: &[u8],
        rows: usize,
        stride: usize,
        width: usize,
    ) -> Vec<u64> {
        let column = |x: usize| (0..rows).map(move |y| data[y * stride + x]);
        let sum = |x: usize| column(x).map(|byte| values[usize::from(byte)]).sum::<u64>();
        let marked = |x: usize| column(x).filter(|byte| *byte >= from).count() as u64;
        (0..width).map(|x| sum(x) + (marked(x) << MARK_BIT)).collect()
    }

    #[test]
    fn sums_are_those_of_plain_loops() {
        let sizes = (1..300_usize, 0..9_usize, prop_oneof![1..20_usize, 1..=MOST_ROWS]);
        let kinds = (any::<u64>(), 0..4_u8, any::<u8>());
        property(300, (sizes, kinds), |((width, pad, rows), (seed, kind, from))| {
            let random = |i: usize| {
                let x = (seed ^ i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
                (x ^ (x >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 26
            };
            let values: [u64; 256] = core::array::from_fn(|code| match kind {
                0 => (1 << 38) - 1,
                1 => code as u64,
                _ => random(code + 7),
            });
            let stride = width + pad;
            // Not a byte more than the last row has.
            let data: Vec<u8> = (0..(rows - 1) * stride + width)
                .map(|i| if kind == 3 { 255 } else { random(i + 1000) as u8 })
                .collect();
            let expected = plain(&values, from, &data, rows, stride, width);
            let table = ByteTable::new(&values, from);
            for simd in Level::ALL.into_iter().filter_map(|level| Simd::for_level(level).ok()) {
                let mut sums = vec![5; width];
                let done = table.column_sums(&data, (rows, stride), &mut sums, simd);
                prop_assert_eq!(done, simd.has_byte_tables());
                prop_assert!(!done || sums == expected, "{:?}", simd);
            }
            Ok(())
        });
    }

    #[test]
    fn sums_that_would_read_or_run_over_are_refused() {
        let (table, data) = (ByteTable::new(&[1; 256], 255), [0_u8; 64]);
        let best = Simd::for_level(Level::detect()).expect("this CPU's level");
        for (rows, stride, width) in [(0, 8, 8), (9, 8, 8), (2, 57, 8), (2, usize::MAX, 1), (1, 0, 65)] {
            let mut sums = vec![7; width];
            assert!(!table.column_sums(&data, (rows, stride), &mut sums, best), "{rows} {stride} {width}");
            assert!(sums.iter().all(|&sum| sum == 7));
        }
        let mut sums = [7; 8];
        assert!(!table.column_sums(&data, (MOST_ROWS + 1, 0), &mut sums, best));
        assert_eq!(table.column_sums(&data, (MOST_ROWS, 0), &mut sums, best), best.has_byte_tables());
        assert_eq!(sums, if best.has_byte_tables() { [MOST_ROWS as u64; 8] } else { [7; 8] });
    }
}
