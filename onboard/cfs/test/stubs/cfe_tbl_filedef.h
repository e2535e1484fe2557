/* A STUB for tests: see common_types.h beside it. The macro that describes a table for the tool that makes its file. */
#ifndef STUB_CFE_TBL_FILEDEF_H
#define STUB_CFE_TBL_FILEDEF_H

#include "common_types.h"

typedef struct {
    char   ObjectName[64];
    char   TableName[40];
    char   Description[32];
    char   TgtFilename[20];
    uint32 ObjectSize;
} CFE_TBL_FileDef_t;

#define CFE_TBL_FILEDEF(object, table, description, file) \
    OS_USED CFE_TBL_FileDef_t CFE_TBL_FileDef = {#object, #table, #description, #file, sizeof(object)};

#endif
