/* Makes a strip of one tile from lines: strip MODEL FOLDER OUT
 *
 * FOLDER contains image.f32, coarse_m.f32 and valid.u8 (see tests/golden/flight_tile). OUT gets the heights, NaN in voids. C99 and
 * C++17.
 */
#include "files.h"

#include <math.h>

static void check(const char *what, eld_status_t status) {
    if (!ELD_WORKED(status)) fail(what, eld_status_text(status));
}

int main(int argc, char **argv) {
    size_t model_bytes, col, rows, cols, done = 0, pushed = 0, steps = 0;
    uint64_t memory_bytes, line;
    const void *model;
    void *memory;
    float *image, *coarse_m, *heights_m;
    eld_model_info_t info;
    eld_check_t checked;
    eld_tile_t tile;
    eld_strip_settings_t settings;
    eld_strip_t *strip;
    eld_strip_telemetry_t telemetry;
    eld_status_t next;
    FILE *out;

    if (argc != 4) fail("usage", "strip MODEL FOLDER OUT");
    model = read_file("", argv[1], &model_bytes);
    info.struct_bytes = sizeof info;
    memset(&checked, 0, sizeof checked);
    while ((next = eld_model_check_step(model, model_bytes, 5000000, &checked, &info)) == ELD_RUNNING) steps++;
    check("model", next);
    rows = info.tile_rows;
    cols = info.tile_cols;
    tile = golden_tile(argv[2]);

    memset(&settings, 0, sizeof settings);
    settings.struct_bytes = sizeof settings;
    settings.cols = info.tile_cols;
    settings.overlap_px = 100;
    settings.pixel_m = tile.pixel_m;
    settings.coarse_px = tile.coarse_px;
    settings.sun_azimuth_deg = tile.sun_azimuth_deg;
    settings.sun_elevation_deg = tile.sun_elevation_deg;
    settings.pixels = tile.image;
    settings.check = &checked;
    check("plan", eld_strip_plan(model, model_bytes, &settings, &memory_bytes));
    memory = malloc((size_t)memory_bytes);
    check("init", eld_strip_init(memory, (size_t)memory_bytes, model, model_bytes, &settings, &strip));

    steps = 0;
    next = ELD_NOTICE_STRIP_PUSH;
    image = (float *)malloc(cols * sizeof *image);
    coarse_m = (float *)malloc(cols * sizeof *coarse_m);
    heights_m = (float *)malloc(rows * cols * sizeof *heights_m);
    while (next != ELD_NOTICE_STRIP_DONE || done < rows) {
        if (next == ELD_NOTICE_STRIP_PUSH && pushed < rows) {
            for (col = 0; col < cols; col++) {
                const size_t pixel = pushed * cols + col;
                image[col] = tile.valid[pixel] ? ((const float *)tile.image.data)[pixel] : NAN;
                coarse_m[col] = tile.valid[pixel] ? tile.coarse_m[pixel] : NAN;
            }
            check("push", eld_strip_push(strip, image, cols * sizeof *image, coarse_m, cols));
            pushed++;
        } else if (next == ELD_NOTICE_STRIP_PUSH) {
            check("finish", eld_strip_finish(strip));
        }
        /* A line leaves when the tiles over it are done. */
        while (eld_strip_take(strip, heights_m + done * cols, NULL, NULL, NULL, cols, &line) == ELD_OK) {
            if (line != done) fail("take", "expected lines in order");
            done++;
        }
        next = eld_strip_step(strip, info.largest_unit_macs);
        check("step", next);
        steps += next == ELD_RUNNING;
        if (steps == 20 && next == ELD_RUNNING) check("scrub", eld_strip_scrub(strip, 4096));
    }
    telemetry.struct_bytes = sizeof telemetry;
    check("telemetry", eld_strip_telemetry(strip, &telemetry));
    if (telemetry.tiles != 1 || telemetry.tiles_again != 0 || telemetry.faults != 0 || telemetry.pieces_lost != 0) {
        fail("telemetry", "expected a tile and no fault");
    }
    printf("%lu bytes, %lu lines, %lu steps\n", (unsigned long)memory_bytes, (unsigned long)done, (unsigned long)steps);
    out = fopen(argv[3], "wb");
    if (out == NULL || fwrite(heights_m, sizeof(float), rows * cols, out) != rows * cols || fclose(out) != 0) {
        fail(argv[3], "cannot be written");
    }
    return 0;
}
