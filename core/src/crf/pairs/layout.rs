//! Where a graph's weights lie, and which pixels they join: see "Storage" in the [module](super).
use super::super::pattern::{Offset, Pattern};
use crate::base::simd::prefetch;
use core::ops::Range;

/// The edges of one row along one offset or its opposite.
pub(super) struct Line {
    /// Columns whose partner can be looked up: all, but in the image's first and last row.
    pub(super) columns: Range<usize>,
    /// Where the weight of column 0 is stored, and where its partner lies in a plane; may lie before the start.
    pub(super) weights: isize,
    pub(super) other: isize,
}

/// The part of `values` that belongs to `columns`, column 0 being at `start`.
#[inline(always)]
pub(super) fn part<T>(values: &[T], start: isize, columns: Range<usize>) -> Option<&[T]> {
    values.get(columns.start.checked_add_signed(start)?..columns.end.checked_add_signed(start)?)
}

impl Line {
    /// The weights of `columns`.
    #[inline(always)]
    pub(super) fn weights<'w>(&self, weights: &'w [u16], columns: Range<usize>) -> Option<&'w [u16]> {
        part(weights, self.weights, columns)
    }

    /// Asks for the weights of the next row along the same offset, which a pass has not read yet.
    #[inline(always)]
    pub(super) fn prefetch_below(&self, shape: &Shape, weights: &[u16]) {
        let start = self.weights + shape.row_len() as isize;
        prefetch(part(weights, start, 0..shape.size).unwrap_or(&[]));
    }

    /// The values of row `y` and of their partners.
    #[inline(always)]
    pub(super) fn pair<'p>(&self, plane: &'p [f32], size: usize, y: usize) -> Option<(&'p [f32], &'p [f32])> {
        let own = plane.get(y * size + self.columns.start..y * size + self.columns.end)?;
        Some((own, part(plane, self.other, self.columns.clone())?))
    }
}

/// Where a graph's weights lie.
#[derive(Debug)]
pub(super) struct Shape {
    pub(super) size: usize,
    pub(super) pad: usize,
    /// Sorted by falling dx, all less than `size` away.
    pub(super) pattern: Pattern,
}

impl Shape {
    pub(super) fn new(size: usize, pattern: &Pattern) -> Self {
        let mut sorted = Pattern::new();
        for offset in pattern {
            if (offset.dx.unsigned_abs() as usize) < size && offset.dy < size {
                // Room for every offset: both hold as many.
                let _ = sorted.push(*offset);
            }
        }
        sorted.sort_unstable_by_key(|offset| (-offset.dx, offset.dy));
        let pad = sorted.iter().map(|offset| offset.dx.unsigned_abs() as usize).max().unwrap_or(0);
        Self { size, pad, pattern: sorted }
    }

    /// Values of a row.
    #[inline(always)]
    pub(super) fn row_len(&self) -> usize {
        self.size.saturating_mul(self.pattern.len()).saturating_add(self.pad)
    }

    /// Values in all.
    pub(super) fn len(&self) -> usize {
        self.row_len().saturating_mul(self.size).saturating_add(self.pad)
    }

    /// From row `y` along offset `k`.
    #[inline(always)]
    pub(super) fn forward(&self, k: usize, offset: &Offset, y: usize) -> Option<Line> {
        let n = self.size;
        let row = y + offset.dy;
        if row >= n {
            return None;
        }
        let right = offset.dx.max(0) as usize;
        Some(Line {
            columns: 0..if row + 1 == n { n - right } else { n },
            weights: (self.pad + y * self.row_len() + k * n) as isize,
            other: (row * n) as isize + offset.dx as isize,
        })
    }

    /// From row `y` against offset `k`.
    #[inline(always)]
    pub(super) fn backward(&self, k: usize, offset: &Offset, y: usize) -> Option<Line> {
        let n = self.size;
        let row = y.checked_sub(offset.dy)?;
        let right = offset.dx.max(0) as usize;
        Some(Line {
            columns: if row == 0 { right } else { 0 }..n,
            weights: (self.pad + row * self.row_len() + k * n) as isize - offset.dx as isize,
            other: (row * n) as isize - offset.dx as isize,
        })
    }

    /// Visits all lines of row `y`, both directions, and asks for the `weights` of the next row.
    #[inline(always)]
    pub(super) fn for_each_line(&self, y: usize, weights: &[u16], mut visit: impl FnMut(&Line, &Offset)) {
        for (k, offset) in self.pattern.iter().enumerate() {
            if let Some(line) = self.forward(k, offset, y) {
                line.prefetch_below(self, weights);
                visit(&line, offset);
            }
            if let Some(line) = self.backward(k, offset, y) {
                visit(&line, offset);
            }
        }
    }
}
