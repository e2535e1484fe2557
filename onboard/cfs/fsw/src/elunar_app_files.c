/* ELUNAR_APP: files, through the OS abstraction layer. */
#include "elunar_app.h"

static const char *Complain(const char *Path, const char *What) {
    CFE_EVS_SendEvent(ELUNAR_APP_FILE_ERR_EID, CFE_EVS_EventType_ERROR, "ELUNAR: %s: %s", Path, What);
    return What;
}

const char *ELUNAR_APP_ReadFile(const char *Path, void *To, size_t MaxBytes, size_t *Bytes) {
    osal_id_t File;
    uint8     More;
    int32     Got = 0;
    *Bytes        = 0;
    if (OS_OpenCreate(&File, Path, OS_FILE_FLAG_NONE, OS_READ_ONLY) != OS_SUCCESS) {
        return Complain(Path, "cannot be opened");
    }
    do {
        *Bytes += (size_t)Got;
        Got = *Bytes < MaxBytes ? OS_read(File, (uint8 *)To + *Bytes, MaxBytes - *Bytes) : 0;
    } while (Got > 0);
    /* One more byte than expected shows that the file is longer. */
    if (Got == 0 && *Bytes == MaxBytes) {
        Got = OS_read(File, &More, 1);
    }
    OS_close(File);
    if (Got < 0) {
        return Complain(Path, "cannot be read");
    }
    return Got == 0 ? NULL : Complain(Path, "is too long");
}

static bool WriteAll(osal_id_t File, const void *From, size_t Bytes) {
    size_t Done = 0;
    while (Done < Bytes) {
        int32 Put = OS_write(File, (const uint8 *)From + Done, Bytes - Done);
        if (Put <= 0) {
            return false;
        }
        Done += (size_t)Put;
    }
    return true;
}

bool ELUNAR_APP_WriteFile(const char *Path, const void *First, size_t FirstBytes, const void *Second, size_t SecondBytes) {
    osal_id_t File;
    bool      Written;
    if (OS_OpenCreate(&File, Path, OS_FILE_FLAG_CREATE | OS_FILE_FLAG_TRUNCATE, OS_WRITE_ONLY) != OS_SUCCESS) {
        (void)Complain(Path, "cannot be made");
        return false;
    }
    Written = WriteAll(File, First, FirstBytes) && WriteAll(File, Second, SecondBytes);
    OS_close(File);
    if (!Written) {
        OS_remove(Path);
        (void)Complain(Path, "cannot be written");
    }
    return Written;
}
