//! Transfer curves and primaries: sRGB codes to linear light and back, Display P3 to sRGB.
//!
//! The curves are IEC 61966-2-1's, exact (not gamma 2.2); Display P3 uses the same curve with SMPTE EG 432-1's
//! primaries and the same white (D65), so that white stays white.
use crate::base::math::powf;

/// sRGB-encoded value to linear light, both with white = 1.
#[must_use]
pub fn srgb_to_linear(x: f32) -> f32 {
    if x <= 0.04045 { x / 12.92 } else { powf((x + 0.055) / 1.055, 2.4) }
}

/// Linear light to the sRGB-encoded value, both with white = 1.
#[must_use]
pub fn linear_to_srgb(x: f32) -> f32 {
    if x <= 0.003_130_8 { x * 12.92 } else { 1.055 * powf(x, 1.0 / 2.4) - 0.055 }
}

/// Linear Display P3 to linear sRGB, row by row. Each row sums to 1; colours outside sRGB come out below 0 or above 1.
pub const P3_TO_SRGB: [[f32; 3]; 3] = [
    [1.224_940_2, -0.224_940_2, 0.0],
    [-0.042_056_95, 1.042_056_9, 0.0],
    [-0.019_637_55, -0.078_636_05, 1.098_273_6],
];

/// One linear Display P3 colour in linear sRGB.
#[must_use]
pub fn p3_to_srgb(p3: [f32; 3]) -> [f32; 3] {
    P3_TO_SRGB.map(|m| m[0] * p3[0] + m[1] * p3[1] + m[2] * p3[2])
}

/// Linear light of each 8-bit code.
#[must_use]
pub fn byte_table(curve: fn(f32) -> f32) -> [f32; 256] {
    let mut table = [0.0; 256];
    for (code, value) in table.iter_mut().enumerate() {
        *value = curve(code as f32 / 255.0);
    }
    table
}

/// Entries of a [`fill_wide_table`] table: one for every 16th 16-bit code, and one past the end.
pub const WIDE_TABLE: usize = 4097;

/// Linear light of every 16th 16-bit code, to be read with [`wide_lookup`].
pub fn fill_wide_table(table: &mut [f32], curve: fn(f32) -> f32) {
    for (i, value) in table.iter_mut().enumerate() {
        *value = curve(i as f32 * 16.0 / 65535.0);
    }
}

/// Linear light of a 16-bit code: linear between the table's entries, at most 1e-7 off the exact curve.
#[must_use]
pub fn wide_lookup(table: &[f32], code: u16) -> f32 {
    let at = usize::from(code >> 4);
    match (table.get(at), table.get(at + 1)) {
        (Some(&a), Some(&b)) => a + (b - a) * (f32::from(code & 15) / 16.0),
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hand_worked_values() {
        assert_eq!(srgb_to_linear(0.0), 0.0);
        assert_eq!(srgb_to_linear(1.0), 1.0);
        assert!((srgb_to_linear(0.5) - 0.214_041_14).abs() < 1e-7);
        assert!((linear_to_srgb(0.18) - 0.461_356_1).abs() < 1e-6);
        assert!((linear_to_srgb(1.0) - 1.0).abs() < 1e-6);
        // Both sides of the knee.
        assert!((srgb_to_linear(0.04045) - 0.003_130_805).abs() < 1e-8);
        assert!((srgb_to_linear(0.04046) - 0.003_131_58).abs() < 1e-7);
    }

    #[test]
    fn every_byte_survives_the_round_trip() {
        for code in 0..=255_u8 {
            let encoded = linear_to_srgb(srgb_to_linear(f32::from(code) / 255.0));
            assert_eq!((encoded * 255.0 + 0.5) as u8, code);
        }
    }

    #[test]
    fn the_wide_table_is_the_curve() {
        let mut table = [0.0; WIDE_TABLE];
        fill_wide_table(&mut table, srgb_to_linear);
        for code in 0..=65535_u16 {
            let exact = srgb_to_linear(f32::from(code) / 65535.0);
            assert!((wide_lookup(&table, code) - exact).abs() <= 1e-6, "{code}");
        }
        assert!((wide_lookup(&table, 65535) - 1.0).abs() < 1e-6);
    }

    /// From the primaries' chromaticities, in f64: RGB -> XYZ of P3, then XYZ -> RGB of sRGB.
    #[test]
    fn the_p3_matrix_follows_from_the_primaries() {
        type M = [[f64; 3]; 3];
        fn inverse(m: M) -> M {
            let minor = |r: usize, c: usize| {
                let (r1, r2, c1, c2) = ((r + 1) % 3, (r + 2) % 3, (c + 1) % 3, (c + 2) % 3);
                m[r1][c1] * m[r2][c2] - m[r1][c2] * m[r2][c1]
            };
            let det: f64 = (0..3).map(|c| m[0][c] * minor(0, c)).sum();
            core::array::from_fn(|r| core::array::from_fn(|c| minor(c, r) / det))
        }
        fn product(a: M, b: M) -> M {
            core::array::from_fn(|r| core::array::from_fn(|c| (0..3).map(|k| a[r][k] * b[k][c]).sum()))
        }
        fn to_xyz(xy: [[f64; 2]; 3]) -> M {
            let columns: M = core::array::from_fn(|r| {
                core::array::from_fn(|c| {
                    let [x, y] = xy[c];
                    [x / y, 1.0, (1.0 - x - y) / y][r]
                })
            });
            let white = [0.3127 / 0.3290, 1.0, (1.0 - 0.3127 - 0.3290) / 0.3290];
            let i = inverse(columns);
            let scale: [f64; 3] = core::array::from_fn(|r| (0..3).map(|k| i[r][k] * white[k]).sum());
            core::array::from_fn(|r| core::array::from_fn(|c| columns[r][c] * scale[c]))
        }
        let p3 = to_xyz([[0.680, 0.320], [0.265, 0.690], [0.150, 0.060]]);
        let srgb = to_xyz([[0.640, 0.330], [0.300, 0.600], [0.150, 0.060]]);
        let matrix = product(inverse(srgb), p3);
        for r in 0..3 {
            for c in 0..3 {
                assert!((matrix[r][c] - f64::from(P3_TO_SRGB[r][c])).abs() < 1e-5, "{r} {c} {matrix:?}");
            }
        }
        assert!(p3_to_srgb([1.0; 3]).iter().all(|&v| (v - 1.0).abs() < 1e-6));
    }
}
