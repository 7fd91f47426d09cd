//! How a block's output pixels are cut into register tiles: shared by the x86-64 levels.
//!
//! A tile is up to [`MAX_RUNS`] runs of [`Tile::width`] neighbouring pixels of one output row. Runs of 4 first, over
//! all rows; then what is left of each row when its length is no multiple of 4.
use super::Block;

/// Neighbouring pixels in a full run.
pub(super) const RUN: usize = 4;
/// Most runs in a tile.
pub(super) const MAX_RUNS: usize = 3;

/// Pixels that are computed together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tile {
    /// Index (row-major) of each run's first pixel; the first `runs` count.
    pub(super) pixels: [usize; MAX_RUNS],
    /// Runs in this tile, 1 to the limit given.
    pub(super) runs: usize,
    /// Pixels in each run, 1 to [`RUN`].
    pub(super) width: usize,
}

/// The tiles of a block, in order.
#[derive(Clone, Debug)]
pub(super) struct Tiles {
    cols: usize,
    rows: usize,
    limit: usize,
    next: usize,
    tail: bool,
}

impl Tiles {
    /// Tiles of at most `limit` runs (1 to [`MAX_RUNS`]).
    pub(super) fn new(block: &Block<'_>, limit: usize) -> Self {
        Self { cols: block.cols, rows: block.rows, limit: limit.clamp(1, MAX_RUNS), next: 0, tail: false }
    }
}

impl Iterator for Tiles {
    type Item = Tile;

    fn next(&mut self) -> Option<Tile> {
        let full = self.cols / RUN;
        if !self.tail && self.next >= full * self.rows {
            (self.tail, self.next) = (true, 0);
        }
        let (per_row, width) = if self.tail { (1, self.cols % RUN) } else { (full, RUN) };
        if width == 0 || self.next >= per_row * self.rows {
            return None;
        }
        let runs = (per_row * self.rows - self.next).min(self.limit);
        let first_column = if self.tail { full * RUN } else { 0 };
        let start = |run: usize| (run / per_row) * self.cols + first_column + (run % per_row) * RUN;
        let mut pixels = [0; MAX_RUNS];
        for (i, pixel) in pixels.iter_mut().take(runs).enumerate() {
            *pixel = start(self.next + i);
        }
        self.next += runs;
        Some(Tile { pixels, runs, width })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;

    #[test]
    fn every_pixel_is_in_one_tile() {
        for (rows, cols) in [(1, 1), (2, 2), (3, 4), (4, 7), (1, 13), (5, 128), (0, 4), (2, 3)] {
            for limit in 1..=MAX_RUNS {
                let mut seen = vec![0; rows * cols];
                let tiles = Tiles { cols, rows, limit, next: 0, tail: false };
                for tile in tiles {
                    assert!((1..=limit).contains(&tile.runs) && (1..=RUN).contains(&tile.width));
                    for &pixel in tile.pixels.iter().take(tile.runs) {
                        assert!(pixel % cols + tile.width <= cols, "a run stays in its row");
                        seen[pixel..pixel + tile.width].iter_mut().for_each(|s| *s += 1);
                    }
                }
                assert!(seen.iter().all(|&s| s == 1), "{rows} {cols} {limit}");
            }
        }
    }
}
