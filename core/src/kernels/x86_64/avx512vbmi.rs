//! AVX-512 VBMI: a table of 256 bytes in four registers, looked up for 64 bytes by two `vpermi2b` and a blend on the
//! bytes' highest bit; `vpdpbusd` (VNNI) adds up four rows' digits. See `columns.rs`.
#![allow(unsafe_code)]
use super::super::byte_table::{AHEAD, ByteTable, DIGITS, MARK_BIT};
use core::arch::x86_64::{
    __m512i, __mmask64, _MM_HINT_T0, _mm_loadl_epi64, _mm_prefetch, _mm512_add_epi64, _mm512_castsi512_si256,
    _mm512_cmpge_epu8_mask, _mm512_cvtepi32_epi64, _mm512_cvtepu8_epi64, _mm512_dpbusd_epi32,
    _mm512_extracti64x4_epi64, _mm512_loadu_si512, _mm512_mask_add_epi8, _mm512_mask_blend_epi8,
    _mm512_mask_storeu_epi64, _mm512_maskz_loadu_epi8, _mm512_movepi8_mask, _mm512_permutex2var_epi8,
    _mm512_permutex2var_epi16, _mm512_set1_epi8, _mm512_set1_epi32, _mm512_setzero_si512, _mm512_slli_epi64,
    _mm512_storeu_si512, _mm512_sub_epi64,
};

/// Columns that are worked on together: the bytes of a register.
const COLUMNS: usize = 64;
/// Rows that are added up by one instruction.
const ROWS: usize = 4;

/// Which bytes of two registers (those of the second count from 64) stand side by side, of columns 0 to 31 and 32 to 63.
const PAIRS: [[u8; 64]; 2] = {
    let mut pairs = [[0; 64]; 2];
    let mut i = 0;
    while i < 128 {
        pairs[i / 64][i % 64] = (i / 2 + i % 2 * 64) as u8;
        i += 1;
    }
    pairs
};

/// The same of pairs of bytes, of their first and last 16 columns.
const FOURS: [[u16; 32]; 2] = {
    let mut fours = [[0; 32]; 2];
    let mut i = 0;
    while i < 64 {
        fours[i / 32][i % 32] = (i / 2 + i % 2 * 32) as u16;
        i += 1;
    }
    fours
};

/// Sets `sums` to the sums over `rows` rows of bytes that start `stride` apart, and marks them.
///
/// # Safety
/// The CPU has the features; `1 <= rows <= 255` and `(rows - 1) * stride + sums.len() <= data.len()`.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vnni,avx512vbmi")]
pub(in super::super) unsafe fn column_sums(
    table: &ByteTable,
    data: &[u8],
    (rows, stride): (usize, usize),
    sums: &mut [u64],
) {
    for (index, sums) in sums.chunks_mut(COLUMNS).enumerate() {
        let inside = u64::MAX >> (COLUMNS - sums.len());
        // SAFETY: the caller's promise; `inside` ends at the last column.
        let (digits, marked) =
            unsafe { add_up(table, data.as_ptr().add(index * COLUMNS), (rows, stride), inside) };
        let mut marks = [0_u8; COLUMNS];
        // SAFETY: 64 bytes.
        unsafe { _mm512_storeu_si512(marks.as_mut_ptr().cast(), marked) };
        for (i, [low, middle, high]) in digits.into_iter().enumerate() {
            for half in 0..2 {
                let wide = |sum: __m512i| {
                    _mm512_cvtepi32_epi64(if half == 0 {
                        _mm512_castsi512_si256(sum)
                    } else {
                        _mm512_extracti64x4_epi64::<1>(sum)
                    })
                };
                let (low, middle, high) = (wide(low), wide(middle), wide(high));
                let above = _mm512_sub_epi64(_mm512_slli_epi64::<30>(high), _mm512_slli_epi64::<15>(middle));
                let sum = _mm512_sub_epi64(above, low);
                let first = 16 * i + 8 * half;
                // SAFETY: `first` is at most 56: eight of the 64 bytes.
                let marks = unsafe { _mm_loadl_epi64(marks.as_ptr().add(first).cast()) };
                let sum = _mm512_add_epi64(sum, _mm512_slli_epi64::<MARK_BIT>(_mm512_cvtepu8_epi64(marks)));
                // SAFETY: the mask has no bits for sums that are not there, and wrapping the pointer to them reads nothing.
                unsafe {
                    let at = sums.as_mut_ptr().wrapping_add(first);
                    _mm512_mask_storeu_epi64(at.cast(), (inside >> first) as u8, sum);
                }
            }
        }
    }
}

/// For 16 columns at a time minus the sums of digits 0 and 1, minus those of 2 and 3, and the sums of digit 4; and of
/// each column how many bytes are marked.
///
/// # Safety
/// The CPU has the features; columns in `inside` can be read in every row.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,avx512vnni,avx512vbmi")]
#[inline]
unsafe fn add_up(
    table: &ByteTable,
    data: *const u8,
    (rows, stride): (usize, usize),
    inside: __mmask64,
) -> ([[__m512i; 3]; 4], __m512i) {
    // SAFETY: 64 bytes each.
    let (pairs, fours) = unsafe {
        (
            PAIRS.each_ref().map(|index| _mm512_loadu_si512(index.as_ptr().cast())),
            FOURS.each_ref().map(|index| _mm512_loadu_si512(index.as_ptr().cast())),
        )
    };
    let mut sums = [[_mm512_setzero_si512(); 3]; 4];
    let mut marked = _mm512_setzero_si512();
    let from = _mm512_set1_epi8(table.marked_from.cast_signed());
    for first in (0..rows).step_by(ROWS) {
        // Past the last row it is taken again, without weight.
        let row = |i: usize| (first + i).min(rows - 1) * stride;
        // SAFETY: the caller's promise.
        let codes: [__m512i; ROWS] =
            core::array::from_fn(|i| unsafe { _mm512_maskz_loadu_epi8(inside, data.add(row(i)).cast()) });
        for i in 0..ROWS {
            // Reads nothing: any address will do.
            _mm_prefetch::<_MM_HINT_T0>(data.wrapping_add(row(i) + AHEAD).cast());
        }
        let weight = u32::MAX >> (8 * (ROWS - (rows - first).min(ROWS)));
        let weights =
            [weight, weight & 0x8080_8080, weight & 0x0101_0101].map(|w| _mm512_set1_epi32(w.cast_signed()));
        for code in codes.into_iter().take(rows - first) {
            let mask = _mm512_cmpge_epu8_mask(code, from);
            marked = _mm512_mask_add_epi8(marked, mask, marked, _mm512_set1_epi8(1));
        }
        let [a, b, c, d] = codes;
        let ab = pairs.map(|index| _mm512_permutex2var_epi8(a, index, b));
        let cd = pairs.map(|index| _mm512_permutex2var_epi8(c, index, d));
        // 16 columns in each, four rows side by side.
        let columns: [__m512i; 4] =
            core::array::from_fn(|i| _mm512_permutex2var_epi16(ab[i / 2], fours[i % 2], cd[i / 2]));
        let upper = columns.map(|codes| _mm512_movepi8_mask(codes));
        for plane in 0..DIGITS {
            // SAFETY: 256 bytes.
            let digits: [__m512i; 4] = core::array::from_fn(|i| unsafe {
                _mm512_loadu_si512(table.digits[plane].as_ptr().add(64 * i).cast())
            });
            let weight = weights[if plane == DIGITS - 1 { 2 } else { plane % 2 }];
            for i in 0..4 {
                let low = _mm512_permutex2var_epi8(digits[0], columns[i], digits[1]);
                let high = _mm512_permutex2var_epi8(digits[2], columns[i], digits[3]);
                let digit = _mm512_mask_blend_epi8(upper[i], low, high);
                sums[i][plane / 2] = _mm512_dpbusd_epi32(sums[i][plane / 2], digit, weight);
            }
        }
    }
    (sums, marked)
}
