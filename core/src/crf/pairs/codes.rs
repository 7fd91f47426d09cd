//! How affinities and weights are held: an affinity's square root in 8 bits while the graph is built, an edge's weight
//! as the upper half of an f32 afterwards. Loops over a line at a time, to be called within `Simd::run`.
use super::layout::Line;
use core::ops::Range;

/// Pixels of a line that are worked on together.
const TILE: usize = 128;

/// Sets the lower bytes of `codes` (and the upper ones to 0), or the upper ones, to the codes of exp(-|f_i - f_j|²) = sqrt(K)
/// of one line.
#[inline(always)]
pub(super) fn affinity_row<const UPPER: bool>(
    features: &[f32],
    size: usize,
    line: &Line,
    y: usize,
    codes: &mut [u16],
) {
    match features.len() / (size * size).max(1) {
        2 => affinity_planes::<UPPER, 2>(features, size, line, y, codes),
        3 => affinity_planes::<UPPER, 3>(features, size, line, y, codes),
        _ => affinity_rest::<UPPER>(features, size, line, y, codes, 0),
    }
}

/// The same for `P` planes, whose distances then never leave the registers.
#[inline(always)]
fn affinity_planes<const UPPER: bool, const P: usize>(
    features: &[f32],
    size: usize,
    line: &Line,
    y: usize,
    codes: &mut [u16],
) {
    let empty: (&[f32], &[f32]) = (&[], &[]);
    let plane = |p: usize| features.get(p * size * size..(p + 1) * size * size).unwrap_or(&[]);
    let pairs: [_; P] = core::array::from_fn(
        #[inline(always)]
        |p| line.pair(plane(p), size, y).unwrap_or(empty),
    );
    let (tiles, rest) = codes.as_chunks_mut::<TILE>();
    let done = tiles.len() * TILE;
    for (tile, codes) in tiles.iter_mut().enumerate() {
        let pairs = pairs.map(
            #[inline(always)]
            |(own, other)| (run_at(own, tile * TILE), run_at(other, tile * TILE)),
        );
        for i in 0..TILE {
            let mut distance = 0.0;
            for (own, other) in pairs {
                let d = own[i] - other[i];
                distance += d * d;
            }
            codes[i] = with_code::<UPPER>(codes[i], distance);
        }
    }
    if !rest.is_empty() {
        affinity_rest::<UPPER>(features, size, line, y, rest, done);
    }
}

/// The run of `values` that starts at `start`; zeros if they end before it does.
#[inline(always)]
fn run_at(values: &[f32], start: usize) -> &[f32; TILE] {
    values.get(start..).and_then(<[f32]>::first_chunk).unwrap_or(&[0.0; TILE])
}

/// The same for any planes, from column `start` on.
#[inline(always)]
fn affinity_rest<const UPPER: bool>(
    features: &[f32],
    size: usize,
    line: &Line,
    y: usize,
    codes: &mut [u16],
    start: usize,
) {
    for (tile, codes) in codes.chunks_mut(TILE).enumerate() {
        let mut distance = [0.0_f32; TILE];
        for plane in features.chunks_exact(size * size) {
            let Some((own, other)) = line.pair(plane, size, y) else { continue };
            let columns = start + tile * TILE..start + tile * TILE + codes.len();
            let (Some(own), Some(other)) = (own.get(columns.clone()), other.get(columns)) else { continue };
            for ((sum, a), b) in distance.iter_mut().zip(own).zip(other) {
                let d = a - b;
                *sum += d * d;
            }
        }
        for (code, &d) in codes.iter_mut().zip(&distance) {
            *code = with_code::<UPPER>(*code, d);
        }
    }
}

/// `code` with the code of a distance in its upper byte; or that alone, in the lower one.
#[inline(always)]
fn with_code<const UPPER: bool>(code: u16, distance: f32) -> u16 {
    // Adding 2^23 rounds to the nearest integer and leaves it in the lowest bits.
    let byte = (exp_minus(distance) * 255.0 + 8_388_608.0).to_bits() & 0xff;
    if UPPER { code | (byte << 8) as u16 } else { byte as u16 }
}

/// Adds weight code² to the sums of `columns`.
#[inline(always)]
pub(super) fn add_squares(row: &mut [f32], columns: Range<usize>, codes: &[u16], shift: u32, weight: f32) {
    let row = row.get_mut(columns).unwrap_or(&mut []);
    for (sum, &code) in row.iter_mut().zip(codes) {
        *sum += weight * squared_code(code, shift);
    }
}

/// The weights of one kernel.
#[inline(always)]
pub(super) fn merge_one(b: f32, i: &[f32], j: &[f32], codes: &mut [u16]) {
    for ((code, i), j) in codes.iter_mut().zip(i).zip(j) {
        *code = encode(b * (i * j) * squared_code(*code, 0));
    }
}

/// The weights of two kernels.
#[inline(always)]
pub(super) fn merge_two(b: [f32; 2], [i0, j0]: [&[f32]; 2], [i1, j1]: [&[f32]; 2], codes: &mut [u16]) {
    for ((((code, i0), j0), i1), j1) in codes.iter_mut().zip(i0).zip(j0).zip(i1).zip(j1) {
        let first = b[0] * (i0 * j0) * squared_code(*code, 0);
        let second = b[1] * (i1 * j1) * squared_code(*code, 8);
        *code = encode(first + second);
    }
}

/// e^-t for t >= 0 to a relative 3e-5, by basic operations only, so that it vectorises and has the same bits
/// everywhere; 0 or nearly so from t = 80 on.
#[inline(always)]
fn exp_minus(t: f32) -> f32 {
    const SHIFT: f32 = 12_582_912.0;
    let t = if t < 80.0 { t } else { 80.0 };
    let scaled = t * -core::f32::consts::LOG2_E;
    let shifted = scaled + SHIFT;
    let f = scaled - (shifted - SHIFT);
    // 2^f on [-1/2, 1/2]: Taylor with the last coefficient a little larger.
    let p = 1.0 + f * (core::f32::consts::LN_2 + f * (0.240_226_5 + f * (0.055_504_1 + f * 0.009_7)));
    f32::from_bits(p.to_bits().wrapping_add(shifted.to_bits() << 23))
}

#[inline(always)]
fn squared_code(codes: u16, shift: u32) -> f32 {
    let code = f32::from(((codes >> shift) & 0xff) as u8);
    code * code
}

/// An f32 from its upper half.
#[inline(always)]
pub(super) fn decode(half: u16) -> f32 {
    f32::from_bits(u32::from(half) << 16)
}

/// The upper half of a finite f32, rounded to nearest.
#[inline(always)]
fn encode(value: f32) -> u16 {
    let bits = value.to_bits();
    ((bits.wrapping_add(0x7fff + ((bits >> 16) & 1))) >> 16) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_close_over_its_whole_range() {
        for i in 0..8000 {
            let t = i as f32 * 0.01;
            let (ours, exact) = (f64::from(exp_minus(t)), (-f64::from(t)).exp());
            assert!((ours / exact - 1.0).abs() < 1e-4, "{t}: {ours} {exact}");
        }
        assert_eq!(exp_minus(0.0), 1.0);
        assert!(exp_minus(1e30) < 1e-30 && exp_minus(f32::INFINITY) < 1e-30);
    }

    #[test]
    fn halves_round_to_nearest_even() {
        for value in [0.0_f32, 1.0, 0.5, 1e-3, 0.333, 7.1e-6] {
            assert!((decode(encode(value)) - value).abs() <= value / 256.0, "{value}");
        }
        assert_eq!(decode(encode(1.0)), 1.0);
    }
}
