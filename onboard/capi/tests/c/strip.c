/* Makes a strip of one tile by the service of strip_service.h: strip MODEL FOLDER OUT
 *
 * FOLDER contains image.f32, coarse_m.f32 and valid.u8 (see tests/golden/flight_tile). OUT gets the heights, NaN in voids. C99 and
 * C++17.
 */
#include "strip_service.h"

#include "files.h"

#include <math.h>

/* The caller's state: a camera that is late now and then. */
typedef struct {
    eld_tile_t tile;
    size_t rows, cols, given, calls;
    FILE *out;
} strip_t;

static int next_line(void *caller, void *pixels, float *coarse_m) {
    strip_t *own = (strip_t *)caller;
    size_t col;
    if (++own->calls % 7 == 0) return STRIP_LATER;
    if (own->given == own->rows) return STRIP_END;
    for (col = 0; col < own->cols; col++) {
        const size_t pixel = own->given * own->cols + col;
        ((float *)pixels)[col] = own->tile.valid[pixel] ? ((const float *)own->tile.image.data)[pixel] : NAN;
        coarse_m[col] = own->tile.valid[pixel] ? own->tile.coarse_m[pixel] : NAN;
    }
    own->given++;
    return STRIP_HERE;
}

static int keep(void *caller, uint64_t line, const float *heights_m) {
    strip_t *own = (strip_t *)caller;
    if (own->out == NULL) return STRIP_BROKEN;
    if ((size_t)line * own->cols * sizeof(float) != (size_t)ftell(own->out)) fail("take", "expected lines in order");
    return fwrite(heights_m, sizeof(float), own->cols, own->out) == own->cols ? STRIP_HERE : STRIP_BROKEN;
}

static void check(const char *what, eld_status_t status) {
    if (!ELD_WORKED(status)) fail(what, eld_status_text(status));
}

int main(int argc, char **argv) {
    unsigned long steps = 0, checks = 0;
    uint64_t bytes;
    size_t model_bytes;
    eld_model_info_t info;
    eld_strip_settings_t settings;
    eld_strip_telemetry_t telemetry;
    strip_memory_t memory;
    strip_lines_t lines;
    strip_service_t service;
    strip_t own;

    if (argc != 4) fail("usage", "strip MODEL FOLDER OUT");
    memset(&own, 0, sizeof own);
    memset(&memory, 0, sizeof memory);
    memset(&settings, 0, sizeof settings);
    memory.model = read_file("", argv[1], &model_bytes);
    memory.model_bytes = model_bytes;
    info.struct_bytes = sizeof info;
    check("model", eld_model_check(memory.model, model_bytes, &info));
    own.tile = golden_tile(argv[2]);
    own.rows = info.tile_rows;
    own.cols = info.tile_cols;

    settings.struct_bytes = sizeof settings;
    settings.cols = info.tile_cols;
    settings.overlap_px = 100;
    settings.pixel_m = own.tile.pixel_m;
    settings.coarse_px = own.tile.coarse_px;
    settings.sun_azimuth_deg = own.tile.sun_azimuth_deg;
    settings.sun_elevation_deg = own.tile.sun_elevation_deg;
    settings.pixels = own.tile.image;
    check("plan", eld_strip_plan(memory.model, model_bytes, &settings, &bytes));
    memory.strip_bytes = (size_t)bytes;
    memory.strip = malloc(memory.strip_bytes);
    memory.pixels_bytes = own.cols * sizeof(float);
    memory.pixels = malloc(memory.pixels_bytes);
    memory.line_len = own.cols;
    memory.line_m = (float *)malloc(own.cols * sizeof(float));
    lines.line = next_line;
    lines.posts = NULL;
    lines.heights = keep;
    lines.caller = &own;

    /* No room for a line of heights: the strip is given up behind the model's validation. */
    memory.line_len--;
    if (strip_begin(&service, &memory, &lines, &settings) != ELD_RUNNING) fail("begin", eld_status_text(service.status));
    for (; service.state == STRIP_CHECK; checks++) strip_cycle(&service, 5000000);
    if (service.state != STRIP_FAILED || service.status != ELD_REFUSED_BUFFER) fail("no room", eld_status_text(service.status));
    if (checks < 10) fail("check", "expected more pieces of the model's validation");
    memory.line_len++;

    /* Heights that cannot be kept. */
    check("begin", strip_begin(&service, &memory, &lines, &settings));
    while (service.state == STRIP_CHECK || service.state == STRIP_WORK) strip_cycle(&service, info.largest_unit_macs);
    if (service.state != STRIP_FAILED || service.lines_out != 1) fail("no file", eld_status_text(service.status));
    if (strip_cycle(&service, 1) != service.status) fail("failed", "expected the same status");

    own.out = fopen(argv[3], "wb");
    if (own.out == NULL) fail(argv[3], "cannot be written");
    own.given = 0;
    check("begin", strip_begin(&service, &memory, &lines, &settings));
    for (; service.state == STRIP_CHECK || service.state == STRIP_WORK; steps++) {
        check("cycle", strip_cycle(&service, info.largest_unit_macs));
        if (steps == 900) check("scrub", eld_strip_scrub(service.strip, 4096));
    }
    telemetry.struct_bytes = sizeof telemetry;
    check("telemetry", eld_strip_telemetry(service.strip, &telemetry));
    if (telemetry.tiles != 1 || telemetry.tiles_again != 0 || telemetry.faults != 0 || telemetry.pieces_lost != 0) {
        fail("telemetry", "expected a tile and no fault");
    }
    if (service.lines_in != own.rows || service.lines_out != own.rows || service.state != STRIP_DONE) fail("lines", "expected all");
    printf("%lu bytes, %lu lines, %lu cycles\n", (unsigned long)bytes, (unsigned long)service.lines_out, steps);
    if (fclose(own.out) != 0) fail(argv[3], "cannot be written");
    return 0;
}
