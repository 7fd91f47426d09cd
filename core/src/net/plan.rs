//! Where the tensors lie: image tensors share one block of bytes by their lifetimes, vectors get one of floats.
use super::graph::{Graph, INPUT, MAX_LAYERS, MAX_TENSORS, Op};
use super::{op_conv, op_depthwise, op_mix};
use crate::Error;
use crate::base::arena::{ALIGN, bytes_for};
use crate::base::planes::MAX_SIZE;
use crate::kernels::Kernels;

/// A tensor's place: first element and number of elements (bytes of an image, floats of a vector).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) start: usize,
    pub(super) len: usize,
}

impl Place {
    fn end(self) -> usize {
        self.start.saturating_add(self.len)
    }
}

/// Places of all tensors and the memory of a run at one size.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    pub(super) size: usize,
    pub(super) places: heapless::Vec<Place, MAX_TENSORS>,
    /// Bytes that all image tensors together need.
    pub(super) image_bytes: usize,
    /// Values of all vectors.
    pub(super) floats: usize,
    scratch: usize,
    /// A bit for each layer that a head needs; the others are the classifier's alone.
    map_layers: u128,
}

impl Plan {
    /// Places the tensors of `graph` for an input of `size`: first fit, in the order of execution.
    pub(super) fn new(graph: &Graph<'_>, size: usize, kernels: &Kernels) -> Result<Self, Error> {
        let multiple = graph.multiple();
        if size == 0 || size > MAX_SIZE || !size.is_multiple_of(multiple) {
            return Err(Error::NetworkSize { size, multiple });
        }
        let mut plan = Self {
            size,
            places: heapless::Vec::new(),
            image_bytes: 0,
            floats: 0,
            scratch: 0,
            map_layers: map_layers(graph),
        };
        let lives = lifetimes(graph);
        for (tensor, life) in graph.tensors().iter().zip(&lives) {
            let side = tensor.side(size);
            let place = if tensor.is_image() {
                let len = side.saturating_mul(side).saturating_mul(tensor.channels);
                let start = plan.first_fit(graph, &lives, life, len);
                plan.image_bytes = plan.image_bytes.max(start.saturating_add(len));
                Place { start, len }
            } else {
                let place = Place { start: plan.floats, len: tensor.channels };
                plan.floats += tensor.channels;
                place
            };
            // As many places as tensors: there is room.
            let _ = plan.places.push(place);
        }
        for layer in graph.layers() {
            let scratch = match &layer.op {
                Op::Conv(conv) => op_conv::scratch_bytes(conv, plan.side(graph, conv.output), kernels),
                Op::Depthwise(layer) => op_depthwise::scratch_bytes(layer, plan.side(graph, layer.output)),
                Op::MixHead(head) => op_mix::scratch_bytes(head, size / head.shuffle, kernels),
                Op::MeanPool(_) | Op::Dense(_) => 0,
            };
            plan.scratch = plan.scratch.max(scratch);
        }
        Ok(plan)
    }

    /// Whether a head needs what the layer of this number writes, or it is a head.
    pub(super) fn makes_maps(&self, layer: usize) -> bool {
        self.map_layers >> layer & 1 == 1
    }

    /// Bytes of workspace that a run needs.
    pub(super) fn bytes(&self) -> usize {
        bytes_for::<i8>(self.image_bytes)
            .saturating_add(bytes_for::<f32>(self.floats))
            .saturating_add(self.scratch)
    }

    fn side(&self, graph: &Graph<'_>, tensor: usize) -> usize {
        graph.tensors().get(tensor).map_or(0, |t| t.side(self.size))
    }

    /// The lowest start at which `len` bytes meet no placed image that lives at the same time.
    fn first_fit(&self, graph: &Graph<'_>, lives: &[Life; MAX_TENSORS], life: &Life, len: usize) -> usize {
        let mut start = 0;
        loop {
            let wanted = Place { start, len };
            let placed = self.places.iter().zip(graph.tensors()).zip(lives);
            let blocking = placed
                .filter(|((place, tensor), other)| {
                    tensor.is_image()
                        && other.first <= life.last
                        && life.first <= other.last
                        && place.start < wanted.end()
                        && wanted.start < place.end()
                })
                .map(|((place, _), _)| place.end())
                .min();
            match blocking {
                Some(end) => start = end.next_multiple_of(ALIGN),
                None => return start,
            }
        }
    }
}

const _: () = assert!(MAX_LAYERS <= 128 && MAX_TENSORS <= 128);

/// See [`Plan::map_layers`]: from the heads backwards.
fn map_layers(graph: &Graph<'_>) -> u128 {
    let (mut layers, mut wanted) = (0, 0_u128);
    for (index, layer) in graph.layers().iter().enumerate().rev() {
        if layer.op.output().is_none_or(|tensor| wanted >> tensor & 1 == 1) {
            layers |= 1 << index;
            wanted |= layer.op.inputs().fold(0, |all, tensor| all | 1 << tensor);
        }
    }
    layers
}

/// The layers between which a tensor must be kept, both included.
#[derive(Clone, Copy, Debug, Default)]
struct Life {
    first: usize,
    last: usize,
}

fn lifetimes(graph: &Graph<'_>) -> [Life; MAX_TENSORS] {
    let mut lives = [Life::default(); MAX_TENSORS];
    for (index, layer) in graph.layers().iter().enumerate() {
        if let Some(life) = layer.op.output().and_then(|tensor| lives.get_mut(tensor)) {
            *life = Life { first: index, last: index };
        }
        for tensor in layer.op.inputs() {
            if let Some(life) = lives.get_mut(tensor) {
                life.last = index;
            }
        }
    }
    lives[INPUT].first = 0;
    lives
}
