/* ELUNAR_APP: messages and commands. */
#include "elunar_app.h"

static void Count(bool Worked) {
    if (Worked) {
        ELUNAR_APP_Data.CommandCounter++;
    } else {
        ELUNAR_APP_Data.CommandErrorCounter++;
    }
}

/* Returns whether a message has the length of its structure; sends an event if not. */
static bool HasLength(const CFE_MSG_Message_t *Msg, size_t Expected) {
    CFE_MSG_Size_t    Found = 0;
    CFE_MSG_FcnCode_t Code  = 0;
    CFE_SB_MsgId_t    MsgId = CFE_SB_ValueToMsgId(0);
    CFE_MSG_GetSize(Msg, &Found);
    if (Found == Expected) {
        return true;
    }
    CFE_MSG_GetMsgId(Msg, &MsgId);
    CFE_MSG_GetFcnCode(Msg, &Code);
    CFE_EVS_SendEvent(ELUNAR_APP_LEN_ERR_EID, CFE_EVS_EventType_ERROR, "ELUNAR: message 0x%04lX, code %u: expected %lu bytes, found %lu",
                      (unsigned long)CFE_SB_MsgIdToValue(MsgId), (unsigned int)Code, (unsigned long)Expected, (unsigned long)Found);
    return false;
}

static bool Noop(void) {
    CFE_EVS_SendEvent(ELUNAR_APP_NOOP_INF_EID, CFE_EVS_EventType_INFORMATION, "ELUNAR: NOOP, library 0x%06lX, model files of version %lu",
                      (unsigned long)eld_version(), (unsigned long)eld_format_version());
    return true;
}

static bool SelfTest(void) {
    eld_status_t Status;
    if (ELUNAR_APP_Data.Service.state != SERVICE_IDLE) {
        CFE_EVS_SendEvent(ELUNAR_APP_BUSY_ERR_EID, CFE_EVS_EventType_ERROR, "ELUNAR: not idle (state %d)", (int)ELUNAR_APP_Data.Service.state);
        return false;
    }
    Status = service_self_test(&ELUNAR_APP_Data.Service);
    if (!ELUNAR_APP_Tell(Status)) {
        return false;
    }
    ELUNAR_APP_Data.StateTold = SERVICE_SELF_TEST;
    CFE_EVS_SendEvent(ELUNAR_APP_SELF_TEST_INF_EID, CFE_EVS_EventType_INFORMATION, "ELUNAR: self test begun");
    return true;
}

static bool Scrub(const ELUNAR_APP_Scrub_Payload_t *Payload) {
    /* One portion only, so that a command does not delay the bus. */
    if (Payload->Bytes == 0u || Payload->Bytes > ELUNAR_APP_SCRUB_BYTES) {
        CFE_EVS_SendEvent(ELUNAR_APP_LEN_ERR_EID, CFE_EVS_EventType_ERROR, "ELUNAR: expected 1 to %lu bytes to scrub, found %lu",
                          (unsigned long)ELUNAR_APP_SCRUB_BYTES, (unsigned long)Payload->Bytes);
        return false;
    }
    return ELUNAR_APP_Tell(service_scrub(&ELUNAR_APP_Data.Service, Payload->Bytes));
}

static void ResetCounters(void) {
    ELUNAR_APP_Data.CommandCounter      = 0;
    ELUNAR_APP_Data.CommandErrorCounter = 0;
    /* Events that were sent sixteen times are sent again, and a model that cannot be had is tried at the next wakeup. */
    CFE_EVS_ResetAllFilters();
    ELUNAR_APP_TryModelSoon();
    CFE_EVS_SendEvent(ELUNAR_APP_RESET_INF_EID, CFE_EVS_EventType_INFORMATION, "ELUNAR: counters and event filters reset");
}

static void Command(const CFE_SB_Buffer_t *Buffer) {
    CFE_MSG_FcnCode_t Code  = 0;
    const size_t      Plain = sizeof(ELUNAR_APP_PlainCmd_t);
    CFE_MSG_GetFcnCode(&Buffer->Msg, &Code);
    switch (Code) {
        case ELUNAR_APP_NOOP_CC:
            Count(HasLength(&Buffer->Msg, Plain) && Noop());
            break;
        case ELUNAR_APP_RESET_COUNTERS_CC:
            if (HasLength(&Buffer->Msg, Plain)) {
                ResetCounters();
            } else {
                Count(false);
            }
            break;
        case ELUNAR_APP_SELF_TEST_CC:
            Count(HasLength(&Buffer->Msg, Plain) && SelfTest());
            break;
        case ELUNAR_APP_PROCESS_TILE_CC:
            Count(HasLength(&Buffer->Msg, sizeof(ELUNAR_APP_ProcessTileCmd_t)) &&
                  ELUNAR_APP_GiveTile(&((const ELUNAR_APP_ProcessTileCmd_t *)(const void *)Buffer)->Payload));
            break;
        case ELUNAR_APP_SCRUB_CC:
            Count(HasLength(&Buffer->Msg, sizeof(ELUNAR_APP_ScrubCmd_t)) && Scrub(&((const ELUNAR_APP_ScrubCmd_t *)(const void *)Buffer)->Payload));
            break;
        default:
            Count(false);
            CFE_EVS_SendEvent(ELUNAR_APP_CC_ERR_EID, CFE_EVS_EventType_ERROR, "ELUNAR: no command has code %u", (unsigned int)Code);
            break;
    }
}

static void SendHousekeeping(void) {
    ELUNAR_APP_HkTlm_Payload_t *Hk      = &ELUNAR_APP_Data.Hk.Payload;
    const service_t            *Service = &ELUNAR_APP_Data.Service;
    const bool                  Waits   = Service->state == SERVICE_DOWN || Service->state == SERVICE_WANTS_MODEL;
    eld_telemetry_t             Counters;
    Counters.struct_bytes = sizeof Counters;
    Hk->CommandCounter      = ELUNAR_APP_Data.CommandCounter;
    Hk->CommandErrorCounter = ELUNAR_APP_Data.CommandErrorCounter;
    Hk->State               = (uint8)Service->state;
    Hk->ModelSlot           = ELUNAR_APP_Data.ModelSlot;
    Hk->RetryWakeups        = Waits ? ELUNAR_APP_Data.RetryWait : 0u;
    Hk->LastStatus          = Service->status;
    Hk->TilesDropped        = Service->drops;
    /* Works with a damaged model. Without a context, the last known counters are sent. */
    if (Service->context != NULL && ELD_WORKED(eld_telemetry(Service->context, &Counters))) {
        Hk->Phase          = (uint8)Counters.phase;
        Hk->Entry          = Counters.entry;
        Hk->LastFault      = Counters.last_fault;
        Hk->ModelCrc       = Counters.header_crc;
        Hk->ValidPx        = Counters.valid_px;
        Hk->Calls          = Counters.calls;
        Hk->Faults         = Counters.faults;
        Hk->ContextRepairs = Counters.context_repairs;
        Hk->LightsAssumed  = Counters.lights_assumed;
        Hk->TilesLost      = Counters.tiles_dropped;
        Hk->Tiles          = Counters.tiles;
        Hk->Steps          = Counters.steps;
        Hk->Macs           = Counters.macs;
        Hk->InputsClamped  = Counters.inputs_clamped;
        Hk->Saturated      = Counters.saturated;
        Hk->ScrubbedBytes  = Counters.scrubbed_bytes;
        Hk->ScrubPasses    = Counters.scrub_passes;
        Hk->ScrubFaults    = Counters.scrub_faults;
        Hk->SelfTestFaults = Counters.self_test_faults;
        Hk->TileFaults     = Counters.tile_faults;
    }
    CFE_SB_TimeStampMsg(CFE_MSG_PTR(ELUNAR_APP_Data.Hk.TelemetryHeader));
    CFE_SB_TransmitMsg(CFE_MSG_PTR(ELUNAR_APP_Data.Hk.TelemetryHeader), true);
    /* Table updates take effect here. */
    (void)ELUNAR_APP_RefreshLimits();
}

void ELUNAR_APP_Dispatch(const CFE_SB_Buffer_t *Buffer) {
    CFE_SB_MsgId_t MsgId = CFE_SB_ValueToMsgId(0);
    CFE_MSG_GetMsgId(&Buffer->Msg, &MsgId);
    switch (CFE_SB_MsgIdToValue(MsgId)) {
        case ELUNAR_APP_CMD_MID:
            Command(Buffer);
            break;
        case ELUNAR_APP_SEND_HK_MID:
            if (HasLength(&Buffer->Msg, sizeof(ELUNAR_APP_PlainCmd_t))) {
                SendHousekeeping();
            }
            break;
        case ELUNAR_APP_WAKEUP_MID:
            if (HasLength(&Buffer->Msg, sizeof(ELUNAR_APP_PlainCmd_t))) {
                ELUNAR_APP_Wakeup();
            }
            break;
        default:
            CFE_EVS_SendEvent(ELUNAR_APP_MID_ERR_EID, CFE_EVS_EventType_ERROR, "ELUNAR: no message has id 0x%04lX",
                              (unsigned long)CFE_SB_MsgIdToValue(MsgId));
            break;
    }
}
