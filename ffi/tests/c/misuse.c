/* Everything that a C program can get wrong in one thread: each gives its status and a text that names the culprit, and
 * leaves the engine usable. misuse MODEL */
#include "check.h"

#define SIZE 128
#define SIDE 140
#define PLANE ((size_t)SIZE * SIZE)

static flashmat_engine *engine = NULL;
static flashmat_engine_options engine_options;
static unsigned char *photo;
static float *albedo;

/* A frame, options and maps that work; each test spoils one thing. */
static flashmat_frame good_frame(void) {
    flashmat_frame frame;
    memset(&frame, 0, sizeof frame);
    frame.struct_size = sizeof frame;
    frame.format = FLASHMAT_FORMAT_RGB8;
    frame.width = frame.height = SIDE;
    frame.planes[0].data = photo;
    frame.planes[0].bytes = 3 * SIDE * SIDE;
    return frame;
}

static flashmat_capture_options good_options(void) {
    flashmat_capture_options options;
    memset(&options, 0, sizeof options);
    options.struct_size = sizeof options;
    options.skip_refinement = 1; /* for speed */
    return options;
}

static flashmat_maps good_maps(void) {
    flashmat_maps maps;
    memset(&maps, 0, sizeof maps);
    maps.struct_size = sizeof maps;
    maps.albedo.data = albedo;
    maps.albedo.bytes = 3 * PLANE * sizeof(float);
    return maps;
}

static flashmat_report good_report(void) {
    flashmat_report report;
    memset(&report, 0, sizeof report);
    report.struct_size = sizeof report;
    return report;
}

static int32_t capture(const flashmat_frame *frame, const flashmat_capture_options *options) {
    flashmat_maps maps = good_maps();
    return (int32_t)flashmat_capture(engine, frame, options, &maps, NULL);
}

static int32_t capture_frame(const flashmat_frame *frame) {
    flashmat_capture_options options = good_options();
    return capture(frame, &options);
}

static int32_t capture_maps(const flashmat_maps *maps) {
    flashmat_frame frame = good_frame();
    flashmat_capture_options options = good_options();
    return (int32_t)flashmat_capture(engine, &frame, &options, maps, NULL);
}

static void create(void) {
    flashmat_engine_options options = engine_options;
    flashmat_engine *none = (flashmat_engine *)&options;
    unsigned char *spoilt = (unsigned char *)must_malloc(options.model_bytes);

    FAILS(flashmat_engine_create(&options, NULL), FLASHMAT_STATUS_NULL_POINTER, "engine is NULL");
#ifdef EMBEDDED
    CHECK(flashmat_engine_create(NULL, &none) == FLASHMAT_STATUS_OK && none != NULL);
    flashmat_engine_destroy(none);
#else
    FAILS(flashmat_engine_create(NULL, &none), FLASHMAT_STATUS_NO_MODEL, "no model");
    CHECK(none == NULL);
#endif
    options.struct_size = 0;
    FAILS(flashmat_engine_create(&options, &none), FLASHMAT_STATUS_STRUCT_SIZE, "options: struct_size is 0");
    options.struct_size = sizeof options - 1;
    FAILS(flashmat_engine_create(&options, &none), FLASHMAT_STATUS_STRUCT_SIZE, "set it to sizeof");
    options.struct_size = 0xFFFFFFFFu;
    FAILS(flashmat_engine_create(&options, &none), FLASHMAT_STATUS_STRUCT_SIZE, "struct_size is 4294967295");

    options = engine_options;
    options.size = 100;
    FAILS(flashmat_engine_create(&options, &none), FLASHMAT_STATUS_SIZE, "size 100");
    options.size = 0xFFFFFF80u;
    FAILS(flashmat_engine_create(&options, &none), FLASHMAT_STATUS_SIZE, "size 4294967168");
    options = engine_options;
    options.level = 7;
    FAILS(flashmat_engine_create(&options, &none), FLASHMAT_STATUS_UNKNOWN_VALUE, "level: 7");
#ifdef __x86_64__
    options.level = FLASHMAT_LEVEL_NEON;
    FAILS(flashmat_engine_create(&options, &none), FLASHMAT_STATUS_LEVEL, "level neon");
#endif
    options = engine_options;
    options.threads = 257;
    FAILS(flashmat_engine_create(&options, &none), FLASHMAT_STATUS_INVALID_ARGUMENT, "threads: 257");

    options = engine_options;
    options.model = NULL;
    FAILS(flashmat_engine_create(&options, &none), FLASHMAT_STATUS_NULL_POINTER, "model is NULL");
    options = engine_options;
    options.model_bytes = 0;
    FAILS(flashmat_engine_create(&options, &none), FLASHMAT_STATUS_MODEL, "not a Flashmat model");
    options.model_bytes = engine_options.model_bytes - 1;
    FAILS(flashmat_engine_create(&options, &none), FLASHMAT_STATUS_MODEL, "cut short");
    options.model_bytes = (size_t)-1;
    FAILS(flashmat_engine_create(&options, &none), FLASHMAT_STATUS_INVALID_ARGUMENT, "do not fit in memory");
    memcpy(spoilt, engine_options.model, engine_options.model_bytes);
    spoilt[engine_options.model_bytes / 2] ^= 1;
    options.model = spoilt;
    options.model_bytes = engine_options.model_bytes;
    FAILS(flashmat_engine_create(&options, &none), FLASHMAT_STATUS_MODEL, "damaged");
    CHECK(none == NULL);
    free(spoilt);
    flashmat_engine_destroy(NULL);
    flashmat_engine_destroy(none);
}

static void pointers(void) {
    flashmat_frame frame = good_frame();
    flashmat_capture_options options = good_options();
    flashmat_maps maps = good_maps();
    flashmat_report report = good_report();
    flashmat_engine_info info;
    size_t bytes = 0;
    /* Room for a frame that starts off its alignment. */
    union {
        double align;
        unsigned char bytes[sizeof(flashmat_frame) + 8];
    } room;
    memset(&room, 0, sizeof room);
    memset(&info, 0, sizeof info);
    info.struct_size = sizeof info;

    FAILS(flashmat_capture(NULL, &frame, &options, &maps, &report), FLASHMAT_STATUS_NULL_POINTER, "engine is NULL");
    FAILS(flashmat_capture(engine, NULL, &options, &maps, &report), FLASHMAT_STATUS_NULL_POINTER, "frame is NULL");
    FAILS(flashmat_capture(engine, &frame, &options, NULL, &report), FLASHMAT_STATUS_NULL_POINTER, "maps is NULL");
    CHECK(flashmat_capture(engine, &frame, &options, &maps, NULL) == FLASHMAT_STATUS_OK);
    CHECK(flashmat_capture(engine, &frame, &options, &maps, &report) == FLASHMAT_STATUS_OK);
    FAILS(flashmat_capture(engine, (const flashmat_frame *)(const void *)(room.bytes + 1), &options, &maps, &report),
          FLASHMAT_STATUS_MISALIGNED, "frame is at");
    FAILS(flashmat_engine_get_info(NULL, &info), FLASHMAT_STATUS_NULL_POINTER, "engine is NULL");
    FAILS(flashmat_engine_get_info(engine, NULL), FLASHMAT_STATUS_NULL_POINTER, "info is NULL");
    info.struct_size = 4;
    FAILS(flashmat_engine_get_info(engine, &info), FLASHMAT_STATUS_STRUCT_SIZE, "info: struct_size is 4");
    FAILS(flashmat_cancel(NULL), FLASHMAT_STATUS_NULL_POINTER, "engine is NULL");
    FAILS(flashmat_cancel(engine), FLASHMAT_STATUS_IDLE, "no capture is running");
    FAILS(flashmat_workspace_bytes(NULL, &bytes), FLASHMAT_STATUS_NULL_POINTER, "options is NULL");
    FAILS(flashmat_workspace_bytes(&engine_options, NULL), FLASHMAT_STATUS_NULL_POINTER, "bytes is NULL");
    CHECK(bytes == 0);

    frame.planes[0].data = NULL;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_NULL_POINTER, "frame.planes[0].data is NULL");
    frame = good_frame();
    frame.format = FLASHMAT_FORMAT_NV12;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_NULL_POINTER, "frame.planes[1].data is NULL");
    frame.format = FLASHMAT_FORMAT_YUV420;
    frame.planes[1] = frame.planes[0];
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_NULL_POINTER, "frame.planes[2].data is NULL");
    frame = good_frame();
    frame.format = FLASHMAT_FORMAT_RGB16;
    frame.planes[0].data = photo + 1;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_MISALIGNED, "not aligned to 2");
    frame.format = FLASHMAT_FORMAT_RGB_F32;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_MISALIGNED, "not aligned to 4");
}

static void struct_sizes(void) {
    struct {
        flashmat_frame frame;
        unsigned char newer[16];
    } large;
    struct {
        flashmat_report report;
        unsigned char newer[16];
    } results;
    flashmat_frame frame = good_frame();
    flashmat_capture_options options = good_options();
    flashmat_maps maps = good_maps();

    frame.struct_size = 0;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_STRUCT_SIZE, "frame: struct_size is 0");
    frame.struct_size = sizeof frame - 4;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_STRUCT_SIZE, "frame: struct_size is");
    frame = good_frame();
    options.struct_size = 1;
    FAILS(capture(&frame, &options), FLASHMAT_STATUS_STRUCT_SIZE, "options: struct_size is 1");
    options = good_options();
    maps.struct_size = 8;
    FAILS(capture_maps(&maps), FLASHMAT_STATUS_STRUCT_SIZE, "maps: struct_size is 8");
    maps = good_maps();

    /* A program built with a newer header: fine as long as it leaves the new fields alone. */
    memset(&large, 0, sizeof large);
    large.frame = frame;
    large.frame.struct_size = sizeof large;
    CHECK(capture_frame(&large.frame) == FLASHMAT_STATUS_OK);
    large.newer[15] = 1;
    FAILS(capture_frame(&large.frame), FLASHMAT_STATUS_STRUCT_SIZE, "does not know");
    memset(&results, 7, sizeof results);
    results.report.struct_size = sizeof results;
    CHECK(flashmat_capture(engine, &frame, &options, &maps, &results.report) == FLASHMAT_STATUS_OK);
    CHECK(results.report.struct_size == sizeof results && results.newer[0] == 0 && results.newer[15] == 0);
    results.report.struct_size = 12;
    FAILS(flashmat_capture(engine, &frame, &options, &maps, &results.report), FLASHMAT_STATUS_STRUCT_SIZE, "report");
}

static void frames(void) {
    flashmat_frame frame = good_frame();
    float pixel[3] = {0.5f, -1.0f, 0.5f};

    frame.width = 0;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_FRAME_EMPTY, "no pixels");
    frame = good_frame();
    frame.height = 0;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_FRAME_EMPTY, "no pixels");
    frame.height = 0xFFFFFFFFu;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_FRAME_TOO_LARGE, "size");
    frame = good_frame();
    frame.width = 0xFFFFFFFFu;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_FRAME_TOO_LARGE, "size");
    frame = good_frame();
    frame.planes[0].bytes--;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_FRAME_BUFFER, "too short");
    frame.planes[0].bytes = 0;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_FRAME_BUFFER, "too short");
    frame.planes[0].bytes = (size_t)-1;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_INVALID_ARGUMENT, "do not fit in memory");
    frame = good_frame();
    frame.planes[0].row_stride = 3 * SIDE - 1;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_FRAME_STRIDE, "stride too small");
    frame.planes[0].row_stride = (size_t)-1;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_FRAME_TOO_LARGE, "size");
    frame = good_frame();
    frame.planes[0].pixel_stride = 4;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_INVALID_ARGUMENT, "pixel_stride is 4");
    frame = good_frame();
    frame.format = FLASHMAT_FORMAT_RGB16;
    frame.planes[0].row_stride = 6 * SIDE + 1;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_INVALID_ARGUMENT, "no whole number");
    frame = good_frame();
    frame.planes[1] = frame.planes[0];
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_INVALID_ARGUMENT, "planes[1] is set");
    frame = good_frame();
    frame.format = FLASHMAT_FORMAT_YUV420;
    frame.planes[2] = frame.planes[1] = frame.planes[0];
    frame.planes[2].pixel_stride = 2;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_INVALID_ARGUMENT, "same strides");

    frame = good_frame();
    frame.format = 0;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_UNKNOWN_VALUE, "frame.format: 0");
    frame.format = 9;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_UNKNOWN_VALUE, "frame.format: 9");
    frame = good_frame();
    frame.rotation = 45;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_UNKNOWN_VALUE, "frame.rotation: 45");
    frame = good_frame();
    frame.encoding = 4;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_UNKNOWN_VALUE, "frame.encoding: 4");
    frame = good_frame();
    frame.yuv_matrix = 3;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_UNKNOWN_VALUE, "frame.yuv_matrix: 3");
    frame.yuv_matrix = FLASHMAT_YUV_MATRIX_BT709;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_INVALID_ARGUMENT, "are for YUV");
    frame = good_frame();
    frame.yuv_range = 3;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_UNKNOWN_VALUE, "frame.yuv_range: 3");

    frame = good_frame();
    frame.format = FLASHMAT_FORMAT_RGB_F32;
    frame.width = frame.height = 1;
    frame.planes[0].data = pixel;
    frame.planes[0].bytes = sizeof pixel;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_FRAME_PIXEL, "pixel (0, 0)");
    pixel[1] = 0.0f / 1.0f;
    pixel[0] = pixel[2] = 0.0f;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_PHOTO_BLACK, "black");
    pixel[0] = pixel[1] = pixel[2] = 1.0f;
    FAILS(capture_frame(&frame), FLASHMAT_STATUS_NO_USABLE_PIXELS, "overexposed");
}

static void options_and_maps(void) {
    flashmat_frame frame = good_frame();
    flashmat_capture_options options = good_options();
    flashmat_maps maps = good_maps();
    flashmat_report report = good_report();
    float *before = (float *)must_malloc(maps.albedo.bytes);

    options.class_override = 9;
    FAILS(capture(&frame, &options), FLASHMAT_STATUS_UNKNOWN_VALUE, "class_override: 9");
    options = good_options();
    options.skip_refinement = 2;
    FAILS(capture(&frame, &options), FLASHMAT_STATUS_UNKNOWN_VALUE, "skip_refinement: 2");
    options = good_options();
    options.photo_fov_deg = 60.0f;
    options.focal_35mm = 26.0f;
    FAILS(capture(&frame, &options), FLASHMAT_STATUS_INVALID_ARGUMENT, "both set");
    options.focal_35mm = 0.0f;
    options.photo_fov_deg = 171.0f;
    FAILS(capture(&frame, &options), FLASHMAT_STATUS_FIELD_OF_VIEW, "1 to 170");
    options = good_options();
    options.target_fov_deg = -1.0f;
    FAILS(capture(&frame, &options), FLASHMAT_STATUS_FIELD_OF_VIEW, "1 to 170");
    options = good_options();
    options.light_scale = -1.0f;
    FAILS(capture(&frame, &options), FLASHMAT_STATUS_INVALID_ARGUMENT, "0.001 to 1000");

    memset(albedo, 0x5A, maps.albedo.bytes);
    memcpy(before, albedo, maps.albedo.bytes);
    maps.format = 2;
    FAILS(capture_maps(&maps), FLASHMAT_STATUS_UNKNOWN_VALUE, "maps.format: 2");
    maps = good_maps();
    maps.albedo.bytes--;
    FAILS(capture_maps(&maps), FLASHMAT_STATUS_BUFFER_TOO_SMALL, "maps.albedo: 196607 bytes given, 196608 needed");
    maps.albedo.data = NULL;
    FAILS(capture_maps(&maps), FLASHMAT_STATUS_NULL_POINTER, "maps.albedo is NULL");
    maps = good_maps();
    maps.observability.bytes = 1;
    FAILS(capture_maps(&maps), FLASHMAT_STATUS_NULL_POINTER, "maps.observability is NULL");
    maps = good_maps();
    maps.albedo.data = (unsigned char *)albedo + 1;
    FAILS(capture_maps(&maps), FLASHMAT_STATUS_MISALIGNED, "maps.albedo is at");
    maps = good_maps();
    maps.albedo.bytes = (size_t)-1;
    FAILS(capture_maps(&maps), FLASHMAT_STATUS_INVALID_ARGUMENT, "do not fit in memory");
    CHECK(memcmp(before, albedo, 3 * PLANE * sizeof(float)) == 0);
    free(before);

    /* Nothing wanted but the report; results that lie on each other are nonsense, not a crash. */
    memset(&maps, 0, sizeof maps);
    maps.struct_size = sizeof maps;
    CHECK(flashmat_capture(engine, &frame, NULL, &maps, &report) == FLASHMAT_STATUS_OK);
    CHECK(report.material_class >= 1 && report.material_class <= 8 && report.solver[0].iterations > 0);
    CHECK(strlen(flashmat_class_name(report.material_class)) > 0);
    maps = good_maps();
    maps.normal = maps.albedo;
    CHECK(capture_maps(&maps) == FLASHMAT_STATUS_OK);
}

static void workspaces(void) {
    flashmat_frame frame = good_frame();
    flashmat_capture_options options = good_options();
    flashmat_engine_options wrong = engine_options;
    flashmat_maps maps = good_maps();
    size_t bytes = 0;
    unsigned char *memory;
    CHECK(flashmat_workspace_bytes(&engine_options, &bytes) == FLASHMAT_STATUS_OK);
    memory = (unsigned char *)must_malloc(bytes);
#define IN(engine_options, memory, bytes, frame, maps) \
    flashmat_capture_in(engine_options, memory, bytes, frame, &options, maps, NULL)
    CHECK(IN(&engine_options, memory, bytes, &frame, &maps) == FLASHMAT_STATUS_OK);
    FAILS(IN(NULL, memory, bytes, &frame, &maps), FLASHMAT_STATUS_NULL_POINTER, "engine_options is NULL");
    FAILS(IN(&engine_options, NULL, bytes, &frame, &maps), FLASHMAT_STATUS_NULL_POINTER, "workspace is NULL");
    FAILS(IN(&engine_options, memory, bytes, NULL, &maps), FLASHMAT_STATUS_NULL_POINTER, "frame is NULL");
    FAILS(IN(&engine_options, memory, bytes, &frame, NULL), FLASHMAT_STATUS_NULL_POINTER, "maps is NULL");
    FAILS(IN(&engine_options, memory, bytes - 1, &frame, &maps), FLASHMAT_STATUS_WORKSPACE_TOO_SMALL, "too small");
    FAILS(IN(&engine_options, memory, 0, &frame, &maps), FLASHMAT_STATUS_WORKSPACE_TOO_SMALL, "too small");
    wrong.threads = 2;
    FAILS(IN(&wrong, memory, bytes, &frame, &maps), FLASHMAT_STATUS_INVALID_ARGUMENT, "threads: 2");
    wrong = engine_options;
    wrong.size = 100;
    FAILS(IN(&wrong, memory, bytes, &frame, &maps), FLASHMAT_STATUS_SIZE, "size 100");
    maps.albedo.data = memory + 64;
    FAILS(IN(&engine_options, memory, bytes, &frame, &maps), FLASHMAT_STATUS_INVALID_ARGUMENT, "overlaps");
    maps = good_maps();
    frame.planes[0].data = memory;
    FAILS(IN(&engine_options, memory, bytes, &frame, &maps), FLASHMAT_STATUS_INVALID_ARGUMENT, "overlaps");
    free(memory);
}

static void names(void) {
    int32_t i;
    CHECK(flashmat_abi_version() == FLASHMAT_ABI_VERSION);
    CHECK(strlen(flashmat_version()) >= 5);
    for (i = 0; i <= FLASHMAT_STATUS_WORKSPACE_TOO_SMALL; i++) {
        CHECK(strncmp(flashmat_status_name(i), "FLASHMAT_STATUS_", 16) == 0 && strlen(flashmat_status_text(i)) > 0);
    }
    CHECK(flashmat_status_name(i)[0] == '\0' && flashmat_status_text(-1)[0] == '\0');
    CHECK(strcmp(flashmat_class_name(FLASHMAT_CLASS_STONE_SPEC), "stone-spec") == 0);
    CHECK(flashmat_class_name(0)[0] == '\0' && flashmat_class_name(9)[0] == '\0');
    CHECK(strcmp(flashmat_stage_name(FLASHMAT_STAGE_FRAME), "frame") == 0 && flashmat_stage_name(FLASHMAT_STAGE_RELIGHT + 1)[0] == '\0');
    CHECK(strcmp(flashmat_level_name(FLASHMAT_LEVEL_I8MM), "i8mm") == 0 && flashmat_level_name(0)[0] == '\0');
    CHECK(flashmat_level_name(0xFFFFFFFFu)[0] == '\0');
}

static int32_t swallow(void *user, const void *data, size_t bytes) {
    CHECK(user == NULL && data != NULL && bytes > 0);
    return 0;
}

static void exports(void) {
    flashmat_report report = good_report();
    flashmat_maps maps = good_maps();
    void *normal = must_malloc(3 * PLANE * sizeof(float)), *roughness = must_malloc(PLANE * sizeof(float));
    memset(normal, 0, 3 * PLANE * sizeof(float));
    memset(roughness, 0, PLANE * sizeof(float));
    memset(albedo, 0, 3 * PLANE * sizeof(float));
    maps.normal.data = normal;
    maps.normal.bytes = 3 * PLANE * sizeof(float);
    maps.roughness.data = roughness;
    maps.roughness.bytes = PLANE * sizeof(float);
    report.f0 = 0.05f;
    report.fov_deg = 43.35f;
    CHECK(flashmat_export_glb(SIZE, &maps, &report, "oak", swallow, NULL) == FLASHMAT_STATUS_OK);
    FAILS(flashmat_export_glb(SIZE, NULL, &report, "oak", swallow, NULL), FLASHMAT_STATUS_NULL_POINTER, "maps is NULL");
    FAILS(flashmat_export_glb(SIZE, &maps, NULL, "oak", swallow, NULL), FLASHMAT_STATUS_NULL_POINTER, "report is");
    FAILS(flashmat_export_glb(SIZE, &maps, &report, NULL, swallow, NULL), FLASHMAT_STATUS_NULL_POINTER, "name is NULL");
    FAILS(flashmat_export_glb(SIZE, &maps, &report, "oak", NULL, NULL), FLASHMAT_STATUS_NULL_POINTER, "write is NULL");
    FAILS(flashmat_export_glb(SIZE, &maps, &report, "\xFF", swallow, NULL), FLASHMAT_STATUS_INVALID_ARGUMENT, "UTF-8");
    FAILS(flashmat_export_glb(0, &maps, &report, "oak", swallow, NULL), FLASHMAT_STATUS_INVALID_ARGUMENT, "size: 0");
    FAILS(flashmat_export_glb(0xFFFFFFFFu, &maps, &report, "oak", swallow, NULL), FLASHMAT_STATUS_INVALID_ARGUMENT,
          "size: 4294967295");
    FAILS(flashmat_export_glb(SIZE + 1, &maps, &report, "oak", swallow, NULL), FLASHMAT_STATUS_BUFFER_TOO_SMALL,
          "maps.albedo");
    report.f0 = 1.0f;
    FAILS(flashmat_export_glb(SIZE, &maps, &report, "oak", swallow, NULL), FLASHMAT_STATUS_INVALID_ARGUMENT, "F0");
    report.f0 = 0.05f;
    report.fov_deg = 0.0f;
    FAILS(flashmat_export_glb(SIZE, &maps, &report, "oak", swallow, NULL), FLASHMAT_STATUS_INVALID_ARGUMENT, "field of");
    report = good_report();
    report.struct_size = 0;
    FAILS(flashmat_export_glb(SIZE, &maps, &report, "oak", swallow, NULL), FLASHMAT_STATUS_STRUCT_SIZE, "report");
    maps.roughness.data = NULL;
    maps.roughness.bytes = 0;
    FAILS(flashmat_export_glb(SIZE, &maps, &report, "oak", swallow, NULL), FLASHMAT_STATUS_NULL_POINTER,
          "maps.roughness is NULL");
    maps.format = 2;
    FAILS(flashmat_export_glb(SIZE, &maps, &report, "oak", swallow, NULL), FLASHMAT_STATUS_UNKNOWN_VALUE, "format: 2");
    free(normal);
    free(roughness);
}

int main(int count, char **arguments) {
    flashmat_frame frame;
    unsigned char *model;
    if (count != 2) {
        fprintf(stderr, "misuse MODEL\n");
        return 2;
    }
    CHECK(flashmat_last_error()[0] == '\0');
    photo = (unsigned char *)must_malloc(3 * SIDE * SIDE);
    paint(photo, SIDE);
    albedo = (float *)must_malloc(3 * PLANE * sizeof(float));
    memset(&engine_options, 0, sizeof engine_options);
    engine_options.struct_size = sizeof engine_options;
    engine_options.size = SIZE;
    engine_options.threads = 1;
    model = read_file(arguments[1], &engine_options.model_bytes);
    engine_options.model = model;
    create();
    CHECK(flashmat_engine_create(&engine_options, &engine) == FLASHMAT_STATUS_OK);
    pointers();
    struct_sizes();
    frames();
    options_and_maps();
    workspaces();
    exports();
    names();
    frame = good_frame();
    CHECK(capture_frame(&frame) == FLASHMAT_STATUS_OK);
    flashmat_engine_destroy(engine);
    free(model);
    free(photo);
    free(albedo);
    return summary();
}
