/* Finds the light that two tiles have in common, then makes both under it: light MODEL FOLDER OUT
 *
 * FOLDER contains image.f32, coarse_m.f32 and valid.u8 (see tests/golden/flight_tile). The second tile is the lower half of the first. OUT gets the
 * heights of both. C99 and C++17.
 */
#include "files.h"

#include <math.h>

static void check(const char *what, eld_status_t status) {
    if (!ELD_WORKED(status)) fail(what, eld_status_text(status));
}

int main(int argc, char **argv) {
    const uint64_t budget_macs = 5000000;
    size_t model_bytes, px, i;
    const void *model;
    eld_model_info_t info;
    eld_tile_t tiles[2];
    eld_lighting_t light;
    eld_context_t *context;
    eld_status_t status;
    float *heights_m, *half;
    void *memory;
    FILE *out;

    if (argc != 4) fail("usage", "light MODEL FOLDER OUT");
    model = read_file("", argv[1], &model_bytes);
    info.struct_bytes = sizeof info;
    check("model", eld_model_check(model, model_bytes, &info));
    px = (size_t)info.tile_rows * info.tile_cols;
    heights_m = (float *)malloc(px * sizeof(float));
    half = (float *)malloc(px * sizeof(float));
    memory = malloc((size_t)info.memory_bytes);
    out = fopen(argv[3], "wb");
    if (heights_m == NULL || half == NULL || memory == NULL || out == NULL) fail("memory or file", "not enough");
    tiles[0] = golden_tile(argv[2]);
    tiles[0].sun_azimuth_deg = NAN;
    tiles[0].sun_elevation_deg = NAN;
    tiles[1] = tiles[0];
    memcpy(half, tiles[0].image.data, px * sizeof(float));
    for (i = 0; i < px / 2; i++) half[i] = NAN;
    tiles[1].image.data = half;

    check("init", eld_init(memory, (size_t)info.memory_bytes, model, model_bytes, &context));
    for (i = 0; i < 2; i++) {
        while ((status = eld_light_add(context, &tiles[i], budget_macs)) == ELD_RUNNING) {
        }
        check("light of a tile", status);
    }
    light.struct_bytes = sizeof light;
    check("light of the scene", eld_light_decide(context, NAN, NAN, &light));
    if (light.source != ELD_SOURCE_FITTED) fail("light", "expected to be fitted");
    for (i = 0; i < 2; i++) {
        tiles[i].light = &light;
        while ((status = eld_begin_step(context, &tiles[i], budget_macs)) == ELD_RUNNING) {
        }
        check("begin", status);
        while ((status = eld_step(context, budget_macs)) == ELD_RUNNING) {
        }
        check("step", status);
        check("output", eld_output(context, heights_m, px, NULL, 0));
        if (fwrite(heights_m, sizeof(float), px, out) != px) fail(argv[3], "cannot be written");
    }
    return fclose(out) == 0 ? 0 : 1;
}
