//! Which model: the caller's bytes, or the embedded one.
use crate::failure::Failure;
use crate::ptr;
use crate::status::flashmat_status as Status;
use core::ffi::c_void;

/// The embedded model file.
#[cfg(feature = "embedded-model")]
const EMBEDDED: Option<&[u8]> = Some(include_bytes!("../../models/phone.fmat"));
#[cfg(not(feature = "embedded-model"))]
const EMBEDDED: Option<&[u8]> = None;

/// A model file and who owns it.
pub(crate) enum ModelBytes<'a> {
    /// The caller's, for the time of the call.
    Caller(&'a [u8]),
    /// The library's.
    Embedded(&'static [u8]),
}

impl<'a> ModelBytes<'a> {
    /// NULL and 0 bytes: the embedded model.
    pub(crate) fn new(data: *const c_void, bytes: usize) -> Result<Self, Failure> {
        if data.is_null() && bytes == 0 {
            return EMBEDDED.map(Self::Embedded).ok_or_else(|| Failure::plain(Status::NoModel));
        }
        ptr::slice(data, bytes, "model").map(Self::Caller)
    }

    pub(crate) fn as_slice(&self) -> &'a [u8] {
        match *self {
            Self::Caller(bytes) => bytes,
            Self::Embedded(bytes) => bytes,
        }
    }
}
