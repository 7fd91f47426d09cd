/* Runs the captures that the Rust test wrote into files and writes what the C functions made of them:
 * parity MODEL CASE OUT [CASE OUT ...]. Frames and results lie in exact allocations, for the sanitizers' sake. */
#include "check.h"

#define SIZE 128
#define RESULTS 6

static const size_t CHANNELS[RESULTS] = {3, 3, 1, 3, 3, 1};

static uint32_t number(const unsigned char **at) {
    uint32_t value;
    memcpy(&value, *at, sizeof value);
    *at += sizeof value;
    return value;
}

static float real(const unsigned char **at) {
    float value;
    memcpy(&value, *at, sizeof value);
    *at += sizeof value;
    return value;
}

static flashmat_maps new_maps(uint32_t format) {
    flashmat_maps maps;
    flashmat_buffer *buffers = &maps.albedo;
    size_t value = format == FLASHMAT_MAP_FORMAT_F32 ? sizeof(float) : 1;
    int i;
    memset(&maps, 0, sizeof maps);
    maps.struct_size = sizeof maps;
    maps.format = format;
    for (i = 0; i < RESULTS; i++) {
        buffers[i].bytes = CHANNELS[i] * SIZE * SIZE * value;
        buffers[i].data = must_malloc(buffers[i].bytes);
    }
    return maps;
}

static void free_maps(flashmat_maps *maps) {
    flashmat_buffer *buffers = &maps->albedo;
    int i;
    for (i = 0; i < RESULTS; i++) {
        free(buffers[i].data);
    }
}

static void write_maps(FILE *file, const flashmat_maps *maps) {
    const flashmat_buffer *buffers = &maps->albedo;
    int i;
    for (i = 0; i < RESULTS; i++) {
        CHECK(fwrite(buffers[i].data, 1, buffers[i].bytes, file) == buffers[i].bytes);
    }
}

static int same_maps(const flashmat_maps *a, const flashmat_maps *b) {
    int i, same = 1;
    for (i = 0; i < RESULTS; i++) {
        same &= memcmp((&a->albedo)[i].data, (&b->albedo)[i].data, (&a->albedo)[i].bytes) == 0;
    }
    return same;
}

/* What an export wrote. */
typedef struct {
    unsigned char *bytes;
    size_t count;
    int calls_left;
} bytes_sink;

static int32_t collect(void *user, const void *data, size_t bytes) {
    bytes_sink *sink = (bytes_sink *)user;
    unsigned char *longer;
    if (sink->calls_left == 0) {
        return 1;
    }
    sink->calls_left--;
    longer = (unsigned char *)realloc(sink->bytes, sink->count + bytes);
    CHECK(longer != NULL);
    memcpy(longer + sink->count, data, bytes);
    sink->bytes = longer;
    sink->count += bytes;
    return 0;
}

/* The file of float maps and of codes is the same; it goes behind the results. */
static void write_glb(FILE *results, const flashmat_maps *floats, const flashmat_maps *codes,
                      const flashmat_report *report) {
    bytes_sink first = {NULL, 0, 100}, second = {NULL, 0, 100}, stopped = {NULL, 0, 1};
    CHECK(flashmat_export_glb(SIZE, floats, report, "parity", collect, &first) == FLASHMAT_STATUS_OK);
    CHECK(flashmat_export_glb(SIZE, codes, report, "parity", collect, &second) == FLASHMAT_STATUS_OK);
    CHECK(first.count == second.count && memcmp(first.bytes, second.bytes, first.count) == 0);
    CHECK(flashmat_export_glb(SIZE, codes, report, "parity", collect, &stopped) == FLASHMAT_STATUS_CANCELLED);
    CHECK(fwrite(first.bytes, 1, first.count, results) == first.count);
    free(first.bytes);
    free(second.bytes);
    free(stopped.bytes);
}

static void run_case(flashmat_engine *engine, const flashmat_engine_options *engine_options, const char *in,
                     const char *out) {
    size_t bytes, workspace_bytes = 0;
    unsigned char *file = read_file(in, &bytes);
    const unsigned char *at = file;
    void *planes[3] = {NULL, NULL, NULL};
    flashmat_frame frame;
    flashmat_capture_options options;
    flashmat_maps floats = new_maps(FLASHMAT_MAP_FORMAT_F32), codes = new_maps(FLASHMAT_MAP_FORMAT_U8);
    flashmat_maps again = new_maps(FLASHMAT_MAP_FORMAT_F32);
    flashmat_report report, second;
    void *workspace;
    FILE *results;
    uint32_t count, i;

    memset(&frame, 0, sizeof frame);
    memset(&options, 0, sizeof options);
    memset(&report, 0, sizeof report);
    frame.struct_size = sizeof frame;
    options.struct_size = sizeof options;
    report.struct_size = sizeof report;
    second = report;
    frame.format = number(&at);
    frame.width = number(&at);
    frame.height = number(&at);
    frame.rotation = number(&at);
    frame.encoding = number(&at);
    frame.yuv_matrix = number(&at);
    frame.yuv_range = number(&at);
    options.class_override = number(&at);
    options.skip_refinement = number(&at);
    options.photo_fov_deg = real(&at);
    options.focal_35mm = real(&at);
    options.target_fov_deg = real(&at);
    options.light_scale = real(&at);
    count = number(&at);
    for (i = 0; i < count; i++) {
        frame.planes[i].bytes = number(&at);
        frame.planes[i].row_stride = number(&at);
        frame.planes[i].pixel_stride = number(&at);
        planes[i] = must_malloc(frame.planes[i].bytes);
        memcpy(planes[i], at, frame.planes[i].bytes);
        frame.planes[i].data = planes[i];
        at += frame.planes[i].bytes;
    }
    CHECK(at == file + bytes);

    CHECK(flashmat_capture(engine, &frame, &options, &floats, &report) == FLASHMAT_STATUS_OK);
    CHECK(report.struct_size == sizeof report);
    CHECK(flashmat_capture(engine, &frame, &options, &codes, NULL) == FLASHMAT_STATUS_OK);
    CHECK(flashmat_workspace_bytes(engine_options, &workspace_bytes) == FLASHMAT_STATUS_OK);
    workspace = must_malloc(workspace_bytes);
    CHECK(flashmat_capture_in(engine_options, workspace, workspace_bytes, &frame, &options, &again, &second) ==
          FLASHMAT_STATUS_OK);
    free(workspace);
    CHECK(same_maps(&floats, &again));
    CHECK(memcmp(&report, &second, sizeof report) == 0);

    results = fopen(out, "wb");
    CHECK(results != NULL);
    if (results != NULL) {
        CHECK(fwrite(&report, 1, sizeof report, results) == sizeof report);
        write_maps(results, &floats);
        write_maps(results, &codes);
        write_glb(results, &floats, &codes, &report);
        CHECK(fclose(results) == 0);
    }
    for (i = 0; i < 3; i++) {
        free(planes[i]);
    }
    free_maps(&floats);
    free_maps(&codes);
    free_maps(&again);
    free(file);
}

int main(int count, char **arguments) {
    flashmat_engine_options options;
    flashmat_engine_info info;
    flashmat_engine *engine = NULL;
    unsigned char *model;
    int i;
    if (count < 4) {
        fprintf(stderr, "parity MODEL CASE OUT ...\n");
        return 2;
    }
    memset(&options, 0, sizeof options);
    options.struct_size = sizeof options;
    options.size = SIZE;
    options.threads = 1;
    model = read_file(arguments[1], &options.model_bytes);
    options.model = model;
    CHECK(flashmat_engine_create(&options, &engine) == FLASHMAT_STATUS_OK);
    memset(&info, 0, sizeof info);
    info.struct_size = sizeof info;
    CHECK(flashmat_engine_get_info(engine, &info) == FLASHMAT_STATUS_OK);
    CHECK(info.size == SIZE && info.level != FLASHMAT_LEVEL_AUTO && info.workspace_bytes > 0);
    printf("level %s\n", flashmat_level_name(info.level));
    for (i = 2; i + 1 < count; i += 2) {
        run_case(engine, &options, arguments[i], arguments[i + 1]);
    }
    flashmat_engine_destroy(engine);
    free(model);
    return summary();
}
