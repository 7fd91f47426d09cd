//! Building the graph: three passes over the weights' memory, which holds the affinities' codes until the last one.
use super::codes::{add_squares, affinity_row, merge_one, merge_two};
use super::{Kernel, Pairs};
use crate::base::exec::{Executor, Plane, ROWS_PER_BLOCK, for_each_row, for_each_row_block};

impl Pairs<'_> {
    /// First pass: the square root of every kernel's feature part, in 8 bits, one kernel per byte.
    pub(super) fn affinities(&mut self, kernels: &[Kernel<'_>], exec: &dyn Executor) {
        let shape = &self.shape;
        let (pad, weights) = self.weights.split_at_mut(shape.pad);
        pad.fill(0);
        let rows = Plane::new(weights, shape.row_len());
        for_each_row(
            exec,
            shape.size,
            rows,
            #[inline(always)]
            |y, row| {
                let (lines, pad) = row.split_at_mut(shape.row_len() - shape.pad);
                pad.fill(0);
                let lines = lines.chunks_exact_mut(shape.size);
                for ((k, offset), codes) in shape.pattern.iter().enumerate().zip(lines) {
                    let Some(line) = shape.forward(k, offset, y) else {
                        codes.fill(0);
                        continue;
                    };
                    // From the first column on, in the last row not to the end.
                    let (inside, beyond) = codes.split_at_mut(line.columns.end.min(shape.size));
                    beyond.fill(0);
                    match kernels {
                        [first, ..] => affinity_row::<false>(first.features, shape.size, &line, y, inside),
                        [] => inside.fill(0),
                    }
                    if let [_, second, ..] = kernels {
                        affinity_row::<true>(second.features, shape.size, &line, y, inside);
                    }
                    let shift = offset.dx.unsigned_abs() as usize;
                    let outside = if offset.dx > 0 { shape.size - shift..shape.size } else { 0..shift };
                    codes.get_mut(outside).unwrap_or(&mut []).fill(0);
                }
            },
        );
    }

    /// Second pass: 1 / sqrt(D) of both kernels; 1 for a kernel that there is not.
    pub(super) fn scales(&self, kernels: &[Kernel<'_>], scales: [&mut [f32]; 2], exec: &dyn Executor) {
        let size = self.shape.size;
        let two = kernels.len() > 1;
        let [first, second] = scales;
        let out = (Plane::new(first, size), Plane::new(second, size));
        for_each_row_block(exec, size, ROWS_PER_BLOCK, out, &|rows, (mut first, mut second)| {
            exec.simd().run(
                #[inline(always)]
                || {
                    for (y, (first, second)) in rows.zip(first.rows().zip(second.rows())) {
                        // In units of the code's square, a pixel's own affinity is 255².
                        first.fill(65025.0);
                        second.fill(if two { 65025.0 } else { 1.0 });
                        self.shape.for_each_line(
                            y,
                            self.weights,
                            #[inline(always)]
                            |line, offset| {
                                let Some(codes) = line.weights(self.weights, line.columns.clone()) else {
                                    return;
                                };
                                add_squares(first, line.columns.clone(), codes, 0, offset.weight);
                                if two {
                                    add_squares(second, line.columns.clone(), codes, 8, offset.weight);
                                }
                            },
                        );
                        for sums in [&mut *first, second] {
                            exec.simd().sqrt(sums);
                            sums.iter_mut().for_each(|root| *root = 1.0 / *root);
                        }
                    }
                },
            );
        });
    }

    /// Third pass: codes become the merged weights, in place.
    pub(super) fn merge(&mut self, kernels: &[Kernel<'_>], scales: [&[f32]; 2], exec: &dyn Executor) {
        let weight = |k: usize| kernels.get(k).map_or(0.0, |kernel| kernel.weight);
        let b = [weight(0), weight(1)];
        let shape = &self.shape;
        let rows = Plane::new(self.weights.get_mut(shape.pad..).unwrap_or(&mut []), shape.row_len());
        for_each_row(
            exec,
            shape.size,
            rows,
            #[inline(always)]
            |y, row| {
                let lines = row.chunks_exact_mut(shape.size);
                for ((k, offset), codes) in shape.pattern.iter().enumerate().zip(lines) {
                    let Some(line) = shape.forward(k, offset, y) else { continue };
                    let Some(codes) = codes.get_mut(line.columns.clone()) else { continue };
                    let [Some((i0, j0)), Some((i1, j1))] = scales.map(|s| line.pair(s, shape.size, y)) else {
                        continue;
                    };
                    if kernels.len() > 1 {
                        merge_two(b.map(|b| b * offset.weight), [i0, j0], [i1, j1], codes);
                    } else {
                        merge_one(b[0] * offset.weight, i0, j0, codes);
                    }
                }
            },
        );
    }
}
