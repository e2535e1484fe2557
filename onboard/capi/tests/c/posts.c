/* Makes a tile whose coarse DTM is given as posts: posts MODEL FOLDER OUT
 *
 * FOLDER contains image.f32, coarse_m.f32 and valid.u8 (see tests/golden/flight_tile). The posts are every 16th height of every 16th row, from
 * (8, 8) on. OUT gets the heights. C99 and C++17.
 */
#include "files.h"

enum { EVERY = 16, FIRST = 8 };

static void check(const char *what, eld_status_t status) {
    if (!ELD_WORKED(status)) fail(what, eld_status_text(status));
}

int main(int argc, char **argv) {
    size_t model_bytes, px, row, col, rows, cols;
    const void *model;
    eld_model_info_t info;
    eld_tile_t tile;
    eld_posts_t posts;
    eld_context_t *context;
    eld_status_t status;
    float *posts_m, *heights_m;
    void *memory;
    FILE *out;

    if (argc != 4) fail("usage", "posts MODEL FOLDER OUT");
    model = read_file("", argv[1], &model_bytes);
    info.struct_bytes = sizeof info;
    check("model", eld_model_check(model, model_bytes, &info));
    px = (size_t)info.tile_rows * info.tile_cols;
    tile = golden_tile(argv[2]);

    rows = (info.tile_rows - FIRST + EVERY - 1) / EVERY;
    cols = (info.tile_cols - FIRST + EVERY - 1) / EVERY;
    posts_m = (float *)malloc(rows * cols * sizeof(float));
    heights_m = (float *)malloc(px * sizeof(float));
    memory = malloc((size_t)info.memory_bytes);
    if (posts_m == NULL || heights_m == NULL || memory == NULL) fail("memory", "not enough");
    for (row = 0; row < rows; row++) {
        for (col = 0; col < cols; col++) {
            posts_m[row * cols + col] = tile.coarse_m[(FIRST + EVERY * row) * info.tile_cols + FIRST + EVERY * col];
        }
    }
    posts.posts_m = posts_m;
    posts.posts_len = rows * cols;
    posts.cols = cols;
    posts.row0 = -(double)FIRST / EVERY;
    posts.rows_per_line = 1.0 / EVERY;
    posts.col0 = posts.row0;
    posts.cols_per_px = posts.rows_per_line;
    tile.coarse_m = NULL;
    tile.coarse_len = 0;
    tile.posts = &posts;

    check("init", eld_init(memory, (size_t)info.memory_bytes, model, model_bytes, &context));
    do status = eld_begin_step(context, &tile, 5000000);
    while (status == ELD_RUNNING);
    check("begin", status);
    while ((status = eld_step(context, 5000000)) == ELD_RUNNING) {
    }
    check("step", status);
    check("output", eld_output(context, heights_m, px, NULL, 0));
    out = fopen(argv[3], "wb");
    if (out == NULL || fwrite(heights_m, sizeof(float), px, out) != px || fclose(out) != 0) fail(argv[3], "cannot be written");
    return 0;
}
