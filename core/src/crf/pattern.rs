//! Which pixel pairs a bilateral kernel looks at: a point-symmetric set of offsets with spatial weights.
//!
//! Small kernels take every offset of the disc of [`RADIUS`] sigmas, with the Gaussian's own weights: the kernel is
//! exact up to truncation. Wide kernels take about [`SAMPLES`] offsets, spread so that each stands for an equal share
//! of the Gaussian's mass (a Fermat spiral, relaxed by Lloyd's iteration); an offset's weight is the mass of the
//! offsets nearest to it, so the disc's whole mass is kept. Only one of d and -d is stored. Lengths in pixels.
use crate::base::math::{ceilf, cosf, expf, floorf, logf, sinf, sqrtf};
use heapless::Vec;

/// Where the spatial Gaussian ends, in sigmas.
pub const RADIUS: f32 = 3.0;

/// Half-plane offsets of a wide kernel.
pub const SAMPLES: usize = 48;

/// Most half-plane offsets of any kernel.
pub const MAX_OFFSETS: usize = 64;

const LLOYD_STEPS: usize = 4;

/// Offsets of a row that are worked on together.
const RUN: usize = 16;

/// One offset of the half-plane dy > 0, or dy = 0 and dx > 0; it also stands for its opposite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Offset {
    /// Columns to the right.
    pub dx: i32,
    /// Rows down, at least 0.
    pub dy: usize,
    /// The spatial kernel's value, in units in which a pixel's own is 1.
    pub weight: f32,
}

/// The offsets of a kernel.
pub type Pattern = Vec<Offset, MAX_OFFSETS>;

/// The offsets for a spatial Gaussian of `sigma` pixels: all of the disc where `samples` or fewer than
/// [`MAX_OFFSETS`] do, else about `samples`.
#[must_use]
pub fn pattern(sigma: f32, samples: usize) -> Pattern {
    let mut all = Pattern::new();
    if for_each_in_half_disc(sigma, |dx, dy, weight| all.push(Offset { dx, dy, weight }).is_ok()) {
        return all;
    }
    sampled(sigma, samples.clamp(1, MAX_OFFSETS))
}

/// Calls `visit(dx, dy, weight)` for every offset until one returns false; true when all were visited.
pub(super) fn for_each_in_half_disc(sigma: f32, mut visit: impl FnMut(i32, usize, f32) -> bool) -> bool {
    for_each_run_in_half_disc(sigma, |_, _| (), |dx, dy, weight, (), _| visit(dx, dy, weight))
}

/// The same, with what `prepare(dx, dy)` makes of the [`RUN`] offsets from `dx` on to the right, and the offset's place in that.
fn for_each_run_in_half_disc<T>(
    sigma: f32,
    mut prepare: impl FnMut(i32, usize) -> T,
    mut visit: impl FnMut(i32, usize, f32, &T, usize) -> bool,
) -> bool {
    let radius = (RADIUS * sigma).clamp(0.0, 4096.0);
    let reach = floorf(radius) as i32;
    for dy in 0..=reach {
        let row = if dy == 0 { 1 } else { -reach };
        for start in (row..=reach).step_by(RUN) {
            let run = prepare(start, dy.unsigned_abs() as usize);
            for (place, dx) in (start..=reach).take(RUN).enumerate() {
                let squared = (dx * dx + dy * dy) as f32;
                if squared <= radius * radius {
                    let weight = expf(-squared / (2.0 * sigma * sigma));
                    if !visit(dx, dy.unsigned_abs() as usize, weight, &run, place) {
                        return false;
                    }
                }
            }
        }
    }
    true
}

fn sampled(sigma: f32, samples: usize) -> Pattern {
    let mut points: Vec<(f32, f32), MAX_OFFSETS> = spiral(sigma, samples);
    for _ in 0..LLOYD_STEPS {
        let mut sums = [(0.0_f32, 0.0_f32, 0.0_f32); MAX_OFFSETS];
        let nearest = |dx, dy| nearest(&points, dx, dy);
        for_each_run_in_half_disc(sigma, nearest, |dx, dy, weight, nearest, place| {
            let k = (nearest[place % RUN] / 2) as usize;
            let sign = if nearest[place % RUN] % 2 == 0 { 1.0 } else { -1.0 };
            if let Some(sum) = sums.get_mut(k) {
                sum.0 += weight * sign * dx as f32;
                sum.1 += weight * sign * dy as f32;
                sum.2 += weight;
            }
            true
        });
        for (point, sum) in points.iter_mut().zip(&sums) {
            if sum.2 > 0.0 {
                *point = (sum.0 / sum.2, sum.1 / sum.2);
            }
        }
    }
    let mut pattern = Pattern::new();
    for &(x, y) in &points {
        let (dx, dy) = (round(x), round(y));
        let (dx, dy) = if dy < 0 || (dy == 0 && dx < 0) { (-dx, -dy) } else { (dx, dy) };
        let dy = dy.unsigned_abs() as usize;
        if (dx, dy) != (0, 0) && !pattern.iter().any(|o| (o.dx, o.dy) == (dx, dy)) {
            // Room for every point: both hold MAX_OFFSETS.
            let _ = pattern.push(Offset { dx, dy, weight: 0.0 });
        }
    }
    points.clear();
    for offset in &pattern {
        let _ = points.push((offset.dx as f32, offset.dy as f32));
    }
    let nearest = |dx, dy| nearest(&points, dx, dy);
    for_each_run_in_half_disc(sigma, nearest, |_, _, weight, nearest, place| {
        if let Some(offset) = pattern.get_mut((nearest[place % RUN] / 2) as usize) {
            offset.weight += weight;
        }
        true
    });
    pattern
}

/// Points of a half disc, each standing for an equal mass of the Gaussian.
fn spiral(sigma: f32, samples: usize) -> Vec<(f32, f32), MAX_OFFSETS> {
    const GOLDEN: f32 = 0.618_034;
    let inside = 1.0 - expf(-0.5 * RADIUS * RADIUS);
    let mut points = Vec::new();
    for k in 0..samples {
        let share = (k as f32 + 0.5) / samples as f32;
        let r = sigma * sqrtf(-2.0 * logf(1.0 - share * inside));
        let turn = k as f32 * GOLDEN;
        let angle = core::f32::consts::PI * (turn - floorf(turn));
        let _ = points.push((r * cosf(angle), r * sinf(angle)));
    }
    points
}

/// For offsets (`dx`, `dy`), (`dx` + 1, `dy`) … the nearest of the points and their opposites, the first of equals: twice its
/// index, and 1 more for an opposite.
fn nearest(points: &[(f32, f32)], dx: i32, dy: usize) -> [u32; RUN] {
    let y = dy as f32;
    let x: [f32; RUN] = core::array::from_fn(|place| (dx + place as i32) as f32);
    let (mut best, mut found) = ([f32::INFINITY; RUN], [0; RUN]);
    for (k, &(px, py)) in (0..).zip(points) {
        let (minus_y, plus_y) = ((y - py) * (y - py), (y + py) * (y + py));
        for i in 0..RUN {
            let minus = (x[i] - px) * (x[i] - px) + minus_y;
            let plus = (x[i] + px) * (x[i] + px) + plus_y;
            let distance = if plus < minus { plus } else { minus };
            // Masks: of a choice LLVM makes a branch.
            let nearer = u32::from(distance < best[i]).wrapping_neg();
            best[i] = if distance < best[i] { distance } else { best[i] };
            found[i] = (found[i] & !nearer) | ((2 * k + u32::from(plus < minus)) & nearer);
        }
    }
    found
}

fn round(value: f32) -> i32 {
    if value < 0.0 { ceilf(value - 0.5) as i32 } else { floorf(value + 0.5) as i32 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_narrow_kernel_takes_every_offset_with_its_gaussian_weight() {
        let offsets = pattern(0.96, SAMPLES);
        // The disc of radius 2.88 holds 25 lattice points: the centre and 12 pairs.
        assert_eq!(offsets.len(), 12);
        for o in &offsets {
            let squared = (o.dx * o.dx) as f32 + (o.dy * o.dy) as f32;
            assert!((o.weight - (-squared / (2.0 * 0.96 * 0.96)).exp()).abs() < 1e-6);
        }
    }

    #[test]
    fn a_wide_kernel_keeps_the_mass_and_the_spread_of_the_gaussian() {
        for sigma in [2.5_f32, 3.84, 7.68, 15.36, 61.44] {
            let offsets = pattern(sigma, SAMPLES);
            // Rounding joins a few points of the narrowest.
            assert!(offsets.len() >= SAMPLES * 2 / 3, "{sigma}: {}", offsets.len());
            let (mut mass, mut spread) = (0.0_f64, 0.0_f64);
            for_each_in_half_disc(sigma, |dx, dy, w| {
                mass += f64::from(w);
                spread += f64::from(w) * (f64::from(dx * dx) + (dy * dy) as f64);
                true
            });
            let sum: f64 = offsets.iter().map(|o| f64::from(o.weight)).sum();
            let square: f64 = offsets
                .iter()
                .map(|o| f64::from(o.weight) * (f64::from(o.dx * o.dx) + (o.dy * o.dy) as f64))
                .sum();
            assert!((sum / mass - 1.0).abs() < 1e-4, "{sigma}: {sum} of {mass}");
            // Points stand for the mass around them, so the tail is a little short.
            assert!((square / spread - 1.0).abs() < 0.15, "{sigma}: {square} of {spread}");
            assert!(offsets.iter().all(|o| o.weight > 0.0 && (o.dy > 0 || o.dx > 0)), "{sigma}");
        }
    }

    #[test]
    fn degenerate_widths_give_patterns_too() {
        assert!(pattern(0.0, SAMPLES).is_empty());
        assert!(pattern(0.1, SAMPLES).is_empty());
        assert!(pattern(f32::NAN, SAMPLES).is_empty());
        assert_eq!(pattern(30.0, 0).len(), 1);
    }
}
