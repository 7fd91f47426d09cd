//! The CRFs against their oracle and their promises; inputs are seeded, and failures print the seed.
mod gradient;
mod oracle;
mod promises;
mod speed;

use super::{Albedo, Normal, Roughness};
use crate::math::sqrtf;
use std::vec;
use std::vec::Vec;

/// SplitMix64.
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [0,1).
    pub(super) fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / 16_777_216.0
    }

    pub(super) fn plane(&mut self, len: usize) -> Vec<f32> {
        (0..len).map(|_| self.unit()).collect()
    }
}

/// Everything that the three CRFs read.
pub(super) struct Scene {
    pub(super) size: usize,
    pub(super) photo: Vec<f32>,
    pub(super) albedo: Vec<f32>,
    pub(super) normal: Vec<f32>,
    pub(super) roughness: Vec<f32>,
    pub(super) search: Vec<f32>,
    pub(super) observability: Vec<f32>,
}

impl Scene {
    /// White noise in every plane.
    pub(super) fn random(size: usize, seed: u64) -> Self {
        let (mut random, n) = (Random(seed), size * size);
        let mut normal: Vec<f32> = random.plane(3 * n).iter().map(|v| v - 0.5).collect();
        unit_length(&mut normal, n);
        Self {
            size,
            photo: random.plane(3 * n),
            albedo: random.plane(3 * n),
            normal,
            roughness: random.plane(n),
            search: random.plane(n),
            observability: random.plane(n),
        }
    }

    /// Something like a tiled floor with a grain, under a flash whose highlight is burnt out, and a network's noisy
    /// idea of it.
    pub(super) fn tiles(size: usize, seed: u64) -> Self {
        let (mut random, n) = (Random(seed), size * size);
        let mut scene = Self::random(size, seed ^ 1);
        let colours: Vec<[f32; 3]> = (0..16)
            .map(|_| [0.15 + 0.6 * random.unit(), 0.15 + 0.5 * random.unit(), 0.1 + 0.4 * random.unit()])
            .collect();
        for i in 0..n {
            let (u, v) = ((i % size) as f32 / size as f32, (i / size) as f32 / size as f32);
            let (s, t) = (u + 0.05 * (9.0 * v).sin(), v + 0.04 * (7.0 * u).cos());
            let tile = (s * 4.0).floor() as usize % 4 + 4 * ((t * 4.0).floor() as usize % 4);
            let joint = (s * 4.0).fract() < 0.08 || (t * 4.0).fract() < 0.08;
            let grain = 0.85 + 0.15 * (60.0 * s + 8.0 * (11.0 * t).sin()).sin() * (40.0 * t).cos();
            let p2 = super::feature::radius_squared(i % size, i / size, size);
            let falloff = 1.0 / (1.0 + 0.16 * p2).powi(2);
            let shine = 1.2 * (-p2 / 0.02).exp();
            let tilt = if joint { 0.4 } else { 0.05 };
            let direction = [tilt * (50.0 * s).sin(), tilt * (50.0 * t).cos(), 1.0];
            let length = sqrtf(direction.iter().map(|d| d * d).sum());
            for c in 0..3 {
                let colour = if joint { 0.08 } else { colours[tile][c] * grain };
                let photo = colour * falloff + shine + 0.01 * (random.unit() - 0.5);
                scene.photo[c * n + i] = photo.clamp(0.0, 1.0);
                let wrong = 0.3 * (-p2 / 0.03).exp();
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
    pub(super) fn constant(size: usize, seed: u64) -> Self {
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

    pub(super) fn albedo(&self) -> Albedo<'_> {
        Albedo { size: self.size, photo: &self.photo, albedo: &self.albedo }
    }

    pub(super) fn normal(&self) -> Normal<'_> {
        Normal { size: self.size, normal: &self.normal, albedo: &self.albedo }
    }

    pub(super) fn roughness(&self) -> Roughness<'_> {
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

/// Workspace for a CRF of `E`, full of numbers that a read of unwritten memory would show.
pub(super) fn workspace<E: super::Energy<N>, const N: usize>(size: usize) -> Vec<u8> {
    vec![0x7f; super::workspace_bytes::<E, N>(size)]
}

/// |a - b| / |b|.
pub(super) fn relative_error(a: &[f32], b: &[f32]) -> f64 {
    let square = |v: f64| v * v;
    let error: f64 = a.iter().zip(b).map(|(a, b)| square(f64::from(*a) - f64::from(*b))).sum();
    let norm: f64 = b.iter().map(|b| square(f64::from(*b))).sum();
    (error / norm).sqrt()
}
