//! The terms of the microfacet model: the paper's appendix "Microfacet BRDF Model", equation by equation.
//!
//! The appendix does not number its equations; here (1) is the whole model, (2) D, (3) alpha, (4) F, (5) G, (6) k,
//! (7) and (8) G1 of v and l, (9) and (10) F0 of dielectrics and conductors. Slips corrected: (8) has n.v in its
//! denominator where n.l belongs; (10) is upside down.
use crate::base::math::approx::exp2;
use core::f32::consts::PI;

/// Smallest alpha: below it (r < 0.0316) the lobe is sharper than any pixel, and D would leave f32's good range.
pub const MIN_ALPHA: f32 = 1e-3;

/// Eq. (3): alpha = r², clamped to [[`MIN_ALPHA`], 1].
#[must_use]
#[inline(always)]
pub fn alpha(roughness: f32) -> f32 {
    (roughness * roughness).clamp(MIN_ALPHA, 1.0)
}

/// Eq. (2): D = alpha² / (pi ((n.h)² (alpha² - 1) + 1)²), GGX.
///
/// Takes both cos² and sin² of the angle between n and h and uses the equal form sin² + cos² alpha²: next to the
/// peak, 1 - cos² has no digits left.
#[must_use]
#[inline(always)]
pub fn distribution(cos2: f32, sin2: f32, alpha: f32) -> f32 {
    let alpha2 = alpha * alpha;
    let root = sin2 + cos2 * alpha2;
    alpha2 / (PI * root * root)
}

/// Eq. (4): F = F0 + (1 - F0) 2^((-5.55473 v.h - 6.98316) v.h), the Gaussian form of Schlick's Fresnel term.
#[must_use]
#[inline(always)]
pub fn fresnel(v_dot_h: f32, f0: f32) -> f32 {
    f0 + (1.0 - f0) * exp2((-5.55473 * v_dot_h - 6.98316) * v_dot_h)
}

/// Eq. (6): k = (r + 1)² / 8.
#[must_use]
#[inline(always)]
pub fn k(roughness: f32) -> f32 {
    (roughness + 1.0) * (roughness + 1.0) / 8.0
}

/// Eq. (7) and (8): G1 = n.x / (n.x (1 - k) + k), for x = v and x = l alike.
#[must_use]
#[inline(always)]
pub fn shadowing(n_dot_x: f32, k: f32) -> f32 {
    n_dot_x * visibility(n_dot_x, k)
}

/// G1 / n.x: what is left of eq. (7) and (8) after the n.l and n.v below the whole model are cancelled; finite at
/// grazing angles.
#[must_use]
#[inline(always)]
pub fn visibility(n_dot_x: f32, k: f32) -> f32 {
    1.0 / (n_dot_x * (1.0 - k) + k)
}

/// Eq. (5): G = G1(v) G1(l).
#[must_use]
#[inline(always)]
pub fn geometry(n_dot_l: f32, n_dot_v: f32, roughness: f32) -> f32 {
    let k = k(roughness);
    shadowing(n_dot_v, k) * shadowing(n_dot_l, k)
}

/// Eq. (9): F0 of a dielectric of refractive index `eta`.
#[must_use]
pub fn f0_dielectric(eta: f32) -> f32 {
    f0_conductor(eta, 0.0)
}

/// Eq. (10), turned over: F0 of a conductor, ((eta - 1)² + kappa²) / ((eta + 1)² + kappa²).
#[must_use]
pub fn f0_conductor(eta: f32, kappa: f32) -> f32 {
    let square = |x: f32| x * x;
    (square(eta - 1.0) + square(kappa)) / (square(eta + 1.0) + square(kappa))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(a: f32, b: f32) {
        assert!((a - b).abs() <= 2e-6 * b.abs().max(1e-3), "{a} is not {b}");
    }

    #[test]
    fn distribution_by_hand() {
        // r = 1: alpha = 1, D = 1/pi everywhere.
        near(distribution(0.3, 0.7, alpha(1.0)), 0.318_309_87);
        // r² = 1/2, alpha² = 1/4. At n.h = 1: (1/4) / (pi/16) = 4/pi.
        near(distribution(1.0, 0.0, 0.5), 1.273_239_5);
        // At (n.h)² = 1/2: 1/2 (1/4 - 1) + 1 = 5/8; (1/4) / (pi 25/64) = 16/(25 pi).
        near(distribution(0.5, 0.5, 0.5), 0.203_718_33);
        // Roughness nothing: alpha = 1e-3, peak 1e6/pi.
        near(distribution(1.0, 0.0, alpha(0.0)), 318_309.88);
    }

    #[test]
    fn fresnel_by_hand() {
        // Head on: 2^-12.53789 = 1.6818e-4 above F0, times 1 - F0.
        near(fresnel(1.0, 0.05), 0.05 + 0.95 * 1.681_757e-4);
        // v.h = 1/2: exponent -(2.777365 + 6.98316)/2 = -4.8802625; 2^-4.8802625 = 0.0339553.
        assert!((fresnel(0.5, 0.0) - 0.033_955).abs() < 1e-5);
        near(fresnel(0.0, 0.05), 1.0);
        // Within 1 % of a unit of Schlick's (1 - v.h)^5.
        for i in 0..=100 {
            let c = i as f32 / 100.0;
            assert!((fresnel(c, 0.05) - (0.05 + 0.95 * (1.0 - c).powi(5))).abs() < 0.01);
        }
    }

    #[test]
    fn geometry_by_hand() {
        // r = 1: k = 1/2. n.x = 1/2: (1/2) / (3/4) = 2/3; both: 4/9.
        near(k(1.0), 0.5);
        near(shadowing(0.5, 0.5), 2.0 / 3.0);
        near(geometry(0.5, 0.5, 1.0), 4.0 / 9.0);
        // r = 0: k = 1/8. n.l = 1 gives 1; n.v = 1/8: (1/8) / (7/64 + 8/64) = 8/15.
        near(geometry(1.0, 0.125, 0.0), 8.0 / 15.0);
        // The slip: the two directions are each shadowed by their own angle.
        near(geometry(0.125, 1.0, 0.0), geometry(1.0, 0.125, 0.0));
        assert_eq!(geometry(0.0, 1.0, 0.5), 0.0);
    }

    #[test]
    fn f0_by_hand() {
        near(f0_dielectric(1.5), 0.04);
        // Aluminium at 550 nm: eta 1.0, kappa 6.6: 43.56 / 47.56.
        near(f0_conductor(1.0, 6.6), 43.56 / 47.56);
        assert!(f0_conductor(0.2, 3.0) < 1.0);
    }
}
