//! Why a file cannot be made.
use core::fmt;

/// Why a file cannot be made of what was given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Error {
    /// The maps are not of the size that they should have.
    Maps(flashmat_core::Error),
    /// F0 is not in [0, 1): no index of refraction has it.
    Reflectance,
    /// The field of view is not above 0 and below 180 degrees.
    FieldOfView,
    /// A picture of no pixels, or a file of more than its format can hold: 2 GiB of a picture, 4 GiB of a GLB.
    Size,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Maps(error) => write!(f, "maps to export: {error}"),
            Self::Reflectance => {
                f.write_str("F0 must be at least 0 and below 1; take it from the capture's report")
            }
            Self::FieldOfView => f.write_str(
                "field of view must be above 0 and below 180 degrees; take it from the capture's report",
            ),
            Self::Size => {
                f.write_str("a picture without pixels, or a file beyond 2 GiB (PNG) or 4 GiB (GLB)")
            }
        }
    }
}

impl core::error::Error for Error {}

impl From<flashmat_core::Error> for Error {
    fn from(error: flashmat_core::Error) -> Self {
        Self::Maps(error)
    }
}
