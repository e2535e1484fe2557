/* The platform of the guides on a host: two tiles from files, and faults on purpose. Environment: ELUNAR_MODEL, ELUNAR_FOLDER,
 * ELUNAR_OUT (heights and validity of every tile, one after the other), ELUNAR_HARM (cycle at which a bit of the model flips; 0: never). */
#include "platform.h"

#include "files.h"

static uint8_t *model;
static size_t model_bytes;
static eld_tile_t tile;
static unsigned long harm, kicks;
static unsigned given, taken, reloaded, reported;
static FILE *out;

static const char *environment(const char *name) {
    const char *value = getenv(name);
    if (value == NULL) fail(name, "not set");
    return value;
}

const void *platform_model(size_t *bytes) {
    if (model == NULL) {
        model = (uint8_t *)read_file("", environment("ELUNAR_MODEL"), &model_bytes);
        tile = golden_tile(environment("ELUNAR_FOLDER"));
        harm = strtoul(environment("ELUNAR_HARM"), NULL, 10);
        out = fopen(environment("ELUNAR_OUT"), "wb");
        if (out == NULL) fail("ELUNAR_OUT", "cannot be written");
    }
    *bytes = model_bytes;
    return model;
}

int platform_reload_model(void) {
    size_t bytes;
    void *again = read_file("", environment("ELUNAR_MODEL"), &bytes);
    memcpy(model, again, bytes);
    free(again);
    reloaded++;
    return 1;
}

int platform_next_tile(eld_tile_t *next) {
    if (given == 2) return 0;
    given++;
    *next = tile;
    return 1;
}

void platform_heights(const float *heights_m, const uint8_t *valid, size_t px) {
    if (fwrite(heights_m, sizeof(float), px, out) != px || fwrite(valid, 1, px, out) != px) fail("ELUNAR_OUT", "cannot be written");
    taken++;
}

void platform_dropped(eld_status_t status) { fail("dropped", eld_status_text(status)); }

void platform_event(eld_status_t status, const char *text) {
    printf("event %08lx: %s\n", (unsigned long)status, text);
    reported++;
}

void platform_housekeeping(const eld_telemetry_t *telemetry) {
    if (telemetry->tiles == 0 && taken > 0) fail("housekeeping", "expected tiles");
}

void platform_kick_watchdog(void) {
    kicks++;
    if (harm != 0 && kicks == harm) model[3000000] ^= 4;
}

int platform_goes_on(void) {
    /* More cycles than the tiles need, for scrubbing. */
    static unsigned more = 400;
    if (kicks > 20000) fail("cycles", "expected two tiles within 20000");
    if (taken < 2) return 1;
    if (more-- > 0) return 1;
    if (fclose(out) != 0) fail("ELUNAR_OUT", "cannot be written");
    printf("%lu cycles, %u tiles, %u events, %u reloads\n", kicks, taken, reported, reloaded);
    return 0;
}
