/* ELUNAR_APP: the model: its slots, and how often they are tried. */
#include "elunar_app.h"

/* Static memory: addresses and sizes are fixed when the application is loaded. */
static uint64_t Memory[(ELUNAR_APP_MEMORY_BYTES + 7u) / 8u];
static uint8    Model[ELUNAR_APP_MODEL_BYTES];

/* Slots are numbered from 1. */
static const char *const Slots[] = {ELUNAR_APP_MODEL_FILE, ELUNAR_APP_MODEL_FILE_2};
#define SLOTS (sizeof Slots / sizeof Slots[0])

/* Reads a slot and begins to validate it; returns NULL, or why not. */
static const char *Begin(uint8 Slot) {
    service_t   *Service = &ELUNAR_APP_Data.Service;
    const bool   Again   = Service->state == SERVICE_WANTS_MODEL;
    size_t       Bytes;
    const char  *WhyNot  = ELUNAR_APP_ReadFile(Slots[Slot - 1u], Model, sizeof Model, &Bytes);
    eld_status_t Status;
    if (WhyNot != NULL) {
        return WhyNot;
    }
    Status = Again ? service_model_reloaded(Service)
                   : service_start(Service, Memory, sizeof Memory, Model, Bytes, ELUNAR_APP_TILE_PX);
    return ELUNAR_APP_Tell(Status) ? NULL : eld_status_text(Status);
}

const char *ELUNAR_APP_StartService(void) {
    service_t  *Service = &ELUNAR_APP_Data.Service;
    const char *Why     = NULL;
    uint8       Slot;
    for (Slot = 1; Slot <= SLOTS; Slot++) {
        const char *WhyNot = Begin(Slot);
        while (WhyNot == NULL && Service->state == SERVICE_CHECK) {
            (void)ELUNAR_APP_Tell(service_cycle(Service, ELUNAR_APP_Data.Limits.StepBudgetMacs, 0u));
        }
        if (WhyNot == NULL && Service->state == SERVICE_DOWN) {
            WhyNot = eld_status_text(Service->status);
        }
        if (WhyNot == NULL) {
            ELUNAR_APP_Data.ModelSlot = Slot;
            ELUNAR_APP_Data.StateTold = Service->state;
            return NULL;
        }
        /* The first slot's reason: the second is its spare. */
        Why = Why == NULL ? WhyNot : Why;
    }
    return Why;
}

/* Whether a model is to be tried at this wakeup: at the first one, then ever more seldom. Reading megabytes again and again would take the
 * processor from other applications as long as no model can be had. */
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
    const bool Again = ELUNAR_APP_Data.Service.state == SERVICE_WANTS_MODEL;
    /* A model that turned out to be damaged is followed by the next slot at once. */
    if (ELUNAR_APP_Data.SlotTried == 0u && !TryNow()) {
        return;
    }
    while (ELUNAR_APP_Data.SlotTried < SLOTS) {
        ELUNAR_APP_Data.SlotTried++;
        if (Begin(ELUNAR_APP_Data.SlotTried) == NULL) {
            ELUNAR_APP_Data.Again = Again;
            return;
        }
    }
    /* Why there is no model was told where it failed; it is tried again. */
    ELUNAR_APP_Data.SlotTried = 0u;
}

void ELUNAR_APP_ModelIsThere(void) {
    ELUNAR_APP_Data.ModelSlot = ELUNAR_APP_Data.SlotTried;
    ELUNAR_APP_Data.SlotTried = 0u;
    if (ELUNAR_APP_Data.Again) {
        CFE_EVS_SendEvent(ELUNAR_APP_MODEL_INF_EID, CFE_EVS_EventType_INFORMATION, "ELUNAR: model loaded again from slot %u",
                          (unsigned int)ELUNAR_APP_Data.ModelSlot);
    } else {
        CFE_EVS_SendEvent(ELUNAR_APP_MODEL_INF_EID, CFE_EVS_EventType_INFORMATION, "ELUNAR: model 0x%08lX loaded from slot %u",
                          (unsigned long)ELUNAR_APP_Data.Service.info.header_crc, (unsigned int)ELUNAR_APP_Data.ModelSlot);
    }
}
