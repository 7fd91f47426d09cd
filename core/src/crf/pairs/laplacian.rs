//! The product of the graph's Laplacian with a few planes: where the solver spends its time.
//!
//! A row is worked on in tiles that stay in the nearest cache; each weight is read once for all planes, and an offset's
//! two lines are added to a tile's sums together.
use super::Pairs;
use super::codes::decode;
use super::layout::{Line, part};
use core::ops::Range;

/// Pixels of a row that are worked on together; [`WIDE`] where the size is a multiple of that.
const TILE: usize = 128;
const WIDE: usize = 256;

/// On the boundary of a vector register and a cache line.
#[repr(align(64))]
struct Aligned<T>(T);

impl Pairs<'_> {
    /// Adds row `y` of L x to `out` (a row each) for the `C` planes `x`. To be called within `Simd::run`.
    #[inline(always)]
    pub(in super::super) fn add_laplacian_row<const C: usize>(
        &self,
        y: usize,
        x: [&[f32]; C],
        out: [&mut [f32]; C],
    ) {
        // Wide tiles read the weights in the order in which they lie in memory.
        if self.shape.size.is_multiple_of(WIDE) {
            self.add_laplacian_tiles::<C, WIDE>(y, x, out);
        } else {
            self.add_laplacian_tiles::<C, TILE>(y, x, out);
        }
    }

    #[inline(always)]
    fn add_laplacian_tiles<const C: usize, const T: usize>(
        &self,
        y: usize,
        x: [&[f32]; C],
        out: [&mut [f32]; C],
    ) {
        let size = self.shape.size;
        let mut out = out;
        for start in (0..size).step_by(T) {
            let tile = start..size.min(start + T);
            let mut own = Aligned([[0.0_f32; T]; C]);
            let mut sum = Aligned([[0.0_f32; T]; C]);
            for (own, plane) in own.0.iter_mut().zip(&x) {
                let row = part(plane, (y * size) as isize, tile.clone()).unwrap_or(&[]);
                own.get_mut(..row.len()).unwrap_or(&mut []).copy_from_slice(row);
            }
            for (k, offset) in self.shape.pattern.iter().enumerate() {
                let forward = self.shape.forward(k, offset, y).map(|line| {
                    if start == 0 {
                        line.prefetch_below(&self.shape, self.weights);
                    }
                    Edges::of(&line, self.weights, x, tile.clone())
                });
                let backward = self.shape.backward(k, offset, y);
                let backward = backward.map(|line| Edges::of(&line, self.weights, x, tile.clone()));
                if let (Some(Some(a)), Some(Some(b))) =
                    (forward.as_ref().map(Edges::whole::<T>), backward.as_ref().map(Edges::whole::<T>))
                {
                    add_two_whole(a, b, &own.0, &mut sum.0);
                    continue;
                }
                for edges in [forward, backward].iter().flatten() {
                    match edges.whole::<T>() {
                        Some(whole) => add_whole(whole, &own.0, &mut sum.0),
                        None => edges.add_some(&own.0, start, &mut sum.0),
                    }
                }
            }
            for (row, sum) in out.iter_mut().zip(&sum.0) {
                let row = row.get_mut(tile.clone()).unwrap_or(&mut []);
                for (out, &value) in row.iter_mut().zip(sum) {
                    *out += value;
                }
            }
        }
    }
}

/// A line's edges within a tile.
struct Edges<'v, const C: usize> {
    columns: Range<usize>,
    weights: &'v [u16],
    others: [&'v [f32]; C],
}

/// The edges of all of a tile's pixels.
type Whole<'v, const C: usize, const T: usize> = (&'v [u16; T], [&'v [f32; T]; C]);

impl<'v, const C: usize> Edges<'v, C> {
    #[inline(always)]
    fn of(line: &Line, weights: &'v [u16], x: [&'v [f32]; C], tile: Range<usize>) -> Self {
        let columns = line.columns.start.max(tile.start)..line.columns.end.min(tile.end);
        let weights = part(weights, line.weights, columns.clone()).unwrap_or(&[]);
        let others = x.map(|plane| part(plane, line.other, columns.clone()).unwrap_or(&[]));
        Self { columns, weights, others }
    }

    #[inline(always)]
    fn whole<const T: usize>(&self) -> Option<Whole<'v, C, T>> {
        let weights = <&[u16; T]>::try_from(self.weights).ok()?;
        // As long as the weights.
        Some((weights, self.others.map(|other| <&[f32; T]>::try_from(other).unwrap_or(&[0.0; T]))))
    }

    /// sum += w (own - other), the tile's first pixel being in column `start`.
    #[inline(always)]
    fn add_some<const T: usize>(&self, own: &[[f32; T]; C], start: usize, sum: &mut [[f32; T]; C]) {
        let at = self.columns.start.saturating_sub(start);
        for ((own, other), sum) in own.iter().zip(self.others).zip(sum) {
            let places = sum.iter_mut().zip(own).skip(at);
            for (((sum, own), other), &w) in places.zip(other).zip(self.weights) {
                *sum += decode(w) * (own - other);
            }
        }
    }
}

/// sum += w (own - other).
#[inline(always)]
fn add_whole<const C: usize, const T: usize>(
    (weights, others): Whole<'_, C, T>,
    own: &[[f32; T]; C],
    sum: &mut [[f32; T]; C],
) {
    for i in 0..T {
        let w = decode(weights[i]);
        for c in 0..C {
            sum[c][i] += w * (own[c][i] - others[c][i]);
        }
    }
}

/// The same for one line and then another: the sums are read and written once.
#[inline(always)]
fn add_two_whole<const C: usize, const T: usize>(
    (first, others): Whole<'_, C, T>,
    (second, more_others): Whole<'_, C, T>,
    own: &[[f32; T]; C],
    sum: &mut [[f32; T]; C],
) {
    for i in 0..T {
        let (v, w) = (decode(first[i]), decode(second[i]));
        for c in 0..C {
            let before = sum[c][i] + v * (own[c][i] - others[c][i]);
            sum[c][i] = before + w * (own[c][i] - more_others[c][i]);
        }
    }
}
