//! Flashmat's core: one flash photo of a flat material in, material maps out.
//!
//! The way of the data, and the modules in that order:
//!
//! ```text
//! Frame --frame--> LinearImage --net--> class probabilities + maps, one set per class --> first maps
//!   --search/flash--> flash --highlight--> albedo --crf/albedo--> albedo --highlight/texture--> albedo
//!   --crf/normal--> normal --search--> roughness that the photo tells --crf/roughness--> roughness
//!   --highlight/roughness--> roughness --brdf--> re-render, lights, residual
//! ```
//!
//! The order is [`Stage::ALL`]; [`capture::run`] has a line for each.
//!
//! Guarantees: no allocation and no panic in a run, the same bits on every CPU level and thread count, with and
//! without `std`. Colour is linear RGB with sRGB primaries, white = 1; planes are stored one after the other
//! (planar, row-major, top row first).
#![no_std]
#![deny(unsafe_code)]

#[cfg(any(feature = "alloc", test))]
extern crate alloc;
#[cfg(any(feature = "std", test))]
extern crate std;

pub mod base;
pub mod brdf;
pub mod capture;
pub mod crf;
pub mod frame;
pub mod highlight;
pub mod kernels;
pub mod maps;
pub mod net;
pub mod search;
#[cfg(feature = "alloc")]
mod session;
mod stage;

pub use base::{Error, ModelError};

#[cfg(feature = "alloc")]
pub use session::{Session, SessionOptions};
pub use stage::{Observer, Silent, Stage};
