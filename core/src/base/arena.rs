//! The caller's bytes as typed slices: a bump arena over a borrowed workspace, without `unsafe`.
//!
//! Every slice starts on a 64-byte boundary (a cache line, an AVX-512 register). [`Arena::scope`] lends the free
//! rest out; what was taken from the scope is free again when the scope ends, so that stages share one workspace.
use crate::Error;
use bytemuck::Pod;

/// Alignment of every slice an [`Arena`] gives, in bytes.
pub const ALIGN: usize = 64;

/// A bump arena over borrowed bytes.
pub struct Arena<'a> {
    rest: &'a mut [u8],
    used: usize,
    total: usize,
}

impl<'a> Arena<'a> {
    /// An arena over `bytes`; up to 63 bytes are lost to alignment at the front.
    #[must_use]
    pub fn new(bytes: &'a mut [u8]) -> Self {
        let total = bytes.len();
        Self { rest: bytes, used: 0, total }
    }

    /// Takes `len` values of `T`; their contents are whatever the workspace held.
    ///
    /// # Errors
    /// [`Error::WorkspaceTooSmall`] when the rest does not hold them.
    pub fn take<T: Pod>(&mut self, len: usize) -> Result<&'a mut [T], Error> {
        let skip = self.rest.as_ptr().align_offset(ALIGN);
        let bytes = len.saturating_mul(size_of::<T>());
        let needed = skip.saturating_add(bytes);
        if needed > self.rest.len() {
            return Err(Error::WorkspaceTooSmall {
                needed: self.used.saturating_add(needed),
                available: self.total,
            });
        }
        let (front, rest) = core::mem::take(&mut self.rest).split_at_mut(needed);
        self.rest = rest;
        self.used += needed;
        let (_, aligned) = front.split_at_mut(skip);
        bytemuck::try_cast_slice_mut(aligned)
            .map_err(|_| Error::WorkspaceTooSmall { needed: self.used, available: self.total })
    }

    /// Takes `len` values of `T` and sets them to zero.
    ///
    /// # Errors
    /// As [`Arena::take`].
    pub fn zeroed<T: Pod>(&mut self, len: usize) -> Result<&'a mut [T], Error> {
        let slice = self.take(len)?;
        slice.fill(T::zeroed());
        Ok(slice)
    }

    /// Lends the free rest as an arena of its own.
    pub fn scope(&mut self) -> Arena<'_> {
        Arena { rest: self.rest, used: self.used, total: self.total }
    }

    /// Bytes used so far, alignment included.
    #[must_use]
    pub fn used(&self) -> usize {
        self.used
    }
}

/// The most bytes that `len` values of `T` can use in an arena, alignment included: the sum of these over all
/// slices alive at once is the size to ask for.
#[must_use]
pub const fn bytes_for<T>(len: usize) -> usize {
    len.saturating_mul(size_of::<T>()).saturating_add(ALIGN - 1)
}
