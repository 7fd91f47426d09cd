/* What the C tests share: a check that says where it failed, and reading a file. */
#ifndef CHECK_H
#define CHECK_H

#include <flashmat.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int checks = 0;
static int failures = 0;

static inline void check(int good, const char *what, const char *file, int line) {
    checks++;
    if (!good) {
        failures++;
        fprintf(stderr, "%s:%d: %s (last error: %s)\n", file, line, what, flashmat_last_error());
    }
}

#define CHECK(condition) check(!!(condition), #condition, __FILE__, __LINE__)

/* That a call gave this status, and a text that has this in it. */
static inline void check_status(int32_t got, int32_t wanted, const char *text, const char *file, int line) {
    checks++;
    if (got != wanted || strstr(flashmat_last_error(), text) == NULL) {
        failures++;
        fprintf(stderr, "%s:%d: %s instead of %s, \"%s\" instead of \"%s\"\n", file, line, flashmat_status_name(got),
                flashmat_status_name(wanted), flashmat_last_error(), text);
    }
}

#define FAILS(call, status, text) check_status((int32_t)(call), status, text, __FILE__, __LINE__)

static inline int summary(void) {
    printf("%d checks, %d failed\n", checks, failures);
    return failures != 0;
}

static inline void *must_malloc(size_t bytes) {
    void *memory = malloc(bytes);
    if (memory == NULL) {
        fprintf(stderr, "out of memory\n");
        exit(2);
    }
    return memory;
}

static inline unsigned char *read_file(const char *path, size_t *bytes) {
    FILE *file = fopen(path, "rb");
    long end;
    unsigned char *data;
    if (file == NULL || fseek(file, 0, SEEK_END) != 0 || (end = ftell(file)) < 0) {
        perror(path);
        exit(2);
    }
    rewind(file);
    *bytes = (size_t)end;
    data = (unsigned char *)must_malloc(*bytes);
    if (fread(data, 1, *bytes, file) != *bytes) {
        perror(path);
        exit(2);
    }
    fclose(file);
    return data;
}

/* A surface of checks under a flash: any sensible photo will do. */
static inline void paint(unsigned char *rgb, int side) {
    int x, y;
    for (y = 0; y < side; y++) {
        for (x = 0; x < side; x++) {
            int dx = x - side / 2, dy = y - side / 2;
            int light = 200 - 160 * (dx * dx + dy * dy) / (side * side);
            int dark = (x / 16 + y / 16) % 2 + 1;
            unsigned char *pixel = rgb + 3 * (y * side + x);
            pixel[0] = (unsigned char)(light / dark);
            pixel[1] = (unsigned char)(light / dark / 2);
            pixel[2] = (unsigned char)(light / 4);
        }
    }
}

#endif
