//! Captured maps under any light, by the core's renderer.
use crate::material::{Material, OwnedMaps};
use flashmat_core::Error;
use flashmat_core::base::exec::Inline;
use flashmat_core::brdf::{self, Light, Scene};
use flashmat_core::frame::LinearImage;
use flashmat_core::search;
use glam::Vec3;

/// Where the sheet's second light stands: to the left and a little above, lower than the flash.
const SIDE: Vec3 = Vec3::new(-0.75, 0.4, 0.6);

/// The maps under a point light at `light` (plane units): 3 planes of linear radiance.
pub(crate) fn relight(
    maps: &OwnedMaps,
    f0: f32,
    fov_deg: f32,
    light: Vec3,
    strength: f32,
) -> Result<Vec<f32>, Error> {
    let mut out = vec![0.0; maps.albedo.len()];
    let scene = Scene { fov_deg, light: Light { position: light, strength } };
    brdf::render(&maps.view(), f0, &scene, &Inline, &mut out)?;
    Ok(out)
}

/// The material under a light from the left, as strong at the centre of a flat matt plane as the photo's.
pub(crate) fn from_the_side(material: &Material) -> Result<Vec<f32>, Error> {
    let strength = material.brightness() * strength_at_centre(SIDE);
    relight(&material.maps, material.f0, material.fov_deg, SIDE, strength)
}

/// The strength that gives a flat white Lambertian at the centre radiance 1 under a light at `light`.
pub(crate) fn strength_at_centre(light: Vec3) -> f32 {
    light.length().powi(3) / light.z
}

/// RMSE of two pictures (3 planes, linear), gamma 2.2, as the residual has it.
pub(crate) fn picture_error(wanted: &[f32], got: &[f32], size: usize, fov_deg: f32) -> Result<f32, Error> {
    let clipped = vec![0; size * size];
    let photo = LinearImage::new(size, wanted, &clipped, fov_deg);
    search::residual(&photo, got, &Inline)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flat_white_plane_is_white_at_the_centre_wherever_the_light_is() {
        let maps =
            OwnedMaps { size: 1, albedo: vec![1.0; 3], normal: vec![0.0, 0.0, 1.0], roughness: vec![1.0] };
        for light in [Vec3::Z, Vec3::new(-0.75, 0.4, 0.6), Vec3::new(0.0, 2.0, 0.5)] {
            let out = relight(&maps, 0.0, 43.35, light, strength_at_centre(light)).expect("scene");
            // What is left above 1 is the Fresnel term's share, none at F0 = 0 and these angles but a little.
            assert!((out[0] - 1.0).abs() < 0.02, "{light}: {}", out[0]);
        }
    }
}
