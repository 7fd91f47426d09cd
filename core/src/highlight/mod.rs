//! What lies below a highlight: the albedo there is told from what surrounds it.
//!
//! Where most of the light is specular the photo hardly tells the diffuse albedo, and where it is burnt out not at all: the
//! network leaves a disc of another brightness or hue. The paper's CRF lets burnt-out pixels near the centre have less say;
//! here every pixel has, by how much of its light the network's own maps call specular, and what is large in the albedo is
//! filled in from around it. Detail, as a ratio to what is large, stays the network's.
//!
//! On a grid of at most [`GRID`] x [`GRID`] cells the filled albedo x minimises sum w_i (x_i - u_i)² + [`SMOOTH`] sum (x_i -
//! x_j)² over neighbours: u the network's albedo, w the mean over the cell of (1 - s)², s the specular share of a pixel's
//! light. Two estimates bound s, and both must agree: what the photo has above the diffuse render (scaled by the median over
//! the pixels), and [`TRUST`] times what the BRDF has. Highlights of a flat material lie near the point where a flat mirror would show
//! the flash, and s falls off with the distance r from there as exp(-(r²/[`REACH`])²). The system is solved exactly (banded Cholesky); the filled albedo then
//! shows the highlight better, so all is done twice. Where filling in would change the brightness by [`MOST`] or more it is
//! rather the material that changes, a dark patch beside a white one, and little is done.
//!
//! Roughness is filled in likewise ([`level_roughness`]).
//!
//! Not in the paper. docs/decisions/016-inpaint-albedo.md has what it changes on test photos. Texture that is burnt out
//! with the highlight comes back from elsewhere in the photo: [`retexture`].
mod roughness;
mod texture;

pub use roughness::{level_roughness, level_roughness_bytes};
pub use texture::{retexture, retexture_bytes};

use crate::Error;
use crate::base::arena::{Arena, bytes_for};
use crate::base::exec::Executor;
use crate::base::math::banded;
use crate::base::math::{expf, log2f, powf};
use crate::base::resample::{Pair, shrink, shrunk};
use crate::brdf::{self, Scene};
use crate::frame::LinearImage;
use crate::frame::geometry::Geometry;
use crate::maps::{Maps, MapsMut};

/// Most cells to a side.
pub const GRID: usize = 32;
/// Weight of a pair of neighbouring cells, where a cell that is lit diffusely alone has 1.
pub const SMOOTH: f32 = 2.0;
/// How much more specular than the BRDF says a pixel may be.
pub const TRUST: f32 = 1.5;
/// Squared distance from where a mirror would show the flash, the half side 1, within which highlights lie.
pub const REACH: f32 = 0.6;
/// Pixels per side at which photo and renders are compared.
const SEEN: usize = 128;
/// The filled albedo explains less of a highlight, and shows more of it: how often that is taken in.
const PASSES: usize = 2;
/// A change of brightness that is hardly believed any more.
pub const MOST: f32 = 2.0;
/// Least weight of a cell: each has a solution.
const LEAST: f32 = 1e-3;
/// Added to both sides of the albedo's ratio, as in `net/scales`.
const FLOOR: f32 = 0.01;

/// Pixels per side of the comparison and of the grid.
fn sizes(size: usize) -> (usize, usize) {
    let seen = size.min(SEEN);
    (seen, seen.min(GRID))
}

/// Photo and maps at the size at which they are compared, and what a flash would make of them.
struct Look<'a> {
    m: usize,
    f0: f32,
    scene: Scene,
    albedo: &'a mut [f32],
    normal: &'a [f32],
    roughness: &'a [f32],
    /// The photo's brightness, that of the specular part of a render, and how far highlights lie there, [0,1].
    photo: &'a [f32],
    specular: &'a [f32],
    near: &'a [f32],
    /// Working memory: a render in colour, its brightness, and the photo's ratio to its diffuse part.
    colour: &'a mut [f32],
    both: &'a mut [f32],
    ratio: &'a mut [f32],
}

impl<'a> Look<'a> {
    /// Planes of `m` x `m`: albedo, normals, roughness, the photo's and renders' brightness, `near` and `ratio`; a render in
    /// colour; and another in colour while it is made.
    const PLANES: usize = 3 + 3 + 1 + 3 + 2 + 3 + 3;

    fn new(
        photo: &LinearImage<'_>,
        maps: &Maps<'_>,
        f0: f32,
        exec: &dyn Executor,
        arena: &mut Arena<'a>,
    ) -> Result<Self, Error> {
        let (n, (m, _)) = (maps.size, sizes(maps.size));
        let scene = Scene::of(photo);
        let albedo = shrunk(maps.albedo, n, m, exec, arena)?;
        let normal = &*shrunk(maps.normal, n, m, exec, arena)?;
        let roughness = &*shrunk(maps.roughness, n, m, exec, arena)?;
        let [bright, specular, near, both, ratio] = [
            arena.take(m * m)?,
            arena.take(m * m)?,
            arena.take(m * m)?,
            arena.take(m * m)?,
            arena.take(m * m)?,
        ];
        let colour = arena.take(3 * m * m)?;
        for (small, large) in colour.chunks_exact_mut(m * m).zip(photo.rgb.chunks_exact(n * n)) {
            shrink(large, n, m, small, exec);
        }
        brightness(colour, bright, exec);
        let mut arena = arena.scope();
        let black = &*arena.zeroed(3 * m * m)?;
        brdf::render(&Maps { size: m, albedo: black, normal, roughness }, f0, &scene, exec, colour)?;
        brightness(colour, specular, exec);
        let geometry = Geometry::new(m, photo.fov_deg);
        // Where a flat mirror shows the flash, which is the centre if the flash is at the camera.
        let mirrored = photo.flash.truncate() / ((1.0 + photo.flash.z) * geometry.half_tan());
        for (i, near) in near.iter_mut().enumerate() {
            let radius = (geometry.position(i / m, i % m) - mirrored).length_squared() / REACH;
            *near = expf(-radius * radius);
        }
        Ok(Self {
            m,
            f0,
            scene,
            albedo,
            normal,
            roughness,
            photo: bright,
            specular,
            near,
            colour,
            both,
            ratio,
        })
    }

    /// How much of each pixel's light is diffuse, [0,1], `m` x `m`.
    fn diffuse_shares(&mut self, share: &mut [f32], exec: &dyn Executor) -> Result<(), Error> {
        let Self { m: size, normal, roughness, .. } = *self;
        let maps = Maps { size, albedo: self.albedo, normal, roughness };
        brdf::render(&maps, self.f0, &self.scene, exec, self.colour)?;
        brightness(self.colour, self.both, exec);
        exec.simd().run(
            #[inline(always)]
            || self.compare(share),
        );
        Ok(())
    }

    /// How much each cell of the grid says, the mean of the diffuse shares' squares; `share` is working memory.
    fn weights(&mut self, share: &mut [f32], weight: &mut [f32], exec: &dyn Executor) -> Result<(), Error> {
        self.diffuse_shares(share, exec)?;
        share.iter_mut().for_each(|share| *share *= *share);
        shrink(share, self.m, sizes(self.m).1, weight, exec);
        weight.iter_mut().for_each(|weight| *weight = weight.max(LEAST));
        Ok(())
    }

    /// [`Look::diffuse_shares`] of the render's brightness in `both`.
    #[inline(always)]
    fn compare(&mut self, share: &mut [f32]) {
        let pixels = || self.photo.iter().zip(&*self.both).zip(self.specular);
        for (ratio, ((photo, both), specular)) in self.ratio.iter_mut().zip(pixels()) {
            *ratio = photo / (both - specular).max(1e-4);
        }
        let middle = self.ratio.len() / 2;
        let scale = if self.ratio.is_empty() {
            0.0
        } else {
            *self.ratio.select_nth_unstable_by(middle, f32::total_cmp).1
        };
        for ((share, near), ((photo, both), specular)) in share.iter_mut().zip(self.near).zip(pixels()) {
            let seen = 1.0 - scale * (both - specular) / photo.max(1e-3);
            let modelled = TRUST * specular / both.max(1e-6);
            *share = 1.0 - near * seen.min(modelled).clamp(0.0, 1.0);
        }
    }
}

/// The means of three planes, pixel by pixel.
fn brightness(planes: &[f32], out: &mut [f32], exec: &dyn Executor) {
    let (first, rest) = planes.split_at(out.len().min(planes.len()));
    let (second, third) = rest.split_at(out.len().min(rest.len()));
    exec.simd().run(
        #[inline(always)]
        || {
            for (out, ((first, second), third)) in out.iter_mut().zip(first.iter().zip(second).zip(third)) {
                *out = (first + second + third) / 3.0;
            }
        },
    );
}

/// Bytes of workspace that [`restore`] needs for maps of `size` x `size`.
#[must_use]
pub fn workspace_bytes(size: usize) -> usize {
    if size > crate::base::planes::MAX_SIZE {
        return usize::MAX;
    }
    let (seen, grid) = sizes(size);
    let (plane, cells) = (bytes_for::<f32>(seen * seen), bytes_for::<f32>(grid * grid));
    // The look and the diffuse part; the grid's weights, albedo, filled albedo and factors, and the matrix.
    plane
        .saturating_mul(Look::PLANES + 1)
        .saturating_add(cells.saturating_mul(1 + 3 + 3 + 3))
        .saturating_add(bytes_for::<f32>(grid * grid * banded::stride(grid)))
        .saturating_add(17 * crate::base::arena::ALIGN)
}

/// Fills in the albedo of `maps` below highlights, in place; `f0` is the material's specular reflectance.
///
/// Albedo stays within [0,1]. A photo without a highlight, and one that is black, changes nothing or next to nothing.
///
/// # Errors
/// [`Error::PlaneLength`], [`Error::Size`], [`Error::FieldOfView`], [`Error::WorkspaceTooSmall`].
pub fn restore(
    photo: &LinearImage<'_>,
    maps: &mut MapsMut<'_>,
    f0: f32,
    exec: &dyn Executor,
    arena: &mut Arena<'_>,
) -> Result<(), Error> {
    photo.check()?;
    maps.as_maps().check()?;
    let n = maps.size;
    let (m, g) = sizes(n);
    let mut arena = arena.scope();
    let mut look = Look::new(photo, &maps.as_maps(), f0, exec, &mut arena)?;
    let share = arena.take::<f32>(m * m)?;
    let (low, filled) = (arena.take::<f32>(3 * g * g)?, arena.take::<f32>(3 * g * g)?);
    let weight = arena.take::<f32>(g * g)?;
    let matrix = arena.take::<f32>(g * g * banded::stride(g))?;
    let total = arena.take::<f32>(3 * g * g)?;
    total.fill(1.0);
    for _ in 0..PASSES {
        look.weights(share, weight, exec)?;
        for (low, albedo) in low.chunks_exact_mut(g * g).zip(look.albedo.chunks_exact(m * m)) {
            shrink(albedo, m, g, low, exec);
        }
        matrix.fill(0.0);
        exec.simd().run(
            #[inline(always)]
            || fill(low, weight, g, filled, matrix),
        );
        believe(low, filled, weight);
        let cells = filled.iter_mut().zip(&*low).zip(weight.iter().cycle()).zip(&mut *total);
        for (((factor, low), belief), total) in cells {
            *factor = powf((factor.max(0.0) + FLOOR) / (low + FLOOR), *belief);
            *total *= *factor;
        }
        multiply(look.albedo, m, filled, g, exec);
    }
    multiply(maps.albedo, n, total, g, exec);
    Ok(())
}

/// Makes the weights how far each cell's filled albedo is believed, [0,1]: as far as the cell is highlight, and less where its
/// brightness changed by a factor near [`MOST`] or more, for then it is rather the material that changes there.
fn believe(low: &[f32], filled: &[f32], weight: &mut [f32]) {
    let cells = weight.len();
    let mean = |planes: &[f32], i: usize| mean(planes, cells, i);
    for (i, weight) in weight.iter_mut().enumerate() {
        let change = log2f((mean(filled, i).max(0.0) + FLOOR) / (mean(low, i) + FLOOR)) / log2f(MOST);
        *weight = (1.0 - weight.min(1.0)) * expf(-change * change);
    }
}

/// The mean of value `i` of three planes of `plane` values.
fn mean(planes: &[f32], plane: usize, i: usize) -> f32 {
    let at = |c: usize| planes.get(c * plane + i).copied().unwrap_or(0.0);
    (at(0) + at(1) + at(2)) / 3.0
}

/// Multiplies each of three planes of `n` x `n` with its plane of `factors`, `g` x `g`, interpolated.
fn multiply(albedo: &mut [f32], n: usize, factors: &[f32], g: usize, exec: &dyn Executor) {
    let pair = Pair { n, m: g };
    for (factor, albedo) in factors.chunks_exact(g * g).zip(albedo.chunks_exact_mut(n * n)) {
        pair.each([factor], albedo, exec, |[factor], value| (value * factor).clamp(0.0, 1.0));
    }
}

/// Solves the grid's system for each of the three planes of `low`; `matrix` is zeros.
#[inline(always)]
fn fill(low: &[f32], weight: &[f32], g: usize, filled: &mut [f32], matrix: &mut [f32]) {
    let stride = banded::stride(g);
    for (i, (row, weight)) in matrix.chunks_exact_mut(stride).zip(weight).enumerate() {
        let (x, y) = (i % g, i / g);
        let neighbours =
            usize::from(x > 0) + usize::from(x + 1 < g) + usize::from(y > 0) + usize::from(y + 1 < g);
        let mut set = |k: usize, value: f32| {
            if let Some(place) = row.get_mut(k) {
                *place = value;
            }
        };
        set(0, weight + SMOOTH * neighbours as f32);
        if x + 1 < g {
            set(1, -SMOOTH);
        }
        if y + 1 < g {
            set(g, -SMOOTH);
        }
    }
    banded::factorise(matrix, stride, g);
    for (filled, low) in filled.chunks_exact_mut(g * g).zip(low.chunks_exact(g * g)) {
        for ((filled, low), weight) in filled.iter_mut().zip(low).zip(weight) {
            *filled = weight * low;
        }
        banded::solve(matrix, stride, g, filled);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::exec::Inline;
    use crate::brdf::Light;
    use crate::crf::feature::radius_squared;
    use std::vec;
    use std::vec::Vec;

    pub(super) const N: usize = 128;
    pub(super) const FOV: f32 = 43.35;

    /// Flat, glossy plastic of one colour, and its photo.
    pub(super) struct Plastic {
        pub(super) albedo: Vec<f32>,
        pub(super) normal: Vec<f32>,
        roughness: Vec<f32>,
        pub(super) photo: Vec<f32>,
    }

    impl Plastic {
        pub(super) fn new(colour: [f32; 3], roughness: f32) -> Self {
            let n2 = N * N;
            let albedo: Vec<f32> = colour.iter().flat_map(|c| vec![*c; n2]).collect();
            let normal = [vec![0.0; 2 * n2], vec![1.0; n2]].concat();
            let roughness = vec![roughness; n2];
            let mut photo = vec![0.0; 3 * n2];
            let maps = Maps { size: N, albedo: &albedo, normal: &normal, roughness: &roughness };
            let scene = Scene { fov_deg: FOV, light: Light::default() };
            brdf::render(&maps, 0.05, &scene, &Inline, &mut photo).expect("a render");
            photo.iter_mut().for_each(|value| *value = value.min(1.0));
            Self { albedo, normal, roughness, photo }
        }

        /// `albedo` after [`restore`].
        fn restored(&self, mut albedo: Vec<f32>) -> Vec<f32> {
            let (mut normal, mut roughness) = (self.normal.clone(), self.roughness.clone());
            let mut maps =
                MapsMut { size: N, albedo: &mut albedo, normal: &mut normal, roughness: &mut roughness };
            let clipped = vec![0; N * N];
            let photo = LinearImage::new(N, &self.photo, &clipped, FOV);
            let mut memory = vec![0; workspace_bytes(N)];
            restore(&photo, &mut maps, 0.05, &Inline, &mut Arena::new(&mut memory)).expect("fits");
            albedo
        }
    }

    fn worst(a: &[f32], b: &[f32]) -> f32 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    #[test]
    fn a_disc_below_the_highlight_vanishes_and_its_detail_stays() {
        let plastic = Plastic::new([0.3, 0.1, 0.1], 0.4);
        // A grey disc under the highlight, with a fine check of 10 %.
        let mut spoilt = plastic.albedo.clone();
        let (mut inside, mut detail) = (0, plastic.albedo.clone());
        for (i, (value, detail)) in spoilt.iter_mut().zip(&mut detail).enumerate() {
            let (x, y) = (i % N, i / N % N);
            let check = if (x + y) % 2 == 0 { 1.05 } else { 0.95 };
            (*value, *detail) = (*value * check, *detail * check);
            if radius_squared(x, y, N) < 0.04 {
                *value = 0.12 * check;
                inside += 1;
            }
        }
        assert!(inside > 1000);
        let restored = plastic.restored(spoilt.clone());
        // The grid blurs the disc's edge, so the mean tells more than the worst pixel; the middle is nearly right.
        let error = |albedo: &[f32]| albedo.iter().zip(&detail).map(|(a, b)| (a - b).abs()).sum::<f32>();
        let (before, after) = (error(&spoilt), error(&restored));
        assert!(after < 0.6 * before, "{before}, then {after}");
        let middle = N * N / 2 + N / 2;
        let (was, is) = (detail[middle] - spoilt[middle], (detail[middle] - restored[middle]).abs());
        assert!(is < 0.25 * was, "{was}, then {is}");
        // Neighbouring pixels keep their ratio.
        let ratio = restored[middle] / restored[middle + 1];
        assert!((ratio - 1.05 / 0.95).abs() < 0.02, "{ratio}");
    }

    #[test]
    fn a_true_albedo_and_a_matt_one_stay_what_they_are() {
        let glossy = Plastic::new([0.2, 0.3, 0.1], 0.4);
        assert!(worst(&glossy.restored(glossy.albedo.clone()), &glossy.albedo) < 1e-3);
        // Matt: a dark centre is the material's own.
        let matt = Plastic::new([0.5, 0.5, 0.5], 1.0);
        let mut dark = matt.albedo.clone();
        for (i, value) in dark.iter_mut().enumerate() {
            *value *= 1.0 - 0.4 * expf(-8.0 * radius_squared(i % N, i / N % N, N));
        }
        let mut own = Plastic { albedo: dark.clone(), ..matt };
        let maps = Maps { size: N, albedo: &own.albedo, normal: &own.normal, roughness: &own.roughness };
        brdf::render(&maps, 0.05, &Scene::flash(FOV, 1.0), &Inline, &mut own.photo).expect("a render");
        let moved = worst(&own.restored(dark.clone()), &dark);
        assert!(moved < 0.02, "{moved}");
    }

    #[test]
    fn black_photos_and_tiny_ones_are_no_error() {
        let mut plastic = Plastic::new([0.2, 0.3, 0.1], 0.4);
        plastic.photo.fill(0.0);
        assert!(worst(&plastic.restored(plastic.albedo.clone()), &plastic.albedo) < 1e-5);
        for size in [1, 2, 3, 33] {
            let (n2, clipped) = (size * size, vec![0; size * size]);
            let rgb: Vec<f32> = (0..3 * n2).map(|i| (i % 7) as f32 / 7.0).collect();
            let photo = LinearImage::new(size, &rgb, &clipped, FOV);
            let (mut albedo, mut normal, mut roughness) =
                (vec![0.4; 3 * n2], vec![0.0; 3 * n2], vec![0.5; n2]);
            normal[2 * n2..].fill(1.0);
            let mut maps =
                MapsMut { size, albedo: &mut albedo, normal: &mut normal, roughness: &mut roughness };
            let mut memory = vec![0; workspace_bytes(size)];
            restore(&photo, &mut maps, 0.05, &Inline, &mut Arena::new(&mut memory)).expect("fits");
            // Constant as it was: there is nothing to fill in from.
            assert!(albedo.iter().all(|v| (v - 0.4).abs() < 1e-4), "{size}");
        }
    }

    #[test]
    fn the_filled_albedo_solves_its_equations() {
        let g = 8;
        let low: Vec<f32> = (0..3 * g * g).map(|i| (i * 37 % 53) as f32 / 53.0).collect();
        let weight: Vec<f32> =
            (0..g * g).map(|i| if i % 5 == 0 { LEAST } else { (i % 4) as f32 / 4.0 + 0.1 }).collect();
        let (mut x, mut matrix) = (vec![0.0; 3 * g * g], vec![0.0; g * g * banded::stride(g)]);
        fill(&low, &weight, g, &mut x, &mut matrix);
        for (x, low) in x.chunks(g * g).zip(low.chunks(g * g)) {
            for i in 0..g * g {
                let (column, row) = ((i % g) as isize, (i / g) as isize);
                let mut sum = f64::from(weight[i]) * f64::from(x[i] - low[i]);
                for (dx, dy) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
                    let (u, v) = (column + dx, row + dy);
                    if (0..g as isize).contains(&u) && (0..g as isize).contains(&v) {
                        sum += f64::from(SMOOTH) * f64::from(x[i] - x[v as usize * g + u as usize]);
                    }
                }
                assert!(sum.abs() < 1e-5, "equation {i}: {sum}");
            }
        }
    }

    #[test]
    fn neither_level_nor_threads_change_a_bit() {
        use crate::base::exec::At;
        use crate::base::simd::Simd;
        use crate::crf::scenes::Scene;
        use crate::kernels::Kernels;
        let size = 200;
        let run = |exec: &dyn Executor| -> Vec<u32> {
            let mut scene = Scene::tiles(size, 5);
            let (rgb, clipped) = (scene.photo.clone(), scene.clipped.clone());
            let photo = LinearImage::new(size, &rgb, &clipped, FOV);
            let Scene { albedo, normal, roughness, .. } = &mut scene;
            let mut memory = vec![0; workspace_bytes(size)];
            let mut maps = MapsMut { size, albedo, normal, roughness };
            restore(&photo, &mut maps, 0.05, exec, &mut Arena::new(&mut memory)).expect("fits");
            scene.albedo.iter().map(|value| value.to_bits()).collect()
        };
        let plain = run(&Inline);
        assert_ne!(plain, Scene::tiles(size, 5).albedo.iter().map(|v| v.to_bits()).collect::<Vec<_>>());
        for kernels in Kernels::supported() {
            let simd = Simd::for_level(kernels.level()).expect("a level of this CPU");
            assert!(run(&At::new(&Inline, simd)) == plain, "{}", kernels.level().name());
        }
        #[cfg(feature = "parallel")]
        for threads in [2, 3] {
            let pool = crate::base::exec::Pool::new(threads).expect("threads");
            assert!(run(&pool) == plain, "{threads} threads");
        }
    }
}
