//! The native half of the Android library: `com.flashmat.NativeBridge`, thin over [`flashmat_core::Session`].
//!
//! Pixels come in and maps go out through direct buffers, which are checked before they are read or written. Every
//! export runs inside jni's `with_env`, which catches panics, and resolves through [`Throw`], which turns failures
//! into Java exceptions: one class for each of core's errors. Outputs are written only when a call succeeds.
//! Handles are numbers looked up in a table, not addresses: a stale or invented one is an exception (`engine`).
#![deny(unsafe_code)]

mod buffer;
mod engine;
mod error;
mod exports;
mod frame;
mod output;
mod progress;

use error::{Failure, Throw};

/// The number that `NativeBridge.ABI` must equal: counts changes of the exports' signatures and layouts.
pub const ABI: i32 = 4;
