//! A session owns what a run needs: the façade that the command line, the C library and the Android library share.
use crate::base::exec::{At, Executor, Inline};
use crate::base::simd::{Level, Simd};
use crate::capture::{self, Capture, CaptureOptions};
use crate::frame::Frame;
use crate::kernels::Kernels;
use crate::net::scales::Scales;
use crate::net::{Inference, Model, Network};
use crate::{Error, Observer};
use alloc::boxed::Box;
use alloc::vec::Vec;

/// What a session is made for.
#[derive(Clone, Copy, Debug)]
pub struct SessionOptions {
    /// Pixels per side of the maps: a multiple of the network's (128).
    pub size: usize,
    /// CPU level; none: the fastest one that this CPU has.
    pub level: Option<Level>,
    /// Threads; more than 1 needs feature `parallel`. 0: one per CPU. Results do not depend on it.
    pub threads: usize,
}

impl Default for SessionOptions {
    fn default() -> Self {
        Self { size: 256, level: None, threads: 1 }
    }
}

/// Owns workspace, kernels and threads; captures one photo at a time.
pub struct Session<'m> {
    engine: Box<dyn Inference + Send + 'm>,
    exec: Box<dyn Executor + Send>,
    workspace: Vec<u8>,
    level: Level,
    simd: Simd,
}

impl<'m> Session<'m> {
    /// A session over the int8 engine; all memory is taken here.
    ///
    /// # Errors
    /// [`Error::LevelUnsupported`], [`Error::NetworkSize`], [`Error::Threads`], [`Error::WorkspaceTooSmall`] when the
    /// memory cannot be had.
    pub fn new(model: Model<'m>, options: &SessionOptions) -> Result<Self, Error> {
        let level = level(options.level)?;
        let kernels = Kernels::for_level(level)?;
        let engine = Scales::new(&model, options.size, |size| Network::new(model.clone(), size, kernels))?;
        Self::with_engine(Box::new(engine), level, options.threads)
    }

    /// A session over the float engine (tract) of the same model.
    ///
    /// # Errors
    /// As [`Session::new`], and [`Error::Float`] when tract refuses the graph.
    #[cfg(feature = "tract")]
    pub fn float(model: Model<'m>, options: &SessionOptions) -> Result<Self, Error> {
        use crate::net::tract::FloatNetwork;
        let engine = Scales::new(&model, options.size, |size| FloatNetwork::new(model.clone(), size))?;
        Self::with_engine(Box::new(engine), level(options.level)?, options.threads)
    }

    fn with_engine(
        engine: Box<dyn Inference + Send + 'm>,
        level: Level,
        threads: usize,
    ) -> Result<Self, Error> {
        let needed = capture::workspace_bytes(&*engine);
        let mut workspace = Vec::new();
        workspace.try_reserve_exact(needed).map_err(|_| Error::WorkspaceTooSmall { needed, available: 0 })?;
        workspace.resize(needed, 0);
        Ok(Self { engine, exec: executor(threads)?, workspace, level, simd: Simd::for_level(level)? })
    }

    /// One photo through the pipeline; the result lies in the session until the next call.
    ///
    /// # Errors
    /// As [`capture::run`].
    pub fn capture(
        &mut self,
        frame: &Frame<'_>,
        options: &CaptureOptions,
        observer: &mut dyn Observer,
    ) -> Result<Capture<'_>, Error> {
        let exec = At::new(&*self.exec, self.simd);
        capture::run(&*self.engine, frame, options, &exec, &mut self.workspace, observer)
    }

    /// As [`Session::capture`], and what `then` makes of the result on the session's threads ([`maps::encode`](crate::maps::encode)).
    ///
    /// # Errors
    /// As [`capture::run`].
    pub fn capture_then<T>(
        &mut self,
        frame: &Frame<'_>,
        options: &CaptureOptions,
        observer: &mut dyn Observer,
        then: impl FnOnce(&Capture<'_>, &dyn Executor) -> T,
    ) -> Result<T, Error> {
        let exec = At::new(&*self.exec, self.simd);
        let capture = capture::run(&*self.engine, frame, options, &exec, &mut self.workspace, observer)?;
        Ok(then(&capture, &exec))
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &Model<'_> {
        self.engine.model()
    }

    /// Pixels per side of the maps.
    #[must_use]
    pub fn size(&self) -> usize {
        self.engine.size()
    }

    /// The CPU level in use.
    #[must_use]
    pub fn level(&self) -> Level {
        self.level
    }

    /// Bytes of the workspace.
    #[must_use]
    pub fn workspace_bytes(&self) -> usize {
        self.workspace.len()
    }
}

/// The level asked for, if this CPU has it; the fastest one otherwise.
fn level(wanted: Option<Level>) -> Result<Level, Error> {
    #[cfg(feature = "std")]
    let fastest = Level::detect();
    #[cfg(not(feature = "std"))]
    let fastest = Level::baseline();
    wanted.map_or(Ok(fastest), |wanted| fastest.lowered_to(wanted))
}

#[cfg(feature = "parallel")]
fn executor(threads: usize) -> Result<Box<dyn Executor + Send>, Error> {
    if threads == 1 {
        return Ok(Box::new(Inline));
    }
    Ok(Box::new(crate::base::exec::Pool::new(threads)?))
}

#[cfg(not(feature = "parallel"))]
fn executor(threads: usize) -> Result<Box<dyn Executor + Send>, Error> {
    if threads <= 1 { Ok(Box::new(Inline)) } else { Err(Error::Threads) }
}
