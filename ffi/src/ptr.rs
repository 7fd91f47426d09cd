//! Raw pointers to values and slices and back: NULL, alignment, length. The only place that dereferences what C gives.
//!
//! The functions here are safe to call in this crate because of what the header makes callers promise: a pointer that
//! is neither NULL nor misaligned points to as many readable (or writable) bytes as its struct_size or `bytes` says,
//! and nobody else writes (or uses) them during the call. What can be checked is checked.
#![expect(unsafe_code, reason = "the border to C")]

use crate::failure::Failure;
use crate::status::flashmat_status as Status;
use crate::types::{
    flashmat_capture_options, flashmat_engine_info, flashmat_engine_options, flashmat_frame, flashmat_maps,
    flashmat_report,
};
use bytemuck::Pod;
use core::ffi::c_void;
#[cfg(feature = "std")]
use core::ffi::{CStr, c_char};
use core::marker::PhantomData;
use core::mem::MaybeUninit;

/// Structs of more bytes than this are garbage, not of a newer library.
const LARGEST_STRUCT: usize = 1024;

/// A struct that C fills in: a `u32` struct_size first, every field fit for any bits.
///
/// # Safety
/// `repr(C)`, its first field is the `u32` struct_size, and zeroed bytes or any bytes from C are a valid value.
pub(crate) unsafe trait Struct: Copy {
    /// Its size in the first version of the ABI: what every caller has.
    const FIRST_SIZE: usize;
}

// SAFETY: `repr(C)` with struct_size first; integers, floats and raw pointers take any bits, and so does the optional
// function pointer as far as C keeps to the header (NULL, or a function of that type).
unsafe impl Struct for flashmat_capture_options {
    const FIRST_SIZE: usize = size_of::<Self>();
}
// SAFETY: as above, without the function pointer.
unsafe impl Struct for flashmat_engine_options {
    const FIRST_SIZE: usize = size_of::<Self>();
}
// SAFETY: as above.
unsafe impl Struct for flashmat_frame {
    const FIRST_SIZE: usize = size_of::<Self>();
}
// SAFETY: as above.
unsafe impl Struct for flashmat_maps {
    const FIRST_SIZE: usize = size_of::<Self>();
}
// SAFETY: as above.
unsafe impl Struct for flashmat_report {
    const FIRST_SIZE: usize = size_of::<Self>();
}
// SAFETY: as above.
unsafe impl Struct for flashmat_engine_info {
    const FIRST_SIZE: usize = size_of::<Self>();
}

fn check<T>(pointer: *const T, what: &str) -> Result<(), Failure> {
    if pointer.is_null() {
        return Err(Failure::new(Status::NullPointer, format_args!("{what} is NULL")));
    }
    if !pointer.is_aligned() {
        let (at, to) = (pointer.addr(), align_of::<T>());
        return Err(Failure::new(
            Status::Misaligned,
            format_args!("{what} is at {at:#x}, which is not aligned to {to} bytes"),
        ));
    }
    Ok(())
}

/// The struct's size as its caller knows it, checked.
fn struct_size<T: Struct>(pointer: *const T, what: &str) -> Result<usize, Failure> {
    check(pointer, what)?;
    // SAFETY: not NULL, aligned, and at least struct_size is there (header: "struct_size is set by the caller").
    let size = unsafe { pointer.cast::<u32>().read() } as usize;
    if (T::FIRST_SIZE..=LARGEST_STRUCT).contains(&size) {
        return Ok(size);
    }
    let first = T::FIRST_SIZE;
    Err(Failure::new(
        Status::StructSize,
        format_args!("{what}: struct_size is {size}, set it to sizeof ({first} or more)"),
    ))
}

/// A copy of a struct. Fields that its caller does not know yet are zero; fields that this library does not know yet
/// must be.
pub(crate) fn read_struct<T: Struct>(pointer: *const T, what: &str) -> Result<T, Failure> {
    let size = struct_size(pointer, what)?;
    let mut value = MaybeUninit::<T>::zeroed();
    let known = size.min(size_of::<T>());
    // SAFETY: the caller's struct has `size` bytes (struct_size), ours has size_of::<T>(); `known` is at most both.
    unsafe { pointer.cast::<u8>().copy_to_nonoverlapping(value.as_mut_ptr().cast(), known) };
    // SAFETY: `known..size` lies within the caller's struct.
    let newer = unsafe { core::slice::from_raw_parts(pointer.cast::<u8>().add(known), size - known) };
    if newer.iter().any(|&byte| byte != 0) {
        return Err(Failure::new(
            Status::StructSize,
            format_args!("{what}: struct_size is {size}, and a field is set that this library does not know"),
        ));
    }
    // SAFETY: zeroed, then overwritten by bytes from C: valid for every `Struct`.
    Ok(unsafe { value.assume_init() })
}

/// As [`read_struct`]; NULL: the default.
pub(crate) fn read_optional<T: Struct>(pointer: *const T, what: &str) -> Result<Option<T>, Failure> {
    if pointer.is_null() { Ok(None) } else { read_struct(pointer, what).map(Some) }
}

/// Where a struct of results goes, checked before the work is done. NULL: nowhere.
pub(crate) struct OutStruct<T> {
    pointer: *mut T,
    size: usize,
}

impl<T: Struct> OutStruct<T> {
    pub(crate) fn required(pointer: *mut T, what: &str) -> Result<Self, Failure> {
        Ok(Self { pointer, size: struct_size(pointer, what)? })
    }

    pub(crate) fn optional(pointer: *mut T, what: &str) -> Result<Self, Failure> {
        if pointer.is_null() { Ok(Self { pointer, size: 0 }) } else { Self::required(pointer, what) }
    }

    /// Writes the fields that the caller knows, but for its struct_size; fields of a newer library become zero.
    pub(crate) fn write(&self, value: &T) {
        const HEAD: usize = size_of::<u32>();
        if self.size <= HEAD {
            return;
        }
        let known = self.size.min(size_of::<T>());
        let from = (&raw const *value).cast::<u8>();
        let to = self.pointer.cast::<u8>();
        // SAFETY: the caller's struct has `size` bytes, all of them writable; `value` is ours and does not overlap.
        unsafe {
            from.add(HEAD).copy_to_nonoverlapping(to.add(HEAD), known - HEAD);
            to.add(known).write_bytes(0, self.size - known);
        }
    }
}

/// Where one value goes.
pub(crate) struct Out<T>(*mut T);

impl<T> Out<T> {
    pub(crate) fn new(pointer: *mut T, what: &str) -> Result<Self, Failure> {
        check(pointer, what)?;
        Ok(Self(pointer))
    }

    pub(crate) fn write(&self, value: T) {
        // SAFETY: not NULL, aligned; the caller promised room for one value.
        unsafe { self.0.write(value) };
    }
}

/// The caller's memory as numbers to read; bytes after the last whole number are left out.
pub(crate) fn slice<'a, T: Pod>(data: *const c_void, bytes: usize, what: &str) -> Result<&'a [T], Failure> {
    let data = data.cast::<T>();
    check(data, what)?;
    check_length(data.addr(), bytes, what)?;
    // SAFETY: not NULL, aligned, does not wrap around; the caller promised `bytes` readable bytes that nobody writes to
    // during the call. `'a` is used for the call alone: frames are dropped, models copied or dropped, before it ends.
    Ok(unsafe { core::slice::from_raw_parts(data, bytes / size_of::<T>()) })
}

/// A text of the caller's: UTF-8, ends with NUL.
#[cfg(feature = "std")]
pub(crate) fn text<'a>(pointer: *const c_char, what: &str) -> Result<&'a str, Failure> {
    check(pointer, what)?;
    // SAFETY: not NULL; the caller promised a NUL at its end and that nobody writes to it during the call, for which
    // alone `'a` is used.
    let text = unsafe { CStr::from_ptr(pointer) };
    text.to_str().map_err(|_| Failure::new(Status::InvalidArgument, format_args!("{what} is not UTF-8")))
}

/// No object is larger than half the address space, none goes beyond its end.
fn check_length(address: usize, bytes: usize, what: &str) -> Result<(), Failure> {
    if isize::try_from(bytes).is_err() || address.checked_add(bytes).is_none() {
        let status = Status::InvalidArgument;
        return Err(Failure::new(status, format_args!("{what}: {bytes} bytes do not fit in memory")));
    }
    Ok(())
}

/// The caller's memory to write to, or nothing if the result is not wanted.
#[derive(Debug)]
pub(crate) struct OutBuffer<'a, T> {
    data: *mut T,
    len: usize,
    call: PhantomData<&'a mut [T]>,
}

impl<T: Pod> OutBuffer<'_, T> {
    /// Room for `len` values; the buffer may be larger.
    pub(crate) fn new(data: *mut c_void, bytes: usize, len: usize, what: &str) -> Result<Self, Failure> {
        let (data, needed) = (data.cast::<T>(), len.saturating_mul(size_of::<T>()));
        if data.is_null() && bytes == 0 {
            return Ok(Self { data, len: 0, call: PhantomData });
        }
        check(data.cast_const(), what)?;
        if bytes < needed {
            return Err(Failure::new(
                Status::BufferTooSmall,
                format_args!("{what}: {bytes} bytes given, {needed} needed"),
            ));
        }
        check_length(data.addr(), bytes, what)?;
        Ok(Self { data, len, call: PhantomData })
    }

    /// The values to fill, zeros at first; none when the result is not wanted.
    pub(crate) fn as_mut(&mut self) -> Option<&mut [T]> {
        if self.data.is_null() {
            return None;
        }
        // SAFETY: not NULL, aligned, long enough (`new`); the caller promised that nobody else uses the memory during
        // the call. Inputs are no longer borrowed when results are written, and one result is written after the other,
        // so that even buffers that overlap make no two live references. Zeroing makes the values initialised.
        Some(unsafe {
            self.data.write_bytes(0, self.len);
            core::slice::from_raw_parts_mut(self.data, self.len)
        })
    }
}

/// The caller's memory to work in, zeroed. It must not overlap anything that `others` name (address and bytes).
pub(crate) fn workspace<'a>(
    data: *mut c_void,
    bytes: usize,
    others: &[(usize, usize)],
) -> Result<&'a mut [u8], Failure> {
    let data = data.cast::<u8>();
    check(data.cast_const(), "workspace")?;
    check_length(data.addr(), bytes, "workspace")?;
    let start = data.addr();
    let overlaps = |&(other, len): &(usize, usize)| {
        len != 0 && other < start + bytes && start < other.saturating_add(len)
    };
    if others.iter().any(overlaps) {
        return Err(Failure::new(
            Status::InvalidArgument,
            format_args!("the workspace overlaps the model, the frame, a struct or a result"),
        ));
    }
    // SAFETY: not NULL, does not wrap around; the caller promised `bytes` writable bytes that nobody else uses during
    // the call, and nothing that this library borrows meanwhile lies in them. Zeroing makes them initialised.
    Ok(unsafe {
        data.write_bytes(0, bytes);
        core::slice::from_raw_parts_mut(data, bytes)
    })
}
