//! What the bilateral kernels compare besides positions: planes of features, each divided by twice its sigma so that
//! the kernel is exp(-2 |f_i - f_j|²). All planes are `size` x `size`.
//!
//! Widths are those of the paper's table in "Details of Continuous DCRFs"; positions in [-1,1].
use crate::base::exec::{Executor, Plane, ROWS_PER_BLOCK as ROWS, for_each_row_block, planes3};
use crate::base::planes::plane_row;

/// kappa_1 of the albedo and the roughness: positions.
pub const SIGMA_SPATIAL: f32 = 0.04;
/// kappa_1 of the normals: positions.
pub const SIGMA_SPATIAL_NORMAL: f32 = 0.03;
/// Positions in every bilateral kernel.
pub const SIGMA_POSITION: f32 = 0.06;
/// Normalised colour of the photo (albedo, kappa_2).
pub const SIGMA_COLOUR: f32 = 0.2;
/// Albedo (albedo, kappa_3).
pub const SIGMA_ALBEDO: f32 = 0.1;
/// Gradient of the albedo (normals, kappa_2).
pub const SIGMA_GRADIENT: f32 = 0.1;
/// Albedo (roughness, kappa_2).
pub const SIGMA_ALBEDO_ROUGHNESS: f32 = 0.2;

/// Pixels per side for which the albedo's gradient is the difference of neighbours.
const GRADIENT_SIZE: f32 = 256.0;

/// Keeps the colour of black defined and the noise of dark pixels small.
const DARK: f32 = 0.01;

/// Copies of planes of rows of `size` values.
pub fn scaled(planes: &[f32], size: usize, sigma: f32, exec: &dyn Executor, out: &mut [f32]) {
    let scale = 0.5 / sigma;
    let rows = out.len() / size.max(1);
    for_each_row_block(exec, rows, ROWS, Plane::new(out, size), &|rows, mut out| {
        let from = planes.get(rows.start * size..).unwrap_or(&[]);
        out.values().iter_mut().zip(from).for_each(|(out, value)| *out = scale * value);
    });
}

/// The photo's colour without its brightness: I / |I|, 3 planes. Black and near black tend to (0, 0, 0).
pub fn normalised_colour(rgb: &[f32], size: usize, sigma: f32, exec: &dyn Executor, out: &mut [f32]) {
    let scale = 0.5 / sigma;
    for_each_row_block(exec, size, ROWS, planes3(out, size, size), &|rows, [mut r, mut g, mut b]| {
        exec.simd().run(
            #[inline(always)]
            || {
                for (y, ((out_r, out_g), out_b)) in rows.clone().zip(r.rows().zip(g.rows()).zip(b.rows())) {
                    let [r, g, b] = [0, 1, 2].map(|plane| plane_row(rgb, size, plane * size + y));
                    for (((square, r), g), b) in out_r.iter_mut().zip(r).zip(g).zip(b) {
                        *square = r * r + g * g + b * b + DARK * DARK;
                    }
                    exec.simd().sqrt(out_r);
                    let outs = out_r.iter_mut().zip(out_g).zip(out_b);
                    for (((r, g), b), ((out_r, out_g), out_b)) in r.iter().zip(g).zip(b).zip(outs) {
                        let factor = scale / *out_r;
                        (*out_r, *out_g, *out_b) = (factor * r, factor * g, factor * b);
                    }
                }
            },
        );
    });
}

/// The gradient of the albedo's mean over its channels, along x and along y: 2 planes. Central differences (one-sided
/// at the border) for a step of 1/128 in p, which is the distance of neighbours at 256 x 256.
pub fn gradient(albedo: &[f32], size: usize, sigma: f32, exec: &dyn Executor, out: &mut [f32]) {
    let n2 = size * size;
    // Mean of three channels over the distance of two pixels.
    let scale = 0.5 / sigma * (size as f32 / GRADIENT_SIZE) / 3.0;
    let sum = |x: usize, y: usize| {
        let value = |c: usize| albedo.get(c * n2 + y * size + x).copied().unwrap_or(0.0);
        value(0) + value(1) + value(2)
    };
    let Some((along_x, along_y)) = out.split_at_mut_checked(n2) else { return };
    let out = (Plane::new(along_x, size), Plane::new(along_y, size));
    for_each_row_block(exec, size, ROWS, out, &|rows, (mut along_x, mut along_y)| {
        for (y, (row_x, row_y)) in rows.zip(along_x.rows().zip(along_y.rows())) {
            let (above, below) = (y.saturating_sub(1), (y + 1).min(size - 1));
            for (x, (out_x, out_y)) in row_x.iter_mut().zip(row_y).enumerate() {
                let (left, right) = (x.saturating_sub(1), (x + 1).min(size - 1));
                *out_x = scale * (sum(right, y) - sum(left, y)) / (right - left).max(1) as f32;
                *out_y = scale * (sum(x, above) - sum(x, below)) / (below - above).max(1) as f32;
            }
        }
    });
}

/// |p|² of pixel (x, y), p in [-1,1]² at pixel centres.
#[must_use]
pub fn radius_squared(x: usize, y: usize, size: usize) -> f32 {
    let p = |i: usize| (2 * i + 1) as f32 / size as f32 - 1.0;
    p(x) * p(x) + p(y) * p(y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::exec::Inline;

    #[test]
    fn brightness_does_not_change_the_normalised_colour() {
        let rgb = [0.2, 0.8, 0.0, 0.1, 0.4, 0.0, 0.2, 0.8, 0.0];
        // Planes of a 1 x 1 image, three times, with the pixel scaled.
        for pixel in [[0.2_f32, 0.1, 0.2], [0.8, 0.4, 0.8]] {
            let mut out = [0.0; 3];
            normalised_colour(&pixel, 1, 0.5, &Inline, &mut out);
            assert!((out[0] - 2.0 / 3.0).abs() < 2e-3 && (out[1] - 1.0 / 3.0).abs() < 2e-3);
        }
        let mut black = [9.0; 12];
        normalised_colour(&[0.0; 12], 2, 0.2, &Inline, &mut black);
        assert_eq!(black, [0.0; 12]);
        let mut short = [7.0; 2];
        normalised_colour(&rgb, 2, 0.2, &Inline, &mut short);
        assert_eq!(short, [7.0; 2]);
    }

    #[test]
    fn the_gradient_points_right_and_up() {
        let size = 4;
        let mut albedo = [0.0_f32; 48];
        for (i, value) in albedo.iter_mut().enumerate() {
            let (x, y) = (i % size, i / size % size);
            *value = 0.02 * x as f32 - 0.01 * y as f32;
        }
        let mut out = [0.0; 32];
        gradient(&albedo, size, 0.5, &Inline, &mut out);
        // Per pixel 0.02 and 0.01 (up), times size / 256.
        for (x, y) in out[..16].iter().zip(&out[16..]) {
            assert!((x - 0.02 / 64.0).abs() < 1e-7 && (y - 0.01 / 64.0).abs() < 1e-7, "{x} {y}");
        }
        gradient(&[1.0; 3], 1, 0.5, &Inline, &mut [0.0; 2]);
    }

    #[test]
    fn positions_are_pixel_centres() {
        assert_eq!(radius_squared(0, 0, 2), 0.5);
        assert_eq!(radius_squared(1, 1, 3), 0.0);
    }
}
