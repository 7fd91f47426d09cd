//! The float engine (feature `tract`): the model's float weights as a tract graph (where the file has none, what its
//! int8 weights stand for: then only the activations are not rounded). It runs retrained networks that
//! are not quantised, and it is an oracle of the int8 engine: other code, other arithmetic, and the heads mix the
//! outputs of all classes after their convolutions instead of the weights before.
//!
//! Unlike the int8 engine it needs `std` and allocates, and its bits may differ between CPUs.
use super::activation;
use super::classes::{CLASSES, ClassProbabilities, Map, Mixing};
use super::graph::{self, Dense, Depthwise, Graph, INPUT, INPUT_CHANNELS, MixHead, Op, Sources, Window};
use super::op_input::coordinate;
use super::{Classification, Model, split3};
use crate::base::arena::Arena;
use crate::base::exec::Executor;
use crate::base::planes::check_planes;
use crate::frame::LinearImage;
use crate::frame::geometry::Geometry;
use crate::frame::transfer::linear_to_srgb;
use crate::kernels::pack::{Shape, unpack};
use crate::maps::MapsMut;
use crate::net::Inference;
use crate::{Error, Observer, Stage};
use std::boxed::Box;
use std::vec;
use std::vec::Vec;
use tract_core::internal::*;
use tract_core::ops::array::{MultiBroadcastTo, TypedConcat};
use tract_core::ops::cnn::{Conv, KernelFormat, PaddingSpec, PoolSpec};
use tract_core::ops::math;
use tract_core::ops::nn::{DataFormat, Reduce, Reducer};

/// A model's float weights, planned for one size.
#[derive(Debug)]
pub struct FloatNetwork<'m> {
    model: Model<'m>,
    size: usize,
    plan: Arc<TypedRunnableModel>,
}

/// Outputs of the tract graph: every tensor but the input in the order of the layers that write them (an image as
/// `[1][side][side][channels]`, a vector as `[1][1][1][channels]`), and each head's raw channels of all classes.
type Outputs = TVec<TValue>;

impl<'m> FloatNetwork<'m> {
    /// Builds and optimises the graph.
    ///
    /// # Errors
    /// [`Error::NetworkSize`]; [`Error::Float`] when tract refuses the graph.
    pub fn new(model: Model<'m>, size: usize) -> Result<Self, Error> {
        let multiple = model.graph.multiple();
        if size == 0 || size > crate::base::planes::MAX_SIZE || !size.is_multiple_of(multiple) {
            return Err(Error::NetworkSize { size, multiple });
        }
        let plan = build(&model, size).map_err(|_| Error::Float)?;
        Ok(Self { model, size, plan })
    }

    fn outputs(&self, photo: &LinearImage<'_>) -> Result<Outputs, Error> {
        if photo.size != self.size {
            return Err(Error::NetworkSize { size: photo.size, multiple: self.size });
        }
        check_planes(self.size, 3, photo.rgb.len())?;
        let shape = [1, self.size, self.size, INPUT_CHANNELS];
        let input = Tensor::from_shape(&shape, &input(photo)).map_err(|_| Error::Float)?;
        self.plan.run(tvec!(input.into_tvalue())).map_err(|_| Error::Float)
    }

    /// Every tensor but the input, by number, interleaved: what the int8 engine's tensors approximate.
    ///
    /// # Errors
    /// As [`Engine::infer`].
    pub fn tensors(&self, photo: &LinearImage<'_>) -> Result<Vec<(usize, Vec<f32>)>, Error> {
        let outputs = self.outputs(photo)?;
        let written = self.model.graph.layers().iter().zip(&outputs);
        let kept = written.filter_map(|(layer, values)| Some((layer.op.output()?, values)));
        kept.map(|(tensor, values)| Ok((tensor, floats(values)?.to_vec()))).collect()
    }
}

fn floats(values: &TValue) -> Result<&[f32], Error> {
    values.try_as_plain_ram().and_then(|view| view.as_slice::<f32>()).map_err(|_| Error::Float)
}

impl Inference for FloatNetwork<'_> {
    fn model(&self) -> &Model<'_> {
        &self.model
    }

    fn size(&self) -> usize {
        self.size
    }

    fn workspace_bytes(&self) -> usize {
        0
    }

    fn infer(
        &self,
        photo: &LinearImage<'_>,
        mixing: Mixing,
        _exec: &dyn Executor,
        _arena: &mut Arena<'_>,
        maps: &mut MapsMut<'_>,
        observer: &mut dyn Observer,
    ) -> Result<Classification, Error> {
        check_planes(self.size, 3, maps.albedo.len())?;
        check_planes(self.size, 3, maps.normal.len())?;
        check_planes(self.size, 1, maps.roughness.len())?;
        if observer.progress(Stage::Global, 0.0).is_break() {
            return Err(Error::Cancelled);
        }
        let outputs = self.outputs(photo)?;
        let graph = &self.model.graph;
        let mut predicted = ClassProbabilities::UNIFORM;
        for (layer, values) in graph.layers().iter().zip(&outputs) {
            if layer.op.output() == Some(graph.logits) {
                let logits = floats(values)?.first_chunk::<CLASSES>();
                predicted = logits.map_or(predicted, ClassProbabilities::softmax);
            }
        }
        let classification = mixing.classification(predicted);
        for (layer, values) in graph.layers().iter().zip(&outputs) {
            if let Op::MixHead(head) = &layer.op {
                let map = match head.map {
                    Map::Albedo => &mut *maps.albedo,
                    Map::Normal => &mut *maps.normal,
                    Map::Roughness => &mut *maps.roughness,
                };
                finish(head, &classification.used, floats(values)?, self.size, map);
            }
        }
        Ok(classification)
    }
}

/// The network's input in real numbers, `[size][size][6]`.
fn input(photo: &LinearImage<'_>) -> Vec<f32> {
    let size = photo.size;
    let mut values = vec![0.0; size * size * INPUT_CHANNELS];
    let geometry = Geometry::new(size, photo.fov_deg);
    let (gain, known) = photo.light_scale.map_or((1.0, 0.0), |scale| (1.0 / scale, 1.0));
    for (index, pixel) in values.as_chunks_mut::<INPUT_CHANNELS>().0.iter_mut().enumerate() {
        let (x, y) = (index % size, index / size);
        for (value, plane) in pixel.iter_mut().zip(photo.rgb.chunks_exact(size * size)) {
            *value = linear_to_srgb((plane[index] * gain).clamp(0.0, 1.0));
        }
        let point = geometry.point(y, x);
        [pixel[3], pixel[4], pixel[5]] = [coordinate(point.x), coordinate(point.y), known];
    }
    values
}

/// Mixes the classes' outputs, shuffles the pixels into planes, applies the activation.
fn finish(head: &MixHead<'_>, probabilities: &ClassProbabilities, raw: &[f32], size: usize, map: &mut [f32]) {
    let (r, side) = (head.shuffle, size / head.shuffle);
    for (pixel, channels) in raw.chunks_exact(head.classes * head.cout).enumerate() {
        for channel in 0..head.cout {
            let of_class = channels.iter().skip(channel).step_by(head.cout);
            let logit = if head.classes == 1 {
                channels[channel]
            } else {
                of_class.zip(probabilities.0).map(|(&logit, p)| p * logit).sum()
            };
            let (plane, i, j) = (channel / (r * r), channel / r % r, channel % r);
            let (y, x) = (pixel / side * r + i, pixel % side * r + j);
            map[(plane * size + y) * size + x] = logit;
        }
    }
    let [x, y, z] = split3(map, size * size);
    match head.map {
        Map::Albedo => [x, y, z].into_iter().for_each(activation::sigmoid_all),
        Map::Roughness => activation::sigmoid_all(x),
        Map::Normal => activation::normals(x, y, z),
    }
}

fn build(model: &Model<'_>, size: usize) -> TractResult<Arc<TypedRunnableModel>> {
    let graph = &model.graph;
    let mut builder =
        Builder { typed: TypedModel::default(), tensors: vec![None; graph.tensors().len()], size };
    let shape = [1, size, size, INPUT_CHANNELS];
    builder.tensors[INPUT] = Some(builder.typed.add_source("input", f32::fact(shape))?);
    let mut outputs = vec![];
    for layer in graph.layers() {
        let name = layer.name.as_str();
        let outlet = match &layer.op {
            Op::Conv(conv) => {
                let weights = match conv.float {
                    Some((weights, bias)) => (weights.iter().collect(), bias.iter().collect()),
                    None => real_weights(graph, conv),
                };
                let input = builder.join(model, name, &conv.sources)?;
                let (window, shape) = (conv.window.get(), (conv.cin, conv.cout, 1));
                let out = builder.conv(name, input, &window, shape, weights, conv.relu)?;
                if conv.relu6 { builder.scalar(name, math::min(), out, 6.0)? } else { out }
            }
            Op::Depthwise(layer) => {
                let weights = match layer.float {
                    Some((weights, bias)) => (weights.iter().collect(), bias.iter().collect()),
                    None => real_depthwise(graph, layer),
                };
                let (input, channels) = (builder.tensor(layer.source)?, layer.channels);
                let shape = (channels, channels, channels);
                let out = builder.conv(name, input, &layer.window.get(), shape, weights, layer.relu)?;
                if layer.relu6 { builder.scalar(name, math::min(), out, 6.0)? } else { out }
            }
            Op::MeanPool(pool) => {
                let first = builder.mean(name, pool.source, graph.tensors()[pool.source].side(size))?;
                match pool.second {
                    None => first,
                    Some(second) => {
                        let more = builder.mean(name, second, graph.tensors()[second].side(size))?;
                        builder.wire(name, TypedConcat { axis: 3 }, &[first, more])?
                    }
                }
            }
            Op::Dense(dense) => builder.dense(name, dense)?,
            Op::MixHead(head) => {
                let input = builder.join(model, name, &head.sources)?;
                let channels = (head.cin, head.classes * head.cout, 1);
                let weights = (head.weights.iter().collect(), head.bias.iter().collect());
                builder.conv(name, input, &head.window.get(), channels, weights, false)?
            }
        };
        if let Some(tensor) = layer.op.output() {
            builder.tensors[tensor] = Some(outlet);
        }
        outputs.push(outlet);
    }
    builder.typed.select_output_outlets(&outputs)?;
    builder.typed.into_optimized()?.into_runnable()
}

/// What the int8 weights stand for, `[cout][height][width][cin]`, and the bias: for files without float weights.
fn real_weights(graph: &Graph<'_>, conv: &graph::Conv<'_>) -> (Vec<f32>, Vec<f32>) {
    let shape = Shape::new(conv.cout, conv.window.get().height, conv.window.get().width, conv.cin);
    let scales: Vec<f32> = conv
        .sources
        .iter()
        .filter_map(|source| graph.tensors().get(source.tensor()))
        .flat_map(|tensor| core::iter::repeat_n(tensor.scale, tensor.channels))
        .collect();
    let mut plain = vec![0_i8; shape.plain_len()];
    unpack(conv.weights, &shape, &mut plain);
    let per_channel = (shape.height * shape.run).max(1);
    let mut weights = Vec::with_capacity(plain.len());
    for (codes, unit) in plain.chunks_exact(per_channel).zip(conv.weight_scale.iter()) {
        // The sources' scales were folded into the weights: out again.
        weights
            .extend(codes.iter().zip(scales.iter().cycle()).map(|(&q, scale)| f32::from(q) * unit / scale));
    }
    let bias = conv.bias.iter().zip(conv.weight_scale.iter()).map(|(b, unit)| b as f32 * unit).collect();
    (weights, bias)
}

/// The same of a depthwise convolution, `[height][width][channels]`.
fn real_depthwise(graph: &Graph<'_>, layer: &Depthwise<'_>) -> (Vec<f32>, Vec<f32>) {
    let scale = graph.tensors().get(layer.source).map_or(1.0, |tensor| tensor.scale);
    let units: Vec<f32> = layer.weight_scale.iter().collect();
    let weights =
        layer.weights.iter().zip(units.iter().cycle()).map(|(&q, unit)| f32::from(q) * unit / scale);
    let bias = layer.bias.iter().zip(&units).map(|(b, unit)| b as f32 * unit).collect();
    (weights.collect(), bias)
}

struct Builder {
    typed: TypedModel,
    tensors: Vec<Option<OutletId>>,
    size: usize,
}

impl Builder {
    fn wire(
        &mut self,
        name: &str,
        op: impl Into<Box<dyn TypedOp>>,
        inputs: &[OutletId],
    ) -> TractResult<OutletId> {
        let unique = std::format!("{name}.{}", self.typed.nodes().len());
        let outlets = self.typed.wire_node(unique, op, inputs)?;
        outlets.first().copied().context("an op without output")
    }

    fn constant(&mut self, name: &str, values: Vec<f32>, shape: &[usize]) -> TractResult<OutletId> {
        let tensor = Tensor::from_shape(shape, &values)?;
        let unique = std::format!("{name}.{}", self.typed.nodes().len());
        self.typed.add_const(unique, tensor)
    }

    fn tensor(&self, number: usize) -> TractResult<OutletId> {
        self.tensors.get(number).copied().flatten().context("a tensor read before it is written")
    }

    /// The sources side by side, up-sampled as asked.
    fn join(&mut self, model: &Model<'_>, name: &str, sources: &Sources) -> TractResult<OutletId> {
        let mut parts: TVec<OutletId> = tvec!();
        for source in sources.iter() {
            let outlet = self.tensor(source.tensor())?;
            let shape = &model.graph.tensors()[source.tensor()];
            let part = if source.upsample {
                self.upsample(name, outlet, shape.side(self.size), shape.channels)?
            } else {
                outlet
            };
            parts.push(part);
        }
        if parts.len() == 1 { Ok(parts[0]) } else { self.wire(name, TypedConcat::new(3), &parts) }
    }

    /// Every pixel twice in both directions: new axes of one, broadcast to two, merged.
    fn upsample(
        &mut self,
        name: &str,
        outlet: OutletId,
        side: usize,
        channels: usize,
    ) -> TractResult<OutletId> {
        let (d, two, double) = (side.to_dim(), 2.to_dim(), (2 * side).to_dim());
        let rows = self.wire(name, AxisOp::Add(2), &[outlet])?;
        let both = self.wire(name, AxisOp::Add(4), &[rows])?;
        let shape = ShapeFact::from_dims([1, side, 2, side, 2, channels].iter().map(ToDim::to_dim));
        let doubled = self.wire(name, MultiBroadcastTo { shape }, &[both])?;
        let columns = AxisOp::Reshape(3, tvec!(d.clone(), two.clone()), tvec!(double.clone()));
        let merged = self.wire(name, columns, &[doubled])?;
        self.wire(name, AxisOp::Reshape(1, tvec!(d, two), tvec!(double)), &[merged])
    }

    fn conv(
        &mut self,
        name: &str,
        input: OutletId,
        window: &Window,
        (cin, cout, groups): (usize, usize, usize),
        (weights, bias): (Vec<f32>, Vec<f32>),
        relu: bool,
    ) -> TractResult<OutletId> {
        let [top, left, bottom, right] = window.pad;
        let pool_spec = PoolSpec {
            data_format: DataFormat::NHWC,
            kernel_shape: tvec!(window.height, window.width),
            padding: PaddingSpec::Explicit(tvec!(top, left), tvec!(bottom, right)),
            dilations: None,
            strides: Some(tvec!(window.stride, window.stride)),
            input_channels: cin,
            output_channels: cout,
        };
        // With groups, the outputs of one: [1][height][width][channels] of a depthwise convolution.
        let weights = self.constant(name, weights, &[cout / groups, window.height, window.width, cin])?;
        let bias = self.constant(name, bias, &[cout])?;
        let op = Conv { pool_spec, kernel_fmt: KernelFormat::OHWI, group: groups, q_params: None };
        let sum = self.wire(name, op, &[input, weights, bias])?;
        if relu { self.scalar(name, math::max(), sum, 0.0) } else { Ok(sum) }
    }

    /// `op` of every value and one number.
    fn scalar(
        &mut self,
        name: &str,
        op: impl Into<Box<dyn TypedOp>>,
        input: OutletId,
        number: f32,
    ) -> TractResult<OutletId> {
        let number = self.constant(name, vec![number], &[1, 1, 1, 1])?;
        self.wire(name, op, &[input, number])
    }

    fn mean(&mut self, name: &str, source: usize, side: usize) -> TractResult<OutletId> {
        let input = self.tensor(source)?;
        let sum = self.wire(name, Reduce { axes: tvec!(1, 2), reducer: Reducer::Sum }, &[input])?;
        self.scalar(name, math::mul(), sum, 1.0 / (side * side) as f32)
    }

    /// A fully connected layer as a 1x1 convolution of one pixel.
    fn dense(&mut self, name: &str, dense: &Dense<'_>) -> TractResult<OutletId> {
        let window = Window { height: 1, width: 1, stride: 1, pad: [0; 4] };
        let mut input = self.tensor(dense.source)?;
        if let Some(second) = dense.second {
            input = self.wire(name, TypedConcat { axis: 3 }, &[input, self.tensor(second)?])?;
        }
        let channels = (dense.weights.len() / dense.bias.len().max(1), dense.bias.len(), 1);
        let parameters = (dense.weights.iter().collect(), dense.bias.iter().collect());
        self.conv(name, input, &window, channels, parameters, dense.relu)
    }
}
