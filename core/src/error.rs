//! The one error type of the core: small, `Copy`, no strings; each variant names its cause.
use core::fmt;

/// Why a call of this crate could not give a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Error {
    /// The workspace given is smaller than the run needs; both in bytes.
    WorkspaceTooSmall {
        /// Bytes the step asked for, counted from the workspace's start.
        needed: usize,
        /// Bytes the workspace has.
        available: usize,
    },
    /// The observer asked to stop.
    Cancelled,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::WorkspaceTooSmall { needed, available } => write!(
                f,
                "workspace too small: {needed} bytes needed, {available} given; ask workspace_bytes() before the run"
            ),
            Self::Cancelled => f.write_str("cancelled by the observer"),
        }
    }
}

impl core::error::Error for Error {}
