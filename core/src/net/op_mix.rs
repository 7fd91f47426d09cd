//! A map's last convolution. Its eight per-class sets of weights are mixed by the class probabilities before the
//! non-linearity, so the paper's K x N-channel layer is one N-channel convolution whose weights are known once the
//! classifier has run: mixed and quantised here, then run on the int8 kernels like any other.
//!
//! logit = accumulator * weight scale + bias; planes by pixel shuffle (PyTorch's order); activation.
use super::activation;
use super::band::{Bands, Input};
use super::classes::{ClassProbabilities, Map};
use super::format::F32s;
use super::graph::MixHead;
use super::op_conv::fill_offsets;
use crate::Error;
use crate::base::arena::{Arena, bytes_for};
use crate::base::exec::{Executor, Plane, for_each_row_block};
use crate::kernels::quant::weight_code;
use crate::kernels::{Block, Kernels, pack};

fn shape(head: &MixHead<'_>) -> pack::Shape {
    pack::Shape::new(head.cout, head.window.get().height, head.window.get().width, head.cin)
}

/// Scratch that [`run`] takes, for `side x side` pixels before the shuffle.
pub(super) fn scratch_bytes(head: &MixHead<'_>, side: usize, kernels: &Kernels) -> usize {
    let (shape, bands) = (shape(head), Bands::new(&head.window.get(), head.cin, side));
    let sums = bands.rows.saturating_mul(side).saturating_mul(head.cout);
    [
        bytes_for::<f32>(shape.plain_len()),
        bytes_for::<i8>(shape.plain_len()),
        bytes_for::<i8>(shape.packed_len()),
        3 * bytes_for::<f32>(shape.panels() * pack::PANEL),
        bytes_for::<i32>(2 * head.cout),
        bytes_for::<u8>(bands.slots.saturating_mul(bands.bytes(kernels))),
        bytes_for::<i32>(bands.slots.saturating_mul(sums)),
    ]
    .into_iter()
    .fold(0, usize::saturating_add)
}

/// sum_k P_k x_k in single precision, in the order of the classes; a lone set is taken as it is.
pub(super) fn mix(sets: F32s<'_>, classes: usize, probabilities: &ClassProbabilities, out: &mut [f32]) {
    let count = out.len();
    for class in 0..classes {
        let values = sets.run(class, count).iter();
        let weight = if classes == 1 { 1.0 } else { probabilities.0.get(class).copied().unwrap_or(0.0) };
        for (out, value) in out.iter_mut().zip(values) {
            *out = if class == 0 { weight * value } else { *out + weight * value };
        }
    }
}

/// Weights ready for the kernels.
struct Mixed<'s> {
    packed: &'s [i8],
    offset: &'s [i32],
    scale: &'s [f32],
    bias: &'s [f32],
}

impl Mixed<'_> {
    /// Scale and bias of an output channel.
    #[inline(always)]
    fn channel(&self, index: usize) -> (f32, f32) {
        (self.scale.get(index).copied().unwrap_or(0.0), self.bias.get(index).copied().unwrap_or(0.0))
    }
}

/// Mixes, folds each source's activation scale into its channels, quantises per output channel, packs.
fn prepare<'s>(
    head: &MixHead<'_>,
    probabilities: &ClassProbabilities,
    inputs: impl Iterator<Item = (Input<'s>, f32)> + Clone,
    kernels: &Kernels,
    scratch: &mut Arena<'s>,
) -> Result<Mixed<'s>, Error> {
    let shape = shape(head);
    let channels = shape.panels() * pack::PANEL;
    let weights = scratch.take::<f32>(shape.plain_len())?;
    let codes = scratch.take::<i8>(shape.plain_len())?;
    let packed = scratch.take::<i8>(shape.packed_len())?;
    let offset = scratch.take::<i32>(channels)?;
    let scale = scratch.zeroed::<f32>(channels)?;
    let bias = scratch.zeroed::<f32>(channels)?;
    let sums = scratch.take::<i32>(2 * head.cout)?;
    mix(head.weights, head.classes, probabilities, weights);
    mix(head.bias, head.classes, probabilities, bias.get_mut(..head.cout).unwrap_or(&mut []));
    for pixel in weights.chunks_exact_mut(head.cin) {
        let mut rest = pixel;
        for (input, scale) in inputs.clone() {
            let (mine, others) = rest.split_at_mut(input.channels.min(rest.len()));
            mine.iter_mut().for_each(|w| *w *= scale);
            rest = others;
        }
    }
    let per_channel = head.window.get().height * shape.run;
    let channels = weights.chunks_exact(per_channel).zip(codes.chunks_exact_mut(per_channel));
    for ((weights, codes), scale) in channels.zip(scale.iter_mut()) {
        let peak = weights.iter().fold(0.0_f32, |peak, w| peak.max(w.abs()));
        *scale = if peak > 0.0 { peak / 127.0 } else { 1.0 };
        for (code, &weight) in codes.iter_mut().zip(weights) {
            *code = weight_code(weight, *scale);
        }
    }
    pack::pack(codes, &shape, packed);
    let first = inputs.clone().next().map_or(head.cin, |(input, _)| input.channels);
    pack::sums(packed, &shape, first, sums);
    let sum = |source: usize, channel: usize| sums.get(source * head.cout + channel).copied().unwrap_or(0);
    let zero_points = inputs.map(|(input, _)| input.zero_point);
    fill_offsets(core::iter::repeat_n(0, head.cout), sum, zero_points, kernels, offset);
    Ok(Mixed { packed, offset, scale, bias })
}

/// Runs one head; `planes` are the map's, `side * shuffle` pixels square.
#[inline(never)] // tests/counts counts it by its name.
pub(super) fn run<'a>(
    head: &MixHead<'_>,
    probabilities: &ClassProbabilities,
    inputs: impl Iterator<Item = (Input<'a>, f32)> + Clone + Sync,
    (kernels, exec): (&Kernels, &dyn Executor),
    mut scratch: Arena<'a>,
    side: usize,
    planes: [&mut [f32]; 3],
) -> Result<(), Error> {
    let mixed = prepare(head, probabilities, inputs.clone(), kernels, &mut scratch)?;
    let (shape, bands) = (shape(head), Bands::new(&head.window.get(), head.cin, side));
    let sums_len = bands.rows * side * head.cout;
    let band_bytes = scratch.take::<u8>(bands.slots.saturating_mul(bands.bytes(kernels)))?;
    let sums = scratch.take::<i32>(bands.slots.saturating_mul(sums_len))?;
    // One probe of the largest block: the blocks below cannot fail where it did not.
    Block::new(band_bytes, bands.geometry(bands.rows.min(side), kernels), shape, mixed.packed, mixed.offset)?;
    let row_len = side * head.shuffle * head.shuffle;
    let planes = planes.map(|plane| Plane::new(plane, bands.slot_rows * row_len));
    let parts = (planes, Plane::new(band_bytes, bands.bytes(kernels)), Plane::new(sums, sums_len));
    for_each_row_block(exec, bands.slots, 1, parts, &|slot, (planes, mut band, mut sums)| {
        let (band, sums) = (band.values(), sums.values());
        let start = slot.start * bands.slot_rows;
        let end = (start + bands.slot_rows).min(side);
        let mut rest = planes;
        for first in (start..end).step_by(bands.rows) {
            let rows = bands.rows.min(end - first);
            bands.fill(inputs.clone().map(|(input, _)| input), first, rows, kernels, band);
            let sums = sums.get_mut(..rows * side * head.cout).unwrap_or(&mut []);
            let block = Block::new(band, bands.geometry(rows, kernels), shape, mixed.packed, mixed.offset);
            let done = block.and_then(|block| kernels.accumulate(&block, sums));
            debug_assert!(done.is_ok(), "{done:?}");
            let skip = (first - start) * row_len;
            let planes = rest
                .each_mut()
                .map(|plane| plane.values().get_mut(skip..skip + rows * row_len).unwrap_or(&mut []));
            let finish = Finish { head, mixed: &mixed, side, sums, planes };
            kernels.simd().run(
                #[inline(always)]
                || finish.run(),
            );
        }
    });
    Ok(())
}

/// Accumulators of a band's rows to the map's pixels.
struct Finish<'f, 'm> {
    head: &'f MixHead<'m>,
    mixed: &'f Mixed<'f>,
    side: usize,
    sums: &'f [i32],
    planes: [&'f mut [f32]; 3],
}

impl Finish<'_, '_> {
    #[inline(always)]
    fn run(self) {
        let Self { head, mixed, side, sums, mut planes } = self;
        let r = head.shuffle;
        for (plane, map) in planes.iter_mut().enumerate().take(head.map.channels()) {
            for (row, line) in map.chunks_exact_mut(side * r).enumerate() {
                let first = plane * r * r + row % r * r;
                let sums = sums.chunks_exact(side * head.cout).nth(row / r).unwrap_or(&[]);
                match r {
                    1 => shuffle_row::<1>(mixed, first, head.cout, sums, line),
                    2 => shuffle_row::<2>(mixed, first, head.cout, sums, line),
                    _ => (0..r).for_each(|j| {
                        let (scale, bias) = mixed.channel(first + j);
                        let accumulators = sums.iter().skip(first + j).step_by(head.cout);
                        for (out, &acc) in line.iter_mut().skip(j).step_by(r).zip(accumulators) {
                            *out = acc as f32 * scale + bias;
                        }
                    }),
                }
            }
        }
        let [x, y, z] = planes;
        match head.map {
            Map::Albedo => [x, y, z].into_iter().for_each(activation::sigmoid_all),
            Map::Roughness => activation::sigmoid_all(x),
            Map::Normal => activation::normals(x, y, z),
        }
    }
}

/// One row of logits: R neighbours from the R channels at `first` of each pixel.
#[inline(always)]
fn shuffle_row<const R: usize>(mixed: &Mixed<'_>, first: usize, cout: usize, sums: &[i32], line: &mut [f32]) {
    let (scale, bias): ([f32; R], [f32; R]) = (
        core::array::from_fn(|j| mixed.channel(first + j).0),
        core::array::from_fn(|j| mixed.channel(first + j).1),
    );
    for (out, pixel) in line.as_chunks_mut::<R>().0.iter_mut().zip(sums.chunks_exact(cout)) {
        let Some(acc) = pixel.get(first..).and_then(<[i32]>::first_chunk::<R>) else { return };
        for (((out, &acc), scale), bias) in out.iter_mut().zip(acc).zip(&scale).zip(&bias) {
            *out = acc as f32 * scale + bias;
        }
    }
}
