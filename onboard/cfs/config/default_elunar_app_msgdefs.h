/* What commands and the housekeeping packet of ELUNAR_APP carry, in the layout of this machine. */
#ifndef ELUNAR_APP_MSGDEFS_H
#define ELUNAR_APP_MSGDEFS_H

#include "common_types.h"
#include "elunar_app_fcncodes.h"
#include "elunar_app_interface_cfg.h"

/* Input files: f32 of this machine, row by row, first row first. OutputFile: heights in metres, then one byte, 1 or 0, per pixel. */
typedef struct {
    char  ImageFile[ELUNAR_APP_PATH_LEN];
    char  CoarseFile[ELUNAR_APP_PATH_LEN];
    char  OutputFile[ELUNAR_APP_PATH_LEN];
    float PixelM;          /* ground size of a pixel, metres */
    float CoarsePx;        /* side of a pixel of the coarse DTM on its own grid, in pixels of the image */
    float SunAzimuthDeg;   /* clockwise from the direction of decreasing rows; NaN: unknown */
    float SunElevationDeg; /* above the horizon; NaN: unknown */
} ELUNAR_APP_ProcessTile_Payload_t;

typedef struct {
    uint32 Bytes; /* 1 to ELUNAR_APP_SCRUB_BYTES */
} ELUNAR_APP_Scrub_Payload_t;

/* Counters as in eld_telemetry_t; 0 while there has been no context. Without padding. */
typedef struct {
    uint8  CommandCounter;
    uint8  CommandErrorCounter;
    uint8  State;     /* service_state_t */
    uint8  Phase;     /* ELD_PHASE_* */
    uint8  ModelSlot; /* where the model was loaded from: 1 or 2; 0: no model yet */
    uint8  Spare[3];
    uint32 Entry;
    uint32 LastStatus;
    uint32 LastFault;
    uint32 ModelCrc;     /* CRC32C of the model's header: its identity */
    uint32 ValidPx;      /* of the current tile */
    uint32 TilesWritten;
    uint32 TilesDropped; /* by this application: refused, or given up after three attempts */
    uint32 ClassifiedPx; /* of the latest tile: pixels whose footprint is within the tile and valid */
    uint32 HazardPx;     /* classified pixels that are too steep or too rough */
    uint32 RetryWakeups; /* wakeups until a model that could not be had is tried again; else 0 */
    uint64 Calls;
    uint64 Faults;
    uint64 ContextRepairs;
    uint64 LightsAssumed;
    uint64 TilesLost; /* by the library: dropped before they were finished, or lost (tiles_dropped) */
    uint64 Tiles;
    uint64 Steps;
    uint64 Macs;
    uint64 InputsClamped;
    uint64 Saturated;
    uint64 ScrubbedBytes;
    uint64 ScrubPasses;
    uint64 ScrubFaults;
    uint64 SelfTestFaults;
    uint64 TileFaults;
} ELUNAR_APP_HkTlm_Payload_t;

#endif
