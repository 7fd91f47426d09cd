//! Captures without an engine, in the caller's memory: no heap, no threads, any target.
#![expect(unsafe_code, reason = "unmangled names")]

use crate::failure::Failure;
use crate::guard::guard;
use crate::input::{self, Progress};
use crate::model::ModelBytes;
use crate::output::{self, Outputs};
use crate::ptr::{self, Out, OutStruct};
use crate::status::flashmat_status;
use crate::types::{
    flashmat_capture_options, flashmat_engine_options, flashmat_frame, flashmat_maps, flashmat_report,
};
use core::ffi::c_void;
use flashmat_core::base::exec::Inline;
use flashmat_core::base::simd::Level;
use flashmat_core::capture::Pipeline;
use flashmat_core::kernels::Kernels;
use flashmat_core::net::Model;

/// The model, size and level of the options, planned.
fn pipeline<'a>(options: &flashmat_engine_options) -> Result<(ModelBytes<'a>, Pipeline<'a>), Failure> {
    if options.threads > 1 {
        let text = format_args!("threads: {}; this call has one", options.threads);
        return Err(Failure::new(flashmat_status::InvalidArgument, text));
    }
    #[cfg(feature = "std")]
    let fastest = Level::detect();
    #[cfg(not(feature = "std"))]
    let fastest = Level::baseline();
    let level = input::level(options.level)?.map_or(Ok(fastest), |level| fastest.lowered_to(level))?;
    let bytes = ModelBytes::new(options.model, options.model_bytes)?;
    let model = Model::from_bytes(bytes.as_slice())?;
    Ok((bytes, Pipeline::new(model, input::size(options.size), Kernels::for_level(level)?)?))
}

/// Tells how much memory flashmat_capture_in needs with these options.
///
/// options: model, size and level as for an engine; threads 0 or 1. Nothing is kept of it.
/// bytes: the caller's; written on success.
/// Threads: any.
/// Errors: NULL_POINTER, MISALIGNED, STRUCT_SIZE, UNKNOWN_VALUE, INVALID_ARGUMENT, NO_MODEL, MODEL, SIZE, LEVEL.
#[unsafe(no_mangle)]
pub extern "C" fn flashmat_workspace_bytes(
    options: *const flashmat_engine_options,
    bytes: *mut usize,
) -> flashmat_status {
    guard(|| {
        let out = Out::new(bytes, "bytes")?;
        let (_, pipeline) = pipeline(&ptr::read_struct(options, "options")?)?;
        out.write(pipeline.workspace_bytes());
        Ok(())
    })
}

/// One photo to material maps without an engine: works in the caller's memory, allocates nothing, keeps nothing, uses
/// the calling thread alone. The same results as flashmat_capture. Checks the model each time (milliseconds).
///
/// engine_options: model, size and level as for an engine; threads 0 or 1. The model is read during the call alone.
/// workspace, workspace_bytes: the caller's memory, flashmat_workspace_bytes of it or more, any alignment; must overlap
/// nothing else that is given. What it holds afterwards is of no use.
/// frame, options, maps, report: as for flashmat_capture. The progress function is the only way to cancel.
/// Threads: any; calls at the same time need a workspace each.
/// Errors: as flashmat_capture and flashmat_workspace_bytes, and WORKSPACE_TOO_SMALL.
#[unsafe(no_mangle)]
pub extern "C" fn flashmat_capture_in(
    engine_options: *const flashmat_engine_options,
    workspace: *mut c_void,
    workspace_bytes: usize,
    frame: *const flashmat_frame,
    options: *const flashmat_capture_options,
    maps: *const flashmat_maps,
    report: *mut flashmat_report,
) -> flashmat_status {
    guard(|| {
        let (model, pipeline) = pipeline(&ptr::read_struct(engine_options, "engine_options")?)?;
        let c_frame = ptr::read_struct(frame, "frame")?;
        let frame = input::frame(&c_frame)?;
        let options = ptr::read_optional(options, "options")?;
        let chosen = input::capture_options(options.as_ref())?;
        let c_maps = ptr::read_struct(maps, "maps")?;
        let size = input::size(ptr::read_struct(engine_options, "engine_options")?.size);
        let mut outputs = Outputs::new(&c_maps, size)?;
        let out = OutStruct::optional(report, "report")?;
        let needed = pipeline.workspace_bytes();
        if workspace_bytes < needed {
            return Err(flashmat_core::Error::WorkspaceTooSmall { needed, available: workspace_bytes }.into());
        }
        let memory = ptr::workspace(workspace, workspace_bytes, &others(&model, &c_frame, &c_maps, report))?;
        let mut observer = Progress { options, stop: || false };
        let capture = pipeline.run(&frame, &chosen, &Inline, memory, &mut observer)?;
        outputs.write(&capture, &Inline)?;
        out.write(&output::report(&capture));
        Ok(())
    })
}

/// Address and bytes of everything that is borrowed while the workspace is, or written while results lie in it.
fn others(
    model: &ModelBytes<'_>,
    frame: &flashmat_frame,
    maps: &flashmat_maps,
    report: *mut flashmat_report,
) -> [(usize, usize); 11] {
    let model = model.as_slice();
    let plane = |index: usize| (frame.planes[index].data.addr(), frame.planes[index].bytes);
    let [a, b, c, d, e, f] = output::buffers(maps).map(|buffer| (buffer.data.addr(), buffer.bytes));
    let report = (report.addr(), if report.is_null() { 0 } else { size_of::<flashmat_report>() });
    [(model.as_ptr().addr(), model.len()), plane(0), plane(1), plane(2), a, b, c, d, e, f, report]
}
