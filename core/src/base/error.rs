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
    /// The photo has no pixels.
    FrameEmpty,
    /// The photo's sides, or its bytes, exceed what can be addressed.
    FrameTooLarge,
    /// Rows or pixels overlap: a stride is smaller than what it steps over. Counted in the plane's values.
    FrameStride {
        /// Smallest stride that would do.
        needed: usize,
        /// The stride given.
        given: usize,
    },
    /// A plane's buffer ends before its last pixel. Counted in the plane's values.
    FrameBuffer {
        /// Fewest values that would do.
        needed: usize,
        /// Values given.
        given: usize,
    },
    /// A float pixel is NaN, infinite or negative.
    FramePixel {
        /// Column, from the left.
        x: usize,
        /// Row, from the top.
        y: usize,
    },
    /// A field of view outside 1 to 170 degrees.
    FieldOfView,
    /// A focal length, 35 mm equivalent, outside 8 to 5000 mm: below are real ones, of phones 4 to 9 mm.
    FocalLength,
    /// A known light scale that is not positive and finite, or beyond 1/1000 to 1000.
    LightScale,
    /// A size in pixels, or a row, that is 0, too large or outside.
    Size {
        /// The size given.
        size: usize,
    },
    /// A plane of pixels is shorter or longer than its size says.
    PlaneLength {
        /// Values that it should have.
        needed: usize,
        /// Values that it has.
        given: usize,
    },
    /// The light or the camera is not above the plane, or not finite.
    LightBelowPlane,
    /// Every pixel is clipped, or the predicted image is black: nothing to compare.
    NoUsablePixels,
    /// The photo is black where it is not clipped.
    PhotoBlack,
    /// The system gave no threads.
    Threads,
    /// The bytes are not a model that this build can run.
    Model(super::ModelError),
    /// The network cannot run at this size, or photo and maps are not of the size that it was planned for.
    NetworkSize {
        /// The size given.
        size: usize,
        /// What it must be a multiple of, or be.
        multiple: usize,
    },
    /// This CPU or this build does not have the instruction set asked for.
    LevelUnsupported {
        /// The one asked for.
        level: crate::base::simd::Level,
    },
    /// The float engine (tract) could not build or run the model's graph.
    Float,
    /// A map or weight that a CRF is to refine is NaN, infinite or out of all measure.
    CrfInput,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::WorkspaceTooSmall { needed, available } => write!(
                f,
                "workspace too small: {needed} bytes needed, {available} given; ask workspace_bytes() before the run"
            ),
            Self::Cancelled => f.write_str("cancelled by the observer"),
            Self::FrameEmpty => f.write_str("the photo has no pixels: width and height must be at least 1"),
            Self::FrameTooLarge => f.write_str("the photo's size exceeds what can be addressed"),
            Self::FrameStride { needed, given } => {
                write!(f, "stride too small: {given} given, at least {needed} needed")
            }
            Self::FrameBuffer { needed, given } => {
                write!(f, "pixel buffer too short: {given} values given, at least {needed} needed")
            }
            Self::FramePixel { x, y } => {
                write!(
                    f,
                    "pixel ({x}, {y}) is NaN, infinite or negative; linear light is finite and at least 0"
                )
            }
            Self::FieldOfView => f.write_str("field of view must be 1 to 170 degrees"),
            Self::FocalLength => f.write_str(
                "focal length must be 8 to 5000 mm, 35 mm equivalent: did you pass FocalLength instead of \
                 FocalLengthIn35mmFilm?",
            ),
            Self::LightScale => f.write_str(
                "the light's known scale must be 0.001 to 1000: the linear value of a flat white surface at the centre",
            ),
            Self::Size { size } => write!(f, "size {size} is not supported here"),
            Self::PlaneLength { needed, given } => {
                write!(f, "plane of {given} values given where {needed} are needed")
            }
            Self::LightBelowPlane => {
                f.write_str("light and camera must be above the plane (z > 0) and finite")
            }
            Self::NoUsablePixels => f.write_str(
                "every pixel is overexposed: nothing to compare; take the photo with less exposure",
            ),
            Self::PhotoBlack => f.write_str("the photo is black; take it with the flash on or more exposure"),
            Self::Threads => f.write_str("the system gave no threads"),
            Self::Model(error) => write!(f, "model: {error}"),
            Self::NetworkSize { size, multiple } => {
                write!(f, "size {size} does not suit the network: it takes multiples of {multiple}")
            }
            Self::LevelUnsupported { level } => {
                write!(f, "level {} is not available on this CPU or in this build", level.name())
            }
            Self::Float => f.write_str("the float engine could not build or run this model's graph"),
            Self::CrfInput => f.write_str("a map to refine holds NaN, infinite or immense values"),
        }
    }
}

impl core::error::Error for Error {}
