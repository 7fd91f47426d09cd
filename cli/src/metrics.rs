//! Errors of maps against the truth.
use crate::material::OwnedMaps;
use glam::Vec3;

/// Mean errors of one material's maps, or means over several.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct MapErrors {
    /// Mean squared error over pixels and channels, linear albedo in [0,1].
    pub(crate) albedo: f64,
    /// The same after the one factor on the guess that makes it least: no photo tells its exposure.
    pub(crate) albedo_scaled: f64,
    /// The same after both albedos were scaled to a mean pixel norm of 0.5 (the paper's Albedo-N).
    pub(crate) albedo_normalised: f64,
    /// Mean squared error over pixels and channels of unit vectors.
    pub(crate) normal: f64,
    /// Mean squared error over pixels, roughness in [0,1].
    pub(crate) roughness: f64,
    /// Mean angle between normals, in degrees.
    pub(crate) angle_deg: f64,
}

impl MapErrors {
    /// Compares maps of one size.
    pub(crate) fn between(truth: &OwnedMaps, guess: &OwnedMaps) -> Self {
        Self {
            albedo: mean_square(&truth.albedo, &guess.albedo),
            albedo_scaled: mean_square(&truth.albedo, &scaled(&guess.albedo, best_scale(truth, guess))),
            albedo_normalised: mean_square(&normalised(&truth.albedo), &normalised(&guess.albedo)),
            normal: mean_square(&truth.normal, &guess.normal),
            roughness: mean_square(&truth.roughness, &guess.roughness),
            angle_deg: mean(vectors(&truth.normal).zip(vectors(&guess.normal)).map(|(a, b)| {
                // atan2 keeps small angles exact, where acos does not.
                f64::from(a.cross(b).length()).atan2(f64::from(a.dot(b))).to_degrees()
            })),
        }
    }

    /// The paper's convention: albedo and roughness scaled to [-1,1], which makes squares four times as large; normals
    /// as they are.
    pub(crate) fn paper(&self) -> [f64; 3] {
        [4.0 * self.albedo, self.normal, 4.0 * self.roughness]
    }
}

fn mean_square(a: &[f32], b: &[f32]) -> f64 {
    mean(a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)))
}

/// The factor on the guess's albedo that makes its squared error least.
fn best_scale(truth: &OwnedMaps, guess: &OwnedMaps) -> f64 {
    let (mut gt, mut gg) = (0.0_f64, 0.0_f64);
    for (t, g) in truth.albedo.iter().zip(&guess.albedo) {
        gt += f64::from(*t) * f64::from(*g);
        gg += f64::from(*g) * f64::from(*g);
    }
    if gg > 0.0 { gt / gg } else { 1.0 }
}

fn scaled(values: &[f32], factor: f64) -> Vec<f32> {
    values.iter().map(|&v| (f64::from(v) * factor) as f32).collect()
}

/// Albedo planes scaled so that the mean over pixels of the colour's length is 0.5.
fn normalised(albedo: &[f32]) -> Vec<f32> {
    let norm = mean(vectors(albedo).map(|v| f64::from(v.length())));
    scaled(albedo, if norm > 0.0 { 0.5 / norm } else { 1.0 })
}

fn vectors(planes: &[f32]) -> impl Iterator<Item = Vec3> + '_ {
    let (x, rest) = planes.split_at(planes.len() / 3);
    let (y, z) = rest.split_at(rest.len() / 2);
    x.iter().zip(y).zip(z).map(|((&x, &y), &z)| Vec3::new(x, y, z))
}

/// Mean of values; 0 of none.
pub(crate) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), v| (sum + v, count + 1));
    sum / f64::from(count.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_match_hand_worked_values() {
        let truth = OwnedMaps {
            size: 1,
            albedo: vec![0.5, 0.5, 0.5],
            normal: vec![0.0, 0.0, 1.0],
            roughness: vec![0.25],
        };
        let s = 0.5_f32.sqrt();
        let guess = OwnedMaps {
            size: 1,
            albedo: vec![0.5, 0.75, 0.0],
            normal: vec![s, 0.0, s],
            roughness: vec![0.75],
        };
        let e = MapErrors::between(&truth, &guess);
        assert!((e.albedo - (0.0625 + 0.25) / 3.0).abs() < 1e-9);
        // |a - b|² = 2 - 2 cos 45° = 0.585786, over three channels.
        assert!((e.normal - 0.585_786 / 3.0).abs() < 1e-6);
        assert!((e.angle_deg - 45.0).abs() < 1e-4);
        assert_eq!(e.paper()[2], 1.0);
        // s = (0.5 x 0.5 + 0.5 x 0.75) / (0.25 + 0.5625); lengths sqrt(0.75) and sqrt(0.8125).
        let factor = 0.625 / 0.8125;
        let rest = |x: f64| (0.5 - factor * x).powi(2);
        assert!((e.albedo_scaled - (rest(0.5) + rest(0.75) + 0.25) / 3.0).abs() < 1e-7);
        let (t, g) = (0.5 / 0.75_f64.sqrt(), 0.5 / 0.8125_f64.sqrt());
        let squares = (0.5 * t - 0.5 * g).powi(2) + (0.5 * t - 0.75 * g).powi(2) + (0.5 * t).powi(2);
        assert!((e.albedo_normalised - squares / 3.0).abs() < 1e-7);
        assert_eq!(MapErrors::between(&truth, &truth), MapErrors::default());
        let mut dark = truth.clone();
        dark.albedo.iter_mut().for_each(|v| *v *= 0.25);
        let e = MapErrors::between(&truth, &dark);
        assert!(e.albedo > 0.1 && e.albedo_scaled < 1e-12 && e.albedo_normalised < 1e-12);
    }
}
