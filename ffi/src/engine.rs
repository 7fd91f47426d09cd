//! Engines: create, ask, capture, cancel, destroy.
#![expect(unsafe_code, reason = "unmangled names")]

use crate::failure::Failure;
use crate::guard::guard;
use crate::handle::{self, flashmat_engine};
use crate::input::{self, Progress};
use crate::model::ModelBytes;
use crate::output::{self, Outputs};
use crate::ptr::{self, Out, OutStruct};
use crate::status::flashmat_status;
use crate::types::{
    flashmat_capture_options, flashmat_engine_info, flashmat_engine_options, flashmat_frame, flashmat_maps,
    flashmat_report,
};
use core::ptr::null_mut;
use flashmat_core::SessionOptions;

/// Most threads that an engine takes.
const MAX_THREADS: u32 = 256;

/// Makes an engine. It takes all its memory now; captures take none.
///
/// options: NULL for the defaults (then the library must have a model embedded). The model is copied: the caller's
/// bytes may go when the call returns.
/// engine: receives the engine, or NULL when the call fails. Owner: the caller, who gives it back with
/// flashmat_engine_destroy.
/// Threads: any.
/// Errors: NULL_POINTER, MISALIGNED, STRUCT_SIZE, UNKNOWN_VALUE, INVALID_ARGUMENT, NO_MODEL, MODEL, SIZE, LEVEL,
/// THREADS, OUT_OF_MEMORY.
#[unsafe(no_mangle)]
pub extern "C" fn flashmat_engine_create(
    options: *const flashmat_engine_options,
    engine: *mut *mut flashmat_engine,
) -> flashmat_status {
    guard(|| {
        let out = Out::new(engine, "engine")?;
        out.write(null_mut());
        let options = ptr::read_optional(options, "options")?.unwrap_or(ENGINE_DEFAULTS);
        if options.threads > MAX_THREADS {
            let (given, status) = (options.threads, flashmat_status::InvalidArgument);
            return Err(Failure::new(status, format_args!("threads: {given}, at most {MAX_THREADS}")));
        }
        let session = SessionOptions {
            size: input::size(options.size),
            level: input::level(options.level)?,
            threads: options.threads as usize,
        };
        let model = ModelBytes::new(options.model, options.model_bytes)?;
        out.write(flashmat_engine::new(&model, &session)?.into_raw());
        Ok(())
    })
}

const ENGINE_DEFAULTS: flashmat_engine_options = flashmat_engine_options {
    struct_size: size_of::<flashmat_engine_options>() as u32,
    size: 0,
    level: 0,
    threads: 0,
    model: core::ptr::null(),
    model_bytes: 0,
};

/// Frees an engine and all its memory. NULL is allowed and does nothing.
///
/// The handle is invalid from then on. A capture that runs on it in another thread (or that called this from its
/// progress function) is cancelled, and the engine freed at its end.
/// Threads: any, once.
#[unsafe(no_mangle)]
pub extern "C" fn flashmat_engine_destroy(engine: *mut flashmat_engine) {
    guard(|| {
        handle::destroy(engine);
        Ok(())
    });
}

/// Tells what an engine is.
///
/// info: the caller's, its struct_size set; written on success.
/// Threads: any, also during a capture.
/// Errors: NULL_POINTER, MISALIGNED, STRUCT_SIZE.
#[unsafe(no_mangle)]
pub extern "C" fn flashmat_engine_get_info(
    engine: *const flashmat_engine,
    info: *mut flashmat_engine_info,
) -> flashmat_status {
    guard(|| {
        let engine = handle::borrow(engine)?;
        let info = OutStruct::required(info, "info")?;
        info.write(&flashmat_engine_info {
            struct_size: 0,
            size: engine.size() as u32,
            level: input::level_code(engine.level()),
            model_checksum: engine.checksum(),
            workspace_bytes: engine.workspace_bytes() as u64,
        });
        Ok(())
    })
}

/// One photo to material maps. Allocates nothing on the calling thread; takes a good part of a second on a phone.
///
/// frame: the photo; read during the call alone.
/// options: NULL for the defaults.
/// maps: where the maps go; written on success alone.
/// report: where class, light and errors of fit go; NULL: not wanted.
/// Owner of everything but the engine: the caller.
/// Threads: any, but one capture at a time on an engine; a second one returns BUSY and leaves the first alone. The
/// progress function is called on this thread.
/// Errors: NULL_POINTER, MISALIGNED, STRUCT_SIZE, UNKNOWN_VALUE, INVALID_ARGUMENT, BUFFER_TOO_SMALL, BUSY, CANCELLED,
/// POISONED, FRAME_EMPTY, FRAME_TOO_LARGE, FRAME_STRIDE, FRAME_BUFFER, FRAME_PIXEL, FIELD_OF_VIEW, NO_USABLE_PIXELS,
/// PHOTO_BLACK, INTERNAL.
#[unsafe(no_mangle)]
pub extern "C" fn flashmat_capture(
    engine: *mut flashmat_engine,
    frame: *const flashmat_frame,
    options: *const flashmat_capture_options,
    maps: *const flashmat_maps,
    report: *mut flashmat_report,
) -> flashmat_status {
    guard(|| {
        let size = handle::borrow(engine)?.size();
        let frame = input::frame(&ptr::read_struct(frame, "frame")?)?;
        let options = ptr::read_optional(options, "options")?;
        let chosen = input::capture_options(options.as_ref())?;
        let mut outputs = Outputs::new(&ptr::read_struct(maps, "maps")?, size)?;
        let report = OutStruct::optional(report, "report")?;
        handle::run(engine, |session, control| {
            let mut progress = Progress { options, stop: || control.stop() };
            session.capture_then(&frame, &chosen, &mut progress, |capture, exec| {
                control.commit()?;
                outputs.write(capture, exec)?;
                report.write(&output::report(capture));
                Ok(())
            })?
        })
    })
}

/// Stops the capture that runs on the engine in another thread: it returns CANCELLED within a few milliseconds to tens
/// of them, and writes no results. Does not wait for that.
///
/// Returns IDLE, and does nothing, when no capture runs: one that is about to start, or that writes its results
/// already, is not affected. OK means that the capture will return CANCELLED, whatever it is at. To cancel without that
/// race, return a number other than 0 from the progress function, which is called before any work is done.
/// Threads: any; touches one atomic.
/// Errors: NULL_POINTER, IDLE.
#[unsafe(no_mangle)]
pub extern "C" fn flashmat_cancel(engine: *const flashmat_engine) -> flashmat_status {
    guard(|| handle::cancel(engine))
}
