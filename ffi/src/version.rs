//! Versions of library and ABI.
#![expect(unsafe_code, reason = "unmangled names")]

use core::ffi::{CStr, c_char};

/// Version of the ABI of this header: it grows when functions, fields or numbers are added. What was there stays.
pub const FLASHMAT_ABI_VERSION: u32 = 4;

const VERSION: &CStr = match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
    Ok(version) => version,
    Err(_) => c"",
};

/// Version of the ABI that the library has: programs built with FLASHMAT_ABI_VERSION up to it can use it.
/// Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn flashmat_abi_version() -> u32 {
    FLASHMAT_ABI_VERSION
}

/// Version of the library, such as "0.1.0". Static. Threads: any.
#[unsafe(no_mangle)]
pub extern "C" fn flashmat_version() -> *const c_char {
    VERSION.as_ptr()
}
