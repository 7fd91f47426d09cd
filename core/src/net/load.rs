//! Records of the file to a [`Graph`]: every count, offset, shape and value is checked here, once.
use super::CLASSES;
use super::format::{F32s, Sections};
use super::graph::{
    Graph, INPUT, INPUT_CHANNELS, INPUT_SCALE, INPUT_ZERO_POINT, Layer, MAX_CHANNELS, MAX_DIVISOR,
    MAX_KERNEL, MAX_LAYERS, MAX_PRODUCTS, MAX_TENSORS, Name, Op, Source, Sources, Tensor, Window,
};
use crate::ModelError;

const HEADER: usize = 16;
const TENSOR_RECORD: usize = 64;
const LAYER_RECORD: usize = 160;
const FIELDS: usize = 32;
pub(super) const NONE: u32 = u32::MAX;

/// Numbers of a layer record's fields.
pub(super) mod field {
    pub(in crate::net) const OP: usize = 0;
    pub(in crate::net) const SOURCE0: usize = 1;
    pub(in crate::net) const SOURCE1: usize = 3;
    pub(in crate::net) const OUTPUT: usize = 5;
    pub(in crate::net) const KERNEL_HEIGHT: usize = 6;
    pub(in crate::net) const KERNEL_WIDTH: usize = 7;
    pub(in crate::net) const STRIDE: usize = 8;
    pub(in crate::net) const PAD: usize = 9;
    pub(in crate::net) const RELU: usize = 13;
    pub(in crate::net) const SHUFFLE: usize = 14;
    pub(in crate::net) const MAP: usize = 15;
    pub(in crate::net) const CLASSES: usize = 16;
    pub(in crate::net) const COUT: usize = 17;
    pub(in crate::net) const WEIGHTS: usize = 18;
    pub(in crate::net) const BIAS: usize = 19;
    pub(in crate::net) const WEIGHT_SCALE: usize = 20;
    pub(in crate::net) const SUMS: usize = 21;
    pub(in crate::net) const FLOAT_WEIGHTS: usize = 22;
    pub(in crate::net) const FLOAT_BIAS: usize = 23;
}

/// The graph of a file's sections.
///
/// # Errors
/// The [`ModelError`] of the first rule that is broken.
pub(super) fn graph<'m>(sections: &Sections<'m>) -> Result<Graph<'m>, ModelError> {
    let length = ModelError::SectionLength { kind: *b"GRPH" };
    let (header, records) = sections.graph.split_at_checked(HEADER).ok_or(length)?;
    let (header, _) = header.as_chunks::<4>();
    let &[tensor_count, layer_count, input, logits] = header else { return Err(length) };
    let [tensor_count, layer_count, input, logits] =
        [tensor_count, layer_count, input, logits].map(u32::from_le_bytes);
    for (found, limit) in [(tensor_count, MAX_TENSORS as u32), (layer_count, MAX_LAYERS as u32)] {
        if found == 0 || found > limit {
            return Err(ModelError::Count { found, limit });
        }
    }
    let (tensor_count, layer_count) = (tensor_count as usize, layer_count as usize);
    let (tensors, layers) = records.split_at_checked(tensor_count * TENSOR_RECORD).ok_or(length)?;
    if layers.len() != layer_count * LAYER_RECORD {
        return Err(length);
    }
    let mut loader =
        Loader { sections, tensors: heapless::Vec::new(), written: [false; MAX_TENSORS], layer: 0 };
    for (index, record) in tensors.chunks_exact(TENSOR_RECORD).enumerate() {
        let tensor = read_tensor(record, index as u32)?;
        loader.tensors.push(tensor).map_err(|_| length)?;
    }
    loader.check_input(input)?;
    let logits = loader.check_logits(logits)?;
    let mut graph_layers = heapless::Vec::new();
    let mut heads = [0; 3];
    for (index, record) in layers.chunks_exact(LAYER_RECORD).enumerate() {
        loader.layer = index as u32;
        let layer = loader.read_layer(record, logits)?;
        if let Op::MixHead(head) = &layer.op {
            heads[head.map as usize] += 1;
        }
        graph_layers.push(layer).map_err(|_| length)?;
    }
    if heads != [1; 3] {
        return Err(ModelError::Heads);
    }
    if let Some(tensor) = loader.written.iter().take(tensor_count).position(|&written| !written) {
        return Err(ModelError::Tensor { tensor: tensor as u32 });
    }
    Ok(Graph { tensors: loader.tensors, layers: graph_layers, logits })
}

fn read_name(bytes: &[u8]) -> Result<Name<'_>, ModelError> {
    let name = Name(bytes.first_chunk().ok_or(ModelError::Text)?);
    let used = name.as_str().len();
    let (text, rest) = name.0.split_at(used);
    if used > 0 && text.iter().all(u8::is_ascii_graphic) && rest.iter().all(|&b| b == 0) {
        Ok(name)
    } else {
        Err(ModelError::Text)
    }
}

fn read_tensor(record: &[u8], tensor: u32) -> Result<Tensor<'_>, ModelError> {
    let wrong = ModelError::Tensor { tensor };
    let (numbers, name) = record.split_at_checked(32).ok_or(wrong)?;
    let (numbers, _) = numbers.as_chunks::<4>();
    let &[channels, divisor, scale, zero_point, ref reserved @ ..] = numbers else { return Err(wrong) };
    if reserved.iter().any(|&r| r != [0; 4]) {
        return Err(ModelError::Reserved);
    }
    let (channels, divisor) = (u32::from_le_bytes(channels) as usize, u32::from_le_bytes(divisor) as usize);
    let scale = f32::from_le_bytes(scale);
    let zero_point = i8::try_from(i32::from_le_bytes(zero_point)).map_err(|_| wrong)?;
    let image = divisor.is_power_of_two() && divisor <= MAX_DIVISOR;
    let vector = divisor == 0 && scale == 1.0 && zero_point == 0;
    if (1..=MAX_CHANNELS).contains(&channels) && (image || vector) && (1e-12..=1e12).contains(&scale) {
        Ok(Tensor { name: read_name(name)?, channels, divisor, scale, zero_point })
    } else {
        Err(wrong)
    }
}

/// A graph as far as it has been read.
pub(super) struct Loader<'s, 'm> {
    pub(super) sections: &'s Sections<'m>,
    pub(super) tensors: heapless::Vec<Tensor<'m>, MAX_TENSORS>,
    pub(super) written: [bool; MAX_TENSORS],
    pub(super) layer: u32,
}

/// A layer's fields, all of them checked to be zero unless a reader took them.
pub(super) struct Fields {
    values: [u32; FIELDS],
    taken: u32,
}

impl Fields {
    pub(super) fn take(&mut self, at: usize) -> u32 {
        self.taken |= 1 << at;
        self.values.get(at).copied().unwrap_or(0)
    }

    fn rest_is_zero(&self) -> bool {
        self.values.iter().enumerate().all(|(at, &value)| value == 0 || self.taken >> at & 1 == 1)
    }
}

impl<'m> Loader<'_, 'm> {
    fn check_input(&mut self, input: u32) -> Result<(), ModelError> {
        match self.tensors.first() {
            Some(t)
                if input as usize == INPUT
                    && (t.channels, t.divisor) == (INPUT_CHANNELS, 1)
                    && t.scale == INPUT_SCALE
                    && t.zero_point == INPUT_ZERO_POINT =>
            {
                self.written[INPUT] = true;
                Ok(())
            }
            _ => Err(ModelError::Input),
        }
    }

    fn check_logits(&self, logits: u32) -> Result<usize, ModelError> {
        let at = logits as usize;
        match self.tensors.get(at) {
            Some(tensor) if !tensor.is_image() && tensor.channels == CLASSES => Ok(at),
            _ => Err(ModelError::Logits),
        }
    }

    pub(super) fn source_error(&self) -> ModelError {
        ModelError::LayerSource { layer: self.layer }
    }

    pub(super) fn shape_error(&self) -> ModelError {
        ModelError::LayerShape { layer: self.layer }
    }

    pub(super) fn bounds_error(&self) -> ModelError {
        ModelError::LayerBounds { layer: self.layer }
    }

    pub(super) fn value_error(&self) -> ModelError {
        ModelError::LayerValue { layer: self.layer }
    }

    /// A tensor that has been written, image or vector.
    pub(super) fn read(&self, id: u32, image: bool) -> Result<(usize, Tensor<'m>), ModelError> {
        let at = id as usize;
        match (self.tensors.get(at), self.written.get(at)) {
            (Some(tensor), Some(true)) if tensor.is_image() == image => Ok((at, *tensor)),
            _ => Err(self.source_error()),
        }
    }

    /// Marks the tensor as written; it must be new and of this shape.
    pub(super) fn write(&mut self, id: u32, channels: usize, divisor: usize) -> Result<usize, ModelError> {
        let at = id as usize;
        match (self.tensors.get(at), self.written.get_mut(at)) {
            (Some(tensor), Some(written))
                if !*written && tensor.channels == channels && tensor.divisor == divisor =>
            {
                *written = true;
                Ok(at)
            }
            _ => Err(ModelError::LayerOutput { layer: self.layer }),
        }
    }

    pub(super) fn flag(&self, value: u32) -> Result<bool, ModelError> {
        match value {
            0 => Ok(false),
            1 => Ok(true),
            _ => Err(self.shape_error()),
        }
    }

    /// The sources, their channels in all, and the divisor at which they are read.
    pub(super) fn sources(&self, fields: &mut Fields) -> Result<(Sources, usize, usize), ModelError> {
        let one = |fields: &mut Fields, at: usize| {
            let (id, upsample) = (fields.take(at), fields.take(at + 1));
            let (tensor, shape) = self.read(id, true)?;
            let upsample = self.flag(upsample)?;
            let divisor = if upsample { shape.divisor / 2 } else { shape.divisor };
            if divisor == 0 {
                return Err(self.shape_error());
            }
            Ok((Source::new(tensor, upsample), shape.channels, divisor))
        };
        let (first, cin, divisor) = one(fields, field::SOURCE0)?;
        if fields.values[field::SOURCE1] == NONE {
            let _ = fields.take(field::SOURCE1);
            return Ok((Sources { first, second: None }, cin, divisor));
        }
        let (second, more, same) = one(fields, field::SOURCE1)?;
        if same != divisor {
            return Err(self.shape_error());
        }
        Ok((Sources { first, second: Some(second) }, cin + more, divisor))
    }

    /// Kernel, stride and padding such that output side = input side / stride for every input.
    pub(super) fn window(&self, fields: &mut Fields, cin: usize) -> Result<Window, ModelError> {
        let height = fields.take(field::KERNEL_HEIGHT) as usize;
        let width = fields.take(field::KERNEL_WIDTH) as usize;
        let stride = fields.take(field::STRIDE) as usize;
        let pad = core::array::from_fn(|i| fields.take(field::PAD + i) as usize);
        let [top, left, bottom, right] = pad;
        let fits = |kernel: usize, before: usize, after: usize| {
            let pad = before.saturating_add(after);
            (1..=MAX_KERNEL).contains(&kernel) && pad < kernel && pad + stride >= kernel
        };
        if !(1..=2).contains(&stride) || !fits(height, top, bottom) || !fits(width, left, right) {
            return Err(self.shape_error());
        }
        if height * width * cin > MAX_PRODUCTS {
            return Err(self.shape_error());
        }
        Ok(Window { height, width, stride, pad })
    }

    pub(super) fn floats(&self, offset: u32, count: usize) -> Result<F32s<'m>, ModelError> {
        let values = F32s::new(self.sections.params, offset, count).ok_or(self.bounds_error())?;
        self.finite(values)
    }

    pub(super) fn finite(&self, values: F32s<'m>) -> Result<F32s<'m>, ModelError> {
        if values.iter().all(f32::is_finite) { Ok(values) } else { Err(self.value_error()) }
    }

    fn read_layer(&mut self, record: &'m [u8], logits: usize) -> Result<Layer<'m>, ModelError> {
        let (numbers, name) = record.split_at_checked(FIELDS * 4).ok_or(self.shape_error())?;
        let mut fields = Fields { values: [0; FIELDS], taken: 0 };
        for (value, &bytes) in fields.values.iter_mut().zip(numbers.as_chunks::<4>().0) {
            *value = u32::from_le_bytes(bytes);
        }
        let name = read_name(name)?;
        let op = match fields.take(field::OP) {
            1 => Op::Conv(self.read_conv(&mut fields)?),
            2 => Op::MeanPool(self.read_pool(&mut fields)?),
            3 => Op::Dense(self.read_dense(&mut fields)?),
            4 => Op::MixHead(self.read_head(&mut fields, logits)?),
            5 => Op::Depthwise(self.read_depthwise(&mut fields)?),
            _ => return Err(ModelError::LayerKind { layer: self.layer }),
        };
        if op.output() == Some(logits) && !matches!(op, Op::Dense(_)) {
            return Err(ModelError::Logits);
        }
        if fields.rest_is_zero() { Ok(Layer { name, op }) } else { Err(ModelError::Reserved) }
    }
}
