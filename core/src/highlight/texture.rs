//! Texture where a highlight has burnt it out: taken from elsewhere in the same material.
//!
//! The photo shows no texture below a strong highlight, so the network's albedo is smooth there, a disc on leather or wood.
//! A flat material mostly looks alike all over; so the disc gets texture from where the photo shows it, as a clone stamp does.
//!
//! Texture is the albedo's ratio to its own means over [`GRID`] x [`GRID`] cells, less 1. A cell has lost it where more than
//! [`SPECULAR`] of its light is specular (the estimate of [`super::restore`]) and its contrast, squared, is below [`LOST`] of
//! the usual one and below that of nine tenths of the diffusely lit cells: where some are smooth anyhow, as on carved wood, a
//! smooth one has lost nothing. Such cells are given offsets, from the disc's rim inwards: a cell takes, of all windows of twice its size
//! that lie in diffusely lit cells, the one nearest to what surrounds it and is there already (least sum of squared differences
//! at [`MATCH`] x [`MATCH`] pixels; the first of equals). That is the patch search of image quilting (Efros and Freeman,
//! SIGGRAPH 2001), its patches laid from a rim. Neighbours tend to go on with the same offset, so threads and grain go on too.
//!
//! At full size each pixel blends the textures at the four nearest cells' offsets, bilinearly; a cell that lost nothing has
//! offset 0. The windows were chosen to agree where they overlap, so the blend keeps their contrast.
//!
//! Not in the paper. What it adds is likely, not seen: the errors of albedo cannot show its worth
//! (docs/decisions/017-inpaint-texture.md).
use super::{FLOOR, Look, SEEN, sizes};
use crate::Error;
use crate::base::arena::{Arena, bytes_for};
use crate::base::exec::{Executor, ROWS_PER_BLOCK, for_each_row_block, planes3};
use crate::base::resample::{Pair, bilinear, shrink};
use crate::frame::LinearImage;
use crate::maps::MapsMut;

/// Cells to a side.
const GRID: usize = 16;
const CELLS: usize = GRID * GRID;
/// Pixels to a side at which textures are compared.
const MATCH: usize = 64;
const CELL: usize = MATCH / GRID;
/// Side of a window: its hat-shaped weight reaches the neighbours' centres.
const WINDOW: usize = 2 * CELL;
/// Places of windows to a side, two pixels apart.
const PLACES: usize = (MATCH - WINDOW) / 2 + 1;
/// Share of specular light above which a cell may have lost its texture, and is no source of any.
const SPECULAR: f32 = 0.2;
/// Share of the usual squared contrast below which it has.
const LOST: f32 = 0.6;
/// One in so many diffusely lit cells may be smoother than one that has lost its texture.
const SMOOTHER: usize = 10;
/// More cells than this, and too little is left to take from.
const MOST: usize = CELLS * 6 / 10;
/// Texture makes no pixel darker than this share of its surroundings.
const DARKEST: f32 = 0.2;

/// Where each cell's texture comes from: (down, right) in pixels of [`MATCH`]; (0, 0): from the cell itself.
type Offsets = [[i8; 2]; CELLS];

/// Bytes of workspace that [`retexture`] needs for maps of `size` x `size`.
#[must_use]
pub fn retexture_bytes(size: usize) -> usize {
    if size > crate::base::planes::MAX_SIZE {
        return usize::MAX;
    }
    let (seen, _) = sizes(size);
    let (full, plane) = (bytes_for::<f32>(size.saturating_mul(size)), bytes_for::<f32>(seen * seen));
    // The texture at full size; the look, shares, and two planes of their size; cells' means, shares and contrast; texture,
    // what is filled in, and whether it is there, at the size of the search; the sources.
    full.saturating_mul(3)
        .saturating_add(plane.saturating_mul(Look::PLANES + 1 + 2))
        .saturating_add(bytes_for::<f32>(CELLS).saturating_mul(3 + 1 + 1))
        .saturating_add(bytes_for::<f32>(MATCH * MATCH).saturating_mul(3))
        .saturating_add(bytes_for::<u16>(PLACES * PLACES))
        .saturating_add(24 * crate::base::arena::ALIGN)
}

/// Gives the albedo of `maps` texture where a highlight has burnt it out, in place; `f0` is the material's specular reflectance.
///
/// Albedo stays within [0,1]; pixels away from the highlight keep their bits. Maps of fewer than 64 pixels a side, and photos
/// that are highlight for the most part, are left as they are.
///
/// # Errors
/// [`Error::PlaneLength`], [`Error::Size`], [`Error::FieldOfView`], [`Error::WorkspaceTooSmall`].
pub fn retexture(
    photo: &LinearImage<'_>,
    maps: &mut MapsMut<'_>,
    f0: f32,
    exec: &dyn Executor,
    arena: &mut Arena<'_>,
) -> Result<(), Error> {
    photo.check()?;
    maps.as_maps().check()?;
    let n = maps.size;
    if n < MATCH {
        return Ok(());
    }
    let (m, mut arena) = (n.min(SEEN), arena.scope());
    let diffuse = arena.take::<f32>(CELLS)?;
    let (means, contrast) = (arena.take::<f32>(3 * CELLS)?, arena.take::<f32>(CELLS)?);
    let (one, seen) = (arena.take::<f32>(m * m)?, arena.zeroed::<f32>(m * m)?);
    let relative = |[mean]: [f32; 1], value: f32| (value + FLOOR) / (mean + FLOOR) - 1.0;
    {
        let mut arena = arena.scope();
        let mut look = Look::new(photo, &maps.as_maps(), f0, exec, &mut arena)?;
        look.diffuse_shares(one, exec)?;
        shrink(one, m, GRID, diffuse, exec);
        let pair = Pair { n: m, m: GRID };
        for (albedo, means) in look.albedo.chunks_exact_mut(m * m).zip(means.chunks_exact_mut(CELLS)) {
            shrink(albedo, m, GRID, means, exec);
            pair.each([means], albedo, exec, relative);
            seen.iter_mut().zip(&*albedo).for_each(|(seen, one)| *seen += one / 3.0);
        }
    }
    one.iter_mut().zip(&*seen).for_each(|(square, seen)| *square = seen * seen);
    shrink(one, m, GRID, contrast, exec);
    let texture = arena.take::<f32>(MATCH * MATCH)?;
    shrink(seen, m, MATCH, texture, exec);
    let lost = lost(diffuse, contrast);
    let count = lost.iter().filter(|lost| **lost).count();
    let sources = sources(diffuse, arena.take(PLACES * PLACES)?);
    if !(1..=MOST).contains(&count) || sources.is_empty() {
        return Ok(());
    }
    let (filled, known) = (arena.take(MATCH * MATCH)?, arena.take(MATCH * MATCH)?);
    let mut search = Search { texture, filled, known, sources };
    let offsets = exec.simd().run(
        #[inline(always)]
        || search.run(lost),
    );
    let (detail, pair) = (arena.take::<f32>(3 * n * n)?, Pair { n, m: GRID });
    detail.copy_from_slice(maps.albedo);
    for (detail, means) in detail.chunks_exact_mut(n * n).zip(means.chunks_exact(CELLS)) {
        pair.each([means], detail, exec, relative);
    }
    blend(maps.albedo, n, detail, means, &offsets, exec);
    Ok(())
}

/// Whether a cell is lit diffusely, for the most part.
fn lit(diffuse: f32) -> bool {
    1.0 - diffuse <= SPECULAR
}

/// Which cells have lost their texture, by their shares of diffuse light and their squared contrast.
fn lost(diffuse: &[f32], contrast: &[f32]) -> [bool; CELLS] {
    let (mut sum, mut weights) = (0.0, 0.0);
    let (mut seen, mut count) = ([0.0; CELLS], 0);
    for (diffuse, contrast) in diffuse.iter().zip(contrast) {
        let weight = (diffuse * diffuse) * (diffuse * diffuse);
        sum += weight * contrast;
        weights += weight;
        if let (true, Some(seen)) = (lit(*diffuse), seen.get_mut(count)) {
            *seen = *contrast;
            count += 1;
        }
    }
    let smooth = match seen.get_mut(..count) {
        Some(seen) if count > 0 => *seen.select_nth_unstable_by((count - 1) / SMOOTHER, f32::total_cmp).1,
        _ => 0.0,
    };
    let usual = sum / weights.max(1e-6);
    let mut lost = [false; CELLS];
    for (lost, (diffuse, contrast)) in lost.iter_mut().zip(diffuse.iter().zip(contrast)) {
        *lost = !lit(*diffuse) && *contrast < smooth.min(LOST * usual);
    }
    lost
}

/// The windows' first pixels, of those that lie in diffusely lit cells only.
fn sources<'a>(diffuse: &[f32], places: &'a mut [u16]) -> &'a [u16] {
    let lit = |y: usize, x: usize| diffuse.get(y * GRID + x).is_some_and(|d| lit(*d));
    let mut count = 0;
    for place in 0..PLACES * PLACES {
        let (y, x) = (place / PLACES * 2, place % PLACES * 2);
        let cells = |at: usize| at / CELL..=(at + WINDOW - 1) / CELL;
        if !cells(y).all(|y| cells(x).all(|x| lit(y, x))) {
            continue;
        }
        if let Some(slot) = places.get_mut(count) {
            *slot = (y * MATCH + x) as u16;
            count += 1;
        }
    }
    places.get(..count).unwrap_or(&[])
}

/// The cells' offsets are found here, [`MATCH`] x [`MATCH`] pixels.
struct Search<'a> {
    texture: &'a [f32],
    /// The texture, where it was lost replaced as far as cells have their offsets.
    filled: &'a mut [f32],
    /// 1 where `filled` shows texture, else 0.
    known: &'a mut [f32],
    sources: &'a [u16],
}

/// A window's lines.
type Window = [[f32; WINDOW]; WINDOW];

impl Search<'_> {
    #[inline(always)]
    fn run(&mut self, mut lost: [bool; CELLS]) -> Offsets {
        self.filled.copy_from_slice(self.texture);
        self.known.fill(1.0);
        for cell in (0..CELLS).filter(|cell| lost.get(*cell) == Some(&true)) {
            Self::pixels(cell).for_each(|at| set(self.known, at, 0.0));
        }
        let mut offsets = [[0; 2]; CELLS];
        // From the rim inwards, ring after ring: each has a neighbour that is known.
        while lost.contains(&true) {
            let before = lost;
            for (cell, (lost, offset)) in lost.iter_mut().zip(&mut offsets).enumerate() {
                if *lost && touches_known(&before, cell) {
                    *offset = self.place(cell);
                    *lost = false;
                }
            }
            if lost == before {
                break;
            }
        }
        offsets
    }

    /// Finds the cell's offset and fills it.
    #[inline(always)]
    fn place(&mut self, cell: usize) -> [i8; 2] {
        let (y, x) = (cell / GRID * CELL, cell % GRID * CELL);
        // The window begins half a cell before the cell; what lies outside the picture has weight 0.
        let (mut wanted, mut weights): (Window, Window) = Default::default();
        for (i, (wanted, weights)) in wanted.iter_mut().zip(&mut weights).enumerate() {
            for (j, (wanted, weight)) in wanted.iter_mut().zip(weights).enumerate() {
                let (row, column) = ((y + i).wrapping_sub(CELL / 2), (x + j).wrapping_sub(CELL / 2));
                if row < MATCH && column < MATCH {
                    *wanted = get(self.filled, row * MATCH + column);
                    *weight = get(self.known, row * MATCH + column);
                }
            }
        }
        let (mut best, mut least) = (0, f32::INFINITY);
        for &source in self.sources {
            let cost = self.cost(usize::from(source), &wanted, &weights, least);
            if cost < least {
                (best, least) = (usize::from(source), cost);
            }
        }
        let down = (best / MATCH + CELL / 2) as isize - y as isize;
        let right = (best % MATCH + CELL / 2) as isize - x as isize;
        for at in Self::pixels(cell) {
            let from = at.wrapping_add_signed(down * MATCH as isize + right);
            set(self.filled, at, get(self.texture, from));
            set(self.known, at, 1.0);
        }
        [down as i8, right as i8]
    }

    /// Weighted squared differences of the window at `source`; given up when over `least`.
    #[inline(always)]
    fn cost(&self, source: usize, wanted: &Window, weights: &Window, least: f32) -> f32 {
        let mut sums = [0.0_f32; WINDOW];
        for (i, (wanted, weights)) in wanted.iter().zip(weights).enumerate() {
            let at = source + i * MATCH;
            let Some(Ok(line)) = self.texture.get(at..at + WINDOW).map(<&[f32; WINDOW]>::try_from) else {
                return f32::INFINITY;
            };
            for k in 0..WINDOW {
                let difference = line[k] - wanted[k];
                sums[k] += weights[k] * (difference * difference);
            }
            if i % 4 == 3 && total(&sums) >= least {
                return f32::INFINITY;
            }
        }
        total(&sums)
    }

    /// The numbers of a cell's pixels.
    fn pixels(cell: usize) -> impl Iterator<Item = usize> {
        let first = cell / GRID * CELL * MATCH + cell % GRID * CELL;
        (0..CELL * CELL).map(move |i| first + i / CELL * MATCH + i % CELL)
    }
}

#[inline(always)]
fn total(sums: &[f32; WINDOW]) -> f32 {
    let [a, b, c, d, e, f, g, h] = sums;
    ((a + b) + (c + d)) + ((e + f) + (g + h))
}

#[inline(always)]
fn get(values: &[f32], at: usize) -> f32 {
    values.get(at).copied().unwrap_or(0.0)
}

#[inline(always)]
fn set(values: &mut [f32], at: usize, value: f32) {
    if let Some(place) = values.get_mut(at) {
        *place = value;
    }
}

/// Whether one of the eight cells around is not lost.
fn touches_known(lost: &[bool; CELLS], cell: usize) -> bool {
    let (y, x) = (cell / GRID, cell % GRID);
    let near = |at: usize| at.saturating_sub(1)..=(at + 1).min(GRID - 1);
    near(y).any(|y| near(x).any(|x| lost.get(y * GRID + x) == Some(&false)))
}

/// Sets the albedo to the cells' means with the texture at the cells' offsets, wherever one of the four nearest has one.
fn blend(
    albedo: &mut [f32],
    n: usize,
    detail: &[f32],
    means: &[f32],
    offsets: &Offsets,
    exec: &dyn Executor,
) {
    let pair = Pair { n, m: GRID };
    let offset = |cell: usize| offsets.get(cell).copied().unwrap_or([0; 2]);
    let moved = |place: usize, by: i8| {
        let by = isize::from(by) * n as isize / MATCH as isize;
        place.saturating_add_signed(by).min(n - 1)
    };
    for_each_row_block(exec, n, ROWS_PER_BLOCK, planes3(albedo, n, n), &|range, planes| {
        let [mut red, mut green, mut blue] = planes;
        for (row, ((red, green), blue)) in range.zip(red.rows().zip(green.rows()).zip(blue.rows())) {
            let (top, bottom, down) = pair.between(row);
            if [top, bottom].iter().all(|y| (0..GRID).all(|x| offset(y * GRID + x) == [0; 2])) {
                continue;
            }
            let pixels = red.iter_mut().zip(green).zip(blue).enumerate();
            for (column, ((red, green), blue)) in pixels {
                let (left, right, along) = pair.between(column);
                let corners = [top, bottom].map(|y| [left, right].map(|x| y * GRID + x));
                let from = corners.as_flattened().iter().map(|cell| offset(*cell));
                if from.clone().all(|offset| offset == [0; 2]) {
                    continue;
                }
                let weights =
                    [(1.0 - down) * (1.0 - along), (1.0 - down) * along, down * (1.0 - along), down * along];
                for (c, value) in [red, green, blue].into_iter().enumerate() {
                    let texture: f32 = from
                        .clone()
                        .zip(weights)
                        .map(|([y, x], weight)| {
                            weight * get(detail, (c * n + moved(row, y)) * n + moved(column, x))
                        })
                        .sum();
                    let mean = bilinear(
                        corners.map(|line| line.map(|cell| get(means, c * CELLS + cell))),
                        along,
                        down,
                    );
                    let ratio = (1.0 + texture).max(DARKEST);
                    *value = ((mean + FLOOR) * ratio - FLOOR).clamp(0.0, 1.0);
                }
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::exec::Inline;
    use crate::base::math::expf;
    use crate::brdf::{self, Scene};
    use crate::crf::feature::radius_squared;
    use crate::maps::Maps;
    use std::vec;
    use std::vec::Vec;

    const N: usize = 128;
    const FOV: f32 = 43.35;

    /// Glossy, flat, its albedo 0.2 times `texture`; the photo, and the albedo as a network has it: smooth below the highlight.
    struct Gloss {
        truth: Vec<f32>,
        albedo: Vec<f32>,
        normal: Vec<f32>,
        roughness: f32,
        photo: Vec<f32>,
    }

    impl Gloss {
        fn new(roughness: f32, texture: impl Fn(usize, usize) -> f32) -> Self {
            let plane: Vec<f32> = (0..N * N).map(|i| 0.2 * texture(i % N, i / N)).collect();
            let truth = plane.repeat(3);
            let normal = [vec![0.0; 2 * N * N], vec![1.0; N * N]].concat();
            let mut photo = vec![0.0; 3 * N * N];
            let maps = Maps { size: N, albedo: &truth, normal: &normal, roughness: &vec![roughness; N * N] };
            brdf::render(&maps, 0.05, &Scene::flash(FOV, 1.0), &Inline, &mut photo).expect("a render");
            photo.iter_mut().for_each(|value| *value = value.min(1.0));
            let mut albedo = truth.clone();
            for (i, value) in albedo.iter_mut().enumerate() {
                let radius = radius_squared(i % N, i / N % N, N) / 0.1;
                *value = 0.2 + (*value - 0.2) * (1.0 - expf(-radius * radius));
            }
            Self { truth, albedo, normal, roughness, photo }
        }

        fn retextured(&self) -> Vec<f32> {
            let (mut albedo, mut normal) = (self.albedo.clone(), self.normal.clone());
            let mut roughness = vec![self.roughness; N * N];
            let mut maps =
                MapsMut { size: N, albedo: &mut albedo, normal: &mut normal, roughness: &mut roughness };
            let clipped = vec![0; N * N];
            let photo = LinearImage::new(N, &self.photo, &clipped, FOV);
            let mut memory = vec![0; retexture_bytes(N)];
            retexture(&photo, &mut maps, 0.05, &Inline, &mut Arena::new(&mut memory)).expect("fits");
            albedo
        }
    }

    /// Root mean square of red's difference to `other` within a fifth of the half side around the centre.
    fn middle(albedo: &[f32], other: impl Fn(usize) -> f32) -> f32 {
        let inside: Vec<f32> = (0..N * N)
            .filter(|i| radius_squared(i % N, i / N, N) < 0.04)
            .map(|i| (albedo[i] - other(i)) * (albedo[i] - other(i)))
            .collect();
        (inside.iter().sum::<f32>() / inside.len() as f32).sqrt()
    }

    /// Means of 2 x 2 pixels of a hash, so that it can be seen at 64 x 64.
    fn grain(x: usize, y: usize) -> f32 {
        let hash = ((x / 2 * 73 + y / 2 * 1031 + 7) as u32).wrapping_mul(2_654_435_761) >> 8;
        1.0 + 0.3 * ((hash % 1000) as f32 / 500.0 - 1.0)
    }

    #[test]
    fn grain_comes_back_with_its_contrast_and_no_other_brightness() {
        let gloss = Gloss::new(0.45, grain);
        let (usual, was) = (middle(&gloss.truth, |_| 0.2), middle(&gloss.albedo, |_| 0.2));
        let out = gloss.retextured();
        let is = middle(&out, |_| 0.2);
        assert!(was < 0.3 * usual && (0.8..1.25).contains(&(is / usual)), "{usual}: {was}, then {is}");
        let inside: Vec<f32> =
            (0..N * N).filter(|i| radius_squared(i % N, i / N, N) < 0.04).map(|i| out[i]).collect();
        let mean = inside.iter().sum::<f32>() / inside.len() as f32;
        assert!((mean / 0.2 - 1.0).abs() < 0.06, "{mean}");
        // Where nothing was lost, the same bits.
        for (i, (out, before)) in out.iter().zip(&gloss.albedo).enumerate() {
            let far = radius_squared(i % N, i / N % N, N) > 1.2;
            assert!(!far || out.to_bits() == before.to_bits(), "value {i}: {out} for {before}");
        }
    }

    #[test]
    fn stripes_go_on_through_the_disc() {
        // The truth is the oracle: stripes of 8 pixels come back nearly as they were.
        let gloss = Gloss::new(0.45, |x, y| if (x + y) % 8 < 4 { 1.25 } else { 0.75 });
        let was = middle(&gloss.albedo, |i| gloss.truth[i]);
        let is = middle(&gloss.retextured(), |i| gloss.truth[i]);
        assert!(is < 0.4 * was, "{was}, then {is}");
    }

    #[test]
    fn nothing_is_made_up_where_nothing_is_lost() {
        // Matt: a smooth place is the material's own. Glossy with its texture seen: it stays.
        let matt = Gloss::new(1.0, grain);
        assert!(matt.retextured() == matt.albedo, "matt");
        let glossy = Gloss::new(0.45, grain);
        let seen = Gloss { albedo: glossy.truth.clone(), ..glossy };
        let moved = seen.retextured().iter().zip(&seen.truth).filter(|(a, b)| a != b).count();
        assert!(moved < N * N / 20, "{moved} values of a texture that was there");
        // Smooth in places: a smooth one below the highlight is nothing lost.
        let patchy = Gloss::new(0.45, |x, y| if (x / 32 + y / 32) % 2 == 0 { grain(x, y) } else { 1.0 });
        assert!(patchy.retextured() == patchy.albedo, "patchy");
        // Plain: there is no texture to take.
        let plain = Gloss::new(0.45, |_, _| 1.0);
        let out = plain.retextured();
        let worst = out.iter().zip(&plain.truth).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(worst < 1e-3, "{worst}");
    }

    #[test]
    fn black_photos_bad_values_and_tiny_ones_are_no_error() {
        let mut gloss = Gloss::new(0.45, grain);
        gloss.photo.fill(0.0);
        assert!(gloss.retextured().iter().all(|v| (0.0..=1.0).contains(v)));
        gloss.photo.fill(f32::NAN);
        assert!(gloss.retextured().iter().all(|v| (0.0..=1.0).contains(v)));
        for size in [1, 63, 64, 65, 100] {
            let (n2, clipped) = (size * size, vec![0; size * size]);
            let rgb: Vec<f32> = (0..3 * n2).map(|i| (i % 7) as f32 / 7.0).collect();
            let photo = LinearImage::new(size, &rgb, &clipped, FOV);
            let (mut albedo, mut roughness) = (rgb.clone(), vec![0.3; n2]);
            let mut normal = [vec![0.0; 2 * n2], vec![1.0; n2]].concat();
            let mut maps =
                MapsMut { size, albedo: &mut albedo, normal: &mut normal, roughness: &mut roughness };
            let mut memory = vec![0; retexture_bytes(size)];
            retexture(&photo, &mut maps, 0.05, &Inline, &mut Arena::new(&mut memory)).expect("fits");
            assert!(albedo.iter().all(|v| (0.0..=1.0).contains(v)), "{size}");
        }
    }
}
