//! The photo's unknown light scale, and the coarse-to-fine search for the roughness at each pixel.
//!
//! Source: the paper's section "Roughness refinement": with normal and albedo known and the light at the camera, the
//! roughness of each pixel is the one whose predicted colour is nearest to the photo's, found on a coarse grid and
//! then on a fine one around its best value (two stages, as in Hui et al.'s univariate BRDF sampling).
//!
//! The error of a roughness is the squared distance of linear RGB at that pixel alone (no pooling of neighbours). It
//! is neither convex nor monotonic: beside the highlight's centre the lobe first gains and then loses with roughness,
//! so two values may explain a pixel alike. Equal errors give the smaller roughness. How much a pixel says is the
//! observability; where it is 0 the roughness found means nothing.
use crate::Error;
use crate::brdf::{Angles, Incident, Light, Scene, ggx, row_of, vectors};
use crate::exec::{Executor, Plane, ROWS_PER_BLOCK, for_each_row_block};
use crate::frame::LinearImage;
use crate::frame::geometry::Geometry;
use crate::maps::check_planes;
use crate::math::{expf, logf, powf, sqrtf};
use core::f32::consts::PI;
use glam::Vec3;

/// Values of the coarse grid: 1/16, 2/16 … 1. The fine grid has as many, 1/128 apart, around the best of them.
const GRID: usize = 16;
/// Smallest roughness that the search gives (alpha of smaller ones is clamped in the model).
pub const MIN_ROUGHNESS: f32 = 1.0 / 32.0;
/// Mean of the photo's unclipped pixels, linear, under which it is black: code 2 of 255 is brighter.
const BLACK: f64 = 5e-4;

/// Whether a photo shows anything to compare a render with.
///
/// # Errors
/// [`Error::NoUsablePixels`] when every pixel is clipped, [`Error::PhotoBlack`] when the others are black,
/// [`Error::PlaneLength`], [`Error::Size`].
pub fn check_exposure(photo: &LinearImage<'_>) -> Result<(), Error> {
    photo.check()?;
    let (mut sum, mut count) = (0.0_f64, 0_u32);
    for (p, _) in usable(photo, photo.rgb) {
        sum += f64::from(p);
        count += 1;
    }
    if count == 0 {
        return Err(Error::NoUsablePixels);
    }
    if sum / f64::from(count) < BLACK { Err(Error::PhotoBlack) } else { Ok(()) }
}

/// The scale s for which s times `render` (3 planes, made with light strength 1) is nearest to the photo.
///
/// Weighted least squares in closed form over all channels of pixels that are not clipped:
/// s = sum(w R P) / sum(w R²). The weight is 1/m, m the mean of photo and prediction (plus 0.02): an error then counts
/// about as much as the eye, or gamma 2.2, has it. Three steps from the geometric mean of the ratios, with the last s
/// in m; relative errors over 0.3 weigh as 0.3 (Huber) and those over 1 not at all, so that a highlight that is
/// elsewhere, or a thousand times too bright, does not pull.
///
/// # Errors
/// [`Error::NoUsablePixels`] when every pixel is clipped or `render` is black, [`Error::PhotoBlack`],
/// [`Error::PlaneLength`], [`Error::Size`].
pub fn light_scale(photo: &LinearImage<'_>, render: &[f32]) -> Result<f32, Error> {
    check_planes(photo.size, 3, render.len())?;
    check_exposure(photo)?;
    let mut scale = starting_scale(photo, render)?;
    for _ in 0..3 {
        let (mut rp, mut rr) = (0.0_f64, 0.0_f64);
        for (p, r) in usable(photo, render) {
            let predicted: f32 = scale * r;
            let mean = (p + predicted) * 0.5 + 0.02;
            let relative = (p - predicted).abs() / mean;
            if relative <= 1.0 {
                let weight = if relative > 0.3 { 0.3 / (relative * mean) } else { 1.0 / mean };
                rp += f64::from(weight * r * p);
                rr += f64::from(weight * r * r);
            }
        }
        let s = (rp / rr) as f32;
        if s.is_finite() && s > 0.0 {
            scale = s;
        }
    }
    Ok(scale)
}

/// The geometric mean of the ratios of photo to render: a start that a few immense highlights do not move.
fn starting_scale(photo: &LinearImage<'_>, render: &[f32]) -> Result<f32, Error> {
    let (mut sum, mut count) = (0.0_f64, 0_u32);
    for (p, r) in usable(photo, render) {
        if r > 0.0 && r.is_finite() {
            sum += f64::from(logf((p + 0.005) / (r + 0.005)));
            count += 1;
        }
    }
    if count == 0 {
        return Err(Error::NoUsablePixels);
    }
    let start = expf((sum / f64::from(count)) as f32);
    if start.is_finite() && start > 0.0 { Ok(start) } else { Err(Error::NoUsablePixels) }
}

/// RMSE in [0,1] of the re-render against the photo, both with gamma 2.2 and clamped to [0,1], clipped pixels left
/// out; 0 when no pixel is left.
///
/// # Errors
/// [`Error::PlaneLength`], [`Error::Size`].
pub fn residual(photo: &LinearImage<'_>, render: &[f32]) -> Result<f32, Error> {
    photo.check()?;
    check_planes(photo.size, 3, render.len())?;
    let (mut sum, mut count) = (0.0_f64, 0_u32);
    for (p, r) in usable(photo, render) {
        let gamma = |x: f32| powf(x.clamp(0.0, 1.0), 1.0 / 2.2);
        let error = f64::from(gamma(p) - gamma(r));
        sum += error * error;
        count += 1;
    }
    Ok(sqrtf((sum / f64::from(count.max(1))) as f32))
}

/// Photo and render, channel by channel, where the photo is not clipped.
fn usable<'a>(photo: &'a LinearImage<'a>, render: &'a [f32]) -> impl Iterator<Item = (f32, f32)> + 'a {
    let clipped = photo.clipped.iter().cycle();
    let values = photo.rgb.iter().zip(render).zip(clipped);
    values.filter(|&(_, &clipped)| clipped == 0).map(|((&p, &r), _)| (p, r))
}

/// Fills `roughness` with the value found at each pixel and `observability` with how much the photo says about it.
///
/// `albedo` and `normal` are 3 planes each; `light.strength` is the light scale. A clipped pixel's prediction is
/// clamped to 1 as the camera clamped the photo.
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
    let n = photo.size;
    photo.check()?;
    Scene { fov_deg: photo.fov_deg, light: *light }.check()?;
    check_planes(n, 3, albedo.len())?;
    check_planes(n, 3, normal.len())?;
    check_planes(n, 1, roughness.len())?;
    check_planes(n, 1, observability.len())?;
    let geometry = Geometry::new(n, photo.fov_deg);
    let coarse = Lobe::coarse();
    let out = (Plane::new(roughness, n), Plane::new(observability, n));
    for_each_row_block(exec, n, ROWS_PER_BLOCK, out, &|range, (mut found, mut seen)| {
        for (row, (found, seen)) in range.zip(found.rows().zip(seen.rows())) {
            let clipped = photo.clipped.iter().skip(row * n);
            let pixels = row_of(albedo, normal, n, row).zip(vectors(photo.rgb, n, row)).zip(clipped);
            let out = found.iter_mut().zip(seen);
            for (column, ((((albedo, normal), photo), &clipped), (found, seen))) in
                pixels.zip(out).enumerate()
            {
                let at = Incident::at(geometry.point(row, column), light);
                let pixel = Pixel::new(photo, clipped != 0, albedo, normal, f0, &at);
                let errors = pixel.errors(&coarse);
                let best = coarse.roughness[smallest(&errors)];
                let fine = Lobe::around(best);
                *found = fine.roughness[smallest(&pixel.errors(&fine))];
                *seen = observability_of(&coarse.roughness, &errors, photo);
            }
        }
    });
    Ok(())
}

/// What of the specular term depends on the roughness alone, for a grid of values.
struct Lobe {
    roughness: [f32; GRID],
    alpha2: [f32; GRID],
    k: [f32; GRID],
}

impl Lobe {
    fn new(roughness: [f32; GRID]) -> Self {
        let alpha2 = roughness.map(|r| {
            let alpha = ggx::alpha(r);
            alpha * alpha
        });
        Self { roughness, alpha2, k: roughness.map(ggx::k) }
    }

    fn coarse() -> Self {
        Self::new(core::array::from_fn(|i| (i + 1) as f32 / GRID as f32))
    }

    /// From one coarse step below `best` to one fine step short of a coarse step above it.
    fn around(best: f32) -> Self {
        let half = GRID as f32 / 2.0;
        let step = 1.0 / (GRID as f32 * half);
        Self::new(core::array::from_fn(|i| (best + (i as f32 - half) * step).clamp(MIN_ROUGHNESS, 1.0)))
    }
}

/// A pixel, with all that does not depend on the roughness worked out.
struct Pixel {
    photo: [f32; 3],
    /// Predicted diffuse radiance.
    diffuse: [f32; 3],
    /// F (n.l) E / (4 pi): times D pi G / ((n.l) (n.v)) it is the specular radiance.
    specular: f32,
    cos2: f32,
    sin2: f32,
    n_dot_l: f32,
    n_dot_v: f32,
    /// Where the camera clamped.
    white: f32,
}

impl Pixel {
    #[inline]
    fn new(photo: Vec3, clipped: bool, albedo: Vec3, normal: Vec3, f0: f32, at: &Incident) -> Self {
        let white = if clipped { 1.0 } else { f32::MAX };
        let photo = photo.to_array();
        match Angles::of(normal, at.light, at.view) {
            Some(Angles { n_dot_l, n_dot_v, v_dot_h, cos2, sin2 }) => {
                let irradiance = n_dot_l * at.irradiance / PI;
                let diffuse = (albedo * irradiance).to_array();
                let specular = ggx::fresnel(v_dot_h, f0) * irradiance * 0.25;
                Self { photo, diffuse, specular, cos2, sin2, n_dot_l, n_dot_v, white }
            }
            // Unlit: black, whatever the roughness.
            None => Self {
                photo,
                diffuse: [0.0; 3],
                specular: 0.0,
                cos2: 1.0,
                sin2: 0.0,
                n_dot_l: 1.0,
                n_dot_v: 1.0,
                white,
            },
        }
    }

    /// Squared error against the photo at each roughness of the grid. One division each, no branch: the compiler
    /// makes vectors of it.
    #[inline]
    fn errors(&self, lobe: &Lobe) -> [f32; GRID] {
        let mut errors = [0.0; GRID];
        for ((error, &alpha2), &k) in errors.iter_mut().zip(&lobe.alpha2).zip(&lobe.k) {
            let root = self.sin2 + self.cos2 * alpha2;
            let shadow = (self.n_dot_l * (1.0 - k) + k) * (self.n_dot_v * (1.0 - k) + k);
            let specular = self.specular * (alpha2 / (root * root * shadow));
            for (&diffuse, &photo) in self.diffuse.iter().zip(&self.photo) {
                let predicted = diffuse + specular;
                let predicted = if predicted < self.white { predicted } else { self.white };
                *error += (predicted - photo) * (predicted - photo);
            }
        }
        errors
    }
}

/// Index of the smallest value, the first of equal ones.
#[inline]
fn smallest(errors: &[f32; GRID]) -> usize {
    let mut best = 0;
    let mut least = errors[0];
    for (i, &error) in errors.iter().enumerate() {
        if error < least {
            (best, least) = (i, error);
        }
    }
    best
}

#[inline]
fn observability_of(grid: &[f32; GRID], errors: &[f32; GRID], photo: Vec3) -> f32 {
    let noise = 0.01 + 0.1 * (photo.x + photo.y + photo.z) / 3.0;
    let scale = 1.0 / (3.0 * noise * noise);
    let likelihood = errors.map(|e| {
        let t = 1.0 / (1.0 + e * scale);
        t * t
    });
    let (mut w, mut wr) = (0.0, 0.0);
    for (&l, &r) in likelihood.iter().zip(grid) {
        w += l;
        wr += l * r;
    }
    let mean = wr / w;
    let mut spread = 0.0;
    for (&l, &r) in likelihood.iter().zip(grid) {
        spread += l * (r - mean) * (r - mean);
    }
    // Variance of equal weights on GRID values 1/GRID apart: (GRID² - 1) / 12 steps².
    let equal = (GRID * GRID - 1) as f32 / (12 * GRID * GRID) as f32;
    // `max` turns NaN (every likelihood 0) into 0.
    (1.0 - sqrtf(spread / w / equal)).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brdf::{Sample, render};
    use crate::exec::Inline;
    use crate::maps::Maps;
    use std::vec;
    use std::vec::Vec;

    struct Scenery {
        n: usize,
        albedo: Vec<f32>,
        normal: Vec<f32>,
        roughness: Vec<f32>,
        photo: Vec<f32>,
        clipped: Vec<u8>,
    }

    const FOV: f32 = 43.35;

    /// Slightly wavy material with roughness falling from left to right, photographed with light scale `scale`.
    fn scenery(n: usize, f0: f32, scale: f32) -> Scenery {
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
        let clipped = (0..plane).map(|i| u8::from((0..3).any(|c| photo[c * plane + i] >= 1.0))).collect();
        photo.iter_mut().for_each(|v| *v = v.min(1.0));
        Scenery { n, albedo, normal, roughness, photo, clipped }
    }

    impl Scenery {
        fn photo(&self) -> LinearImage<'_> {
            LinearImage {
                size: self.n,
                rgb: &self.photo,
                clipped: &self.clipped,
                fov_deg: FOV,
                light_scale: None,
            }
        }

        fn search(&self, f0: f32, scale: f32, exec: &dyn Executor) -> (Vec<f32>, Vec<f32>) {
            let (mut r, mut o) = (vec![0.0; self.n * self.n], vec![0.0; self.n * self.n]);
            let light = Light { strength: scale, ..Light::default() };
            roughness(&self.photo(), &self.albedo, &self.normal, f0, &light, exec, &mut r, &mut o)
                .expect("shapes");
            (r, o)
        }

        fn render(&self, f0: f32) -> Vec<f32> {
            let mut out = vec![0.0; 3 * self.n * self.n];
            let maps =
                Maps { size: self.n, albedo: &self.albedo, normal: &self.normal, roughness: &self.roughness };
            render(&maps, f0, &Scene::flash(FOV, 1.0), &Inline, &mut out).expect("scene");
            out
        }
    }

    #[test]
    fn the_scale_of_an_exact_photo_is_found_exactly() {
        for scale in [0.05, 0.7, 1.0, 3.0] {
            let s = scenery(32, 0.05, scale);
            let found = light_scale(&s.photo(), &s.render(0.05)).expect("usable");
            assert!((found / scale - 1.0).abs() < 1e-4, "{scale}: {found}");
        }
    }

    #[test]
    fn wrong_highlights_do_not_pull_the_scale() {
        let mut s = scenery(32, 0.05, 0.8);
        let render = s.render(0.05);
        // One pixel in twenty is ten times too bright.
        for value in s.photo.iter_mut().step_by(20) {
            *value = (*value * 10.0).min(0.99);
        }
        let plain: f32 = {
            let (mut rp, mut rr) = (0.0, 0.0);
            for (p, r) in usable(&s.photo(), &render) {
                rp += r * p;
                rr += r * r;
            }
            rp / rr
        };
        let found = light_scale(&s.photo(), &render).expect("usable");
        assert!((found / 0.8 - 1.0).abs() < 0.06, "{found}");
        assert!((found - 0.8).abs() < 0.3 * (plain - 0.8).abs(), "{found}, plain least squares {plain}");
    }

    #[test]
    fn photos_without_information_are_errors() {
        let mut s = scenery(8, 0.05, 1.0);
        let render = s.render(0.05);
        assert_eq!(light_scale(&s.photo(), &vec![0.0; 192]), Err(Error::NoUsablePixels));
        assert_eq!(light_scale(&s.photo(), &[0.0; 3]), Err(Error::PlaneLength { needed: 192, given: 3 }));
        s.clipped.fill(1);
        assert_eq!(light_scale(&s.photo(), &render), Err(Error::NoUsablePixels));
        s.clipped.fill(0);
        s.photo.fill(1e-4);
        assert_eq!(light_scale(&s.photo(), &render), Err(Error::PhotoBlack));
    }

    #[test]
    fn the_residual_is_gamma_2_2_rmse_of_unclipped_pixels() {
        let image = LinearImage {
            size: 2,
            rgb: &[0.25; 12],
            clipped: &[0, 0, 0, 1],
            fov_deg: FOV,
            light_scale: None,
        };
        assert_eq!(residual(&image, &[0.25; 12]), Ok(0.0));
        // 1 - 0.25^(1/2.2) = 0.467479 where not clipped; over-bright render counts as white.
        let mut render = [7.0; 12];
        render[3] = 0.0;
        assert!((residual(&image, &render).expect("shape") - 0.467_479).abs() < 1e-5);
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
                let radiance = if s.clipped[i] == 0 { radiance } else { radiance.min(Vec3::ONE) };
                (radiance - pick(&s.photo)).length_squared()
            };
            let least = (4..=128).map(|j| error(j as f32 / 128.0)).fold(f32::MAX, f32::min);
            // Within what a hundredth of brightness makes.
            missed += u32::from(error(found[i]) > least + 3.0 * 0.01 * 0.01);
        }
        assert!(f64::from(missed) < 0.01 * plane as f64, "{missed} of {plane}");
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

    #[cfg(feature = "parallel")]
    #[test]
    fn threads_do_not_change_a_bit() {
        let s = scenery(45, 0.05, 0.9);
        let pool = crate::exec::Pool::new(3).expect("threads");
        assert_eq!(s.search(0.05, 0.9, &pool), s.search(0.05, 0.9, &Inline));
    }
}
