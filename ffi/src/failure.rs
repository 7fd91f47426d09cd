//! Why an export failed: a status and a text with the details, made without a heap.
use crate::status::flashmat_status;
#[cfg(feature = "std")]
use core::ffi::CStr;
use core::fmt::{self, Write};
use flashmat_core::Error;

/// Bytes that a text can have, its closing NUL included.
const CAPACITY: usize = 256;

/// A text that ends with NUL; what does not fit is cut off between two characters.
#[derive(Clone, Copy)]
pub(crate) struct Text {
    bytes: [u8; CAPACITY],
    len: usize,
    /// Cut off: nothing more follows.
    full: bool,
}

impl Text {
    pub(crate) const EMPTY: Self = Self { bytes: [0; CAPACITY], len: 0, full: false };

    pub(crate) fn new(arguments: fmt::Arguments<'_>) -> Self {
        let mut text = Self::EMPTY;
        // Cutting off is no error of `write_str`; the texts' own `Display` have none.
        let _ = text.write_fmt(arguments);
        text
    }

    #[cfg(feature = "std")]
    pub(crate) fn as_c_str(&self) -> &CStr {
        CStr::from_bytes_until_nul(&self.bytes).unwrap_or(c"")
    }
}

impl Write for Text {
    fn write_str(&mut self, s: &str) -> fmt::Result {
        for c in s.chars().filter(|&c| c != '\0') {
            let end = self.len + c.len_utf8();
            self.full |= end >= CAPACITY;
            if self.full {
                break;
            }
            if let Some(slot) = self.bytes.get_mut(self.len..end) {
                c.encode_utf8(slot);
                self.len = end;
            }
        }
        Ok(())
    }
}

/// A status that is not OK, and its details.
pub(crate) struct Failure {
    pub(crate) status: flashmat_status,
    // Without std there is nowhere to keep it.
    #[cfg_attr(not(feature = "std"), expect(dead_code, reason = "only flashmat_last_error reads it"))]
    pub(crate) text: Text,
}

impl Failure {
    pub(crate) fn new(status: flashmat_status, arguments: fmt::Arguments<'_>) -> Self {
        Self { status, text: Text::new(arguments) }
    }

    /// With the status' own text.
    pub(crate) fn plain(status: flashmat_status) -> Self {
        Self::new(status, format_args!("{}", status.text().to_str().unwrap_or("")))
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        Self::new(flashmat_status::of(error), format_args!("{error}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_texts_are_cut_between_characters() {
        let text = Text::new(format_args!("{:a<254}ä{}", "", "more"));
        assert_eq!(text.as_c_str().to_bytes(), std::format!("{:a<254}", "").as_bytes());
        assert_eq!(Text::new(format_args!("a\0b")).as_c_str(), c"ab");
    }
}
