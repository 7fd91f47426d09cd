//! What one gets without a network: guesses, and a classical estimate from the photo alone.
use crate::engine::light;
use crate::mapset;
use crate::material::OwnedMaps;
use crate::metrics::mean;
use crate::photo::Photo;
use flashmat_core::brdf::F0_DIELECTRIC;
use flashmat_core::frame::Encoding;
use flashmat_core::net::Class;
use flashmat_core::{Error, frame::FieldOfView};
use glam::Vec3;

const FOV: f32 = FieldOfView::TARGET_DEG;
/// Mean albedo and roughness of the training materials (train/flashmat_train/training/validate.py).
const MEAN_ALBEDO: f32 = 0.22;
const MEAN_ROUGHNESS: f32 = 0.6;
/// A channel at or above this is taken for clipped.
const CLIPPED: f32 = 0.99;
/// Height per unit of log albedo, in pixels of a 256² photo, of the classical estimate ("dark is deep").
const DEPTH: f32 = 0.5;

/// A way to get at maps without a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Baseline {
    /// The same for every photo: mean albedo and roughness of the training materials, flat.
    Constants,
    /// The photo's mean colour, flat, roughness 0.5.
    Colour,
    /// Albedo = photo without the fitted highlight, over falloff; normals from its gradients; one fitted roughness.
    Classical,
}

impl Baseline {
    pub(super) const ALL: [Self; 3] = [Self::Constants, Self::Colour, Self::Classical];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Constants => "constants",
            Self::Colour => "mean colour",
            Self::Classical => "classical",
        }
    }

    /// The maps that it says the photo shows.
    pub(super) fn maps(self, photo: &Photo, size: usize) -> Result<OwnedMaps, Error> {
        let rgb = mapset::planes(photo, Encoding::Srgb, size)?;
        let pixels = size * size;
        let flat = [vec![0.0; 2 * pixels], vec![1.0; pixels]].concat();
        match self {
            Self::Constants => Ok(OwnedMaps {
                size,
                albedo: vec![MEAN_ALBEDO; 3 * pixels],
                normal: flat,
                roughness: vec![MEAN_ROUGHNESS; pixels],
            }),
            Self::Colour => {
                let albedo = rgb.chunks_exact(pixels).flat_map(|plane| {
                    let colour = mean(plane.iter().map(|&v| f64::from(v.min(1.0)))) as f32;
                    std::iter::repeat_n(colour, pixels)
                });
                Ok(OwnedMaps { size, albedo: albedo.collect(), normal: flat, roughness: vec![0.5; pixels] })
            }
            Self::Classical => classical(&rgb, size, flat),
        }
    }
}

/// The commonest class among `classes`.
pub(super) fn commonest(classes: impl Iterator<Item = Class> + Clone) -> Class {
    let count = |class: &Class| classes.clone().filter(|c| c == class).count();
    Class::ALL.into_iter().max_by_key(count).unwrap_or(Class::Wood)
}

fn classical(rgb: &[f32], size: usize, flat: Vec<f32>) -> Result<OwnedMaps, Error> {
    let pixels = size * size;
    let clipped: Vec<bool> =
        (0..pixels).map(|i| (0..3).any(|c| rgb.get(c * pixels + i).is_some_and(|&v| v >= CLIPPED))).collect();
    let falloff = falloff(size);
    let mut plane =
        OwnedMaps { size, albedo: vec![0.0; 3 * pixels], normal: flat, roughness: vec![0.0; pixels] };
    // The roughness whose highlight on an even, flat plane leaves least of the photo unexplained.
    let mut best = (f64::INFINITY, 0.0_f32, Vec::new());
    for step in 1..=16_u8 {
        let roughness = f32::from(step) / 16.0;
        plane.roughness.fill(roughness);
        let highlight = light::relight(&plane, F0_DIELECTRIC, FOV, Vec3::Z, 1.0)?;
        let error = unexplained(rgb, &highlight, &falloff, &clipped);
        if error < best.0 {
            best = (error, roughness, highlight);
        }
    }
    let (_, roughness, highlight) = best;
    let mut albedo: Vec<f32> = rgb
        .iter()
        .zip(&highlight)
        .zip(falloff.iter().cycle())
        .map(|((photo, highlight), falloff)| ((photo - highlight).max(0.0) / falloff).min(1.0))
        .collect();
    fill_clipped(&mut albedo, &clipped);
    let normal = normals(&albedo, size);
    Ok(OwnedMaps { size, albedo, normal, roughness: vec![roughness; pixels] })
}

/// Radiance of a flat white Lambertian under the flash: the cube of the cosine at each point.
fn falloff(size: usize) -> Vec<f32> {
    let t = (FOV.to_radians() / 2.0).tan();
    let p = |i: usize| ((i as f32 + 0.5) * 2.0 / size as f32 - 1.0) * t;
    (0..size * size).map(|i| (1.0 + p(i % size).powi(2) + p(i / size).powi(2)).powf(-1.5)).collect()
}

/// Squared error of photo = colour x falloff + highlight, the colour being the best one, where nothing is clipped.
fn unexplained(rgb: &[f32], highlight: &[f32], falloff: &[f32], clipped: &[bool]) -> f64 {
    let pixels = falloff.len();
    let planes = rgb.chunks_exact(pixels).zip(highlight.chunks_exact(pixels));
    planes
        .map(|(photo, highlight)| {
            let (mut ff, mut fd, mut dd) = (0.0_f64, 0.0_f64, 0.0_f64);
            for (((photo, highlight), falloff), _) in
                photo.iter().zip(highlight).zip(falloff).zip(clipped).filter(|(_, clipped)| !**clipped)
            {
                let (f, d) = (f64::from(*falloff), f64::from(photo - highlight));
                ff += f * f;
                fd += f * d;
                dd += d * d;
            }
            dd - fd.max(0.0).powi(2) / ff.max(1e-12)
        })
        .sum()
}

/// Clipped pixels get the mean of the others.
fn fill_clipped(planes: &mut [f32], clipped: &[bool]) {
    for plane in planes.chunks_exact_mut(clipped.len()) {
        let kept = plane.iter().zip(clipped).filter(|(_, clipped)| !**clipped);
        let colour = mean(kept.map(|(&v, _)| f64::from(v))) as f32;
        for (value, _) in plane.iter_mut().zip(clipped).filter(|(_, clipped)| **clipped) {
            *value = colour;
        }
    }
}

/// Normals of the height `DEPTH` x log albedo, by central differences.
fn normals(albedo: &[f32], size: usize) -> Vec<f32> {
    let pixels = size * size;
    let scale = DEPTH * size as f32 / 256.0;
    let grey = |x: usize, y: usize| {
        let sum: f32 = (0..3).filter_map(|c| albedo.get(c * pixels + y * size + x)).sum();
        scale * (sum / 3.0 + 0.01).ln()
    };
    let mut normal = vec![0.0; 3 * pixels];
    for i in 0..pixels {
        let (x, y) = (i % size, i / size);
        let dx = (grey((x + 1).min(size - 1), y) - grey(x.saturating_sub(1), y)) / 2.0;
        // Rows run down, y runs up.
        let dy = (grey(x, y.saturating_sub(1)) - grey(x, (y + 1).min(size - 1))) / 2.0;
        let n = Vec3::new(-dx, -dy, 1.0).normalize();
        for (c, value) in n.to_array().into_iter().enumerate() {
            if let Some(slot) = normal.get_mut(c * pixels + i) {
                *slot = value;
            }
        }
    }
    normal
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An even, flat, glossy plane under the flash is what the classical estimate assumes: it must find it.
    #[test]
    fn the_classical_estimate_finds_an_even_plane() {
        let size = 64;
        let pixels = size * size;
        let plane = OwnedMaps {
            size,
            albedo: [vec![0.4; pixels], vec![0.3; pixels], vec![0.2; pixels]].concat(),
            normal: [vec![0.0; 2 * pixels], vec![1.0; pixels]].concat(),
            roughness: vec![0.5; pixels],
        };
        let radiance = light::relight(&plane, F0_DIELECTRIC, FOV, Vec3::Z, 1.0).expect("render");
        let photo = Photo::of_radiance(&radiance, size).expect("photo");
        let found = Baseline::Classical.maps(&photo, size).expect("maps");
        assert_eq!(found.roughness[0], 0.5);
        let worst = found.albedo.iter().zip(&plane.albedo).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 0.02, "{worst}");
        assert!(found.normal[2 * pixels..].iter().all(|&z| z > 0.98));
        let constants = Baseline::Constants.maps(&photo, size).expect("maps");
        assert_eq!((constants.albedo[7], constants.roughness[9]), (MEAN_ALBEDO, MEAN_ROUGHNESS));
    }

    /// A bump that is brighter towards its top: normals lean away from it on all sides.
    #[test]
    fn normals_lean_away_from_bright_bumps() {
        let n = 16;
        let bump = |i: usize| {
            let (x, y) = ((i % n) as f32 - 7.5, (i / n) as f32 - 7.5);
            (-(x * x + y * y) / 20.0).exp() * 0.5 + 0.2
        };
        let albedo: Vec<f32> = (0..3 * n * n).map(|i| bump(i % (n * n))).collect();
        let normal = normals(&albedo, n);
        let at = |x: usize, y: usize, c: usize| normal[c * n * n + y * n + x];
        assert!(at(11, 7, 0) > 0.0 && at(4, 7, 0) < 0.0);
        assert!(at(7, 4, 1) > 0.0 && at(7, 11, 1) < 0.0);
    }
}
