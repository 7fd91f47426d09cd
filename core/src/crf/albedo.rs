//! The albedo's CRF: smooths what the network hallucinated under highlights, guided by the photo's colour.
//!
//! Paper, "Designing DCRFs for Refinement", eq. (diffuseCRF), and the appendix's weight map
//! a_i = a0 max(1 - exp(-p²/s0²), 1 - exp(-(c_min - 1)²/s1²)) + a1: small only where the photo is burnt out near the
//! centre, where the flash's highlight lies. Coefficients: a0, a1, b1 (p), b2 (p, colour), b3 (p, albedo).
use super::feature::{self, radius_squared};
use super::refine::Energy;
use crate::Error;
use crate::base::exec::{Executor, Plane, ROWS_PER_BLOCK, for_each_row_block};
use crate::base::math::expf;
use crate::base::planes::check_planes;

/// Reach of the highlight's weight map, in units of p (the paper's sigma_d0).
pub const SIGMA_CENTRE: f32 = 0.5;
/// Width of "burnt out" in linear light (the paper's sigma_d1).
pub const SIGMA_CLIPPED: f32 = 0.08;

/// Inputs of the albedo's CRF, planar, `size` x `size`, linear RGB.
#[derive(Clone, Copy, Debug)]
pub struct Albedo<'i> {
    /// Pixels per side.
    pub size: usize,
    /// The photo, white = 1.
    pub photo: &'i [f32],
    /// The network's albedo.
    pub albedo: &'i [f32],
}

impl Energy<5> for Albedo<'_> {
    const CHANNELS: usize = 3;
    const UNARIES: usize = 2;
    const SIGMA_SPATIAL: f32 = feature::SIGMA_SPATIAL;
    const FEATURES: [usize; 2] = [3, 3];

    fn size(&self) -> usize {
        self.size
    }

    fn check(&self) -> Result<(), Error> {
        check_planes(self.size, 3, self.photo.len())?;
        check_planes(self.size, 3, self.albedo.len())
    }

    fn unary(&self, _term: usize) -> &[f32] {
        self.albedo
    }

    fn unary_map(&self, term: usize, exec: &dyn Executor, out: &mut [f32]) {
        if term != 0 {
            out.fill(1.0);
            return;
        }
        for_each_pixel(self.photo, self.size, exec, out, |radius, minimum| {
            // The larger of both maps has the larger exponent.
            let dark = (minimum - 1.0) * (minimum - 1.0) / (SIGMA_CLIPPED * SIGMA_CLIPPED);
            let exponent = dark.max(radius / (SIGMA_CENTRE * SIGMA_CENTRE));
            // Further out than this the exponential is below 1e-7, and most pixels are.
            if exponent > 17.0 { 1.0 } else { 1.0 - expf(-exponent) }
        });
    }

    fn features(&self, kernel: usize, exec: &dyn Executor, out: &mut [f32]) {
        if kernel == 0 {
            feature::normalised_colour(self.photo, self.size, feature::SIGMA_COLOUR, exec, out);
        } else {
            feature::scaled(self.albedo, self.size, feature::SIGMA_ALBEDO, exec, out);
        }
    }

    fn project(&self, map: &mut [f32]) {
        map.iter_mut().for_each(|value| *value = value.clamp(0.0, 1.0));
    }
}

/// Calls `weight(|p|², min(R, G, B) clamped to [0,1])` for every pixel.
pub(super) fn for_each_pixel(
    photo: &[f32],
    size: usize,
    exec: &dyn Executor,
    out: &mut [f32],
    weight: impl Fn(f32, f32) -> f32 + Sync,
) {
    let n2 = size * size;
    let channel = |c: usize, i: usize| photo.get(c * n2 + i).copied().unwrap_or(0.0);
    for_each_row_block(exec, size, ROWS_PER_BLOCK, Plane::new(out, size), &|rows, mut out| {
        for (y, out) in rows.zip(out.rows()) {
            for (x, out) in out.iter_mut().enumerate() {
                let i = y * size + x;
                let minimum = channel(0, i).min(channel(1, i)).min(channel(2, i)).clamp(0.0, 1.0);
                *out = weight(radius_squared(x, y, size), minimum);
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::exec::Inline;

    #[test]
    fn only_burnt_out_pixels_near_the_centre_lose_their_say() {
        // 3 x 3: the middle is at p = 0, an edge at |p| = 2/3, a corner at |p|² = 8/9.
        let mut photo = [1.0_f32; 27];
        photo[3] = 0.9; // red of the left edge
        let mut map = [0.0; 9];
        Albedo { size: 3, photo: &photo, albedo: &photo }.unary_map(0, &Inline, &mut map);
        assert_eq!(map[4], 0.0);
        assert!((map[0] - (1.0 - (-32.0_f32 / 9.0).exp())).abs() < 1e-6);
        assert!((map[1] - (1.0 - (-16.0_f32 / 9.0).exp())).abs() < 1e-6);
        // min = 0.9: (0.1 / 0.08)² = 1.5625 against 16/9 = 1.78: the position says more.
        assert!((map[3] - (1.0 - (-16.0_f32 / 9.0).exp())).abs() < 1e-6);
        photo[4 + 9] = 0.92; // green of the middle: exponent 1
        Albedo { size: 3, photo: &photo, albedo: &photo }.unary_map(0, &Inline, &mut map);
        assert!((map[4] - (1.0 - (-1.0_f32).exp())).abs() < 1e-5);
        photo[4] = 0.1;
        Albedo { size: 3, photo: &photo, albedo: &photo }.unary_map(0, &Inline, &mut map);
        assert_eq!(map[4], 1.0);
    }
}
