/* ELUNAR_APP: hazards of a tile against the limits of the table, by the terrain maps of the library: slope and roughness of the vehicle's
 * footprint around every pixel. */
#include "elunar_app.h"

#include <math.h>
#include <string.h>

static uint64_t TerrainMemory[(ELUNAR_APP_TERRAIN_BYTES + 7u) / 8u];
static float    Line[ELUNAR_APP_TILE_COLS];
static uint8_t  Hazard[ELUNAR_APP_TILE_COLS];

static eld_terrain_options_t Options(const ELUNAR_APP_Table_t *Limits, uint32 Cols, float PixelM) {
    eld_terrain_options_t Asked;
    (void)memset(&Asked, 0, sizeof Asked);
    Asked.struct_bytes = sizeof Asked;
    Asked.cols         = Cols;
    Asked.radius_px    = Limits->FootprintRadiusPx;
    Asked.row_m        = PixelM;
    Asked.col_m        = PixelM;
    Asked.slope_deg    = Limits->MaxSlopeDeg;
    Asked.roughness_m  = Limits->MaxRoughnessM;
    return Asked;
}

bool ELUNAR_APP_FootprintFits(const ELUNAR_APP_Table_t *Limits) {
    const eld_terrain_options_t Asked = Options(Limits, ELUNAR_APP_TILE_COLS, 1.0f);
    uint64_t                    Bytes = 0;
    return eld_terrain_plan(&Asked, &Bytes) == ELD_OK && Bytes <= sizeof TerrainMemory;
}

/* Adds up a line of the map. */
static void CountLine(uint32 Cols, uint32 *ClassifiedPx, uint32 *HazardPx) {
    uint32 Col;
    for (Col = 0; Col < Cols; Col++) {
        *ClassifiedPx += (Hazard[Col] & (uint8_t)ELD_HAZARD_UNKNOWN) == 0u ? 1u : 0u;
        *HazardPx += Hazard[Col] != 0u && (Hazard[Col] & (uint8_t)ELD_HAZARD_UNKNOWN) == 0u ? 1u : 0u;
    }
}

eld_status_t ELUNAR_APP_CountHazards(const ELUNAR_APP_Table_t *Limits, const float *HeightsM, const uint8 *Valid, uint32 Rows, uint32 Cols,
                                     float PixelM, uint32 *ClassifiedPx, uint32 *HazardPx) {
    const eld_terrain_options_t Asked = Options(Limits, Cols, PixelM);
    eld_terrain_maps_t          Maps;
    eld_terrain_t              *Terrain = NULL;
    eld_status_t                Status;
    uint64_t                    Row;
    uint32                      Next    = 0;
    uint32                      Col;
    *ClassifiedPx = 0;
    *HazardPx     = 0;
    if (Cols > ELUNAR_APP_TILE_COLS) {
        return ELD_REFUSED_BUFFER;
    }
    (void)memset(&Maps, 0, sizeof Maps);
    Maps.struct_bytes = sizeof Maps;
    Maps.hazard       = Hazard;
    Status            = eld_terrain_init(TerrainMemory, sizeof TerrainMemory, &Asked, &Terrain);
    while (ELD_WORKED(Status)) {
        if (Next < Rows) {
            for (Col = 0; Col < Cols; Col++) {
                Line[Col] = Valid[(size_t)Next * Cols + Col] ? HeightsM[(size_t)Next * Cols + Col] : NAN;
            }
            Status = eld_terrain_push(Terrain, Line, NULL, Cols, &Maps, &Row);
            Next++;
        } else {
            Status = eld_terrain_finish(Terrain, &Maps, &Row);
            if (Status == ELD_NOTICE_NO_LINE) {
                return ELD_OK;
            }
        }
        if (ELD_WORKED(Status) && Status != ELD_NOTICE_NO_LINE) {
            CountLine(Cols, ClassifiedPx, HazardPx);
        }
    }
    return Status;
}
