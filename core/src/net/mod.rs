//! The network: a model file read in place, its layers run in int8 on the caller's workspace.
//!
//! Input: a linear photo. Output: class probabilities and the first maps, already mixed with them (albedo linear,
//! normals unit, roughness). [`Model::from_bytes`] checks every rule of `docs/model-format.md`; after that nothing
//! can fail but memory, size and cancellation. A run allocates nothing; its bits do not depend on level or threads.
mod activation;
mod band;
mod classes;
pub mod format;
pub mod graph;
mod inference;
mod load;
mod load_layers;
mod op_conv;
mod op_dense;
mod op_depthwise;
mod op_input;
mod op_mix;
mod op_pool;
mod plan;
pub mod scales;
#[cfg(test)]
pub(crate) mod testing;
#[cfg(test)]
mod tests;
#[cfg(feature = "tract")]
pub mod tract;

use crate::base::arena::Arena;
use crate::base::exec::{Executor, within};
use crate::base::planes::check_planes;
use crate::frame::LinearImage;
use crate::kernels::{Kernels, quant};
use crate::maps::MapsMut;
use crate::{Error, Observer, Stage};
pub use activation::NORMAL_Z_EPSILON;
use band::Input;
pub use classes::{CLASSES, Class, ClassProbabilities, Classification, Map, Mixing};
use core::ops::Range;
use format::{CRF_COEFFICIENTS, Defaults, Sections};
use graph::{Graph, INPUT, Layer, Op, Source, Sources, Tensor};
pub use inference::Inference;
use plan::{Place, Plan};

/// A model file that keeps the format's rules; borrows its bytes.
#[derive(Clone, Debug)]
pub struct Model<'m> {
    sections: Sections<'m>,
    graph: Graph<'m>,
}

impl<'m> Model<'m> {
    /// Checks a model file; nothing is copied, and the bytes need no alignment.
    ///
    /// # Errors
    /// [`Error::Model`] with the first rule that is broken.
    pub fn from_bytes(bytes: &'m [u8]) -> Result<Self, Error> {
        let sections = Sections::parse(bytes).map_err(Error::Model)?;
        let graph = load::graph(&sections).map_err(Error::Model)?;
        Ok(Self { sections, graph })
    }

    /// Layers and tensors.
    #[must_use]
    pub fn graph(&self) -> &Graph<'m> {
        &self.graph
    }

    /// JSON: name, class names, training summary.
    #[must_use]
    pub fn meta(&self) -> &'m str {
        self.sections.meta
    }

    /// The model card, Markdown.
    #[must_use]
    pub fn card(&self) -> &'m str {
        self.sections.card
    }

    /// How the training renders were lit and seen.
    #[must_use]
    pub fn defaults(&self) -> Defaults {
        self.sections.defaults
    }

    /// The file's CRC-32.
    #[must_use]
    pub fn checksum(&self) -> u32 {
        self.sections.checksum
    }

    /// Whether every convolution has float weights, for the float engine.
    #[must_use]
    pub fn has_float(&self) -> bool {
        self.graph.layers.iter().all(|layer| match &layer.op {
            Op::Conv(conv) => conv.float.is_some(),
            Op::Depthwise(depthwise) => depthwise.float.is_some(),
            Op::MeanPool(_) | Op::Dense(_) | Op::MixHead(_) => true,
        })
    }

    /// A class's CRF coefficients: albedo a0, a1, b1, b2, b3; normal a, b1, b2; roughness a0, a1, b1, b2.
    #[must_use]
    pub fn crf(&self, class: Class) -> [f32; CRF_COEFFICIENTS] {
        let mut coefficients = [0.0; CRF_COEFFICIENTS];
        let values = self.sections.crf.run(class as usize, CRF_COEFFICIENTS);
        coefficients.iter_mut().zip(values.iter()).for_each(|(slot, value)| *slot = value);
        coefficients
    }
}

/// Sees every tensor as soon as it is written, on whichever thread: for tests and reports.
pub trait Tap: Send {
    /// An int8 image, interleaved.
    fn image(&mut self, number: usize, tensor: &Tensor<'_>, codes: &[i8]);
    /// A float vector.
    fn vector(&mut self, number: usize, tensor: &Tensor<'_>, values: &[f32]);
}

/// A [`Tap`] that looks away.
struct NoTap;

impl Tap for NoTap {
    fn image(&mut self, _: usize, _: &Tensor<'_>, _: &[i8]) {}
    fn vector(&mut self, _: usize, _: &Tensor<'_>, _: &[f32]) {}
}

/// A model planned for one size, on the kernels of one level.
#[derive(Clone, Debug)]
pub struct Network<'m> {
    model: Model<'m>,
    plan: Plan,
    kernels: &'static Kernels,
}

impl<'m> Network<'m> {
    /// Plans `model` for inputs of `size x size` pixels.
    ///
    /// # Errors
    /// [`Error::NetworkSize`] unless `size` is a multiple of the graph's [`Graph::multiple`] and not too large.
    pub fn new(model: Model<'m>, size: usize, kernels: &'static Kernels) -> Result<Self, Error> {
        let plan = Plan::new(&model.graph, size, kernels)?;
        Ok(Self { model, plan, kernels })
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Model<'m> {
        &self.model
    }

    /// Pixels per side.
    #[must_use]
    pub fn size(&self) -> usize {
        self.plan.size
    }

    /// Bytes of workspace that a run takes from its arena; they are free again when it ends.
    #[must_use]
    pub fn workspace_bytes(&self) -> usize {
        self.plan.bytes()
    }

    /// Runs the network: `maps` gets the first maps. `mixing` has a say in the class probabilities that
    /// mix the heads.
    ///
    /// # Errors
    /// [`Error::NetworkSize`] or [`Error::PlaneLength`] when photo or maps are of another size than planned,
    /// [`Error::WorkspaceTooSmall`], [`Error::Cancelled`].
    pub fn run(
        &self,
        photo: &LinearImage<'_>,
        mixing: Mixing,
        exec: &dyn Executor,
        arena: &mut Arena<'_>,
        maps: &mut MapsMut<'_>,
        observer: &mut dyn Observer,
    ) -> Result<Classification, Error> {
        self.run_tapped(photo, mixing, exec, arena, maps, observer, &mut NoTap)
    }

    /// [`Network::run`], showing every tensor to `tap`.
    ///
    /// # Errors
    /// As [`Network::run`].
    #[expect(clippy::too_many_arguments, reason = "run's arguments and the tap")]
    pub fn run_tapped(
        &self,
        photo: &LinearImage<'_>,
        mixing: Mixing,
        exec: &dyn Executor,
        arena: &mut Arena<'_>,
        maps: &mut MapsMut<'_>,
        observer: &mut dyn Observer,
        tap: &mut dyn Tap,
    ) -> Result<Classification, Error> {
        self.check(photo, maps)?;
        let mut scope = arena.scope();
        let images = scope.take::<i8>(self.plan.image_bytes)?;
        let vectors = scope.take::<f32>(self.plan.floats)?;
        let mut state = State { network: self, images, vectors, exec, tap };
        let mut classification = mixing.classification(ClassProbabilities::UNIFORM);
        let layers = self.model.graph.layers();
        let mut next = 0;
        while next < layers.len() {
            if observer.progress(Stage::Global, next as f32 / layers.len() as f32).is_break() {
                return Err(Error::Cancelled);
            }
            let batch = self.batch(next);
            within(exec, || {
                if batch.start == 0 {
                    state.fill_input(photo);
                }
                for (index, layer) in layers.iter().enumerate().take(batch.end).skip(batch.start) {
                    if mixing.known.is_some() && !self.plan.makes_maps(index) {
                        continue;
                    }
                    state.step(layer, &classification.used, scope.scope(), maps)?;
                    if layer.op.output() == Some(self.model.graph.logits) {
                        classification = mixing.classification(state.predicted());
                    }
                }
                Ok(())
            })?;
            next = batch.end;
        }
        Ok(classification)
    }

    /// The layers from `first` on that run between two progress calls: the fewest with [`BATCH`] products.
    fn batch(&self, first: usize) -> Range<usize> {
        let (graph, mut macs) = (&self.model.graph, 0);
        let mut layers = graph.layers().iter().enumerate().skip(first);
        let last = layers.find(|(_, layer)| {
            macs += graph.layer_macs(layer, self.plan.size);
            macs >= BATCH
        });
        first..last.map_or(graph.layers().len(), |(index, _)| index + 1)
    }

    fn check(&self, photo: &LinearImage<'_>, maps: &MapsMut<'_>) -> Result<(), Error> {
        let size = self.plan.size;
        for given in [photo.size, maps.size] {
            if given != size {
                return Err(Error::NetworkSize { size: given, multiple: size });
            }
        }
        check_planes(size, 3, photo.rgb.len())?;
        check_planes(size, 3, maps.albedo.len())?;
        check_planes(size, 3, maps.normal.len())?;
        check_planes(size, 1, maps.roughness.len())
    }
}

/// Multiply-accumulates between two progress calls, at least: a fraction of a millisecond on a fast core, some tens on
/// plain loops. More often, and threads would be handed over more often than is worth it.
const BATCH: u64 = 1 << 27;

/// The tensors of a run.
struct State<'r, 'm> {
    network: &'r Network<'m>,
    images: &'r mut [i8],
    vectors: &'r mut [f32],
    exec: &'r dyn Executor,
    tap: &'r mut dyn Tap,
}

/// The values at `place`, and what lies before and after them.
fn carve<T>(all: &mut [T], place: Place) -> (&[T], &mut [T], &[T]) {
    let (before, rest) = all.split_at_mut(place.start.min(all.len()));
    let (wanted, after) = rest.split_at_mut(place.len.min(rest.len()));
    (before, wanted, after)
}

/// The values at `place`, which lies before or after the carved one (at `hole`).
fn find<'a, T>(before: &'a [T], after: &'a [T], hole: Place, place: Place) -> &'a [T] {
    let part = if place.start < hole.start {
        before.get(place.start..)
    } else {
        place.start.checked_sub(hole.start + hole.len).and_then(|start| after.get(start..))
    };
    part.and_then(|part| part.get(..place.len)).unwrap_or(&[])
}

impl<'m> State<'_, 'm> {
    fn place(&self, tensor: usize) -> Place {
        self.network.plan.places.get(tensor).copied().unwrap_or_default()
    }

    fn graph(&self) -> &Graph<'m> {
        &self.network.model.graph
    }

    fn fill_input(&mut self, photo: &LinearImage<'_>) {
        let place = self.place(INPUT);
        let (_, codes, _) = carve(self.images, place);
        op_input::run(photo, self.exec, codes);
        if let Some(tensor) = self.network.model.graph.tensors().first() {
            self.tap.image(INPUT, tensor, codes);
        }
    }

    fn predicted(&self) -> ClassProbabilities {
        let place = self.place(self.graph().logits);
        let logits = self.vectors.get(place.start..).and_then(<[f32]>::first_chunk);
        logits.map_or(ClassProbabilities::UNIFORM, ClassProbabilities::softmax)
    }

    fn step(
        &mut self,
        layer: &Layer<'m>,
        probabilities: &ClassProbabilities,
        scratch: Arena<'_>,
        maps: &mut MapsMut<'_>,
    ) -> Result<(), Error> {
        let (network, output) = (self.network, layer.op.output().unwrap_or(INPUT));
        let graph = &network.model.graph;
        let (Some(tensor), hole) = (graph.tensors().get(output), self.place(output)) else { return Ok(()) };
        let how = (network.kernels, self.exec);
        match &layer.op {
            Op::Conv(conv) => {
                let (before, codes, after) = carve(self.images, hole);
                let inputs = inputs(network, &conv.sources, before, after, hole).map(|(input, _)| input);
                let quant = (tensor.scale, quant::Range::new(tensor.zero_point, conv.relu));
                op_conv::run(conv, inputs, quant, how, scratch, tensor.side(network.plan.size), codes)?;
                self.tap.image(output, tensor, codes);
            }
            Op::Depthwise(layer) => {
                let source = Source::new(layer.source, false);
                let (before, codes, after) = carve(self.images, hole);
                let input =
                    inputs(network, &Sources { first: source, second: None }, before, after, hole).next();
                let quant = (tensor.scale, quant::Range::new(tensor.zero_point, layer.relu));
                if let Some((input, _)) = input {
                    op_depthwise::run(
                        layer,
                        input,
                        quant,
                        how,
                        scratch,
                        tensor.side(network.plan.size),
                        codes,
                    )?;
                }
                self.tap.image(output, tensor, codes);
            }
            Op::MeanPool(pool) => {
                let (_, values, _) = carve(self.vectors, hole);
                let mut rest = &mut *values;
                for source in [Some(pool.source), pool.second].into_iter().flatten() {
                    let Some(tensor) = graph.tensors().get(source) else { continue };
                    let place = self.network.plan.places.get(source).copied().unwrap_or_default();
                    let codes = find(&[], self.images, Place::default(), place);
                    let (means, after) = rest.split_at_mut(tensor.channels.min(rest.len()));
                    op_pool::run(tensor, codes, means);
                    rest = after;
                }
                self.tap.vector(output, tensor, values);
            }
            Op::Dense(dense) => {
                let places =
                    [self.place(dense.source), dense.second.map_or(Place::default(), |s| self.place(s))];
                let (before, values, after) = carve(self.vectors, hole);
                op_dense::run(dense, places.map(|place| find(before, after, hole, place)), values);
                self.tap.vector(output, tensor, values);
            }
            Op::MixHead(head) => {
                let none = Place::default();
                let inputs = inputs(network, &head.sources, &[], self.images, none);
                let size = network.plan.size;
                let planes = match head.map {
                    Map::Albedo => split3(maps.albedo, size * size),
                    Map::Normal => split3(maps.normal, size * size),
                    Map::Roughness => split3(maps.roughness, size * size),
                };
                op_mix::run(head, probabilities, inputs, how, scratch, size / head.shuffle, planes)?;
            }
        }
        Ok(())
    }
}

/// Three planes of `len` values; those past the end are empty.
fn split3(values: &mut [f32], len: usize) -> [&mut [f32]; 3] {
    let (x, rest) = values.split_at_mut(len.min(values.len()));
    let (y, rest) = rest.split_at_mut(len.min(rest.len()));
    let (z, _) = rest.split_at_mut(len.min(rest.len()));
    [x, y, z]
}

/// The sources of a layer with their scales, found beside the output that was carved out.
fn inputs<'a>(
    network: &'a Network<'_>,
    sources: &Sources,
    before: &'a [i8],
    after: &'a [i8],
    hole: Place,
) -> impl Iterator<Item = (Input<'a>, f32)> + Clone {
    let one = move |source: Source| {
        let tensor = network.model.graph.tensors().get(source.tensor())?;
        let place = network.plan.places.get(source.tensor()).copied()?;
        let data = find(before, after, hole, place);
        let Tensor { channels, zero_point, scale, .. } = *tensor;
        let side = tensor.side(network.plan.size);
        Some((Input { data, side, channels, upsample: source.upsample, zero_point }, scale))
    };
    let pair = [one(sources.first), sources.second.and_then(one)];
    pair.into_iter().flatten()
}
