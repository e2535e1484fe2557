/* The service under faults that the library alone cannot repair: service_harmed MODEL FOLDER OUT writes the heights of every case;
 * service_harmed MODEL FOLDER, with a model whose self test fails, checks that the model is not used. */
#include "service.h"

#include "files.h"

static uint8_t *model;
static size_t model_bytes;
static uint64_t *memory;
static eld_model_info_t info;
static service_t service;
static FILE *out;
static float *heights_m;

static void expect(const char *what, unsigned long found, unsigned long expected) {
    if (found == expected) return;
    fprintf(stderr, "ERROR: %s: expected %lu, found %lu\n", what, expected, found);
    exit(1);
}

/* Returns the bytes of a copy of what is kept twice from a byte on; both copies begin with the same bytes. */
static size_t copy_bytes(size_t from) {
    size_t at;
    for (at = 1; at < 256; at++) {
        if (memory[from / 8 + at] == memory[from / 8]) return 8 * at;
    }
    fail("memory", "expected two copies");
    return 0;
}

/* Returns the byte where the part behind two copies begins: at a cache line. */
static size_t behind(size_t from) { return (from + 2 * copy_bytes(from) + 63) / 64 * 64; }

static void harm_context(void) {
    uint8_t *bytes = (uint8_t *)memory;
    size_t copy = copy_bytes(0);
    bytes[20] ^= 1;
    bytes[copy + 30] ^= 1;
}

/* Returns the number of cycles until a state is reached; 0 if it is not reached. */
static unsigned cycles_to(service_state_t state) {
    unsigned cycles = 0;
    while (service.state != state && cycles < 10000) {
        service_cycle(&service, info.largest_unit_macs, 4096);
        cycles++;
    }
    return service.state == state ? cycles + 1 : 0;
}

static void boot(void) {
    unsigned checks = 0;
    expect("start", service_start(&service, memory, (size_t)info.memory_bytes, model, model_bytes, SIZE_MAX), ELD_RUNNING);
    expect("no context", service_scrub(&service, 1), ELD_REFUSED_NOT_DONE);
    for (; service.state == SERVICE_CHECK; checks++) service_cycle(&service, 5000000, 0);
    /* Validation takes many cycles, none of them long. */
    if (checks < 10) fail("start", "expected more pieces of the model's validation");
    expect("start", service.state, SERVICE_SELF_TEST);
    if (!cycles_to(service.has_tile ? SERVICE_READY : SERVICE_IDLE)) fail("start", eld_status_text(service.status));
}

static void take(void) {
    size_t px = (size_t)info.tile_rows * info.tile_cols;
    expect("take", service_take(&service, heights_m, NULL), ELD_OK);
    expect("idle", service.state, SERVICE_IDLE);
    if (fwrite(heights_m, sizeof(float), px, out) != px) fail("OUT", "cannot be written");
}

static void distrust(const eld_tile_t *tile) {
    expect("start", service_start(&service, memory, (size_t)info.memory_bytes, model, model_bytes, SIZE_MAX), ELD_RUNNING);
    if (!cycles_to(SERVICE_WANTS_MODEL)) fail("self test", eld_status_text(service.status));
    expect("status", service.status, ELD_FAULT_SELF_TEST);
    expect("no tile", service_give(&service, tile), ELD_REFUSED_NOT_DONE);
    /* Loaded again, and the self test fails again. */
    expect("reloaded", service_model_reloaded(&service), ELD_RUNNING);
    if (!cycles_to(SERVICE_FAILED)) fail("self test again", eld_status_text(service.status));
    expect("no tile", service_give(&service, tile), ELD_REFUSED_NOT_DONE);
    expect("failed", service_cycle(&service, 1, 1), ELD_FAULT_SELF_TEST);
}

int main(int argc, char **argv) {
    eld_tile_t tile, dark, spoilt;
    float *one;
    uint8_t *mask;
    size_t px, i;
    if (argc != 3 && argc != 4) fail("usage", "service_harmed MODEL FOLDER [OUT]");
    model = (uint8_t *)read_file("", argv[1], &model_bytes);
    tile = golden_tile(argv[2]);
    info.struct_bytes = sizeof info;
    expect("model", eld_model_check(model, model_bytes, &info), ELD_OK);
    px = (size_t)info.tile_rows * info.tile_cols;
    memory = (uint64_t *)malloc((size_t)info.memory_bytes + 8);
    heights_m = (float *)malloc(px * sizeof(float));
    mask = (uint8_t *)malloc(px);
    if (argc == 3) {
        distrust(&tile);
        return 0;
    }
    out = fopen(argv[3], "wb");
    if (out == NULL) fail(argv[3], "cannot be written");
    boot();

    /* A service whose caller has no room for the tile goes down. */
    expect("start", service_start(&service, memory, (size_t)info.memory_bytes, model, model_bytes, (size_t)info.tile_rows * info.tile_cols - 1), ELD_RUNNING);
    if (!cycles_to(SERVICE_DOWN)) fail("no room", eld_status_text(service.status));
    expect("no room", service.status, ELD_REFUSED_BUFFER);
    boot();

    /* Both copies of the context are damaged: the service goes down and starts again, and the tile begins again. */
    expect("give", service_give(&service, &tile), ELD_RUNNING);
    service_cycle(&service, info.largest_unit_macs, 0);
    harm_context();
    service_cycle(&service, info.largest_unit_macs, 0);
    expect("status", service.status, ELD_FAULT_CONTEXT_LOST);
    expect("down", service.state, SERVICE_DOWN);
    expect("cycle while down", service_cycle(&service, 1, 1), ELD_FAULT_CONTEXT_LOST);
    boot();
    take();

    /* A validity bit of a finished tile is damaged: the tile is computed again when it is taken, and can be taken then. */
    expect("give", service_give(&service, &tile), ELD_RUNNING);
    if (!cycles_to(SERVICE_READY)) fail("tile", eld_status_text(service.status));
    ((uint8_t *)memory)[behind(behind(0)) + 100] ^= 1; /* behind the context and the tile's job */
    expect("a lost tile", ELD_WORKED(service_take(&service, heights_m, NULL)), 1);
    expect("again", service.state, SERVICE_TILE);
    if (!cycles_to(SERVICE_READY)) fail("tile", eld_status_text(service.status));
    take();

    /* A tile that is not usable is dropped, and the next one is taken. */
    one = (float *)malloc(px * sizeof(float));
    for (i = 0; i < px; i++) one[i] = 1.0f;
    dark = tile;
    dark.image = service_floats(one, px * sizeof(float));
    dark.pixel_m = 0.0f;
    expect("no ground", service_give(&service, &dark), ELD_REFUSED_TILE_PIXEL);
    expect("dropped", service.drops, 1);
    expect("give", service_give(&service, &tile), ELD_RUNNING);
    expect("give twice", service_give(&service, &tile), ELD_REFUSED_NOT_DONE);
    if (!cycles_to(SERVICE_READY)) fail("tile", eld_status_text(service.status));
    take();

    /* An image without light: the heights are those of the coarse DTM. */
    dark.pixel_m = tile.pixel_m;
    expect("dark", service_give(&service, &dark), ELD_RUNNING);
    while (service.state == SERVICE_TILE && !service.begun) service_cycle(&service, info.largest_unit_macs, 0);
    expect("coarse", service.status, ELD_NOTICE_COARSE);
    if (!cycles_to(SERVICE_READY)) fail("dark", eld_status_text(service.status));
    take();

    /* A mask that is spoilt during the preparation: the tile is dropped, and the next one in the same buffers begins anew. */
    spoilt = tile;
    spoilt.valid = mask;
    memset(mask, 1, px);
    expect("give", service_give(&service, &spoilt), ELD_RUNNING);
    mask[px - 1] = 7;
    expect("spoilt", service_cycle(&service, 1, 0), ELD_REFUSED_TILE_MASK);
    expect("dropped", service.drops, 2);
    memcpy(mask, tile.valid, px);
    expect("give", service_give(&service, &spoilt), ELD_RUNNING);
    if (!cycles_to(SERVICE_READY)) fail("tile", eld_status_text(service.status));
    take();

    /* A damaged model, found by scrubbing, is not accepted as long as it is damaged. */
    model[4000000] ^= 16;
    if (!cycles_to(SERVICE_WANTS_MODEL)) fail("scrub", eld_status_text(service.status));
    expect("still damaged", service_model_reloaded(&service), ELD_RUNNING);
    if (!cycles_to(SERVICE_WANTS_MODEL)) fail("still damaged", eld_status_text(service.status));
    expect("still damaged", ELD_SEVERITY(service.status), ELD_REFUSED);
    model[4000000] ^= 16;
    expect("reloaded", service_model_reloaded(&service), ELD_RUNNING);
    if (!cycles_to(SERVICE_IDLE)) fail("self test", eld_status_text(service.status));
    if (fclose(out) != 0) fail("OUT", "cannot be written");
    puts("served");
    return 0;
}
