/* A software bus for tests with the functions that the application uses:
 *
 *     bus IMAGE COARSE OUT      commands, a tile, a damaged model
 *     bus                       no model in either slot; then one in the second
 *
 * Sends the application a script of messages, prints its events that pass its filters, one per line, and its housekeeping. It is not cFE:
 * one task, no queue, no time. Files are those of the host. */
#include "elunar_app.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

extern ELUNAR_APP_Table_t ELUNAR_APP_Limits;

/* A message as this bus stores it. */
typedef union {
    CFE_SB_Buffer_t             Buffer;
    ELUNAR_APP_PlainCmd_t       Plain;
    ELUNAR_APP_ProcessTileCmd_t Tile;
    ELUNAR_APP_ScrubCmd_t       Scrub;
} Message_t;

static Message_t              Message;
static CFE_SB_MsgId_Atom_t    MessageId;
static size_t                 MessageSize;
static CFE_MSG_FcnCode_t      MessageCode;
static char                 **Arguments;
static unsigned               Subscribed, Step, Wakeups, Events, Packets;
static ELUNAR_APP_Table_t     Table;
static CFE_TBL_CallbackFuncPtr_t Validate;
static ELUNAR_APP_HkTlm_t     Packet;
static FILE                  *Files[8];
static unsigned               Opened[2]; /* the model's files */

static void Fail(const char *What) {
    fprintf(stderr, "ERROR: %s\n", What);
    exit(1);
}

/* ---- executive, events, messages ------------------------------------------------------------------------------------ */

static bool Ended;

bool CFE_ES_RunLoop(uint32 *RunStatus) { return *RunStatus == CFE_ES_RunStatus_APP_RUN && !Ended; }

void CFE_ES_ExitApp(uint32 ExitStatus) { printf("exit %u\n", (unsigned)ExitStatus); }

void CFE_ES_PerfLogAdd(uint32 Marker, uint32 EntryExit) {
    /* Entries and exits of the work must alternate. */
    static uint32 Last = 1;
    if (Marker == ELUNAR_APP_WORK_PERF_ID) {
        if (EntryExit == Last) Fail("performance marks out of order");
        Last = EntryExit;
    }
}

CFE_Status_t CFE_ES_WriteToSysLog(const char *SpecStringPtr, ...) {
    va_list List;
    va_start(List, SpecStringPtr);
    vprintf(SpecStringPtr, List);
    va_end(List);
    return CFE_SUCCESS;
}

/* Binary filters, as cFE counts them: an event passes while the bits of its count that the mask has are 0. */
static CFE_EVS_BinFilter_t EventFilters[2];
static uint16              EventCounts[2];

CFE_Status_t CFE_EVS_Register(const void *Filters, uint16 NumEventFilters, uint16 FilterScheme) {
    if (Filters == NULL || NumEventFilters != 2 || FilterScheme != CFE_EVS_EventFilter_BINARY) return -1;
    memcpy(EventFilters, Filters, sizeof EventFilters);
    return CFE_SUCCESS;
}

CFE_Status_t CFE_EVS_ResetAllFilters(void) {
    memset(EventCounts, 0, sizeof EventCounts);
    return CFE_SUCCESS;
}

static bool Filtered(uint16 EventID) {
    int i;
    for (i = 0; i < 2; i++) {
        if (EventFilters[i].EventID == EventID) return (EventCounts[i]++ & EventFilters[i].Mask) != 0;
    }
    return false;
}

CFE_Status_t CFE_EVS_SendEvent(uint16 EventID, uint16 EventType, const char *Spec, ...) {
    va_list List;
    if (Filtered(EventID)) return CFE_SUCCESS;
    printf("event %u type %u: ", EventID, EventType);
    va_start(List, Spec);
    vprintf(Spec, List);
    va_end(List);
    putchar('\n');
    Events++;
    return CFE_SUCCESS;
}

CFE_Status_t CFE_MSG_Init(CFE_MSG_Message_t *MsgPtr, CFE_SB_MsgId_t MsgId, CFE_MSG_Size_t Size) {
    memset(MsgPtr, 0, Size);
    return MsgId.Value == ELUNAR_APP_HK_TLM_MID && Size == sizeof(ELUNAR_APP_HkTlm_t) ? CFE_SUCCESS : -1;
}

CFE_Status_t CFE_MSG_GetMsgId(const CFE_MSG_Message_t *MsgPtr, CFE_SB_MsgId_t *MsgId) {
    (void)MsgPtr;
    MsgId->Value = MessageId;
    return CFE_SUCCESS;
}

CFE_Status_t CFE_MSG_GetFcnCode(const CFE_MSG_Message_t *MsgPtr, CFE_MSG_FcnCode_t *FcnCode) {
    (void)MsgPtr;
    *FcnCode = MessageCode;
    return CFE_SUCCESS;
}

CFE_Status_t CFE_MSG_GetSize(const CFE_MSG_Message_t *MsgPtr, CFE_MSG_Size_t *Size) {
    (void)MsgPtr;
    *Size = MessageSize;
    return CFE_SUCCESS;
}

/* ---- bus ------------------------------------------------------------------------------------------------------------ */

CFE_Status_t CFE_SB_CreatePipe(CFE_SB_PipeId_t *PipeIdPtr, uint16 Depth, const char *PipeName) {
    PipeIdPtr->Value = 7;
    return Depth > 0 && strlen(PipeName) > 0 ? CFE_SUCCESS : -1;
}

CFE_Status_t CFE_SB_Subscribe(CFE_SB_MsgId_t MsgId, CFE_SB_PipeId_t PipeId) {
    Subscribed++;
    return PipeId.Value == 7 && MsgId.Value != 0 ? CFE_SUCCESS : -1;
}

void CFE_SB_TimeStampMsg(CFE_MSG_Message_t *MsgPtr) { (void)MsgPtr; }

CFE_Status_t CFE_SB_TransmitMsg(const CFE_MSG_Message_t *MsgPtr, bool IsOrigination) {
    size_t i;
    if (!IsOrigination) Fail("housekeeping originates here");
    memcpy(&Packet, (const void *)MsgPtr, sizeof Packet);
    Packets++;
    printf("hk commands %u errors %u state %u tiles %lu written %u dropped %u classified %u hazards %u scrub passes %lu faults %lu status 0x%08lx\n",
           Packet.Payload.CommandCounter, Packet.Payload.CommandErrorCounter, Packet.Payload.State, (unsigned long)Packet.Payload.Tiles,
           (unsigned)Packet.Payload.TilesWritten, (unsigned)Packet.Payload.TilesDropped, (unsigned)Packet.Payload.ClassifiedPx,
           (unsigned)Packet.Payload.HazardPx, (unsigned long)Packet.Payload.ScrubPasses, (unsigned long)Packet.Payload.Faults,
           (unsigned long)Packet.Payload.LastStatus);
    fputs("packet ", stdout);
    for (i = 0; i < sizeof Packet; i++) printf("%02x", ((const uint8 *)&Packet)[i]);
    putchar('\n');
    return CFE_SUCCESS;
}

static void Send(CFE_SB_MsgId_Atom_t Id, CFE_MSG_FcnCode_t Code, size_t Size) {
    MessageId   = Id;
    MessageCode = Code;
    MessageSize = Size;
}

static void Command(CFE_MSG_FcnCode_t Code, size_t Size) { Send(ELUNAR_APP_CMD_MID, Code, Size); }

static bool Tile(const char *Image, float SunElevationDeg) {
    ELUNAR_APP_ProcessTile_Payload_t *Payload = &Message.Tile.Payload;
    memset(Payload, 0, sizeof *Payload);
    strncpy(Payload->ImageFile, Image, sizeof Payload->ImageFile - 1);
    strncpy(Payload->CoarseFile, Arguments[2], sizeof Payload->CoarseFile - 1);
    strncpy(Payload->OutputFile, Arguments[3], sizeof Payload->OutputFile - 1);
    Payload->PixelM          = 2.0f;
    Payload->CoarsePx        = 29.61f;
    Payload->SunAzimuthDeg   = 189.48853f;
    Payload->SunElevationDeg = SunElevationDeg;
    Command(ELUNAR_APP_PROCESS_TILE_CC, sizeof Message.Tile);
    return true;
}

/* Prepares one of so many wakeups. */
static bool WakeTimes(unsigned Times) {
    if (++Wakeups > Times) {
        Wakeups = 0;
        return false;
    }
    Send(ELUNAR_APP_WAKEUP_MID, 0, sizeof Message.Plain);
    Step--;
    return true;
}

/* Prints how often the model's files were opened since the last call. */
static bool TellOpened(const char *When) {
    printf("opened %u and %u times %s\n", Opened[0], Opened[1], When);
    memset(Opened, 0, sizeof Opened);
    return false;
}

/* Prepares a wakeup and stays at this step of the script as long as the service is in a state. */
static bool Wake(service_state_t While) {
    if (ELUNAR_APP_Data.Service.state != While) return false;
    if (++Wakeups > 20000) Fail("too many wakeups");
    Send(ELUNAR_APP_WAKEUP_MID, 0, sizeof Message.Plain);
    Step--;
    return true;
}

static bool Scrub(uint32 Bytes) {
    Message.Scrub.Payload.Bytes = Bytes;
    Command(ELUNAR_APP_SCRUB_CC, sizeof Message.Scrub);
    return true;
}

/* Puts a damaged model into the first slot, and a sound one into the second. */
static bool MoveModels(void) {
    if (rename("damaged.eld", ELUNAR_APP_MODEL_FILE) != 0 || rename("spare.eld", ELUNAR_APP_MODEL_FILE_2) != 0) Fail("no models");
    return false;
}

static bool HarmModel(void) {
    ((uint8 *)(uintptr_t)ELUNAR_APP_Data.Service.model)[2000000] ^= 8;
    return false;
}

/* An illegal table is refused. */
static bool HarmTable(void) {
    Table.MaxSlopeDeg = -1.0f;
    if (Validate(&Table) == CFE_SUCCESS) Fail("a bad table is taken");
    Table = ELUNAR_APP_Limits;
    return false;
}

static bool Ask(CFE_SB_MsgId_Atom_t Id) {
    Send(Id, 0, sizeof Message.Plain);
    return true;
}

static bool Plain(CFE_MSG_FcnCode_t Code) {
    Command(Code, sizeof Message.Plain);
    return true;
}

/* The script without a model. */
static bool PlayWithout(unsigned At) {
    switch (At) {
        case 0: return TellOpened("at the start");
        case 1: return WakeTimes(4000);
        case 2: return TellOpened("in 4000 wakeups");
        case 3: return Ask(ELUNAR_APP_SEND_HK_MID);
        case 4: return Plain(ELUNAR_APP_RESET_COUNTERS_CC);
        case 5: return WakeTimes(1);
        case 6: return TellOpened("after a reset");
        case 7: return MoveModels();
        case 8: return Plain(ELUNAR_APP_RESET_COUNTERS_CC);
        case 9: return WakeTimes(1);
        case 10: return Wake(SERVICE_CHECK); /* the first slot's model is damaged: */
        case 11: return Wake(SERVICE_DOWN); /* the second slot's */
        case 12: return Wake(SERVICE_CHECK);
        case 13: return Wake(SERVICE_SELF_TEST);
        case 14: Wakeups = 0; return Ask(ELUNAR_APP_SEND_HK_MID);
        case 15: return HarmModel();
        case 16: return Wake(SERVICE_IDLE); /* found by scrubbing, */
        case 17: return Wake(SERVICE_WANTS_MODEL);
        case 18: return Wake(SERVICE_CHECK); /* the first slot's again, */
        case 19: return Wake(SERVICE_WANTS_MODEL); /* loaded again from the second slot, */
        case 20: return Wake(SERVICE_CHECK);
        case 21: return Wake(SERVICE_SELF_TEST); /* tested again */
        case 22: return TellOpened("after damage");
        default: Ended = true; return Ask(ELUNAR_APP_SEND_HK_MID);
    }
}

/* The script: prepares the message of a step; returns false if that step ends without a message. */
static bool Play(unsigned At) {
    switch (At) {
        case 0: return Plain(ELUNAR_APP_NOOP_CC);
        case 1: return Plain(ELUNAR_APP_PROCESS_TILE_CC); /* too short */
        case 2: return Plain(99);
        case 3: return Ask(0x1999);
        case 4: return Tile(Arguments[1], 25.614722f); /* while the self test is in progress */
        case 5: return Wake(SERVICE_SELF_TEST);
        case 6: return Tile("/nowhere/image.f32", 25.614722f);
        case 7: return Tile(Arguments[1], 1.0f); /* the Sun too low */
        case 8: return Tile(Arguments[1], 25.614722f);
        case 9: return Wake(SERVICE_TILE);
        case 10: return Wake(SERVICE_READY);
        case 11: return Ask(ELUNAR_APP_SEND_HK_MID);
        case 12: return Scrub(0);
        case 13: return Scrub(4096);
        case 14: return HarmModel();
        case 15: return Wake(SERVICE_IDLE); /* found by scrubbing, */
        case 16: return Wake(SERVICE_WANTS_MODEL); /* loaded again, */
        case 17: return Wake(SERVICE_CHECK);
        case 18: return Wake(SERVICE_SELF_TEST); /* tested again */
        case 19: return Plain(ELUNAR_APP_SELF_TEST_CC);
        case 20: return Wake(SERVICE_SELF_TEST);
        case 21: return HarmTable();
        case 22: return Ask(ELUNAR_APP_SEND_HK_MID);
        case 23: return Plain(ELUNAR_APP_RESET_COUNTERS_CC);
        case 24: return Ask(ELUNAR_APP_SEND_HK_MID);
        default: Ended = true; return Ask(ELUNAR_APP_WAKEUP_MID);
    }
}

CFE_Status_t CFE_SB_ReceiveBuffer(CFE_SB_Buffer_t **BufPtr, CFE_SB_PipeId_t PipeId, int32 TimeOut) {
    if (PipeId.Value != 7 || TimeOut != CFE_SB_PEND_FOREVER) return CFE_SB_PIPE_RD_ERR;
    while (!(Arguments == NULL ? PlayWithout(Step++) : Play(Step++))) {
    }
    *BufPtr = &Message.Buffer;
    return CFE_SUCCESS;
}

/* ---- tables --------------------------------------------------------------------------------------------------------- */

CFE_Status_t CFE_TBL_Register(CFE_TBL_Handle_t *TblHandlePtr, const char *Name, size_t Size, uint16 TblOptionFlags,
                              CFE_TBL_CallbackFuncPtr_t TblValidationFuncPtr) {
    *TblHandlePtr = 3;
    Validate      = TblValidationFuncPtr;
    return strcmp(Name, ELUNAR_APP_TABLE_NAME) == 0 && Size == sizeof Table && TblOptionFlags == CFE_TBL_OPT_DEFAULT ? CFE_SUCCESS : -1;
}

CFE_Status_t CFE_TBL_Load(CFE_TBL_Handle_t TblHandle, CFE_TBL_SrcEnum_t SrcType, const void *SrcDataPtr) {
    if (TblHandle != 3 || SrcType != CFE_TBL_SRC_FILE || strcmp(SrcDataPtr, ELUNAR_APP_TABLE_FILE) != 0) return -1;
    Table = ELUNAR_APP_Limits;
    return Validate(&Table);
}

CFE_Status_t CFE_TBL_Manage(CFE_TBL_Handle_t TblHandle) { return TblHandle == 3 ? CFE_SUCCESS : -1; }

static bool Held;

CFE_Status_t CFE_TBL_GetAddress(void **TblPtr, CFE_TBL_Handle_t TblHandle) {
    static bool Updated = true;
    if (TblHandle != 3) return CFE_TBL_ERR_NEVER_LOADED;
    if (Held) Fail("the table is held");
    Held    = true;
    *TblPtr = &Table;
    /* cFE returns this once after a load. */
    if (Updated) {
        Updated = false;
        return CFE_TBL_INFO_UPDATED;
    }
    return CFE_SUCCESS;
}

CFE_Status_t CFE_TBL_ReleaseAddress(CFE_TBL_Handle_t TblHandle) {
    Held = false;
    return TblHandle == 3 ? CFE_SUCCESS : -1;
}

/* ---- files ---------------------------------------------------------------------------------------------------------- */

int32 OS_OpenCreate(osal_id_t *filedes, const char *path, int32 flags, int32 access_mode) {
    uint32 i = 0;
    while (i < 8 && Files[i] != NULL) i++;
    if (i == 8) Fail("too many open files");
    if (strcmp(path, ELUNAR_APP_MODEL_FILE) == 0) Opened[0]++;
    if (strcmp(path, ELUNAR_APP_MODEL_FILE_2) == 0) Opened[1]++;
    if ((access_mode == OS_WRITE_ONLY) != (flags == (OS_FILE_FLAG_CREATE | OS_FILE_FLAG_TRUNCATE))) return OS_ERROR;
    Files[i]       = fopen(path, access_mode == OS_WRITE_ONLY ? "wb" : "rb");
    filedes->Value = i;
    return Files[i] == NULL ? OS_ERROR : OS_SUCCESS;
}

int32 OS_close(osal_id_t filedes) {
    fclose(Files[filedes.Value]);
    Files[filedes.Value] = NULL;
    return OS_SUCCESS;
}

int32 OS_read(osal_id_t filedes, void *buffer, size_t nbytes) {
    /* In portions, as a file system may do. */
    return (int32)fread(buffer, 1, nbytes < 100000 ? nbytes : 100000, Files[filedes.Value]);
}

int32 OS_write(osal_id_t filedes, const void *buffer, size_t nbytes) {
    return (int32)fwrite(buffer, 1, nbytes < 100000 ? nbytes : 100000, Files[filedes.Value]);
}

int32 OS_remove(const char *path) { return remove(path) == 0 ? OS_SUCCESS : OS_ERROR; }

int main(int argc, char **argv) {
    char Kernel[64];
    if (argc != 4 && argc != 1) Fail("usage: bus [IMAGE COARSE OUT]");
    if (argc == 4) Arguments = argv;
    if (eld_kernel_name(Kernel, sizeof Kernel) != ELD_OK) Fail("no name of the kernel");
    printf("kernel %s\n", Kernel);
    ELUNAR_APP_Main();
    if (Subscribed != 3) Fail("expected three subscriptions");
    printf("%u events, %u packets, %s\n", Events, Packets, Held ? "table held" : "table released");
    return 0;
}
