//! What crosses the border: `#[repr(C)]` structs, and the numbers of enumerations.
//!
//! A zero (or NULL) in any field means its default, so that a zeroed struct with its `struct_size` set is complete and
//! old programs keep working when fields are added at the end. Sizes and offsets are asserted at compile time.
use core::ffi::c_void;

/// A call that tells how far a capture is: `fraction` of `stage` (flashmat_stage) is done. Return 0 to go on, anything
/// else to cancel the capture, which then returns FLASHMAT_STATUS_CANCELLED.
///
/// Called on the thread that runs the capture, several times a stage, first before any work is done. It may call
/// flashmat_cancel; a capture on the same engine returns FLASHMAT_STATUS_BUSY. It must not throw C++ exceptions or
/// longjmp out of the library.
pub type flashmat_progress = Option<extern "C" fn(user: *mut c_void, stage: u32, fraction: f32) -> i32>;

/// Takes the next `bytes` bytes of a file, which are at `data` during the call alone. Return 0 to go on, anything else
/// to stop: the export then returns FLASHMAT_STATUS_CANCELLED. It must not throw C++ exceptions or longjmp out of
/// the library.
pub type flashmat_write = Option<extern "C" fn(user: *mut c_void, data: *const c_void, bytes: usize) -> i32>;

/// How pixels lie in memory.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum flashmat_format {
    /// planes[0]: R, G, B, 8 bits each.
    Rgb8 = 1,
    /// planes[0]: R, G, B, A, 8 bits each; A is not read.
    Rgba8 = 2,
    /// planes[0]: B, G, R, A, 8 bits each; A is not read.
    Bgra8 = 3,
    /// planes[0]: R, G, B, 16 bits each in native byte order.
    Rgb16 = 4,
    /// planes[0]: R, G, B as float, 0 to 1; above 1 is taken as 1. Linear unless `encoding` says otherwise.
    RgbF32 = 5,
    /// planes[0]: Y; planes[1]: U and V interleaved, half as wide and high, rounded up.
    Nv12 = 6,
    /// planes[0]: Y; planes[1]: V and U interleaved.
    Nv21 = 7,
    /// planes[0], [1], [2]: Y, U, V with any pixel stride (I420, Android's YUV_420_888); U and V have the same strides.
    Yuv420 = 8,
}

/// How the photo must be turned, clockwise, to stand upright.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum flashmat_rotation {
    /// Upright as it is (EXIF orientation 1).
    None = 0,
    /// A quarter turn clockwise (EXIF orientation 6).
    Cw90 = 90,
    /// Half a turn (EXIF orientation 3).
    Cw180 = 180,
    /// A quarter turn counter-clockwise (EXIF orientation 8).
    Cw270 = 270,
}

/// What the values of pixels mean.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum flashmat_encoding {
    /// sRGB; linear for FLASHMAT_FORMAT_RGB_F32.
    Default = 0,
    /// sRGB curve and primaries.
    Srgb = 1,
    /// Linear light, sRGB primaries.
    Linear = 2,
    /// sRGB curve, Display P3 primaries; colours outside sRGB are clamped.
    DisplayP3 = 3,
}

/// Luma equation of YUV formats.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum flashmat_yuv_matrix {
    /// BT.601.
    Default = 0,
    /// JPEG, Android's default.
    Bt601 = 1,
    /// HD video, iOS's default.
    Bt709 = 2,
}

/// Which codes black and white have in YUV formats.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum flashmat_yuv_range {
    /// Full.
    Default = 0,
    /// Luma 0 to 255 (JPEG).
    Full = 1,
    /// Luma 16 to 235 (video).
    Limited = 2,
}

/// Material classes. `probabilities[c - 1]` of a report belongs to class c.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum flashmat_class {
    /// Let the network decide (in options only).
    Auto = 0,
    /// Woven and knitted cloth.
    Fabric = 1,
    /// Soil, grass, gravel.
    Ground = 2,
    /// Leather.
    Leather = 3,
    /// Metal.
    Metal = 4,
    /// Diffuse stone.
    StoneDiff = 5,
    /// Polished stone.
    StoneSpec = 6,
    /// Plastics and paint.
    Polymer = 7,
    /// Wood.
    Wood = 8,
}

/// Instruction sets. All give the same results, bit for bit.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum flashmat_level {
    /// The fastest that this CPU has (bare metal: that every CPU of the target has).
    Auto = 0,
    /// Any CPU.
    Scalar = 1,
    /// x86-64 with AVX2.
    Avx2 = 2,
    /// x86-64 with AVX-512 F, BW, VL and VNNI.
    Avx512Vnni = 3,
    /// AArch64.
    Neon = 4,
    /// AArch64 with the dot-product extension.
    DotProd = 5,
    /// AArch64 with the int8 matrix-multiply extension.
    I8mm = 6,
}

/// Stages of a capture, in their order.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum flashmat_stage {
    /// Photo to linear RGB at the maps' size.
    Frame = 0,
    /// The network: class probabilities and first maps.
    Global = 1,
    /// Where the flash is beside the camera.
    Flash = 2,
    /// Albedo below highlights.
    Highlight = 3,
    /// Refinement of the albedo.
    Albedo = 4,
    /// Texture of the albedo that a highlight burnt out.
    Texture = 5,
    /// Refinement of the normals.
    Normal = 6,
    /// Light scale and roughness search.
    Search = 7,
    /// Refinement of the roughness.
    Roughness = 8,
    /// Roughness below highlights.
    Level = 9,
    /// Re-render, lights and residual.
    Relight = 10,
}

/// How results are written. Rows from the top, without padding, size x size pixels.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum flashmat_map_format {
    /// float, one plane per channel, plane after plane. Albedo, render, photo: linear light, sRGB primaries. Normal:
    /// x, y, z of unit vectors. Bytes: channels * size * size * 4.
    F32 = 0,
    /// uint8_t, channels interleaved, as image files have it. Albedo, render, photo: sRGB-encoded. Normal: (n + 1) / 2.
    /// Roughness, observability: linear. Bytes: channels * size * size.
    U8 = 1,
}

/// One plane of a photo.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct flashmat_plane {
    /// First pixel of the first row. Aligned to the format's values (16 bits: 2, float: 4 bytes).
    pub data: *const c_void,
    /// Bytes that may be read from there on.
    pub bytes: usize,
    /// Bytes from row to row; 0: rows follow each other without padding.
    pub row_stride: usize,
    /// Bytes from pixel to pixel; 0: the format's own. Only FLASHMAT_FORMAT_YUV420 takes others.
    pub pixel_stride: usize,
}

/// A photo, in the caller's memory, which the library reads during the call alone and never writes.
/// No other thread may write to it meanwhile.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct flashmat_frame {
    /// sizeof(flashmat_frame).
    pub struct_size: u32,
    /// flashmat_format.
    pub format: u32,
    /// Pixels across as stored, before the rotation.
    pub width: u32,
    /// Pixels down as stored.
    pub height: u32,
    /// flashmat_rotation.
    pub rotation: u32,
    /// flashmat_encoding.
    pub encoding: u32,
    /// flashmat_yuv_matrix; 0 for RGB formats.
    pub yuv_matrix: u32,
    /// flashmat_yuv_range; 0 for RGB formats.
    pub yuv_range: u32,
    /// As many as the format has; the others zero.
    pub planes: [flashmat_plane; 3],
}

/// What an engine is made for.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct flashmat_engine_options {
    /// sizeof(flashmat_engine_options).
    pub struct_size: u32,
    /// Pixels per side of the maps, a multiple of 128; 0: 256.
    pub size: u32,
    /// flashmat_level. One that the CPU does not have is an error.
    pub level: u32,
    /// Threads to work with, at most 256; 0: one per CPU. Results do not depend on it.
    pub threads: u32,
    /// A model file's bytes; no alignment needed. NULL: the model embedded in the library, if it was built with one.
    pub model: *const c_void,
    /// Bytes of the model.
    pub model_bytes: usize,
}

/// What an engine is.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct flashmat_engine_info {
    /// sizeof(flashmat_engine_info), set by the caller.
    pub struct_size: u32,
    /// Pixels per side of the maps.
    pub size: u32,
    /// flashmat_level in use.
    pub level: u32,
    /// CRC-32 of the model file.
    pub model_checksum: u32,
    /// Bytes that a capture works in; the engine holds them for its whole life, besides a copy of the model.
    pub workspace_bytes: u64,
}

/// What a caller may choose for one capture.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct flashmat_capture_options {
    /// sizeof(flashmat_capture_options).
    pub struct_size: u32,
    /// flashmat_class that the material is of; FLASHMAT_CLASS_AUTO: the network decides.
    pub class_override: u32,
    /// 1: the network's maps as they are, without refinement; 0: refined.
    pub skip_refinement: u32,
    /// Field of view of the photo over its shorter side, in degrees; 0: not known, or given by the focal length.
    pub photo_fov_deg: f32,
    /// Focal length of the photo in mm, 35 mm equivalent (EXIF FocalLengthIn35mmFilm, not FocalLength), 8 to 5000; 0:
    /// not known.
    pub focal_35mm: f32,
    /// Field of view to crop the photo to, in degrees; 0: 43.35, for which the network was trained.
    pub target_fov_deg: f32,
    /// Told about progress, may cancel; NULL: nobody.
    pub progress: flashmat_progress,
    /// First argument of progress.
    pub user: *mut c_void,
    /// Linear value that a flat white surface at the centre has at this exposure under the flash alone, 0.001 to 1000,
    /// measured once with white paper; 0: not known, then the albedo's brightness is a guess.
    pub light_scale: f32,
}

/// A caller's memory for one result.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct flashmat_buffer {
    /// Where to write; NULL: the result is not wanted. Aligned to the map format's values.
    pub data: *mut c_void,
    /// Bytes that may be written there; 0 with NULL.
    pub bytes: usize,
}

/// Where the results go: the caller's memory, written only when the capture succeeds (flashmat_map_format says how).
/// Buffers that are not wanted are zero. Nobody else may use the others during the call.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct flashmat_maps {
    /// sizeof(flashmat_maps).
    pub struct_size: u32,
    /// flashmat_map_format of all results.
    pub format: u32,
    /// Diffuse albedo (base colour), 3 channels, [0,1].
    pub albedo: flashmat_buffer,
    /// Normals, 3 channels: tangent space, x right, y up, z to the camera (as OpenGL and glTF).
    pub normal: flashmat_buffer,
    /// Roughness, 1 channel, [0,1]; alpha of GGX is its square.
    pub roughness: flashmat_buffer,
    /// The maps re-rendered under the estimated flash, as bright as the photo, 3 channels.
    pub render: flashmat_buffer,
    /// The photo as the network saw it: square, upright, 3 channels.
    pub photo: flashmat_buffer,
    /// How much the photo says about the roughness of each pixel, 1 channel, [0,1]; zeros without refinement.
    pub observability: flashmat_buffer,
}

/// What a solver of the refinement did; zeros without refinement.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct flashmat_solver {
    /// Steps taken.
    pub iterations: u32,
    /// Relative residual where it stopped.
    pub residual: f32,
}

/// In photo_flags: more than a tenth of the photo's pixels are overexposed in a channel, the maps suffer.
pub const FLASHMAT_PHOTO_OVEREXPOSED: u32 = 1;
/// In photo_flags: what is not overexposed is so dark (below a hundredth of white) that 8 bits are coarser than it.
pub const FLASHMAT_PHOTO_DARK: u32 = 2;

/// What a capture found, beside the maps.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct flashmat_report {
    /// sizeof(flashmat_report), set by the caller.
    pub struct_size: u32,
    /// flashmat_class of the material: the caller's, or the most probable one. Never 0.
    pub material_class: u32,
    /// What the network believes, also when the caller chose the class: fabric, ground, leather, metal, stone-diff,
    /// stone-spec, polymer, wood. Their sum is 1.
    pub probabilities: [f32; 8],
    /// The photo's exposure times the flash's strength: a render with light strength 1 is multiplied by it.
    pub light_scale: f32,
    /// RMSE of the re-render against the photo, gamma 2.2, overexposed pixels left out.
    pub residual: f32,
    /// Specular reflectance at normal incidence: 0.05, of metal 0.5, blended by the probability of metal.
    pub f0: f32,
    /// Field of view over the square, in degrees.
    pub fov_deg: f32,
    /// Refinement of albedo, normal, roughness.
    pub solver: [flashmat_solver; 3],
    /// Even light that the re-render adds to the flash's, as a share of the flash's at the centre, in [0,1]: it adds
    /// light_scale * room_light * albedo. Fitted with light_scale, no measurement of the room.
    pub room_light: f32,
    /// Where the re-render's flash is, fitted to the photo: x, y, z in plane units. The plane is z = 0, x to the
    /// right, y up, the camera at (0,0,1).
    pub flash: [f32; 3],
    /// Share of the photo's own pixels, within the square, that are overexposed in red, green and blue, in [0,1].
    pub overexposed: [f32; 3],
    /// Mean linear light of what is not overexposed, in [0,1].
    pub brightness: f32,
    /// What is wrong with the photo: FLASHMAT_PHOTO_OVEREXPOSED and FLASHMAT_PHOTO_DARK, added up.
    pub photo_flags: u32,
}

macro_rules! layout {
    ($name:ident: $size32:literal, $size64:literal, $($field:ident at $at32:literal, $at64:literal);* $(;)?) => {
        const _: () = {
            let wide = size_of::<usize>() == 8;
            assert!(size_of::<$name>() == if wide { $size64 } else { $size32 });
            assert!(align_of::<$name>() <= 8);
            $(assert!(core::mem::offset_of!($name, $field) == if wide { $at64 } else { $at32 });)*
        };
    };
}
// The ABI: a change here breaks programs built before. New fields go to the end.
layout!(flashmat_plane: 16, 32, data at 0, 0; bytes at 4, 8; row_stride at 8, 16; pixel_stride at 12, 24);
layout!(flashmat_frame: 80, 128, struct_size at 0, 0; format at 4, 4; width at 8, 8; height at 12, 12;
    rotation at 16, 16; encoding at 20, 20; yuv_matrix at 24, 24; yuv_range at 28, 28; planes at 32, 32);
layout!(flashmat_engine_options: 24, 32, struct_size at 0, 0; size at 4, 4; level at 8, 8; threads at 12, 12;
    model at 16, 16; model_bytes at 20, 24);
layout!(flashmat_engine_info: 24, 24, struct_size at 0, 0; size at 4, 4; level at 8, 8; model_checksum at 12, 12;
    workspace_bytes at 16, 16);
layout!(flashmat_capture_options: 36, 48, struct_size at 0, 0; class_override at 4, 4; skip_refinement at 8, 8;
    photo_fov_deg at 12, 12; focal_35mm at 16, 16; target_fov_deg at 20, 20; progress at 24, 24; user at 28, 32;
    light_scale at 32, 40);
layout!(flashmat_buffer: 8, 16, data at 0, 0; bytes at 4, 8);
layout!(flashmat_maps: 56, 104, struct_size at 0, 0; format at 4, 4; albedo at 8, 8; normal at 16, 24;
    roughness at 24, 40; render at 32, 56; photo at 40, 72; observability at 48, 88);
layout!(flashmat_solver: 8, 8, iterations at 0, 0; residual at 4, 4);
layout!(flashmat_report: 116, 116, struct_size at 0, 0; material_class at 4, 4; probabilities at 8, 8;
    light_scale at 40, 40; residual at 44, 44; f0 at 48, 48; fov_deg at 52, 52; solver at 56, 56;
    room_light at 80, 80; flash at 84, 84; overexposed at 96, 96; brightness at 108, 108; photo_flags at 112, 112);
