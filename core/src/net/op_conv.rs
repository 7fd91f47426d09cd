//! Int8 convolution: gathers bands and hands them to the kernels; see `docs/model-format.md` for the arithmetic.
use super::band::{Bands, Input};
use super::format::{F32s, I32s};
use super::graph::Conv;
use crate::Error;
use crate::base::arena::{Arena, bytes_for};
use crate::base::exec::{Executor, Plane, for_each_row_block};
use crate::kernels::quant::Range;
use crate::kernels::{Block, Kernels, Requant, pack};

/// The shape of a convolution's packed weights.
pub(super) fn shape(conv: &Conv<'_>) -> pack::Shape {
    pack::Shape::new(conv.cout, conv.window.get().height, conv.window.get().width, conv.cin)
}

/// Scratch that [`run`] takes, for `side x side` output pixels.
pub(super) fn scratch_bytes(conv: &Conv<'_>, side: usize, kernels: &Kernels) -> usize {
    let bands = Bands::new(&conv.window.get(), conv.cin, side);
    let channels = shape(conv).panels() * pack::PANEL;
    bytes_for::<u8>(bands.slots.saturating_mul(bands.bytes(kernels)))
        .saturating_add(bytes_for::<i32>(channels))
        .saturating_add(bytes_for::<f32>(channels))
}

/// What accumulators start from: the bias, less what zero points and the level's flip add to every sum.
///
/// sum w (q - z) = sum w (q ^ flip as stored) - sum over sources of (z + flip) * (sum of the source's w).
pub(super) fn fill_offsets(
    bias: impl Iterator<Item = i32>,
    sums: impl Fn(usize, usize) -> i32,
    zero_points: impl Iterator<Item = i8> + Clone,
    kernels: &Kernels,
    offset: &mut [i32],
) {
    offset.fill(0);
    for (channel, (slot, bias)) in offset.iter_mut().zip(bias).enumerate() {
        *slot = zero_points.clone().enumerate().fold(bias, |total, (source, zero_point)| {
            let lift = i32::from(zero_point) + kernels.flip_bias();
            // Wrapping: the finished sum is within 32 bits, what comes on the way need not be.
            total.wrapping_sub(lift.wrapping_mul(sums(source, channel)))
        });
    }
}

/// Runs one convolution; `output` is `side x side x cout`, interleaved.
#[inline(never)] // tests/counts counts it by its name.
pub(super) fn run<'a>(
    conv: &Conv<'_>,
    inputs: impl Iterator<Item = Input<'a>> + Clone + Sync,
    (scale, range): (f32, Range),
    (kernels, exec): (&Kernels, &dyn Executor),
    mut scratch: Arena<'_>,
    side: usize,
    output: &mut [i8],
) -> Result<(), Error> {
    let shape = shape(conv);
    let bands = Bands::new(&conv.window.get(), conv.cin, side);
    let channels = shape.panels() * pack::PANEL;
    let band_bytes = scratch.take::<u8>(bands.slots.saturating_mul(bands.bytes(kernels)))?;
    let offset = scratch.take::<i32>(channels)?;
    let multiplier = scratch.zeroed::<f32>(channels)?;
    let sum = |source: usize, channel: usize| nth(conv.sums.run(source, conv.cout), channel);
    fill_offsets(conv.bias.iter(), sum, inputs.clone().map(|i| i.zero_point), kernels, offset);
    fill_multipliers(conv.weight_scale, scale, multiplier);
    let requant = Requant { multiplier, range };
    let (offset, row_len) = (&*offset, side * conv.cout);
    // One probe of the largest block: the blocks below cannot fail where it did not.
    Block::new(band_bytes, bands.geometry(bands.rows.min(side), kernels), shape, conv.weights, offset)?;
    let planes =
        (Plane::new(output, bands.slot_rows * row_len), Plane::new(band_bytes, bands.bytes(kernels)));
    for_each_row_block(exec, bands.slots, 1, planes, &|slot, (mut out, mut band)| {
        let (mut first, band) = (slot.start * bands.slot_rows, band.values());
        for out in out.values().chunks_mut(bands.rows * row_len) {
            let rows = out.len() / row_len;
            bands.fill(inputs.clone(), first, rows, kernels, band);
            let block = Block::new(band, bands.geometry(rows, kernels), shape, conv.weights, offset);
            let done = block.and_then(|block| kernels.convolve(&block, &requant, out));
            debug_assert!(done.is_ok(), "{done:?}");
            first += rows;
        }
    });
    Ok(())
}

fn nth(values: I32s<'_>, index: usize) -> i32 {
    values.iter().nth(index).unwrap_or(0)
}

/// weight scale / output scale, one IEEE single division per channel.
pub(super) fn fill_multipliers(weight_scale: F32s<'_>, scale: f32, multiplier: &mut [f32]) {
    for (slot, weight_scale) in multiplier.iter_mut().zip(weight_scale.iter()) {
        *slot = weight_scale / scale;
    }
}
