//! One row between pixels and cells of a constant number of pixels, with linear weights, so that the loops vectorise.

/// Weights of the `H` pixels between two cells in the second one; `H` is even.
#[inline(always)]
fn ramp<const H: usize>() -> [f32; H] {
    core::array::from_fn(|r| (2 * r + 1) as f32 / (2 * H) as f32)
}

/// Pixels to cells of `H` pixels; `W` = 2 H.
#[inline(always)]
pub(super) fn splat_row<const H: usize, const W: usize>(row: &[f32], out: &mut [f32]) {
    let up = ramp::<H>();
    // What a cell gets: rising weights from the pixels before its centre, falling ones from those behind.
    let tent: [f32; W] = core::array::from_fn(|i| if i < H { up[i] } else { 1.0 - up[i - H] });
    // Cell c's pixels start at c H - 3 H / 2: all of them lie in the row for the cells `first..last`.
    let first = 2.min(out.len());
    let last = ((row.len() + H / 2) / H).clamp(first, out.len());
    for (c, out) in out.iter_mut().enumerate() {
        if (first..last).contains(&c) {
            continue;
        }
        for (i, weight) in tent.iter().enumerate() {
            let pixel = (c * H + i).checked_sub(H + H / 2).and_then(|x| row.get(x));
            *out += weight * pixel.copied().unwrap_or(0.0);
        }
    }
    let inside = out.get_mut(first..last).unwrap_or(&mut []);
    let (pixels, _) = row.get(H / 2..).unwrap_or(&[]).as_chunks::<H>();
    for ((before, behind), out) in pixels.iter().zip(pixels.get(1..).unwrap_or(&[])).zip(inside) {
        let mut sum = 0.0;
        for i in 0..H {
            sum += tent[i] * before[i];
        }
        for i in 0..H {
            sum += tent[H + i] * behind[i];
        }
        *out = sum;
    }
}

/// Cells of `H` pixels to pixels.
#[inline(always)]
pub(super) fn slice_row<const H: usize>(row: &[f32], out: &mut [f32]) {
    let up = ramp::<H>();
    // Half a cell lies before the first cell's centre.
    let (front, rest) = out.split_at_mut((H / 2).min(out.len()));
    if let Some(&[a, b]) = row.get(..2) {
        for (out, second) in front.iter_mut().zip(up.iter().skip(H / 2)) {
            *out = (1.0 - second) * a + second * b;
        }
    }
    let (a, b) = (row.get(1..).unwrap_or(&[]), row.get(2..).unwrap_or(&[]));
    let (whole, end) = rest.as_chunks_mut::<H>();
    let (cells, last) = (whole.len(), [a.get(whole.len()), b.get(whole.len())]);
    for ((out, a), b) in whole.iter_mut().zip(a.get(..cells).unwrap_or(&[])).zip(b) {
        for i in 0..H {
            out[i] = (1.0 - up[i]) * a + up[i] * b;
        }
    }
    if let [Some(a), Some(b)] = last {
        for (out, second) in end.iter_mut().zip(&up) {
            *out = (1.0 - second) * a + second * b;
        }
    }
}
