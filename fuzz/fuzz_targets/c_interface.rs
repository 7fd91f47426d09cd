//! The C interface: calls decoded from bytes, with structs, sizes, numbers and pointers that lie as far as a caller
//! may. Every pointer that is given has the memory that it promises, to the byte, so that AddressSanitizer sees what
//! reads or writes beyond.
#![no_main]

use flashmat::{
    flashmat_buffer, flashmat_cancel, flashmat_capture, flashmat_capture_in, flashmat_capture_options,
    flashmat_class_name, flashmat_engine, flashmat_engine_create, flashmat_engine_destroy,
    flashmat_engine_get_info, flashmat_engine_info, flashmat_engine_options, flashmat_export_glb,
    flashmat_frame, flashmat_last_error, flashmat_level_name, flashmat_maps, flashmat_plane, flashmat_report,
    flashmat_stage_name, flashmat_status, flashmat_status_name, flashmat_status_text,
    flashmat_workspace_bytes,
};
use flashmat_fuzz::{Bytes, TOY};
use libfuzzer_sys::fuzz_target;
use std::ffi::{CStr, CString, c_char, c_void};
use std::ptr::{null, null_mut};

/// A struct of C as bytes: its own size, or that of a newer header, zeros or not behind what is known.
struct Struct(Vec<u64>);

impl Struct {
    fn new<T: Copy>(bytes: &mut Bytes<'_>, value: T) -> Self {
        let own = size_of::<T>();
        let size = match bytes.u8() {
            0..=239 => own,
            240..=247 => own + usize::from(bytes.u8()),
            248..=250 => usize::from(bytes.u8()),
            _ => bytes.u16().into(),
        };
        let mut memory = vec![0_u64; size.max(own).div_ceil(8)];
        // SAFETY: the memory has at least the struct's size and alignment.
        unsafe { memory.as_mut_ptr().cast::<T>().write(value) };
        let mut made = Self(memory);
        made.0[0] = made.0[0] & !0xFFFF_FFFF | size as u64;
        if size > own && bytes.u8() > 200 {
            *made.0.last_mut().expect("not empty") = 1;
        }
        made
    }

    fn at<T>(&mut self) -> *mut T {
        self.0.as_mut_ptr().cast()
    }
}

/// `pointer`, rarely NULL instead.
fn maybe<T>(bytes: &mut Bytes<'_>, pointer: *mut T) -> *mut T {
    if bytes.u8() == 255 { null_mut() } else { pointer }
}

/// Memory that ends with its content, aligned to 8 or moved by up to 7.
struct Exact {
    memory: Vec<u8>,
    off: usize,
    len: usize,
}

impl Exact {
    fn new(bytes: &mut Bytes<'_>, content: &[u8]) -> Self {
        let off = if bytes.u8() < 240 { 0 } else { usize::from(bytes.u8()) % 8 };
        // malloc aligns to 16, so that nothing has to be left over at the end.
        let mut memory = Vec::with_capacity(off + content.len());
        memory.resize(off, 0);
        memory.extend_from_slice(content);
        Self { memory, off, len: content.len() }
    }

    fn at(&mut self) -> *mut c_void {
        self.memory[self.off..].as_mut_ptr().cast()
    }
}

fn text(pointer: *const c_char) {
    assert!(!pointer.is_null());
    // SAFETY: texts end with NUL and live until the next call of the thread.
    unsafe { CStr::from_ptr(pointer) }.to_str().expect("UTF-8");
}

fn engine_options(bytes: &mut Bytes<'_>, model: &mut Exact) -> flashmat_engine_options {
    let model_bytes = if bytes.u8() < 240 { model.len } else { model.len.min(usize::from(bytes.u16())) };
    let size = bytes.code(&[128, 128, 128, 0, 64, 100]);
    flashmat_engine_options {
        struct_size: 0,
        // Large maps are honest, but slow.
        size: if (257..=8192).contains(&size) { 256 } else { size },
        level: bytes.code(&[0, 1, 2, 3, 4]),
        threads: bytes.code(&[1, 1, 1, 2, 300]),
        model: maybe(bytes, model.at()),
        model_bytes,
    }
}

extern "C" fn progress(user: *mut c_void, stage: u32, fraction: f32) -> i32 {
    assert!(stage < 16 && (0.0..=1.0).contains(&fraction), "stage {stage}, fraction {fraction}");
    // SAFETY: `user` is the countdown that the caller keeps during the capture.
    let left = unsafe { &mut *user.cast::<i32>() };
    *left -= 1;
    i32::from(*left == 0)
}

/// A frame and the memory of its planes.
fn frame(bytes: &mut Bytes<'_>) -> (flashmat_frame, Vec<Exact>) {
    let format = bytes.code(&[1, 2, 3, 4, 5, 6, 7, 8]);
    let (width, height) = (1 + usize::from(bytes.u8()) % 160, 1 + usize::from(bytes.u8()) % 160);
    let used = match format {
        6 | 7 => 2,
        8 => 3,
        _ => 1,
    };
    let yuv = format >= 6 && format <= 8;
    let none = flashmat_plane { data: null(), bytes: 0, row_stride: 0, pixel_stride: 0 };
    let mut frame = flashmat_frame {
        struct_size: 0,
        format,
        width: bytes.amount(width) as u32,
        height: bytes.amount(height) as u32,
        rotation: bytes.code(&[0, 90, 180, 270]),
        encoding: bytes.code(&[0, 1, 2, 3]),
        yuv_matrix: if yuv { bytes.code(&[0, 1, 2]) } else { bytes.code(&[0]) },
        yuv_range: if yuv { bytes.code(&[0, 1, 2]) } else { bytes.code(&[0]) },
        planes: [none; 3],
    };
    let mut memory = Vec::new();
    for index in 0..used {
        let (w, h) = if index == 0 { (width, height) } else { (width.div_ceil(2), height.div_ceil(2)) };
        let step = match (format, index) {
            (1, _) => 3,
            (2 | 3, _) => 4,
            (4, _) => 6,
            (5, _) => 12,
            (6 | 7, 1) => 2,
            _ => 1,
        };
        let stride = bytes.amount(w * step);
        let len = bytes.amount(stride.saturating_mul(h - 1).saturating_add(w * step)).min(1 << 19);
        let content = bytes.fill(len);
        let floats: Vec<u8> =
            content.chunks_exact(4).flat_map(|v| (f32::from(v[0]) / 255.0).to_le_bytes()).collect();
        let mut plane = Exact::new(bytes, if format == 5 { &floats } else { &content });
        frame.planes[index] = flashmat_plane {
            data: maybe(bytes, plane.at()),
            bytes: plane.len,
            row_stride: stride,
            pixel_stride: bytes.amount(0),
        };
        memory.push(plane);
    }
    if bytes.u8() == 255 {
        frame.planes[2].row_stride = 7;
    }
    (frame, memory)
}

fn capture_options(bytes: &mut Bytes<'_>, countdown: &mut i32) -> flashmat_capture_options {
    let mut real = |low, high| if bytes.u8() < 190 { 0.0 } else { bytes.real(low, high) };
    let (photo_fov_deg, focal_35mm, target_fov_deg, light_scale) =
        (real(1.0, 170.0), real(4.0, 200.0), real(1.0, 170.0), real(1e-3, 1e3));
    flashmat_capture_options {
        struct_size: 0,
        class_override: bytes.code(&[0, 0, 0, 1, 4, 8]),
        skip_refinement: bytes.code(&[1, 1, 1, 1, 1, 1, 1, 0]),
        photo_fov_deg,
        focal_35mm,
        target_fov_deg,
        progress: if bytes.u8() < 128 { Some(progress) } else { None },
        user: (&raw mut *countdown).cast(),
        light_scale,
    }
}

/// Results in exact memory, some of them not wanted, some too small.
fn maps(bytes: &mut Bytes<'_>, size: usize) -> (flashmat_maps, Vec<Exact>) {
    let format = bytes.code(&[0, 1]);
    let value = if format == 1 { 1 } else { 4 };
    let mut memory = Vec::new();
    let mut buffer = |channels: usize| {
        if bytes.u8() > 180 {
            return flashmat_buffer { data: null_mut(), bytes: 0 };
        }
        let len = bytes.amount(channels * size * size * value).min(1 << 20);
        let mut result = Exact::new(bytes, &vec![0xA5; len]);
        let made = flashmat_buffer { data: maybe(bytes, result.at()), bytes: len };
        memory.push(result);
        made
    };
    let maps = flashmat_maps {
        struct_size: 0,
        format,
        albedo: buffer(3),
        normal: buffer(3),
        roughness: buffer(1),
        render: buffer(3),
        photo: buffer(3),
        observability: buffer(1),
    };
    (maps, memory)
}

fn report() -> flashmat_report {
    // SAFETY: integers and floats; zeros are values of all of them.
    unsafe { std::mem::zeroed() }
}

/// One capture, on `engine` or, with `workspace`, in the caller's memory.
fn run(bytes: &mut Bytes<'_>, engine: *mut flashmat_engine, model: &mut Exact) -> flashmat_status {
    let mut countdown = i32::from(bytes.u8() % 24);
    let (frame, _planes) = frame(bytes);
    let (maps, _results) = maps(bytes, 128);
    let options = capture_options(bytes, &mut countdown);
    let mut frame = Struct::new(bytes, frame);
    let mut options = Struct::new(bytes, options);
    let mut maps = Struct::new(bytes, maps);
    let mut report = Struct::new(bytes, report());
    let (frame, options, maps, report) = (
        maybe(bytes, frame.at::<flashmat_frame>()),
        maybe(bytes, options.at::<flashmat_capture_options>()),
        maybe(bytes, maps.at::<flashmat_maps>()),
        maybe(bytes, report.at::<flashmat_report>()),
    );
    if bytes.u8() < 192 {
        return flashmat_capture(maybe(bytes, engine), frame, options, maps, report);
    }
    let given = engine_options(bytes, model);
    let mut given = Struct::new(bytes, given);
    let mut needed = 0_usize;
    let told = flashmat_workspace_bytes(given.at(), maybe(bytes, &raw mut needed));
    if told == flashmat_status::Ok {
        assert!(needed > 0);
    }
    let len = bytes.amount(needed).min(24 << 20);
    let mut workspace = Exact::new(bytes, &vec![0xA5; len]);
    flashmat_capture_in(given.at(), maybe(bytes, workspace.at()), len, frame, options, maps, report)
}

/// Reads what it is given, and stops when the countdown ends.
extern "C" fn write(user: *mut c_void, data: *const c_void, len: usize) -> i32 {
    // SAFETY: `user` is the countdown and the sum that the caller keeps during the export.
    let (left, sum) = unsafe { &mut *user.cast::<(i32, u64)>() };
    // SAFETY: the library promises `len` bytes at `data`.
    let part = unsafe { std::slice::from_raw_parts(data.cast::<u8>(), len) };
    *sum += part.iter().map(|&v| u64::from(v)).sum::<u64>();
    *left -= 1;
    i32::from(*left == 0)
}

/// Maps of up to 16 x 16 as a GLB.
fn export(bytes: &mut Bytes<'_>) -> flashmat_status {
    let size = 1 + usize::from(bytes.u8()) % 16;
    let (maps, _memory) = maps(bytes, size);
    let mut maps = Struct::new(bytes, maps);
    let report = flashmat_report { f0: bytes.real(0.0, 0.9), fov_deg: bytes.real(1.0, 170.0), ..report() };
    let mut report = Struct::new(bytes, report);
    let name: Vec<u8> = (0..bytes.u8() % 24).map(|_| bytes.u8().max(1)).collect();
    let name = CString::new(name).expect("no NUL");
    let mut progress = (i32::from(bytes.u8() % 8), 0_u64);
    flashmat_export_glb(
        bytes.amount(size) as u32,
        maybe(bytes, maps.at()),
        maybe(bytes, report.at()),
        maybe(bytes, name.as_ptr().cast_mut()),
        if bytes.u8() == 255 { None } else { Some(write) },
        (&raw mut progress).cast(),
    )
}

fuzz_target!(|data: &[u8]| {
    let mut bytes = Bytes::new(data);
    let mut file = TOY.to_vec();
    if bytes.u8() > 240 {
        let at = usize::from(bytes.u16());
        file[at] ^= 1 << (bytes.u8() % 8);
    }
    let mut model = Exact::new(&mut bytes, &file);
    let mut engine: *mut flashmat_engine = null_mut();
    for _ in 0..12 {
        if bytes.is_empty() {
            break;
        }
        let status = match bytes.u8() % 8 {
            0 | 1 => {
                flashmat_engine_destroy(engine);
                engine = null_mut();
                let options = engine_options(&mut bytes, &mut model);
                let mut options = Struct::new(&mut bytes, options);
                let status = flashmat_engine_create(options.at(), maybe(&mut bytes, &raw mut engine));
                assert!(engine.is_null() || status == flashmat_status::Ok, "an engine, yet {status:?}");
                status
            }
            2 => {
                let mut info = Struct::new(
                    &mut bytes,
                    flashmat_engine_info {
                        struct_size: 0,
                        size: 0,
                        level: 0,
                        model_checksum: 0,
                        workspace_bytes: 0,
                    },
                );
                flashmat_engine_get_info(maybe(&mut bytes, engine), maybe(&mut bytes, info.at()))
            }
            3 => flashmat_cancel(maybe(&mut bytes, engine)),
            4 => {
                let number = bytes.u32();
                for name in [flashmat_class_name, flashmat_stage_name, flashmat_level_name] {
                    text(name(number));
                    text(name(number % 12));
                }
                text(flashmat_status_name(number.cast_signed()));
                text(flashmat_status_text(number.cast_signed() % 40));
                flashmat_status::Ok
            }
            5 => export(&mut bytes),
            _ => run(&mut bytes, engine, &mut model),
        };
        text(flashmat_last_error());
        // A panic would end there: it is a bug, wherever it came from.
        assert!(!matches!(status, flashmat_status::Internal | flashmat_status::Poisoned), "{status:?}");
    }
    flashmat_engine_destroy(engine);
});
