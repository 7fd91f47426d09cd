//! How bright the photo is: whether it shows anything, its unknown light scale, and how near a render comes.
//!
//! Sums run over runs of pixels in f32, over the runs in f64, as a tree over row blocks.
use crate::Error;
use crate::exec::{Executor, ROWS_PER_BLOCK, sum_row_blocks};
use crate::frame::LinearImage;
use crate::lanes::{LANES, Lanes, load, sum, unset};
use crate::maps::{check_planes, plane_row};
use crate::math::approx::{exp2, gamma, log2};
use crate::math::sqrtf;

/// Mean of the photo's unclipped pixels, linear, under which it is black: code 2 of 255 is brighter.
const BLACK: f64 = 5e-4;

/// Whether a photo shows anything to compare a render with.
///
/// # Errors
/// [`Error::NoUsablePixels`] when every pixel is clipped, [`Error::PhotoBlack`] when the others are black,
/// [`Error::PlaneLength`], [`Error::Size`].
pub fn check_exposure(photo: &LinearImage<'_>, exec: &dyn Executor) -> Result<(), Error> {
    photo.check()?;
    let exposure = sums(
        photo,
        photo.rgb,
        exec,
        #[inline(always)]
        |p, _| [p, 1.0],
    );
    check_mean(exposure)
}

/// The sum of the photo's values and their number.
fn check_mean(exposure: [f64; 2]) -> Result<(), Error> {
    if mean(exposure).ok_or(Error::NoUsablePixels)? < BLACK { Err(Error::PhotoBlack) } else { Ok(()) }
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
pub fn light_scale(photo: &LinearImage<'_>, render: &[f32], exec: &dyn Executor) -> Result<f32, Error> {
    check_planes(photo.size, 3, render.len())?;
    photo.check()?;
    let mut scale = starting_scale(photo, render, exec)?;
    for _ in 0..3 {
        let [rp, rr] = sums(
            photo,
            render,
            exec,
            #[inline(always)]
            |p, r| {
                let predicted = scale * r;
                let mean = (p + predicted) * 0.5 + 0.02;
                let error = (p - predicted).abs();
                let large = error > 0.3 * mean;
                let numerator = if large { 0.3 } else { 1.0 };
                let denominator = if large { error } else { mean };
                // Also where r is infinite.
                let r = if error <= mean { r } else { 0.0 };
                let weighted = numerator / denominator * r;
                [weighted * p, weighted * r]
            },
        );
        let s = (rp / rr) as f32;
        if s.is_finite() && s > 0.0 {
            scale = s;
        }
    }
    Ok(scale)
}

/// The geometric mean of the ratios of photo to render: a start that a few immense highlights do not move. Checks the exposure
/// in the same pass.
fn starting_scale(photo: &LinearImage<'_>, render: &[f32], exec: &dyn Executor) -> Result<f32, Error> {
    let [sum, number, logs, count] = sums(
        photo,
        render,
        exec,
        #[inline(always)]
        |p, r| {
            let counts = (r > 0.0) & (r < f32::INFINITY);
            let r = if counts { r } else { 0.0 };
            let log = log2((p + 0.005) / (r + 0.005));
            if counts { [p, 1.0, log, 1.0] } else { [p, 1.0, 0.0, 0.0] }
        },
    );
    check_mean([sum, number])?;
    let start = exp2(mean([logs, count]).ok_or(Error::NoUsablePixels)? as f32);
    if start.is_finite() && start > 0.0 { Ok(start) } else { Err(Error::NoUsablePixels) }
}

/// RMSE in [0,1] of the re-render against the photo, both with gamma 2.2 and clamped to [0,1], clipped pixels left
/// out; 0 when no pixel is left.
///
/// # Errors
/// [`Error::PlaneLength`], [`Error::Size`].
pub fn residual(photo: &LinearImage<'_>, render: &[f32], exec: &dyn Executor) -> Result<f32, Error> {
    photo.check()?;
    check_planes(photo.size, 3, render.len())?;
    let squares = sums(
        photo,
        render,
        exec,
        #[inline(always)]
        |p, r| {
            let error = gamma(p.clamp(0.0, 1.0)) - gamma(r.clamp(0.0, 1.0));
            [error * error, 1.0]
        },
    );
    Ok(sqrtf(mean(squares).unwrap_or(0.0) as f32))
}

/// The mean of values, given their sum and their number; None of no values.
fn mean([sum, count]: [f64; 2]) -> Option<f64> {
    (count > 0.0).then(|| sum / count)
}

/// The sums of `terms(photo, render)` over all channels of the pixels that are not clipped.
#[inline(always)]
fn sums<const N: usize>(
    photo: &LinearImage<'_>,
    render: &[f32],
    exec: &dyn Executor,
    terms: impl Fn(f32, f32) -> [f32; N] + Sync,
) -> [f64; N] {
    let n = photo.size;
    sum_row_blocks(exec, 0..n, ROWS_PER_BLOCK, &|rows| {
        exec.simd().run(
            #[inline(always)]
            || {
                let mut total = [0.0_f64; N];
                for row in rows {
                    let clipped = photo.clipped.get(row * n..(row + 1) * n).unwrap_or(&[]);
                    for start in (0..n).step_by(LANES) {
                        let free = unset(clipped, start);
                        for plane in 0..3 {
                            let photo = load(plane_row(photo.rgb, n, plane * n + row), start);
                            let render = load(plane_row(render, n, plane * n + row), start);
                            let mut values: [Lanes; N] = [[0.0; LANES]; N];
                            for i in 0..LANES {
                                let terms = terms(photo[i], render[i]);
                                for t in 0..N {
                                    values[t][i] = terms[t];
                                }
                            }
                            // Loops of their own: the one above must not branch on it.
                            for (total, values) in total.iter_mut().zip(&mut values) {
                                for i in 0..LANES {
                                    values[i] = if free[i] > 0.0 { values[i] } else { 0.0 };
                                }
                                *total += f64::from(sum(values));
                            }
                        }
                    }
                }
                total
            },
        )
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::{FOV, scenery};
    use super::*;
    use crate::exec::Inline;
    use std::vec;

    #[test]
    fn the_scale_of_an_exact_photo_is_found_exactly() {
        for scale in [0.05, 0.7, 1.0, 3.0] {
            let s = scenery(32, 0.05, scale);
            let found = light_scale(&s.photo(), &s.render(0.05), &Inline).expect("usable");
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
            let clipped = s.clipped.iter().cycle();
            for ((p, r), _) in s.photo.iter().zip(&render).zip(clipped).filter(|(_, clipped)| **clipped == 0)
            {
                rp += r * p;
                rr += r * r;
            }
            rp / rr
        };
        let found = light_scale(&s.photo(), &render, &Inline).expect("usable");
        assert!((found / 0.8 - 1.0).abs() < 0.06, "{found}");
        assert!((found - 0.8).abs() < 0.3 * (plain - 0.8).abs(), "{found}, plain least squares {plain}");
    }

    #[test]
    fn photos_without_information_are_errors() {
        let mut s = scenery(8, 0.05, 1.0);
        let render = s.render(0.05);
        assert_eq!(light_scale(&s.photo(), &vec![0.0; 192], &Inline), Err(Error::NoUsablePixels));
        assert_eq!(
            light_scale(&s.photo(), &[0.0; 3], &Inline),
            Err(Error::PlaneLength { needed: 192, given: 3 })
        );
        s.clipped.fill(1);
        assert_eq!(light_scale(&s.photo(), &render, &Inline), Err(Error::NoUsablePixels));
        s.clipped.fill(0);
        s.photo.fill(4.5e-4);
        assert_eq!(light_scale(&s.photo(), &render, &Inline), Err(Error::PhotoBlack));
        s.photo.fill(5.5e-4);
        assert_eq!(check_exposure(&s.photo(), &Inline), Ok(()));
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
        assert_eq!(residual(&image, &[0.25; 12], &Inline), Ok(0.0));
        // 1 - 0.25^(1/2.2) = 0.467479 where not clipped; over-bright render counts as white.
        let mut render = [7.0; 12];
        render[3] = 0.0;
        assert!((residual(&image, &render, &Inline).expect("shape") - 0.467_479).abs() < 1e-5);
    }

    /// The definition, with `libm`'s power, in f64.
    #[test]
    fn the_residual_is_its_definition_on_rows_of_any_length() {
        for n in [1, 37, 128, 200] {
            let mut s = scenery(n, 0.05, 1.0);
            let render: std::vec::Vec<f32> = s.photo.iter().map(|p| 0.8 * p + 0.03).collect();
            s.clipped.iter_mut().skip(5).step_by(7).for_each(|clipped| *clipped = 1);
            let (mut sum, mut count) = (0.0, 0.0);
            for ((p, r), clipped) in s.photo.iter().zip(&render).zip(s.clipped.iter().cycle()) {
                if *clipped == 0 {
                    let gamma = |x: f32| libm::pow(f64::from(x.clamp(0.0, 1.0)), 1.0 / 2.2);
                    sum += (gamma(*p) - gamma(*r)).powi(2);
                    count += 1.0;
                }
            }
            let found = f64::from(residual(&s.photo(), &render, &Inline).expect("planes"));
            assert!((found - (sum / count).sqrt()).abs() < 1e-6, "{n}: {found} {}", (sum / count).sqrt());
        }
    }
}
