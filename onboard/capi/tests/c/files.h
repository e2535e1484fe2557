/* Files of the golden tile, for host programs of the tests. */
#ifndef FILES_H
#define FILES_H

#include "elunar.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void fail(const char *what, const char *why) {
    fprintf(stderr, "ERROR: %s: %s\n", what, why);
    exit(1);
}

static void *read_file(const char *folder, const char *name, size_t *bytes) {
    char path[4096];
    long end;
    void *data;
    FILE *file;
    snprintf(path, sizeof path, "%s%s", folder, name);
    file = fopen(path, "rb");
    if (file == NULL || fseek(file, 0, SEEK_END) != 0 || (end = ftell(file)) < 0) fail(path, "cannot be read");
    rewind(file);
    *bytes = (size_t)end;
    data = malloc(*bytes + 1);
    if (data == NULL || fread(data, 1, *bytes, file) != *bytes) fail(path, "cannot be read");
    fclose(file);
    return data;
}

/* tests/golden/flight_tile. */
static eld_tile_t golden_tile(const char *folder) {
    eld_tile_t tile;
    size_t bytes;
    memset(&tile, 0, sizeof tile);
    tile.struct_bytes = sizeof tile;
    tile.pixel_m = 2.0f;
    tile.coarse_px = 29.61f;
    tile.sun_azimuth_deg = 189.48853f;
    tile.sun_elevation_deg = 25.614722f;
    tile.image.data = read_file(folder, "/image.f32", &tile.image.data_bytes);
    tile.image.format = ELD_PIXELS_F32;
    tile.image.gain = 1.0f;
    tile.coarse_m = (const float *)read_file(folder, "/coarse_m.f32", &bytes);
    tile.coarse_len = bytes / sizeof(float);
    tile.valid = (const uint8_t *)read_file(folder, "/valid.u8", &tile.valid_len);
    return tile;
}

#endif
