//! Host harness of Flashmat: what several test programs share.
pub mod counting;
pub mod golden;
pub mod models;
pub mod runs;
#[cfg(feature = "tract")]
pub mod snr;
