/* Captures over and over in one process and prints its resident memory: soak MODEL CAPTURES [refine]. Fails if memory
 * grew after the first tenth. Engines are made and destroyed on the way. */
#include "check.h"

#define SIZE 128
#define SIDE 140
#define PLANE ((size_t)SIZE * SIZE)

/* Resident memory in KiB (Linux); 0 elsewhere. */
static long resident(void) {
    char line[256];
    long kib = 0;
    FILE *file = fopen("/proc/self/status", "r");
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

int main(int count, char **arguments) {
    flashmat_engine_options engine_options;
    flashmat_frame frame;
    flashmat_capture_options options;
    flashmat_maps maps;
    flashmat_report report;
    flashmat_engine *engine = NULL;
    unsigned char *model, *photo = (unsigned char *)must_malloc(3 * SIDE * SIDE);
    unsigned char *codes = (unsigned char *)must_malloc(7 * PLANE);
    long captures, i, early = 0, most = 0;
    if (count < 3 || (captures = strtol(arguments[2], NULL, 10)) < 10) {
        fprintf(stderr, "soak MODEL CAPTURES [refine]\n");
        return 2;
    }
    paint(photo, SIDE);
    memset(&engine_options, 0, sizeof engine_options);
    engine_options.struct_size = sizeof engine_options;
    engine_options.size = SIZE;
    engine_options.threads = 2;
    model = read_file(arguments[1], &engine_options.model_bytes);
    engine_options.model = model;
    memset(&frame, 0, sizeof frame);
    frame.struct_size = sizeof frame;
    frame.format = FLASHMAT_FORMAT_RGB8;
    frame.width = frame.height = SIDE;
    frame.planes[0].data = photo;
    frame.planes[0].bytes = 3 * SIDE * SIDE;
    memset(&options, 0, sizeof options);
    options.struct_size = sizeof options;
    options.skip_refinement = count < 4;
    memset(&maps, 0, sizeof maps);
    maps.struct_size = sizeof maps;
    maps.format = FLASHMAT_MAP_FORMAT_U8;
    maps.albedo.data = codes;
    maps.albedo.bytes = maps.normal.bytes = 3 * PLANE;
    maps.normal.data = codes + 3 * PLANE;
    maps.roughness.data = codes + 6 * PLANE;
    maps.roughness.bytes = PLANE;
    memset(&report, 0, sizeof report);
    report.struct_size = sizeof report;
    printf("captures  resident KiB\n");
    for (i = 0; i < captures; i++) {
        /* A new engine now and then, a capture that fails, and one that is refused before it starts. */
        if (i % 50 == 0) {
            flashmat_engine_destroy(engine);
            CHECK(flashmat_engine_create(&engine_options, &engine) == FLASHMAT_STATUS_OK);
            frame.format = 99;
            CHECK(flashmat_capture(engine, &frame, &options, &maps, &report) == FLASHMAT_STATUS_UNKNOWN_VALUE);
            frame.format = FLASHMAT_FORMAT_RGB8;
        }
        CHECK(flashmat_capture(engine, &frame, &options, &maps, &report) == FLASHMAT_STATUS_OK);
        if ((i + 1) % (captures / 10) == 0) {
            long now = resident();
            printf("%8ld  %12ld\n", i + 1, now);
            fflush(stdout);
            if (early == 0) {
                early = now;
            }
            most = now > most ? now : most;
        }
    }
    /* Pages of allocators come and go; a leak of one byte per capture's row would be far more. */
    CHECK(most <= early + 512);
    flashmat_engine_destroy(engine);
    free(model);
    free(photo);
    free(codes);
    return summary();
}
