//! Photos larger than the network's training photos: seen at full size for the detail, and twice, once mirrored, at the
//! training size.
//!
//! A network knows the flash's highlight, its falloff and the picture's borders at the size of its training photos
//! ([`Defaults::base_size`](super::format::Defaults)). At twice that size the same layers see a quarter of the picture
//! each, and shading goes into the maps. So the base run (everything larger than a base pixel) is joined with
//! what the full-size run adds below a base pixel, as a two-level Laplacian pyramid: albedo by ratio, normals by
//! slope, roughness by difference. A network that was trained at the full size too
//! ([`Defaults::top_size`](super::format::Defaults)) knows it all there as well: then what is large in normals is the
//! mean of both runs, which errs less than either; albedo and roughness, which the light's falloff and the highlight's
//! shape tell, stay the base run's (docs/decisions/015-full-size-run.md). The class is what the full-size run says, for
//! a material's texture shows there; so it comes first, and the base run's heads are mixed by its answer, without a
//! classifier of their own.
//!
//! Flash and camera are at the centre, so a mirrored photo is a photo of the mirrored material, and what the network
//! says of it, mirrored back, is a second opinion: the mean of both errs less than either
//! (docs/decisions/014-mirrored-run.md). The base run is the cheap one to do twice.
//!
//! Not in the paper, whose photos all have the training size (docs/paper-notes.md).
use super::{Classification, Model};
use crate::base::arena::{Arena, bytes_for};
use crate::base::exec::{Executor, ROWS_PER_BLOCK, for_each_row_block, planes3};
use crate::base::math::sqrtf;
use crate::base::resample::{Pair, shrink};
use crate::frame::LinearImage;
use crate::maps::MapsMut;
use crate::net::Inference;
use crate::net::Mixing;
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
/// Share of the progress that the full-size run is; the other two have equal parts of the rest.
const FULL_SHARE: f32 = 0.7;

/// An engine at the photo's size, with one at the training size where that is smaller.
#[derive(Clone, Debug)]
pub struct Scales<E> {
    full: E,
    base: Option<E>,
    /// Whether the network was trained at the full size too.
    knows_full: bool,
}

impl<E: Inference> Scales<E> {
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

impl<E: Inference> Inference for Scales<E> {
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
        let mut part = Part { observer, from: 0.0, share: FULL_SHARE };
        let seen = self.full.infer(photo, mixing, exec, &mut scope, maps, &mut part)?;
        let mixing = Mixing { known: Some(seen.predicted), ..mixing };
        let again = scope.take::<f32>(MAPS * m * m)?;
        let share = (1.0 - FULL_SHARE) / 2.0;
        let mut look = |rgb: &[f32], out: &mut [f32], from: f32| {
            let small = LinearImage { size: m, rgb, clipped, ..*photo };
            let mut part = Part { observer: &mut *observer, from, share };
            base.infer(&small, mixing, exec, &mut scope.scope(), &mut maps_of(out, m), &mut part)
        };
        look(rgb, first, FULL_SHARE)?;
        rgb.chunks_exact_mut(m).for_each(<[f32]>::reverse);
        look(rgb, again, FULL_SHARE + share)?;
        add_mirrored(first, again, m);
        join(first, again, m, maps, self.knows_full, exec);
        Ok(seen)
    }
}

/// Sets the base run's maps to the mean of themselves and of `again`, the maps of the mirrored photo.
fn add_mirrored(first: &mut [f32], again: &[f32], m: usize) {
    for (plane, (first, again)) in first.chunks_exact_mut(m * m).zip(again.chunks_exact(m * m)).enumerate() {
        // Mirroring turns the x of a normal round.
        let sign = if plane == 3 { -1.0 } else { 1.0 };
        for (first, again) in first.chunks_exact_mut(m).zip(again.chunks_exact(m)) {
            first.iter_mut().zip(again.iter().rev()).for_each(|(a, b)| *a = (*a + sign * b) / 2.0);
        }
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
        pair.each([base, low], plane, exec, |[base, low], full| {
            let ratio = (full + ALBEDO_FLOOR) / (low + ALBEDO_FLOOR);
            let detail = ratio.clamp(1.0 / MOST_DETAIL, MOST_DETAIL);
            ((base + ALBEDO_FLOOR) * detail - ALBEDO_FLOOR).clamp(0.0, 1.0)
        });
    }
    for (c, plane) in maps.normal.chunks_exact_mut(n * n).enumerate().take(2) {
        let (Some(base), Some(low)) = (high.normal.get(parts(c)), low.normal.get(parts(c))) else { return };
        pair.each([base, low], plane, exec, |[base, low], full| base + (full - low));
    }
    pair.each([high.roughness, low.roughness], maps.roughness, exec, |[base, low], full| {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::exec::Inline;
    use std::vec;
    use std::vec::Vec;

    #[test]
    fn the_mirrored_photos_maps_are_mirrored_back() {
        // A material with something else in every pixel, and what an ideal network says of its mirror image.
        let m = 4;
        let material: Vec<f32> = (0..MAPS * m * m).map(|i| (i * 37 % 101) as f32 / 64.0).collect();
        let mut mirrored = material.clone();
        mirrored.chunks_exact_mut(m).for_each(<[f32]>::reverse);
        maps_of(&mut mirrored, m).normal[..m * m].iter_mut().for_each(|x| *x = -*x);
        let mut first = material.clone();
        add_mirrored(&mut first, &mirrored, m);
        assert_eq!(first, material);
        // Where the opinions differ, half the difference.
        mirrored[0] += 0.5;
        add_mirrored(&mut first, &mirrored, m);
        assert_eq!(first[m - 1], material[m - 1] + 0.25);
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
