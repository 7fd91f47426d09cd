//! `flashmat model`: what is in a model file.
use super::capture::map_size;
use super::{complain, say};
use crate::engine::{Loaded, ModelFile};
use crate::failure::Failure;
use flashmat_core::net::format::Defaults;
use flashmat_core::net::graph::{INPUT, Layer, Op, Window};
use std::fmt::Write as _;
use std::path::PathBuf;

/// Which model to show.
#[derive(clap::Args)]
pub(crate) struct ModelArgs {
    /// A model file [default: the embedded model].
    #[arg(value_name = "FILE")]
    file: Option<PathBuf>,
    /// The same as FILE, as the other commands have it.
    #[arg(long, value_name = "FILE", conflicts_with = "file")]
    model: Option<PathBuf>,
    /// Pixels per side that sides and multiply-accumulates are shown for.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = map_size)]
    size: usize,
}

/// Runs the command; `false` when it failed.
pub(crate) fn run(args: &ModelArgs) -> bool {
    match show(args) {
        Ok(text) => {
            say(&text);
            true
        }
        Err(failure) => {
            complain(&failure);
            false
        }
    }
}

fn show(args: &ModelArgs) -> Result<String, Failure> {
    let file = ModelFile::load(args.file.as_deref().or(args.model.as_deref()))?;
    let loaded = file.parse()?;
    Ok(format!(
        "{}\n{}\n{}",
        facts(&loaded, args.size),
        layers(&loaded, args.size),
        loaded.model.card().trim_end()
    ))
}

/// Name, hash and sums.
fn facts(loaded: &Loaded<'_>, size: usize) -> String {
    let model = &loaded.model;
    let sum = |part: fn(&Op<'_>) -> usize| model.graph().layers().iter().map(|l| part(&l.op)).sum::<usize>();
    let int8 = sum(|op| match op {
        Op::Conv(conv) => conv.weights.len(),
        Op::Depthwise(depthwise) => depthwise.weights.len(),
        _ => 0,
    });
    let float = sum(|op| match op {
        Op::MixHead(head) => head.weights.len() + head.bias.len(),
        Op::Dense(dense) => dense.weights.len() + dense.bias.len(),
        _ => 0,
    });
    let defaults = model.defaults();
    let lines = [
        ("model", loaded.name.clone()),
        ("from", loaded.path.display().to_string()),
        ("file", format!("{} bytes", loaded.bytes)),
        ("sha-256", loaded.hash.clone()),
        ("weights", format!("{int8} of 8 bits (packed), {float} of 32 bits in heads and classifier")),
        ("engines", if model.has_float() { "int8, float" } else { "int8" }.to_owned()),
        ("work", format!("{:.3} GMAC at {size} x {size}", model.graph().macs(size) as f64 / 1e9)),
        ("sizes", format!("multiples of {}", model.graph().multiple())),
        ("trained for", format!("field of view {:.2} degrees{}", defaults.fov_deg, sizes_seen(&defaults))),
        ("meta", model.meta().split_whitespace().collect::<Vec<_>>().join(" ")),
    ];
    lines.map(|(label, value)| format!("{label:<12} {value}\n")).concat()
}

/// The sizes of the training photos, where the model says them.
fn sizes_seen(defaults: &Defaults) -> String {
    match (defaults.base_size, defaults.top_size) {
        (0, _) => String::new(),
        (base, 0) => format!(", photos of {base} x {base}"),
        (base, top) => format!(", photos of {base} x {base} and {top} x {top}"),
    }
}

/// One line for each layer.
fn layers(loaded: &Loaded<'_>, size: usize) -> String {
    let graph = loaded.model.graph();
    let tensor = |number: usize| graph.tensors().get(number);
    let shape = |number: usize| {
        tensor(number).map_or_else(String::new, |t| match t.side(size) {
            0 => t.channels.to_string(),
            side => format!("{} x {side}²", t.channels),
        })
    };
    let mut text = format!(
        "{:<20} {:<36} {:<36} {:>13} {:>9} {:>9}\n",
        "layer", "what", "reads", "writes", "weights", "MMAC"
    );
    for layer in graph.layers() {
        let reads: Vec<String> = sources(layer)
            .into_iter()
            .map(|(number, doubled)| {
                let name =
                    if number == INPUT { "input" } else { tensor(number).map_or("", |t| t.name.as_str()) };
                format!("{name}{}", if doubled { " (x2)" } else { "" })
            })
            .collect();
        let (what, weights) = what(&layer.op);
        let writes = match &layer.op {
            Op::MixHead(head) => format!("{} x {size}²", head.map.channels()),
            op => op.output().map_or_else(String::new, shape),
        };
        let macs = graph.layer_macs(layer, size) as f64 / 1e6;
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "{:<20} {what:<36} {:<36} {writes:>13} {weights:>9} {macs:>9.2}",
            layer.name.as_str(),
            reads.join(" + ")
        );
    }
    text
}

/// Tensor numbers that a layer reads, and whether it doubles their pixels.
fn sources(layer: &Layer<'_>) -> Vec<(usize, bool)> {
    match &layer.op {
        Op::Conv(conv) => conv.sources.iter().map(|s| (s.tensor(), s.upsample)).collect(),
        Op::MixHead(head) => head.sources.iter().map(|s| (s.tensor(), s.upsample)).collect(),
        op => op.inputs().map(|number| (number, false)).collect(),
    }
}

/// A layer in a few words, and how many weights it has.
fn what(op: &Op<'_>) -> (String, usize) {
    let kernel = |w: &Window| format!("{}x{}/{}", w.height, w.width, w.stride);
    let relu = |on: bool| if on { ", relu" } else { "" };
    match op {
        Op::Conv(conv) => {
            let weights = conv.cout * conv.cin * conv.window.get().height * conv.window.get().width;
            (format!("conv {}{}", kernel(&conv.window.get()), relu(conv.relu)), weights)
        }
        Op::Depthwise(layer) => {
            (format!("depthwise {}{}", kernel(&layer.window.get()), relu(layer.relu)), layer.weights.len())
        }
        Op::MeanPool(_) => ("mean over space".to_owned(), 0),
        Op::Dense(dense) => (format!("dense{}", relu(dense.relu)), dense.weights.len()),
        Op::MixHead(head) => {
            let text = format!(
                "{} {}, {} sets, shuffle {}",
                head.map.name(),
                kernel(&head.window.get()),
                head.classes,
                head.shuffle
            );
            (text, head.weights.len())
        }
    }
}
