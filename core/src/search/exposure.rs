//! How bright the photo is: whether it shows anything, its unknown light scale, and how near a render comes.
//!
//! Sums run over runs of pixels in f32, over the runs in f64, as a tree over row blocks.
use crate::Error;
use crate::base::exec::{Executor, ROWS_PER_BLOCK, sum_row_blocks};
use crate::base::lanes::{LANES, load, sum, unset};
use crate::base::math::approx::{exp2, gamma, log2};
use crate::base::math::sqrtf;
use crate::base::planes::{check_planes, plane_row};
use crate::frame::{Exposure, LinearImage};

/// Mean of the photo's values, linear, under which it is black: code 2 of 255 is brighter.
const BLACK: f64 = 5e-4;

/// Steps of [`lights`] after those of [`light_scale`].
const ROOM_STEPS: usize = 5;
/// Rows of a larger photo that [`light_scale`] looks at, or up to twice as many, evenly spread.
const ROWS: usize = 256;
/// The same of [`lights`]' own steps.
const ROOM_ROWS: usize = 128;

/// Whether a photo shows anything to compare a render with; its exposure, with the brightness of what is not clipped.
///
/// # Errors
/// [`Error::NoUsablePixels`] when every channel of every pixel is clipped, [`Error::PhotoBlack`] when the photo is black, what
/// is clipped included, [`Error::PlaneLength`], [`Error::Size`].
pub fn check_exposure(photo: &LinearImage<'_>, exec: &dyn Executor) -> Result<Exposure, Error> {
    photo.check()?;
    let usable = sums(
        photo,
        [],
        1,
        exec,
        #[inline(always)]
        |p, []| [p, 1.0],
    );
    let brightness = mean(usable).ok_or(Error::NoUsablePixels)? as f32;
    check_black(photo.rgb.len(), usable)?;
    Ok(Exposure { brightness, ..photo.exposure })
}

/// Whether a photo of `values` values is black: the sum and the number of those that are not clipped, the others being 1.
fn check_black(values: usize, [sum, number]: [f64; 2]) -> Result<(), Error> {
    let all = values as f64;
    if sum + (all - number) < BLACK * all { Err(Error::PhotoBlack) } else { Ok(()) }
}

/// The scale s for which s times `render` (3 planes, made with light strength 1) is nearest to the photo.
///
/// Weighted least squares in closed form over all values that are not clipped:
/// s = sum(w R P) / sum(w R²). The weight is 1/m, m the mean of photo and prediction (plus 0.02): an error then counts
/// about as much as the eye, or gamma 2.2, has it. Three steps from the geometric mean of the ratios, with the last s
/// in m; relative errors over 0.3 weigh as 0.3 (Huber) and those over 1 not at all, so that a highlight that is
/// elsewhere, or a thousand times too bright, does not pull.
///
/// # Errors
/// [`Error::NoUsablePixels`] when every value is clipped or `render` is black, [`Error::PhotoBlack`],
/// [`Error::PlaneLength`], [`Error::Size`].
pub fn light_scale(photo: &LinearImage<'_>, render: &[f32], exec: &dyn Executor) -> Result<f32, Error> {
    check_planes(photo.size, 3, render.len())?;
    photo.check()?;
    let step = (photo.size / ROWS).max(1);
    let (mut scale, step) = match starting_scale(photo, render, step, exec) {
        // Those rows may be what is overexposed or black.
        Err(_) if step > 1 => (starting_scale(photo, render, 1, exec)?, 1),
        scale => (scale?, step),
    };
    for _ in 0..3 {
        let [rp, rr] = sums(
            photo,
            [render],
            step,
            exec,
            #[inline(always)]
            |p, [r]| {
                let (weight, counts) = weight(p, scale * r);
                // Also where r is infinite.
                let r = if counts { r } else { 0.0 };
                [weight * r * p, weight * r * r]
            },
        );
        let s = (rp / rr) as f32;
        if s.is_finite() && s > 0.0 {
            scale = s;
        }
    }
    Ok(scale)
}

/// The weight of a value of the photo in [`light_scale`], and whether it counts at all.
#[inline(always)]
fn weight(photo: f32, predicted: f32) -> (f32, bool) {
    let mean = (photo + predicted) * 0.5 + 0.02;
    let error = (photo - predicted).abs();
    let large = error > 0.3 * mean;
    let numerator = if large { 0.3 } else { 1.0 };
    let denominator = if large { error } else { mean };
    (numerator / denominator, error <= mean)
}

/// What a re-render is lit with: the flash and, evenly, the room.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lights {
    /// Factor of a render made with light strength 1.
    pub flash: f32,
    /// The room's light as a share of the flash's at the centre, [0,1]: it adds `flash * room * albedo`.
    pub room: f32,
}

/// The lights whose sum is nearest to the photo: `flash` times `render` (3 planes, made with light strength 1) and
/// `flash * room` times `albedo` (3 planes), which is the diffuse part of a photo in even light.
///
/// The paper's photos have a room's light too ("Acquisition Setup and SVBRDF Decomposition"); an even one explains what is flatter
/// in the photo than the flash's falloff, whatever flattened it: on the test photos `room` correlates with the true one by 0.31
/// alone, since the albedo has taken its part already. For re-rendering, therefore, and no measurement of the room.
///
/// As [`light_scale`], from whose result it starts, with two unknowns and [`ROOM_STEPS`] steps more, which look at [`ROOM_ROWS`]
/// rows or up to twice as many. Not negative, and no more room than flash: beyond that the falloff, which tells them apart, is
/// hardly there.
///
/// # Errors
/// As [`light_scale`].
pub fn lights(
    photo: &LinearImage<'_>,
    render: &[f32],
    albedo: &[f32],
    exec: &dyn Executor,
) -> Result<Lights, Error> {
    check_planes(photo.size, 3, albedo.len())?;
    let start = Lights { flash: light_scale(photo, render, exec)?, room: 0.0 };
    Ok(nearer_lights(photo, [render, albedo], start, ROOM_STEPS, exec))
}

/// `steps` more steps of [`lights`], whose `render` and `albedo` these are, from `start` on.
pub(super) fn nearer_lights(
    photo: &LinearImage<'_>,
    [render, albedo]: [&[f32]; 2],
    start: Lights,
    steps: usize,
    exec: &dyn Executor,
) -> Lights {
    let step = (photo.size / ROOM_ROWS).max(1);
    let mut lights = start;
    for _ in 0..steps {
        let Lights { flash, room } = lights;
        let [rr, ra, aa, rp, ap] = sums(
            photo,
            [render, albedo],
            step,
            exec,
            #[inline(always)]
            |p, [r, a]| {
                let (weight, counts) = weight(p, flash * (r + room * a));
                let (r, a) = if counts { (r, a) } else { (0.0, 0.0) };
                [weight * r * r, weight * r * a, weight * a * a, weight * r * p, weight * a * p]
            },
        );
        // The least of a convex parabola over a wedge: within it, or on the side beyond which the free one lies.
        let determinant = rr * aa - ra * ra;
        let (free, even) = ((aa * rp - ra * ap) / determinant, (rr * ap - ra * rp) / determinant);
        let (flash, room) = if even > 0.0 && even >= free {
            ((rp + ap) / (rr + 2.0 * ra + aa), 1.0)
        } else if even > 0.0 {
            (free, even / free)
        } else {
            (rp / rr, 0.0)
        };
        if flash.is_finite() && flash > 0.0 {
            lights = Lights { flash: flash as f32, room: room as f32 };
        }
    }
    lights
}

/// The geometric mean of the ratios of photo to render: a start that a few immense highlights do not move. Checks the exposure
/// in the same pass.
fn starting_scale(
    photo: &LinearImage<'_>,
    render: &[f32],
    step: usize,
    exec: &dyn Executor,
) -> Result<f32, Error> {
    let [sum, number, logs, count] = sums(
        photo,
        [render],
        step,
        exec,
        #[inline(always)]
        |p, [r]| {
            let counts = (r > 0.0) & (r < f32::INFINITY);
            let r = if counts { r } else { 0.0 };
            let log = log2((p + 0.005) / (r + 0.005));
            if counts { [p, 1.0, log, 1.0] } else { [p, 1.0, 0.0, 0.0] }
        },
    );
    let exposure = [sum, number];
    if step > 1 && mean(exposure).ok_or(Error::NoUsablePixels)? < BLACK {
        return Err(Error::PhotoBlack);
    } else if step == 1 {
        check_black(photo.rgb.len(), exposure)?;
    }
    let start = exp2(mean([logs, count]).ok_or(Error::NoUsablePixels)? as f32);
    if start.is_finite() && start > 0.0 { Ok(start) } else { Err(Error::NoUsablePixels) }
}

/// RMSE in [0,1] of the re-render against the photo, both with gamma 2.2 and clamped to [0,1], clipped values left
/// out; 0 when none is left.
///
/// # Errors
/// [`Error::PlaneLength`], [`Error::Size`].
pub fn residual(photo: &LinearImage<'_>, render: &[f32], exec: &dyn Executor) -> Result<f32, Error> {
    photo.check()?;
    check_planes(photo.size, 3, render.len())?;
    let squares = sums(
        photo,
        [render],
        1,
        exec,
        #[inline(always)]
        |p, [r]| {
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

/// The sums of `terms(photo, renders)` over all values that are not clipped, in every `step`-th row.
#[inline(always)]
pub(super) fn sums<const K: usize, const N: usize>(
    photo: &LinearImage<'_>,
    renders: [&[f32]; K],
    step: usize,
    exec: &dyn Executor,
    terms: impl Fn(f32, [f32; K]) -> [f32; N] + Sync,
) -> [f64; N] {
    let n = photo.size;
    sum_row_blocks(exec, 0..n, ROWS_PER_BLOCK, &|rows| {
        exec.simd().run(
            #[inline(always)]
            || {
                let mut total = [0.0_f64; N];
                // Written anew for each run of pixels: made there, they would be cleared for each.
                let (mut loaded, mut values) = ([[0.0; LANES]; K], [[0.0; LANES]; N]);
                for row in rows.filter(|row| row.is_multiple_of(step)) {
                    let clipped = photo.clipped.get(row * n..(row + 1) * n).unwrap_or(&[]);
                    for start in (0..n).step_by(LANES) {
                        for plane in 0..3 {
                            let free = unset(clipped, 1 << plane, start);
                            let photo = load(plane_row(photo.rgb, n, plane * n + row), start);
                            for k in 0..K {
                                loaded[k] = load(plane_row(renders[k], n, plane * n + row), start);
                            }
                            for i in 0..LANES {
                                let terms = terms(photo[i], core::array::from_fn(|k| loaded[k][i]));
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
    use crate::base::exec::Inline;
    use crate::frame::ALL_CLIPPED;
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
    fn the_scale_of_a_large_photo_is_found_from_some_of_its_rows() {
        let n = 2 * ROWS;
        let mut s = scenery(n, 0.05, 0.7);
        let render = s.render(0.05);
        let found = light_scale(&s.photo(), &render, &Inline).expect("usable");
        assert!((found / 0.7 - 1.0).abs() < 1e-4, "{found}");
        // Nothing usable in the rows that are looked at: all are.
        for (i, clipped) in s.clipped.iter_mut().enumerate() {
            *clipped |= if (i / n).is_multiple_of(2) { ALL_CLIPPED } else { 0 };
        }
        let found = light_scale(&s.photo(), &render, &Inline).expect("usable");
        assert!((found / 0.7 - 1.0).abs() < 1e-4, "{found}");
    }

    #[test]
    fn flash_and_room_of_an_exact_photo_are_found() {
        for (flash, room) in [(0.7, 0.0), (0.4, 0.2), (1.0, 0.5), (0.3, 0.97), (0.5, 1.0)] {
            let mut s = scenery(64, 0.05, 1.0);
            let render = s.render(0.05);
            for (photo, (r, a)) in s.photo.iter_mut().zip(render.iter().zip(&s.albedo)) {
                *photo = flash * (r + room * a);
            }
            let found = lights(&s.photo(), &render, &s.albedo, &Inline).expect("usable");
            assert!((found.flash / flash - 1.0).abs() < 0.01, "{flash}, {room}: {found:?}");
            assert!((found.room - room).abs() < 0.01, "{flash}, {room}: {found:?}");
        }
    }

    /// A grid search over the wedge finds nothing better, by the weights of the last step.
    #[test]
    fn no_other_lights_are_nearer() {
        for seed in 0..6_u32 {
            let mut s = scenery(32, 0.05, 1.0);
            let render = s.render(0.05);
            // Falloff that the model has not: stronger in some, weaker (so that no room would be negative) in others.
            let bend = seed as f32 * 0.2 - 0.5;
            for (i, (photo, (r, a))) in s.photo.iter_mut().zip(render.iter().zip(&s.albedo)).enumerate() {
                let (x, y) = (i % 32, i / 32 % 32);
                *photo = 0.5 * (r + 0.4 * a) * (1.0 + bend * crate::crf::feature::radius_squared(x, y, 32));
            }
            let s = s;
            let photo = s.photo();
            let found = lights(&photo, &render, &s.albedo, &Inline).expect("usable");
            let cost = |lights: Lights| {
                sums(&photo, [&render, &s.albedo], 1, &Inline, |p, [r, a]| {
                    let (weight, counts) = weight(p, found.flash * (r + found.room * a));
                    let error = p - lights.flash * (r + lights.room * a);
                    [if counts { weight * error * error } else { 0.0 }]
                })[0]
            };
            let least = cost(found);
            for i in -20..=20 {
                for j in 0..=20 {
                    let other =
                        Lights { flash: found.flash * (1.0 + 0.02 * i as f32), room: j as f32 / 20.0 };
                    assert!(least <= cost(other) * 1.002, "{bend}: {found:?}, {other:?}");
                }
            }
            assert!((0.0..=1.0).contains(&found.room));
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
        s.clipped.fill(ALL_CLIPPED);
        assert_eq!(light_scale(&s.photo(), &render, &Inline), Err(Error::NoUsablePixels));
        s.clipped.fill(0);
        s.photo.fill(4.5e-4);
        assert_eq!(light_scale(&s.photo(), &render, &Inline), Err(Error::PhotoBlack));
        s.photo.fill(5.5e-4);
        let exposure = check_exposure(&s.photo(), &Inline).expect("not black");
        assert!((exposure.brightness - 5.5e-4).abs() < 1e-9, "{exposure:?}");
    }

    /// What is overexposed is no black: half a photo that is white beside black shows the edge at least.
    #[test]
    fn a_photo_of_white_and_black_is_not_black() {
        let mut s = scenery(8, 0.05, 1.0);
        let render = s.render(0.05);
        s.photo.fill(0.0);
        assert_eq!(check_exposure(&s.photo(), &Inline), Err(Error::PhotoBlack));
        s.photo.chunks_mut(2).for_each(|pair| pair[0] = 1.0);
        s.clipped.chunks_mut(2).for_each(|pair| pair[0] = ALL_CLIPPED);
        assert_eq!(check_exposure(&s.photo(), &Inline).map(|exposure| exposure.brightness), Ok(0.0));
        assert!(light_scale(&s.photo(), &render, &Inline).expect("usable") > 0.0);
    }

    /// Red is burnt out everywhere; the scale comes from green and blue.
    #[test]
    fn a_clipped_channel_leaves_the_others() {
        let mut s = scenery(32, 0.05, 0.7);
        let render = s.render(0.05);
        s.photo[..32 * 32].fill(1.0);
        s.clipped.fill(0b001);
        let found = light_scale(&s.photo(), &render, &Inline).expect("usable");
        assert!((found / 0.7 - 1.0).abs() < 1e-4, "{found}");
    }

    #[test]
    fn the_residual_is_gamma_2_2_rmse_of_unclipped_pixels() {
        let image = LinearImage::new(2, &[0.25; 12], &[0, 0, 0, ALL_CLIPPED], FOV);
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
            s.clipped.iter_mut().skip(5).step_by(7).for_each(|clipped| *clipped = ALL_CLIPPED);
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
