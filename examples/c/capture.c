/* One flash photo to material maps: capture PHOTO.ppm FOLDER [MODEL.fmat]
 *
 * Reads a binary PPM (P6, 8 bits) and writes albedo.ppm, normal.ppm, roughness.pgm and material.glb into the folder.
 * Without a model file the one embedded in the library is used. C99; builds as C++17 too. docs/abi.md tells how to link. */
#include <flashmat.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define SIZE 256

/* The bytes of a whole file, or NULL with a line on stderr. Free it with free. */
static unsigned char *read_file(const char *path, size_t *bytes) {
    FILE *file = fopen(path, "rb");
    unsigned char *data = NULL;
    long end = -1;
    if (file != NULL && fseek(file, 0, SEEK_END) == 0 && (end = ftell(file)) > 0) {
        rewind(file);
        data = (unsigned char *)malloc((size_t)end);
        if (data != NULL && fread(data, 1, (size_t)end, file) != (size_t)end) {
            free(data);
            data = NULL;
        }
    }
    if (file != NULL) {
        fclose(file);
    }
    if (data == NULL) {
        fprintf(stderr, "%s: cannot be read, or is empty\n", path);
        return NULL;
    }
    *bytes = (size_t)end;
    return data;
}

/* The next number of a PPM's header; -1 if there is none. Moves *at behind it. */
static long header_number(const unsigned char *data, size_t bytes, size_t *at) {
    long value = -1;
    while (*at < bytes && (strchr(" \t\r\n", data[*at]) != NULL || data[*at] == '#')) {
        if (data[*at] == '#') {
            while (*at < bytes && data[*at] != '\n') {
                ++*at;
            }
        } else {
            ++*at;
        }
    }
    while (*at < bytes && data[*at] >= '0' && data[*at] <= '9' && value < 1000000) {
        value = (value < 0 ? 0 : value) * 10 + (data[*at] - '0');
        ++*at;
    }
    return value;
}

/* Describes the pixels of a PPM as a frame; they stay where they are. 0 if it is no PPM. */
static int ppm_frame(const unsigned char *data, size_t bytes, flashmat_frame *frame) {
    size_t at = 2;
    long width, height, most;
    if (bytes < 2 || data[0] != 'P' || data[1] != '6') {
        return 0;
    }
    width = header_number(data, bytes, &at);
    height = header_number(data, bytes, &at);
    most = header_number(data, bytes, &at);
    if (width < 1 || height < 1 || most != 255 || at >= bytes) {
        return 0;
    }
    at++; /* the one white space before the pixels */
    memset(frame, 0, sizeof *frame);
    frame->struct_size = sizeof *frame;
    frame->format = FLASHMAT_FORMAT_RGB8;
    frame->width = (uint32_t)width;
    frame->height = (uint32_t)height;
    frame->planes[0].data = data + at;
    frame->planes[0].bytes = bytes - at; /* too few are the library's to notice */
    return 1;
}

/* Writes a map as PPM (3 channels) or PGM (1). */
static int write_map(const char *folder, const char *name, const unsigned char *map, int channels) {
    char path[4096];
    FILE *file;
    size_t bytes = (size_t)channels * SIZE * SIZE;
    int good;
    if ((size_t)snprintf(path, sizeof path, "%s/%s", folder, name) >= sizeof path) {
        fprintf(stderr, "%s: the path is too long\n", folder);
        return 0;
    }
    file = fopen(path, "wb");
    if (file == NULL) {
        perror(path);
        return 0;
    }
    good = fprintf(file, "P%c\n%d %d\n255\n", channels == 3 ? '6' : '5', SIZE, SIZE) > 0;
    good = fwrite(map, 1, bytes, file) == bytes && good;
    good = fclose(file) == 0 && good;
    if (!good) {
        perror(path);
    }
    return good;
}

static int32_t to_file(void *user, const void *data, size_t bytes) {
    return fwrite(data, 1, bytes, (FILE *)user) == bytes ? 0 : 1;
}

/* Writes the material as binary glTF. */
static int write_glb(const char *folder, const flashmat_maps *maps, const flashmat_report *report) {
    char path[4096];
    FILE *file;
    int good;
    if ((size_t)snprintf(path, sizeof path, "%s/material.glb", folder) >= sizeof path) {
        return 0; /* write_map said so */
    }
    file = fopen(path, "wb");
    if (file == NULL) {
        perror(path);
        return 0;
    }
    good = flashmat_export_glb(SIZE, maps, report, "material", to_file, file) == FLASHMAT_STATUS_OK;
    good = fclose(file) == 0 && good;
    if (!good) {
        fprintf(stderr, "%s: %s\n", path, flashmat_last_error());
    }
    return good;
}

static int32_t show_progress(void *user, uint32_t stage, float fraction) {
    (void)user;
    fprintf(stderr, "\r%-14s %3d %%", flashmat_stage_name(stage), (int)(100.0f * fraction));
    return 0; /* go on */
}

static int failed(const char *what) {
    fprintf(stderr, "\n%s: %s\n", what, flashmat_last_error());
    return 0;
}

/* The whole capture; all memory is the caller's. */
static int capture(flashmat_engine *engine, const flashmat_frame *frame, const char *photo, const char *folder,
                   unsigned char *memory) {
    flashmat_capture_options options;
    flashmat_maps maps;
    flashmat_report report;
    unsigned char *albedo = memory, *normal = memory + 3 * SIZE * SIZE, *roughness = memory + 6 * SIZE * SIZE;

    memset(&options, 0, sizeof options);
    options.struct_size = sizeof options;
    options.progress = show_progress;

    memset(&maps, 0, sizeof maps);
    maps.struct_size = sizeof maps;
    maps.format = FLASHMAT_MAP_FORMAT_U8;
    maps.albedo.data = albedo;
    maps.albedo.bytes = 3 * SIZE * SIZE;
    maps.normal.data = normal;
    maps.normal.bytes = 3 * SIZE * SIZE;
    maps.roughness.data = roughness;
    maps.roughness.bytes = SIZE * SIZE;

    memset(&report, 0, sizeof report);
    report.struct_size = sizeof report;

    if (flashmat_capture(engine, frame, &options, &maps, &report) != FLASHMAT_STATUS_OK) {
        return failed(photo);
    }
    fprintf(stderr, "\r%20s\r", "");
    printf("class %s (%.0f %%), light %.3f, residual %.4f\n", flashmat_class_name(report.material_class),
           100.0 * (double)report.probabilities[report.material_class - 1], (double)report.light_scale,
           (double)report.residual);
    return write_map(folder, "albedo.ppm", albedo, 3) && write_map(folder, "normal.ppm", normal, 3) &&
           write_map(folder, "roughness.pgm", roughness, 1) && write_glb(folder, &maps, &report);
}

int main(int count, char **arguments) {
    flashmat_engine_options options;
    flashmat_engine *engine = NULL;
    flashmat_frame frame;
    unsigned char *photo, *model = NULL, *memory;
    size_t bytes = 0;
    int good = 0;

    if (count != 3 && count != 4) {
        fprintf(stderr, "capture PHOTO.ppm FOLDER [MODEL.fmat]\nlibrary %s\n", flashmat_version());
        return 2;
    }
    memset(&options, 0, sizeof options);
    options.struct_size = sizeof options;
    options.size = SIZE;
    photo = read_file(arguments[1], &bytes);
    if (count == 4) {
        model = read_file(arguments[3], &options.model_bytes);
        options.model = model;
    }
    memory = (unsigned char *)malloc(7 * SIZE * SIZE);
    if (photo != NULL && memory != NULL && (count == 3 || model != NULL)) {
        if (!ppm_frame(photo, bytes, &frame)) {
            fprintf(stderr, "%s: not a binary PPM with 8 bits\n", arguments[1]);
        } else if (flashmat_engine_create(&options, &engine) != FLASHMAT_STATUS_OK) {
            failed("engine");
        } else {
            good = capture(engine, &frame, arguments[1], arguments[2], memory);
        }
    }
    flashmat_engine_destroy(engine);
    free(memory);
    free(model);
    free(photo);
    return good ? 0 : 1;
}
