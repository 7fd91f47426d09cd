//! Tests of the program as a user runs it: arguments in, files, messages and exit status out.
mod bad_input;
mod capture;
mod common;
#[cfg(unix)]
mod disk;
mod eval;
mod glb;
mod model_file;
mod names;
mod photos;
mod schema;
#[cfg(unix)]
mod unclean;
