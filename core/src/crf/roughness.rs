//! The roughness' CRF: joins the network's roughness with the search's, which knows more near highlights.
//!
//! Paper, "Designing DCRFs for Refinement", eq. (roughnessCRF), and the appendix's weight map
//! a1_i = a1 max(exp(-p²/s0²), exp(-(c_min - 1)²/s1²)); the appendix lost the second exponent's square. The map is
//! also multiplied with the search's observability. Coefficients: a0 (network), a1 (search), b1 (p), b2 (p, albedo).
use super::albedo::for_each_pixel;
use super::feature;
use super::refine::Energy;
use crate::Error;
use crate::base::exec::Executor;
use crate::base::math::expf;
use crate::base::planes::check_planes;

/// Reach of the highlight's weight map, in units of p (the paper's sigma_r0).
pub const SIGMA_CENTRE: f32 = 0.5;
/// Width of "bright" in linear light (the paper's sigma_r1).
pub const SIGMA_BRIGHT: f32 = 0.2;

/// Inputs of the roughness' CRF, planar, `size` x `size`.
#[derive(Clone, Copy, Debug)]
pub struct Roughness<'i> {
    /// Pixels per side.
    pub size: usize,
    /// The photo, linear RGB, white = 1.
    pub photo: &'i [f32],
    /// The refined albedo, 3 planes.
    pub albedo: &'i [f32],
    /// The network's roughness, one plane.
    pub network: &'i [f32],
    /// The search's roughness, one plane.
    pub search: &'i [f32],
    /// How much the photo says about roughness at each pixel, [0,1], one plane; none: 1 everywhere.
    pub observability: Option<&'i [f32]>,
}

impl Energy<4> for Roughness<'_> {
    const CHANNELS: usize = 1;
    const UNARIES: usize = 2;
    const SIGMA_SPATIAL: f32 = feature::SIGMA_SPATIAL;
    const FEATURES: [usize; 2] = [3, 0];

    fn size(&self) -> usize {
        self.size
    }

    fn check(&self) -> Result<(), Error> {
        check_planes(self.size, 3, self.photo.len())?;
        check_planes(self.size, 3, self.albedo.len())?;
        check_planes(self.size, 1, self.network.len())?;
        check_planes(self.size, 1, self.search.len())?;
        self.observability.map_or(Ok(()), |plane| check_planes(self.size, 1, plane.len()))
    }

    fn unary(&self, term: usize) -> &[f32] {
        if term == 0 { self.network } else { self.search }
    }

    fn unary_map(&self, term: usize, exec: &dyn Executor, out: &mut [f32]) {
        if term == 0 {
            out.fill(1.0);
            return;
        }
        for_each_pixel(self.photo, self.size, exec, out, |radius, minimum| {
            let dark = (minimum - 1.0) * (minimum - 1.0) / (SIGMA_BRIGHT * SIGMA_BRIGHT);
            expf(-(radius / (SIGMA_CENTRE * SIGMA_CENTRE)).min(dark))
        });
        for (out, seen) in out.iter_mut().zip(self.observability.unwrap_or(&[])) {
            *out *= seen.clamp(0.0, 1.0);
        }
    }

    fn features(&self, kernel: usize, exec: &dyn Executor, out: &mut [f32]) {
        if kernel == 0 {
            feature::scaled(self.albedo, self.size, feature::SIGMA_ALBEDO_ROUGHNESS, exec, out);
        }
    }

    fn project(&self, map: &mut [f32]) {
        map.iter_mut().for_each(|value| *value = value.clamp(0.0, 1.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::exec::Inline;

    #[test]
    fn the_search_is_heard_near_the_centre_and_where_the_photo_is_bright() {
        let mut photo = [0.0_f32; 27];
        for channel in 0..3 {
            photo[channel * 9] = 0.8; // a corner: exponent 1
            photo[channel * 9 + 2] = 1.5; // another, brighter than white
        }
        let zero = [0.0; 27];
        let mut energy = Roughness {
            size: 3,
            photo: &photo,
            albedo: &zero,
            network: &zero[..9],
            search: &zero[..9],
            observability: None,
        };
        let mut map = [0.0; 9];
        energy.unary_map(1, &Inline, &mut map);
        assert_eq!(map[4], 1.0);
        assert!((map[0] - (-1.0_f32).exp()).abs() < 1e-6);
        assert_eq!(map[2], 1.0);
        assert!((map[1] - (-16.0_f32 / 9.0).exp()).abs() < 1e-6);
        let seen = [0.5, 1.0, 0.0, 1.0, 0.25, 1.0, 1.0, 1.0, 9.0];
        energy.observability = Some(&seen);
        energy.unary_map(1, &Inline, &mut map);
        assert_eq!((map[2], map[4]), (0.0, 0.25));
    }
}
