/* ELUNAR_APP: slope and roughness of a tile against the limits of the table.
 *
 *     slope      = |((right - left), (below - above))| / (2 pixel)        compared as squares
 *     roughness  = |height - (left + right + above + below) / 4|
 *
 * A pixel at the edge, or next to an invalid height, is not classified. This is an example of the use of heights by a lander, not a
 * proposed method. */
#include "elunar_app.h"

static bool Hazard(const ELUNAR_APP_Table_t *Limits, const float *At, uint32 Cols, float PixelM) {
    const float Left = At[-1], Right = At[1], Above = At[-(ptrdiff_t)Cols], Below = At[Cols];
    const float Dx = (Right - Left) / (2.0f * PixelM), Dy = (Below - Above) / (2.0f * PixelM);
    const float Rough = At[0] - 0.25f * (Left + Right + Above + Below);
    return Dx * Dx + Dy * Dy > Limits->MaxSlope * Limits->MaxSlope || Rough > Limits->MaxRoughnessM || -Rough > Limits->MaxRoughnessM;
}

void ELUNAR_APP_CountHazards(const ELUNAR_APP_Table_t *Limits, const float *HeightsM, const uint8 *Valid, uint32 Rows, uint32 Cols,
                             float PixelM, uint32 *ClassifiedPx, uint32 *HazardPx) {
    uint32 Row, Col;
    *ClassifiedPx = 0;
    *HazardPx = 0;
    for (Row = 1; Row + 1 < Rows; Row++) {
        for (Col = 1; Col + 1 < Cols; Col++) {
            const size_t i = (size_t)Row * Cols + Col;
            if (Valid[i] && Valid[i - 1] && Valid[i + 1] && Valid[i - Cols] && Valid[i + Cols]) {
                (*ClassifiedPx)++;
                *HazardPx += Hazard(Limits, HeightsM + i, Cols, PixelM) ? 1u : 0u;
            }
        }
    }
}
