//! What went wrong with one file, as a value: the file, what is wrong with it, and what would help.
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

/// One failure; prints as one line.
#[derive(Clone, Debug)]
pub(crate) struct Failure {
    path: PathBuf,
    what: String,
    help: String,
}

impl Failure {
    /// A failure of `path`: `what` is wrong, `help` would mend it.
    pub(crate) fn new(path: &Path, what: impl Into<String>, help: impl Into<String>) -> Self {
        Self { path: path.to_owned(), what: what.into(), help: help.into() }
    }

    /// An error while reading `path`.
    pub(crate) fn reading(path: &Path, error: &io::Error) -> Self {
        let help = match error.kind() {
            io::ErrorKind::NotFound => "check the path",
            io::ErrorKind::PermissionDenied => "make it readable for this user",
            _ => "check the disk and try again",
        };
        Self::new(path, format!("cannot be read: {}", plain(error)), help)
    }

    /// An error while writing `path`.
    pub(crate) fn writing(path: &Path, error: &io::Error) -> Self {
        let help = match error.kind() {
            io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => {
                "free some space or choose another place with --out"
            }
            _ => "choose another place with --out",
        };
        Self::new(path, format!("cannot be written: {}", plain(error)), help)
    }

    /// The core's word on `path`; its messages say what would help after a semicolon.
    pub(crate) fn core(path: &Path, error: &flashmat_core::Error) -> Self {
        let text = error.to_string();
        match text.split_once("; ") {
            Some((what, help)) => Self::new(path, what, help),
            None => Self::new(path, text, "see `flashmat help`"),
        }
    }

    /// The same trouble as the reason why `path` gave no result.
    pub(crate) fn at(&self, path: &Path) -> Self {
        Self::new(path, format!("{}: {}", one_line(&self.path), self.what), self.help.clone())
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}; {}", one_line(&self.path), self.what, self.help)
    }
}

impl std::error::Error for Failure {}

/// A path as text that cannot break the line it stands in.
pub(crate) fn one_line(path: &Path) -> String {
    path.display().to_string().replace(['\n', '\r'], "?")
}

/// The system's words without "(os error 28)".
fn plain(error: &io::Error) -> String {
    let text = error.to_string();
    let end = text.find(" (os error").unwrap_or(text.len());
    text.get(..end).unwrap_or(&text).to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_is_one_line_that_names_the_file_and_the_cure() {
        let full = io::Error::from(io::ErrorKind::StorageFull);
        let line =
            Failure::writing(Path::new("out/a\nb/albedo.png"), &full).at(Path::new("a.jpg")).to_string();
        assert_eq!(
            line,
            "a.jpg: out/a?b/albedo.png: cannot be written: no storage space; \
             free some space or choose another place with --out"
        );
    }

    #[test]
    fn the_systems_numbers_are_left_out() {
        let error = io::Error::from_raw_os_error(2);
        let line = Failure::reading(Path::new("x.png"), &error).to_string();
        assert_eq!(line, "x.png: cannot be read: no such file or directory; check the path");
    }
}
