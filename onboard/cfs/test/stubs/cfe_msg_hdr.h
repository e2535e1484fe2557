/* A STUB for tests: see cfe.h beside it. Headers of messages. */
#ifndef STUB_CFE_MSG_HDR_H
#define STUB_CFE_MSG_HDR_H

#include "common_types.h"

typedef size_t CFE_MSG_Size_t;
typedef uint16 CFE_MSG_FcnCode_t;
typedef union {
    uint8  Bytes[6];
    uint16 Align;
} CFE_MSG_Message_t;
typedef struct {
    CFE_MSG_Message_t Msg;
    uint8             Secondary[2];
} CFE_MSG_CommandHeader_t;
typedef struct {
    CFE_MSG_Message_t Msg;
    uint8             Secondary[6];
    uint8             Spare[4];
} CFE_MSG_TelemetryHeader_t;
#define CFE_MSG_PTR(header) (&((header).Msg))

#endif
