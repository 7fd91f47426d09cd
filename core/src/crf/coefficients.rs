//! The CRFs' learnable coefficients: one set per class, mixed with the class probabilities.

/// Classes, in the order of the network's probabilities.
pub const CLASSES: usize = 8;

/// Coefficients of a class, in the model file's order.
pub const COUNT: usize = 12;

/// The coefficients of the three CRFs. Each is at least 0; only their ratios within a CRF matter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coefficients {
    /// a0 (unary away from highlights), a1 (unary everywhere), b1 (position), b2 (position and the photo's colour),
    /// b3 (position and albedo).
    pub albedo: [f32; 5],
    /// a (unary), b1 (position), b2 (position and the albedo's gradient).
    pub normal: [f32; 3],
    /// a0 (the network's roughness), a1 (the search's), b1 (position), b2 (position and albedo).
    pub roughness: [f32; 4],
}

impl Default for Coefficients {
    /// Chosen by hand, mild: away from highlights a pixel's neighbourhood has about a tenth of the say in albedo and
    /// normal and a third in roughness, which is smoother in most materials; where the photo is burnt out, the
    /// neighbourhood decides.
    fn default() -> Self {
        Self {
            albedo: [1.0, 0.01, 0.005, 0.02, 0.03],
            normal: [1.0, 0.01, 0.03],
            roughness: [1.0, 0.25, 0.05, 0.2],
        }
    }
}

impl Coefficients {
    /// Every coefficient non-negative and every CRF's divided by their sum.
    #[must_use]
    pub fn normalised(&self) -> Self {
        Self {
            albedo: normalised(&self.albedo),
            normal: normalised(&self.normal),
            roughness: normalised(&self.roughness),
        }
    }

    /// The mean of the classes' normalised sets, weighted with the class probabilities; the default set when no
    /// probability is positive.
    #[must_use]
    pub fn mixed(sets: &[Self; CLASSES], probabilities: &[f32; CLASSES]) -> Self {
        let mut sum = [0.0_f32; COUNT];
        let mut total = 0.0_f32;
        for (set, &p) in sets.iter().zip(probabilities) {
            if p > 0.0 && p.is_finite() {
                total += p;
                for (sum, value) in sum.iter_mut().zip(set.normalised().to_array()) {
                    *sum += p * value;
                }
            }
        }
        if total > 0.0 { Self::from_array(&sum).normalised() } else { Self::default().normalised() }
    }

    /// Albedo, normal, roughness, one after the other.
    #[must_use]
    pub fn to_array(&self) -> [f32; COUNT] {
        let ([a0, a1, b1, b2, b3], [n, n1, n2], [r0, r1, s1, s2]) =
            (self.albedo, self.normal, self.roughness);
        [a0, a1, b1, b2, b3, n, n1, n2, r0, r1, s1, s2]
    }

    /// The inverse of [`Coefficients::to_array`].
    #[must_use]
    pub fn from_array(values: &[f32; COUNT]) -> Self {
        let &[a0, a1, b1, b2, b3, n, n1, n2, r0, r1, s1, s2] = values;
        Self { albedo: [a0, a1, b1, b2, b3], normal: [n, n1, n2], roughness: [r0, r1, s1, s2] }
    }
}

/// Coefficients divided by their sum; negative, infinite and NaN ones count as 0. All 0: the first is 1.
#[must_use]
pub fn normalised<const N: usize>(coefficients: &[f32; N]) -> [f32; N] {
    let clean = coefficients.map(|c| if c > 0.0 && c.is_finite() { c } else { 0.0 });
    // Scaled first, so that the sum of large ones is finite.
    let largest = clean.iter().copied().fold(0.0_f32, f32::max);
    if largest == 0.0 {
        let mut only = [0.0; N];
        if let Some(first) = only.first_mut() {
            *first = 1.0;
        }
        return only;
    }
    let scaled = clean.map(|c| c / largest);
    let sum: f32 = scaled.iter().sum();
    scaled.map(|c| c / sum)
}

/// The gradient by the raw coefficients from that by the normalised ones: clipped coefficients get the gradient they
/// would have at 0.
#[must_use]
pub fn through_normalisation<const N: usize>(raw: &[f32; N], gradient: &[f32; N]) -> [f32; N] {
    let sum: f32 = raw.iter().filter(|c| **c > 0.0 && c.is_finite()).sum();
    if sum <= 0.0 {
        return [0.0; N];
    }
    let mean: f32 = normalised(raw).iter().zip(gradient).map(|(c, g)| c * g).sum();
    gradient.map(|g| (g - mean) / sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normalised_sets_sum_to_one_whatever_comes_in() {
        assert_eq!(normalised(&[2.0, 6.0]), [0.25, 0.75]);
        assert_eq!(normalised(&[-1.0, f32::NAN, 3.0]), [0.0, 0.0, 1.0]);
        assert_eq!(normalised(&[0.0; 3]), [1.0, 0.0, 0.0]);
        assert_eq!(normalised(&[f32::MAX, f32::MAX]), [0.5, 0.5]);
    }

    #[test]
    fn a_certain_class_gives_its_own_set() {
        let mut sets = [Coefficients::default(); CLASSES];
        sets[3].albedo = [1.0, 1.0, 1.0, 1.0, 0.0];
        let mut p = [0.0; CLASSES];
        p[3] = 1.0;
        assert_eq!(Coefficients::mixed(&sets, &p).albedo, [0.25, 0.25, 0.25, 0.25, 0.0]);
        p = [0.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0, 0.0];
        let mixed = Coefficients::mixed(&sets, &p);
        let expected = 0.5 * (0.25 + normalised(&Coefficients::default().albedo)[0]);
        assert!((mixed.albedo[0] - expected).abs() < 1e-6);
        assert_eq!(Coefficients::mixed(&sets, &[0.0; CLASSES]), Coefficients::default().normalised());
        assert_eq!(Coefficients::from_array(&mixed.to_array()), mixed);
    }
}
