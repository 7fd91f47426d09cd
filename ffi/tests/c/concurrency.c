/* Two threads and one engine: BUSY, cancel before, during and after a capture, progress functions that cancel, destroy
 * while a capture runs. concurrency MODEL */
#include "check.h"

#include <pthread.h>

#define SIZE 128
#define SIDE 140
#define PLANE ((size_t)SIZE * SIZE)

static flashmat_engine_options engine_options;
static unsigned char *photo;

/* A progress function that holds its capture at the first call until it may go on. */
typedef struct gate {
    pthread_mutex_t mutex;
    pthread_cond_t changed;
    int arrived, open, calls;
    int32_t answer;
} gate;

static int32_t hold(void *user, uint32_t stage, float fraction) {
    gate *g = (gate *)user;
    pthread_mutex_lock(&g->mutex);
    g->calls++;
    g->arrived = 1;
    pthread_cond_broadcast(&g->changed);
    while (!g->open) {
        pthread_cond_wait(&g->changed, &g->mutex);
    }
    pthread_mutex_unlock(&g->mutex);
    (void)stage;
    (void)fraction;
    return g->answer;
}

typedef struct job {
    flashmat_engine *engine;
    flashmat_progress progress;
    void *user;
    int32_t status;
    float *albedo;
    flashmat_report report;
} job;

static void *work(void *argument) {
    job *j = (job *)argument;
    flashmat_frame frame;
    flashmat_capture_options options;
    flashmat_maps maps;
    memset(&frame, 0, sizeof frame);
    frame.struct_size = sizeof frame;
    frame.format = FLASHMAT_FORMAT_RGB8;
    frame.width = frame.height = SIDE;
    frame.planes[0].data = photo;
    frame.planes[0].bytes = 3 * SIDE * SIDE;
    memset(&options, 0, sizeof options);
    options.struct_size = sizeof options;
    options.skip_refinement = 1;
    options.progress = j->progress;
    options.user = j->user;
    memset(&maps, 0, sizeof maps);
    maps.struct_size = sizeof maps;
    maps.albedo.data = j->albedo;
    maps.albedo.bytes = 3 * PLANE * sizeof(float);
    memset(&j->report, 0, sizeof j->report);
    j->report.struct_size = sizeof j->report;
    j->status = (int32_t)flashmat_capture(j->engine, &frame, &options, &maps, &j->report);
    if (j->status != FLASHMAT_STATUS_OK) {
        CHECK(strlen(flashmat_last_error()) > 0);
    }
    return NULL;
}

static int32_t run(flashmat_engine *engine, flashmat_progress progress, void *user, float *albedo) {
    job j;
    memset(&j, 0, sizeof j);
    j.engine = engine;
    j.progress = progress;
    j.user = user;
    j.albedo = albedo;
    work(&j);
    return j.status;
}

static void gate_start(gate *g, job *j, pthread_t *thread) {
    memset(g, 0, sizeof *g);
    pthread_mutex_init(&g->mutex, NULL);
    pthread_cond_init(&g->changed, NULL);
    j->progress = hold;
    j->user = g;
    CHECK(pthread_create(thread, NULL, work, j) == 0);
    pthread_mutex_lock(&g->mutex);
    while (!g->arrived) {
        pthread_cond_wait(&g->changed, &g->mutex);
    }
    pthread_mutex_unlock(&g->mutex);
}

static void gate_open(gate *g, pthread_t thread) {
    pthread_mutex_lock(&g->mutex);
    g->open = 1;
    pthread_cond_broadcast(&g->changed);
    pthread_mutex_unlock(&g->mutex);
    pthread_join(thread, NULL);
    pthread_mutex_destroy(&g->mutex);
    pthread_cond_destroy(&g->changed);
}

static flashmat_engine *create(void) {
    flashmat_engine *engine = NULL;
    CHECK(flashmat_engine_create(&engine_options, &engine) == FLASHMAT_STATUS_OK);
    return engine;
}

/* What a progress function does to its own capture. */
typedef struct meddler {
    flashmat_engine *engine;
    float *albedo;
    int calls, stop_at, destroys;
    uint32_t last_stage;
    float last_fraction;
} meddler;

static int32_t meddle(void *user, uint32_t stage, float fraction) {
    meddler *m = (meddler *)user;
    CHECK(stage > m->last_stage || fraction >= m->last_fraction);
    CHECK(fraction >= 0.0f && fraction <= 1.0f && stage <= FLASHMAT_STAGE_RELIGHT);
    m->last_stage = stage;
    m->last_fraction = fraction;
    m->calls++;
    if (m->calls == 1 && m->engine != NULL) {
        FAILS(run(m->engine, NULL, NULL, m->albedo), FLASHMAT_STATUS_BUSY, "another capture");
    }
    if (m->destroys) {
        flashmat_engine_destroy(m->engine);
        m->destroys = 0;
        m->engine = NULL;
    }
    return m->stop_at != 0 && m->calls >= m->stop_at;
}

int main(int count, char **arguments) {
    flashmat_engine *engine;
    float *first = (float *)must_malloc(3 * PLANE * sizeof(float));
    float *second = (float *)must_malloc(3 * PLANE * sizeof(float));
    unsigned char *model;
    gate g;
    job j;
    meddler m;
    pthread_t thread;
    int calls, i;
    if (count != 2) {
        fprintf(stderr, "concurrency MODEL\n");
        return 2;
    }
    photo = (unsigned char *)must_malloc(3 * SIDE * SIDE);
    paint(photo, SIDE);
    memset(&engine_options, 0, sizeof engine_options);
    engine_options.struct_size = sizeof engine_options;
    engine_options.size = SIZE;
    engine_options.threads = 2;
    model = read_file(arguments[1], &engine_options.model_bytes);
    engine_options.model = model;
    engine = create();
    /* The engine has its own copy. */
    memset(model, 0, engine_options.model_bytes);
    memset(&j, 0, sizeof j);
    j.engine = engine;
    j.albedo = first;

    /* A second capture meanwhile, and questions about the engine. */
    gate_start(&g, &j, &thread);
    FAILS(run(engine, NULL, NULL, second), FLASHMAT_STATUS_BUSY, "another capture");
    {
        flashmat_engine_info info;
        memset(&info, 0, sizeof info);
        info.struct_size = sizeof info;
        CHECK(flashmat_engine_get_info(engine, &info) == FLASHMAT_STATUS_OK && info.size == SIZE);
    }
    gate_open(&g, thread);
    CHECK(j.status == FLASHMAT_STATUS_OK && g.calls > 1);
    calls = g.calls;

    /* Cancel before: nothing to cancel, the next capture is whole. */
    FAILS(flashmat_cancel(engine), FLASHMAT_STATUS_IDLE, "no capture");
    CHECK(run(engine, NULL, NULL, second) == FLASHMAT_STATUS_OK);
    CHECK(memcmp(first, second, 3 * PLANE * sizeof(float)) == 0);

    /* During: CANCELLED, nothing written, twice is no harm. */
    memset(second, 0x5A, 3 * PLANE * sizeof(float));
    j.albedo = second;
    gate_start(&g, &j, &thread);
    CHECK(flashmat_cancel(engine) == FLASHMAT_STATUS_OK);
    CHECK(flashmat_cancel(engine) == FLASHMAT_STATUS_OK);
    gate_open(&g, thread);
    CHECK(j.status == FLASHMAT_STATUS_CANCELLED && g.calls == 1 && j.report.material_class == 0);
    for (i = 0; i < (int)(3 * PLANE * sizeof(float)); i++) {
        if (((unsigned char *)second)[i] != 0x5A) {
            break;
        }
    }
    CHECK(i == (int)(3 * PLANE * sizeof(float)));

    /* After: too late, and no echo in the next capture. */
    FAILS(flashmat_cancel(engine), FLASHMAT_STATUS_IDLE, "no capture");
    CHECK(run(engine, NULL, NULL, second) == FLASHMAT_STATUS_OK);
    CHECK(memcmp(first, second, 3 * PLANE * sizeof(float)) == 0);

    /* Progress functions that cancel at every call in turn, and that call the library. */
    for (i = 1; i <= calls + 1; i++) {
        memset(&m, 0, sizeof m);
        m.stop_at = i;
        CHECK(run(engine, meddle, &m, second) == (i <= calls ? FLASHMAT_STATUS_CANCELLED : FLASHMAT_STATUS_OK));
        CHECK(m.calls == (i <= calls ? i : calls));
    }
    memset(&m, 0, sizeof m);
    m.engine = engine;
    m.albedo = first;
    CHECK(run(engine, meddle, &m, second) == FLASHMAT_STATUS_OK);

    /* Destroyed while a capture runs: by another thread, then by its own progress function. */
    gate_start(&g, &j, &thread);
    flashmat_engine_destroy(engine);
    gate_open(&g, thread);
    CHECK(j.status == FLASHMAT_STATUS_CANCELLED);
    free(model);
    model = read_file(arguments[1], &engine_options.model_bytes);
    engine_options.model = model;
    memset(&m, 0, sizeof m);
    m.engine = create();
    m.albedo = first;
    m.destroys = 1;
    CHECK(run(m.engine, meddle, &m, second) == FLASHMAT_STATUS_CANCELLED);

    /* Engines are independent: two at once. */
    engine = create();
    m.engine = create();
    memset(&j, 0, sizeof j);
    j.engine = engine;
    j.albedo = first;
    gate_start(&g, &j, &thread);
    CHECK(run(m.engine, NULL, NULL, second) == FLASHMAT_STATUS_OK);
    gate_open(&g, thread);
    CHECK(j.status == FLASHMAT_STATUS_OK && memcmp(first, second, 3 * PLANE * sizeof(float)) == 0);
    flashmat_engine_destroy(engine);
    flashmat_engine_destroy(m.engine);

    free(model);
    free(photo);
    free(first);
    free(second);
    return summary();
}
