/* Commands and the housekeeping packet of ELUNAR_APP, with their headers. */
#ifndef ELUNAR_APP_MSGSTRUCT_H
#define ELUNAR_APP_MSGSTRUCT_H

#include "cfe_msg_hdr.h"
#include "elunar_app_msgdefs.h"

/* A message without payload: NOOP, RESET_COUNTERS, SELF_TEST, housekeeping request, wakeup. */
typedef struct {
    CFE_MSG_CommandHeader_t CommandHeader;
} ELUNAR_APP_PlainCmd_t;

typedef struct {
    CFE_MSG_CommandHeader_t          CommandHeader;
    ELUNAR_APP_ProcessTile_Payload_t Payload;
} ELUNAR_APP_ProcessTileCmd_t;

typedef struct {
    CFE_MSG_CommandHeader_t    CommandHeader;
    ELUNAR_APP_Scrub_Payload_t Payload;
} ELUNAR_APP_ScrubCmd_t;

typedef struct {
    CFE_MSG_TelemetryHeader_t  TelemetryHeader;
    ELUNAR_APP_HkTlm_Payload_t Payload;
} ELUNAR_APP_HkTlm_t;

#endif
