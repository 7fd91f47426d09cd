//! Model files made in memory: the product's network shape with random weights, for speed and memory tests.
use flashmat_core::net::format::crc32;

const NONE: u32 = u32::MAX;

/// Widths of a network of the product's shape.
#[derive(Clone, Debug)]
pub struct Widths {
    /// Encoder levels, each of half the side.
    pub encoder: Vec<usize>,
    /// Decoder levels, deepest first, up to half the input's side.
    pub decoder: Vec<usize>,
    /// Channels straight from the photo, which the heads read beside the decoders'.
    pub detail: usize,
}

impl Widths {
    /// The phone preset.
    #[must_use]
    pub fn phone() -> Self {
        Self {
            encoder: vec![32, 48, 64, 128, 192, 256, 256],
            decoder: vec![128, 128, 96, 64, 40, 32],
            detail: 32,
        }
    }
}

#[derive(Default)]
struct Builder {
    tensors: Vec<u8>,
    channels: Vec<usize>,
    divisors: Vec<usize>,
    layers: Vec<u8>,
    weights: Vec<u8>,
    params: Vec<u8>,
    state: u64,
}

fn align(section: &mut Vec<u8>) -> u32 {
    section.resize(section.len().next_multiple_of(64), 0);
    section.len() as u32
}

fn name(text: &str) -> [u8; 32] {
    let mut bytes = [0; 32];
    bytes[..text.len()].copy_from_slice(text.as_bytes());
    bytes
}

impl Builder {
    fn random(&mut self) -> u32 {
        self.state =
            self.state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.state >> 33) as u32
    }

    fn tensor(&mut self, text: &str, channels: usize, divisor: usize, scale: f32, zero_point: i32) -> usize {
        self.tensors.extend((channels as u32).to_le_bytes());
        self.tensors.extend((divisor as u32).to_le_bytes());
        self.tensors.extend(scale.to_le_bytes());
        self.tensors.extend(zero_point.to_le_bytes());
        self.tensors.extend([0; 16]);
        self.tensors.extend(name(text));
        self.channels.push(channels);
        self.divisors.push(divisor);
        self.channels.len() - 1
    }

    fn layer(&mut self, text: &str, fields: &[(usize, u32)]) {
        let mut values = [0_u32; 32];
        values[3] = NONE;
        for &(at, value) in fields {
            values[at] = value;
        }
        self.layers.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        self.layers.extend(name(text));
    }

    fn floats(&mut self, count: usize, size: f32) -> u32 {
        let at = align(&mut self.params);
        for _ in 0..count {
            let value = (self.random() as f32 / (1_u32 << 30) as f32 - 1.0) * size;
            self.params.extend(value.to_le_bytes());
        }
        at
    }

    /// A convolution with random weights; `up` applies to the first source.
    fn conv(
        &mut self,
        text: &str,
        sources: &[usize],
        up: bool,
        cout: usize,
        kernel: usize,
        stride: usize,
    ) -> usize {
        let cin: usize = sources.iter().map(|&s| self.channels[s]).sum();
        let divisor = self.divisors[sources[0]] / if up { 2 } else { 1 } * stride;
        let output = self.tensor(text, cout, divisor, 0.02, -128);
        let (run, panels) = (kernel * cin, cout.div_ceil(16));
        let groups = run.div_ceil(4);
        let weights_at = align(&mut self.weights);
        let mut sums = vec![0_i32; sources.len() * cout];
        let first = self.channels[sources[0]];
        for panel in 0..panels {
            for position in 0..kernel * groups * 64 {
                let channel = panel * 16 + position % 64 / 4;
                let at = position / 64 % groups * 4 + position % 4;
                let inside = channel < cout && at < run;
                let weight = if inside { (self.random() % 255) as i32 - 127 } else { 0 };
                self.weights.push(weight as u8);
                if inside {
                    sums[usize::from(at % cin >= first) * cout + channel] += weight;
                }
            }
        }
        let bias_at = align(&mut self.params);
        self.params.resize(bias_at as usize + 4 * cout, 0);
        let scale_at = align(&mut self.params);
        let scale = 0.02 / (0.6 * 74.0 * 74.0 * (kernel * kernel * cin) as f32).sqrt();
        self.params.extend((0..cout).flat_map(|_| scale.to_le_bytes()));
        let sums_at = align(&mut self.params);
        self.params.extend(sums.iter().flat_map(|s| s.to_le_bytes()));
        let second = sources.get(1).map_or(NONE, |&s| s as u32);
        let pad = ((kernel - stride).div_ceil(2)) as u32;
        let kernel = kernel as u32;
        let mut fields = vec![(0, 1), (1, sources[0] as u32), (2, u32::from(up)), (3, second)];
        fields.extend([(5, output as u32), (6, kernel), (7, kernel), (8, stride as u32), (13, 1)]);
        fields.extend((9..13).map(|side| (side, pad)));
        fields.extend([(17, cout as u32), (18, weights_at), (19, bias_at), (20, scale_at), (21, sums_at)]);
        fields.extend([(22, NONE), (23, NONE)]);
        self.layer(text, &fields);
        output
    }

    /// Means of one image or two.
    fn means(&mut self, text: &str, sources: &[usize]) -> usize {
        let count = sources.iter().map(|&s| self.channels[s]).sum();
        let output = self.tensor(text, count, 0, 1.0, 0);
        let read = [(1, sources[0] as u32), (3, sources.get(1).map_or(NONE, |&s| s as u32))];
        self.layer(text, &[&read[..], &[(0, 2), (5, output as u32), (17, count as u32)]].concat());
        output
    }

    fn dense(&mut self, text: &str, sources: &[usize], count: usize, relu: u32) -> usize {
        let inputs: usize = sources.iter().map(|&s| self.channels[s]).sum();
        let output = self.tensor(text, count, 0, 1.0, 0);
        let (weights, bias) = (self.floats(count * inputs, 0.1), self.floats(count, 0.1));
        let read = [(1, sources[0] as u32), (3, sources.get(1).map_or(NONE, |&s| s as u32))];
        let fields = [(0, 3), (5, output as u32), (13, relu), (17, count as u32), (18, weights), (19, bias)];
        self.layer(text, &[&read[..], &fields].concat());
        output
    }

    fn head(&mut self, text: &str, sources: [usize; 2], map: u32, maps: usize) {
        let (cin, cout) = (sources.iter().map(|&s| self.channels[s]).sum::<usize>(), maps * 4);
        let (weights, bias) = (self.floats(8 * cout * 9 * cin, 0.05), self.floats(8 * cout, 0.3));
        let [first, second] = sources.map(|s| s as u32);
        let fields =
            [(0, 4), (1, first), (3, second), (5, NONE), (6, 3), (7, 3), (8, 1), (14, 2), (15, map), (16, 8)];
        let pads: Vec<_> = (9..13).map(|pad| (pad, 1)).collect();
        let rest = [(17, cout as u32), (18, weights), (19, bias)];
        self.layer(text, &[&fields[..], &pads, &rest].concat());
    }
}

/// A model file with random weights of the product's shape: 4x4 stride-2 encoder, three decoders of 3x3 layers over
/// the up-sampled previous level and the encoder's, heads at half resolution that also read the photo's 2x2 blocks.
#[must_use]
pub fn random_model(widths: &Widths, seed: u64) -> Vec<u8> {
    let mut b = Builder { state: seed, ..Builder::default() };
    let input = b.tensor("input", 6, 1, 1.0 / 255.0, -128);
    let mut levels = vec![input];
    for (i, &width) in widths.encoder.iter().enumerate() {
        let level = b.conv(&format!("enc{i}"), &[levels[i]], false, width, 4, 2);
        levels.push(level);
    }
    let deepest = *levels.last().expect("the input at least");
    let texture = |stage: usize| levels[levels.len().min(stage + 2) - 1];
    let pools = [b.means("pool0", &[deepest, texture(3)]), b.means("pool1", &[texture(4), texture(5)])];
    let hidden = b.dense("hidden", &pools, 128, 1);
    let logits = b.dense("logits", &[hidden], 8, 0);
    let detail = b.conv("detail", &[input], false, widths.detail, 2, 2);
    for (map, (text, maps)) in [("albedo", 3), ("normal", 3), ("roughness", 1)].into_iter().enumerate() {
        let mut last = deepest;
        for (i, &width) in widths.decoder.iter().enumerate() {
            last = b.conv(&format!("{text}{i}"), &[last, levels[levels.len() - 2 - i]], true, width, 3, 1);
        }
        b.head(&format!("{text}-head"), [last, detail], map as u32 + 1, maps);
    }
    let mut graph = Vec::new();
    let counts = [b.channels.len(), b.layers.len() / 160, 0, logits];
    graph.extend(counts.iter().flat_map(|&c| (c as u32).to_le_bytes()));
    graph.extend(&b.tensors);
    graph.extend(&b.layers);
    let crf: Vec<u8> = [0.5_f32; 96].iter().flat_map(|v| v.to_le_bytes()).collect();
    let mut defaults: Vec<u8> = [43.35_f32, 1.0, 1.0, 1.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    defaults.extend(0_u32.to_le_bytes());
    let sections: [(&[u8; 4], &[u8]); 7] = [
        (b"META", b"{\"name\": \"random\"}"),
        (b"GRPH", &graph),
        (b"WGT8", &b.weights),
        (b"PARM", &b.params),
        (b"CRFC", &crf),
        (b"DFLT", &defaults),
        (b"CARD", b"random weights"),
    ];
    container(&sections)
}

/// Header, section table and checksum around sections.
#[must_use]
pub fn container(sections: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
    let (mut table, mut body) = (Vec::new(), Vec::new());
    let start = 64 + 32 * sections.len();
    for (kind, data) in sections {
        let at = (start + body.len()).next_multiple_of(64);
        body.resize(at - start, 0);
        table.extend(*kind);
        table.extend([0; 4]);
        table.extend((at as u64).to_le_bytes());
        table.extend((data.len() as u64).to_le_bytes());
        table.extend([0; 8]);
        body.extend(*data);
    }
    let payload = [table, body].concat();
    let mut file = b"FLASHMAT".to_vec();
    file.extend(2_u32.to_le_bytes());
    file.extend((sections.len() as u32).to_le_bytes());
    file.extend((64 + payload.len() as u64).to_le_bytes());
    file.extend(crc32(&payload).to_le_bytes());
    file.resize(64, 0);
    file.extend(payload);
    file
}

/// Writes the right checksum into a file that was tampered with.
pub fn fix_checksum(file: &mut [u8]) {
    if file.len() >= 64 {
        let crc = crc32(&file[64..]);
        file[24..28].copy_from_slice(&crc.to_le_bytes());
    }
}
