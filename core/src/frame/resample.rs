//! Area resampling of a square window of the photo to n x n, in linear light, source row by source row.
//!
//! Shrinking: every output pixel is the mean over the box that it covers. A source pixel in which a box's border falls
//! counts for both boxes, in parts. Growing (window smaller than n): bilinear between source
//! pixel centres. At equal size and whole borders both copy.
//!
//! Linear light is added up as integers ([`fixed`]): exact in any order. So pixels may be taken along a row, each value
//! loaded from a table (no slower than the widest registers' gathers), or, where registers hold the table
//! ([`Source::has_columns`]), rows added up first, column by column. Only the sums over a box's rows become floats (f64), in one order, so the
//! bits are the same everywhere.
use super::Crop;
use super::exposure::marks;
use crate::Error;
use crate::base::arena::{Arena, bytes_for};
use crate::base::exec::{Executor, Plane, ROWS_PER_BLOCK, for_each_row_block, planes3};
use crate::base::simd::Simd;
use crate::kernels::MARK_BIT;
use bytemuck::{Pod, Zeroable};
use core::ops::Range;

/// Less of a source pixel than this is rounding, not part of a box.
const SLIVER: f64 = 1e-6;
/// Integer units of linear light in white: all values of 8-bit codes are whole numbers of them.
const ONE: f32 = (1_u64 << 36) as f32;
/// Marks a clipped channel of a pixel. Sums of [`MOST`] pixels stay below it, and as many marks are counted above it.
const CLIPPED: u64 = 1 << MARK_BIT;
/// Most pixels that are added up as integers.
const MOST: usize = 1 << 12;
/// Boxes of a row that are worked on together.
const RUN: usize = 128;
/// Pixels whose columns are added up together.
const CHUNK: usize = 192;
/// Most values of a pixel.
const MOST_VALUES: usize = 4;
/// Rows from which on it is faster to add up columns first.
const ROWS_OF_COLUMNS: usize = 2;

/// Linear light in [0,1] as an integer, marked if its pixel counts as clipped.
#[inline(always)]
pub(super) fn fixed(linear: f32, clipped: bool) -> u64 {
    // Exact for 0 and from 2^-12 up: the product is with a power of two.
    (linear * ONE) as u64 + if clipped { CLIPPED } else { 0 }
}

/// Photos whose pixels can be added up row by row.
pub(super) trait Source: Sync {
    /// A row of it.
    type Row<'r>: Row
    where
        Self: 'r;

    /// Values of a pixel, R, G and B first: at most [`MOST_VALUES`].
    const VALUES: usize = 3;

    /// Row `y`; rows outside are black.
    fn row(&self, y: usize) -> Self::Row<'_>;

    /// Whether [`Source::add_up_columns`] works, and fast.
    fn has_columns(&self, _simd: Simd) -> bool {
        false
    }

    /// Sets `sums` to the sums of [`fixed`] over `rows`, one for each value from pixel `start` on. Nothing that is outside may be asked for.
    fn add_up_columns(&self, _rows: Range<usize>, _start: usize, _sums: &mut [u64], _simd: Simd) {}

    /// Asks for the pixels at `start` of `rows`, which will be added up soon.
    fn prefetch(&self, _rows: Range<usize>, _start: usize) {}
}

/// A row of pixels.
pub(super) trait Row {
    /// `sums` with [`fixed`] of pixels `start..end` added. Those outside are black.
    fn add(&self, start: usize, end: usize, sums: Sums) -> Sums;
}

/// Sums of [`fixed`] over at most [`MOST`] pixels, for R, G and B.
pub(super) type Sums = [u64; 3];

/// Linear light of a sum, exact.
#[inline(always)]
fn linear(sum: u64) -> f64 {
    // The bits of 2^52 with the sum in its lowest bits: vectors convert f64 fast, u64 not.
    const SHIFT: f64 = (1_u64 << 52) as f64;
    (f64::from_bits((sum & (CLIPPED - 1)) | SHIFT.to_bits()) - SHIFT) * (1.0 / ONE as f64)
}

/// How many of a sum's pixels are clipped.
#[inline(always)]
fn marked(sum: u64) -> f64 {
    const SHIFT: f64 = (1_u64 << 52) as f64;
    f64::from_bits((sum >> MARK_BIT) | SHIFT.to_bits()) - SHIFT
}

/// A square window of a photo and the pixels to make of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window {
    x: f64,
    y: f64,
    width: usize,
    height: usize,
    step: f64,
    size: usize,
}

impl Window {
    pub(super) fn new(crop: &Crop, width: usize, height: usize, size: usize) -> Self {
        Self { x: crop.x, y: crop.y, width, height, step: crop.side / size as f64, size }
    }
}

/// Bytes that [`run`] takes for itself.
pub(super) const fn scratch_bytes(size: usize) -> usize {
    bytes_for::<Border>(size + 1) + bytes_for::<f32>(3 * size)
}

/// Fills `rgb` (3 planes of n x n) and `clipped` (1 plane of [`marks`]) from the window of `source`; gives the share of the
/// window that is clipped in each channel.
pub(super) fn run<S: Source>(
    source: &S,
    window: &Window,
    exec: &dyn Executor,
    rgb: &mut [f32],
    clipped: &mut [u8],
    arena: &mut Arena<'_>,
) -> Result<[f32; 3], Error> {
    let n = window.size;
    let mut arena = arena.scope();
    let columns = arena.take::<Border>(n + 1)?;
    // Of each row, how many of its pixels are clipped in each channel.
    let shares = arena.zeroed::<f32>(3 * n)?;
    for (index, column) in columns.iter_mut().enumerate() {
        *column = Border::new(window.x, window.step, index, window.width);
    }
    let columns = &*columns;
    let out = (planes3(rgb, n, n), Plane::new(clipped, n), Plane::new(&mut *shares, 3));
    for_each_row_block(exec, n, ROWS_PER_BLOCK, out, &|rows, out| {
        if window.step >= 1.0 {
            shrink(source, window, columns, rows, exec.simd(), out);
        } else {
            grow(source, window, rows, out);
        }
    });
    let mut sums = [0.0; 3];
    for row in shares.as_chunks::<3>().0 {
        for (sum, share) in sums.iter_mut().zip(row) {
            *sum += f64::from(*share);
        }
    }
    Ok(sums.map(|sum| (sum / (n * n) as f64) as f32))
}

/// Rows of R, G and B, of marks, and of three shares each.
type Out<'a> = ([Plane<'a, f32>; 3], Plane<'a, u8>, Plane<'a, f32>);

/// Where two boxes meet: in which pixel, and how much of it belongs to the box before; [0,1).
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
struct Border {
    pixel: u32,
    part: f32,
}

impl Border {
    /// The border before box `index` of boxes `step` wide from `origin`, within 0..=`limit`.
    fn new(origin: f64, step: f64, index: usize, limit: usize) -> Self {
        let at = (origin + step * index as f64).clamp(0.0, limit as f64);
        let pixel = (at + SLIVER) as u32;
        let part = at - f64::from(pixel);
        Self { pixel, part: if part < SLIVER { 0.0 } else { part as f32 } }
    }

    /// How much the border's pixel counts for the box behind it, which ends at `end`, and how much `end`'s pixel does.
    #[inline(always)]
    fn weights(self, end: Self) -> (f64, f64) {
        let (part, end_part) = (f64::from(self.part), f64::from(end.part));
        if self.pixel == end.pixel { (end_part - part, 0.0) } else { (1.0 - part, end_part) }
    }

    fn index(self) -> usize {
        self.pixel as usize
    }
}

/// Rows of means over boxes, a run of columns at a time.
fn shrink<S: Source>(
    source: &S,
    window: &Window,
    columns: &[Border],
    rows: Range<usize>,
    simd: Simd,
    (mut rgb, mut clipped, mut shares): Out<'_>,
) {
    let border = |index| Border::new(window.y, window.step, index, window.height);
    let norm = 1.0 / (window.step * window.step);
    for start in (0..window.size).step_by(RUN) {
        let columns = columns.get(start..window.size.min(start + RUN) + 1).unwrap_or(&[]);
        let boxes = Boxes::new(window, columns, simd);
        let mut from = border(rows.start);
        let mut first = boxes.add_up(source, from.index()..from.index() + 1);
        let [r, g, b] = &mut rgb;
        let out = r.rows().zip(g.rows()).zip(b.rows()).zip(clipped.rows().zip(shares.rows()));
        for (index, (((r, g), b), (clipped, shares))) in rows.clone().zip(out) {
            let to = border(index + 1);
            let inside = boxes.add_up(source, from.index() + 1..to.index());
            let last = boxes.add_up(source, to.index()..to.index() + 1);
            let (weight, last_weight) = from.weights(to);
            simd.run(
                #[inline(always)]
                || {
                    for (c, out) in [r, g, b].into_iter().enumerate() {
                        let mut means = [0.0_f32; RUN];
                        for (i, slot) in means.iter_mut().enumerate() {
                            let inside = inside.rgb[c][i] + last.rgb[c][i] * last_weight;
                            let mean = ((first.rgb[c][i] * weight + inside) * norm) as f32;
                            *slot = if mean < 1.0 { mean } else { 1.0 };
                        }
                        out.iter_mut().skip(start).zip(means).for_each(|(out, mean)| *out = mean);
                    }
                    let clipped = clipped.iter_mut().skip(start).take(RUN);
                    if !(first.marked | inside.marked | last.marked) {
                        clipped.for_each(|out| *out = 0);
                        return;
                    }
                    let mut areas = [[0.0_f32; RUN]; 3];
                    for (c, areas) in areas.iter_mut().enumerate() {
                        for (i, area) in areas.iter_mut().enumerate() {
                            let inside = inside.marks[c][i] + last.marks[c][i] * last_weight;
                            *area = ((first.marks[c][i] * weight + inside) * norm) as f32;
                        }
                        // Boxes that are not there have no weight.
                        if let Some(share) = shares.get_mut(c) {
                            *share += areas.iter().sum::<f32>();
                        }
                    }
                    for (i, out) in clipped.enumerate() {
                        *out = marks([areas[0][i], areas[1][i], areas[2][i]]);
                    }
                },
            );
            (from, first) = (to, last);
        }
    }
}

/// A run of boxes in a row: their borders, and how much the pixels on them count.
struct Boxes<'a> {
    columns: &'a [Border],
    weights: [f64; RUN],
    last_weights: [f64; RUN],
    width: usize,
    height: usize,
    /// Most pixels from border to border.
    longest: usize,
    simd: Simd,
}

/// Rows added up: for each box of a run its sums and how many of its pixels are clipped, columns weighted.
struct Line {
    rgb: [[f64; RUN]; 3],
    marks: [[f64; RUN]; 3],
    /// Whether any is.
    marked: bool,
}

impl<'a> Boxes<'a> {
    fn new(window: &Window, columns: &'a [Border], simd: Simd) -> Self {
        let (mut weights, mut last_weights) = ([0.0; RUN], [0.0; RUN]);
        let borders = columns.iter().zip(columns.iter().skip(1));
        for ((weight, last), (from, to)) in weights.iter_mut().zip(&mut last_weights).zip(borders) {
            (*weight, *last) = from.weights(*to);
        }
        let longest = window.step as usize + 2;
        Self { columns, weights, last_weights, width: window.width, height: window.height, longest, simd }
    }

    fn add_up<S: Source>(&self, source: &S, rows: Range<usize>) -> Line {
        let mut line = Line { rgb: [[0.0; RUN]; 3], marks: [[0.0; RUN]; 3], marked: false };
        // As many rows at once as can be added up; of boxes too long for a single row, one part after the other.
        let most = (MOST / self.longest).max(1);
        let end = rows.end.min(self.height);
        let mut y = rows.start;
        while y < end {
            let some = y..end.min(y + most);
            for part in (0..self.longest).step_by(MOST) {
                self.add(source, some.clone(), part, &mut line);
            }
            y = some.end;
        }
        line
    }

    /// Adds rows; of the pixels within each box, those from `part` on, at most [`MOST`].
    fn add<S: Source>(&self, source: &S, rows: Range<usize>, part: usize, line: &mut Line) {
        // The pixels on the borders and those between them.
        let (mut borders, mut inside) = ([[0; RUN + 1]; 3], [[0; RUN]; 3]);
        let count = self.columns.len().saturating_sub(1).min(RUN);
        let columns_first =
            rows.len() >= ROWS_OF_COLUMNS && self.longest <= MOST && source.has_columns(self.simd);
        if columns_first {
            self.add_columns(source, &rows, &mut borders, &mut inside);
        }
        for y in if columns_first { 0..0 } else { rows } {
            let row = source.row(y);
            let mut from = self.columns.first().map_or(0, |border| border.index());
            for (i, to) in self.columns.iter().skip(1).enumerate().take(RUN) {
                let to = to.index();
                if part == 0 {
                    add_at(&mut borders, i, |sums| row.add(from, from + 1, sums));
                }
                let start = from + 1 + part;
                add_at(&mut inside, i, |sums| row.add(start, to.min(start + MOST), sums));
                from = to;
            }
            if part == 0 {
                add_at(&mut borders, count, |sums| row.add(from, from + 1, sums));
            }
        }
        self.simd.run(
            #[inline(always)]
            || {
                for ((sums, borders), inside) in line.rgb.iter_mut().zip(&borders).zip(&inside) {
                    let (before, behind) = (first(borders), last(borders));
                    for i in 0..RUN {
                        let (weight, last_weight) = (self.weights[i], self.last_weights[i]);
                        let middle = linear(inside[i]) + linear(behind[i]) * last_weight;
                        sums[i] += linear(before[i]) * weight + middle;
                    }
                }
                let bits = |sums: &[u64]| sums.iter().fold(0, |bits, sum| bits | sum);
                let any = |sums: &[u64]| bits(sums) >= CLIPPED;
                if !borders.iter().zip(&inside).any(|(borders, inside)| any(borders) | any(inside)) {
                    return;
                }
                line.marked = true;
                for ((marks, borders), inside) in line.marks.iter_mut().zip(&borders).zip(&inside) {
                    let (before, behind) = (first(borders), last(borders));
                    for i in 0..RUN {
                        let (weight, last_weight) = (self.weights[i], self.last_weights[i]);
                        let middle = marked(inside[i]) + marked(behind[i]) * last_weight;
                        marks[i] += marked(before[i]) * weight + middle;
                    }
                }
            },
        );
    }
}

impl Boxes<'_> {
    /// Adds rows up column by column, and columns to boxes.
    #[inline(never)]
    fn add_columns<S: Source>(
        &self,
        source: &S,
        rows: &Range<usize>,
        borders: &mut [[u64; RUN + 1]; 3],
        inside: &mut [[u64; RUN]; 3],
    ) {
        self.simd.run(
            #[inline(always)]
            || self.add_chunks(source, rows, borders, inside),
        );
    }

    #[inline(always)]
    fn add_chunks<S: Source>(
        &self,
        source: &S,
        rows: &Range<usize>,
        borders: &mut [[u64; RUN + 1]; 3],
        inside: &mut [[u64; RUN]; 3],
    ) {
        let border = |index: usize| self.columns.get(index).map(|border| border.index());
        let (Some(first), Some(last)) = (border(0), border(self.columns.len() - 1)) else { return };
        let mut values = [0; MOST_VALUES * CHUNK];
        let end = (last + 1).min(self.width);
        // The box that the next pixel is in, or on its first border.
        let mut i = 0;
        for start in (first..end).step_by(CHUNK) {
            let stop = end.min(start + CHUNK);
            let Some(sums) = values.get_mut(..S::VALUES * (stop - start)) else { return };
            source.add_up_columns(rows.clone(), start, sums, self.simd);
            let pixels =
                |from: usize, to: usize| sums.get(S::VALUES * (from - start)..S::VALUES * (to - start));
            let mut x = start;
            while x < stop {
                let Some(from) = border(i) else { return };
                let to = border(i + 1).unwrap_or(stop);
                if x == from {
                    add_at(borders, i, |sums| add_pixels::<S>(sums, pixels(x, x + 1)));
                    x += 1;
                }
                let next = to.min(stop).max(x);
                add_at(inside, i, |sums| add_pixels::<S>(sums, pixels(x, next)));
                i += usize::from(to <= next);
                x = next;
            }
        }
        // What comes next in these columns: the row on the border, and about as many as these.
        source.prefetch(rows.end..rows.end + rows.len() + 1, first);
    }
}

/// `sums` with the values of pixels added.
#[inline(always)]
fn add_pixels<S: Source>(mut sums: Sums, values: Option<&[u64]>) -> Sums {
    for pixel in values.unwrap_or(&[]).chunks_exact(S::VALUES) {
        for (sum, value) in sums.iter_mut().zip(pixel) {
            *sum += value;
        }
    }
    sums
}

/// All but the last.
#[inline(always)]
fn first(borders: &[u64; RUN + 1]) -> &[u64; RUN] {
    borders.first_chunk().unwrap_or(&[0; RUN])
}

/// All but the first.
#[inline(always)]
fn last(borders: &[u64; RUN + 1]) -> &[u64; RUN] {
    borders.last_chunk().unwrap_or(&[0; RUN])
}

/// Changes the three sums at `index`.
#[inline(always)]
fn add_at<const N: usize>(sums: &mut [[u64; N]; 3], index: usize, add: impl FnOnce(Sums) -> Sums) {
    let [r, g, b] = sums;
    if let (Some(r), Some(g), Some(b)) = (r.get_mut(index), g.get_mut(index), b.get_mut(index)) {
        [*r, *g, *b] = add([*r, *g, *b]);
    }
}

/// The two pixels whose centres lie around a point, and how much the second counts.
#[derive(Clone, Copy, Debug)]
struct Between {
    first: usize,
    second: usize,
    part: f32,
}

impl Between {
    /// Around the centre of box `index`; at the border the border pixel alone.
    fn new(origin: f64, step: f64, index: usize, limit: usize) -> Self {
        let last = limit.saturating_sub(1);
        let at = (origin + step * (index as f64 + 0.5) - 0.5).clamp(0.0, last as f64);
        let first = (at as usize).min(last);
        let part = (at - first as f64) as f32;
        let part = if part < SLIVER as f32 { 0.0 } else { part };
        Self { first, second: if part > 0.0 { (first + 1).min(last) } else { first }, part }
    }
}

/// Rows of interpolated pixels.
fn grow<S: Source>(
    source: &S,
    window: &Window,
    rows: Range<usize>,
    ([mut r, mut g, mut b], mut clipped, mut shares): Out<'_>,
) {
    let mix = |[a, b]: [f32; 2], part: f32| a * (1.0 - part) + b * part;
    let pixel = |row: &S::Row<'_>, x: usize| row.add(x, x + 1, [0; 3]);
    let out = r.rows().zip(g.rows()).zip(b.rows()).zip(clipped.rows().zip(shares.rows()));
    for (index, (((r, g), b), (clipped, shares))) in rows.zip(out) {
        let down = Between::new(window.y, window.step, index, window.height);
        let pair = [source.row(down.first), source.row(down.second)];
        for (j, (((r, g), b), mark)) in r.iter_mut().zip(g).zip(b).zip(clipped).enumerate() {
            let across = Between::new(window.x, window.step, j, window.width);
            let corners = [0, 1].map(|i| [across.first, across.second].map(|x| pixel(&pair[i], x)));
            let between = |value: fn(u64) -> f64, c: usize| {
                let rows = corners.map(|row| mix(row.map(|sums| value(sums[c]) as f32), across.part));
                mix(rows, down.part).min(1.0)
            };
            for (c, out) in [r, g, b].into_iter().enumerate() {
                *out = between(linear, c);
            }
            let areas = [0, 1, 2].map(|c| between(marked, c));
            shares.iter_mut().zip(areas).for_each(|(share, area)| *share += area);
            *mark = marks(areas);
        }
    }
}
