/* The README's lines for C, on a photo that is made here: readme MODEL.fmat. C99. */
#include <flashmat.h>

#include <stdio.h>
#include <stdlib.h>

#define SIDE 300

static int capture(const void *model, size_t model_bytes, const unsigned char *rgb, float *albedo) {
    flashmat_engine_options options = {0};
    flashmat_engine *engine = NULL;
    flashmat_frame frame = {0};
    flashmat_maps maps = {0};
    flashmat_report report = {0};

    options.struct_size = sizeof options;
    options.model = model; /* NULL: the model that the library embeds */
    options.model_bytes = model_bytes;

    frame.struct_size = sizeof frame;
    frame.format = FLASHMAT_FORMAT_RGB8;
    frame.width = frame.height = SIDE;
    frame.planes[0].data = rgb;
    frame.planes[0].bytes = 3 * SIDE * SIDE;

    maps.struct_size = sizeof maps;
    maps.albedo.data = albedo; /* 3 planes of 256 x 256 floats */
    maps.albedo.bytes = 3 * 256 * 256 * sizeof(float);
    report.struct_size = sizeof report;

    if (flashmat_engine_create(&options, &engine) != FLASHMAT_STATUS_OK ||
        flashmat_capture(engine, &frame, NULL, &maps, &report) != FLASHMAT_STATUS_OK) {
        fprintf(stderr, "%s\n", flashmat_last_error());
        flashmat_engine_destroy(engine);
        return 1;
    }
    printf("%s, residual %.3f\n", flashmat_class_name(report.material_class), (double)report.residual);
    flashmat_engine_destroy(engine);
    return 0;
}

int main(int count, char **arguments) {
    static unsigned char rgb[3 * SIDE * SIDE];
    static float albedo[3 * 256 * 256];
    unsigned char *model = NULL;
    size_t bytes = 0;
    int i, status = 1;

    for (i = 0; i < 3 * SIDE * SIDE; i++) {
        rgb[i] = (unsigned char)(90 + i / 3 % SIDE / 40 % 2 * 80);
    }
    if (count == 2) {
        FILE *file = fopen(arguments[1], "rb");
        long end = -1;
        if (file != NULL && fseek(file, 0, SEEK_END) == 0 && (end = ftell(file)) > 0) {
            rewind(file);
            bytes = (size_t)end;
            model = (unsigned char *)malloc(bytes);
            if (model != NULL && fread(model, 1, bytes, file) == bytes) {
                status = capture(model, bytes, rgb, albedo);
            }
        }
        if (file != NULL) {
            fclose(file);
        }
    }
    free(model);
    return status;
}
