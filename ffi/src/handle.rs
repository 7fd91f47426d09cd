//! The engine behind its opaque handle: who may use it when, and when its memory goes.
//!
//! One atomic says what goes on. `IDLE` -> `RUNNING` (a capture) -> `WRITING` (its results) -> `IDLE`, or `RUNNING` ->
//! `CANCELLING` (flashmat_cancel) -> `IDLE`: a capture that was cancelled cannot write, one that writes cannot be cancelled.
//! From any of them `DOOMED` (flashmat_engine_destroy). Whoever leaves last frees: destroy if the engine was idle, else the
//! capture at its end. The session lies in a mutex that is never waited for; a panic poisons it.
#![expect(unsafe_code, reason = "the border to C: handles")]

use crate::failure::Failure;
use crate::model::ModelBytes;
use crate::status::flashmat_status as Status;
use core::sync::atomic::{AtomicU32, Ordering};
use flashmat_core::net::Model;
use flashmat_core::{Session, SessionOptions};
use self_cell::self_cell;
use std::borrow::Cow;
use std::boxed::Box;
use std::sync::Mutex;
use std::vec::Vec;

const IDLE: u32 = 0;
const RUNNING: u32 = 1;
const CANCELLING: u32 = 2;
const DOOMED: u32 = 3;
const WRITING: u32 = 4;

self_cell!(
    /// A session and the model bytes that it reads.
    struct Owned {
        owner: Cow<'static, [u8]>,
        #[covariant]
        dependent: Session,
    }
);

/// What captures run on: a model, a CPU level, threads, memory. Create it once, capture with it often.
/// Opaque; made by flashmat_engine_create, freed by flashmat_engine_destroy. Not in the bare-metal build.
pub struct flashmat_engine {
    state: AtomicU32,
    size: usize,
    level: flashmat_core::base::simd::Level,
    checksum: u32,
    workspace_bytes: usize,
    session: Mutex<Owned>,
}

impl flashmat_engine {
    /// An engine with its own copy of the model (or the embedded one).
    pub(crate) fn new(model: &ModelBytes<'_>, options: &SessionOptions) -> Result<Self, Failure> {
        let bytes = match *model {
            ModelBytes::Embedded(bytes) => Cow::Borrowed(bytes),
            ModelBytes::Caller(bytes) => {
                // Garbage is not worth a copy.
                Model::from_bytes(bytes)?;
                let mut copy = Vec::new();
                copy.try_reserve_exact(bytes.len()).map_err(|_| Failure::plain(Status::OutOfMemory))?;
                copy.extend_from_slice(bytes);
                Cow::Owned(copy)
            }
        };
        let session = Owned::try_new(bytes, |bytes| Session::new(Model::from_bytes(bytes)?, options));
        let session = session.map_err(|error| match error {
            flashmat_core::Error::WorkspaceTooSmall { needed, .. } => {
                let text = format_args!("out of memory: the engine works in {needed} bytes");
                Failure::new(Status::OutOfMemory, text)
            }
            other => other.into(),
        })?;
        let inner = session.borrow_dependent();
        Ok(Self {
            state: AtomicU32::new(IDLE),
            size: inner.size(),
            level: inner.level(),
            checksum: inner.model().checksum(),
            workspace_bytes: inner.workspace_bytes(),
            session: Mutex::new(session),
        })
    }

    pub(crate) fn size(&self) -> usize {
        self.size
    }

    pub(crate) fn level(&self) -> flashmat_core::base::simd::Level {
        self.level
    }

    pub(crate) fn checksum(&self) -> u32 {
        self.checksum
    }

    pub(crate) fn workspace_bytes(&self) -> usize {
        self.workspace_bytes
    }

    /// Gives the engine to C; [`destroy`] takes it back.
    pub(crate) fn into_raw(self) -> *mut Self {
        Box::into_raw(Box::new(self))
    }
}

/// The engine of a handle.
pub(crate) fn borrow<'a>(engine: *const flashmat_engine) -> Result<&'a flashmat_engine, Failure> {
    // SAFETY: NULL is checked; else the caller promised that it came from flashmat_engine_create and was not
    // destroyed, so it lives during the call.
    unsafe { engine.as_ref() }
        .ok_or_else(|| Failure::new(Status::NullPointer, format_args!("engine is NULL")))
}

/// Stops the capture that runs on the engine.
pub(crate) fn cancel(engine: *const flashmat_engine) -> Result<(), Failure> {
    let state = &borrow(engine)?.state;
    match state.compare_exchange(RUNNING, CANCELLING, Ordering::AcqRel, Ordering::Acquire) {
        Ok(_) | Err(CANCELLING | DOOMED) => Ok(()),
        Err(_) => Err(Failure::plain(Status::Idle)),
    }
}

/// Frees the engine; at once, or at the end of the capture that runs on it, which is cancelled.
pub(crate) fn destroy(engine: *mut flashmat_engine) {
    let Ok(borrowed) = borrow(engine) else { return };
    if borrowed.state.swap(DOOMED, Ordering::AcqRel) == IDLE {
        // SAFETY: it came from `into_raw`; nobody runs on it (it was idle, and no capture starts on a doomed engine),
        // and the caller promised not to use it again.
        drop(unsafe { Box::from_raw(engine) });
    }
}

/// The only capture on an engine, until it is dropped.
struct Running(*mut flashmat_engine);

impl Running {
    fn start(engine: *mut flashmat_engine) -> Result<Self, Failure> {
        let state = &borrow(engine)?.state;
        match state.compare_exchange(IDLE, RUNNING, Ordering::AcqRel, Ordering::Acquire) {
            Ok(_) => Ok(Self(engine)),
            Err(_) => Err(Failure::plain(Status::Busy)),
        }
    }

    fn engine(&self) -> &flashmat_engine {
        // SAFETY: while the state is not IDLE, only `drop` below frees the engine.
        unsafe { &*self.0 }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let leave = |state| if state == DOOMED { None } else { Some(IDLE) };
        if self.engine().state.fetch_update(Ordering::AcqRel, Ordering::Acquire, leave).is_err() {
            // SAFETY: it came from `into_raw`, and `destroy` left it to us: nobody else uses it any more.
            drop(unsafe { Box::from_raw(self.0) });
        }
    }
}

/// What a capture asks of its engine's state.
#[derive(Clone, Copy)]
pub(crate) struct Control<'a>(&'a AtomicU32);

impl Control<'_> {
    /// Whether somebody wants it to stop.
    pub(crate) fn stop(self) -> bool {
        self.0.load(Ordering::Acquire) != RUNNING
    }

    /// The last moment at which it can be stopped: from here on its results are written.
    pub(crate) fn commit(self) -> Result<(), Failure> {
        let state = self.0.compare_exchange(RUNNING, WRITING, Ordering::AcqRel, Ordering::Acquire);
        state.map(drop).map_err(|_| flashmat_core::Error::Cancelled.into())
    }
}

/// Runs `work` with the engine's session, alone.
pub(crate) fn run(
    engine: *mut flashmat_engine,
    work: impl FnOnce(&mut Session<'_>, Control<'_>) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let running = Running::start(engine)?;
    let engine = running.engine();
    // Alone, so the lock is free, if no panic poisoned it.
    let mut session = engine.session.try_lock().map_err(|_| Failure::plain(Status::Poisoned))?;
    session.with_dependent_mut(|_, session| work(session, Control(&engine.state)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guard::guard;

    fn engine() -> *mut flashmat_engine {
        let model = include_bytes!("../../tests/golden/toy.fmat");
        let options = SessionOptions { size: 128, level: None, threads: 1 };
        match flashmat_engine::new(&ModelBytes::Caller(model), &options) {
            Ok(engine) => engine.into_raw(),
            Err(failure) => panic!("{:?}", failure.text.as_c_str()),
        }
    }

    #[test]
    fn a_panic_poisons_its_engine_and_no_other() {
        let (bad, good) = (engine(), engine());
        assert_eq!(guard(|| run(bad, |_, _| panic!("on purpose"))), Status::Internal);
        assert_eq!(guard(|| run(bad, |_, _| Ok(()))), Status::Poisoned);
        assert_eq!(guard(|| run(bad, |_, _| Ok(()))), Status::Poisoned, "and not busy");
        assert_eq!(guard(|| run(good, |_, _| Ok(()))), Status::Ok);
        destroy(bad);
        destroy(good);
    }

    /// At no moment both: the cancel accepted and the capture written.
    #[test]
    fn a_cancel_that_is_accepted_stops_the_capture() {
        let engine = engine();
        let status = guard(|| {
            run(engine, |_, control| {
                cancel(engine)?;
                assert!(control.stop());
                control.commit()
            })
        });
        assert_eq!(status, Status::Cancelled);
        let status = guard(|| {
            run(engine, |_, control| {
                control.commit()?;
                cancel(engine)
            })
        });
        assert_eq!(status, Status::Idle, "too late, and says so");
        assert_eq!(guard(|| run(engine, |_, control| control.commit())), Status::Ok);
        destroy(engine);
    }

    #[test]
    fn a_panic_in_a_doomed_engine_frees_it() {
        let engine = engine();
        let status = guard(|| {
            run(engine, |_, control| {
                destroy(engine);
                assert!(!control.stop(), "on purpose: it is to stop");
                Ok(())
            })
        });
        assert_eq!(status, Status::Internal);
    }
}
