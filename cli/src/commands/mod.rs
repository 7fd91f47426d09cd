//! One file for each command; each returns whether all went well and prints its own errors.
pub(crate) mod bench;
pub(crate) mod capture;
pub(crate) mod eval;
pub(crate) mod learn_crf;
pub(crate) mod model;
pub(crate) mod render;
mod workers;

use std::fmt::Display;
use std::io::Write;

/// One line on stderr.
pub(crate) fn complain(failure: &dyn Display) {
    // With stderr gone there is nobody to tell.
    let _ = writeln!(std::io::stderr(), "flashmat: {failure}");
}

/// Text on stdout; a reader that went away (`| head`) is no error.
pub(crate) fn say(text: &dyn Display) {
    let _ = writeln!(std::io::stdout(), "{text}");
}
