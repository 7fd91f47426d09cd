//! The one way out of an export: results become a status, panics end here, the text is kept for the caller.
use crate::failure::Failure;
use crate::status::flashmat_status;

/// Runs an export's work. Nothing unwinds past this function.
#[cfg(feature = "std")]
pub(crate) fn guard(work: impl FnOnce() -> Result<(), Failure>) -> flashmat_status {
    use std::panic::{AssertUnwindSafe, catch_unwind};
    // What `work` may leave broken behind a panic is an engine, whose lock is then poisoned.
    let result = catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| {
        let message = panic.downcast_ref::<&str>().copied();
        let message = message.or_else(|| panic.downcast_ref::<std::string::String>().map(|s| s.as_str()));
        let message = message.unwrap_or("no message");
        Err(Failure::new(flashmat_status::Internal, format_args!("a bug in the library: {message}")))
    });
    match result {
        Ok(()) => flashmat_status::Ok,
        Err(failure) => {
            let status = failure.status;
            last_error::set(failure.text);
            status
        }
    }
}

/// Runs an export's work. The core does not panic; if it did, `flashmat_on_panic` would be called.
#[cfg(not(feature = "std"))]
pub(crate) fn guard(work: impl FnOnce() -> Result<(), Failure>) -> flashmat_status {
    work().map_or_else(|failure| failure.status, |()| flashmat_status::Ok)
}

#[cfg(feature = "std")]
pub use last_error::flashmat_last_error;

#[cfg(feature = "std")]
#[expect(unsafe_code, reason = "unmangled names")]
mod last_error {
    use crate::failure::Text;
    use core::cell::RefCell;
    use core::ffi::c_char;

    std::thread_local! {
        static LAST: RefCell<Text> = const { RefCell::new(Text::EMPTY) };
    }

    /// Keeps the text; at a thread's very end there is nowhere to keep it.
    pub(super) fn set(text: Text) {
        let _ = LAST.try_with(|last| last.try_borrow_mut().map(|mut last| *last = text));
    }

    /// What the last call of this thread that failed has to say: one sentence in English, UTF-8, with the details
    /// (which argument, which limit). Never NULL; empty when no call of this thread failed yet.
    ///
    /// Owner: the library. Valid until the next call of a function of this library on the same thread.
    /// Threads: any; each has a text of its own. Not in the bare-metal build.
    #[unsafe(no_mangle)]
    pub extern "C" fn flashmat_last_error() -> *const c_char {
        LAST.try_with(|last| last.try_borrow().map_or(c"".as_ptr(), |last| last.as_c_str().as_ptr()))
            .unwrap_or(c"".as_ptr())
    }
}

#[cfg(all(test, feature = "std"))]
mod tests {
    use super::*;
    use core::ffi::CStr;

    #[test]
    fn panics_end_in_the_guard() {
        let quiet = std::panic::take_hook();
        std::panic::set_hook(std::boxed::Box::new(|_| {}));
        let status = guard(|| panic!("on purpose, {}", 1));
        std::panic::set_hook(quiet);
        assert_eq!(status, flashmat_status::Internal);
        assert_eq!(text(), "a bug in the library: on purpose, 1");
        assert_eq!(guard(|| Ok(())), flashmat_status::Ok);
        assert_eq!(text(), "a bug in the library: on purpose, 1");
        assert_eq!(guard(|| Err(Failure::plain(flashmat_status::Busy))), flashmat_status::Busy);
        assert_eq!(text(), "another capture is running on this engine");
        let other = std::thread::spawn(text).join().expect("thread");
        assert_eq!(other, "", "each thread has its own text");
    }

    #[expect(unsafe_code, reason = "reads what C reads")]
    fn text() -> std::string::String {
        // SAFETY: the pointer is NUL-terminated and valid until the next call.
        unsafe { CStr::from_ptr(flashmat_last_error()) }.to_str().expect("UTF-8").into()
    }
}
