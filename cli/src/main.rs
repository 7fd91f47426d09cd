//! Flashmat on the desktop.
fn main() {}
