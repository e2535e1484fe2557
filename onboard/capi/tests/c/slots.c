/* Updates a model in two slots whose storage is read, not mapped: slots OLD NEW
 *
 * The storage is an array here; a driver of NOR or NAND flash, or of files, takes the place of `drive`. C99 and C++17.
 */
#include "files.h"

enum { SECTOR = 4096, SLOT = 32 * SECTOR, CHUNK = 1000 };

static uint8_t slot_a[SLOT], slot_b[SLOT], record[SECTOR], record_copy[SECTOR];
static uint8_t *const regions[4] = {slot_a, slot_b, record, record_copy};
/* The model runs from here. */
static uint64_t ram[SLOT / 8];
/* Headers, records and chunks are read here. */
static uint8_t part[SECTOR];
static uint64_t state[ELD_SLOTS_BYTES / 8];
static eld_slots_t *slots;
static unsigned long steps;

static void expect(const char *what, eld_status_t found, eld_status_t expected) {
    if (found != expected) fail(what, eld_status_text(found));
}

/* Does what the library asks for, until the work is done. */
static eld_status_t drive(eld_status_t begun) {
    eld_slots_want_t want;
    const void *data = NULL;
    size_t bytes = 0;
    eld_status_t status = begun;
    want.struct_bytes = sizeof want;
    while (status == ELD_RUNNING) {
        status = eld_slots_step(slots, data, bytes, 0, 100000, &want); /* a watchdog is kicked here */
        if (status != ELD_RUNNING) break;
        steps++;
        if (want.what == ELD_SLOTS_READ_AGAIN) continue;
        data = NULL;
        bytes = 0;
        if (want.what == ELD_SLOTS_READ) {
            /* A model is wanted as a whole; all else is short. */
            void *const to = want.bytes > sizeof part ? (void *)ram : (void *)part;
            bytes = (size_t)want.bytes;
            memcpy(to, regions[want.region] + want.offset_bytes, bytes);
            data = to;
        } else if (want.what == ELD_SLOTS_ERASE) {
            memset(regions[want.region] + want.offset_bytes, 0xff, SECTOR);
        } else {
            memcpy(regions[want.region] + want.offset_bytes, want.data, (size_t)want.bytes);
        }
    }
    return status;
}

/* Runs the self test of the model that runs, and confirms it. */
static void confirm(void) {
    static uint64_t memory[1 << 17];
    eld_slots_state_t known;
    eld_context_t *context;
    known.struct_bytes = sizeof known;
    expect("state", eld_slots_state(slots, &known), ELD_OK);
    /* The boot has validated it, and left it in memory. */
    expect("init", eld_init_checked(memory, sizeof memory, ram, known.file_bytes, &known.check, &context), ELD_OK);
    expect("self test", eld_self_test_begin(context), ELD_OK);
    while (eld_step(context, 1000000) == ELD_RUNNING) {
    }
    expect("confirm", drive(eld_slots_confirm(slots, context)), ELD_OK);
}

static void reset(eld_status_t expected) {
    eld_slots_storage_t storage;
    memset(&storage, 0, sizeof storage);
    storage.struct_bytes = sizeof storage;
    storage.slot_bytes = SLOT;
    storage.slot_sector_bytes = storage.record_sector_bytes = storage.record_bytes = SECTOR;
    expect("init", eld_slots_init(state, sizeof state, &storage, &slots), ELD_OK);
    expect("boot", drive(eld_slots_boot(slots)), expected);
}

static uint32_t word_at(const uint8_t *bytes) {
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}

int main(int argc, char **argv) {
    size_t old_bytes, new_bytes, half;
    const uint8_t *old_model, *new_model;
    eld_slots_state_t known;
    (void)golden_tile;
    if (argc != 3) fail("usage", "slots OLD NEW");
    old_model = (const uint8_t *)read_file("", argv[1], &old_bytes);
    new_model = (const uint8_t *)read_file("", argv[2], &new_bytes);
    memset(slot_a, 0xff, SLOT);
    memset(slot_b, 0xff, SLOT);
    memset(record, 0xff, SECTOR);
    memset(record_copy, 0xff, SECTOR);
    memcpy(slot_a, old_model, old_bytes); /* delivered with the hardware */

    reset(ELD_NOTICE_SLOTS_SALVAGED);
    confirm();
    known.struct_bytes = sizeof known;
    for (half = new_bytes / 2;; half = new_bytes) {
        /* The header's last word, its 32nd. */
        expect("upload", drive(eld_slots_upload(slots, (uint32_t)new_bytes, word_at(new_model + 124))), ELD_OK);
        for (;;) {
            size_t chunk;
            expect("state", eld_slots_state(slots, &known), ELD_OK);
            if (known.uploaded_bytes >= half) break;
            chunk = new_bytes - (size_t)known.uploaded_bytes;
            if (chunk > CHUNK) chunk = CHUNK;
            expect("write", drive(eld_slots_write(slots, known.uploaded_bytes, new_model + known.uploaded_bytes, chunk)), ELD_OK);
        }
        if (half == new_bytes) break;
        reset(ELD_OK); /* in the middle */
    }
    expect("trial", drive(eld_slots_start_trial(slots, 1)), ELD_OK);
    reset(ELD_NOTICE_SLOTS_TRIAL);
    confirm();
    reset(ELD_OK);
    expect("state", eld_slots_state(slots, &known), ELD_OK);
    if (known.slot != ELD_REGION_SLOT_B || known.file_bytes != new_bytes || known.record_copies != 2) fail("state", "not the new model");
    if (memcmp(slot_b, new_model, new_bytes) != 0 || memcmp(slot_a, old_model, old_bytes) != 0) fail("slots", "other bytes");
    printf("%lu steps\n", steps);
    return 0;
}
