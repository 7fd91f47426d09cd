//! The normals' CRF: less noise, with pixels of like albedo gradient drawn together.
//!
//! Paper, "Designing DCRFs for Refinement", eq. (normalCRF); uniform unary weight. Coefficients: a, b1 (p),
//! b2 (p, gradient of the refined albedo). The solution is renormalised; a zero vector becomes +Z.
use super::feature;
use super::refine::Energy;
use crate::Error;
use crate::base::exec::Executor;
use crate::base::math::sqrtf;
use crate::base::planes::check_planes;

/// Inputs of the normals' CRF, planar, `size` x `size`.
#[derive(Clone, Copy, Debug)]
pub struct Normal<'i> {
    /// Pixels per side.
    pub size: usize,
    /// The network's unit normals, planes x, y, z.
    pub normal: &'i [f32],
    /// The refined albedo, 3 planes.
    pub albedo: &'i [f32],
}

impl Energy<3> for Normal<'_> {
    const CHANNELS: usize = 3;
    const UNARIES: usize = 1;
    const SIGMA_SPATIAL: f32 = feature::SIGMA_SPATIAL_NORMAL;
    const FEATURES: [usize; 2] = [2, 0];

    fn size(&self) -> usize {
        self.size
    }

    fn check(&self) -> Result<(), Error> {
        check_planes(self.size, 3, self.normal.len())?;
        check_planes(self.size, 3, self.albedo.len())
    }

    fn unary(&self, _term: usize) -> &[f32] {
        self.normal
    }

    fn unary_map(&self, _term: usize, _exec: &dyn Executor, out: &mut [f32]) {
        out.fill(1.0);
    }

    fn features(&self, kernel: usize, exec: &dyn Executor, out: &mut [f32]) {
        if kernel == 0 {
            feature::gradient(self.albedo, self.size, feature::SIGMA_GRADIENT, exec, out);
        }
    }

    fn project(&self, map: &mut [f32]) {
        let n2 = map.len() / 3;
        let Some((x, rest)) = map.split_at_mut_checked(n2) else { return };
        let Some((y, z)) = rest.split_at_mut_checked(n2) else { return };
        for ((x, y), z) in x.iter_mut().zip(y).zip(z) {
            let squared = *x * *x + *y * *y + *z * *z;
            if squared < 1e-12 {
                (*x, *y, *z) = (0.0, 0.0, 1.0);
            } else if (squared - 1.0).abs() > 1e-6 {
                // Unit vectors, as they come from the network, stay what they are, bit for bit.
                let scale = 1.0 / sqrtf(squared);
                (*x, *y, *z) = (scale * *x, scale * *y, scale * *z);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projection_renormalises_and_turns_zero_up() {
        let mut map = [0.6, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.4, 0.8, 0.0, 0.4, 1.0];
        let planes = [0.0; 12];
        Normal { size: 2, normal: &planes, albedo: &planes }.project(&mut map);
        let vector = |i: usize| [map[i], map[4 + i], map[8 + i]];
        assert_eq!(vector(0), [0.6, 0.0, 0.8]);
        assert_eq!(vector(1), [0.0, 0.0, 1.0]);
        assert!((vector(2)[0] - 0.6).abs() < 1e-6 && (vector(2)[2] - 0.8).abs() < 1e-6);
        let [x, y, z] = vector(3);
        assert!((x * x + y * y + z * z - 1.0).abs() < 1e-6 && y < z);
    }
}
