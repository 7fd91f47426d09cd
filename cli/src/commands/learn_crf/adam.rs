//! Adam (Kingma and Ba) over the coefficients, clipped to stay at least 0.
use super::gradient::Values;
use flashmat_core::crf::coefficients::COUNT;
use flashmat_core::net::Class;

const BETA1: f64 = 0.9;
const BETA2: f64 = 0.999;
const EPSILON: f64 = 1e-12;

/// The optimiser's state.
pub(super) struct Adam {
    rate: f64,
    halve_every: u32,
    steps: u32,
    first: Values,
    second: Values,
}

impl Adam {
    /// `rate` is halved after every `halve_every` steps.
    pub(super) fn new(rate: f64, halve_every: u32) -> Self {
        let zero = [[0.0; COUNT]; Class::ALL.len()];
        Self { rate, halve_every, steps: 0, first: zero, second: zero }
    }

    /// One step against `gradient`, of the coefficients `range` of each class.
    pub(super) fn step(&mut self, theta: &mut Values, gradient: &Values, range: std::ops::Range<usize>) {
        let rate = self.rate * 0.5_f64.powi((self.steps / self.halve_every.max(1)) as i32);
        self.steps += 1;
        let (debias1, debias2) = (1.0 - BETA1.powi(self.steps as i32), 1.0 - BETA2.powi(self.steps as i32));
        let moments = self.first.iter_mut().flatten().zip(self.second.iter_mut().flatten());
        let values = theta.iter_mut().flatten().zip(gradient.iter().flatten());
        for (at, ((theta, &g), (m, v))) in values.zip(moments).enumerate() {
            if !range.contains(&(at % COUNT)) {
                continue;
            }
            *m = BETA1 * *m + (1.0 - BETA1) * g;
            *v = BETA2 * *v + (1.0 - BETA2) * g * g;
            let step = rate * (*m / debias1) / ((*v / debias2).sqrt() + EPSILON);
            *theta = (*theta - step).max(0.0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_as_long_as_the_rate_and_stops_at_zero() {
        let mut adam = Adam::new(0.01, 1);
        let mut theta = [[0.5; COUNT]; Class::ALL.len()];
        let mut gradient = [[0.0; COUNT]; Class::ALL.len()];
        (gradient[2][1], gradient[2][2], gradient[2][9]) = (3.0, -1e-6, 1.0);
        adam.step(&mut theta, &gradient, 0..5);
        assert!((theta[2][1] - 0.49).abs() < 1e-9 && (theta[2][2] - 0.51).abs() < 1e-6);
        // Outside the range, and without a gradient.
        assert_eq!((theta[2][9], theta[1][1]), (0.5, 0.5));
        adam.step(&mut theta, &gradient, 0..5);
        assert!((theta[2][1] - 0.485).abs() < 1e-6, "half the rate");
        theta[2][1] = 1e-4;
        adam.step(&mut theta, &gradient, 0..5);
        assert_eq!(theta[2][1], 0.0);
    }
}
