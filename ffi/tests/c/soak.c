/* Captures photos of changing sizes and formats over and over in one process: soak MODEL CAPTURES. Fails if memory grew
 * after the first tenth, or if a photo ever gave other maps or another report than the first time. Engines are made and
 * destroyed on the way: two sizes, one and two threads, two levels; some captures are cancelled, some refused, some run
 * in the caller's memory. */
#include "check.h"

#ifdef __GLIBC__
#include <malloc.h>
#endif

#define PHOTOS 24
#define SIZES 2
#define LARGEST 256
/* Captures on one engine. */
#define PERIOD 20

static const uint32_t SIZE[SIZES] = {128, 256};

/* What a photo gave the first time, at each size: a hash, and whether it is known yet. */
static uint64_t hashes[SIZES][PHOTOS];
static int known[SIZES][PHOTOS];
/* Statuses other than OK, by photo. */
static long failed[PHOTOS];

/* Resident memory in KiB (Linux); 0 elsewhere. */
static long resident(void) {
    char line[256];
    long kib = 0;
    FILE *file;
#ifdef __GLIBC__
    /* Pages that the allocator merely keeps are no leak. */
    malloc_trim(0);
#endif
    file = fopen("/proc/self/status", "r");
    while (file != NULL && fgets(line, sizeof line, file) != NULL) {
        if (sscanf(line, "VmRSS: %ld", &kib) == 1) {
            break;
        }
    }
    if (file != NULL) {
        fclose(file);
    }
    return kib;
}

/* FNV-1a. */
static uint64_t hash(uint64_t value, const void *data, size_t bytes) {
    const unsigned char *at = (const unsigned char *)data;
    size_t i;
    for (i = 0; i < bytes; i++) {
        value = (value ^ at[i]) * 1099511628211u;
    }
    return value;
}

/* A surface under a flash, with a grain of its own for each photo. */
static unsigned char texel(uint32_t photo, uint32_t x, uint32_t y, uint32_t width, uint32_t height, uint32_t channel) {
    int32_t dx = (int32_t)(2 * x) - (int32_t)width, dy = (int32_t)(2 * y) - (int32_t)height;
    int32_t far = (int32_t)(width * width + height * height) + 1;
    int32_t light = 230 - 150 * (dx * dx + dy * dy) / far;
    uint32_t noise = (x * 2654435761u) ^ (y * 2246822519u) ^ (photo * 3266489917u) ^ (channel * 668265263u);
    noise = (noise ^ (noise >> 15)) * 2246822519u;
    return (unsigned char)(light * (int32_t)(90 + channel * 30 + (noise >> 27)) / 190);
}

/* One plane of `width` x `height` pixels of `values` values, `bytes` bytes each, in an exact allocation. */
static flashmat_plane plane(uint32_t photo, uint32_t width, uint32_t height, uint32_t values, uint32_t bytes,
                            uint32_t padding) {
    flashmat_plane made;
    uint32_t x, y, c;
    size_t stride = (size_t)width * values * bytes + (size_t)padding * bytes;
    unsigned char *data;
    memset(&made, 0, sizeof made);
    made.row_stride = stride;
    made.bytes = stride * (height - 1) + (size_t)width * values * bytes;
    data = (unsigned char *)must_malloc(made.bytes);
    memset(data, 0xA5, made.bytes);
    for (y = 0; y < height; y++) {
        for (x = 0; x < width; x++) {
            for (c = 0; c < values; c++) {
                unsigned char code = texel(photo, x, y, width, height, c);
                unsigned char *to = data + y * stride + ((size_t)x * values + c) * bytes;
                uint16_t wide = (uint16_t)(code * 257);
                float real = (float)code / 255.0f;
                if (bytes == 1) {
                    *to = code;
                } else {
                    memcpy(to, bytes == 2 ? (const void *)&wide : (const void *)&real, bytes);
                }
            }
        }
    }
    made.data = data;
    return made;
}

/* Photo number `photo`: a size, format, rotation, encoding, stride of its own. */
static flashmat_frame new_frame(uint32_t photo) {
    static const uint32_t ROTATIONS[4] = {0, 90, 180, 270};
    flashmat_frame frame;
    uint32_t format = FLASHMAT_FORMAT_RGB8 + photo % 8, padding = photo % 5;
    uint32_t width = 60 + photo * 97 % 331, height = 60 + photo * 61 % 283;
    memset(&frame, 0, sizeof frame);
    frame.struct_size = sizeof frame;
    frame.format = format;
    frame.width = width;
    frame.height = height;
    frame.rotation = ROTATIONS[photo / 2 % 4];
    switch (format) {
    case FLASHMAT_FORMAT_RGB8:
    case FLASHMAT_FORMAT_RGBA8:
    case FLASHMAT_FORMAT_BGRA8:
        frame.planes[0] = plane(photo, width, height, format == FLASHMAT_FORMAT_RGB8 ? 3 : 4, 1, padding);
        frame.encoding = photo / 8 % 2 ? FLASHMAT_ENCODING_DISPLAY_P3 : FLASHMAT_ENCODING_DEFAULT;
        break;
    case FLASHMAT_FORMAT_RGB16:
        frame.planes[0] = plane(photo, width, height, 3, 2, padding);
        break;
    case FLASHMAT_FORMAT_RGB_F32:
        frame.planes[0] = plane(photo, width, height, 3, 4, padding);
        break;
    case FLASHMAT_FORMAT_YUV420:
        frame.planes[0] = plane(photo, width, height, 1, 1, padding);
        frame.planes[1] = plane(photo, (width + 1) / 2, (height + 1) / 2, 1, 1, padding);
        frame.planes[2] = plane(photo + 1, (width + 1) / 2, (height + 1) / 2, 1, 1, padding);
        break;
    default:
        frame.planes[0] = plane(photo, width, height, 1, 1, padding);
        frame.planes[1] = plane(photo, (width + 1) / 2, (height + 1) / 2, 2, 1, padding);
        break;
    }
    if (format >= FLASHMAT_FORMAT_NV12) {
        frame.yuv_matrix = photo / 8 % 3;
        frame.yuv_range = photo / 4 % 3;
    }
    return frame;
}

static void free_frame(flashmat_frame *frame) {
    int i;
    for (i = 0; i < 3; i++) {
        free((void *)frame->planes[i].data);
    }
}

static int32_t refuse(void *user, uint32_t stage, float fraction) {
    (void)user;
    (void)fraction;
    return stage != FLASHMAT_STAGE_FRAME;
}

/* Where results go: room for the largest, as floats. */
static unsigned char *results;

/* Seven channels for `size`, packed to its start. */
static flashmat_maps maps_of(uint32_t size, uint32_t format, size_t *bytes) {
    flashmat_maps maps;
    size_t one = (size_t)size * size * (format == FLASHMAT_MAP_FORMAT_F32 ? 4 : 1);
    memset(&maps, 0, sizeof maps);
    maps.struct_size = sizeof maps;
    maps.format = format;
    maps.albedo.data = results;
    maps.albedo.bytes = maps.normal.bytes = 3 * one;
    maps.normal.data = results + 3 * one;
    maps.roughness.data = results + 6 * one;
    maps.roughness.bytes = one;
    *bytes = 7 * one;
    return maps;
}

static flashmat_engine *new_engine(flashmat_engine_options *options, long period) {
    flashmat_engine *engine = NULL;
    options->size = SIZE[period % 25 == 1];
    options->threads = (uint32_t)(1 + period % 2);
    options->level = period % 3 == 1 ? FLASHMAT_LEVEL_AVX2 : FLASHMAT_LEVEL_AUTO;
    if (flashmat_engine_create(options, &engine) == FLASHMAT_STATUS_LEVEL) {
        options->level = FLASHMAT_LEVEL_AUTO;
        CHECK(flashmat_engine_create(options, &engine) == FLASHMAT_STATUS_OK);
    }
    CHECK(engine != NULL);
    return engine;
}

int main(int count, char **arguments) {
    flashmat_engine_options engine_options;
    flashmat_engine *engine = NULL;
    unsigned char *model, *workspace;
    size_t workspace_bytes = 0;
    long captures, i, good = 0, early = 0, most = 0;
    int at;
    if (count < 3 || (captures = strtol(arguments[2], NULL, 10)) < 10) {
        fprintf(stderr, "soak MODEL CAPTURES\n");
        return 2;
    }
    results = (unsigned char *)must_malloc((size_t)7 * LARGEST * LARGEST * sizeof(float));
    memset(&engine_options, 0, sizeof engine_options);
    engine_options.struct_size = sizeof engine_options;
    engine_options.size = SIZE[0];
    engine_options.threads = 1;
    model = read_file(arguments[1], &engine_options.model_bytes);
    engine_options.model = model;
    CHECK(flashmat_workspace_bytes(&engine_options, &workspace_bytes) == FLASHMAT_STATUS_OK);
    workspace = (unsigned char *)must_malloc(workspace_bytes);
    printf("captures  resident KiB\n");
    for (i = 0; i < captures; i++) {
        uint32_t photo = (uint32_t)(i % PHOTOS);
        flashmat_frame frame = new_frame(photo);
        flashmat_capture_options options;
        flashmat_maps maps;
        flashmat_report report;
        flashmat_status status;
        size_t bytes;
        uint64_t now;
        if (engine == NULL || i % PERIOD == 0) {
            flashmat_engine_destroy(engine);
            engine = new_engine(&engine_options, i / PERIOD);
        }
        at = engine_options.size == SIZE[1];
        memset(&options, 0, sizeof options);
        options.struct_size = sizeof options;
        options.skip_refinement = photo != 0;
        options.photo_fov_deg = photo % 3 == 1 ? 60.0f : 0.0f;
        options.focal_35mm = photo % 3 == 2 ? 26.0f : 0.0f;
        options.light_scale = photo % 7 == 3 ? 0.5f : 0.0f;
        maps = maps_of(engine_options.size, photo % 2 ? FLASHMAT_MAP_FORMAT_F32 : FLASHMAT_MAP_FORMAT_U8, &bytes);
        memset(&report, 0, sizeof report);
        report.struct_size = sizeof report;
        /* Now and then one that is refused, and one that is cancelled half-way. */
        if (i % 50 == 0) {
            frame.format += 90;
            CHECK(flashmat_capture(engine, &frame, &options, &maps, &report) == FLASHMAT_STATUS_UNKNOWN_VALUE);
            frame.format -= 90;
        }
        if (i % 97 == 0) {
            options.progress = refuse;
            CHECK(flashmat_capture(engine, &frame, &options, &maps, &report) == FLASHMAT_STATUS_CANCELLED);
            options.progress = NULL;
        }
        if (at == 0 && i % 11 == 0) {
            engine_options.threads = 1;
            status = flashmat_capture_in(&engine_options, workspace, workspace_bytes, &frame, &options, &maps, &report);
        } else {
            status = flashmat_capture(engine, &frame, &options, &maps, &report);
        }
        free_frame(&frame);
        now = hash(14695981039346656037u, &status, sizeof status);
        if (status == FLASHMAT_STATUS_OK) {
            good++;
            now = hash(hash(now, results, bytes), &report, sizeof report);
        } else {
            failed[photo]++;
        }
        if (known[at][photo]) {
            CHECK(hashes[at][photo] == now);
        }
        hashes[at][photo] = now;
        known[at][photo] = 1;
        if ((i + 1) % (captures / 10) == 0) {
            long kib;
            /* Without an engine, whose size would say more than what was left behind. */
            flashmat_engine_destroy(engine);
            engine = NULL;
            kib = resident();
            printf("%8ld  %12ld\n", i + 1, kib);
            fflush(stdout);
            if (early == 0) {
                early = kib;
            }
            most = kib > most ? kib : most;
        }
    }
    /* Pages come and go; a leak of one byte per capture's row would be far more. */
    CHECK(most <= early + 512);
    for (at = 0; at < PHOTOS; at++) {
        CHECK(failed[at] == 0);
    }
    printf("%ld captures gave maps\n", good);
    flashmat_engine_destroy(engine);
    free(workspace);
    free(model);
    free(results);
    return summary();
}
