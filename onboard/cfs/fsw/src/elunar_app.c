/* ELUNAR_APP: start, software bus loop, table. */
#include "elunar_app.h"

#include <string.h>

ELUNAR_APP_Data_t ELUNAR_APP_Data;

static bool InLimits(float Value, float Low, float High) {
    /* False for NaN. */
    return Value >= Low && Value <= High;
}

/* Validates a table before table services activate it. */
static int32 ValidateTable(void *TblPtr) {
    const ELUNAR_APP_Table_t *Table = TblPtr;
    bool                      Good  = Table->StepBudgetMacs > 0u && Table->ScrubBytes > 0u && ELUNAR_APP_FootprintFits(Table) &&
                InLimits(Table->MinSunElevationDeg, 0.0f, 90.0f) &&
                InLimits(Table->MaxSunElevationDeg, 0.0f, 90.0f) && Table->MinSunElevationDeg < Table->MaxSunElevationDeg;
    if (!Good) {
        CFE_EVS_SendEvent(ELUNAR_APP_TBL_ERR_EID, CFE_EVS_EventType_ERROR, "ELUNAR: table refused: a limit is out of range");
    }
    return Good ? CFE_SUCCESS : -1;
}

bool ELUNAR_APP_RefreshLimits(void) {
    void        *Address;
    CFE_Status_t Status;
    CFE_TBL_Manage(ELUNAR_APP_Data.TableHandle);
    Status = CFE_TBL_GetAddress(&Address, ELUNAR_APP_Data.TableHandle);
    /* An updated table is not an error; a table that was never loaded is one. */
    if (Status != CFE_SUCCESS && Status != CFE_TBL_INFO_UPDATED) {
        CFE_EVS_SendEvent(ELUNAR_APP_TBL_ERR_EID, CFE_EVS_EventType_ERROR, "ELUNAR: no table, RC = 0x%08lX", (unsigned long)Status);
        return false;
    }
    (void)memcpy(&ELUNAR_APP_Data.Limits, Address, sizeof ELUNAR_APP_Data.Limits);
    CFE_TBL_ReleaseAddress(ELUNAR_APP_Data.TableHandle);
    return true;
}

static CFE_Status_t InitTable(void) {
    CFE_Status_t Status = CFE_TBL_Register(&ELUNAR_APP_Data.TableHandle, ELUNAR_APP_TABLE_NAME, sizeof(ELUNAR_APP_Table_t),
                                           CFE_TBL_OPT_DEFAULT, ValidateTable);
    if (Status == CFE_SUCCESS) {
        Status = CFE_TBL_Load(ELUNAR_APP_Data.TableHandle, CFE_TBL_SRC_FILE, ELUNAR_APP_TABLE_FILE);
    }
    if (Status == CFE_SUCCESS && !ELUNAR_APP_RefreshLimits()) {
        Status = -1;
    }
    return Status;
}

static CFE_Status_t InitBus(void) {
    static const CFE_SB_MsgId_Atom_t Ids[] = {ELUNAR_APP_CMD_MID, ELUNAR_APP_SEND_HK_MID, ELUNAR_APP_WAKEUP_MID};
    size_t                           i;
    CFE_Status_t Status = CFE_SB_CreatePipe(&ELUNAR_APP_Data.Pipe, ELUNAR_APP_PIPE_DEPTH, ELUNAR_APP_PIPE_NAME);
    for (i = 0; Status == CFE_SUCCESS && i < sizeof Ids / sizeof Ids[0]; i++) {
        Status = CFE_SB_Subscribe(CFE_SB_ValueToMsgId(Ids[i]), ELUNAR_APP_Data.Pipe);
    }
    return Status;
}

/* Says what the application started with. WhyNot: NULL, or why there is no model. */
static void TellStartup(const char *WhyNot) {
    const service_t   *Service = &ELUNAR_APP_Data.Service;
    const uint32       Version = eld_version();
    const unsigned int Major   = Version >> 16;
    const unsigned int Minor   = (Version >> 8) & 255u;
    const unsigned int Patch   = Version & 255u;
    char               Kernel[64];
    if (!ELD_WORKED(eld_kernel_name(Kernel, sizeof Kernel))) {
        Kernel[0] = 0;
    }
    if (WhyNot != NULL) {
        CFE_EVS_SendEvent(ELUNAR_APP_STARTUP_INF_EID, CFE_EVS_EventType_ERROR, "ELUNAR: no model: slot 1: %s; library %u.%u.%u, kernel %s", WhyNot,
                          Major, Minor, Patch, Kernel);
        return;
    }
    CFE_EVS_SendEvent(ELUNAR_APP_STARTUP_INF_EID, CFE_EVS_EventType_INFORMATION,
                      "ELUNAR: model 0x%08lX from slot %u, %lu of %lu bytes; library %u.%u.%u, kernel %s", (unsigned long)Service->info.header_crc,
                      (unsigned int)ELUNAR_APP_Data.ModelSlot, (unsigned long)Service->info.memory_bytes,
                      (unsigned long)ELUNAR_APP_MEMORY_BYTES, Major, Minor, Patch, Kernel);
}

static CFE_Status_t Init(void) {
    /* Events that a damaged model could repeat at every wakeup are sent 16 times, and counted in housekeeping. */
    static const CFE_EVS_BinFilter_t Filters[] = {
        {ELUNAR_APP_STATUS_ERR_EID, CFE_EVS_FIRST_16_STOP},
        {ELUNAR_APP_FILE_ERR_EID, CFE_EVS_FIRST_16_STOP},
    };
    CFE_Status_t Status;
    (void)memset(&ELUNAR_APP_Data, 0, sizeof ELUNAR_APP_Data);
    ELUNAR_APP_Data.RunStatus = CFE_ES_RunStatus_APP_RUN;
    Status = CFE_EVS_Register(Filters, (uint16)(sizeof Filters / sizeof Filters[0]), CFE_EVS_EventFilter_BINARY);
    if (Status != CFE_SUCCESS) {
        CFE_ES_WriteToSysLog("ELUNAR_APP: events not registered, RC = 0x%08lX\n", (unsigned long)Status);
        return Status;
    }
    CFE_MSG_Init(CFE_MSG_PTR(ELUNAR_APP_Data.Hk.TelemetryHeader), CFE_SB_ValueToMsgId(ELUNAR_APP_HK_TLM_MID), sizeof ELUNAR_APP_Data.Hk);
    Status = InitBus();
    if (Status == CFE_SUCCESS) {
        Status = InitTable();
    }
    if (Status != CFE_SUCCESS) {
        CFE_ES_WriteToSysLog("ELUNAR_APP: bus or table not there, RC = 0x%08lX\n", (unsigned long)Status);
        return Status;
    }
    if (eld_version() >> 16 != (uint32_t)ELD_VERSION >> 16) {
        CFE_ES_WriteToSysLog("ELUNAR_APP: library version 0x%06lX, header 0x%06lX\n", (unsigned long)eld_version(), (unsigned long)ELD_VERSION);
        return -1;
    }
    /* A missing or damaged model does not end the application: it is tried again at wakeups, and housekeeping says when. */
    TellStartup(ELUNAR_APP_StartService());
    return CFE_SUCCESS;
}

void ELUNAR_APP_Main(void) {
    CFE_SB_Buffer_t *Buffer;
    CFE_Status_t     Status;
    CFE_ES_PerfLogEntry(ELUNAR_APP_PERF_ID);
    if (Init() != CFE_SUCCESS) {
        ELUNAR_APP_Data.RunStatus = CFE_ES_RunStatus_APP_ERROR;
    }
    while (CFE_ES_RunLoop(&ELUNAR_APP_Data.RunStatus)) {
        CFE_ES_PerfLogExit(ELUNAR_APP_PERF_ID);
        Status = CFE_SB_ReceiveBuffer(&Buffer, ELUNAR_APP_Data.Pipe, CFE_SB_PEND_FOREVER);
        CFE_ES_PerfLogEntry(ELUNAR_APP_PERF_ID);
        if (Status == CFE_SUCCESS) {
            ELUNAR_APP_Dispatch(Buffer);
        } else {
            CFE_EVS_SendEvent(ELUNAR_APP_PIPE_ERR_EID, CFE_EVS_EventType_ERROR, "ELUNAR: pipe cannot be read, RC = 0x%08lX", (unsigned long)Status);
            ELUNAR_APP_Data.RunStatus = CFE_ES_RunStatus_APP_ERROR;
        }
    }
    CFE_ES_PerfLogExit(ELUNAR_APP_PERF_ID);
    CFE_ES_ExitApp(ELUNAR_APP_Data.RunStatus);
}
