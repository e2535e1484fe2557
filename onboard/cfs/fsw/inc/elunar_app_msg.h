/* Commands and the housekeeping packet of ELUNAR_APP. Packets are structures in this machine's layout, as in every cFS application. */
#ifndef ELUNAR_APP_MSG_H
#define ELUNAR_APP_MSG_H

#include "cfe.h"
#include "elunar_app_platform_cfg.h"

#define ELUNAR_APP_NOOP_CC 0           /* counts, and reports versions */
#define ELUNAR_APP_RESET_COUNTERS_CC 1 /* sets both command counters to 0; counters of the library stay */
#define ELUNAR_APP_SELF_TEST_CC 2      /* begins the self test */
#define ELUNAR_APP_PROCESS_TILE_CC 3   /* begins a tile from files */
#define ELUNAR_APP_SCRUB_CC 4          /* scrubs some bytes of the model at once */

/* A message without payload: NOOP, RESET_COUNTERS, SELF_TEST, housekeeping request, wakeup. */
typedef struct {
    CFE_MSG_CommandHeader_t CommandHeader;
} ELUNAR_APP_PlainCmd_t;

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
    CFE_MSG_CommandHeader_t          CommandHeader;
    ELUNAR_APP_ProcessTile_Payload_t Payload;
} ELUNAR_APP_ProcessTileCmd_t;

typedef struct {
    uint32 Bytes; /* 1 to ELUNAR_APP_SCRUB_BYTES */
} ELUNAR_APP_Scrub_Payload_t;

typedef struct {
    CFE_MSG_CommandHeader_t    CommandHeader;
    ELUNAR_APP_Scrub_Payload_t Payload;
} ELUNAR_APP_ScrubCmd_t;

/* Counters as in eld_telemetry_t; 0 while there is no context. */
typedef struct {
    uint8  CommandCounter;
    uint8  CommandErrorCounter;
    uint8  State; /* service_state_t */
    uint8  Phase; /* ELD_PHASE_* */
    uint32 Entry;
    uint32 LastStatus;
    uint32 LastFault;
    uint32 ModelCrc;     /* CRC32C of the model's header: its identity */
    uint32 ValidPx;      /* of the current tile */
    uint32 TilesWritten;
    uint32 TilesDropped; /* by this application */
    uint32 ClassifiedPx;     /* of the latest tile: pixels whose height and four neighbours are valid */
    uint32 HazardPx;     /* classified pixels that are too steep or too rough */
    uint64 Calls;
    uint64 Faults;
    uint64 ContextRepairs;
    uint64 LightsAssumed;
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

typedef struct {
    CFE_MSG_TelemetryHeader_t  TelemetryHeader;
    ELUNAR_APP_HkTlm_Payload_t Payload;
} ELUNAR_APP_HkTlm_t;

#endif
