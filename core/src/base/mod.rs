//! The ground floor: what every other module stands on. It imports nothing of this crate but itself.
pub mod arena;
mod error;
pub mod exec;
pub(crate) mod lanes;
pub mod math;
mod model_error;
pub mod planes;
pub(crate) mod resample;
pub mod simd;
#[cfg(test)]
pub(crate) mod testing;

pub use error::Error;
pub use model_error::{FORMAT_VERSION, ModelError};
