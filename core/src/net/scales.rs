//! Photos larger than the network's training photos, seen twice: whole at the training size, then at full size for
//! the detail.
//!
//! A network knows the flash's highlight, its falloff and the picture's borders at the size of its training photos
//! ([`Defaults::base_size`](super::format::Defaults)). At twice that size the same layers see a quarter of the picture
//! each, and shading goes into the maps. So the base run (class, everything larger than a base pixel) is joined with
//! what the full-size run adds below a base pixel, as a two-level Laplacian pyramid: albedo by ratio, normals by
//! slope, roughness by difference. A network that was trained at the full size too
//! ([`Defaults::top_size`](super::format::Defaults)) knows it all there as well: then what is large in normals is the
//! mean of both runs, which errs less than either; albedo and roughness, which the light's falloff and the highlight's
//! shape tell, stay the base run's (docs/experiments.md). The class is what both say, for fine cloth shows its threads at full size only; so
//! the full-size run comes first, and the base run's heads are mixed by both. Not in the paper, whose photos all have the training size (docs/paper-notes.md).
use super::{Classification, Model};
use crate::arena::{Arena, bytes_for};
use crate::exec::{Executor, Plane, ROWS_PER_BLOCK, for_each_row_block, planes3};
use crate::frame::LinearImage;
use crate::maps::MapsMut;
use crate::math::sqrtf;
use crate::net::Mixing;
use crate::pipeline::Engine;
use crate::{Error, Observer, Stage};
use core::ops::ControlFlow;

/// Added to both sides of the albedo's ratio: below it, detail is noise.
const ALBEDO_FLOOR: f32 = 0.01;
/// The detail's ratio stays within this factor, up and down.
const MOST_DETAIL: f32 = 3.0;
/// Smallest z of a normal whose slope is taken.
const LEAST_Z: f32 = 0.05;
/// Planes of a set of maps.
const MAPS: usize = 7;
/// Share of the progress that the full-size run is.
const FULL_SHARE: f32 = 0.8;

/// An engine at the photo's size, with one at the training size where that is smaller.
#[derive(Clone, Debug)]
pub struct Scales<E> {
    full: E,
    base: Option<E>,
    /// Whether the network was trained at the full size too.
    knows_full: bool,
}

impl<E: Engine> Scales<E> {
    /// Makes the engines for photos of `size` x `size` with `make`.
    ///
    /// # Errors
    /// What `make` says.
    pub fn new(
        model: &Model<'_>,
        size: usize,
        make: impl Fn(usize) -> Result<E, Error>,
    ) -> Result<Self, Error> {
        let knows_full = size <= model.defaults().top_size as usize;
        let base = model.defaults().base_size as usize;
        let base = if base == 0 || base >= size { None } else { Some(make(base)?) };
        Ok(Self { full: make(size)?, base, knows_full })
    }
}

impl<E: Engine> Engine for Scales<E> {
    fn model(&self) -> &Model<'_> {
        self.full.model()
    }

    fn size(&self) -> usize {
        self.full.size()
    }

    fn workspace_bytes(&self) -> usize {
        let full = self.full.workspace_bytes();
        let Some(base) = &self.base else { return full };
        let plane = base.size().saturating_mul(base.size());
        bytes_for::<f32>(plane)
            .saturating_mul(2 * MAPS + 3)
            .saturating_add(bytes_for::<u8>(plane))
            .saturating_add(full.max(base.workspace_bytes()))
    }

    fn infer(
        &self,
        photo: &LinearImage<'_>,
        mixing: Mixing,
        exec: &dyn Executor,
        arena: &mut Arena<'_>,
        maps: &mut MapsMut<'_>,
        observer: &mut dyn Observer,
    ) -> Result<Classification, Error> {
        let Some(base) = &self.base else {
            return self.full.infer(photo, mixing, exec, arena, maps, observer);
        };
        let (n, m) = (photo.size, base.size());
        let mut scope = arena.scope();
        let first = scope.take::<f32>(MAPS * m * m)?;
        let rgb = scope.take::<f32>(3 * m * m)?;
        let clipped = scope.zeroed::<u8>(m * m)?;
        for (small, large) in rgb.chunks_exact_mut(m * m).zip(photo.rgb.chunks_exact(n * n)) {
            shrink(large, n, m, small, exec);
        }
        let small = LinearImage { size: m, rgb, clipped, ..*photo };
        let mut part = Part { observer, from: 0.0, share: FULL_SHARE };
        let seen = self.full.infer(photo, mixing, exec, &mut scope, maps, &mut part)?;
        let mixing = Mixing { second: Some(seen.predicted), ..mixing };
        let mut part = Part { observer: part.observer, from: FULL_SHARE, share: 1.0 - FULL_SHARE };
        let classification = {
            let mut out = maps_of(first, m);
            base.infer(&small, mixing, exec, &mut scope, &mut out, &mut part)?
        };
        let smooth = scope.take::<f32>(MAPS * m * m)?;
        join(first, smooth, m, maps, self.knows_full, exec);
        Ok(classification)
    }
}

/// One run's share of the stage's progress.
struct Part<'o> {
    observer: &'o mut dyn Observer,
    from: f32,
    share: f32,
}

impl Observer for Part<'_> {
    fn progress(&mut self, stage: Stage, fraction: f32) -> ControlFlow<()> {
        self.observer.progress(stage, self.from + self.share * fraction)
    }
}

/// Seven planes as maps.
fn maps_of(planes: &mut [f32], size: usize) -> MapsMut<'_> {
    let (albedo, rest) = planes.split_at_mut(3 * size * size);
    let (normal, roughness) = rest.split_at_mut(3 * size * size);
    MapsMut { size, albedo, normal, roughness }
}

/// Joins the base run's maps `first` with the detail of the full-size `maps`, in place; `smooth` is working memory. What
/// is large is the base run's, of normals, if `both`, the mean of both runs'.
fn join(
    first: &mut [f32],
    smooth: &mut [f32],
    m: usize,
    maps: &mut MapsMut<'_>,
    both: bool,
    exec: &dyn Executor,
) {
    let n = maps.size;
    to_slopes(maps.normal, n);
    to_slopes(maps_of(first, m).normal, m);
    let planes = |values: &mut [f32], size: usize, out: &mut [f32], count: usize| {
        for (small, large) in out.chunks_exact_mut(m * m).zip(values.chunks_exact(size * size)).take(count) {
            shrink(large, size, m, small, exec);
        }
    };
    let low = maps_of(smooth, m);
    planes(maps.albedo, n, low.albedo, 3);
    planes(maps.normal, n, low.normal, 2);
    planes(maps.roughness, n, low.roughness, 1);
    if both {
        let slopes = 3 * m * m..5 * m * m;
        let pairs =
            first.get_mut(slopes.clone()).into_iter().flatten().zip(smooth.get(slopes).unwrap_or(&[]));
        for (base, low) in pairs {
            *base = (*base + low) / 2.0;
        }
    }
    let low = maps_of(smooth, m);
    let high = maps_of(first, m);
    let pair = Pair { n, m };
    let parts = |c: usize| c * m * m..(c + 1) * m * m;
    for (c, plane) in maps.albedo.chunks_exact_mut(n * n).enumerate() {
        let (Some(base), Some(low)) = (high.albedo.get(parts(c)), low.albedo.get(parts(c))) else { return };
        pair.each(base, low, plane, exec, |base, low, full| {
            let ratio = (full + ALBEDO_FLOOR) / (low + ALBEDO_FLOOR);
            let detail = ratio.clamp(1.0 / MOST_DETAIL, MOST_DETAIL);
            ((base + ALBEDO_FLOOR) * detail - ALBEDO_FLOOR).clamp(0.0, 1.0)
        });
    }
    for (c, plane) in maps.normal.chunks_exact_mut(n * n).enumerate().take(2) {
        let (Some(base), Some(low)) = (high.normal.get(parts(c)), low.normal.get(parts(c))) else { return };
        pair.each(base, low, plane, exec, |base, low, full| base + (full - low));
    }
    pair.each(high.roughness, low.roughness, maps.roughness, exec, |base, low, full| {
        (base + (full - low)).clamp(0.0, 1.0)
    });
    to_normals(maps.normal, n, exec);
}

/// Planes x, y of unit normals to x/z, y/z.
fn to_slopes(normal: &mut [f32], size: usize) {
    let (xy, z) = normal.split_at_mut((2 * size * size).min(normal.len()));
    for plane in xy.chunks_exact_mut(size * size) {
        for (value, z) in plane.iter_mut().zip(z.iter()) {
            *value /= z.max(LEAST_Z);
        }
    }
}

/// The inverse of [`to_slopes`].
fn to_normals(normal: &mut [f32], size: usize, exec: &dyn Executor) {
    for_each_row_block(
        exec,
        size,
        ROWS_PER_BLOCK,
        planes3(normal, size, size),
        &|_, [mut x, mut y, mut z]| {
            let (x, y) = (x.values().iter_mut(), y.values().iter_mut());
            for ((x, y), z) in x.zip(y).zip(z.values().iter_mut()) {
                let length = sqrtf(*x * *x + *y * *y + 1.0);
                (*x, *y, *z) = (*x / length, *y / length, 1.0 / length);
            }
        },
    );
}

/// Area average of an `n` x `n` plane to `m` x `m`, m <= n, exact for any ratio.
fn shrink(large: &[f32], n: usize, m: usize, small: &mut [f32], exec: &dyn Executor) {
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

/// Two sizes.
struct Pair {
    n: usize,
    m: usize,
}

impl Pair {
    /// Sets every full-size value to `f(base, low, value)`, base and low interpolated bilinearly.
    fn each<'p>(
        &self,
        base: &'p [f32],
        low: &'p [f32],
        plane: &mut [f32],
        exec: &dyn Executor,
        f: impl Fn(f32, f32, f32) -> f32 + Sync,
    ) {
        let (n, m) = (self.n, self.m);
        for_each_row_block(exec, n, ROWS_PER_BLOCK, Plane::new(plane, n), &|rows, mut out| {
            for (row, out) in rows.zip(out.rows()) {
                let (top, bottom, down) = self.between(row);
                let lines =
                    |plane: &'p [f32]| [top, bottom].map(|y| plane.get(y * m..(y + 1) * m).unwrap_or(&[]));
                let lines = [lines(base), lines(low)];
                if n == 2 * m && m > 1 {
                    between_doubled(lines, down, out, &f);
                    continue;
                }
                for (column, value) in out.iter_mut().enumerate() {
                    let (left, right, along) = self.between(column);
                    let [base, low] = lines.map(|pair| {
                        bilinear(
                            pair.map(|line| [left, right].map(|x| line.get(x).copied().unwrap_or(0.0))),
                            along,
                            down,
                        )
                    });
                    *value = f(base, low, *value);
                }
            }
        });
    }

    /// The base pixels left and right of a full-size one, and how far it is towards the right one.
    fn between(&self, i: usize) -> (usize, usize, f32) {
        let at = ((i as f32 + 0.5) * self.m as f32 / self.n as f32 - 0.5).max(0.0);
        let left = (at as usize).min(self.m.saturating_sub(1));
        (left, (left + 1).min(self.m.saturating_sub(1)), at - left as f32)
    }
}

/// [`Pair::each`] on one row of twice the base's pixels: `lines` are the base's and the low-pass's lines above and below,
/// `down` how far the row is towards the one below. The same arithmetic, in loops that the compiler vectorises.
fn between_doubled(lines: [[&[f32]; 2]; 2], down: f32, out: &mut [f32], f: &impl Fn(f32, f32, f32) -> f32) {
    let at = |corners: [[[f32; 2]; 2]; 2], along: f32, value: f32| {
        let [base, low] = corners.map(|pair| bilinear(pair, along, down));
        f(base, low, value)
    };
    let end = |line: &[f32], i: usize| line.get(i).copied().unwrap_or(0.0);
    let last = lines[0][0].len().saturating_sub(1);
    let (along, [first, rest @ ..]) = (0.25, out) else { return };
    let Some((right, inner)) = rest.split_last_mut() else { return };
    *first = at(lines.map(|pair| pair.map(|line| [end(line, 0), end(line, 1)])), 0.0, *first);
    *right = at(lines.map(|pair| pair.map(|line| [end(line, last); 2])), along, *right);
    let [[a, b], [c, d]] = lines.map(|pair| pair.map(|line| line.iter().zip(line.get(1..).unwrap_or(&[]))));
    for (two, (((a, b), c), d)) in inner.as_chunks_mut::<2>().0.iter_mut().zip(a.zip(b).zip(c).zip(d)) {
        let corners = [[[*a.0, *a.1], [*b.0, *b.1]], [[*c.0, *c.1], [*d.0, *d.1]]];
        *two = [at(corners, along, two[0]), at(corners, 1.0 - along, two[1])];
    }
}

/// Between four corners: [above, below] of [left, right], `along` and `down` in [0,1].
#[inline(always)]
fn bilinear(corners: [[f32; 2]; 2], along: f32, down: f32) -> f32 {
    let [above, below] = corners.map(|[left, right]| left + along * (right - left));
    above + down * (below - above)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exec::Inline;
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
    fn twice_the_size_is_any_size_to_the_bit() {
        let noise = |count: usize, seed: u32| -> Vec<f32> {
            let at = |i: usize| (i as u32).wrapping_mul(2_654_435_761).wrapping_add(seed).rotate_left(9) >> 8;
            (0..count).map(|i| at(i).wrapping_mul(40_503) as f32 / u32::MAX as f32).collect()
        };
        for m in [2, 8, 13] {
            let n = 2 * m;
            let (base, low, plane) = (noise(m * m, 1), noise(m * m, 2), noise(n * n, 3));
            let pair = Pair { n, m };
            let f = |base: f32, low: f32, full: f32| base * 3.0 + low * 0.7 - full;
            let mut out = plane.clone();
            pair.each(&base, &low, &mut out, &Inline, f);
            for (i, (out, full)) in out.iter().zip(&plane).enumerate() {
                let ((top, bottom, down), (left, right, along)) = (pair.between(i / n), pair.between(i % n));
                let at = |p: &[f32]| {
                    let corners = [top, bottom].map(|y| [left, right].map(|x| p[y * m + x]));
                    bilinear(corners, along, down)
                };
                assert_eq!(*out, f(at(&base), at(&low), *full), "{m}: value {i}");
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

    #[test]
    fn a_base_run_that_says_the_same_leaves_smooth_maps_as_they_are() {
        let (n, m) = (16, 8);
        let ramp = |size: usize| -> Vec<f32> {
            let at = |i: usize| (i % size) as f32 / size as f32 + 0.5 / size as f32;
            let plane: Vec<f32> = (0..size * size).map(|i| 0.2 + 0.5 * at(i)).collect();
            let flat = [vec![0.0; 2 * size * size], vec![1.0; size * size]].concat();
            [plane.repeat(3), flat, plane].concat()
        };
        let (mut first, mut smooth, mut full) = (ramp(m), vec![0.0; MAPS * m * m], ramp(n));
        let before = full.clone();
        join(&mut first, &mut smooth, m, &mut maps_of(&mut full, n), false, &Inline);
        for (i, (a, b)) in full.iter().zip(&before).enumerate() {
            assert!((a - b).abs() < 1e-5, "value {i}: {a} for {b}");
        }
    }

    #[test]
    fn both_runs_have_an_equal_say_in_normals_where_the_network_knows_both_sizes() {
        let (n, m) = (16, 8);
        let constant = |size: usize, albedo: f32, slope: f32, roughness: f32| -> Vec<f32> {
            let z = 1.0 / (slope * slope + 1.0).sqrt();
            let planes = [albedo, albedo, albedo, slope * z, 0.0, z, roughness];
            planes.iter().flat_map(|v| vec![*v; size * size]).collect()
        };
        let (mut first, mut full) = (constant(m, 0.4, 0.0, 0.3), constant(n, 0.2, 0.5, 0.9));
        join(&mut first, &mut vec![0.0; MAPS * m * m], m, &mut maps_of(&mut full, n), true, &Inline);
        for (i, (is, want)) in full.iter().zip(constant(n, 0.4, 0.25, 0.3)).enumerate() {
            assert!((is - want).abs() < 1e-6, "value {i}: {is} for {want}");
        }
    }

    #[test]
    fn the_base_decides_what_is_large_and_the_full_run_what_is_small() {
        // The full run: half as bright all over, with a checkerboard of +-20 %, and a tilt of its own.
        let (n, m) = (16, 8);
        let check = |i: usize| if (i % n + i / n).is_multiple_of(2) { 1.2 } else { 0.8 };
        let plane: Vec<f32> = (0..n * n).map(|i| 0.2 * check(i)).collect();
        let tilted = [vec![0.6; n * n], vec![0.0; n * n], vec![0.8; n * n]].concat();
        let mut full = [plane.repeat(3), tilted, vec![0.9; n * n]].concat();
        let flat = [vec![0.0; 2 * m * m], vec![1.0; m * m]].concat();
        let mut first = [vec![0.4; 3 * m * m], flat, vec![0.3; m * m]].concat();
        let mut smooth = vec![0.0; MAPS * m * m];
        let mut maps = maps_of(&mut full, n);
        join(&mut first, &mut smooth, m, &mut maps, false, &Inline);
        for i in 0..n * n {
            let ratio = (0.2 * check(i) + ALBEDO_FLOOR) / (0.2 + ALBEDO_FLOOR);
            let expected = (0.4 + ALBEDO_FLOOR) * ratio - ALBEDO_FLOOR;
            assert!((maps.albedo[i] - expected).abs() < 1e-5);
            let normal = [maps.normal[i], maps.normal[n * n + i], maps.normal[2 * n * n + i]];
            assert!(normal[0].abs() < 1e-6 && normal[1].abs() < 1e-6 && (normal[2] - 1.0).abs() < 1e-6);
            assert!((maps.roughness[i] - 0.3).abs() < 1e-6);
        }
    }
}
