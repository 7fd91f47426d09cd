//! Flashmat's C ABI. The documentation for callers is `include/flashmat.h` and `docs/abi.md`; this is for its makers.
//!
//! An export checks its arguments, calls `flashmat-core`, writes its results: it contains no algorithm. The rules:
//!
//! - Every export that can fail runs in [`guard::guard`]: no panic crosses into C, each error becomes a number of
//!   [`flashmat_status`] and a text.
//! - C passes numbers, never Rust enums: they are looked up, and unknown ones refused.
//! - Results are written only when the call succeeded.
//! - Raw pointers are touched in `ptr.rs` and `handle.rs` alone. Exports are not `unsafe fn`: their callers are C, and
//!   what those must promise is written at each function of the header. A test holds all this (`tests/source.rs`).
//!
//! Without feature `std` there are no engines, no last-error text and no guard; the linker gets a panic handler that
//! calls `flashmat_on_panic`, which the program must define.
#![no_std]
#![deny(unsafe_code)]
#![expect(non_camel_case_types, reason = "types are named as in C")]
#![expect(clippy::result_large_err, reason = "texts of failures, without a heap; failures are rare")]

#[cfg(feature = "std")]
extern crate std;

#[cfg(not(feature = "std"))]
mod bare;
#[cfg(feature = "std")]
mod engine;
#[cfg(feature = "std")]
mod export;
mod failure;
mod guard;
#[cfg(feature = "std")]
mod handle;
mod input;
mod model;
mod names;
mod output;
mod ptr;
mod status;
mod types;
mod version;
mod workspace;

#[cfg(feature = "std")]
pub use engine::*;
#[cfg(feature = "std")]
pub use export::*;
#[cfg(feature = "std")]
pub use guard::flashmat_last_error;
#[cfg(feature = "std")]
pub use handle::flashmat_engine;
pub use names::*;
pub use status::flashmat_status;
pub use types::*;
pub use version::*;
pub use workspace::*;
