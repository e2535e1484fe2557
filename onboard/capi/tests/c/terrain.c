/* Finds hazards line by line: terrain FOLDER OUT
 *
 * FOLDER contains coarse_m.f32 and valid.u8 (see tests/golden/flight_tile), which are a DTM here. OUT gets a byte a pixel: ELD_HAZARD_*. C99 and
 * C++17.
 */
#include "files.h"

#include <math.h>

enum { ROWS = 256, COLS = 320 };

static void check(const char *what, eld_status_t status) {
    if (!ELD_WORKED(status)) fail(what, eld_status_text(status));
}

int main(int argc, char **argv) {
    static uint8_t hazard[COLS];
    eld_terrain_options_t options;
    eld_terrain_maps_t maps;
    eld_terrain_t *terrain;
    eld_tile_t tile;
    eld_status_t status;
    uint64_t bytes, row, taken = 0;
    float *heights_m;
    void *memory;
    size_t i;
    FILE *out;

    if (argc != 3) fail("usage", "terrain FOLDER OUT");
    tile = golden_tile(argv[1]);
    out = fopen(argv[2], "wb");
    heights_m = (float *)malloc(ROWS * COLS * sizeof(float));
    if (out == NULL || heights_m == NULL) fail(argv[2], "cannot be written");
    for (i = 0; i < (size_t)ROWS * COLS; i++) heights_m[i] = tile.valid[i] ? tile.coarse_m[i] : NAN;

    memset(&options, 0, sizeof options);
    options.struct_bytes = sizeof options;
    options.cols = COLS;
    options.radius_px = 3; /* a lander of 14 m */
    options.row_m = options.col_m = 2.0f;
    options.slope_deg = 4.0f;
    options.roughness_m = 0.25f;
    check("plan", eld_terrain_plan(&options, &bytes));
    memory = malloc((size_t)bytes);
    if (memory == NULL) fail("memory", "not enough");
    check("init", eld_terrain_init(memory, (size_t)bytes, &options, &terrain));

    memset(&maps, 0, sizeof maps); /* NULL: not wanted */
    maps.struct_bytes = sizeof maps;
    maps.hazard = hazard;
    for (i = 0;; i++) {
        if (i < ROWS) {
            status = eld_terrain_push(terrain, heights_m + i * COLS, NULL, COLS, &maps, &row);
        } else {
            status = eld_terrain_finish(terrain, &maps, &row);
        }
        check("line", status);
        if (status == ELD_NOTICE_NO_LINE) {
            if (i < ROWS) continue;
            break;
        }
        if (row != taken++ || fwrite(hazard, 1, COLS, out) != COLS) fail("line", "expected in order, and written");
    }
    if (taken != ROWS || fclose(out) != 0) fail(argv[2], "expected as many lines as went in");
    return 0;
}
