/* One capture without an operating system: the toy model, a painted photo, memory of this program alone. Prints a
 * checksum of the maps; the same program on a host prints the same (check.sh). */
#include <flashmat.h>

#define SIZE 128
#define SIDE 140

/* From model.S, and the platform's (cortex-m4.c, or the host's below). */
extern const unsigned char model[], model_end[];
void print(const char *text);
void finish(int status);

#ifdef HOSTED
#include <stdio.h>
#include <stdlib.h>
void print(const char *text) { fputs(text, stdout); }
void finish(int status) { exit(status); }
/* Named by the prebuilt core library's unwind tables; nothing unwinds. */
void rust_eh_personality(void);
void rust_eh_personality(void) {}
#endif

/* What the library's panic handler calls. It never does. */
void flashmat_on_panic(void);
void flashmat_on_panic(void) {
    print("panic\n");
    finish(3);
    for (;;) {
    }
}

#define WORKSPACE ((size_t)WORKSPACE_MIB << 20)
__attribute__((section(".large"))) static unsigned char workspace[WORKSPACE];
static unsigned char photo[3 * SIDE * SIDE];
static float maps_memory[7 * SIZE * SIZE];

static void paint(void) {
    int x, y;
    for (y = 0; y < SIDE; y++) {
        for (x = 0; x < SIDE; x++) {
            int dx = x - SIDE / 2, dy = y - SIDE / 2;
            int light = 200 - 160 * (dx * dx + dy * dy) / (SIDE * SIDE);
            int dark = (x / 16 + y / 16) % 2 + 1;
            unsigned char *pixel = photo + 3 * (y * SIDE + x);
            pixel[0] = (unsigned char)(light / dark);
            pixel[1] = (unsigned char)(light / dark / 2);
            pixel[2] = (unsigned char)(light / 4);
        }
    }
}

/* FNV-1a. */
static uint32_t checksum(const void *data, size_t bytes) {
    const unsigned char *at = (const unsigned char *)data;
    uint32_t hash = 2166136261u;
    while (bytes-- > 0) {
        hash = (hash ^ *at++) * 16777619u;
    }
    return hash;
}

static void print_hex(const char *what, uint32_t value) {
    char digits[10];
    int i;
    for (i = 0; i < 8; i++) {
        digits[i] = "0123456789abcdef"[value >> (28 - 4 * i) & 15];
    }
    digits[8] = '\n';
    digits[9] = '\0';
    print(what);
    print(digits);
}

int main(void) {
    flashmat_engine_options engine = {0};
    flashmat_frame frame = {0};
    flashmat_maps maps = {0};
    flashmat_report report = {0};
    flashmat_status status;
    size_t needed = 0;

    engine.struct_size = sizeof engine;
    engine.size = SIZE;
    engine.model = model;
    engine.model_bytes = (size_t)(model_end - model);
    status = flashmat_workspace_bytes(&engine, &needed);
    print_hex("workspace 0x", (uint32_t)needed);
    if (status == FLASHMAT_STATUS_OK && needed <= WORKSPACE) {
        paint();
        frame.struct_size = sizeof frame;
        frame.format = FLASHMAT_FORMAT_RGB8;
        frame.width = frame.height = SIDE;
        frame.planes[0].data = photo;
        frame.planes[0].bytes = sizeof photo;
        maps.struct_size = sizeof maps;
        maps.albedo.data = maps_memory;
        maps.albedo.bytes = 3 * SIZE * SIZE * sizeof(float);
        maps.normal.data = maps_memory + 3 * SIZE * SIZE;
        maps.normal.bytes = 3 * SIZE * SIZE * sizeof(float);
        maps.roughness.data = maps_memory + 6 * SIZE * SIZE;
        maps.roughness.bytes = SIZE * SIZE * sizeof(float);
        report.struct_size = sizeof report;
        status = flashmat_capture_in(&engine, workspace, needed, &frame, NULL, &maps, &report);
    }
    print(flashmat_status_name(status));
    print_hex("\nmaps 0x", checksum(maps_memory, sizeof maps_memory));
    print_hex("report 0x", checksum(&report, sizeof report));
    finish(status == FLASHMAT_STATUS_OK ? 0 : 1);
    return 0;
}
