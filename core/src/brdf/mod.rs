//! How the material reflects, and the flash renderer. Source: the paper's appendix, "Microfacet BRDF Model".
//!
//! f = d / pi + D F G / (4 (n.l) (n.v)), linear RGB per steradian; radiance = f (n.l) E. The appendix's slips are
//! corrected: the diffuse term is d / pi, and the whole is multiplied by n.l and the light's falloff.
//!
//! The model is reciprocal: D depends on n.h, F on v.h = l.h, G is a product of one factor in n.l and the same factor
//! in n.v; all are symmetric in l and v (with the slip in G1(l) it would not be). It is not energy conserving as a
//! whole: the diffuse term is not reduced by what the specular term reflects, as in the paper. The specular lobe
//! alone never reflects more than it receives (tested by quadrature).
pub mod ggx;
mod render;

pub(crate) use render::Incident;
pub use render::{Light, Scene, render};

use crate::base::math::approx::rsqrt;
use core::f32::consts::PI;
use glam::Vec3;

/// F0 of everything but metals.
pub const F0_DIELECTRIC: f32 = 0.05;
/// F0 of metals.
pub const F0_METAL: f32 = 0.5;

/// F0 blended by the probability that the material is a metal.
#[must_use]
pub fn f0(metal: f32) -> f32 {
    F0_DIELECTRIC + (F0_METAL - F0_DIELECTRIC) * metal.clamp(0.0, 1.0)
}

/// The material at one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Diffuse colour d, linear RGB in [0,1].
    pub albedo: Vec3,
    /// Unit normal: x right, y up, z to the camera.
    pub normal: Vec3,
    /// Roughness r in [0,1]; alpha = r².
    pub roughness: f32,
    /// Specular reflectance at normal incidence.
    pub f0: f32,
}

impl Sample {
    /// f(l, v) in 1/sr for unit directions `light` and `view`; black when either is below the surface.
    #[must_use]
    pub fn evaluate(&self, light: Vec3, view: Vec3) -> Vec3 {
        if self.normal.dot(light) <= 0.0 || self.normal.dot(view) <= 0.0 {
            return Vec3::ZERO;
        }
        self.albedo / PI + Vec3::splat(self.specular(light, view))
    }

    /// D F G / (4 (n.l) (n.v)) alone, in 1/sr; 0 when either direction is below the surface.
    #[must_use]
    pub fn specular(&self, light: Vec3, view: Vec3) -> f32 {
        let Some(angles) = Angles::of(self.normal, light, view) else { return 0.0 };
        angles.specular(self.roughness, self.f0)
    }
}

/// What the specular term needs to know of n, l and v: all that does not depend on the roughness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Angles {
    /// n.l, in (0,1].
    pub n_dot_l: f32,
    /// n.v, in (0,1].
    pub n_dot_v: f32,
    /// v.h = l.h.
    pub v_dot_h: f32,
    /// (n.h)².
    pub cos2: f32,
    /// 1 - (n.h)², as |n x h|².
    pub sin2: f32,
}

impl Angles {
    /// The angles of unit vectors; `None` when the light or the viewer is below the surface (or not a number).
    #[must_use]
    #[inline]
    pub fn of(normal: Vec3, light: Vec3, view: Vec3) -> Option<Self> {
        let (angles, lit) = Self::anyhow(normal, light, view);
        lit.then_some(angles)
    }

    /// The angles, and whether they mean anything: without a branch, for loops over lanes.
    #[inline(always)]
    pub(crate) fn anyhow(normal: Vec3, light: Vec3, view: Vec3) -> (Self, bool) {
        let (n_dot_l, n_dot_v) = (normal.dot(light), normal.dot(view));
        let sum = light + view;
        let half = sum * rsqrt(sum.length_squared());
        let n_dot_h = normal.dot(half);
        let sin2 = normal.cross(half).length_squared();
        let angles = Self { n_dot_l, n_dot_v, v_dot_h: view.dot(half), cos2: n_dot_h * n_dot_h, sin2 };
        (angles, (n_dot_l > 0.0) & (n_dot_v > 0.0))
    }

    /// D F G / (4 (n.l) (n.v)), in 1/sr, with n.l and n.v cancelled so that grazing angles stay finite.
    #[must_use]
    #[inline(always)]
    pub fn specular(&self, roughness: f32, f0: f32) -> f32 {
        let k = ggx::k(roughness);
        let visibility = ggx::visibility(self.n_dot_l, k) * ggx::visibility(self.n_dot_v, k);
        let d = ggx::distribution(self.cos2, self.sin2, ggx::alpha(roughness));
        d * ggx::fresnel(self.v_dot_h, f0) * visibility * 0.25
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::PI as PI64;

    fn sample(roughness: f32, f0: f32) -> Sample {
        Sample { albedo: Vec3::new(0.5, 0.25, 0.125), normal: Vec3::Z, roughness, f0 }
    }

    fn direction(theta: f64, phi: f64) -> Vec3 {
        let (sin, cos) = theta.sin_cos();
        Vec3::new((sin * phi.cos()) as f32, (sin * phi.sin()) as f32, cos as f32)
    }

    #[test]
    fn the_whole_by_hand() {
        // Head on, r = 1: D = 1/pi, G = 1, F = 0.05016; f = d/pi + F/(4 pi).
        let f = sample(1.0, 0.05).evaluate(Vec3::Z, Vec3::Z) * PI;
        assert!((f - Vec3::new(0.5, 0.25, 0.125) - Vec3::splat(0.050_159_77 / 4.0)).length() < 1e-6, "{f}");
        // l and v 60 degrees to either side, r² = 1/2: h = n, D = 4/pi, v.h = 1/2, k = (1.70711)²/8 = 0.364277,
        // G1 = 0.5/0.682138 = 0.732989; F = 0.05 + 0.95 * 0.0339553 = 0.0822575;
        // D F G / (4 / 4) = 1.2732395 * 0.0822575 * 0.537273 = 0.0562701.
        let (s, c) = (0.75_f32.sqrt(), 0.5);
        let f = sample(0.5_f32.sqrt(), 0.05).specular(Vec3::new(s, 0.0, c), Vec3::new(-s, 0.0, c));
        assert!((f - 0.056_270).abs() < 2e-5, "{f}");
    }

    #[test]
    fn below_the_surface_is_black() {
        let s = sample(0.5, 0.05);
        assert_eq!(s.evaluate(-Vec3::Z, Vec3::Z), Vec3::ZERO);
        assert_eq!(s.evaluate(Vec3::Z, Vec3::X), Vec3::ZERO);
        assert_eq!(s.specular(Vec3::NAN, Vec3::Z), 0.0);
    }

    /// Directional albedo of the specular lobe with F0 = 1: the integral of f (n.l) over the hemisphere of l.
    ///
    /// Quadrature over half vectors (dl = 4 (v.h) dh) with theta_h = atan(alpha tan(pi/2 u)): follows the sharp lobe.
    #[test]
    fn the_specular_lobe_reflects_at_most_what_it_receives() {
        let (steps_u, steps_phi) = (600, 256);
        for roughness in [0.05_f32, 0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0] {
            let a = f64::from(ggx::alpha(roughness));
            for view_angle in [0.0_f64, 0.3, 0.6, 0.9, 1.2, 1.4, 1.5, 1.56] {
                let view = direction(view_angle, 0.0);
                let s = sample(roughness, 1.0);
                let (mut energy, mut facets) = (0.0, 0.0);
                for i in 0..steps_u {
                    let t = a * (PI64 / 2.0 * (f64::from(i) + 0.5) / f64::from(steps_u)).tan();
                    let theta = t.atan();
                    // dtheta/du
                    let d_theta = PI64 / 2.0 * (a * a + t * t) / (a * (1.0 + t * t)) / f64::from(steps_u);
                    for j in 0..steps_phi {
                        let phi = 2.0 * PI64 * (f64::from(j) + 0.5) / f64::from(steps_phi);
                        let half = direction(theta, phi);
                        let d_half = theta.sin() * d_theta * 2.0 * PI64 / f64::from(steps_phi);
                        let (cos2, sin2) = (theta.cos().powi(2) as f32, theta.sin().powi(2) as f32);
                        facets += f64::from(ggx::distribution(cos2, sin2, a as f32)) * theta.cos() * d_half;
                        let v_dot_h = view.dot(half);
                        let light = half * (2.0 * v_dot_h) - view;
                        if v_dot_h > 0.0 && light.z > 0.0 {
                            let f = f64::from(s.specular(light, view) * light.z);
                            energy += f * 4.0 * f64::from(v_dot_h) * d_half;
                        }
                    }
                }
                assert!((facets - 1.0).abs() < 1e-3, "r {roughness}: the integral of D (n.h) is {facets}");
                assert!(energy > 0.0 && energy <= 1.0, "r {roughness}, view {view_angle}: {energy}");
                // Closed form at r = 1, v = n: the integral of c / (1 + c) over c in [0,1] = 1 - ln 2.
                let exact = 1.0 - core::f64::consts::LN_2;
                assert!(roughness < 1.0 || view_angle > 0.0 || (energy - exact).abs() < 1e-4, "{energy}");
            }
        }
    }

    #[test]
    fn light_and_view_may_be_exchanged() {
        for roughness in [0.0, 0.2, 0.6, 1.0] {
            for (a, b, phi) in [(0.1, 1.2, 0.4), (0.7, 0.3, 2.0), (1.5, 1.0, 3.1), (0.0, 1.57, 0.0)] {
                let (l, v) = (direction(a, 0.3), direction(b, phi));
                let s = sample(roughness, 0.05);
                let (one, other) = (s.evaluate(l, v), s.evaluate(v, l));
                assert!((one - other).length() <= 1e-5 * one.length(), "{one} {other}");
            }
        }
    }

    #[test]
    fn finite_at_grazing_angles_and_without_roughness() {
        for roughness in [0.0, 1e-20, 1e-3, 0.5, 1.0] {
            for angle in [0.0, 1e-4, 0.5, 1.57, PI64 / 2.0 - 1e-6, PI64 / 2.0] {
                for phi in [0.0, 1.0, PI64] {
                    let f = sample(roughness, 0.5).evaluate(direction(angle, phi), direction(angle, 0.0));
                    assert!(f.is_finite() && f.min_element() >= 0.0, "{roughness} {angle}: {f}");
                }
            }
        }
    }

    #[test]
    fn f0_is_blended_by_the_metal_probability() {
        assert_eq!(f0(0.0), 0.05);
        assert_eq!(f0(1.0), 0.5);
        assert!((f0(0.5) - 0.275).abs() < 1e-7);
    }
}
