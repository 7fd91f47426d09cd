//! The one packed weight layout, the same for every level and in the model file, so that nothing is packed at load.
//!
//! A panel holds 16 output channels. Within it, kernel row by kernel row, the `width * cin` weights that multiply one
//! contiguous run of pixels are cut into groups of four: `[cout / 16][height][groups][16][4]`. One group row is one
//! 512-bit register for `vpdpbusd`, four 128-bit registers for `sdot` or for widening to 16 bit; zipping two groups gives
//! `smmla`'s 2 x 8. Channels past `cout` and weights past the run are zero.
/// Output channels in a panel.
pub const PANEL: usize = 16;
/// Weights in a group.
pub const GROUP: usize = 4;
/// Weights in one group row of a panel.
pub const BLOCK: usize = PANEL * GROUP;

/// Shape of a convolution's weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Output channels.
    pub cout: usize,
    /// Kernel rows.
    pub height: usize,
    /// Values in one kernel row: kernel columns times input channels.
    pub run: usize,
    /// Input channels.
    pub cin: usize,
}

impl Shape {
    /// The shape of `[cout][height][width][cin]` weights.
    #[must_use]
    pub const fn new(cout: usize, height: usize, width: usize, cin: usize) -> Self {
        Self { cout, height, run: width.saturating_mul(cin), cin }
    }

    /// Panels of output channels.
    #[must_use]
    pub const fn panels(&self) -> usize {
        self.cout.div_ceil(PANEL)
    }

    /// Groups in one kernel row.
    #[must_use]
    pub const fn groups(&self) -> usize {
        self.run.div_ceil(GROUP)
    }

    /// Bytes of one packed panel.
    #[must_use]
    pub const fn panel_len(&self) -> usize {
        self.height.saturating_mul(self.groups()).saturating_mul(BLOCK)
    }

    /// Bytes of all packed weights.
    #[must_use]
    pub const fn packed_len(&self) -> usize {
        self.panels().saturating_mul(self.panel_len())
    }

    /// Weights of the plain layout.
    #[must_use]
    pub const fn plain_len(&self) -> usize {
        self.cout.saturating_mul(self.height).saturating_mul(self.run)
    }
}

/// Packs plain weights `[cout][height][run]` into `packed`, which must be as long as the shape says (else it stays
/// as it is).
pub fn pack(plain: &[i8], shape: &Shape, packed: &mut [i8]) {
    if plain.len() != shape.plain_len() || packed.len() != shape.packed_len() {
        return;
    }
    packed.fill(0);
    let per_channel = shape.height * shape.run;
    for (channel, rows) in plain.chunks_exact(per_channel.max(1)).enumerate() {
        let (panel, lane) = (channel / PANEL, channel % PANEL);
        for (row, run) in rows.chunks_exact(shape.run.max(1)).enumerate() {
            let base = panel * shape.panel_len() + row * shape.groups() * BLOCK + lane * GROUP;
            for (group, weights) in run.chunks(GROUP).enumerate() {
                let at = base + group * BLOCK;
                if let Some(slot) = packed.get_mut(at..at + weights.len()) {
                    slot.copy_from_slice(weights);
                }
            }
        }
    }
}

/// The inverse of [`pack`], for slices as long as the shape says (else `plain` stays as it is).
pub fn unpack(packed: &[i8], shape: &Shape, plain: &mut [i8]) {
    if plain.len() != shape.plain_len() || packed.len() != shape.packed_len() {
        return;
    }
    for (channel, rows) in plain.chunks_exact_mut((shape.height * shape.run).max(1)).enumerate() {
        let (panel, lane) = (channel / PANEL, channel % PANEL);
        for (row, run) in rows.chunks_exact_mut(shape.run.max(1)).enumerate() {
            let base = panel * shape.panel_len() + row * shape.groups() * BLOCK + lane * GROUP;
            for (group, weights) in run.chunks_mut(GROUP).enumerate() {
                let at = base + group * BLOCK;
                if let Some(slot) = packed.get(at..at + weights.len()) {
                    weights.copy_from_slice(slot);
                }
            }
        }
    }
}

/// Sums of one panel's weights: `[source][lane]`, where the first `first` channels belong to source 0; or `None` when
/// padding is not zero.
fn panel_sums(panel: &[i8], shape: &Shape, first: usize) -> Option<[[i32; PANEL]; 2]> {
    let mut sums = [[0_i32; PANEL]; 2];
    for row in panel.chunks_exact((shape.groups() * BLOCK).max(1)) {
        let mut channel = 0;
        let mut position = 0;
        for block in row.as_chunks::<BLOCK>().0 {
            let whole = position + GROUP <= shape.run && channel % shape.cin + GROUP <= shape.cin;
            let one_source = whole && (channel >= first || channel + GROUP <= first);
            if one_source {
                let sums = &mut sums[usize::from(channel >= first)];
                for (sum, weights) in sums.iter_mut().zip(block.as_chunks::<GROUP>().0) {
                    *sum += weights.iter().map(|&w| i32::from(w)).sum::<i32>();
                }
                channel += GROUP;
            } else {
                for byte in 0..GROUP {
                    let inside = position + byte < shape.run;
                    let sums = &mut sums[usize::from(channel >= first)];
                    for (sum, weights) in sums.iter_mut().zip(block.as_chunks::<GROUP>().0) {
                        let weight = weights[byte];
                        if !inside && weight != 0 {
                            return None;
                        }
                        *sum += i32::from(weight);
                    }
                    channel += 1;
                    if channel == shape.cin {
                        channel = 0;
                    }
                }
            }
            if channel == shape.cin {
                channel = 0;
            }
            position += GROUP;
        }
    }
    Some(sums)
}

/// Writes the sums of packed weights, `[source][cout]`; channels below `first` belong to source 0, the others to
/// source 1, whose row is left out when `first` is all of them. Weights of wrong length or padding leave zeros.
pub fn sums(packed: &[i8], shape: &Shape, first: usize, out: &mut [i32]) {
    out.fill(0);
    for (panel, weights) in packed.chunks_exact(shape.panel_len().max(1)).enumerate() {
        let Some(sums) = panel_sums(weights, shape, first) else { return };
        for (row, sums) in out.chunks_mut(shape.cout.max(1)).zip(&sums) {
            for (slot, &sum) in row.iter_mut().skip(panel * PANEL).zip(sums) {
                *slot = sum;
            }
        }
    }
}

/// Whether `stored`, `[source][cout]`, are the sums of the packed weights and all padding is zero.
#[must_use]
pub fn sums_match(
    packed: &[i8],
    shape: &Shape,
    first: usize,
    stored: impl Iterator<Item = i32> + Clone,
) -> bool {
    packed.chunks_exact(shape.panel_len().max(1)).enumerate().all(|(panel, weights)| {
        let Some(sums) = panel_sums(weights, shape, first) else { return false };
        sums.iter().enumerate().all(|(source, sums)| {
            let of_source = stored.clone().skip(source * shape.cout).take(shape.cout);
            let mut expected = of_source.skip(panel * PANEL);
            sums.iter().enumerate().all(|(lane, &sum)| {
                let padding = panel * PANEL + lane >= shape.cout || (source == 1 && first == shape.cin);
                sum == if padding { 0 } else { expected.next().unwrap_or(i32::MIN) }
            })
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;
    use std::vec::Vec;

    /// Weight (channel, row, position) by the layout's formula, read back from packed bytes.
    fn at(packed: &[i8], shape: &Shape, channel: usize, row: usize, position: usize) -> i8 {
        packed[(channel / 16) * shape.panel_len()
            + (row * shape.groups() + position / 4) * 64
            + (channel % 16) * 4
            + position % 4]
    }

    #[test]
    fn packing_and_sums_follow_the_formula() {
        for (cout, height, width, cin, first) in [
            (1, 1, 1, 1, 1),
            (16, 3, 3, 8, 8),
            (17, 4, 4, 5, 5),
            (40, 3, 3, 72, 40),
            (33, 2, 3, 7, 3),
            (5, 3, 1, 9, 4),
        ] {
            let shape = Shape::new(cout, height, width, cin);
            let plain: Vec<i8> = (0..shape.plain_len()).map(|i| ((i * 89 + 13) % 255) as i8).collect();
            let mut packed = vec![99; shape.packed_len()];
            pack(&plain, &shape, &mut packed);
            let mut back = vec![99; plain.len()];
            unpack(&packed, &shape, &mut back);
            assert_eq!(back, plain, "{shape:?}");
            let mut sums_out = vec![0; if first < cin { 2 * cout } else { cout }];
            sums(&packed, &shape, first, &mut sums_out);
            for channel in 0..cout {
                let mut by_hand = [0_i32; 2];
                for row in 0..height {
                    for position in 0..shape.run {
                        let w = plain[(channel * height + row) * shape.run + position];
                        assert_eq!(at(&packed, &shape, channel, row, position), w);
                        by_hand[usize::from(position % cin >= first)] += i32::from(w);
                    }
                }
                assert_eq!(sums_out[channel], by_hand[0], "{shape:?}");
                if first < cin {
                    assert_eq!(sums_out[cout + channel], by_hand[1], "{shape:?}");
                }
            }
            let stored = sums_out.iter().copied();
            assert!(sums_match(&packed, &shape, first, stored.clone()));
            let used: i32 = packed.iter().map(|&w| i32::from(w)).sum();
            assert_eq!(used, plain.iter().map(|&w| i32::from(w)).sum::<i32>(), "padding is zero");
            for position in [0, packed.len() / 2, packed.len() - 1] {
                let mut wrong = packed.clone();
                wrong[position] = wrong[position].wrapping_add(1);
                assert!(!sums_match(&wrong, &shape, first, stored.clone()), "{shape:?} {position}");
            }
        }
    }
}
