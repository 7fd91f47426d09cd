//! Procedural inputs of the CRFs and the search, seeded, for tests and benches.
use super::feature::radius_squared;
use super::{Albedo, Normal, Roughness};
use crate::base::math::{cosf, expf, floorf, sinf, sqrtf};
use crate::frame::LinearImage;
use alloc::vec;
use alloc::vec::Vec;

/// Field of view of the scenes, in degrees.
pub const FOV: f32 = 43.35;

/// SplitMix64.
#[derive(Clone, Debug)]
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

    /// `len` such values.
    pub fn plane(&mut self, len: usize) -> Vec<f32> {
        (0..len).map(|_| self.unit()).collect()
    }
}

/// Everything that the three CRFs and the search read; planes one after the other.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Pixels per side.
    pub size: usize,
    /// 3 planes, linear, at most 1.
    pub photo: Vec<f32>,
    /// Bit c where channel c of the photo is burnt out.
    pub clipped: Vec<u8>,
    /// 3 planes.
    pub albedo: Vec<f32>,
    /// 3 planes.
    pub normal: Vec<f32>,
    /// The network's roughness, 1 plane.
    pub roughness: Vec<f32>,
    /// The search's roughness, 1 plane.
    pub search: Vec<f32>,
    /// 1 plane.
    pub observability: Vec<f32>,
}

impl Scene {
    /// White noise in every plane.
    #[must_use]
    pub fn random(size: usize, seed: u64) -> Self {
        let (mut random, n) = (Random(seed), size * size);
        let mut normal: Vec<f32> = random.plane(3 * n).iter().map(|v| v - 0.5).collect();
        unit_length(&mut normal, n);
        Self {
            size,
            photo: random.plane(3 * n),
            clipped: vec![0; n],
            albedo: random.plane(3 * n),
            normal,
            roughness: random.plane(n),
            search: random.plane(n),
            observability: random.plane(n),
        }
    }

    /// Something like a tiled floor with a grain, under a flash whose highlight is burnt out, and a network's noisy
    /// idea of it.
    #[must_use]
    pub fn tiles(size: usize, seed: u64) -> Self {
        let (mut random, n) = (Random(seed), size * size);
        let mut scene = Self::random(size, seed ^ 1);
        let colours: Vec<[f32; 3]> = (0..16)
            .map(|_| [0.15 + 0.6 * random.unit(), 0.15 + 0.5 * random.unit(), 0.1 + 0.4 * random.unit()])
            .collect();
        let part = |v: f32| v - floorf(v);
        for i in 0..n {
            let (u, v) = ((i % size) as f32 / size as f32, (i / size) as f32 / size as f32);
            let (s, t) = (u + 0.05 * sinf(9.0 * v), v + 0.04 * cosf(7.0 * u));
            let tile = floorf(s * 4.0) as usize % 4 + 4 * (floorf(t * 4.0) as usize % 4);
            let joint = part(s * 4.0) < 0.08 || part(t * 4.0) < 0.08;
            let grain = 0.85 + 0.15 * sinf(60.0 * s + 8.0 * sinf(11.0 * t)) * cosf(40.0 * t);
            let p2 = radius_squared(i % size, i / size, size);
            let distance2 = 1.0 + 0.16 * p2;
            let falloff = 1.0 / (distance2 * distance2);
            let shine = 1.2 * expf(-p2 / 0.02);
            let tilt = if joint { 0.4 } else { 0.05 };
            let direction = [tilt * sinf(50.0 * s), tilt * cosf(50.0 * t), 1.0];
            let length = sqrtf(direction.iter().map(|d| d * d).sum());
            for c in 0..3 {
                let colour = if joint { 0.08 } else { colours[tile][c] * grain };
                let photo = colour * falloff + shine + 0.01 * (random.unit() - 0.5);
                scene.photo[c * n + i] = photo.clamp(0.0, 1.0);
                scene.clipped[i] |= u8::from(photo >= 1.0) << c;
                let wrong = 0.3 * expf(-p2 / 0.03);
                scene.albedo[c * n + i] = (colour + wrong + 0.06 * (random.unit() - 0.5)).clamp(0.0, 1.0);
                scene.normal[c * n + i] = direction[c] / length + 0.1 * (random.unit() - 0.5);
            }
            let roughness = if joint { 0.8 } else { 0.2 + 0.05 * tile as f32 / 2.0 };
            scene.roughness[i] = (roughness + 0.2 * (random.unit() - 0.5)).clamp(0.0, 1.0);
            scene.search[i] = (roughness + 0.4 * (random.unit() - 0.5)).clamp(0.0, 1.0);
        }
        unit_length(&mut scene.normal, n);
        scene
    }

    /// The same value everywhere in every map.
    #[must_use]
    pub fn constant(size: usize, seed: u64) -> Self {
        let mut scene = Self::random(size, seed);
        let mut random = Random(seed);
        let n = size * size;
        for plane in scene.albedo.chunks_exact_mut(n).chain(scene.roughness.chunks_exact_mut(n)) {
            plane.fill(random.unit());
        }
        scene.search = scene.roughness.clone();
        for (plane, value) in scene.normal.chunks_exact_mut(n).zip([0.36, -0.48, 0.8]) {
            plane.fill(value);
        }
        scene
    }

    /// What the search compares renders with.
    #[must_use]
    pub fn image(&self) -> LinearImage<'_> {
        LinearImage::new(self.size, &self.photo, &self.clipped, FOV)
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

    /// Inputs of the roughness' CRF.
    #[must_use]
    pub fn roughness(&self) -> Roughness<'_> {
        Roughness {
            size: self.size,
            photo: &self.photo,
            albedo: &self.albedo,
            network: &self.roughness,
            search: &self.search,
            observability: Some(&self.observability),
        }
    }
}

fn unit_length(planes: &mut [f32], n: usize) {
    for i in 0..n {
        let length = sqrtf((0..3).map(|c| planes[c * n + i] * planes[c * n + i]).sum());
        for c in 0..3 {
            planes[c * n + i] /= length.max(1e-6);
        }
    }
}
