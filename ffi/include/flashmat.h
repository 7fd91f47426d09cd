/* Flashmat: one flash photo of a flat material in, relightable material maps out.
 *
 * Generated from the sources in ffi/src; do not edit.
 *
 * Memory: all inputs and outputs are the caller's, read and written during a call alone. The library owns engines
 * (flashmat_engine_create to flashmat_engine_destroy) and the texts that it returns.
 * Structs: zero all fields, then set struct_size and what you want; a zero is always a field's default.
 *     flashmat_frame frame = {0};
 *     frame.struct_size = sizeof frame;
 * Enumerations: passed as uint32_t. Unknown numbers are refused.
 * Errors: a flashmat_status; flashmat_last_error tells the details. Nothing is written by a call that fails, but for
 * what its comment says. Nothing throws; the library stops no program.
 * Threads: said at every function. Different engines are independent.
 * Stack: less than 384 KiB in any function (musl gives threads 128 KiB by default; other systems 512 KiB or more).
 */

#ifndef FLASHMAT_H
#define FLASHMAT_H

#include <stddef.h>
#include <stdint.h>

#define FLASHMAT_VERSION_MAJOR 0
#define FLASHMAT_VERSION_MINOR 1
#define FLASHMAT_VERSION_PATCH 0

/**
 * In photo_flags: more than a tenth of the photo's pixels are overexposed in a channel, the maps suffer.
 */
#define FLASHMAT_PHOTO_OVEREXPOSED 1

/**
 * In photo_flags: what is not overexposed is so dark (below a hundredth of white) that 8 bits are coarser than it.
 */
#define FLASHMAT_PHOTO_DARK 2

/**
 * Version of the ABI of this header: it grows when functions, fields or numbers are added. What was there stays.
 */
#define FLASHMAT_ABI_VERSION 4

/**
 * What became of a call. Numbers never change their meaning; new ones are added at the end, so treat a number that
 * you do not know as an error.
 */
enum flashmat_status
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * Done.
     */
    FLASHMAT_STATUS_OK = 0,
    /**
     * A pointer that must be given is NULL.
     */
    FLASHMAT_STATUS_NULL_POINTER = 1,
    /**
     * A struct_size is none that this library knows: too small, or it claims fields of a newer library that are set.
     */
    FLASHMAT_STATUS_STRUCT_SIZE = 2,
    /**
     * A number is not one of its enumeration.
     */
    FLASHMAT_STATUS_UNKNOWN_VALUE = 3,
    /**
     * Arguments that contradict each other or are out of range.
     */
    FLASHMAT_STATUS_INVALID_ARGUMENT = 4,
    /**
     * A pointer is not aligned to the type that it points to.
     */
    FLASHMAT_STATUS_MISALIGNED = 5,
    /**
     * An output buffer is too small.
     */
    FLASHMAT_STATUS_BUFFER_TOO_SMALL = 6,
    /**
     * Another capture is running on this engine.
     */
    FLASHMAT_STATUS_BUSY = 7,
    /**
     * Nothing is running on this engine that could be cancelled.
     */
    FLASHMAT_STATUS_IDLE = 8,
    /**
     * The capture was cancelled.
     */
    FLASHMAT_STATUS_CANCELLED = 9,
    /**
     * The memory cannot be had.
     */
    FLASHMAT_STATUS_OUT_OF_MEMORY = 10,
    /**
     * A bug in the library; it was caught. Please report it with the text of flashmat_last_error.
     */
    FLASHMAT_STATUS_INTERNAL = 11,
    /**
     * An earlier capture of this engine ended with FLASHMAT_STATUS_INTERNAL: destroy the engine, create another.
     */
    FLASHMAT_STATUS_POISONED = 12,
    /**
     * No model was given and this build of the library embeds none.
     */
    FLASHMAT_STATUS_NO_MODEL = 13,
    /**
     * The bytes are not a model that this library can run.
     */
    FLASHMAT_STATUS_MODEL = 14,
    /**
     * The size of the maps does not suit the network.
     */
    FLASHMAT_STATUS_SIZE = 15,
    /**
     * This CPU or this build does not have the level asked for.
     */
    FLASHMAT_STATUS_LEVEL = 16,
    /**
     * The system gave no threads, or this build has none.
     */
    FLASHMAT_STATUS_THREADS = 17,
    /**
     * The photo has no pixels.
     */
    FLASHMAT_STATUS_FRAME_EMPTY = 18,
    /**
     * The photo's sides exceed what is supported.
     */
    FLASHMAT_STATUS_FRAME_TOO_LARGE = 19,
    /**
     * Rows or pixels of the photo overlap: a stride is too small.
     */
    FLASHMAT_STATUS_FRAME_STRIDE = 20,
    /**
     * The photo's buffer ends before its last pixel.
     */
    FLASHMAT_STATUS_FRAME_BUFFER = 21,
    /**
     * A float pixel is NaN, infinite or negative.
     */
    FLASHMAT_STATUS_FRAME_PIXEL = 22,
    /**
     * A field of view outside 1 to 170 degrees, or a focal length outside 8 to 5000 mm (35 mm equivalent).
     */
    FLASHMAT_STATUS_FIELD_OF_VIEW = 23,
    /**
     * Every pixel of the photo is overexposed.
     */
    FLASHMAT_STATUS_NO_USABLE_PIXELS = 24,
    /**
     * The photo is black.
     */
    FLASHMAT_STATUS_PHOTO_BLACK = 25,
    /**
     * The workspace is smaller than flashmat_workspace_bytes says.
     */
    FLASHMAT_STATUS_WORKSPACE_TOO_SMALL = 26,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum flashmat_status flashmat_status;
#else
typedef int32_t flashmat_status;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * How pixels lie in memory.
 */
enum flashmat_format
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * planes[0]: R, G, B, 8 bits each.
     */
    FLASHMAT_FORMAT_RGB8 = 1,
    /**
     * planes[0]: R, G, B, A, 8 bits each; A is not read.
     */
    FLASHMAT_FORMAT_RGBA8 = 2,
    /**
     * planes[0]: B, G, R, A, 8 bits each; A is not read.
     */
    FLASHMAT_FORMAT_BGRA8 = 3,
    /**
     * planes[0]: R, G, B, 16 bits each in native byte order.
     */
    FLASHMAT_FORMAT_RGB16 = 4,
    /**
     * planes[0]: R, G, B as float, 0 to 1; above 1 is taken as 1. Linear unless `encoding` says otherwise.
     */
    FLASHMAT_FORMAT_RGB_F32 = 5,
    /**
     * planes[0]: Y; planes[1]: U and V interleaved, half as wide and high, rounded up.
     */
    FLASHMAT_FORMAT_NV12 = 6,
    /**
     * planes[0]: Y; planes[1]: V and U interleaved.
     */
    FLASHMAT_FORMAT_NV21 = 7,
    /**
     * planes[0], [1], [2]: Y, U, V with any pixel stride (I420, Android's YUV_420_888); U and V have the same strides.
     */
    FLASHMAT_FORMAT_YUV420 = 8,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum flashmat_format flashmat_format;
#else
typedef uint32_t flashmat_format;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * How the photo must be turned, clockwise, to stand upright.
 */
enum flashmat_rotation
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * Upright as it is (EXIF orientation 1).
     */
    FLASHMAT_ROTATION_NONE = 0,
    /**
     * A quarter turn clockwise (EXIF orientation 6).
     */
    FLASHMAT_ROTATION_CW90 = 90,
    /**
     * Half a turn (EXIF orientation 3).
     */
    FLASHMAT_ROTATION_CW180 = 180,
    /**
     * A quarter turn counter-clockwise (EXIF orientation 8).
     */
    FLASHMAT_ROTATION_CW270 = 270,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum flashmat_rotation flashmat_rotation;
#else
typedef uint32_t flashmat_rotation;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * What the values of pixels mean.
 */
enum flashmat_encoding
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * sRGB; linear for FLASHMAT_FORMAT_RGB_F32.
     */
    FLASHMAT_ENCODING_DEFAULT = 0,
    /**
     * sRGB curve and primaries.
     */
    FLASHMAT_ENCODING_SRGB = 1,
    /**
     * Linear light, sRGB primaries.
     */
    FLASHMAT_ENCODING_LINEAR = 2,
    /**
     * sRGB curve, Display P3 primaries; colours outside sRGB are clamped.
     */
    FLASHMAT_ENCODING_DISPLAY_P3 = 3,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum flashmat_encoding flashmat_encoding;
#else
typedef uint32_t flashmat_encoding;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * Luma equation of YUV formats.
 */
enum flashmat_yuv_matrix
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * BT.601.
     */
    FLASHMAT_YUV_MATRIX_DEFAULT = 0,
    /**
     * JPEG, Android's default.
     */
    FLASHMAT_YUV_MATRIX_BT601 = 1,
    /**
     * HD video, iOS's default.
     */
    FLASHMAT_YUV_MATRIX_BT709 = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum flashmat_yuv_matrix flashmat_yuv_matrix;
#else
typedef uint32_t flashmat_yuv_matrix;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * Which codes black and white have in YUV formats.
 */
enum flashmat_yuv_range
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * Full.
     */
    FLASHMAT_YUV_RANGE_DEFAULT = 0,
    /**
     * Luma 0 to 255 (JPEG).
     */
    FLASHMAT_YUV_RANGE_FULL = 1,
    /**
     * Luma 16 to 235 (video).
     */
    FLASHMAT_YUV_RANGE_LIMITED = 2,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum flashmat_yuv_range flashmat_yuv_range;
#else
typedef uint32_t flashmat_yuv_range;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * Material classes. `probabilities[c - 1]` of a report belongs to class c.
 */
enum flashmat_class
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * Let the network decide (in options only).
     */
    FLASHMAT_CLASS_AUTO = 0,
    /**
     * Woven and knitted cloth.
     */
    FLASHMAT_CLASS_FABRIC = 1,
    /**
     * Soil, grass, gravel.
     */
    FLASHMAT_CLASS_GROUND = 2,
    /**
     * Leather.
     */
    FLASHMAT_CLASS_LEATHER = 3,
    /**
     * Metal.
     */
    FLASHMAT_CLASS_METAL = 4,
    /**
     * Diffuse stone.
     */
    FLASHMAT_CLASS_STONE_DIFF = 5,
    /**
     * Polished stone.
     */
    FLASHMAT_CLASS_STONE_SPEC = 6,
    /**
     * Plastics and paint.
     */
    FLASHMAT_CLASS_POLYMER = 7,
    /**
     * Wood.
     */
    FLASHMAT_CLASS_WOOD = 8,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum flashmat_class flashmat_class;
#else
typedef uint32_t flashmat_class;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * Instruction sets. All give the same results, bit for bit.
 */
enum flashmat_level
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * The fastest that this CPU has (bare metal: that every CPU of the target has).
     */
    FLASHMAT_LEVEL_AUTO = 0,
    /**
     * Any CPU.
     */
    FLASHMAT_LEVEL_SCALAR = 1,
    /**
     * x86-64 with AVX2.
     */
    FLASHMAT_LEVEL_AVX2 = 2,
    /**
     * x86-64 with AVX-512 F, BW, VL and VNNI.
     */
    FLASHMAT_LEVEL_AVX512_VNNI = 3,
    /**
     * AArch64.
     */
    FLASHMAT_LEVEL_NEON = 4,
    /**
     * AArch64 with the dot-product extension.
     */
    FLASHMAT_LEVEL_DOT_PROD = 5,
    /**
     * AArch64 with the int8 matrix-multiply extension.
     */
    FLASHMAT_LEVEL_I8MM = 6,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum flashmat_level flashmat_level;
#else
typedef uint32_t flashmat_level;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * Stages of a capture, in their order.
 */
enum flashmat_stage
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * Photo to linear RGB at the maps' size.
     */
    FLASHMAT_STAGE_FRAME = 0,
    /**
     * The network: class probabilities and first maps.
     */
    FLASHMAT_STAGE_GLOBAL = 1,
    /**
     * Where the flash is beside the camera.
     */
    FLASHMAT_STAGE_FLASH = 2,
    /**
     * Albedo below highlights.
     */
    FLASHMAT_STAGE_HIGHLIGHT = 3,
    /**
     * Refinement of the albedo.
     */
    FLASHMAT_STAGE_ALBEDO = 4,
    /**
     * Texture of the albedo that a highlight burnt out.
     */
    FLASHMAT_STAGE_TEXTURE = 5,
    /**
     * Refinement of the normals.
     */
    FLASHMAT_STAGE_NORMAL = 6,
    /**
     * Light scale and roughness search.
     */
    FLASHMAT_STAGE_SEARCH = 7,
    /**
     * Refinement of the roughness.
     */
    FLASHMAT_STAGE_ROUGHNESS = 8,
    /**
     * Roughness below highlights.
     */
    FLASHMAT_STAGE_LEVEL = 9,
    /**
     * Re-render, lights and residual.
     */
    FLASHMAT_STAGE_RELIGHT = 10,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum flashmat_stage flashmat_stage;
#else
typedef uint32_t flashmat_stage;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * How results are written. Rows from the top, without padding, size x size pixels.
 */
enum flashmat_map_format
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : uint32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * float, one plane per channel, plane after plane. Albedo, render, photo: linear light, sRGB primaries. Normal:
     * x, y, z of unit vectors. Bytes: channels * size * size * 4.
     */
    FLASHMAT_MAP_FORMAT_F32 = 0,
    /**
     * uint8_t, channels interleaved, as image files have it. Albedo, render, photo: sRGB-encoded. Normal: (n + 1) / 2.
     * Roughness, observability: linear. Bytes: channels * size * size.
     */
    FLASHMAT_MAP_FORMAT_U8 = 1,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum flashmat_map_format flashmat_map_format;
#else
typedef uint32_t flashmat_map_format;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * What captures run on: a model, a CPU level, threads, memory. Create it once, capture with it often.
 * Opaque; made by flashmat_engine_create, freed by flashmat_engine_destroy. Not in the bare-metal build.
 */
typedef struct flashmat_engine flashmat_engine;

/**
 * What an engine is made for.
 */
typedef struct flashmat_engine_options {
    /**
     * sizeof(flashmat_engine_options).
     */
    uint32_t struct_size;
    /**
     * Pixels per side of the maps, a multiple of 128; 0: 256.
     */
    uint32_t size;
    /**
     * flashmat_level. One that the CPU does not have is an error.
     */
    uint32_t level;
    /**
     * Threads to work with, at most 256; 0: one per CPU. Results do not depend on it.
     */
    uint32_t threads;
    /**
     * A model file's bytes; no alignment needed. NULL: the model embedded in the library, if it was built with one.
     */
    const void *model;
    /**
     * Bytes of the model.
     */
    size_t model_bytes;
} flashmat_engine_options;

/**
 * What an engine is.
 */
typedef struct flashmat_engine_info {
    /**
     * sizeof(flashmat_engine_info), set by the caller.
     */
    uint32_t struct_size;
    /**
     * Pixels per side of the maps.
     */
    uint32_t size;
    /**
     * flashmat_level in use.
     */
    uint32_t level;
    /**
     * CRC-32 of the model file.
     */
    uint32_t model_checksum;
    /**
     * Bytes that a capture works in; the engine holds them for its whole life, besides a copy of the model.
     */
    uint64_t workspace_bytes;
} flashmat_engine_info;

/**
 * One plane of a photo.
 */
typedef struct flashmat_plane {
    /**
     * First pixel of the first row. Aligned to the format's values (16 bits: 2, float: 4 bytes).
     */
    const void *data;
    /**
     * Bytes that may be read from there on.
     */
    size_t bytes;
    /**
     * Bytes from row to row; 0: rows follow each other without padding.
     */
    size_t row_stride;
    /**
     * Bytes from pixel to pixel; 0: the format's own. Only FLASHMAT_FORMAT_YUV420 takes others.
     */
    size_t pixel_stride;
} flashmat_plane;

/**
 * A photo, in the caller's memory, which the library reads during the call alone and never writes.
 * No other thread may write to it meanwhile.
 */
typedef struct flashmat_frame {
    /**
     * sizeof(flashmat_frame).
     */
    uint32_t struct_size;
    /**
     * flashmat_format.
     */
    uint32_t format;
    /**
     * Pixels across as stored, before the rotation.
     */
    uint32_t width;
    /**
     * Pixels down as stored.
     */
    uint32_t height;
    /**
     * flashmat_rotation.
     */
    uint32_t rotation;
    /**
     * flashmat_encoding.
     */
    uint32_t encoding;
    /**
     * flashmat_yuv_matrix; 0 for RGB formats.
     */
    uint32_t yuv_matrix;
    /**
     * flashmat_yuv_range; 0 for RGB formats.
     */
    uint32_t yuv_range;
    /**
     * As many as the format has; the others zero.
     */
    struct flashmat_plane planes[3];
} flashmat_frame;

/**
 * A call that tells how far a capture is: `fraction` of `stage` (flashmat_stage) is done. Return 0 to go on, anything
 * else to cancel the capture, which then returns FLASHMAT_STATUS_CANCELLED.
 *
 * Called on the thread that runs the capture, several times a stage, first before any work is done. It may call
 * flashmat_cancel; a capture on the same engine returns FLASHMAT_STATUS_BUSY. It must not throw C++ exceptions or
 * longjmp out of the library.
 */
typedef int32_t (*flashmat_progress)(void *user, uint32_t stage, float fraction);

/**
 * What a caller may choose for one capture.
 */
typedef struct flashmat_capture_options {
    /**
     * sizeof(flashmat_capture_options).
     */
    uint32_t struct_size;
    /**
     * flashmat_class that the material is of; FLASHMAT_CLASS_AUTO: the network decides.
     */
    uint32_t class_override;
    /**
     * 1: the network's maps as they are, without refinement; 0: refined.
     */
    uint32_t skip_refinement;
    /**
     * Field of view of the photo over its shorter side, in degrees; 0: not known, or given by the focal length.
     */
    float photo_fov_deg;
    /**
     * Focal length of the photo in mm, 35 mm equivalent (EXIF FocalLengthIn35mmFilm, not FocalLength), 8 to 5000; 0:
     * not known.
     */
    float focal_35mm;
    /**
     * Field of view to crop the photo to, in degrees; 0: 43.35, for which the network was trained.
     */
    float target_fov_deg;
    /**
     * Told about progress, may cancel; NULL: nobody.
     */
    flashmat_progress progress;
    /**
     * First argument of progress.
     */
    void *user;
    /**
     * Linear value that a flat white surface at the centre has at this exposure under the flash alone, 0.001 to 1000,
     * measured once with white paper; 0: not known, then the albedo's brightness is a guess.
     */
    float light_scale;
} flashmat_capture_options;

/**
 * A caller's memory for one result.
 */
typedef struct flashmat_buffer {
    /**
     * Where to write; NULL: the result is not wanted. Aligned to the map format's values.
     */
    void *data;
    /**
     * Bytes that may be written there; 0 with NULL.
     */
    size_t bytes;
} flashmat_buffer;

/**
 * Where the results go: the caller's memory, written only when the capture succeeds (flashmat_map_format says how).
 * Buffers that are not wanted are zero. Nobody else may use the others during the call.
 */
typedef struct flashmat_maps {
    /**
     * sizeof(flashmat_maps).
     */
    uint32_t struct_size;
    /**
     * flashmat_map_format of all results.
     */
    uint32_t format;
    /**
     * Diffuse albedo (base colour), 3 channels, [0,1].
     */
    struct flashmat_buffer albedo;
    /**
     * Normals, 3 channels: tangent space, x right, y up, z to the camera (as OpenGL and glTF).
     */
    struct flashmat_buffer normal;
    /**
     * Roughness, 1 channel, [0,1]; alpha of GGX is its square.
     */
    struct flashmat_buffer roughness;
    /**
     * The maps re-rendered under the estimated flash, as bright as the photo, 3 channels.
     */
    struct flashmat_buffer render;
    /**
     * The photo as the network saw it: square, upright, 3 channels.
     */
    struct flashmat_buffer photo;
    /**
     * How much the photo says about the roughness of each pixel, 1 channel, [0,1]; zeros without refinement.
     */
    struct flashmat_buffer observability;
} flashmat_maps;

/**
 * What a solver of the refinement did; zeros without refinement.
 */
typedef struct flashmat_solver {
    /**
     * Steps taken.
     */
    uint32_t iterations;
    /**
     * Relative residual where it stopped.
     */
    float residual;
} flashmat_solver;

/**
 * What a capture found, beside the maps.
 */
typedef struct flashmat_report {
    /**
     * sizeof(flashmat_report), set by the caller.
     */
    uint32_t struct_size;
    /**
     * flashmat_class of the material: the caller's, or the most probable one. Never 0.
     */
    uint32_t material_class;
    /**
     * What the network believes, also when the caller chose the class: fabric, ground, leather, metal, stone-diff,
     * stone-spec, polymer, wood. Their sum is 1.
     */
    float probabilities[8];
    /**
     * The photo's exposure times the flash's strength: a render with light strength 1 is multiplied by it.
     */
    float light_scale;
    /**
     * RMSE of the re-render against the photo, gamma 2.2, overexposed pixels left out.
     */
    float residual;
    /**
     * Specular reflectance at normal incidence: 0.05, of metal 0.5, blended by the probability of metal.
     */
    float f0;
    /**
     * Field of view over the square, in degrees.
     */
    float fov_deg;
    /**
     * Refinement of albedo, normal, roughness.
     */
    struct flashmat_solver solver[3];
    /**
     * Even light that the re-render adds to the flash's, as a share of the flash's at the centre, in [0,1]: it adds
     * light_scale * room_light * albedo. Fitted with light_scale, no measurement of the room.
     */
    float room_light;
    /**
     * Where the re-render's flash is, fitted to the photo: x, y, z in plane units. The plane is z = 0, x to the
     * right, y up, the camera at (0,0,1).
     */
    float flash[3];
    /**
     * Share of the photo's own pixels, within the square, that are overexposed in red, green and blue, in [0,1].
     */
    float overexposed[3];
    /**
     * Mean linear light of what is not overexposed, in [0,1].
     */
    float brightness;
    /**
     * What is wrong with the photo: FLASHMAT_PHOTO_OVEREXPOSED and FLASHMAT_PHOTO_DARK, added up.
     */
    uint32_t photo_flags;
} flashmat_report;

/**
 * Takes the next `bytes` bytes of a file, which are at `data` during the call alone. Return 0 to go on, anything else
 * to stop: the export then returns FLASHMAT_STATUS_CANCELLED. It must not throw C++ exceptions or longjmp out of
 * the library.
 */
typedef int32_t (*flashmat_write)(void *user, const void *data, size_t bytes);

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Makes an engine. It takes all its memory now; captures take none.
 *
 * options: NULL for the defaults (then the library must have a model embedded). The model is copied: the caller's
 * bytes may go when the call returns.
 * engine: receives the engine, or NULL when the call fails. Owner: the caller, who gives it back with
 * flashmat_engine_destroy.
 * Threads: any.
 * Errors: NULL_POINTER, MISALIGNED, STRUCT_SIZE, UNKNOWN_VALUE, INVALID_ARGUMENT, NO_MODEL, MODEL, SIZE, LEVEL,
 * THREADS, OUT_OF_MEMORY.
 */
flashmat_status flashmat_engine_create(const struct flashmat_engine_options *options,
                                       struct flashmat_engine **engine);

/**
 * Frees an engine and all its memory. NULL is allowed and does nothing.
 *
 * The handle is invalid from then on. A capture that runs on it in another thread (or that called this from its
 * progress function) is cancelled, and the engine freed at its end.
 * Threads: any, once.
 */
void flashmat_engine_destroy(struct flashmat_engine *engine);

/**
 * Tells what an engine is.
 *
 * info: the caller's, its struct_size set; written on success.
 * Threads: any, also during a capture.
 * Errors: NULL_POINTER, MISALIGNED, STRUCT_SIZE.
 */
flashmat_status flashmat_engine_get_info(const struct flashmat_engine *engine,
                                         struct flashmat_engine_info *info);

/**
 * One photo to material maps. Allocates nothing on the calling thread; takes a good part of a second on a phone.
 *
 * frame: the photo; read during the call alone.
 * options: NULL for the defaults.
 * maps: where the maps go; written on success alone.
 * report: where class, light and errors of fit go; NULL: not wanted.
 * Owner of everything but the engine: the caller.
 * Threads: any, but one capture at a time on an engine; a second one returns BUSY and leaves the first alone. The
 * progress function is called on this thread.
 * Errors: NULL_POINTER, MISALIGNED, STRUCT_SIZE, UNKNOWN_VALUE, INVALID_ARGUMENT, BUFFER_TOO_SMALL, BUSY, CANCELLED,
 * POISONED, FRAME_EMPTY, FRAME_TOO_LARGE, FRAME_STRIDE, FRAME_BUFFER, FRAME_PIXEL, FIELD_OF_VIEW, NO_USABLE_PIXELS,
 * PHOTO_BLACK, INTERNAL.
 */
flashmat_status flashmat_capture(struct flashmat_engine *engine,
                                 const struct flashmat_frame *frame,
                                 const struct flashmat_capture_options *options,
                                 const struct flashmat_maps *maps,
                                 struct flashmat_report *report);

/**
 * Stops the capture that runs on the engine in another thread: it returns CANCELLED within a few milliseconds to tens
 * of them, and writes no results. Does not wait for that.
 *
 * Returns IDLE, and does nothing, when no capture runs: one that is about to start, or that writes its results
 * already, is not affected. OK means that the capture will return CANCELLED, whatever it is at. To cancel without that
 * race, return a number other than 0 from the progress function, which is called before any work is done.
 * Threads: any; touches one atomic.
 * Errors: NULL_POINTER, IDLE.
 */
flashmat_status flashmat_cancel(const struct flashmat_engine *engine);

/**
 * A captured material on a square, as one binary glTF 2.0 file for any viewer: albedo, normals, roughness, metallic,
 * index of refraction. The same bytes as the command line's material.glb of the same capture.
 *
 * size: pixels per side of the maps.
 * maps: as they were given to the capture that filled them, in either format; albedo, normal and roughness are read,
 * the others may be NULL.
 * report: of the same capture; f0 and fov_deg are read.
 * name: the material's, UTF-8, ends with NUL.
 * write: takes the file's bytes, in order, in one call or several. user: its first argument.
 * Owner of everything: the caller.
 * Threads: any, also during captures, as long as they do not write to these maps.
 * Memory: that of the file, from the system. Not in the bare-metal build.
 * Errors: NULL_POINTER, MISALIGNED, STRUCT_SIZE, UNKNOWN_VALUE, INVALID_ARGUMENT, BUFFER_TOO_SMALL (a map is shorter
 * than size says), CANCELLED (write said so), INTERNAL.
 */
flashmat_status flashmat_export_glb(uint32_t size,
                                    const struct flashmat_maps *maps,
                                    const struct flashmat_report *report,
                                    const char *name,
                                    flashmat_write write,
                                    void *user);

/**
 * What the last call of this thread that failed has to say: one sentence in English, UTF-8, with the details
 * (which argument, which limit). Never NULL; empty when no call of this thread failed yet.
 *
 * Owner: the library. Valid until the next call of a function of this library on the same thread.
 * Threads: any; each has a text of its own. Not in the bare-metal build.
 */
const char *flashmat_last_error(void);

/**
 * A status' constant as text, such as "FLASHMAT_STATUS_BUSY". Static; empty for numbers that are no status.
 * Threads: any.
 */
const char *flashmat_status_name(int32_t number);

/**
 * What a status means, in English; flashmat_last_error knows more of a certain call. Static; empty for numbers that
 * are no status. Threads: any.
 */
const char *flashmat_status_text(int32_t number);

/**
 * A class' name: "fabric", "ground", "leather", "metal", "stone-diff", "stone-spec", "polymer", "wood". Static; empty
 * for FLASHMAT_CLASS_AUTO and numbers that are no class. Threads: any.
 */
const char *flashmat_class_name(uint32_t material_class);

/**
 * A stage's name, such as "albedo". Static; empty for numbers that are no stage. Threads: any.
 */
const char *flashmat_stage_name(uint32_t stage);

/**
 * A level's name, such as "neon". Static; empty for FLASHMAT_LEVEL_AUTO and numbers that are no level. Threads: any.
 */
const char *flashmat_level_name(uint32_t level);

/**
 * Version of the ABI that the library has: programs built with FLASHMAT_ABI_VERSION up to it can use it.
 * Threads: any.
 */
uint32_t flashmat_abi_version(void);

/**
 * Version of the library, such as "0.1.0". Static. Threads: any.
 */
const char *flashmat_version(void);

/**
 * Tells how much memory flashmat_capture_in needs with these options.
 *
 * options: model, size and level as for an engine; threads 0 or 1. Nothing is kept of it.
 * bytes: the caller's; written on success.
 * Threads: any.
 * Errors: NULL_POINTER, MISALIGNED, STRUCT_SIZE, UNKNOWN_VALUE, INVALID_ARGUMENT, NO_MODEL, MODEL, SIZE, LEVEL.
 */
flashmat_status flashmat_workspace_bytes(const struct flashmat_engine_options *options,
                                         size_t *bytes);

/**
 * One photo to material maps without an engine: works in the caller's memory, allocates nothing, keeps nothing, uses
 * the calling thread alone. The same results as flashmat_capture. Checks the model each time (milliseconds).
 *
 * engine_options: model, size and level as for an engine; threads 0 or 1. The model is read during the call alone.
 * workspace, workspace_bytes: the caller's memory, flashmat_workspace_bytes of it or more, any alignment; must overlap
 * nothing else that is given. What it holds afterwards is of no use.
 * frame, options, maps, report: as for flashmat_capture. The progress function is the only way to cancel.
 * Threads: any; calls at the same time need a workspace each.
 * Errors: as flashmat_capture and flashmat_workspace_bytes, and WORKSPACE_TOO_SMALL.
 */
flashmat_status flashmat_capture_in(const struct flashmat_engine_options *engine_options,
                                    void *workspace,
                                    size_t workspace_bytes,
                                    const struct flashmat_frame *frame,
                                    const struct flashmat_capture_options *options,
                                    const struct flashmat_maps *maps,
                                    struct flashmat_report *report);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* FLASHMAT_H */
