//! The network as a list of layers over numbered tensors. A [`Graph`] exists only if every rule of
//! `docs/model-format.md` holds ([`super::load`] checks them), so the engines follow its numbers without a doubt:
//! tensor numbers are in range, written before read, and shapes fit for every size that is a multiple of
//! [`Graph::multiple`].
use super::Map;
use super::format::{F32s, I32s};

/// Most tensors in a graph. A planned graph lies on the stack while it is made: this and [`MAX_LAYERS`] are most of it.
pub const MAX_TENSORS: usize = 80;
/// Most layers in a graph.
pub const MAX_LAYERS: usize = 80;
/// Most channels of a tensor.
pub const MAX_CHANNELS: usize = 2048;
/// Largest kernel side.
pub const MAX_KERNEL: usize = 8;
/// Most products in one accumulator: 128 * 255 * `MAX_PRODUCTS` + [`MAX_BIAS`] stays below 2^31.
pub const MAX_PRODUCTS: usize = 32768;
/// Largest bias, in units of the accumulator.
pub const MAX_BIAS: i32 = 1 << 30;
/// Largest ratio of the input's side to a tensor's.
pub const MAX_DIVISOR: usize = 128;

/// A name of up to 32 printable ASCII characters, where it lies in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Name<'m>(pub(super) &'m [u8; 32]);

impl Name<'_> {
    /// The name as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        let end = self.0.iter().position(|&b| b == 0).unwrap_or(self.0.len());
        core::str::from_utf8(self.0.get(..end).unwrap_or(&[])).unwrap_or("")
    }
}

/// What a tensor holds: int8 pixels, interleaved channels (NHWC), or a float vector.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tensor<'m> {
    /// Its name.
    pub name: Name<'m>,
    /// Channels, or values of the vector.
    pub channels: usize,
    /// The input's side over this tensor's; 0 for a vector.
    pub divisor: usize,
    /// real = scale * (q - zero_point).
    pub scale: f32,
    /// The code of real zero.
    pub zero_point: i8,
}

impl Tensor<'_> {
    /// Whether it is an image (else a float vector).
    #[must_use]
    pub fn is_image(&self) -> bool {
        self.divisor > 0
    }

    /// Pixels per side for an input of `size`; 0 for a vector.
    #[must_use]
    pub fn side(&self, size: usize) -> usize {
        size.checked_div(self.divisor).unwrap_or(0)
    }
}

/// An image tensor as a layer reads it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Source {
    /// A byte holds it: see [`PackedWindow`].
    tensor: u8,
    /// Read with every pixel doubled in both directions.
    pub upsample: bool,
}

const _: () = assert!(MAX_TENSORS <= 1 << u8::BITS);

impl Source {
    /// The tensor of this number, which is below [`MAX_TENSORS`].
    pub(super) const fn new(tensor: usize, upsample: bool) -> Self {
        Self { tensor: tensor as u8, upsample }
    }

    /// Tensor number.
    #[must_use]
    pub fn tensor(self) -> usize {
        usize::from(self.tensor)
    }
}

/// One or two sources, concatenated by channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sources {
    /// The first channels.
    pub first: Source,
    /// The channels after them.
    pub second: Option<Source>,
}

impl Sources {
    /// The sources in order.
    pub fn iter(&self) -> impl Iterator<Item = Source> + use<> {
        [Some(self.first), self.second].into_iter().flatten()
    }
}

/// A kernel's extent: output side = input side / stride.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Rows of the kernel.
    pub height: usize,
    /// Columns of the kernel.
    pub width: usize,
    /// Step between outputs, 1 or 2.
    pub stride: usize,
    /// Padding above, to the left, below, to the right.
    pub pad: [usize; 4],
}

/// A [`Window`] in seven bytes: a graph's layers lie on the stack, many times while they are moved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PackedWindow {
    height: u8,
    width: u8,
    stride: u8,
    pad: [u8; 4],
}

impl PackedWindow {
    /// No side of `window` is above [`MAX_KERNEL`].
    pub(super) fn new(window: Window) -> Self {
        let Window { height, width, stride, pad } = window;
        Self { height: height as u8, width: width as u8, stride: stride as u8, pad: pad.map(|pad| pad as u8) }
    }

    /// The window.
    #[must_use]
    pub fn get(self) -> Window {
        let Self { height, width, stride, pad } = self;
        let [height, width, stride] = [height, width, stride].map(usize::from);
        Window { height, width, stride, pad: pad.map(usize::from) }
    }
}

/// Convolution with int8 weights and int8 output.
#[derive(Clone, Copy, Debug)]
pub struct Conv<'m> {
    /// What it reads.
    pub sources: Sources,
    /// The tensor that it writes.
    pub output: usize,
    /// Kernel, stride, padding.
    pub window: PackedWindow,
    /// Channels read, all sources together.
    pub cin: usize,
    /// Channels written.
    pub cout: usize,
    /// Negative results become real zero.
    pub relu: bool,
    /// With `relu`: nothing is above 6. The output's codes end there or below, so only the float engine does anything.
    pub relu6: bool,
    /// Packed weights (`kernels::pack`).
    pub weights: &'m [i8],
    /// Per output channel, in units of the accumulator.
    pub bias: I32s<'m>,
    /// Per output channel: real value of one accumulator unit.
    pub weight_scale: F32s<'m>,
    /// [source][cout]: sums of the weights that read each source.
    pub sums: I32s<'m>,
    /// Weights [cout][height][width][cin] and bias [cout] in real units, if the file has them.
    pub float: Option<(F32s<'m>, F32s<'m>)>,
}

/// Convolution of every channel with a kernel of its own; int8 weights and output.
#[derive(Clone, Copy, Debug)]
pub struct Depthwise<'m> {
    /// Image tensor read.
    pub source: usize,
    /// The tensor that it writes.
    pub output: usize,
    /// Kernel, stride, padding.
    pub window: PackedWindow,
    /// Channels read and written.
    pub channels: usize,
    /// Negative results become real zero.
    pub relu: bool,
    /// With `relu`: nothing is above 6. The output's codes end there or below, so only the float engine does anything.
    pub relu6: bool,
    /// [height][width][channels], as they are.
    pub weights: &'m [i8],
    /// Per channel, in units of the accumulator.
    pub bias: I32s<'m>,
    /// Per channel: real value of one accumulator unit.
    pub weight_scale: F32s<'m>,
    /// Weights [height][width][channels] and bias [channels] in real units, if the file has them.
    pub float: Option<(F32s<'m>, F32s<'m>)>,
}

/// Mean over space.
#[derive(Clone, Copy, Debug)]
pub struct MeanPool {
    /// Image tensor read.
    pub source: usize,
    /// Another one, whose means follow those of the first.
    pub second: Option<usize>,
    /// Vector written.
    pub output: usize,
}

/// Fully connected float layer.
#[derive(Clone, Copy, Debug)]
pub struct Dense<'m> {
    /// Vector read.
    pub source: usize,
    /// Another one, whose values follow those of the first.
    pub second: Option<usize>,
    /// Vector written.
    pub output: usize,
    /// Negative results become 0.
    pub relu: bool,
    /// [out][in].
    pub weights: F32s<'m>,
    /// [out].
    pub bias: F32s<'m>,
}

/// Last convolution of one map: weights mixed by the class probabilities, pixel shuffle, activation.
#[derive(Clone, Copy, Debug)]
pub struct MixHead<'m> {
    /// What it reads.
    pub sources: Sources,
    /// The map that it makes.
    pub map: Map,
    /// Kernel and padding; stride 1.
    pub window: PackedWindow,
    /// Channels read, all sources together.
    pub cin: usize,
    /// Channels before the shuffle: the map's channels times shuffle squared.
    pub cout: usize,
    /// Pixels of the map per pixel read, in each direction.
    pub shuffle: usize,
    /// Sets of weights: 8, or 1 when there is nothing to mix.
    pub classes: usize,
    /// [classes][cout][height][width][cin], real units.
    pub weights: F32s<'m>,
    /// [classes][cout].
    pub bias: F32s<'m>,
}

/// What a layer does.
#[derive(Clone, Copy, Debug)]
pub enum Op<'m> {
    /// See [`Conv`].
    Conv(Conv<'m>),
    /// See [`Depthwise`].
    Depthwise(Depthwise<'m>),
    /// See [`MeanPool`].
    MeanPool(MeanPool),
    /// See [`Dense`].
    Dense(Dense<'m>),
    /// See [`MixHead`].
    MixHead(MixHead<'m>),
}

/// A named step of the network.
#[derive(Clone, Copy, Debug)]
pub struct Layer<'m> {
    /// Its name.
    pub name: Name<'m>,
    /// What it does.
    pub op: Op<'m>,
}

impl Op<'_> {
    /// The tensor that it writes; a head writes none.
    #[must_use]
    pub fn output(&self) -> Option<usize> {
        match self {
            Self::Conv(conv) => Some(conv.output),
            Self::Depthwise(depthwise) => Some(depthwise.output),
            Self::MeanPool(pool) => Some(pool.output),
            Self::Dense(dense) => Some(dense.output),
            Self::MixHead(_) => None,
        }
    }

    /// The tensors that it reads.
    pub fn inputs(&self) -> impl Iterator<Item = usize> + use<> {
        let (first, second) = match self {
            Self::Conv(Conv { sources, .. }) | Self::MixHead(MixHead { sources, .. }) => {
                (sources.first.tensor(), sources.second.map(Source::tensor))
            }
            Self::Depthwise(depthwise) => (depthwise.source, None),
            Self::MeanPool(pool) => (pool.source, pool.second),
            Self::Dense(dense) => (dense.source, dense.second),
        };
        [Some(first), second].into_iter().flatten()
    }
}

/// A network whose rules have been checked.
#[derive(Clone, Debug)]
pub struct Graph<'m> {
    pub(super) tensors: heapless::Vec<Tensor<'m>, MAX_TENSORS>,
    pub(super) layers: heapless::Vec<Layer<'m>, MAX_LAYERS>,
    pub(super) logits: usize,
}

/// The input's tensor number.
pub const INPUT: usize = 0;
/// The input's channels: sRGB-encoded R, G, B, then the coordinates (see [`COORDINATE_REACH`]), and 1 where the light's
/// scale is known.
pub const INPUT_CHANNELS: usize = 6;
/// A pixel's coordinates are its point (x, y) of the plane, in units of the camera's distance, as
/// (x / reach + 1) / 2 and (y / reach + 1) / 2 in [0,1]: they tell the network the field of view, and with it how
/// fast the flash falls off. 0.75 is half the side that a field of view of 73.7 degrees shows; beyond, they saturate.
pub const COORDINATE_REACH: f32 = 0.75;
/// The input's scale: one step of an 8-bit photo.
pub const INPUT_SCALE: f32 = 1.0 / 255.0;
/// The input's zero point.
pub const INPUT_ZERO_POINT: i8 = -128;

impl<'m> Graph<'m> {
    /// The tensors by number.
    #[must_use]
    pub fn tensors(&self) -> &[Tensor<'m>] {
        &self.tensors
    }

    /// The layers in order of execution.
    #[must_use]
    pub fn layers(&self) -> &[Layer<'m>] {
        &self.layers
    }

    /// Tensor number of the class logits.
    #[must_use]
    pub fn logits(&self) -> usize {
        self.logits
    }

    /// The input's side must be a multiple of this.
    #[must_use]
    pub fn multiple(&self) -> usize {
        self.tensors.iter().map(|t| t.divisor).max().unwrap_or(1).max(1)
    }

    /// Multiply-accumulates of one run at `size`.
    #[must_use]
    pub fn macs(&self, size: usize) -> u64 {
        self.layers.iter().map(|layer| self.layer_macs(layer, size)).sum()
    }

    /// Bytes that one run at `size` must move at least: every layer's sources and weights once, and what it writes.
    #[must_use]
    pub fn bytes_moved(&self, size: usize) -> u64 {
        let image = |number: usize| {
            self.tensors.get(number).map_or(0, |t| {
                let side = t.side(size);
                if t.is_image() { side * side * t.channels } else { 4 * t.channels }
            })
        };
        let layer = |layer: &Layer<'_>| {
            let read: usize = layer.op.inputs().map(image).sum();
            let (weights, map) = match &layer.op {
                Op::Conv(c) => (c.weights.len(), 0),
                Op::Depthwise(d) => (d.weights.len(), 0),
                Op::Dense(d) => (4 * d.weights.len(), 0),
                Op::MeanPool(_) => (0, 0),
                Op::MixHead(h) => (4 * h.weights.len(), 4 * size * size * h.map.channels()),
            };
            (read + weights + map + layer.op.output().map_or(0, image)) as u64
        };
        self.layers.iter().map(layer).sum()
    }

    /// Multiply-accumulates of one layer at `size`.
    #[must_use]
    pub fn layer_macs(&self, layer: &Layer<'_>, size: usize) -> u64 {
        let spatial = |pixels: usize, window: &Window, cin: usize, cout: usize| {
            pixels as u64 * (window.height * window.width) as u64 * (cin * cout) as u64
        };
        match &layer.op {
            Op::Conv(c) => {
                let side = self.tensors.get(c.output).map_or(0, |t| t.side(size));
                spatial(side * side, &c.window.get(), c.cin, c.cout)
            }
            Op::Depthwise(d) => {
                let side = self.tensors.get(d.output).map_or(0, |t| t.side(size));
                spatial(side * side, &d.window.get(), 1, d.channels)
            }
            Op::MixHead(h) => {
                let side = size / h.shuffle.max(1);
                spatial(side * side, &h.window.get(), h.cin, h.cout)
            }
            Op::Dense(d) => d.weights.len() as u64,
            Op::MeanPool(_) => 0,
        }
    }
}
