//! A captured material as files: the only place of the project that makes the bytes of PNG pictures and glTF.
//!
//! - [`png`]: pictures of 8 or 16 bits a channel, grey or RGB.
//! - [`orm`]: occlusion, roughness and metallic in one picture; what a material's F0 means in glTF.
//! - [`glb`]: the material on a square, as one binary glTF 2.0 file for any viewer.
//!
//! The command line, the C library (Swift on top of it) and the Android library call it, so that one capture gives the
//! same bytes everywhere. Needs `alloc`, not `std`. Maps are those of [`flashmat_core::maps`], with its units; nothing
//! panics, whatever is given.
#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(not(test), warn(clippy::indexing_slicing, clippy::panic, clippy::expect_used))]

extern crate alloc;
#[cfg(test)]
extern crate std;

mod error;
pub mod glb;
pub mod orm;
mod pictures;
pub mod png;

pub use error::Error;
pub use pictures::Pictures;
