//! Refinement of photos larger than the CRFs' grid.
//!
//! A CRF's kernels are as wide as a share of the picture, whatever its pixels: what it changes is smooth but for the edges that
//! it follows. So photos of more than [`CRF_SIZE`] pixels a side are refined at that size, and each map gets the
//! difference, interpolated: detail stays the network's. Time and memory of the CRFs then stop growing; all else grows with
//! the pixels. The paper refines at its photos' 256² (docs/crf.md).
use crate::Error;
use crate::base::arena::{Arena, bytes_for};
use crate::base::exec::{Executor, Watch};
use crate::base::resample::Pair;
use crate::crf::{self, Energy};

/// Pixels per side up to which the CRFs see every pixel.
pub(super) const CRF_SIZE: usize = 512;

/// Pixels per side at which maps of `size` are refined.
pub(super) fn crf_size(size: usize) -> usize {
    size.min(CRF_SIZE)
}

/// Bytes that the CRF of `E` takes for maps of `size`, `planes` of the inputs shrunk beside it.
pub(super) fn workspace_bytes<E: Energy<N>, const N: usize>(size: usize, planes: usize) -> usize {
    let small = crf_size(size);
    let shrunk = if small == size { 0 } else { planes + E::CHANNELS };
    crf::workspace_bytes::<E, N>(small)
        .saturating_add(bytes_for::<f32>(small.saturating_mul(small)).saturating_mul(shrunk))
}

/// Refines `energy`, all of whose inputs were shrunk, and adds the difference to its unary 0 to the full-size `map`,
/// planes of `n` x `n`, and projects it.
pub(super) fn refine_at<E: Energy<N>, const N: usize>(
    energy: &E,
    coefficients: &[f32; N],
    options: &crf::Options,
    (map, n): (&mut [f32], usize),
    exec: &dyn Executor,
    arena: &mut Arena<'_>,
    watch: Watch<'_>,
) -> Result<crf::Report, Error> {
    let m = energy.size();
    let unary = energy.unary(0);
    let difference = arena.take(unary.len())?;
    let report = crf::refine_watched(energy, coefficients, options, difference, exec, arena, watch)?;
    difference.iter_mut().zip(unary).for_each(|(difference, unary)| *difference -= unary);
    let pair = Pair { n, m };
    for (difference, map) in difference.chunks_exact(m * m).zip(map.chunks_exact_mut(n * n)) {
        pair.each([difference], map, exec, |[difference], value| value + difference);
    }
    energy.project(map);
    Ok(report)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::exec::Inline;
    use crate::crf::exact::Dense;
    use crate::crf::scenes::Scene;
    use crate::crf::{Albedo, Normal};
    use std::vec;
    use std::vec::Vec;

    const N: usize = 48;
    const M: usize = 16;

    /// Means of 3 x 3 pixels.
    fn means(plane: &[f32]) -> Vec<f32> {
        let at = |i: usize| {
            let (x, y) = (i % M * 3, i / M * 3);
            (0..9).map(|k| plane[(y + k / 3) * N + x + k % 3]).sum::<f32>() / 9.0
        };
        (0..M * M).map(at).collect()
    }

    /// Bilinear, borders held.
    fn interpolated(plane: &[f64], i: usize) -> f64 {
        let place = |i: usize| ((i as f64 + 0.5) / 3.0 - 0.5).clamp(0.0, (M - 1) as f64);
        let (x, y) = (place(i % N), place(i / N));
        let at = |y: usize, x: usize| plane[y.min(M - 1) * M + x.min(M - 1)];
        let row = |y: usize| at(y, x as usize) * (1.0 - x.fract()) + at(y, x as usize + 1) * x.fract();
        row(y as usize) * (1.0 - y.fract()) + row(y as usize + 1) * y.fract()
    }

    fn check<E: Energy<K>, const K: usize>(energy: &E, coefficients: [f32; K], map: &[f32]) {
        let mut memory = vec![0; workspace_bytes::<E, K>(N, 6) + crf::workspace_bytes::<E, K>(M) + (1 << 16)];
        let mut out = map.to_vec();
        let options = crf::Options::default();
        let watch: Watch<'_> = &mut |_| core::ops::ControlFlow::Continue(());
        let arena = &mut Arena::new(&mut memory);
        refine_at(energy, &coefficients, &options, (&mut out, N), &Inline, arena, watch).expect("fits");
        let mut solution: Vec<f32> =
            Dense::new(energy, &coefficients).solve().into_iter().map(|x| x as f32).collect();
        energy.project(&mut solution);
        let mut wanted = map.to_vec();
        for (plane, (wanted, unary)) in
            solution.chunks(M * M).zip(wanted.chunks_mut(N * N).zip(energy.unary(0).chunks(M * M)))
        {
            let difference: Vec<f64> = plane.iter().zip(unary).map(|(x, u)| f64::from(x - u)).collect();
            for (i, wanted) in wanted.iter_mut().enumerate() {
                *wanted += interpolated(&difference, i) as f32;
            }
        }
        energy.project(&mut wanted);
        let moved = wanted.iter().zip(map).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(moved > 0.02, "nothing to see: {moved}");
        for (i, (is, want)) in out.iter().zip(&wanted).enumerate() {
            assert!((is - want).abs() < 0.02 * moved, "value {i}: {is} for {want}");
        }
    }

    #[test]
    fn the_difference_of_the_exact_solution_is_added() {
        let scene = Scene::tiles(N, 7);
        let three = |planes: &[f32]| -> Vec<f32> { planes.chunks(N * N).flat_map(means).collect() };
        let (photo, albedo, normal) = (three(&scene.photo), three(&scene.albedo), three(&scene.normal));
        let small = Albedo { size: M, photo: &photo, albedo: &albedo };
        check(&small, [0.5, 0.1, 0.1, 0.5, 0.0], &scene.albedo);
        check(&Normal { size: M, normal: &normal, albedo: &albedo }, [0.4, 0.3, 0.3], &scene.normal);
    }

    #[test]
    fn small_photos_are_refined_as_they_are() {
        assert_eq!(
            [1, 256, CRF_SIZE, CRF_SIZE + 1, 2048].map(crf_size),
            [1, 256, CRF_SIZE, CRF_SIZE, CRF_SIZE]
        );
    }
}
