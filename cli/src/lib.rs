//! Flashmat on the desktop: flash photos to relightable materials.
//!
//! A library of one function, the program's `main`, and of doors for the fuzzers of `fuzz/`; nothing else may use it.
mod commands;
mod dataset;
mod engine;
mod exposure;
mod failure;
#[doc(hidden)]
pub mod fuzzing;
mod interrupt;
mod mapset;
mod material;
mod metrics;
mod output;
mod photo;

use clap::{Parser, Subcommand};
use std::process::ExitCode;

/// Flash photos of flat materials to relightable material maps.
#[derive(Parser)]
#[command(name = "flashmat", version, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Material maps from flash photos.
    Capture(commands::capture::CaptureArgs),
    /// Captured maps under another light.
    Render(commands::render::RenderArgs),
    /// Errors over materials whose maps are known.
    Eval(commands::eval::EvalArgs),
    /// The CRFs' coefficients, learned from materials whose maps are known.
    LearnCrf(commands::learn_crf::LearnArgs),
    /// Layers, sizes, work, hash and card of a model.
    Model(commands::model::ModelArgs),
    /// How long the stages take.
    Bench(commands::bench::BenchArgs),
}

/// Runs the program with the arguments of the process.
#[must_use]
pub fn main() -> ExitCode {
    interrupt::listen();
    let done = match Cli::parse().command {
        Command::Capture(args) => commands::capture::run(&args),
        Command::Render(args) => commands::render::run(&args),
        Command::Eval(args) => commands::eval::run(&args),
        Command::LearnCrf(args) => commands::learn_crf::run(&args),
        Command::Model(args) => commands::model::run(&args),
        Command::Bench(args) => commands::bench::run(&args),
    };
    if done { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
