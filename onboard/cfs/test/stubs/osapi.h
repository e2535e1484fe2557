/* A STUB for tests: see common_types.h beside it. Files of the OS abstraction layer. */
#ifndef STUB_OSAPI_H
#define STUB_OSAPI_H

#include "common_types.h"

#define OS_SUCCESS            0
#define OS_ERROR              (-1)
#define OS_READ_ONLY          0
#define OS_WRITE_ONLY         1
#define OS_FILE_FLAG_NONE     0
#define OS_FILE_FLAG_CREATE   1
#define OS_FILE_FLAG_TRUNCATE 2

int32 OS_OpenCreate(osal_id_t *filedes, const char *path, int32 flags, int32 access_mode);
int32 OS_close(osal_id_t filedes);
int32 OS_read(osal_id_t filedes, void *buffer, size_t nbytes);
int32 OS_write(osal_id_t filedes, const void *buffer, size_t nbytes);
int32 OS_remove(const char *path);

#endif
