//! The heads' non-linearities, from IEEE basic operations only, so that they vectorise and give the same bits
//! everywhere (`libm` is a call per value). Within 3e-7 of the exact functions.

/// 1.5 * 2^23: adding it to |x| < 2^22 leaves the nearest integer in the low bits.
const ROUND: f32 = 12_582_912.0;
/// Beyond it e^x leaves the normal range.
const LIMIT: f32 = 87.0;
/// Added to a normal's z, so that no normal is zero and none points backwards.
pub const NORMAL_Z_EPSILON: f32 = 1e-2;

/// e^x for |x| <= 87 (clamped; NaN gives e^-87): 2^n * e^r, |r| <= ln 2 / 2, Taylor's polynomial of degree 7.
#[inline(always)]
#[must_use]
fn exp(x: f32) -> f32 {
    let x = if x > LIMIT {
        LIMIT
    } else if x > -LIMIT {
        x
    } else {
        -LIMIT
    };
    let shifted = x * core::f32::consts::LOG2_E + ROUND;
    let n = shifted - ROUND;
    // ln 2 in two parts: the first has few bits, so that n times it is exact.
    let r = (x - n * 0.693_359_4) - n * -2.121_944_4e-4;
    let mut poly = 1.0 / 5040.0;
    for factor in [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0] {
        poly = poly * r + factor;
    }
    let power = shifted.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23;
    poly * f32::from_bits(power)
}

/// The logistic function.
#[inline(always)]
#[must_use]
pub(super) fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + exp(-x))
}

/// The hyperbolic tangent.
#[inline(always)]
#[must_use]
pub(super) fn tanh(x: f32) -> f32 {
    1.0 - 2.0 / (exp(2.0 * x) + 1.0)
}

/// Albedo and roughness: logits to [0,1], in place.
#[inline(always)]
pub(super) fn sigmoid_all(values: &mut [f32]) {
    for value in values {
        *value = sigmoid(*value);
    }
}

/// Normals: logits (a, b, c) to the unit vector along (tanh a, tanh b, sigmoid c + epsilon), in place.
#[inline(always)]
pub(super) fn normals(x: &mut [f32], y: &mut [f32], z: &mut [f32]) {
    for ((x, y), z) in x.iter_mut().zip(y.iter_mut()).zip(z.iter_mut()) {
        (*x, *y, *z) = (tanh(*x), tanh(*y), sigmoid(*z) + NORMAL_Z_EPSILON);
    }
    for ((x, y), z) in x.iter_mut().zip(y.iter_mut()).zip(z.iter_mut()) {
        let scale = inverse_sqrt(*x * *x + *y * *y + *z * *z);
        (*x, *y, *z) = (*x * scale, *y * scale, *z * scale);
    }
}

/// 1 / sqrt x for normal x > 0, within 2e-7 of it: a first guess from the exponent, three steps of Newton's method.
#[inline(always)]
#[must_use]
fn inverse_sqrt(x: f32) -> f32 {
    let mut y = f32::from_bits(0x5F37_5A86_u32.wrapping_sub(x.to_bits() >> 1));
    for _ in 0..3 {
        y *= 1.5 - 0.5 * x * y * y;
    }
    y
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn close_to_the_exact_functions() {
        let mut worst = (0.0_f64, 0.0_f64);
        for i in -120_000..=120_000 {
            let x = i as f32 * 1e-3;
            let exact = 1.0 / (1.0 + libm::exp(-f64::from(x)));
            worst.0 = worst.0.max((f64::from(sigmoid(x)) - exact).abs());
            worst.1 = worst.1.max((f64::from(tanh(x)) - libm::tanh(f64::from(x))).abs());
        }
        std::println!("sigmoid within {:.1e}, tanh within {:.1e}", worst.0, worst.1);
        assert!(worst.0 < 2e-7 && worst.1 < 3e-7);
    }

    #[test]
    fn close_to_the_exact_inverse_root() {
        let mut worst = 0.0_f64;
        // Squared lengths: from the epsilon's square to 1 + 1 + 1.01^2, and far beyond.
        for i in 0..400_000 {
            let x = libm::exp2f(i as f32 * 1e-4 - 20.0);
            let exact = 1.0 / libm::sqrt(f64::from(x));
            worst = worst.max((f64::from(inverse_sqrt(x)) / exact - 1.0).abs());
        }
        std::println!("1 / sqrt within {worst:.1e} of it");
        assert!(worst < 2e-7);
    }

    #[test]
    fn extremes_stay_in_range() {
        for x in [f32::INFINITY, f32::MAX, 1e4] {
            assert_eq!((sigmoid(x), tanh(x), tanh(-x)), (1.0, 1.0, -1.0));
            assert!((0.0..1e-30).contains(&sigmoid(-x)));
        }
        assert!((0.0..=1.0).contains(&sigmoid(f32::NAN)) && (-1.0..=1.0).contains(&tanh(f32::NAN)));
    }

    #[test]
    fn normals_are_unit_and_face_the_camera() {
        let (mut x, mut y, mut z) = ([0.0, 30.0, -0.3], [0.0, -30.0, 0.2], [0.0, -50.0, 2.0]);
        normals(&mut x, &mut y, &mut z);
        for i in 0..3 {
            assert!((x[i] * x[i] + y[i] * y[i] + z[i] * z[i] - 1.0).abs() < 1e-6 && z[i] > 0.0);
        }
        assert!(x[0] == 0.0 && y[0] == 0.0 && (z[0] - 1.0).abs() < 2e-7);
        // Against libm: (tanh -0.3, tanh 0.2, sigmoid 2 + 0.01) normalised.
        let v = [libm::tanh(-0.3), libm::tanh(0.2), 1.0 / (1.0 + libm::exp(-2.0)) + 0.01];
        let length = libm::sqrt(v.iter().map(|c| c * c).sum());
        assert!((f64::from(x[2]) - v[0] / length).abs() < 1e-6);
        assert!((f64::from(z[2]) - v[2] / length).abs() < 1e-6);
    }
}
