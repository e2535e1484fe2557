/* ELUNAR_APP: tiles, and the work of a wakeup. */
#include "elunar_app.h"

#include <string.h>

/* Static memory: addresses and sizes are fixed when the application is loaded. */
static float    Image[ELUNAR_APP_TILE_PX];
static float    CoarseM[ELUNAR_APP_TILE_PX];
static float    HeightsM[ELUNAR_APP_TILE_PX];
static uint8_t  Valid[ELUNAR_APP_TILE_PX];

bool ELUNAR_APP_Tell(eld_status_t Status) {
    const bool Worked = ELD_WORKED(Status);
    if (Worked && (Status == ELD_OK || Status == ELD_RUNNING)) {
        return true;
    }
    CFE_EVS_SendEvent(Worked ? ELUNAR_APP_STATUS_INF_EID : ELUNAR_APP_STATUS_ERR_EID,
                      Worked ? CFE_EVS_EventType_INFORMATION : CFE_EVS_EventType_ERROR, "ELUNAR: 0x%08lX: %s", (unsigned long)Status,
                      eld_status_text(Status));
    return Worked;
}

/* Sends events for changes of the service since the last call. */
static void TellState(void) {
    const service_t *Service = &ELUNAR_APP_Data.Service;
    if (Service->drops != ELUNAR_APP_Data.DropsTold) {
        ELUNAR_APP_Data.DropsTold = Service->drops;
        CFE_EVS_SendEvent(ELUNAR_APP_DROPPED_ERR_EID, CFE_EVS_EventType_ERROR, "ELUNAR: tile dropped: %s", eld_status_text(Service->status));
    }
    if (Service->state == ELUNAR_APP_Data.StateTold) {
        return;
    }
    if (ELUNAR_APP_Data.StateTold == SERVICE_CHECK && Service->state == SERVICE_SELF_TEST) {
        ELUNAR_APP_ModelIsThere();
    } else if (Service->state == SERVICE_FAILED) {
        CFE_EVS_SendEvent(ELUNAR_APP_FAILED_ERR_EID, CFE_EVS_EventType_ERROR, "ELUNAR: self test fails, heights are not to be used");
    } else if (ELUNAR_APP_Data.StateTold == SERVICE_SELF_TEST && (Service->state == SERVICE_IDLE || Service->state == SERVICE_TILE)) {
        CFE_EVS_SendEvent(ELUNAR_APP_IDLE_INF_EID, CFE_EVS_EventType_INFORMATION, "ELUNAR: self test passed");
    } else {
        /* Other changes come with the event of their status. */
    }
    ELUNAR_APP_Data.StateTold = Service->state;
}

bool ELUNAR_APP_GiveTile(const ELUNAR_APP_ProcessTile_Payload_t *Tile) {
    service_t   *Service = &ELUNAR_APP_Data.Service;
    const size_t Px      = (size_t)Service->info.tile_rows * Service->info.tile_cols;
    const char  *End     = memchr(Tile->OutputFile, 0, sizeof Tile->OutputFile);
    size_t       Found[2];
    eld_tile_t   Given;
    if (Service->state != SERVICE_IDLE) {
        CFE_EVS_SendEvent(ELUNAR_APP_BUSY_ERR_EID, CFE_EVS_EventType_ERROR, "ELUNAR: not idle (state %d)", (int)Service->state);
        return false;
    }
    if (End == NULL || memchr(Tile->ImageFile, 0, sizeof Tile->ImageFile) == NULL || memchr(Tile->CoarseFile, 0, sizeof Tile->CoarseFile) == NULL) {
        CFE_EVS_SendEvent(ELUNAR_APP_FILE_ERR_EID, CFE_EVS_EventType_ERROR, "ELUNAR: a path of the command has no end");
        return false;
    }
    /* NaN, an unknown Sun, is within all limits: the library fits or assumes the light, and reports it. */
    if (Tile->SunElevationDeg < ELUNAR_APP_Data.Limits.MinSunElevationDeg || Tile->SunElevationDeg > ELUNAR_APP_Data.Limits.MaxSunElevationDeg) {
        CFE_EVS_SendEvent(ELUNAR_APP_SUN_ERR_EID, CFE_EVS_EventType_ERROR, "ELUNAR: Sun at %.2f degrees, expected %.2f to %.2f",
                          (double)Tile->SunElevationDeg, (double)ELUNAR_APP_Data.Limits.MinSunElevationDeg,
                          (double)ELUNAR_APP_Data.Limits.MaxSunElevationDeg);
        return false;
    }
    if (ELUNAR_APP_ReadFile(Tile->ImageFile, Image, sizeof Image, &Found[0]) != NULL ||
        ELUNAR_APP_ReadFile(Tile->CoarseFile, CoarseM, sizeof CoarseM, &Found[1]) != NULL) {
        return false;
    }
    (void)memset(&Given, 0, sizeof Given);
    Given.struct_bytes      = sizeof Given;
    Given.pixel_m           = Tile->PixelM;
    Given.coarse_px         = Tile->CoarsePx;
    Given.sun_azimuth_deg   = Tile->SunAzimuthDeg;
    Given.sun_elevation_deg = Tile->SunElevationDeg;
    /* A file of another length is not this tile's image; the library refuses one that is too short. */
    Given.image             = service_floats(Image, Found[0] == Px * sizeof(float) ? Found[0] : 0u);
    Given.coarse_m          = CoarseM;
    Given.coarse_len        = Found[1] / sizeof(float);
    (void)memcpy(ELUNAR_APP_Data.OutputFile, Tile->OutputFile, sizeof ELUNAR_APP_Data.OutputFile);
    if (!ELUNAR_APP_Tell(service_give(Service, &Given))) {
        TellState();
        return false;
    }
    ELUNAR_APP_Data.StateTold = Service->state;
    CFE_EVS_SendEvent(ELUNAR_APP_TILE_INF_EID, CFE_EVS_EventType_INFORMATION, "ELUNAR: %s begun, %lu pixels", Tile->ImageFile, (unsigned long)Px);
    return true;
}

/* Takes the heights of a finished tile, counts hazards, writes the file. */
static void Take(void) {
    service_t                  *Service = &ELUNAR_APP_Data.Service;
    ELUNAR_APP_HkTlm_Payload_t *Hk      = &ELUNAR_APP_Data.Hk.Payload;
    const uint32                Rows    = Service->info.tile_rows;
    const uint32                Cols    = Service->info.tile_cols;
    const float                 PixelM  = Service->tile.pixel_m;
    if (!ELUNAR_APP_Tell(service_take(Service, HeightsM, Valid)) || Service->state != SERVICE_IDLE) {
        return;
    }
    (void)ELUNAR_APP_Tell(ELUNAR_APP_CountHazards(&ELUNAR_APP_Data.Limits, HeightsM, Valid, Rows, Cols, PixelM, &Hk->ClassifiedPx, &Hk->HazardPx));
    if (ELUNAR_APP_WriteFile(ELUNAR_APP_Data.OutputFile, HeightsM, (size_t)Rows * Cols * sizeof HeightsM[0], Valid, (size_t)Rows * Cols)) {
        Hk->TilesWritten++;
        CFE_EVS_SendEvent(ELUNAR_APP_HEIGHTS_INF_EID, CFE_EVS_EventType_INFORMATION, "ELUNAR: %s written, %lu of %lu pixels are hazards",
                          ELUNAR_APP_Data.OutputFile, (unsigned long)Hk->HazardPx, (unsigned long)Hk->ClassifiedPx);
    }
}

void ELUNAR_APP_Wakeup(void) {
    service_t *Service = &ELUNAR_APP_Data.Service;
    CFE_ES_PerfLogEntry(ELUNAR_APP_WORK_PERF_ID);
    switch (Service->state) {
        case SERVICE_DOWN:
        case SERVICE_WANTS_MODEL:
            ELUNAR_APP_WorkWithoutModel();
            break;
        case SERVICE_READY:
            Take();
            break;
        case SERVICE_FAILED:
            /* Told once, by TellState. */
            break;
        default:
            /* A piece of the model's validation, one step, or one portion of scrubbing. */
            (void)ELUNAR_APP_Tell(service_cycle(Service, ELUNAR_APP_Data.Limits.StepBudgetMacs, ELUNAR_APP_Data.Limits.ScrubBytes));
            break;
    }
    /* Only a model that passed its self test ends the waiting: one that fails it again and again is loaded ever more seldom, too. */
    if (Service->state == SERVICE_IDLE || Service->state == SERVICE_TILE || Service->state == SERVICE_READY) {
        ELUNAR_APP_TryModelSoon();
    }
    TellState();
    CFE_ES_PerfLogExit(ELUNAR_APP_WORK_PERF_ID);
}
