//! Engines behind handles: a table of numbers, one capture at a time, closing that waits, cancelling that does not.
use crate::Failure;
use flashmat_core::net::Model;
use flashmat_core::{Error, Session, SessionOptions};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};

self_cell::self_cell! {
    /// A session together with the model file's bytes that it borrows.
    pub(crate) struct OwnedSession {
        owner: Vec<u8>,
        #[not_covariant]
        dependent: Session,
    }
}

/// One engine: what `MaterialEngine` holds.
pub(crate) struct Engine {
    /// None once closed. Poisoned by a panic: then every later call fails, and closing still works.
    session: Mutex<Option<OwnedSession>>,
    /// The thread that captures now, so that a listener's call back into its own engine fails instead of hanging.
    runner: Mutex<Option<ThreadId>>,
    closed: AtomicBool,
    /// Counts cancel calls: a capture stops when the count differs from when it was asked for.
    cancels: AtomicU64,
    pub(crate) size: usize,
    pub(crate) level: &'static str,
    pub(crate) workspace_bytes: usize,
    pub(crate) meta: String,
    pub(crate) checksum: u32,
}

/// Clears the runner when a capture ends, however it ends.
struct Running<'e>(&'e Engine);

impl Drop for Running<'_> {
    fn drop(&mut self) {
        *self.0.runner() = None;
    }
}

impl Engine {
    fn new(model: Vec<u8>, options: &SessionOptions) -> Result<Self, Error> {
        let session = OwnedSession::try_new(model, |bytes| Session::new(Model::from_bytes(bytes)?, options))?;
        let (size, level, workspace_bytes, meta, checksum) = session.with_dependent(|_, s| {
            let model = s.model();
            (s.size(), s.level().name(), s.workspace_bytes(), model.meta().to_owned(), model.checksum())
        });
        Ok(Self {
            session: Mutex::new(Some(session)),
            runner: Mutex::new(None),
            closed: AtomicBool::new(false),
            cancels: AtomicU64::new(0),
            size,
            level,
            workspace_bytes,
            meta,
            checksum,
        })
    }

    fn runner(&self) -> MutexGuard<'_, Option<ThreadId>> {
        self.runner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn refuse_own_thread(&self, what: &str) -> Result<(), Failure> {
        if *self.runner() == Some(thread::current().id()) {
            return Err(Failure::State(format!(
                "{what} called from the engine's own progress listener would wait for itself; return false there to stop"
            )));
        }
        Ok(())
    }

    /// Stops the capture that runs and those that wait; later ones are not touched.
    pub(crate) fn cancel(&self) {
        self.cancels.fetch_add(1, Ordering::SeqCst);
    }

    /// What [`Engine::cancelled_since`] compares with; taken when a capture is asked for.
    pub(crate) fn cancel_count(&self) -> u64 {
        self.cancels.load(Ordering::SeqCst)
    }

    pub(crate) fn cancelled_since(&self, count: u64) -> bool {
        self.cancel_count() != count
    }

    /// Gives `work` the session, once it is free.
    pub(crate) fn with_session<T>(
        &self,
        work: impl FnOnce(&mut OwnedSession) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        self.refuse_own_thread("capture()")?;
        let mut guard = self.session.lock().map_err(|_| {
            Failure::State("this engine failed inside an earlier call; close it and make another".to_owned())
        })?;
        if self.closed.load(Ordering::SeqCst) {
            return Err(Failure::Closed);
        }
        let session = guard.as_mut().ok_or(Failure::Closed)?;
        *self.runner() = Some(thread::current().id());
        let _running = Running(self);
        work(session)
    }

    /// Refuses new captures, waits for the one that runs, frees the session.
    fn close(&self) {
        self.closed.store(true, Ordering::SeqCst);
        *self.session.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

/// "FM": the top 16 bits of every handle, so that a number from elsewhere is seen to be none.
const TAG: u64 = 0x464d << 48;

struct Table {
    serial: u64,
    engines: BTreeMap<u64, Arc<Engine>>,
}

static TABLE: Mutex<Table> = Mutex::new(Table { serial: 0, engines: BTreeMap::new() });

fn table() -> MutexGuard<'static, Table> {
    TABLE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Makes an engine and returns its handle; `model` is the engine's own copy of the file.
pub(crate) fn open(model: Vec<u8>, options: &SessionOptions) -> Result<u64, Error> {
    let engine = Arc::new(Engine::new(model, options)?);
    let mut table = table();
    table.serial += 1;
    let handle = TAG | table.serial;
    table.engines.insert(handle, engine);
    Ok(handle)
}

/// The engine of a handle.
pub(crate) fn get(handle: u64) -> Result<Arc<Engine>, Failure> {
    if handle >> 48 != TAG >> 48 {
        return Err(Failure::State("not an engine's handle".to_owned()));
    }
    table().engines.get(&handle).cloned().ok_or(Failure::Closed)
}

/// Closes an engine: once; a second time is [`Failure::Closed`].
pub(crate) fn close(handle: u64) -> Result<(), Failure> {
    get(handle)?.refuse_own_thread("close()")?;
    let engine = table().engines.remove(&handle).ok_or(Failure::Closed)?;
    engine.close();
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use flashmat_core::Stage;
    use flashmat_core::capture::CaptureOptions;
    use flashmat_core::frame::Frame;
    use std::ops::ControlFlow;
    use std::sync::mpsc;
    use std::time::Duration;

    const TOY: &[u8] = include_bytes!("../../../tests/golden/toy.fmat");

    fn toy() -> u64 {
        open(TOY.to_vec(), &SessionOptions { size: 128, ..SessionOptions::default() }).expect("toy model")
    }

    fn is_closed<T>(result: Result<T, Failure>) -> bool {
        matches!(result, Err(Failure::Closed))
    }

    #[test]
    fn handles_close_once_and_invented_ones_are_refused() {
        let handle = toy();
        assert_eq!(handle >> 48, 0x464d);
        assert_eq!(get(handle).expect("open").size, 128);
        close(handle).expect("first");
        assert!(is_closed(close(handle)));
        assert!(is_closed(get(handle)));
        for invented in [0, 1, u64::MAX, 0x7fff_dead_beef, TAG] {
            assert!(get(invented).is_err(), "{invented:#x}");
            assert!(close(invented).is_err(), "{invented:#x}");
        }
    }

    #[test]
    fn closing_waits_for_the_capture_that_runs_and_turns_waiting_ones_away() {
        let handle = toy();
        let engine = get(handle).expect("open");
        let (inside, entered) = mpsc::channel();
        let (finish, finished) = mpsc::channel::<()>();
        let (order, events) = mpsc::channel();
        thread::scope(|scope| {
            let (runner, ends) = (&engine, order.clone());
            scope.spawn(move || {
                runner
                    .with_session(|_| {
                        inside.send(()).expect("test waits");
                        finished.recv().expect("test answers");
                        ends.send("ran").expect("test waits");
                        Ok(())
                    })
                    .expect("runs");
            });
            entered.recv().expect("running");
            let closer = scope.spawn(move || {
                close(handle).expect("closes");
                order.send("closed").expect("test waits");
            });
            while !engine.closed.load(Ordering::SeqCst) {
                thread::sleep(Duration::from_millis(1));
            }
            let late = scope.spawn(|| is_closed(engine.with_session(|_| Ok(()))));
            assert!(is_closed(get(handle)), "no new call finds it");
            finish.send(()).expect("capture waits");
            closer.join().expect("closer");
            assert!(late.join().expect("late"));
        });
        assert_eq!(events.try_iter().collect::<Vec<_>>(), ["ran", "closed"]);
    }

    #[test]
    fn calls_back_into_the_own_engine_fail_instead_of_hanging() {
        let handle = toy();
        let engine = get(handle).expect("open");
        engine
            .with_session(|_| {
                assert!(matches!(close(handle), Err(Failure::State(_))));
                assert!(matches!(engine.with_session(|_| Ok(())), Err(Failure::State(_))));
                Ok(())
            })
            .expect("runs");
        close(handle).expect("still open");
    }

    #[test]
    fn a_panic_poisons_the_engine_and_it_still_closes() {
        let handle = toy();
        let engine = get(handle).expect("open");
        let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
            engine.with_session::<()>(|_| panic!("on purpose"))
        }));
        assert!(panicked.is_err());
        assert!(matches!(engine.with_session(|_| Ok(())), Err(Failure::State(_))));
        close(handle).expect("closes");
    }

    #[test]
    fn cancelling_stops_only_what_was_asked_for_before() {
        let handle = toy();
        let engine = get(handle).expect("open");
        let pixels = vec![90; 32 * 32 * 3];
        let frame = Frame::rgb8(&pixels, 32, 32, 96).expect("frame");
        let run = |cancel_at: Option<Stage>| {
            let count = engine.cancel_count();
            engine.with_session(|session| {
                session.with_dependent_mut(|_, session| {
                    let mut observer = |stage, _: f32| {
                        if Some(stage) == cancel_at {
                            engine.cancel();
                        }
                        if engine.cancelled_since(count) {
                            ControlFlow::Break(())
                        } else {
                            ControlFlow::Continue(())
                        }
                    };
                    let result = session.capture(&frame, &CaptureOptions::default(), &mut observer);
                    result.map(|capture| capture.maps.size).map_err(Failure::Core)
                })
            })
        };
        assert!(matches!(run(Some(Stage::Albedo)), Err(Failure::Core(Error::Cancelled))));
        assert_eq!(run(None).expect("not cancelled"), 128);
        close(handle).expect("closes");
    }
}
