//! Ctrl-C: the first asks every run to stop and clean up, the second stops at once.
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};

static ASKED: AtomicBool = AtomicBool::new(false);

/// Listens from now on (to SIGTERM and SIGHUP as well, where they exist).
pub(crate) fn listen() {
    let stop = || {
        if ASKED.swap(true, Ordering::SeqCst) {
            std::process::exit(130);
        }
    };
    // Without a handler Ctrl-C ends the program at once, which leaves a hidden folder behind at worst.
    let _ = ctrlc::set_handler(stop);
}

/// Whether the user asked to stop.
pub(crate) fn asked() -> bool {
    ASKED.load(Ordering::SeqCst)
}

/// What an observer answers.
pub(crate) fn flow() -> ControlFlow<()> {
    if asked() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
}
