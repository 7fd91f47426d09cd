//! How close the int8 engine is to the float engine, layer by layer (feature `tract`).
use flashmat_core::Error;
use flashmat_core::base::exec::Inline;
use flashmat_core::base::simd::Level;
use flashmat_core::frame::LinearImage;
use flashmat_core::kernels::Kernels;
use flashmat_core::kernels::quant::dequantise;
use flashmat_core::net::graph::{Op, Tensor};
use flashmat_core::net::tract::FloatNetwork;
use flashmat_core::net::{Model, Network, Tap};

use crate::runs::NetRun;

/// One tensor's signal-to-noise ratio.
#[derive(Clone, Debug)]
pub struct LayerSnr {
    /// The tensor's name.
    pub name: String,
    /// 10 log10(float energy / energy of the difference).
    pub db: f64,
    /// Whether a head reads it: a decoder's output, or the detail.
    pub feeds_head: bool,
}

struct Record(Vec<(usize, Vec<f32>)>);

impl Tap for Record {
    fn image(&mut self, number: usize, tensor: &Tensor<'_>, codes: &[i8]) {
        let real = codes.iter().map(|&q| dequantise(q, tensor.scale, tensor.zero_point));
        self.0.push((number, real.collect()));
    }

    fn vector(&mut self, number: usize, _: &Tensor<'_>, values: &[f32]) {
        self.0.push((number, values.to_vec()));
    }
}

/// Runs both engines on a planar linear photo and compares every tensor that a layer writes.
///
/// # Errors
/// The engines'.
pub fn layer_snr(model: &Model<'_>, size: usize, rgb: &[f32], level: Level) -> Result<Vec<LayerSnr>, Error> {
    let network = Network::new(model.clone(), size, Kernels::for_level(level)?)?;
    let mut record = Record(Vec::new());
    NetRun::new(&network, size, rgb.to_vec()).run(&network, None, &Inline, Some(&mut record))?;
    let clipped = vec![0; size * size];
    let photo = LinearImage::new(size, rgb, &clipped, 43.35);
    let exact = FloatNetwork::new(model.clone(), size)?.tensors(&photo)?;
    let graph = model.graph();
    let feeds_head = |tensor: usize| {
        let reads = |op: &Op<'_>| matches!(op, Op::MixHead(_)) && op.inputs().any(|t| t == tensor);
        graph.layers().iter().any(|layer| reads(&layer.op))
    };
    let mut report = Vec::new();
    for (number, want) in exact {
        let Some((_, got)) = record.0.iter().find(|(n, _)| *n == number) else { continue };
        let energy =
            |values: &mut dyn Iterator<Item = f32>| values.map(|v| f64::from(v) * f64::from(v)).sum::<f64>();
        let noise = energy(&mut got.iter().zip(&want).map(|(a, b)| a - b));
        let db = 10.0 * (energy(&mut want.iter().copied()) / noise.max(1e-30)).log10();
        let name = graph.tensors()[number].name.as_str().to_owned();
        report.push(LayerSnr { name, db, feeds_head: feeds_head(number) });
    }
    Ok(report)
}
