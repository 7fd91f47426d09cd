//! Operators against textbook loops, on every level that this machine has.
use super::band::Input;
use super::classes::{ClassProbabilities, Map};
use super::format::{F32s, I32s};
use super::graph::{Conv, Depthwise, MixHead, PackedWindow, Source, Sources, Window};
use super::testing::{correlate, correlate_depthwise};
use super::{op_conv, op_depthwise, op_mix};
use crate::base::arena::Arena;
use crate::base::exec::{Executor, Inline};
use crate::base::simd::Level;
use crate::base::testing::Random;
use crate::kernels::quant::Range;
use crate::kernels::testing::requantise;
use crate::kernels::{Kernels, pack};
use std::vec;
use std::vec::Vec;

/// The levels to test; prints which. Fails when the level that `FLASHMAT_REQUIRE_LEVEL` names is not among them.
fn levels() -> Vec<&'static Kernels> {
    let here: Vec<_> = Kernels::supported().collect();
    if let Ok(required) = std::env::var("FLASHMAT_REQUIRE_LEVEL") {
        assert!(here.iter().any(|k| k.level().name() == required), "{required} does not run here");
    }
    for level in Level::ALL {
        let runs = here.iter().any(|kernels| kernels.level() == level);
        std::println!("{}: {}", level.name(), if runs { "runs" } else { "NOT RUN: this CPU lacks it" });
    }
    here
}

fn bytes_of(values: impl Iterator<Item = [u8; 4]>) -> Vec<u8> {
    values.flatten().collect()
}

const SOURCE: Source = Source::new(0, false);

/// Random sources for `side x side` outputs at this stride.
struct Sides {
    data: Vec<Vec<i8>>,
    sides: Vec<usize>,
    channels: Vec<usize>,
    upsample: Vec<bool>,
    zero_points: Vec<i8>,
}

impl Sides {
    fn random(random: &mut Random, read: usize, channels: Vec<usize>) -> Self {
        let upsample: Vec<bool> =
            channels.iter().map(|_| read.is_multiple_of(2) && random.range(0, 1) == 1).collect();
        let sides: Vec<usize> = upsample.iter().map(|&up| if up { read / 2 } else { read }).collect();
        let data = sides.iter().zip(&channels).map(|(s, c)| random.codes(s * s * c)).collect();
        let zero_points =
            channels.iter().map(|_| if random.range(0, 1) == 0 { -128 } else { random.next() as i8 });
        let zero_points = zero_points.collect();
        Self { data, sides, channels, upsample, zero_points }
    }

    fn inputs(&self) -> Vec<Input<'_>> {
        let one = |i: usize| Input {
            data: &self.data[i],
            side: self.sides[i],
            channels: self.channels[i],
            upsample: self.upsample[i],
            zero_point: self.zero_points[i],
        };
        (0..self.data.len()).map(one).collect()
    }
}

fn random_window(random: &mut Random, max_stride: usize) -> Window {
    let kernel = (random.range(1, 5), random.range(1, 5));
    window_of(random, kernel, max_stride)
}

/// A window of this height and width, its stride and padding random.
fn window_of(random: &mut Random, (height, width): (usize, usize), max_stride: usize) -> Window {
    let stride = random.range(1, max_stride);
    let mut pads = |kernel: usize| {
        let total = random.range(kernel.saturating_sub(stride), kernel - 1);
        let before = random.range(0, total);
        (before, total - before)
    };
    let ((top, bottom), (left, right)) = (pads(height), pads(width));
    Window { height, width, stride, pad: [top, left, bottom, right] }
}

#[test]
fn convolutions_equal_the_textbook_on_every_level() {
    let levels = levels();
    for seed in 0..150_u64 {
        let mut random = Random(seed);
        let window = random_window(&mut random, 2);
        let side = random.range(1, 19);
        let channels: Vec<usize> = (0..random.range(1, 2)).map(|_| random.range(1, 40)).collect();
        let cout = random.range(1, 70);
        let sources = Sides::random(&mut random, side * window.stride, channels);
        let inputs = sources.inputs();
        let cin: usize = sources.channels.iter().sum();
        let shape = pack::Shape::new(cout, window.height, window.width, cin);
        let plain = random.weights(shape.plain_len());
        let mut packed = vec![0; shape.packed_len()];
        pack::pack(&plain, &shape, &mut packed);
        let mut sums = vec![0; inputs.len() * cout];
        pack::sums(&packed, &shape, sources.channels[0], &mut sums);
        let bias: Vec<i32> = (0..cout).map(|_| (random.float() * 5e4) as i32).collect();
        let scales: Vec<f32> = (0..cout).map(|_| 1e-3 * (1.1 + random.float())).collect();
        let range = Range::new(random.next() as i8, random.range(0, 1) == 1);
        let bytes = [
            bytes_of(bias.iter().map(|b| b.to_le_bytes())),
            bytes_of(scales.iter().map(|s| s.to_le_bytes())),
            bytes_of(sums.iter().map(|s| s.to_le_bytes())),
        ];
        let conv = Conv {
            sources: Sources { first: SOURCE, second: None },
            output: 1,
            window: PackedWindow::new(window),
            cin,
            cout,
            relu: false,
            relu6: false,
            weights: &packed,
            bias: I32s::new(&bytes[0], 0, cout).expect("in range"),
            weight_scale: F32s::new(&bytes[1], 0, cout).expect("in range"),
            sums: I32s::new(&bytes[2], 0, sums.len()).expect("in range"),
            float: None,
        };
        let scale = 0.37;
        let exact = correlate(&inputs, &window, &plain, cout, side);
        let channel = |index: usize| index % cout;
        let code = |(i, &acc): (usize, &i64)| {
            requantise(acc + i64::from(bias[channel(i)]), scales[channel(i)] / scale, range)
        };
        let expected: Vec<i8> = exact.iter().enumerate().map(code).collect();
        for kernels in &levels {
            let mut bytes = vec![0xA5; op_conv::scratch_bytes(&conv, side, kernels)];
            let mut out = vec![0; expected.len()];
            let how = (*kernels, &Inline as _);
            op_conv::run(
                &conv,
                inputs.iter().copied(),
                (scale, range),
                how,
                Arena::new(&mut bytes),
                side,
                &mut out,
            )
            .expect("enough scratch");
            assert_eq!(
                out,
                expected,
                "seed {seed} {} {window:?} side {side} cin {cin} cout {cout}",
                kernels.name()
            );
        }
    }
}

/// A random depthwise convolution, what it reads, and its codes by the textbook.
struct DepthwiseCase {
    layer: (Window, usize, Vec<i8>),
    bytes: [Vec<u8>; 2],
    source: Vec<i8>,
    zero_point: i8,
    side: usize,
    quant: (f32, Range),
    expected: Vec<i8>,
}

impl DepthwiseCase {
    fn random(random: &mut Random) -> Self {
        let any = (random.range(1, 8), random.range(1, 8));
        let kernel = [(3, 3), (5, 5), any][random.range(0, 2)];
        let window = window_of(random, kernel, 2);
        let (side, channels) = (random.range(1, 36), random.range(1, 70));
        Self::of_shape(random, window, side, channels)
    }

    fn of_shape(random: &mut Random, window: Window, side: usize, channels: usize) -> Self {
        let read = side * window.stride;
        let source = random.codes(read * read * channels);
        let zero_point = if random.range(0, 1) == 0 { -128 } else { random.next() as i8 };
        let weights = random.weights(window.height * window.width * channels);
        let bias: Vec<i32> = (0..channels).map(|_| (random.float() * 5e4) as i32).collect();
        let scales: Vec<f32> = (0..channels).map(|_| 3e-3 * (1.1 + random.float())).collect();
        let quant = (0.37, Range::new(random.next() as i8, random.range(0, 1) == 1));
        let input = Input { data: &source, side: read, channels, upsample: false, zero_point };
        let exact = correlate_depthwise(&input, &window, &weights, side);
        let units = bias.iter().zip(&scales).cycle();
        let code = |(&acc, (&bias, scale)): (&i64, (&i32, &f32))| {
            requantise(acc + i64::from(bias), scale / quant.0, quant.1)
        };
        let expected = exact.iter().zip(units).map(code).collect();
        let bytes = [
            bytes_of(bias.iter().map(|b| b.to_le_bytes())),
            bytes_of(scales.iter().map(|s| s.to_le_bytes())),
        ];
        Self { layer: (window, channels, weights), bytes, source, zero_point, side, quant, expected }
    }

    fn run(&self, kernels: &Kernels, exec: &dyn Executor) -> Vec<i8> {
        let (mut scratch, mut out) = (Vec::new(), vec![0; self.expected.len()]);
        self.run_in(kernels, exec, &mut scratch, &mut out);
        out
    }

    fn run_in(&self, kernels: &Kernels, exec: &dyn Executor, scratch: &mut Vec<u8>, out: &mut [i8]) {
        let &(window, channels, ref weights) = &self.layer;
        let layer = Depthwise {
            source: 0,
            output: 1,
            window: PackedWindow::new(window),
            channels,
            relu: false,
            relu6: false,
            weights,
            bias: I32s::new(&self.bytes[0], 0, channels).expect("in range"),
            weight_scale: F32s::new(&self.bytes[1], 0, channels).expect("in range"),
            float: None,
        };
        let (read, zero_point) = (self.side * window.stride, self.zero_point);
        let input = Input { data: &self.source, side: read, channels, upsample: false, zero_point };
        scratch.resize(op_depthwise::scratch_bytes(&layer, self.side), 0xA5);
        let (arena, how) = (Arena::new(scratch), (kernels, exec));
        op_depthwise::run(&layer, input, self.quant, how, arena, self.side, out).expect("enough scratch");
    }
}

fn depthwise_equals_the_textbook(seeds: core::ops::Range<u64>, exec: &dyn Executor) {
    let levels = levels();
    for seed in seeds {
        let case = DepthwiseCase::random(&mut Random(seed));
        let ((window, channels, _), side) = (&case.layer, case.side);
        for kernels in &levels {
            let same = case.run(kernels, exec) == case.expected;
            assert!(same, "seed {seed} {} {window:?} side {side} channels {channels}", kernels.name());
        }
    }
}

#[test]
fn depthwise_convolutions_equal_the_textbook_on_every_level() {
    depthwise_equals_the_textbook(2000..2150, &Inline);
}

#[cfg(feature = "parallel")]
#[test]
fn depthwise_convolutions_on_threads_equal_the_textbook() {
    depthwise_equals_the_textbook(2150..2200, &crate::base::exec::Pool::new(3).expect("threads"));
}

/// Fastest of many runs, one thread: `cargo test -p flashmat-core --release depthwise_speed -- --ignored --nocapture`.
#[test]
#[ignore = "a measurement"]
fn depthwise_speed() {
    for (side, channels, kernel, stride) in
        [(64, 144, 3, 1), (16, 672, 5, 1), (32, 240, 5, 2), (32, 240, 3, 2), (32, 40, 7, 1)]
    {
        let pad = [kernel / 2, kernel / 2, kernel - kernel / 2 - 1, kernel - kernel / 2 - 1];
        let window = Window { height: kernel, width: kernel, stride, pad };
        let case = DepthwiseCase::of_shape(&mut Random(3), window, side, channels);
        for kernels in Kernels::supported() {
            let mut best = f64::INFINITY;
            let (mut scratch, mut out) = (Vec::new(), vec![0; case.expected.len()]);
            for _ in 0..200 {
                let start = std::time::Instant::now();
                case.run_in(kernels, &Inline, &mut scratch, core::hint::black_box(&mut out));
                best = best.min(start.elapsed().as_secs_f64());
            }
            let macs = (side * side * channels * kernel * kernel) as f64;
            let name = kernels.level().name();
            std::println!("{side}² x {channels}, {kernel}/{stride}, {name}: {:.1} GMAC/s", macs / best / 1e9);
        }
    }
}

/// A random head and its bytes.
struct Head {
    weights: Vec<f32>,
    bias: Vec<f32>,
    weight_bytes: Vec<u8>,
    bias_bytes: Vec<u8>,
    shuffle: usize,
    map: Map,
    cin: usize,
}

impl Head {
    fn random(random: &mut Random, cin: usize) -> Self {
        let (shuffle, map) =
            (random.range(1, 3), [Map::Albedo, Map::Normal, Map::Roughness][random.range(0, 2)]);
        let cout = map.channels() * shuffle * shuffle;
        let weights: Vec<f32> = (0..8 * cout * 9 * cin).map(|_| random.float() * 0.2).collect();
        let bias: Vec<f32> = (0..8 * cout).map(|_| random.float()).collect();
        let weight_bytes = bytes_of(weights.iter().map(|w| w.to_le_bytes()));
        let bias_bytes = bytes_of(bias.iter().map(|b| b.to_le_bytes()));
        Self { weights, bias, weight_bytes, bias_bytes, shuffle, map, cin }
    }

    fn cout(&self) -> usize {
        self.map.channels() * self.shuffle * self.shuffle
    }

    fn layer(&self) -> MixHead<'_> {
        let cout = self.cout();
        MixHead {
            sources: Sources { first: SOURCE, second: None },
            map: self.map,
            window: PackedWindow::new(Window { height: 3, width: 3, stride: 1, pad: [1; 4] }),
            cin: self.cin,
            cout,
            shuffle: self.shuffle,
            classes: 8,
            weights: F32s::new(&self.weight_bytes, 0, self.weights.len()).expect("in range"),
            bias: F32s::new(&self.bias_bytes, 0, self.bias.len()).expect("in range"),
        }
    }
}

fn random_probabilities(random: &mut Random) -> ClassProbabilities {
    let logits = core::array::from_fn(|_| 3.0 * random.float());
    ClassProbabilities::softmax(&logits)
}

/// Logit (channel, pixel) of one class's weights over real inputs, in double precision.
fn class_logit(head: &Head, real: &[Vec<f64>], class: usize, channel: usize) -> Vec<f64> {
    let per_class = head.cout() * 9 * head.cin;
    let weights = &head.weights[class * per_class + channel * 9 * head.cin..][..9 * head.cin];
    let bias = f64::from(head.bias[class * head.cout() + channel]);
    real.iter()
        .map(|patch| bias + patch.iter().zip(weights).map(|(x, &w)| x * f64::from(w)).sum::<f64>())
        .collect()
}

/// Every pixel's 3 x 3 patch of real values, `[kernel row][kernel column][channel]`.
fn patches(inputs: &[Input<'_>], scales: &[f32], side: usize) -> Vec<Vec<f64>> {
    let window = Window { height: 3, width: 3, stride: 1, pad: [1; 4] };
    let cin: usize = inputs.iter().map(|i| i.channels).sum();
    // One-hot weights read one value each: the textbook loop gathers the patches.
    let mut out = vec![vec![0.0; 9 * cin]; side * side];
    for position in 0..9 * cin {
        let mut one_hot = vec![0; 9 * cin];
        one_hot[position] = 1;
        let scale = if position % cin < inputs[0].channels { scales[0] } else { scales[1] };
        for (patch, value) in out.iter_mut().zip(correlate(inputs, &window, &one_hot, 1, side)) {
            patch[position] = value as f64 * f64::from(scale);
        }
    }
    out
}

#[test]
fn mixing_the_weights_is_mixing_the_outputs() {
    let levels = levels();
    for seed in 1000..1012_u64 {
        let mut random = Random(seed);
        let channels = vec![random.range(1, 9), random.range(1, 9)];
        let side = 2 * random.range(1, 4);
        let sources = Sides::random(&mut random, side, channels);
        let (inputs, scales) = (sources.inputs(), [0.01, 0.017]);
        let head = Head::random(&mut random, sources.channels.iter().sum());
        let (layer, cout, r) = (head.layer(), head.cout(), head.shuffle);
        let probabilities = random_probabilities(&mut random);
        let real = patches(&inputs, &scales, side);

        let mut weights = vec![0.0; cout * 9 * head.cin];
        let mut bias = vec![0.0; cout];
        op_mix::mix(layer.weights, 8, &probabilities, &mut weights);
        op_mix::mix(layer.bias, 8, &probabilities, &mut bias);
        let mut expected = vec![vec![0.0; side * side]; cout];
        for (channel, expected) in expected.iter_mut().enumerate() {
            for (class, &p) in probabilities.0.iter().enumerate() {
                let logits = class_logit(&head, &real, class, channel);
                expected.iter_mut().zip(logits).for_each(|(sum, logit)| *sum += f64::from(p) * logit);
            }
            let folded = &weights[channel * 9 * head.cin..][..9 * head.cin];
            for (patch, expected) in real.iter().zip(expected.iter()) {
                let logit: f64 = patch.iter().zip(folded).map(|(x, &w)| x * f64::from(w)).sum();
                assert!((logit + f64::from(bias[channel]) - *expected).abs() < 1e-5, "seed {seed}");
            }
        }

        let n = side * r;
        let mut first: Option<Vec<f32>> = None;
        for kernels in &levels {
            let mut bytes = vec![0x5A; op_mix::scratch_bytes(&layer, side, kernels)];
            let mut out = vec![0.0; 3 * n * n];
            let planes = super::split3(&mut out, n * n);
            let pairs = inputs.iter().copied().zip(scales);
            op_mix::run(
                &layer,
                &probabilities,
                pairs,
                (*kernels, &Inline),
                Arena::new(&mut bytes),
                side,
                planes,
            )
            .expect("enough scratch");
            for (channel, expected) in expected.iter().enumerate().filter(|_| head.map != Map::Normal) {
                let (plane, i, j) = (channel / (r * r), channel / r % r, channel % r);
                // Half a step of every weight, and the sigmoid's slope of at most 1/4.
                let folded = &weights[channel * 9 * head.cin..][..9 * head.cin];
                let scaled =
                    |(k, w): (usize, &f32)| w.abs() * scales[usize::from(k % head.cin >= inputs[0].channels)];
                let step = folded.iter().enumerate().map(scaled).fold(0.0, f32::max) / 127.0;
                for (pixel, (patch, expected)) in real.iter().zip(expected).enumerate() {
                    let at = plane * n * n + (pixel / side * r + i) * n + pixel % side * r + j;
                    let codes: f64 = patch
                        .iter()
                        .enumerate()
                        .map(|(k, x)| {
                            (x / f64::from(scales[usize::from(k % head.cin >= inputs[0].channels)])).abs()
                        })
                        .sum();
                    let bound = 0.25 * 0.5 * f64::from(step) * codes + 1e-5;
                    let want = 1.0 / (1.0 + libm::exp(-expected));
                    assert!((f64::from(out[at]) - want).abs() <= bound, "seed {seed} {}", kernels.name());
                }
            }
            let bits = first.get_or_insert_with(|| out.clone());
            assert_eq!(&out, bits, "seed {seed}: {} differs", kernels.name());
        }
    }
}
