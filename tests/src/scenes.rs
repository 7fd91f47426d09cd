//! Procedural inputs of the stages behind the network, seeded.
use flashmat_core::crf::{Albedo, Normal, Roughness};
use flashmat_core::frame::LinearImage;

/// Field of view of the scenes, in degrees.
pub const FOV: f32 = 43.35;

/// SplitMix64.
#[derive(Clone, Copy, Debug)]
pub struct Random(pub u64);

impl Random {
    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0,1).
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / 16_777_216.0
    }
}

/// A photo and a network's noisy maps of it; planes one after the other.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Pixels per side.
    pub size: usize,
    /// 3 planes, linear, at most 1.
    pub photo: Vec<f32>,
    /// 1 where a channel of the photo is burnt out.
    pub clipped: Vec<u8>,
    /// 3 planes.
    pub albedo: Vec<f32>,
    /// 3 planes.
    pub normal: Vec<f32>,
    /// 1 plane.
    pub roughness: Vec<f32>,
}

impl Scene {
    /// A tiled floor with joints and grain under a flash whose highlight is burnt out.
    #[must_use]
    pub fn tiles(size: usize, seed: u64) -> Self {
        let (mut random, n) = (Random(seed), size * size);
        let mut scene = Self {
            size,
            photo: vec![0.0; 3 * n],
            clipped: vec![0; n],
            albedo: vec![0.0; 3 * n],
            normal: vec![0.0; 3 * n],
            roughness: vec![0.0; n],
        };
        let colours: Vec<[f32; 3]> = (0..16)
            .map(|_| [0.15 + 0.6 * random.unit(), 0.15 + 0.5 * random.unit(), 0.1 + 0.4 * random.unit()])
            .collect();
        for i in 0..n {
            let (u, v) = ((i % size) as f32 / size as f32, (i / size) as f32 / size as f32);
            let (s, t) = (u + 0.05 * (9.0 * v).sin(), v + 0.04 * (7.0 * u).cos());
            let tile = (s * 4.0).floor() as usize % 4 + 4 * ((t * 4.0).floor() as usize % 4);
            let joint = (s * 4.0).fract() < 0.08 || (t * 4.0).fract() < 0.08;
            let grain = 0.85 + 0.15 * (60.0 * s + 8.0 * (11.0 * t).sin()).sin() * (40.0 * t).cos();
            let p2 = (2.0 * u - 1.0).powi(2) + (2.0 * v - 1.0).powi(2);
            let falloff = 1.0 / (1.0 + 0.16 * p2).powi(2);
            let shine = 1.2 * (-p2 / 0.02).exp();
            let tilt = if joint { 0.4 } else { 0.05 };
            let noise = [random.unit() - 0.5, random.unit() - 0.5];
            let direction =
                [tilt * (50.0 * s).sin() + 0.1 * noise[0], tilt * (50.0 * t).cos() + 0.1 * noise[1], 1.0];
            let length = direction.iter().map(|d| d * d).sum::<f32>().sqrt();
            for c in 0..3 {
                let colour = if joint { 0.08 } else { colours[tile][c] * grain };
                let photo = colour * falloff + shine + 0.01 * (random.unit() - 0.5);
                scene.photo[c * n + i] = photo.clamp(0.0, 1.0);
                scene.clipped[i] |= u8::from(photo >= 1.0);
                let wrong = 0.3 * (-p2 / 0.03).exp();
                scene.albedo[c * n + i] = (colour + wrong + 0.06 * (random.unit() - 0.5)).clamp(0.0, 1.0);
                scene.normal[c * n + i] = direction[c] / length;
            }
            let roughness = if joint { 0.8 } else { 0.2 + 0.05 * tile as f32 / 2.0 };
            scene.roughness[i] = (roughness + 0.2 * (random.unit() - 0.5)).clamp(0.0, 1.0);
        }
        scene
    }

    /// The photo.
    #[must_use]
    pub fn photo(&self) -> LinearImage<'_> {
        LinearImage {
            size: self.size,
            rgb: &self.photo,
            clipped: &self.clipped,
            fov_deg: FOV,
            light_scale: None,
        }
    }

    /// Inputs of the albedo's CRF.
    #[must_use]
    pub fn albedo(&self) -> Albedo<'_> {
        Albedo { size: self.size, photo: &self.photo, albedo: &self.albedo }
    }

    /// Inputs of the normals' CRF.
    #[must_use]
    pub fn normal(&self) -> Normal<'_> {
        Normal { size: self.size, normal: &self.normal, albedo: &self.albedo }
    }

    /// Inputs of the roughness' CRF; the red albedo stands in for the search's roughness.
    #[must_use]
    pub fn roughness(&self) -> Roughness<'_> {
        Roughness {
            size: self.size,
            photo: &self.photo,
            albedo: &self.albedo,
            network: &self.roughness,
            search: &self.albedo[..self.size * self.size],
            observability: None,
        }
    }
}
