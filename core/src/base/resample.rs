//! Planes and smaller ones of the same picture: area averages down, bilinear interpolation up.
//!
//! The network's looks are joined so (`net/scales`), albedo is filled in so below highlights (`highlight`), and photos larger
//! than the CRFs' grid are refined so (`capture/reduced`).
use crate::Error;
use crate::base::arena::Arena;
use crate::base::exec::{Executor, Plane, ROWS_PER_BLOCK, for_each_row_block};

/// Area average of an `n` x `n` plane to `m` x `m`, m <= n, exact for any ratio.
pub(crate) fn shrink(large: &[f32], n: usize, m: usize, small: &mut [f32], exec: &dyn Executor) {
    if n == m {
        return small.iter_mut().zip(large).for_each(|(small, large)| *small = *large);
    }
    let ratio = n as f32 / m as f32;
    for_each_row_block(exec, m, ROWS_PER_BLOCK, Plane::new(small, m), &|rows, mut out| {
        for (row, out) in rows.zip(out.rows()) {
            if n == 2 * m {
                let pairs = |y: usize| large.get(y * n..(y + 1) * n).unwrap_or(&[]).as_chunks::<2>().0.iter();
                for (out, ([a, b], [c, d])) in out.iter_mut().zip(pairs(2 * row).zip(pairs(2 * row + 1))) {
                    *out = ((a + b) + (c + d)) / 4.0;
                }
                continue;
            }
            if n == n / m * m {
                let whole = n / m;
                let rows = large.chunks_exact(n).skip(row * whole).take(whole);
                out.fill(0.0);
                for line in rows {
                    for (out, under) in out.iter_mut().zip(line.chunks_exact(whole)) {
                        *out += under.iter().sum::<f32>();
                    }
                }
                out.iter_mut().for_each(|out| *out /= ratio * ratio);
                continue;
            }
            let vertical = Cover::new(row, ratio, n);
            for (column, out) in out.iter_mut().enumerate() {
                let across = Cover::new(column, ratio, n);
                let mut sum = 0.0;
                for y in vertical.first..vertical.end {
                    let line = large.get(y * n + across.first..y * n + across.end).unwrap_or(&[]);
                    let part: f32 = line.iter().zip(across.first..).map(|(v, x)| v * across.weight(x)).sum();
                    sum += part * vertical.weight(y);
                }
                *out = sum / (ratio * ratio);
            }
        }
    });
}

/// `planes`, each of `n` x `n`, averaged to `m` x `m`, in memory of their own.
///
/// # Errors
/// [`Error::WorkspaceTooSmall`].
pub(crate) fn shrunk<'a>(
    planes: &[f32],
    n: usize,
    m: usize,
    exec: &dyn Executor,
    arena: &mut Arena<'a>,
) -> Result<&'a mut [f32], Error> {
    let small = arena.take::<f32>(planes.len() / (n * n).max(1) * m * m)?;
    for (small, large) in small.chunks_exact_mut(m * m).zip(planes.chunks_exact(n * n)) {
        shrink(large, n, m, small, exec);
    }
    Ok(small)
}

/// The source pixels under one target pixel.
struct Cover {
    start: f32,
    stop: f32,
    first: usize,
    end: usize,
}

impl Cover {
    fn new(target: usize, ratio: f32, n: usize) -> Self {
        let (start, stop) = (target as f32 * ratio, (target + 1) as f32 * ratio);
        let end = stop as usize + usize::from(stop > stop as usize as f32);
        Self { start, stop, first: start as usize, end: end.min(n) }
    }

    /// How much of source pixel `x` is covered, in [0,1].
    fn weight(&self, x: usize) -> f32 {
        (self.stop.min(x as f32 + 1.0) - self.start.max(x as f32)).max(0.0)
    }
}

/// Columns that are interpolated at a time, between two loops over them.
const SPAN: usize = 512;

/// The sizes of a plane and of a smaller one, m <= n.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    pub(crate) n: usize,
    pub(crate) m: usize,
}

impl Pair {
    /// Sets every full-size value to `f(small, value)`, `small` the values of the smaller planes there, interpolated bilinearly.
    pub(crate) fn each<const K: usize>(
        &self,
        small: [&[f32]; K],
        plane: &mut [f32],
        exec: &dyn Executor,
        f: impl Fn([f32; K], f32) -> f32 + Sync,
    ) {
        for_each_row_block(exec, self.n, ROWS_PER_BLOCK, Plane::new(plane, self.n), &|rows, mut out| {
            exec.simd().run(
                #[inline(always)]
                || rows.zip(out.rows()).for_each(|(row, out)| self.each_of_row(small, row, out, &f)),
            );
        });
    }

    /// [`Pair::each`] on row `row`.
    #[inline(always)]
    fn each_of_row<const K: usize>(
        &self,
        small: [&[f32]; K],
        row: usize,
        out: &mut [f32],
        f: &impl Fn([f32; K], f32) -> f32,
    ) {
        let (top, bottom, down) = self.between(row);
        let lines =
            small.map(|plane| [top, bottom].map(|y| plane.get(y * self.m..(y + 1) * self.m).unwrap_or(&[])));
        let mut between = [[0.0; SPAN]; K];
        for (first, out) in (0..).step_by(SPAN).zip(out.chunks_mut(SPAN)) {
            for (between, lines) in between.iter_mut().zip(lines) {
                self.interpolate(lines, down, first, between.get_mut(..out.len()).unwrap_or(&mut []));
            }
            for (i, value) in out.iter_mut().enumerate().take(SPAN) {
                *value = f(between.each_ref().map(|between| between[i]), *value);
            }
        }
    }

    /// One row's columns from `first` on, a multiple of [`SPAN`]: `down` of the way from the first of `lines` to the second.
    /// Powers of two take loops that the compiler vectorises; the arithmetic is the same.
    #[inline(always)]
    fn interpolate(&self, lines: [&[f32]; 2], down: f32, first: usize, out: &mut [f32]) {
        let one = |(column, value): (usize, &mut f32)| {
            let (left, right, along) = self.between(column);
            let corners = lines.map(|line| [left, right].map(|x| line.get(x).copied().unwrap_or(0.0)));
            *value = bilinear(corners, along, down);
        };
        let ratio = self.n / self.m.max(1);
        if !(2..=SPAN).contains(&ratio) || self.n != ratio * self.m || !ratio.is_power_of_two() {
            return (first..).zip(out).for_each(one);
        }
        let (before, rest) = out.split_at_mut(out.len().min(ratio / 2));
        (first..).zip(before).for_each(one);
        let [above, below] = lines.map(|line| line.get(first / ratio..).unwrap_or(&[]).windows(2));
        let corners = above.zip(below).map(|(above, below)| [[above[0], above[1]], [below[0], below[1]]]);
        let end = first + ratio / 2 + rest.len() / ratio * ratio;
        let after = if ratio == 2 {
            let (pairs, after) = rest.as_chunks_mut::<2>();
            for (pair, corners) in pairs.iter_mut().zip(corners) {
                *pair = [bilinear(corners, 0.25, down), bilinear(corners, 0.75, down)];
            }
            after
        } else {
            let mut spans = rest.chunks_exact_mut(ratio);
            for (span, corners) in spans.by_ref().zip(corners) {
                for (i, value) in span.iter_mut().enumerate() {
                    *value = bilinear(corners, (i as i32 as f32 + 0.5) / ratio as f32, down);
                }
            }
            spans.into_remainder()
        };
        (end..).zip(after).for_each(one);
    }

    /// The base pixels left and right of a full-size one, and how far it is towards the right one.
    pub(crate) fn between(&self, i: usize) -> (usize, usize, f32) {
        let at = ((i as f32 + 0.5) * self.m as f32 / self.n as f32 - 0.5).max(0.0);
        let left = (at as usize).min(self.m.saturating_sub(1));
        (left, (left + 1).min(self.m.saturating_sub(1)), at - left as f32)
    }
}

/// Between four corners: [above, below] of [left, right], `along` and `down` in [0,1].
#[inline(always)]
pub(crate) fn bilinear(corners: [[f32; 2]; 2], along: f32, down: f32) -> f32 {
    let [above, below] = corners.map(|[left, right]| left + along * (right - left));
    above + down * (below - above)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::exec::Inline;
    use std::vec;
    use std::vec::Vec;

    #[test]
    fn shrinking_keeps_the_mean_and_constants_at_any_ratio() {
        for (n, m) in [(8, 4), (12, 8), (9, 9), (384, 256), (7, 2)] {
            let large: Vec<f32> = (0..n * n).map(|i| ((i * 7919) % 101) as f32 / 101.0).collect();
            let mut small = vec![0.0; m * m];
            shrink(&large, n, m, &mut small, &Inline);
            let mean = |v: &[f32]| v.iter().map(|&x| f64::from(x)).sum::<f64>() / v.len() as f64;
            assert!((mean(&large) - mean(&small)).abs() < 1e-5, "{n} to {m}");
            shrink(&vec![0.25; n * n], n, m, &mut small, &Inline);
            assert!(small.iter().all(|v| (v - 0.25).abs() < 1e-6), "{n} to {m}");
        }
        let mut small = [0.0];
        shrink(&[1.0, 2.0, 3.0, 6.0], 2, 1, &mut small, &Inline);
        assert_eq!(small, [3.0]);
    }

    #[test]
    fn powers_of_two_are_any_ratio_to_the_bit() {
        let noise = |count: usize, seed: u32| -> Vec<f32> {
            let at = |i: usize| (i as u32).wrapping_mul(2_654_435_761).wrapping_add(seed).rotate_left(9) >> 8;
            (0..count).map(|i| at(i).wrapping_mul(40_503) as f32 / u32::MAX as f32).collect()
        };
        for (m, ratio) in
            [(1, 2), (2, 2), (8, 2), (13, 2), (300, 2), (2, 4), (7, 4), (150, 4), (5, 16), (1, 512)]
        {
            let n = ratio * m;
            let (base, low, plane) = (noise(m * m, 1), noise(m * m, 2), noise(n * n, 3));
            let pair = Pair { n, m };
            let f = |[base, low]: [f32; 2], full: f32| base * 3.0 + low * 0.7 - full;
            let mut out = plane.clone();
            pair.each([&base, &low], &mut out, &Inline, f);
            for (i, (out, full)) in out.iter().zip(&plane).enumerate() {
                let ((top, bottom, down), (left, right, along)) = (pair.between(i / n), pair.between(i % n));
                let at = |p: &[f32]| {
                    let corners = [top, bottom].map(|y| [left, right].map(|x| p[y * m + x]));
                    bilinear(corners, along, down)
                };
                assert_eq!(*out, f([at(&base), at(&low)], *full), "{m} times {ratio}: value {i}");
            }
            if ratio > 2 {
                continue;
            }
            let mut small = vec![0.0; m * m];
            shrink(&plane, n, m, &mut small, &Inline);
            for (i, small) in small.iter().enumerate() {
                let first = i / m * 2 * n + i % m * 2;
                let want =
                    ((plane[first] + plane[first + 1]) + (plane[first + n] + plane[first + n + 1])) / 4.0;
                assert_eq!(*small, want, "{m}: value {i}");
            }
        }
    }
}
