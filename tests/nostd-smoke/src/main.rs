//! The whole int8 pipeline on one frame, from static memory: no std, no heap, no operating system but an exit code.
//!
//! `std` sneaking into flashmat-core would be a second panic handler, which does not link. libc's start-up code calls
//! `main`; nothing else of libc is used.
#![no_std]
#![no_main]

use core::ffi::c_int;
use core::panic::PanicInfo;
use flashmat_core::base::exec::Inline;
use flashmat_core::frame::Frame;
use flashmat_core::base::simd::Level;
use flashmat_core::kernels::Kernels;
use flashmat_core::net::Model;
use flashmat_core::capture::{CaptureOptions, Pipeline};
use flashmat_core::{Error, Silent};

/// The toy model of the golden files.
static MODEL: &[u8] = include_bytes!("../../golden/toy.fmat");
const SIZE: usize = 128;
const WORKSPACE: usize = 32 << 20;
const SIDE: usize = 160;

/// Memory of the whole run.
#[repr(align(64))]
struct Arena<const N: usize>([u8; N]);

static mut WORK: Arena<WORKSPACE> = Arena([0; WORKSPACE]);
static mut PHOTO: [u8; 3 * SIDE * SIDE] = [0; 3 * SIDE * SIDE];

#[panic_handler]
fn panic(_: &PanicInfo<'_>) -> ! {
    // SAFETY: abort takes nothing and does not return.
    unsafe { abort() }
}

/// The prebuilt libcore names it in its unwind tables; nothing unwinds here.
#[unsafe(no_mangle)]
extern "C" fn rust_eh_personality() {}

#[link(name = "c")]
unsafe extern "C" {
    fn abort() -> !;
}

/// Returns 0 when the maps are where maps live, else the number of what is wrong.
#[unsafe(no_mangle)]
extern "C" fn main(_: c_int, _: *const *const u8) -> c_int {
    // SAFETY: this program has one thread, and `main` is called once: nobody else holds these references.
    let (work, photo) = unsafe { (&mut *(&raw mut WORK.0), &mut *(&raw mut PHOTO)) };
    match capture(work, photo) {
        Ok(code) => code,
        Err(Error::WorkspaceTooSmall { .. }) => 10,
        Err(_) => 11,
    }
}

fn capture(work: &mut [u8], photo: &mut [u8]) -> Result<c_int, Error> {
    // A checked surface under a flash: brighter in the middle.
    for (i, pixel) in photo.chunks_exact_mut(3).enumerate() {
        let (x, y) = ((i % SIDE) as i32 - 80, (i / SIDE) as i32 - 80);
        let light = (200 - (x * x + y * y) / 80) as u8;
        let dark = if (i % SIDE / 16 + i / SIDE / 16).is_multiple_of(2) { 1 } else { 2 };
        pixel.copy_from_slice(&[light / dark, light / dark / 2, light / 4]);
    }
    let model = Model::from_bytes(MODEL)?;
    let pipeline = Pipeline::new(model, SIZE, Kernels::for_level(Level::baseline())?)?;
    let frame = Frame::rgb8(photo, SIDE, SIDE, 3 * SIDE)?;
    let capture = pipeline.run(&frame, &CaptureOptions::default(), &Inline, work, &mut Silent)?;
    let unit = |v: &f32| (0.0..=1.0).contains(v);
    let plane = SIZE * SIZE;
    let normals = (0..plane).all(|i| {
        let n = [0, 1, 2].map(|c| capture.maps.normal.get(c * plane + i).copied().unwrap_or(0.0));
        (n.iter().map(|v| v * v).sum::<f32>() - 1.0).abs() < 1e-3
    });
    Ok(if !capture.maps.albedo.iter().all(unit) {
        1
    } else if !capture.maps.roughness.iter().all(unit) {
        2
    } else if !normals {
        3
    } else if !(capture.light_scale > 0.0 && capture.residual.is_finite()) {
        4
    } else {
        0
    })
}
