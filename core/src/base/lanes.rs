//! Runs of pixels of a row as arrays of constant length: loops over them vectorise without remainders.

/// Pixels of a run.
pub(crate) const LANES: usize = 128;

/// One value for each pixel of a run.
pub(crate) type Lanes = [f32; LANES];

/// The run of `row` that starts at `start`; zeros past its end.
#[inline(always)]
pub(crate) fn load(row: &[f32], start: usize) -> Lanes {
    let rest = row.get(start..).unwrap_or(&[]);
    match rest.first_chunk::<LANES>() {
        Some(run) => *run,
        None => {
            let mut run = [0.0; LANES];
            for (value, &given) in run.iter_mut().zip(rest) {
                *value = given;
            }
            run
        }
    }
}

/// The run of row `row` of three planes of `size` x `size`.
#[inline(always)]
pub(crate) fn load3(planes: &[f32], size: usize, row: usize, start: usize) -> [Lanes; 3] {
    [0, 1, 2].map(
        #[inline(always)]
        |plane| load(crate::base::planes::plane_row(planes, size, plane * size + row), start),
    )
}

/// Writes the part of a run that lies in `row`.
#[inline(always)]
pub(crate) fn store(run: &Lanes, row: &mut [f32], start: usize) {
    let rest = row.get_mut(start..).unwrap_or(&mut []);
    match rest.first_chunk_mut::<LANES>() {
        Some(out) => *out = *run,
        None => {
            for (out, &value) in rest.iter_mut().zip(run) {
                *out = value;
            }
        }
    }
}

/// 1 where none of `bits` is set in the flags of the run's pixel and the pixel is in the row, 0 elsewhere.
#[inline(always)]
pub(crate) fn unset(flags: &[u8], bits: u8, start: usize) -> Lanes {
    let rest = flags.get(start..).unwrap_or(&[]);
    let mut run = [0.0; LANES];
    match rest.first_chunk::<LANES>() {
        Some(flags) => {
            for i in 0..LANES {
                run[i] = if flags[i] & bits == 0 { 1.0 } else { 0.0 };
            }
        }
        None => {
            for (value, &flag) in run.iter_mut().zip(rest) {
                *value = if flag & bits == 0 { 1.0 } else { 0.0 };
            }
        }
    }
    run
}

/// The sum of a run: value i goes to running sum i modulo 16, then halves are added until one is left.
#[inline(always)]
pub(crate) fn sum(run: &Lanes) -> f32 {
    let mut sums = [0.0_f32; LANES / 8];
    for part in run.chunks_exact(LANES / 8) {
        for (sum, value) in sums.iter_mut().zip(part) {
            *sum += value;
        }
    }
    let mut half = sums.len() / 2;
    while half > 0 {
        for i in 0..half {
            sums[i] += sums[i + half];
        }
        half /= 2;
    }
    sums[0]
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    #[test]
    fn runs_end_with_their_row() {
        let row: Vec<f32> = (1..=200).map(|v| v as f32).collect();
        assert_eq!(load(&row, 3)[..], row[3..3 + LANES]);
        let last = load(&row, 128);
        assert_eq!(last[..72], row[128..]);
        assert!(last[72..].iter().chain(&load(&row, 300)).all(|&v| v == 0.0));
        let mut out = [0.0; 200];
        store(&load(&row, 0), &mut out, 0);
        store(&last, &mut out, 128);
        store(&last, &mut out, 999);
        assert_eq!(out[..], row[..]);
        assert_eq!(sum(&last), (129..=200).sum::<i32>() as f32);
        let flags: Vec<u8> = (0..200).map(|i| 4 * u8::from(i % 3 == 0) + 1).collect();
        assert_eq!(unset(&flags, 4, 0).iter().sum::<f32>(), 85.0);
        assert_eq!(unset(&flags, 4, 128).iter().sum::<f32>(), 48.0);
    }
}
