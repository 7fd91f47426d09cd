//! Flashmat's core: one flash photo of a flat material in, material maps out.
//!
//! The way of the data, and the modules in that order:
//!
//! ```text
//! Frame --frame--> LinearImage --net--> class probabilities + maps, one set per class --blend--> first maps
//!   --crf/albedo--> albedo --crf/normal--> normal --search--> rough~ --crf/roughness--> roughness --maps--> MaterialMaps
//!                               brdf (renders; used by search and by the re-render check)
//! ```
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
pub mod crf;
pub mod frame;
pub mod highlight;
pub mod kernels;
pub mod maps;
pub mod net;
mod observer;
pub mod pipeline;
pub mod search;
#[cfg(feature = "alloc")]
mod session;

pub use base::{Error, ModelError};
pub use observer::{Observer, Silent, Stage};
#[cfg(feature = "alloc")]
pub use session::{Session, SessionOptions};
