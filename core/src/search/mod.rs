//! The photo's unknown light scale, where its flash is, and the coarse-to-fine search for the roughness at each pixel.
//!
//! Source: the paper's section "Roughness refinement": with normal and albedo known and the light at the camera, the
//! roughness of each pixel is the one whose predicted colour is nearest to the photo's, found on a coarse grid and
//! then on a fine one around its best value (two stages, as in Hui et al.'s univariate BRDF sampling).
//!
//! The error of a roughness is the squared distance of linear RGB at that pixel alone (no pooling of neighbours). It
//! is neither convex nor monotonic: beside the highlight's centre the lobe first gains and then loses with roughness,
//! so two values may explain a pixel alike. Equal errors give the smaller roughness. How much a pixel says is the
//! observability; where it is 0 the roughness found means nothing.
mod exposure;
mod flash;

pub use exposure::{Lights, check_exposure, light_scale, lights, residual};
pub use flash::{flash_position, flash_position_bytes};

use crate::Error;
use crate::base::exec::{Executor, Plane, ROWS_PER_BLOCK, Rows, Watch, for_each_row_block, within};
use crate::base::lanes::{LANES, Lanes, load3, store, unset};
use crate::base::math::approx::sqrt;
use crate::base::planes::check_planes;
use crate::brdf::{Angles, Incident, Light, Scene, ggx};
use crate::frame::LinearImage;
use crate::frame::geometry::Geometry;
use core::f32::consts::PI;
use core::ops::ControlFlow;
use glam::Vec3;

/// Values of the coarse grid: 1/16, 2/16 … 1. The fine grid has as many, 1/128 apart, around the best of them.
const GRID: usize = 16;
/// Smallest roughness that the search gives (alpha of smaller ones is clamped in the model).
pub const MIN_ROUGHNESS: f32 = 1.0 / 32.0;
/// Fills `roughness` with the value found at each pixel and `observability` with how much the photo says about it.
///
/// `albedo` and `normal` are 3 planes each; `light.strength` is the light scale. Where a channel is
/// clipped its prediction is clamped to 1 as the camera clamped the photo.
///
/// The observability is 1 - std/std0, clamped to [0,1]: std is the standard deviation of the roughness on the coarse
/// grid, each value weighted by its likelihood (Student's t, three degrees of freedom, scale 0.01 + 0.1 of the
/// pixel's brightness: sensor noise and errors of albedo and normal), std0 that of equal weights. 0: every roughness
/// explains the pixel alike, or two far apart do. 1: one value alone does.
///
/// # Errors
/// [`Error::PlaneLength`], [`Error::Size`], [`Error::LightBelowPlane`], [`Error::FieldOfView`].
#[expect(
    clippy::too_many_arguments,
    reason = "four planes in, two out, and the scene: no two of them belong together"
)]
pub fn roughness(
    photo: &LinearImage<'_>,
    albedo: &[f32],
    normal: &[f32],
    f0: f32,
    light: &Light,
    exec: &dyn Executor,
    roughness: &mut [f32],
    observability: &mut [f32],
) -> Result<(), Error> {
    let out = (roughness, observability);
    roughness_watched(photo, (albedo, normal), f0, light, exec, out, &mut |_| ControlFlow::Continue(()))
}

/// Pixels that are searched between two calls of the watcher, in whole row blocks.
const STRIP: usize = 1 << 18;

/// [`roughness`], which tells `watch` after every strip of rows.
pub(crate) fn roughness_watched(
    photo: &LinearImage<'_>,
    (albedo, normal): (&[f32], &[f32]),
    f0: f32,
    light: &Light,
    exec: &dyn Executor,
    (roughness, observability): (&mut [f32], &mut [f32]),
    watch: Watch<'_>,
) -> Result<(), Error> {
    let n = photo.size;
    photo.check()?;
    Scene { fov_deg: photo.fov_deg, light: *light }.check()?;
    check_planes(n, 3, albedo.len())?;
    check_planes(n, 3, normal.len())?;
    check_planes(n, 1, roughness.len())?;
    check_planes(n, 1, observability.len())?;
    let geometry = Geometry::new(n, photo.fov_deg);
    let strip = (STRIP / n).next_multiple_of(ROWS_PER_BLOCK).max(ROWS_PER_BLOCK);
    let mut rest = (Plane::new(roughness, n), Plane::new(observability, n));
    for first in (0..n).step_by(strip) {
        let (out, more) = rest.split_rows(strip);
        rest = more;
        let rows = strip.min(n - first);
        within(exec, || {
            search_rows(photo, (albedo, normal), f0, light, &geometry, exec, (first, rows), out);
            Ok(())
        })?;
        if watch((first + rows) as f32 / n as f32).is_break() {
            return Err(Error::Cancelled);
        }
    }
    Ok(())
}

/// [`roughness`] of `rows` rows from `first` on; the outputs begin there.
#[expect(clippy::too_many_arguments, reason = "as `roughness`, and which rows")]
fn search_rows(
    photo: &LinearImage<'_>,
    (albedo, normal): (&[f32], &[f32]),
    f0: f32,
    light: &Light,
    geometry: &Geometry,
    exec: &dyn Executor,
    (first, rows): (usize, usize),
    out: (Plane<'_, f32>, Plane<'_, f32>),
) {
    let n = photo.size;
    for_each_row_block(exec, rows, ROWS_PER_BLOCK, out, &|range, (mut found, mut seen)| {
        exec.simd().run(
            #[inline(always)]
            || {
                let range = range.start + first..range.end + first;
                for (row, (found, seen)) in range.zip(found.rows().zip(seen.rows())) {
                    let clipped = photo.clipped.get(row * n..(row + 1) * n).unwrap_or(&[]);
                    for start in (0..n).step_by(LANES) {
                        let colours = load3(photo.rgb, n, row, start);
                        let albedo = load3(albedo, n, row, start);
                        let normal = load3(normal, n, row, start);
                        let free = [0, 1, 2].map(
                            #[inline(always)]
                            |c| unset(clipped, 1 << c, start),
                        );
                        let at = |i: usize| Incident::at(geometry.point(row, start + i), light);
                        let run = Run::new(colours, &free, &albedo, &normal, f0, at);
                        let (best, observability) = run.coarse();
                        store(&run.fine(&best), found, start);
                        store(&observability, seen, start);
                    }
                }
            },
        );
    });
}

/// A run of pixels, with all that does not depend on the roughness worked out.
struct Run {
    photo: [Lanes; 3],
    /// Predicted diffuse radiance.
    diffuse: [Lanes; 3],
    /// F (n.l) E / (4 pi): times D pi G / ((n.l) (n.v)) it is the specular radiance.
    specular: Lanes,
    cos2: Lanes,
    sin2: Lanes,
    n_dot_l: Lanes,
    n_dot_v: Lanes,
    /// Where the camera clamped.
    white: [Lanes; 3],
}

/// Value `i` of the coarse grid.
#[inline(always)]
fn coarse_value(i: usize) -> f32 {
    (i + 1) as f32 / GRID as f32
}

impl Run {
    #[inline(always)]
    fn new(
        photo: [Lanes; 3],
        free: &[Lanes; 3],
        albedo: &[Lanes; 3],
        normal: &[Lanes; 3],
        f0: f32,
        at: impl Fn(usize) -> Incident,
    ) -> Self {
        let zero = [0.0; LANES];
        let (mut diffuse, mut white) = ([zero; 3], [zero; 3]);
        let [mut specular, mut cos2, mut sin2, mut n_dot_l, mut n_dot_v] = [zero; 5];
        for i in 0..LANES {
            let at = at(i);
            let normal = Vec3::new(normal[0][i], normal[1][i], normal[2][i]);
            let (angles, lit) = Angles::anyhow(normal, at.light, at.view);
            let irradiance = angles.n_dot_l * at.irradiance * (1.0 / PI);
            // Unlit: black, whatever the roughness.
            for c in 0..3 {
                diffuse[c][i] = if lit { albedo[c][i] * irradiance } else { 0.0 };
            }
            let fresnel = ggx::fresnel(angles.v_dot_h, f0) * irradiance * 0.25;
            specular[i] = if lit { fresnel } else { 0.0 };
            cos2[i] = if lit { angles.cos2 } else { 1.0 };
            sin2[i] = if lit { angles.sin2 } else { 0.0 };
            n_dot_l[i] = if lit { angles.n_dot_l } else { 1.0 };
            n_dot_v[i] = if lit { angles.n_dot_v } else { 1.0 };
            for c in 0..3 {
                white[c][i] = if free[c][i] > 0.0 { f32::MAX } else { 1.0 };
            }
        }
        Self { photo, diffuse, specular, cos2, sin2, n_dot_l, n_dot_v, white }
    }

    /// Squared error of pixel `i` against the photo at a roughness given by alpha² and k.
    #[inline(always)]
    fn error(&self, i: usize, alpha2: f32, k: f32) -> f32 {
        let root = self.sin2[i] + self.cos2[i] * alpha2;
        let shadow = (self.n_dot_l[i] * (1.0 - k) + k) * (self.n_dot_v[i] * (1.0 - k) + k);
        let specular = self.specular[i] * (alpha2 / (root * root * shadow));
        let mut error = 0.0;
        for c in 0..3 {
            let predicted = self.diffuse[c][i] + specular;
            let predicted = if predicted < self.white[c][i] { predicted } else { self.white[c][i] };
            error += (predicted - self.photo[c][i]) * (predicted - self.photo[c][i]);
        }
        error
    }

    /// The best value of the coarse grid, the first of equals, and the observability.
    #[inline(always)]
    fn coarse(&self) -> (Lanes, Lanes) {
        let mut errors = [[0.0; LANES]; GRID];
        let (mut best, mut least) = ([coarse_value(0); LANES], [f32::INFINITY; LANES]);
        for (g, errors) in errors.iter_mut().enumerate() {
            let r = coarse_value(g);
            let (alpha2, k) = (alpha2(r), ggx::k(r));
            for i in 0..LANES {
                let error = self.error(i, alpha2, k);
                errors[i] = error;
                best[i] = if error < least[i] { r } else { best[i] };
                least[i] = if error < least[i] { error } else { least[i] };
            }
        }
        (best, self.observability(&mut errors))
    }

    /// From one coarse step below `best` to one fine step short of a coarse step above it.
    #[inline(always)]
    fn fine(&self, best: &Lanes) -> Lanes {
        let half = GRID as f32 / 2.0;
        let step = 1.0 / (GRID as f32 * half);
        let at = |i: usize, g: usize| (best[i] + (g as f32 - half) * step).clamp(MIN_ROUGHNESS, 1.0);
        let mut found = [0.0; LANES];
        for (i, found) in found.iter_mut().enumerate() {
            *found = at(i, 0);
        }
        let mut least = [f32::INFINITY; LANES];
        for g in 0..GRID {
            for i in 0..LANES {
                let r = at(i, g);
                let error = self.error(i, alpha2(r), ggx::k(r));
                found[i] = if error < least[i] { r } else { found[i] };
                least[i] = if error < least[i] { error } else { least[i] };
            }
        }
        found
    }

    /// From the errors on the coarse grid, which become likelihoods.
    #[inline(always)]
    fn observability(&self, errors: &mut [Lanes; GRID]) -> Lanes {
        let [mut scale, mut w, mut wr, mut spread] = [[0.0; LANES]; 4];
        let [red, green, blue] = &self.photo;
        for (scale, ((r, g), b)) in scale.iter_mut().zip(red.iter().zip(green).zip(blue)) {
            let noise = 0.01 + 0.1 * (r + g + b) / 3.0;
            *scale = 1.0 / (3.0 * noise * noise);
        }
        for (g, errors) in errors.iter_mut().enumerate() {
            let r = coarse_value(g);
            for i in 0..LANES {
                let t = 1.0 / (1.0 + errors[i] * scale[i]);
                errors[i] = t * t;
                w[i] += t * t;
                wr[i] += t * t * r;
            }
        }
        for i in 0..LANES {
            wr[i] /= w[i];
        }
        for (g, likelihood) in errors.iter().enumerate() {
            let r = coarse_value(g);
            for i in 0..LANES {
                spread[i] += likelihood[i] * (r - wr[i]) * (r - wr[i]);
            }
        }
        // Variance of equal weights on GRID values 1/GRID apart: (GRID² - 1) / 12 steps².
        let equal = (GRID * GRID - 1) as f32 / (12 * GRID * GRID) as f32;
        for i in 0..LANES {
            let seen = 1.0 - sqrt(spread[i] / (w[i] * equal));
            // NaN (every likelihood 0) becomes 0.
            spread[i] = if seen > 0.0 { seen } else { 0.0 };
        }
        spread
    }
}

#[inline(always)]
fn alpha2(roughness: f32) -> f32 {
    let alpha = ggx::alpha(roughness);
    alpha * alpha
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::exec::{At, Inline};
    use crate::base::simd::{Level, Simd};
    use crate::brdf::{Sample, render};
    use crate::frame::ALL_CLIPPED;
    use crate::maps::Maps;
    use std::vec;
    use std::vec::Vec;

    pub(super) struct Scenery {
        n: usize,
        pub(super) albedo: Vec<f32>,
        normal: Vec<f32>,
        roughness: Vec<f32>,
        pub(super) photo: Vec<f32>,
        pub(super) clipped: Vec<u8>,
    }

    pub(super) const FOV: f32 = 43.35;

    /// Bit c where channel c of a pixel is at white or above.
    pub(super) fn marks(photo: &[f32], plane: usize) -> Vec<u8> {
        let mark = |i: usize, c: usize| u8::from(photo[c * plane + i] >= 1.0) << c;
        (0..plane).map(|i| mark(i, 0) | mark(i, 1) | mark(i, 2)).collect()
    }

    /// Slightly wavy material with roughness falling from left to right, photographed with light scale `scale`.
    pub(super) fn scenery(n: usize, f0: f32, scale: f32) -> Scenery {
        let plane = n * n;
        let (mut albedo, mut normal, mut roughness) =
            (vec![0.0; 3 * plane], vec![0.0; 3 * plane], vec![0.0; plane]);
        for i in 0..plane {
            let (x, y) = ((i % n) as f32 / n as f32, (i / n) as f32 / n as f32);
            let bump = Vec3::new(0.15 * (9.0 * x).sin(), 0.15 * (7.0 * y).cos(), 1.0).normalize();
            for c in 0..3 {
                albedo[c * plane + i] = 0.1 + 0.1 * c as f32 + 0.2 * (5.0 * x * y).sin().abs();
                normal[c * plane + i] = bump[c];
            }
            roughness[i] = 0.2 + 0.6 * x;
        }
        let mut photo = vec![0.0; 3 * plane];
        let maps = Maps { size: n, albedo: &albedo, normal: &normal, roughness: &roughness };
        render(&maps, f0, &Scene::flash(FOV, scale), &Inline, &mut photo).expect("scene");
        let clipped = marks(&photo, plane);
        photo.iter_mut().for_each(|v| *v = v.min(1.0));
        Scenery { n, albedo, normal, roughness, photo, clipped }
    }

    impl Scenery {
        pub(super) fn maps(&self) -> Maps<'_> {
            Maps { size: self.n, albedo: &self.albedo, normal: &self.normal, roughness: &self.roughness }
        }

        pub(super) fn photo(&self) -> LinearImage<'_> {
            LinearImage::new(self.n, &self.photo, &self.clipped, FOV)
        }

        fn search(&self, f0: f32, scale: f32, exec: &dyn Executor) -> (Vec<f32>, Vec<f32>) {
            let (mut r, mut o) = (vec![0.0; self.n * self.n], vec![0.0; self.n * self.n]);
            let light = Light { strength: scale, ..Light::default() };
            roughness(&self.photo(), &self.albedo, &self.normal, f0, &light, exec, &mut r, &mut o)
                .expect("shapes");
            (r, o)
        }

        pub(super) fn render(&self, f0: f32) -> Vec<f32> {
            let mut out = vec![0.0; 3 * self.n * self.n];
            let maps =
                Maps { size: self.n, albedo: &self.albedo, normal: &self.normal, roughness: &self.roughness };
            render(&maps, f0, &Scene::flash(FOV, 1.0), &Inline, &mut out).expect("scene");
            out
        }
    }

    /// Even without noise two values may explain a pixel alike; the observability knows where that is.
    #[test]
    fn the_more_the_photo_shows_the_nearer_the_roughness_is() {
        for (f0, scale) in [(0.05, 0.5), (0.5, 0.3), (0.05, 1.5)] {
            let s = scenery(64, f0, scale);
            let (found, seen) = s.search(f0, scale, &Inline);
            let mut bins = [(0.0_f32, 0.0_f32); 3];
            for ((&r, &o), (&truth, &clipped)) in
                found.iter().zip(&seen).zip(s.roughness.iter().zip(&s.clipped))
            {
                assert!((0.0..=1.0).contains(&o) && (MIN_ROUGHNESS..=1.0).contains(&r));
                if clipped == 0 {
                    let bin = &mut bins[((o * 4.0) as usize).min(2)];
                    bin.0 += (r - truth).abs();
                    bin.1 += 1.0;
                }
            }
            let [low, middle, high] = bins.map(|(sum, count)| sum / count);
            assert!(high < 0.06 && high < middle && middle < low, "{f0} {scale}: {bins:?}");
        }
    }

    /// Every value of the fine grid, with the model itself instead of the search's short form.
    #[test]
    fn exhaustive_search_finds_nothing_much_better() {
        let s = scenery(24, 0.05, 0.6);
        let (found, _) = s.search(0.05, 0.6, &Inline);
        let geometry = Geometry::new(s.n, FOV);
        let plane = s.n * s.n;
        let mut missed = 0;
        for i in 0..plane {
            let at =
                Incident::at(geometry.point(i / s.n, i % s.n), &Light { strength: 0.6, ..Light::default() });
            let pick = |v: &[f32]| Vec3::new(v[i], v[plane + i], v[2 * plane + i]);
            let error = |roughness: f32| {
                let normal = pick(&s.normal);
                let sample = Sample { albedo: pick(&s.albedo), normal, roughness, f0: 0.05 };
                let radiance = sample.evaluate(at.light, at.view) * normal.dot(at.light) * at.irradiance;
                let white = [1, 2, 4].map(|bit| if s.clipped[i] & bit == 0 { f32::MAX } else { 1.0 });
                let radiance = radiance.min(Vec3::from_array(white));
                (radiance - pick(&s.photo)).length_squared()
            };
            let least = (4..=128).map(|j| error(j as f32 / 128.0)).fold(f32::MAX, f32::min);
            // Within what a hundredth of brightness makes.
            missed += u32::from(error(found[i]) > least + 3.0 * 0.01 * 0.01);
        }
        assert!(f64::from(missed) < 0.01 * plane as f64, "{missed} of {plane}");
    }

    /// A prediction over white is white to the camera: it says nothing about how far over.
    #[test]
    fn a_clipped_photo_of_something_brighter_says_nothing() {
        let mut s = scenery(16, 0.05, 1.0);
        s.albedo.fill(0.9);
        s.photo.fill(1.0);
        s.clipped.fill(ALL_CLIPPED);
        let (found, seen) = s.search(0.05, 4.0, &Inline);
        assert!(
            found.iter().all(|&r| r == MIN_ROUGHNESS) && seen.iter().all(|&o| o < 1e-3),
            "{found:?} {seen:?}"
        );
    }

    #[test]
    fn flat_errors_give_the_smallest_roughness_and_no_observability() {
        let mut s = scenery(8, 0.05, 1.0);
        s.normal.fill(0.0);
        s.normal[2 * 64..].fill(-1.0);
        let (found, seen) = s.search(0.05, 1.0, &Inline);
        assert!(
            found.iter().all(|&r| r == MIN_ROUGHNESS) && seen.iter().all(|&o| o < 1e-3),
            "{found:?} {seen:?}"
        );
        s.normal.fill(f32::NAN);
        s.albedo.fill(f32::NAN);
        s.photo.fill(f32::NAN);
        let (found, seen) = s.search(f32::NAN, 1.0, &Inline);
        assert!(found.iter().all(|r| r.is_finite()) && seen.iter().all(|&o| o == 0.0));
    }

    #[test]
    fn the_cpu_level_does_not_change_a_bit() {
        for n in [45, 128, 200] {
            let s = scenery(n, 0.05, 0.9);
            let render = s.render(0.3);
            let all = |exec: &dyn Executor| {
                let scale = light_scale(&s.photo(), &render, exec).expect("usable");
                let residual = residual(&s.photo(), &render, exec).expect("planes");
                let Lights { flash, room } = lights(&s.photo(), &render, &s.albedo, exec).expect("usable");
                let (found, seen) = s.search(0.05, 0.9, exec);
                let mut again = vec![0.0; render.len()];
                let maps = Maps { size: n, albedo: &s.albedo, normal: &s.normal, roughness: &s.roughness };
                crate::brdf::render(&maps, 0.3, &Scene::flash(FOV, 1.0), exec, &mut again).expect("scene");
                let values = [scale, residual, flash, room].into_iter().chain(found).chain(seen).chain(again);
                values.map(f32::to_bits).collect::<Vec<u32>>()
            };
            let baseline = all(&Inline);
            for simd in Level::ALL.into_iter().filter_map(|level| Simd::for_level(level).ok()) {
                assert!(all(&At::new(&Inline, simd)) == baseline, "{simd:?} {n}");
            }
        }
    }

    #[cfg(feature = "parallel")]
    #[test]
    fn threads_do_not_change_a_bit() {
        let s = scenery(45, 0.05, 0.9);
        let pool = crate::base::exec::Pool::new(3).expect("threads");
        assert_eq!(s.search(0.05, 0.9, &pool), s.search(0.05, 0.9, &Inline));
    }
}
