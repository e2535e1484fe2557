/* Runs two tiles in two contexts, in turn step by step: tile MODEL FOLDER OUT
 *
 * FOLDER contains image.f32, coarse_m.f32 and valid.u8 (see tests/golden/flight_tile). OUT gets the heights of the first tile, then its
 * validity bytes, the expected errors of its heights and slopes, their origins; then the heights of the second tile, which is the first
 * one upside down. C99 and C++17.
 */
#include "files.h"

#include <math.h>

static void check(const char *what, eld_status_t status) {
    if (!ELD_WORKED(status)) fail(what, eld_status_text(status));
}

static void *reversed(const void *map, size_t samples) {
    float *turned = (float *)malloc(samples * sizeof *turned);
    size_t i;
    for (i = 0; i < samples; i++) turned[i] = ((const float *)map)[samples - 1 - i];
    return turned;
}

int main(int argc, char **argv) {
    size_t model_bytes, px, i, passes = 0, pieces = 0;
    const void *model;
    eld_model_info_t info;
    eld_check_t checked;
    eld_status_t status;
    eld_tile_t tiles[2];
    eld_context_t *contexts[2];
    void *memory[2];
    float *heights_m[2];
    float *error_m, *slope;
    uint8_t *valid, *origin;
    eld_telemetry_t telemetry;
    char kernel[64];
    FILE *out;

    if (argc != 4) fail("usage", "tile MODEL FOLDER OUT");
    if (eld_version() >> 16 != ELD_VERSION >> 16) fail("version", "of another library");
    model = read_file("", argv[1], &model_bytes);
    info.struct_bytes = sizeof info;
    /* No call is longer than its budget and a unit: a watchdog is kicked between two of them. */
    memset(&checked, 0, sizeof checked);
    while ((status = eld_model_check_step(model, model_bytes, 5000000, &checked, &info)) == ELD_RUNNING) pieces++;
    check("model", status);
    px = (size_t)info.tile_rows * info.tile_cols;

    tiles[0] = golden_tile(argv[2]);
    tiles[1] = tiles[0];
    tiles[1].image.data = reversed(tiles[0].image.data, px);
    tiles[1].coarse_m = (const float *)reversed(tiles[0].coarse_m, px);
    tiles[1].valid = NULL;
    tiles[1].valid_len = 0;
    tiles[1].sun_azimuth_deg = 9.0f;
    tiles[1].sun_elevation_deg = NAN;

    for (i = 0; i < 2; i++) {
        memory[i] = malloc((size_t)info.memory_bytes);
        heights_m[i] = (float *)malloc(px * sizeof(float));
        check("init", eld_init_checked(memory[i], (size_t)info.memory_bytes, model, model_bytes, &checked, &contexts[i]));
        check("self test", eld_self_test_begin(contexts[i]));
        while (eld_step(contexts[i], info.tile_macs / 4) == ELD_RUNNING) {
        }
        check("self test", eld_self_test_check(contexts[i]));
        /* The first tile is begun at once, the second in pieces. */
        while (i == 1 && eld_begin_step(contexts[i], &tiles[i], info.largest_unit_macs) == ELD_RUNNING) pieces++;
        if (i == 0) check("begin", eld_begin(contexts[i], &tiles[i]));
    }
    for (;;) {
        eld_status_t first = eld_step(contexts[0], info.largest_unit_macs);
        eld_status_t second = eld_step(contexts[1], 3 * info.largest_unit_macs);
        check("step", first);
        check("step", second);
        check("scrub", eld_scrub(contexts[0], 4096));
        passes++;
        if (first != ELD_RUNNING && second != ELD_RUNNING) break;
    }
    if (pieces < 2) fail("begin", "expected pieces");
    valid = (uint8_t *)malloc(px);
    check("output", eld_output(contexts[0], heights_m[0], px, valid, px));
    check("output", eld_output(contexts[1], heights_m[1], px, NULL, 0));
    error_m = (float *)malloc(px * sizeof(float));
    slope = (float *)malloc(px * sizeof(float));
    origin = (uint8_t *)malloc(px);
    check("errors", eld_error_maps(contexts[0], error_m, slope, origin, px));

    telemetry.struct_bytes = sizeof telemetry;
    check("telemetry", eld_telemetry(contexts[0], &telemetry));
    if (telemetry.tiles != 2 || telemetry.faults != 0 || telemetry.phase != ELD_PHASE_TILE_DONE) {
        fail("telemetry", "expected two tiles and no fault");
    }
    check("kernel", eld_kernel_name(kernel, sizeof kernel));
    printf("%s, %lu rounds, %lu pixels that count\n", kernel, (unsigned long)passes, (unsigned long)telemetry.valid_px);

    out = fopen(argv[3], "wb");
    if (out == NULL || fwrite(heights_m[0], sizeof(float), px, out) != px || fwrite(valid, 1, px, out) != px ||
        fwrite(error_m, sizeof(float), px, out) != px || fwrite(slope, sizeof(float), px, out) != px ||
        fwrite(origin, 1, px, out) != px ||
        fwrite(heights_m[1], sizeof(float), px, out) != px || fclose(out) != 0) {
        fail(argv[3], "cannot be written");
    }
    return 0;
}
