/* ELUNAR_APP, internal declarations. */
#ifndef ELUNAR_APP_H
#define ELUNAR_APP_H

#include "cfe.h"

#include "elunar_app_eventids.h"
#include "elunar_app_msg.h"
#include "elunar_app_msgids.h"
#include "elunar_app_perfids.h"
#include "elunar_app_platform_cfg.h"
#include "elunar_app_tbl.h"
#include "service.h"

/* cFE before Draco has no CFE_MSG_PTR; there, too, a header begins with the message. */
#ifndef CFE_MSG_PTR
#define CFE_MSG_PTR(header) (&(header).Msg)
#endif

typedef struct {
    uint32           RunStatus;
    CFE_SB_PipeId_t  Pipe;
    CFE_TBL_Handle_t TableHandle;
    /* A copy, so that no address of the table is kept from one wakeup to the next. */
    ELUNAR_APP_Table_t Limits;
    ELUNAR_APP_HkTlm_t Hk;
    uint8              CommandCounter;
    uint8              CommandErrorCounter;
    service_t          Service;
    service_state_t    StateTold;
    uint32             DropsTold;
    uint8              ModelSlot; /* where the model came from; 0: no model yet */
    uint8              SlotTried; /* whose model is being validated; 0: none */
    bool               Again;     /* it replaces a model that has changed in memory */
    uint32           RetryWait; /* wakeups until a model is tried again */
    uint32             RetryNext; /* how many they were when it was tried last; 0: it was not */
    char               OutputFile[ELUNAR_APP_PATH_LEN];
} ELUNAR_APP_Data_t;

extern ELUNAR_APP_Data_t ELUNAR_APP_Data;

/* elunar_app.c: the entry point that the startup script names. */
void ELUNAR_APP_Main(void);
/* Copies the table if there is a new one; returns false, with an event, if there is none. */
bool ELUNAR_APP_RefreshLimits(void);

/* elunar_app_dispatch.c */
void ELUNAR_APP_Dispatch(const CFE_SB_Buffer_t *Buffer);

/* elunar_app_model.c: starts the service with the model of the first slot that has one; returns NULL, or why the first slot has none. */
const char *ELUNAR_APP_StartService(void);
/* A wakeup in SERVICE_DOWN or SERVICE_WANTS_MODEL: reads a slot, if it is time to. The next wakeups validate it. */
void ELUNAR_APP_WorkWithoutModel(void);
/* To be called when a model that a wakeup read is validated. */
void ELUNAR_APP_ModelIsThere(void);
/* A model that cannot be had is tried at the next wakeup, and then seldom. */
void ELUNAR_APP_TryModelSoon(void);

/* elunar_app_work.c: tiles, and the work of a wakeup. */
void ELUNAR_APP_Wakeup(void);
bool ELUNAR_APP_GiveTile(const ELUNAR_APP_ProcessTile_Payload_t *Tile);
/* Reports a status other than "continue"; returns false for a refusal or a fault. */
bool ELUNAR_APP_Tell(eld_status_t Status);

/* elunar_app_files.c: reads a whole file; returns NULL, or why not, with an event. */
const char *ELUNAR_APP_ReadFile(const char *Path, void *To, size_t MaxBytes, size_t *Bytes);
/* Returns false, with an event, if a file cannot be written completely; then it is removed. */
bool ELUNAR_APP_WriteFile(const char *Path, const void *First, size_t FirstBytes, const void *Second, size_t SecondBytes);

/* elunar_app_hazard.c: returns whether the footprint of the table fits the memory for it, and all limits are legal. */
bool ELUNAR_APP_FootprintFits(const ELUNAR_APP_Table_t *Limits);
/* Counts the pixels whose footprint is known, and those of them that are too steep or too rough. */
eld_status_t ELUNAR_APP_CountHazards(const ELUNAR_APP_Table_t *Limits, const float *HeightsM, const uint8 *Valid, uint32 Rows, uint32 Cols,
                                     float PixelM, uint32 *ClassifiedPx, uint32 *HazardPx);

#endif
