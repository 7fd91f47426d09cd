//! The graph's weights summed over cells of pixels, for the solver's coarse part.
use super::super::coarse::Weights;
use super::super::pattern::Offset;
use super::Pairs;
use super::codes::decode;
use crate::base::exec::{Executor, Plane, for_each_row};
use crate::base::lanes::LANES;
use core::ops::Range;

impl Pairs<'_> {
    /// Adds the weights of all edges between different cells to `weights`.
    pub(in super::super) fn add_between_cells(&self, weights: &mut Weights<'_>, exec: &dyn Executor) {
        let Weights { cells, band, stride, ref mut rows } = *weights;
        let out = Plane::new(rows, cells.count * stride);
        for_each_row(
            exec,
            cells.count,
            out,
            #[inline(always)]
            |cell, out| {
                let ends = ((cell + 1) * cells.width).min(cells.size);
                for (k, offset) in self.shape.pattern.iter().enumerate() {
                    // Rows whose partners lie in one row of cells are summed up first.
                    let mut y = cell * cells.width;
                    while y < ends && y + offset.dy < cells.size {
                        let other = (y + offset.dy) / cells.width;
                        let end = ends.min(((other + 1) * cells.width).min(cells.size) - offset.dy);
                        for start in (0..cells.size).step_by(LANES) {
                            let tile = start..cells.size.min(start + LANES);
                            let sums = self.column_sums((k, offset), y..end, tile.clone());
                            for_each_run(offset.dx, cells.size, cells.width, tile, |pixels, i, j| {
                                let (i, j) = (cell * cells.count + i, other * cells.count + j);
                                let (first, second) = (i.min(j), i.max(j));
                                let place = (first - cell * cells.count) * stride + second - first;
                                if first == second || second - first > band {
                                    return;
                                }
                                if let Some((out, sums)) = out.get_mut(place).zip(sums.get(pixels)) {
                                    *out += sums.iter().sum::<f32>();
                                }
                            });
                        }
                        y = end;
                    }
                }
            },
        );
    }

    /// The weights along offset `k` of columns `tile`, summed over `rows`.
    #[inline(always)]
    fn column_sums(
        &self,
        (k, offset): (usize, &Offset),
        rows: Range<usize>,
        tile: Range<usize>,
    ) -> [f32; LANES] {
        let mut sums = [0.0; LANES];
        for y in rows {
            let Some(line) = self.shape.forward(k, offset, y) else { continue };
            let columns = tile.start..tile.end.min(line.columns.end);
            for (sum, &w) in sums.iter_mut().zip(line.weights(self.weights, columns).unwrap_or(&[])) {
                *sum += decode(w);
            }
        }
        sums
    }
}

/// Calls `visit(pixels, i, j)` for each run of the columns `tile` that lies in cell i and its partners, `dx` to the right,
/// in cell j; the pixels are counted from the tile's first. Columns without a partner are left out.
#[inline(always)]
fn for_each_run(
    dx: i32,
    size: usize,
    width: usize,
    tile: Range<usize>,
    mut visit: impl FnMut(Range<usize>, usize, usize),
) {
    let left = dx.min(0).unsigned_abs() as usize;
    let right = dx.max(0) as usize;
    let end = tile.end.min(size.saturating_sub(right));
    let mut x = tile.start.max(left);
    let (mut i, mut j) = (x / width, (x + right - left) / width);
    while x < end {
        let (next_i, next_j) = ((i + 1) * width, (j + 1) * width + left - right);
        let next = next_i.min(next_j).min(end);
        visit(x - tile.start..next - tile.start, i, j);
        i += usize::from(next == next_i);
        j += usize::from(next == next_j);
        x = next;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    #[test]
    fn runs_are_the_pixels_of_each_pair_of_cells() {
        for (size, width) in [(37, 4), (64, 8), (9, 4), (130, 5)] {
            for dx in [-9, -4, -1, 0, 3, 8, 11] {
                let mut found = Vec::new();
                for start in (0..size).step_by(LANES) {
                    for_each_run(dx, size, width, start..size.min(start + LANES), |pixels, i, j| {
                        found.extend(pixels.map(|x| (start + x, i, j)));
                    });
                }
                let partner = |x: usize| usize::try_from(x as i32 + dx).ok().filter(|p| *p < size);
                let expected: Vec<_> =
                    (0..size).filter_map(|x| Some((x, x / width, partner(x)? / width))).collect();
                assert_eq!(found, expected, "{size} {width} {dx}");
            }
        }
    }
}
