//! The status numbers, and which error of the core becomes which.
use core::ffi::CStr;
use flashmat_core::Error;

/// What became of a call. Numbers never change their meaning; new ones are added at the end, so treat a number that
/// you do not know as an error.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum flashmat_status {
    /// Done.
    Ok = 0,
    /// A pointer that must be given is NULL.
    NullPointer = 1,
    /// A struct_size is none that this library knows: too small, or it claims fields of a newer library that are set.
    StructSize = 2,
    /// A number is not one of its enumeration.
    UnknownValue = 3,
    /// Arguments that contradict each other or are out of range.
    InvalidArgument = 4,
    /// A pointer is not aligned to the type that it points to.
    Misaligned = 5,
    /// An output buffer is too small.
    BufferTooSmall = 6,
    /// Another capture is running on this engine.
    Busy = 7,
    /// Nothing is running on this engine that could be cancelled.
    Idle = 8,
    /// The capture was cancelled.
    Cancelled = 9,
    /// The memory cannot be had.
    OutOfMemory = 10,
    /// A bug in the library; it was caught. Please report it with the text of flashmat_last_error.
    Internal = 11,
    /// An earlier capture of this engine ended with FLASHMAT_STATUS_INTERNAL: destroy the engine, create another.
    Poisoned = 12,
    /// No model was given and this build of the library embeds none.
    NoModel = 13,
    /// The bytes are not a model that this library can run.
    Model = 14,
    /// The size of the maps does not suit the network.
    Size = 15,
    /// This CPU or this build does not have the level asked for.
    Level = 16,
    /// The system gave no threads, or this build has none.
    Threads = 17,
    /// The photo has no pixels.
    FrameEmpty = 18,
    /// The photo's sides exceed what is supported.
    FrameTooLarge = 19,
    /// Rows or pixels of the photo overlap: a stride is too small.
    FrameStride = 20,
    /// The photo's buffer ends before its last pixel.
    FrameBuffer = 21,
    /// A float pixel is NaN, infinite or negative.
    FramePixel = 22,
    /// A field of view outside 1 to 170 degrees, or a focal length outside 8 to 5000 mm (35 mm equivalent).
    FieldOfView = 23,
    /// Every pixel of the photo is overexposed.
    NoUsablePixels = 24,
    /// The photo is black.
    PhotoBlack = 25,
    /// The workspace is smaller than flashmat_workspace_bytes says.
    WorkspaceTooSmall = 26,
}

impl flashmat_status {
    /// Every status, in the order of their numbers.
    pub(crate) const ALL: [Self; 27] = [
        Self::Ok,
        Self::NullPointer,
        Self::StructSize,
        Self::UnknownValue,
        Self::InvalidArgument,
        Self::Misaligned,
        Self::BufferTooSmall,
        Self::Busy,
        Self::Idle,
        Self::Cancelled,
        Self::OutOfMemory,
        Self::Internal,
        Self::Poisoned,
        Self::NoModel,
        Self::Model,
        Self::Size,
        Self::Level,
        Self::Threads,
        Self::FrameEmpty,
        Self::FrameTooLarge,
        Self::FrameStride,
        Self::FrameBuffer,
        Self::FramePixel,
        Self::FieldOfView,
        Self::NoUsablePixels,
        Self::PhotoBlack,
        Self::WorkspaceTooSmall,
    ];

    /// The core's error as a status. Its enum may grow, so the compiler wants a last arm; a test (`tests/source.rs`)
    /// sees to it that every variant has an arm of its own.
    pub(crate) fn of(error: Error) -> Self {
        match error {
            Error::WorkspaceTooSmall { .. } => Self::WorkspaceTooSmall,
            Error::Cancelled => Self::Cancelled,
            Error::FrameEmpty => Self::FrameEmpty,
            Error::FrameTooLarge => Self::FrameTooLarge,
            Error::FrameStride { .. } => Self::FrameStride,
            Error::FrameBuffer { .. } => Self::FrameBuffer,
            Error::FramePixel { .. } => Self::FramePixel,
            Error::FieldOfView | Error::FocalLength => Self::FieldOfView,
            Error::Size { .. } | Error::NetworkSize { .. } => Self::Size,
            Error::NoUsablePixels => Self::NoUsablePixels,
            Error::PhotoBlack => Self::PhotoBlack,
            Error::LightScale => Self::InvalidArgument,
            Error::Threads => Self::Threads,
            Error::Model(_) => Self::Model,
            // The float engine is not in this library.
            Error::Float => Self::Internal,
            Error::LevelUnsupported { .. } => Self::Level,
            // Sizes, lights and maps inside the pipeline are its own.
            Error::PlaneLength { .. } | Error::LightBelowPlane | Error::CrfInput => Self::Internal,
            _ => Self::Internal,
        }
    }

    /// The constant's name in the header.
    pub(crate) const fn name(self) -> &'static CStr {
        match self {
            Self::Ok => c"FLASHMAT_STATUS_OK",
            Self::NullPointer => c"FLASHMAT_STATUS_NULL_POINTER",
            Self::StructSize => c"FLASHMAT_STATUS_STRUCT_SIZE",
            Self::UnknownValue => c"FLASHMAT_STATUS_UNKNOWN_VALUE",
            Self::InvalidArgument => c"FLASHMAT_STATUS_INVALID_ARGUMENT",
            Self::Misaligned => c"FLASHMAT_STATUS_MISALIGNED",
            Self::BufferTooSmall => c"FLASHMAT_STATUS_BUFFER_TOO_SMALL",
            Self::Busy => c"FLASHMAT_STATUS_BUSY",
            Self::Idle => c"FLASHMAT_STATUS_IDLE",
            Self::Cancelled => c"FLASHMAT_STATUS_CANCELLED",
            Self::OutOfMemory => c"FLASHMAT_STATUS_OUT_OF_MEMORY",
            Self::Internal => c"FLASHMAT_STATUS_INTERNAL",
            Self::Poisoned => c"FLASHMAT_STATUS_POISONED",
            Self::NoModel => c"FLASHMAT_STATUS_NO_MODEL",
            Self::Model => c"FLASHMAT_STATUS_MODEL",
            Self::Size => c"FLASHMAT_STATUS_SIZE",
            Self::Level => c"FLASHMAT_STATUS_LEVEL",
            Self::Threads => c"FLASHMAT_STATUS_THREADS",
            Self::FrameEmpty => c"FLASHMAT_STATUS_FRAME_EMPTY",
            Self::FrameTooLarge => c"FLASHMAT_STATUS_FRAME_TOO_LARGE",
            Self::FrameStride => c"FLASHMAT_STATUS_FRAME_STRIDE",
            Self::FrameBuffer => c"FLASHMAT_STATUS_FRAME_BUFFER",
            Self::FramePixel => c"FLASHMAT_STATUS_FRAME_PIXEL",
            Self::FieldOfView => c"FLASHMAT_STATUS_FIELD_OF_VIEW",
            Self::NoUsablePixels => c"FLASHMAT_STATUS_NO_USABLE_PIXELS",
            Self::PhotoBlack => c"FLASHMAT_STATUS_PHOTO_BLACK",
            Self::WorkspaceTooSmall => c"FLASHMAT_STATUS_WORKSPACE_TOO_SMALL",
        }
    }

    /// A sentence for people, without the details of a certain call.
    pub(crate) const fn text(self) -> &'static CStr {
        match self {
            Self::Ok => c"done",
            Self::NullPointer => c"a pointer that must be given is NULL",
            Self::StructSize => c"a struct_size is none that this library knows",
            Self::UnknownValue => c"a number is not one of its enumeration",
            Self::InvalidArgument => c"arguments contradict each other or are out of range",
            Self::Misaligned => c"a pointer is not aligned to its type",
            Self::BufferTooSmall => c"an output buffer is too small",
            Self::Busy => c"another capture is running on this engine",
            Self::Idle => c"no capture is running on this engine",
            Self::Cancelled => c"the capture was cancelled",
            Self::OutOfMemory => c"out of memory",
            Self::Internal => c"a bug in the library, caught",
            Self::Poisoned => c"the engine met a bug before; create another",
            Self::NoModel => c"no model was given and none is embedded",
            Self::Model => c"not a model that this library can run",
            Self::Size => c"the size of the maps does not suit the network",
            Self::Level => c"the level is not available on this CPU or in this build",
            Self::Threads => c"no threads",
            Self::FrameEmpty => c"the photo has no pixels",
            Self::FrameTooLarge => c"the photo is too large",
            Self::FrameStride => c"a stride of the photo is too small",
            Self::FrameBuffer => c"the photo's buffer ends before its last pixel",
            Self::FramePixel => c"a pixel of the photo is NaN, infinite or negative",
            Self::FieldOfView => c"a field of view or focal length makes no sense",
            Self::NoUsablePixels => c"the photo is overexposed all over",
            Self::PhotoBlack => c"the photo is black",
            Self::WorkspaceTooSmall => c"the workspace is too small",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn status_numbers_never_change() {
        let frozen = "Ok NullPointer StructSize UnknownValue InvalidArgument Misaligned BufferTooSmall Busy Idle \
            Cancelled OutOfMemory Internal Poisoned NoModel Model Size Level Threads FrameEmpty FrameTooLarge \
            FrameStride FrameBuffer FramePixel FieldOfView NoUsablePixels PhotoBlack WorkspaceTooSmall";
        let frozen = frozen.split_whitespace();
        for (number, (status, name)) in flashmat_status::ALL.iter().zip(frozen).enumerate() {
            assert_eq!((*status as usize, std::format!("{status:?}").as_str()), (number, name));
        }
    }
}
