//! Occlusion, roughness and metallic in one picture (R, G, B), and what a material's F0 means in glTF.
use crate::{Error, Pictures};
use alloc::vec;
use alloc::vec::Vec;
use flashmat_core::brdf::{self, F0_DIELECTRIC};

/// Metal or not, and the index of refraction of what is not.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// A metal: its reflectance at normal incidence is its base colour.
    pub metallic: bool,
    /// Index of refraction; of a metal, that of F0 = 0.05, which nothing reads.
    pub ior: f32,
}

impl Surface {
    /// What a capture's F0 says: it is blended by the probability of metal, or by the class that the caller gave, and
    /// half-way to a metal's is a metal.
    ///
    /// # Errors
    /// [`Error::Reflectance`] unless `f0` is in [0, 1).
    pub fn of_f0(f0: f32) -> Result<Self, Error> {
        if !(0.0..1.0).contains(&f0) {
            return Err(Error::Reflectance);
        }
        let metallic = f0 >= brdf::f0(0.5);
        // F0 = ((n - 1) / (n + 1))², solved for n.
        let root = libm::sqrtf(if metallic { F0_DIELECTRIC } else { f0 });
        Ok(Self { metallic, ior: (1.0 + root) / (1.0 - root) })
    }

    /// The code of metallic: 0 or 255.
    #[must_use]
    pub fn metallic_code(&self) -> u8 {
        if self.metallic { u8::MAX } else { 0 }
    }
}

/// Packs rows: `pack(y, out)` fills 3 * size codes. Occlusion is white: a flat sample shades nothing.
pub(crate) fn packer(
    pictures: Pictures<'_>,
    surface: Surface,
) -> impl FnMut(usize, &mut [u8]) -> Result<(), Error> {
    let metallic = surface.metallic_code();
    let mut roughness: Vec<u8> = vec![0; pictures.size()];
    move |row, out| {
        pictures.roughness_row(row, &mut roughness)?;
        for (pixel, &roughness) in out.as_chunks_mut::<3>().0.iter_mut().zip(&roughness) {
            *pixel = [u8::MAX, roughness, metallic];
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_way_to_metal_is_metal() {
        for (probability, metallic) in [(0.0, false), (0.49, false), (0.5, true), (1.0, true)] {
            let surface = Surface::of_f0(brdf::f0(probability)).expect("in range");
            assert_eq!(surface.metallic, metallic, "P(metal) = {probability}");
        }
    }

    #[test]
    fn index_of_refraction_by_hand() {
        // Glass of 1.5: F0 = 0.04. (1 + sqrt 0.05) / (1 - sqrt 0.05) = 1.57601.
        for (f0, ior) in [(0.0, 1.0), (0.04, 1.5), (0.05, 1.576_01), (0.5, 1.576_01)] {
            let surface = Surface::of_f0(f0).expect("in range");
            assert!((surface.ior - ior).abs() < 1e-5, "{f0}: {}", surface.ior);
        }
        for f0 in [f32::NAN, -0.01, 1.0, f32::INFINITY] {
            assert_eq!(Surface::of_f0(f0), Err(Error::Reflectance), "{f0}");
        }
    }
}
