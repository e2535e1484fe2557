/* ELUNAR_APP: the model: its slots, and how often they are tried. */
#include "elunar_app.h"

#include <string.h>

/* Static memory: addresses and sizes are fixed when the application is loaded. */
static uint64_t Memory[(ELUNAR_APP_MEMORY_BYTES + 7u) / 8u];
static uint8    Model[ELUNAR_APP_MODEL_BYTES];

/* Slots are numbered from 1. */
static const char *const Slots[] = {ELUNAR_APP_MODEL_FILE, ELUNAR_APP_MODEL_FILE_2};
#define SLOTS (sizeof Slots / sizeof Slots[0])

/* Starts the service with the model in Model; returns NULL, or why not. */
static const char *Start(size_t Bytes) {
    service_t *Service = &ELUNAR_APP_Data.Service;
    (void)ELUNAR_APP_Tell(service_start(Service, Memory, sizeof Memory, Model, Bytes));
    if (Service->state == SERVICE_DOWN) {
        return eld_status_text(Service->status);
    }
    if ((size_t)Service->info.tile_rows * Service->info.tile_cols > ELUNAR_APP_TILE_PX) {
        CFE_EVS_SendEvent(ELUNAR_APP_FILE_ERR_EID, CFE_EVS_EventType_ERROR, "ELUNAR: expected tiles of at most %lu pixels, found %lu x %lu",
                          (unsigned long)ELUNAR_APP_TILE_PX, (unsigned long)Service->info.tile_rows, (unsigned long)Service->info.tile_cols);
        (void)memset(Service, 0, sizeof *Service);
        return "its tiles are too large";
    }
    return NULL;
}

const char *ELUNAR_APP_StartService(void) {
    const char *Why = NULL;
    uint8       Slot;
    for (Slot = 1; Slot <= SLOTS; Slot++) {
        size_t      Bytes;
        const char *WhyNot = ELUNAR_APP_ReadFile(Slots[Slot - 1u], Model, sizeof Model, &Bytes);
        if (WhyNot == NULL) {
            WhyNot = Start(Bytes);
        }
        if (WhyNot == NULL) {
            ELUNAR_APP_Data.ModelSlot = Slot;
            ELUNAR_APP_Data.StateTold = ELUNAR_APP_Data.Service.state;
            return NULL;
        }
        /* The first slot's reason: the second is its spare. */
        Why = Why == NULL ? WhyNot : Why;
    }
    return Why;
}

/* Loads the model again, at the same address. */
static void Reload(void) {
    uint8 Slot;
    for (Slot = 1; Slot <= SLOTS; Slot++) {
        size_t Bytes;
        if (ELUNAR_APP_ReadFile(Slots[Slot - 1u], Model, sizeof Model, &Bytes) == NULL &&
            ELUNAR_APP_Tell(service_model_reloaded(&ELUNAR_APP_Data.Service))) {
            ELUNAR_APP_Data.ModelSlot = Slot;
            CFE_EVS_SendEvent(ELUNAR_APP_MODEL_INF_EID, CFE_EVS_EventType_INFORMATION, "ELUNAR: model loaded again from slot %u",
                              (unsigned int)Slot);
            return;
        }
    }
}

/* Whether a model is to be tried at this wakeup: at the first one, then ever more seldom. Reading and validating megabytes at every wakeup would
 * take the processor from other applications as long as no model can be had. */
static bool TryNow(void) {
    if (ELUNAR_APP_Data.RetryWait > 0u) {
        ELUNAR_APP_Data.RetryWait--;
        return false;
    }
    ELUNAR_APP_Data.RetryNext = ELUNAR_APP_Data.RetryNext == 0u ? 1u : 2u * ELUNAR_APP_Data.RetryNext;
    if (ELUNAR_APP_Data.RetryNext > ELUNAR_APP_RETRY_WAKEUPS) {
        ELUNAR_APP_Data.RetryNext = ELUNAR_APP_RETRY_WAKEUPS;
    }
    ELUNAR_APP_Data.RetryWait = ELUNAR_APP_Data.RetryNext;
    return true;
}

void ELUNAR_APP_TryModelSoon(void) {
    ELUNAR_APP_Data.RetryWait = 0u;
    ELUNAR_APP_Data.RetryNext = 0u;
}

void ELUNAR_APP_WorkWithoutModel(void) {
    if (!TryNow()) {
        return;
    }
    if (ELUNAR_APP_Data.Service.state == SERVICE_WANTS_MODEL) {
        Reload();
    } else if (ELUNAR_APP_StartService() == NULL) {
        CFE_EVS_SendEvent(ELUNAR_APP_MODEL_INF_EID, CFE_EVS_EventType_INFORMATION, "ELUNAR: model 0x%08lX loaded from slot %u",
                          (unsigned long)ELUNAR_APP_Data.Service.info.header_crc, (unsigned int)ELUNAR_APP_Data.ModelSlot);
    } else {
        /* Why there is no model was told where it failed; it is tried again. */
    }
}
