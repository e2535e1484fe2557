/* ELunarDTM, the flight runner: one orbiter image and a coarse DTM in, a DTM at the image's resolution out.
 *
 *     eld_model_check -> eld_init -> eld_begin, or eld_begin_step ... -> eld_step ... -> eld_output
 *     or in pieces: eld_model_check_step ... -> eld_init_checked -> eld_begin_step ... -> eld_step ...
 *                                    eld_scrub between steps, eld_self_test_* now and then, eld_telemetry always
 *     eld_slots_init -> eld_slots_boot, _upload, _write, _start_trial, _confirm or _reject -> eld_slots_step ...
 *     eld_strip_plan -> eld_strip_init -> what eld_strip_step asks for: eld_strip_push, _push_posts, _take, _finish
 *
 * Made by cbindgen from onboard/capi/src (tests/header.rs); do not edit. C99 and C++17.
 *
 * The library allocates nothing, has no globals and takes no locks: all memory is the caller's, and contexts are independent. Every function
 * returns a status. Refused means: nothing has changed. NULL, misaligned pointers, lengths that wrap, overlapping buffers and calls out of
 * order are refused. What the caller promises:
 *
 * - a pointer with its length names memory that exists, and that nobody else writes during the call (nor reads, if the library writes it);
 * - the memory lent to eld_init or eld_strip_init, and the model, live at their places as long as the context is used;
 * - a pointer given as a context or a strip came from eld_init or eld_strip_init, or points at 4 KiB that may be read and written;
 * - one thread at a time uses a context.
 */

#ifndef ELUNAR_H
#define ELUNAR_H

#include <stddef.h>
#include <stdint.h>

/* A status: severity, unit and code.
 *
 *  31 30 29         24 23             16 15                              0
 * +-----+-------------+-----------------+---------------------------------+
 * | sev |  0 (unused) |      unit       |              code               |
 * +-----+-------------+-----------------+---------------------------------+
 * unit: 1 the call, 2 the lent memory, 3 the model, 4 the tile, 5 the run, 6 the context, 7 the strip, 8 the slots
 */
/** ELD_GOOD, ELD_NOTICE, ELD_REFUSED or ELD_FAULT. */
#define ELD_SEVERITY(status) ((uint32_t)(status) >> 30)
/** Whether the call did its work: good or notice. */
#define ELD_WORKED(status) (ELD_SEVERITY(status) <= ELD_NOTICE)

#define ELD_GOOD    0u /**< severity: done */
#define ELD_NOTICE  1u /**< severity: done, and there is something to know */
#define ELD_REFUSED 2u /**< severity: not done, and nothing has changed */
#define ELD_FAULT   3u /**< severity: memory has changed or a result is wrong: what the context or the model holds cannot be trusted */
#define ELD_OK                            UINT32_C(0x00000000) /**< done */

#define ELD_RUNNING                       UINT32_C(0x40050001) /**< the tile needs more steps */
#define ELD_NOTICE_DROPPED                UINT32_C(0x40050002) /**< begun; the tile before was dropped unfinished */

#define ELD_NOTICE_LIGHT_ASSUMED          UINT32_C(0x40040001) /**< begun; the tile does not show its light, so the light is assumed */
#define ELD_NOTICE_DROPPED_LIGHT_ASSUMED  UINT32_C(0x40040002) /**< begun; the tile before was dropped unfinished, and the light is assumed */
#define ELD_NOTICE_COARSE                 UINT32_C(0x40040003) /**< begun; the image has no contrast or no light, or the coarse DTM no relief, so the heights will be the coarse DTM's */
#define ELD_NOTICE_DROPPED_COARSE         UINT32_C(0x40040004) /**< begun; the tile before was dropped unfinished, and the heights will be the coarse DTM's */

#define ELD_NOTICE_NO_LINE                UINT32_C(0x40010001) /**< done; no line of the maps came out: push the next one, or all are out */

#define ELD_NOTICE_REPAIRED               UINT32_C(0x40060001) /**< done; a damaged copy of the context was repaired from the other */

#define ELD_NOTICE_STRIP_PUSH             UINT32_C(0x40070001) /**< the strip needs a line, or its end */
#define ELD_NOTICE_STRIP_POSTS            UINT32_C(0x40070002) /**< the strip needs a row of posts, or their end, before its next line */
#define ELD_NOTICE_STRIP_TAKE             UINT32_C(0x40070003) /**< finished lines of the strip must be taken first */
#define ELD_NOTICE_STRIP_DONE             UINT32_C(0x40070004) /**< all tiles of the strip are done; its last lines can be taken */
#define ELD_NOTICE_STRIP_NO_LINE          UINT32_C(0x40070005) /**< no line of the strip is finished */

#define ELD_NOTICE_SLOTS_TRIAL            UINT32_C(0x40080001) /**< the model on trial runs: run its self test, then confirm or reject it */
#define ELD_NOTICE_SLOTS_SALVAGED         UINT32_C(0x40080002) /**< a model runs that was found without a record: run its self test, then confirm or reject it */

#define ELD_REFUSED_NULL                  UINT32_C(0x80010001) /**< a pointer is NULL */
#define ELD_REFUSED_ALIGNMENT             UINT32_C(0x80010002) /**< a pointer is not aligned as its type demands */
#define ELD_REFUSED_LENGTH                UINT32_C(0x80010003) /**< a length reaches beyond the address space */
#define ELD_REFUSED_STRUCT_BYTES          UINT32_C(0x80010004) /**< struct_bytes is not the size of this library's structure */
#define ELD_REFUSED_OVERLAP               UINT32_C(0x80010005) /**< a buffer overlaps another one, the lent memory or the model */
#define ELD_REFUSED_BUFFER                UINT32_C(0x80010006) /**< a buffer is too short, or not of rows * cols samples */
#define ELD_REFUSED_NO_TILE               UINT32_C(0x80010007) /**< no tile was begun */
#define ELD_REFUSED_NOT_DONE              UINT32_C(0x80010008) /**< the tile is not finished */
#define ELD_REFUSED_OTHER_TILE            UINT32_C(0x80010009) /**< the tile is the self test's where the caller's is asked for, or the other way round */
#define ELD_REFUSED_NOT_BEGUN             UINT32_C(0x8001000b) /**< the tile is not begun yet: call eld_begin_step until it is */
#define ELD_REFUSED_NO_ERRORS             UINT32_C(0x8001000a) /**< the model's maps are not weighed, so it expects no errors */
#define ELD_REFUSED_OPTIONS               UINT32_C(0x8001000c) /**< an option of the terrain maps is out of range */
#define ELD_REFUSED_TIME                  UINT32_C(0x8001000f) /**< the time is not within the years 1900 to 2100 */
#define ELD_REFUSED_PLACE                 UINT32_C(0x80010010) /**< the latitude is beyond 90 degrees, the longitude beyond 360, or one is no number */
#define ELD_REFUSED_NOT_CHECKED           UINT32_C(0x8001000e) /**< the check of the model is not finished: call eld_model_check_step until it is */
#define ELD_REFUSED_UNFINISHED            UINT32_C(0x8001000d) /**< lines of the grid before are not out yet: call eld_terrain_finish */

#define ELD_REFUSED_MEMORY_SHORT          UINT32_C(0x80020001) /**< the lent memory is shorter than eld_model_check says */
#define ELD_REFUSED_MEMORY_ALIGNMENT      UINT32_C(0x80020002) /**< the lent memory is not aligned as eld_model_check says */

#define ELD_REFUSED_MODEL_MAGIC           UINT32_C(0x80030001) /**< not a model file */
#define ELD_REFUSED_MODEL_VERSION         UINT32_C(0x80030002) /**< a model file of another format version */
#define ELD_REFUSED_MODEL_ENDIANNESS      UINT32_C(0x80030003) /**< a model file whose words have their bytes swapped */
#define ELD_REFUSED_MODEL_LENGTH          UINT32_C(0x80030004) /**< the model's length is not what its header says */
#define ELD_REFUSED_MODEL_HEADER_CHECKSUM UINT32_C(0x80030005) /**< the checksum of the model's header does not match */
#define ELD_REFUSED_MODEL_CHECKSUM        UINT32_C(0x80030006) /**< a checksum of the model's body does not match */
#define ELD_REFUSED_MODEL_HEADER          UINT32_C(0x80030007) /**< a field of the model's header is out of range */
#define ELD_REFUSED_MODEL_TENSOR          UINT32_C(0x80030008) /**< a tensor of the model is not legal */
#define ELD_REFUSED_MODEL_OPERATOR        UINT32_C(0x80030009) /**< an operator of the model is not legal */
#define ELD_REFUSED_MODEL_SCHEDULE        UINT32_C(0x8003000a) /**< the model's schedule is not legal */
#define ELD_REFUSED_MODEL_SIZE            UINT32_C(0x8003000b) /**< the model needs more memory than this machine can address */
#define ELD_REFUSED_MODEL_WORK            UINT32_C(0x8003000c) /**< validating the model takes more work than a file of its length may take */

#define ELD_REFUSED_TILE_SIZE             UINT32_C(0x80040001) /**< a map of the tile does not have rows * cols samples */
#define ELD_REFUSED_TILE_MASK             UINT32_C(0x80040002) /**< a byte of the mask is neither 0 nor 1 */
#define ELD_REFUSED_TILE_PIXEL            UINT32_C(0x80040003) /**< pixel_m or coarse_px is not finite and above 0 */
#define ELD_REFUSED_TILE_SUN              UINT32_C(0x80040004) /**< the Sun's azimuth is not within -360 to 360 degrees, or its elevation not above 0 and below 90; NaN stands for unknown */
#define ELD_REFUSED_TILE_MASKED           UINT32_C(0x80040005) /**< no pixel of the tile is valid in both maps */
#define ELD_REFUSED_TILE_POSTS            UINT32_C(0x80040009) /**< the posts are not whole rows, a number of their grid is not finite, or coarse_m is given as well */
#define ELD_REFUSED_TILE_LIGHT            UINT32_C(0x8004000b) /**< the light of the scene is none that eld_light_decide gives for this model */
#define ELD_REFUSED_TILE_OPTION           UINT32_C(0x8004000a) /**< network_alone or processor_checks is neither 0 nor 1 */
#define ELD_REFUSED_TILE_FORMAT           UINT32_C(0x80040008) /**< the image has no format of ELD_PIXELS_*, a gain or offset that is not finite, or flags that do not exist */

#define ELD_REFUSED_STRIP_SETTINGS        UINT32_C(0x80070001) /**< an overlap, a number of lines kept or a choice of the strip's settings that does not exist */
#define ELD_REFUSED_STRIP_SIZE            UINT32_C(0x80070002) /**< a strip without columns, or one that needs more memory than this machine can address */
#define ELD_REFUSED_STRIP_GRID            UINT32_C(0x80070003) /**< the grid of posts does not run along the strip */
#define ELD_REFUSED_STRIP_FULL            UINT32_C(0x80070004) /**< no room for a line or a row of posts: step, or take lines, first */
#define ELD_REFUSED_STRIP_ENDED           UINT32_C(0x80070005) /**< the end of the strip or of its posts was announced */
#define ELD_REFUSED_STRIP_POSTS_FIRST     UINT32_C(0x80070006) /**< the line needs another row of posts first */
#define ELD_REFUSED_STRIP_NO_POSTS        UINT32_C(0x80070007) /**< the strip's coarse heights come with its lines, not as posts */

#define ELD_REFUSED_SLOTS_STORAGE         UINT32_C(0x80080001) /**< regions of the slots that cannot hold a record, or are not whole sectors */
#define ELD_REFUSED_SLOTS_BUSY            UINT32_C(0x80080002) /**< other work on the slots is not finished: call eld_slots_step, or eld_slots_boot to give it up */
#define ELD_REFUSED_SLOTS_IDLE            UINT32_C(0x80080003) /**< no work on the slots was begun */
#define ELD_REFUSED_SLOTS_NOT_BOOTED      UINT32_C(0x80080004) /**< eld_slots_boot must be finished first */
#define ELD_REFUSED_SLOTS_NOTHING_RUNS    UINT32_C(0x80080005) /**< no slot holds a model that runs; one can be uploaded */
#define ELD_REFUSED_SLOTS_UNCONFIRMED     UINT32_C(0x80080006) /**< the model that runs, or one that is to be tried, must be confirmed or rejected first */
#define ELD_REFUSED_SLOTS_CONFIRMED       UINT32_C(0x80080007) /**< a confirmed model is not rejected: put another one on trial */
#define ELD_REFUSED_SLOTS_NO_UPLOAD       UINT32_C(0x80080008) /**< no upload was begun, or it was given up after an error */
#define ELD_REFUSED_SLOTS_LENGTH          UINT32_C(0x80080009) /**< an upload that is longer than a slot or than announced, or of which bytes are missing */
#define ELD_REFUSED_SLOTS_OFFSET          UINT32_C(0x8008000a) /**< a chunk that does not follow the one before */
#define ELD_REFUSED_SLOTS_OTHER_MODEL     UINT32_C(0x8008000b) /**< another model than the one announced or running */
#define ELD_REFUSED_SLOTS_BOOTS           UINT32_C(0x8008000c) /**< a trial of none or of more than 16 boots */

#define ELD_FAULT_SLOTS_STORAGE           UINT32_C(0xc0080001) /**< the storage could not read, erase or write */
#define ELD_FAULT_SLOTS_NOT_WRITTEN       UINT32_C(0xc0080002) /**< what was written to the storage is not there */

#define ELD_FAULT_MODEL_CHANGED           UINT32_C(0xc0030001) /**< the model is not as it was when it was checked */
#define ELD_FAULT_CHECK                   UINT32_C(0xc0030002) /**< the check of the model has changed in memory, or is that of another model: zero it and begin again */

#define ELD_FAULT_VALIDITY                UINT32_C(0xc0040001) /**< the bits of valid or dark pixels have changed in memory; the tile is lost */
#define ELD_FAULT_LIGHT                   UINT32_C(0xc0040002) /**< what was added of the scene's light has changed in memory, in both copies; it is forgotten: add it again */
#define ELD_FAULT_LINES                   UINT32_C(0xc0040003) /**< a line that is kept for the terrain maps has changed in memory; the grid is lost: begin it again */

#define ELD_FAULT_SELF_TEST               UINT32_C(0xc0050001) /**< the self test's output is not the one stored in the model */
#define ELD_FAULT_RUN                     UINT32_C(0xc0050002) /**< the run stands at a place that the model does not have; the tile is lost */
#define ELD_FAULT_DATA_CHANGED            UINT32_C(0xc0050004) /**< a map of the tile has changed in memory, or the processor has erred; the tile is lost: begin it again */
#define ELD_FAULT_HEIGHT                  UINT32_C(0xc0050005) /**< the network gave a height that no ground has; the tile is lost */
#define ELD_FAULT_INTERRUPTED             UINT32_C(0xc0050003) /**< the call before did not return; the tile is lost */

#define ELD_FAULT_CONTEXT_LOST            UINT32_C(0xc0060001) /**< no context there, or both its copies are damaged: call eld_init again */
#define ELD_FAULT_CONTEXT_MOVED           UINT32_C(0xc0060002) /**< the context is not where it was made: call eld_init again */


/**
 * Version of the header's interface, major << 16 | minor << 8 | patch. Compare with `eld_version()`.
 */
#define ELD_VERSION 131072

/**
 * Light: the network works with any Sun and takes the image unchanged.
 */
#define ELD_LIGHT_ANY 0

/**
 * Light: the network knows the Sun in the north-west; tiles with another Sun are mirrored, and the heights are mirrored back.
 */
#define ELD_LIGHT_NORTHWEST 1

/**
 * Light: as `ELD_LIGHT_NORTHWEST`, and the network takes maps computed from the image and the light.
 */
#define ELD_LIGHT_GIVEN 2

/**
 * Light: as `ELD_LIGHT_GIVEN`, and the maps are weighed by the trust in the light and by the share of the contrast that is relief.
 */
#define ELD_LIGHT_WEIGHED 3

/**
 * Light: as `ELD_LIGHT_WEIGHED`, with more maps: the slopes of the first estimate, and the direction of the light.
 */
#define ELD_LIGHT_SLOPED 4

/**
 * Heights: scaled by the relief of the tile's own truth, which the relief of the coarse DTM replaces.
 */
#define ELD_HEIGHTS_OWN_RELIEF 0

/**
 * Heights: scaled by the coarse DTM's relief.
 */
#define ELD_HEIGHTS_COARSE_RELIEF 1

/**
 * Heights: counted in pixels about the coarse DTM's mean; level ground is legal.
 */
#define ELD_HEIGHTS_PIXELS 2

/**
 * Phase: no tile was begun.
 */
#define ELD_PHASE_EMPTY 0

/**
 * Phase: a tile is in progress.
 */
#define ELD_PHASE_TILE 1

/**
 * Phase: a tile is finished; its heights can be read.
 */
#define ELD_PHASE_TILE_DONE 2

/**
 * Phase: the self test is in progress.
 */
#define ELD_PHASE_SELF_TEST 3

/**
 * Phase: the self test is finished and can be checked.
 */
#define ELD_PHASE_SELF_TEST_DONE 4

/**
 * Phase: `eld_begin_step` prepares a tile.
 */
#define ELD_PHASE_PREPARING 5

/**
 * Phase: `eld_light_add` looks at a tile.
 */
#define ELD_PHASE_LIGHT 6

/**
 * Pixels: a float in the processor's own byte order.
 */
#define ELD_PIXELS_F32 0

/**
 * Pixels: a byte.
 */
#define ELD_PIXELS_U8 1

/**
 * Pixels: two bytes, the low one first.
 */
#define ELD_PIXELS_U16_LE 2

/**
 * Pixels: two bytes, the high one first.
 */
#define ELD_PIXELS_U16_BE 3

/**
 * Pixels: twelve bits, two pixels in three bytes, the high bits first; a row begins with a byte.
 */
#define ELD_PIXELS_U12_PACKED 4

/**
 * Flag of pixels: those with `null_code` are void.
 */
#define ELD_PIXELS_HAS_NULL 1

/**
 * Flag of pixels: those with `saturated_from` or more are void.
 */
#define ELD_PIXELS_HAS_SATURATED 2

/**
 * Origin of a height: the image explains at least half of the relief between the coarse DTM's pixels.
 */
#define ELD_ORIGIN_IMAGE 0

/**
 * Origin of a height: the image explains a tenth to a half of it.
 */
#define ELD_ORIGIN_BLENDED 1

/**
 * Origin of a height: the image explains less; the height is that of the coarse DTM.
 */
#define ELD_ORIGIN_COARSE 2

/**
 * Origin of a height: the pixel is dark; the height is that of its surroundings and of the coarse DTM.
 */
#define ELD_ORIGIN_SHADOW 3

/**
 * Origin of a height: image or coarse DTM is void; the height is filled.
 */
#define ELD_ORIGIN_VOID 4

/**
 * Hazard: the plane under the footprint is steeper than the limit.
 */
#define ELD_HAZARD_TOO_STEEP 1

/**
 * Hazard: a pixel is above or below that plane by more than the limit.
 */
#define ELD_HAZARD_TOO_ROUGH 2

/**
 * Hazard: the footprint leaves the grid or has a void.
 */
#define ELD_HAZARD_UNKNOWN 4

/**
 * Hazard: the plane may be steeper than the limit within the stated number of standard deviations.
 */
#define ELD_HAZARD_MAYBE_TOO_STEEP 8

/**
 * Source of a light: the network works with any light and takes none.
 */
#define ELD_SOURCE_NOT_ASKED 0

/**
 * Source of a light: every angle of the Sun that the network needs was stated.
 */
#define ELD_SOURCE_GIVEN 1

/**
 * Source of a light: fitted to image and coarse DTM, at least in part.
 */
#define ELD_SOURCE_FITTED 2

/**
 * Source of a light: neither stated nor shown.
 */
#define ELD_SOURCE_ASSUMED 3

/**
 * Bytes of memory for `eld_slots_init`.
 */
#define ELD_SLOTS_BYTES 1616

/**
 * Wanted: nothing, the work is done.
 */
#define ELD_SLOTS_NOTHING 0

/**
 * Wanted: `bytes` bytes of a region, from `offset_bytes` on, as `data` of the next call: a whole model, or else at most a header (128 bytes), a
 * record (64 bytes) or the chunk that was written.
 */
#define ELD_SLOTS_READ 1

/**
 * Wanted: the bytes of the call before, once more.
 */
#define ELD_SLOTS_READ_AGAIN 2

/**
 * Wanted: that the sector that begins at `offset_bytes` be erased.
 */
#define ELD_SLOTS_ERASE 3

/**
 * Wanted: that `bytes` bytes at `data` be written from `offset_bytes` on.
 */
#define ELD_SLOTS_WRITE 4

/**
 * Region: slot A.
 */
#define ELD_REGION_SLOT_A 0

/**
 * Region: slot B.
 */
#define ELD_REGION_SLOT_B 1

/**
 * Region: the record.
 */
#define ELD_REGION_RECORD 2

/**
 * Region: its copy.
 */
#define ELD_REGION_RECORD_COPY 3

/**
 * Standing of the model that runs: `eld_slots_boot` is not finished.
 */
#define ELD_STANDING_UNKNOWN 0

/**
 * Standing of the model that runs: confirmed.
 */
#define ELD_STANDING_CONFIRMED 1

/**
 * Standing of the model that runs: on trial.
 */
#define ELD_STANDING_TRIAL 2

/**
 * Standing of the model that runs: found without a record.
 */
#define ELD_STANDING_SALVAGED 3

/**
 * No model runs.
 */
#define ELD_STANDING_NOTHING 4

/**
 * A model's working memory and the state of its tile, at the start of the memory lent to `eld_init`. It must not be moved or read.
 * A copy of all lent memory that was made between two calls may be written back to the same place, for the same model.
 * It ends with that memory: there is no function to close it. One thread at a time may use it; different contexts are independent.
 */
typedef struct eld_context_t eld_context_t;

/**
 * The work on model slots, at the start of the memory lent to `eld_slots_init`. The rules of `eld_context_t` hold.
 */
typedef struct eld_slots_t eld_slots_t;

/**
 * A strip with its model's working memory, at the start of the memory lent to `eld_strip_init`. What holds for a context holds for it, too.
 */
typedef struct eld_strip_t eld_strip_t;

/**
 * Terrain maps of a grid whose lines come one at a time, at the start of the memory lent to `eld_terrain_init`. The rules of `eld_context_t` hold.
 */
typedef struct eld_terrain_t eld_terrain_t;

/**
 * Result of a call: severity in bits 31-30 (0 good, 1 notice, 2 refused, 3 fault), unit in bits 23-16, code in bits 15-0.
 */
typedef uint32_t eld_status_t;

/**
 * Properties and requirements of a model. All sizes are exact.
 */
typedef struct {
    /**
     * sizeof(eld_model_info_t), set by the caller.
     */
    uint32_t struct_bytes;
    /**
     * Version of the file's format.
     */
    uint32_t format_version;
    /**
     * Rows of a tile.
     */
    uint32_t tile_rows;
    /**
     * Columns of a tile.
     */
    uint32_t tile_cols;
    /**
     * Number of maps for the image: 1, 4 with `ELD_LIGHT_GIVEN` or `ELD_LIGHT_WEIGHED`, 8 with `ELD_LIGHT_SLOPED`.
     */
    uint32_t image_maps;
    /**
     * Light that the network knows: one of `ELD_LIGHT_*`.
     */
    uint32_t light;
    /**
     * Scale of heights: one of `ELD_HEIGHTS_*`.
     */
    uint32_t heights;
    /**
     * Alignment of the memory for `eld_init`, bytes.
     */
    uint32_t memory_align;
    /**
     * Bytes of memory for `eld_init`; one byte less is refused.
     */
    uint64_t memory_bytes;
    /**
     * Bytes of `memory_bytes` that are the arena of the network's tensors.
     */
    uint64_t arena_bytes;
    /**
     * Length of the file, bytes.
     */
    uint64_t file_bytes;
    /**
     * Multiply-accumulates of a tile.
     */
    uint64_t tile_macs;
    /**
     * Bound of a unit of work, multiply-accumulates and bytes that are compared: a step exceeds its budget by less than this.
     */
    uint64_t largest_unit_macs;
    /**
     * CRC32C of the header, which depends on all other bytes: the model's identity.
     */
    uint32_t header_crc;
    /**
     * CRC32C of the self test's output.
     */
    uint32_t self_test_crc;
    /**
     * Upper end of the normalised elevation range.
     */
    float nr;
    /**
     * Share by which the range of the coarse DTM is widened below and above.
     */
    float range_margin;
} eld_model_info_t;

/**
 * The check of a model in pieces, which the caller keeps: zero before the first call of `eld_model_check_step`. It has a checksum and may be
 * copied.
 */
typedef struct {
    /**
     * Known to the library.
     */
    uint64_t words[11];
} eld_check_t;

/**
 * Pixels as the camera has them, perhaps within a larger frame. Brightness is `gain * code + offset`, relative to any unit.
 */
typedef struct {
    /**
     * The first pixel, first row first. Any address is legal.
     */
    const void *data;
    /**
     * Number of bytes from the first pixel on.
     */
    size_t data_bytes;
    /**
     * Bytes from a row to the next; 0 if rows follow each other without a gap.
     */
    size_t row_bytes;
    /**
     * One of `ELD_PIXELS_*`.
     */
    uint32_t format;
    /**
     * `ELD_PIXELS_HAS_NULL`, `ELD_PIXELS_HAS_SATURATED`, both or 0; 0 for floats.
     */
    uint32_t flags;
    /**
     * Brightness of a step of the code; 1 for floats that are brightness.
     */
    float gain;
    /**
     * Brightness of code 0.
     */
    float offset;
    /**
     * The code of a pixel without a value.
     */
    uint32_t null_code;
    /**
     * The smallest code of a saturated pixel.
     */
    uint32_t saturated_from;
} eld_pixels_t;

/**
 * A coarse DTM as posts on its own grid. The library interpolates it onto the image's grid as the ground does. Rows and columns of the posts run
 * along those of the image: the centre of the image's pixel (row, column) is at row `row0 + row * rows_per_line` and column
 * `col0 + column * cols_per_px` of the posts, where (0, 0) is the centre of the first post.
 */
typedef struct {
    /**
     * Heights at the posts, metres above the 1737.4 km sphere, row-major; samples that are not real are voids.
     */
    const float *posts_m;
    /**
     * Number of posts: whole rows.
     */
    size_t posts_len;
    /**
     * Posts in a row.
     */
    size_t cols;
    /**
     * Row of the posts at the image's first row.
     */
    double row0;
    /**
     * Rows of posts from a row of the image to the next; negative if they run the other way.
     */
    double rows_per_line;
    /**
     * Column of the posts at the image's first column.
     */
    double col0;
    /**
     * Columns of posts from a column of the image to the next.
     */
    double cols_per_px;
} eld_posts_t;

/**
 * The light of a scene, decided by `eld_light_decide`. Tiles of one scene, and a strip, have one light: with a light of its own for each, heights
 * would have steps at the seams. It holds for the models of one `ELD_LIGHT_*`.
 */
typedef struct {
    /**
     * sizeof(eld_lighting_t), set by the caller.
     */
    uint32_t struct_bytes;
    /**
     * Where the light comes from: one of `ELD_SOURCE_*`.
     */
    uint32_t source;
    /**
     * Change of relative brightness per slope of the ground, which rises towards increasing columns.
     */
    float east;
    /**
     * The same for ground that rises towards increasing rows.
     */
    float south;
    /**
     * Share of the relief found under this light that is kept, 0 to 1.
     */
    float trust;
    /**
     * Probability that the image shows the ground of the coarse DTM under this light, 0 to 1.
     */
    float related;
    /**
     * Share of the contrast of long waves that is relief, 0 to 1; NaN if unknown.
     */
    float long_share;
    /**
     * Standard deviation of the logarithm of the light's strength.
     */
    float log_strength_sd;
    /**
     * Standard deviation of the light's azimuth, degrees, 0 to 180.
     */
    float azimuth_sd_deg;
} eld_lighting_t;

/**
 * A tile in physical units. Maps are row-major, tile_rows x tile_cols samples, first row first; they are read until the tile is begun.
 * Samples that are not real (NaN, or 1e30 or more from zero, as PDS3 and ISIS specials are) are voids.
 */
typedef struct {
    /**
     * sizeof(eld_tile_t), set by the caller.
     */
    uint32_t struct_bytes;
    /**
     * Ground size of a pixel, metres.
     */
    float pixel_m;
    /**
     * Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
     */
    float coarse_px;
    /**
     * Azimuth of the Sun, degrees clockwise from the direction of decreasing rows; NaN if unknown.
     */
    float sun_azimuth_deg;
    /**
     * Elevation of the Sun above the horizon, degrees, above 0 and below 90; NaN if unknown.
     */
    float sun_elevation_deg;
    /**
     * 0: heights as the ground's `elunar predict` writes them. 1: the network decides about long and short waves, too (the paper).
     */
    uint32_t network_alone;
    /**
     * 1: sums of the network's products are found in a second way, and heights are made twice, because the processor may err. 0: neither.
     */
    uint32_t processor_checks;
    /**
     * Relative brightness.
     */
    eld_pixels_t image;
    /**
     * Coarse DTM on the image's grid, metres above the 1737.4 km sphere; NULL with `posts`.
     */
    const float *coarse_m;
    /**
     * Number of samples of the coarse DTM; 0 with `posts`.
     */
    size_t coarse_len;
    /**
     * Mask: 1 or 0 per pixel; NULL: every real pixel is valid.
     */
    const uint8_t *valid;
    /**
     * Bytes of the mask; 0 with NULL.
     */
    size_t valid_len;
    /**
     * Coarse DTM on its own grid; NULL with `coarse_m`.
     */
    const eld_posts_t *posts;
    /**
     * The light of the tile's scene, in place of the Sun's angles; NULL: the tile's own.
     */
    const eld_lighting_t *light;
} eld_tile_t;

/**
 * The errors that the heights and slopes of a tile are expected to have: standard deviations, without the error of the coarse DTM itself.
 */
typedef struct {
    /**
     * sizeof(eld_errors_t), set by the caller.
     */
    uint32_t struct_bytes;
    /**
     * Of heights, metres.
     */
    float height_m;
    /**
     * Of slopes along either axis, metres per metre.
     */
    float slope;
    /**
     * Share of the relief between the coarse DTM's pixels that the image explains, 0 to 1.
     */
    float explained;
    /**
     * Of heights of dark pixels, metres.
     */
    float dark_height_m;
    /**
     * Of slopes of dark pixels along either axis, metres per metre.
     */
    float dark_slope;
    /**
     * A pixel is dark if its brightness (`gain * code + offset`) is below this.
     */
    float dark_below;
} eld_errors_t;

/**
 * Counters of a context since `eld_init`. They do not wrap within the time of a mission.
 */
typedef struct {
    /**
     * sizeof(eld_telemetry_t), set by the caller.
     */
    uint32_t struct_bytes;
    /**
     * One of `ELD_PHASE_*`.
     */
    uint32_t phase;
    /**
     * Current entry of the schedule; 0 unless a tile is in progress.
     */
    uint32_t entry;
    /**
     * Number of pixels of the tile with valid heights.
     */
    uint32_t valid_px;
    /**
     * Latest fault; 0 if there was none.
     */
    eld_status_t last_fault;
    /**
     * CRC32C of the model's header.
     */
    uint32_t header_crc;
    /**
     * Calls with this context.
     */
    uint64_t calls;
    /**
     * Calls that ended with a fault.
     */
    uint64_t faults;
    /**
     * Damaged copies of the context that were repaired.
     */
    uint64_t context_repairs;
    /**
     * Tiles begun with an assumed light.
     */
    uint64_t lights_assumed;
    /**
     * Tiles dropped before they were finished, or lost.
     */
    uint64_t tiles_dropped;
    /**
     * Tiles finished, self tests included.
     */
    uint64_t tiles;
    /**
     * Steps.
     */
    uint64_t steps;
    /**
     * Multiply-accumulates.
     */
    uint64_t macs;
    /**
     * Input samples outside the range that the model was calibrated for.
     */
    uint64_t inputs_clamped;
    /**
     * Intermediate results cut to their tensor's range.
     */
    uint64_t saturated;
    /**
     * Bytes of the model compared with their checksums.
     */
    uint64_t scrubbed_bytes;
    /**
     * Complete passes over the model.
     */
    uint64_t scrub_passes;
    /**
     * Chunks of the model found to have changed.
     */
    uint64_t scrub_faults;
    /**
     * Self tests that failed.
     */
    uint64_t self_test_faults;
    /**
     * Tiles that were given up because the model or a map had changed in memory.
     */
    uint64_t tile_faults;
} eld_telemetry_t;

/**
 * The storage: two slots of equal length, and two regions for the record. Regions share no sector.
 */
typedef struct {
    /**
     * sizeof(eld_slots_storage_t), set by the caller.
     */
    uint32_t struct_bytes;
    /**
     * Bytes of a slot that are erased at once, at least 1. 1: memory without erasing.
     */
    uint32_t slot_sector_bytes;
    /**
     * Bytes of a region of the record, at least 64.
     */
    uint32_t record_bytes;
    /**
     * Bytes of it that are erased at once, at least 1.
     */
    uint32_t record_sector_bytes;
    /**
     * Bytes of a slot: the longest model that is ever to be loaded; whole sectors.
     */
    uint64_t slot_bytes;
} eld_slots_storage_t;

/**
 * What the caller shall do before the next call of `eld_slots_step`.
 */
typedef struct {
    /**
     * sizeof(eld_slots_want_t), set by the caller.
     */
    uint32_t struct_bytes;
    /**
     * One of `ELD_SLOTS_*`.
     */
    uint32_t what;
    /**
     * One of `ELD_REGION_*`.
     */
    uint32_t region;
    /**
     * 0.
     */
    uint32_t reserved;
    /**
     * First byte in the region.
     */
    uint64_t offset_bytes;
    /**
     * Number of bytes.
     */
    uint64_t bytes;
    /**
     * The bytes to be written; else NULL.
     */
    const void *data;
} eld_slots_want_t;

/**
 * What is known of the slots.
 */
typedef struct {
    /**
     * sizeof(eld_slots_state_t), set by the caller.
     */
    uint32_t struct_bytes;
    /**
     * Standing of the model that runs: one of `ELD_STANDING_*`.
     */
    uint32_t standing;
    /**
     * Its slot: `ELD_REGION_SLOT_A` or `ELD_REGION_SLOT_B`.
     */
    uint32_t slot;
    /**
     * Its length, bytes.
     */
    uint32_t file_bytes;
    /**
     * Checksum of its header.
     */
    uint32_t header_crc;
    /**
     * Boots that a trial has left; 0 without one.
     */
    uint32_t boots_left;
    /**
     * Trials that ended without confirmation.
     */
    uint32_t rollbacks;
    /**
     * Copies of the record that are intact and equal, when it was used last: 2, unless the storage is worn or damaged.
     */
    uint32_t record_copies;
    /**
     * 1 while an upload is begun.
     */
    uint32_t uploading;
    /**
     * Latest fault; 0 if there was none.
     */
    eld_status_t last_fault;
    /**
     * Bytes of the upload that are written: the next chunk's offset.
     */
    uint64_t uploaded_bytes;
    /**
     * Calls since `eld_slots_init`.
     */
    uint64_t calls;
    /**
     * Calls that ended with a fault.
     */
    uint64_t faults;
    /**
     * Damaged copies of the state that were repaired.
     */
    uint64_t context_repairs;
    /**
     * After a boot, the finished check of the model that runs, for `eld_init_checked`; zero if another model was read since.
     */
    eld_check_t check;
} eld_slots_state_t;

/**
 * Settings of a strip, known before its first line.
 */
typedef struct {
    /**
     * sizeof(eld_strip_settings_t), set by the caller.
     */
    uint32_t struct_bytes;
    /**
     * Pixels of a line. A line shorter than a tile is continued by its last pixel.
     */
    uint32_t cols;
    /**
     * Number of lines kept, at least the rows of a tile plus one; 0 for that number.
     */
    uint32_t ring_lines;
    /**
     * Overlap of neighbouring tiles, pixels; less than either side of a tile. The ground's `elunar predict` takes 100.
     */
    uint32_t overlap_px;
    /**
     * Ground size of a pixel, metres.
     */
    float pixel_m;
    /**
     * Side of a pixel of the coarse DTM on its own grid, in pixels of the image.
     */
    float coarse_px;
    /**
     * Azimuth of the Sun, degrees clockwise from the direction of decreasing lines; NaN if unknown.
     */
    float sun_azimuth_deg;
    /**
     * Elevation of the Sun above the horizon, degrees; NaN if unknown.
     */
    float sun_elevation_deg;
    /**
     * 0: heights as the ground's `elunar predict` writes them. 1: the network decides about long and short waves, too (the paper).
     */
    uint32_t network_alone;
    /**
     * 1 if `eld_strip_take` shall give expected errors, else 0. Finished lines then keep their place until they are taken.
     */
    uint32_t expected_errors;
    /**
     * Number of posts in a row of the coarse DTM; 0 if coarse heights come with every line, on the image's pixels.
     */
    uint32_t post_cols;
    /**
     * 1: sums of the network's products are found in a second way, and heights are made twice, because the processor may err. 0: neither.
     */
    uint32_t processor_checks;
    /**
     * Row of the posts at the centre of the strip's first line. (0, 0) is the centre of the first post.
     */
    double post_row0;
    /**
     * Rows of posts per line; above 0.
     */
    double post_rows_per_line;
    /**
     * Column of the posts at the centre of the strip's first column.
     */
    double post_col0;
    /**
     * Columns of posts per pixel.
     */
    double post_cols_per_px;
    /**
     * The pixels of a line: format, flags, gain, offset and codes. `data`, `data_bytes` and `row_bytes` are not used.
     */
    eld_pixels_t pixels;
    /**
     * The light of the strip, as `eld_light_decide` gives it; NULL: decided from the stated angles of the Sun alone.
     */
    const eld_lighting_t *light;
    /**
     * The finished check of the model (`eld_model_check_step`); NULL: the model is validated at once.
     */
    const eld_check_t *check;
} eld_strip_settings_t;

/**
 * Counters of a strip since `eld_strip_init`. They do not wrap within the time of a mission.
 */
typedef struct {
    /**
     * sizeof(eld_strip_telemetry_t), set by the caller.
     */
    uint32_t struct_bytes;
    /**
     * Latest fault; 0 if there was none.
     */
    eld_status_t last_fault;
    /**
     * Lines that `eld_strip_take` can return now.
     */
    uint64_t ready;
    /**
     * Calls with this strip.
     */
    uint64_t calls;
    /**
     * Calls that ended with a fault.
     */
    uint64_t faults;
    /**
     * Damaged copies of the strip's state that were repaired.
     */
    uint64_t context_repairs;
    /**
     * Tiles done, with those below.
     */
    uint64_t tiles;
    /**
     * Tiles without image contrast or coarse relief, which keep the coarse heights.
     */
    uint64_t tiles_coarse;
    /**
     * Tiles without a valid pixel.
     */
    uint64_t tiles_empty;
    /**
     * Tiles that began again after a fault.
     */
    uint64_t tiles_again;
    /**
     * Tiles given up after a second fault, which keep the coarse heights.
     */
    uint64_t tiles_lost;
    /**
     * Tiles given up after a third fault, which have no heights.
     */
    uint64_t tiles_void;
    /**
     * Times that the memory of a tile was found to have changed between two steps.
     */
    uint64_t memory_faults;
    /**
     * Pieces of kept lines, means or expected errors that were found to have changed. Their pixels are voids.
     */
    uint64_t pieces_lost;
    /**
     * Steps of the network.
     */
    uint64_t steps;
    /**
     * Multiply-accumulates.
     */
    uint64_t macs;
    /**
     * Input samples outside the range that the model was calibrated for.
     */
    uint64_t inputs_clamped;
    /**
     * Intermediate results cut to their tensor's range.
     */
    uint64_t saturated;
    /**
     * Bytes of the model compared with their checksums.
     */
    uint64_t scrubbed_bytes;
    /**
     * Complete passes over the model.
     */
    uint64_t scrub_passes;
    /**
     * Chunks of the model found to have changed.
     */
    uint64_t scrub_faults;
    /**
     * Tiles that were given up because the model or a map had changed in memory.
     */
    uint64_t tile_faults;
} eld_strip_telemetry_t;

/**
 * Where the Sun stands at a place.
 */
typedef struct {
    /**
     * sizeof(eld_sun_t), set by the caller.
     */
    uint32_t struct_bytes;
    /**
     * Azimuth, degrees clockwise from north, 0 to 360.
     */
    float azimuth_deg;
    /**
     * Elevation of the Sun's centre above the horizon of the sphere, degrees.
     */
    float elevation_deg;
    /**
     * Latitude of the point under the Sun, degrees north.
     */
    float sub_solar_lat_deg;
    /**
     * Longitude of that point, degrees east, -180 to 180.
     */
    float sub_solar_lon_deg;
    /**
     * Distance of the Moon from the Sun, astronomical units.
     */
    float distance_au;
} eld_sun_t;

/**
 * What terrain maps are made of a grid.
 */
typedef struct {
    /**
     * sizeof(eld_terrain_options_t), set by the caller.
     */
    uint32_t struct_bytes;
    /**
     * Samples of a line, at least 1.
     */
    uint32_t cols;
    /**
     * Radius r of a vehicle's footprint, pixels, 1 to 16: a square of 2r + 1 pixels a side.
     */
    uint32_t radius_px;
    /**
     * Ground size of a pixel from one line to the next, metres.
     */
    float row_m;
    /**
     * Ground size of a pixel along a line, metres.
     */
    float col_m;
    /**
     * Largest safe slope of the footprint's plane, degrees, above 0 and at most 90.
     */
    float slope_deg;
    /**
     * Largest safe distance of a pixel of the footprint from that plane, metres, above 0.
     */
    float roughness_m;
    /**
     * Number of standard deviations of the slope's error for `ELD_HAZARD_MAYBE_TOO_STEEP`; 0: errors do not count.
     */
    float sigmas;
    /**
     * Azimuth of the light of the hillshade, degrees clockwise from the direction of decreasing rows.
     */
    float sun_azimuth_deg;
    /**
     * Its elevation, degrees.
     */
    float sun_elevation_deg;
} eld_terrain_options_t;

/**
 * The maps of a line: `cols` samples each, or NULL: not wanted.
 */
typedef struct {
    /**
     * sizeof(eld_terrain_maps_t), set by the caller.
     */
    uint32_t struct_bytes;
    /**
     * Horn's slope of the pixel, degrees; NaN at edges and beside voids.
     */
    float *slope_deg;
    /**
     * Shaded relief, 1 to 255; 0 at edges and beside voids.
     */
    uint8_t *hillshade;
    /**
     * Slope of the plane under the footprint, degrees; NaN where the footprint leaves the grid or has a void.
     */
    float *footprint_slope_deg;
    /**
     * Largest distance of a pixel of the footprint from that plane, metres; NaN as above.
     */
    float *roughness_m;
    /**
     * Sum of `ELD_HAZARD_*`; 0 is safe.
     */
    uint8_t *hazard;
} eld_terrain_maps_t;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Returns the version of this library's interface, major << 16 | minor << 8 | patch. If its major number differs from that of the header's
 * `ELD_VERSION`, call no other function.
 */
uint32_t eld_version(void);

/**
 * Returns the version of the model files that this library reads.
 */
uint32_t eld_format_version(void);

/**
 * Returns the meaning of a status in one line of ASCII; never NULL, and never to be freed.
 */
const char *eld_status_text(eld_status_t status);

/**
 * Writes the name of the kernel for this processor, ended by NUL, into `name` of `name_bytes` bytes; 64 are enough.
 */
eld_status_t eld_kernel_name(char *name, size_t name_bytes);

/**
 * Writes the checksum of a part of the program, for example a page, into `*sum`. Note it when the program is good, and compare it before or after a
 * tile: a flipped bit of an instruction stays, and makes every tile wrong. About one instruction for every four bytes.
 */
eld_status_t eld_code_sum(const void *code,
                          size_t code_bytes,
                          uint32_t *sum);

/**
 * Validates every byte of a model file and writes its properties and requirements. `info->struct_bytes` must be set.
 */
eld_status_t eld_model_check(const void *model, size_t model_bytes, eld_model_info_t *info);

/**
 * Validates as `eld_model_check` does, a piece of about `budget_macs` multiply-accumulates at a time. `*check` is zero at the first call.
 * `ELD_RUNNING`: call again with the same arguments and an unchanged model. `ELD_OK`: `*info` is written, and `*check` serves `eld_init_checked`
 * and strips as long as the model is unchanged. After every other status but a refused pointer, `*check` is zero.
 */
eld_status_t eld_model_check_step(const void *model,
                                  size_t model_bytes,
                                  uint64_t budget_macs,
                                  eld_check_t *check,
                                  eld_model_info_t *info);

/**
 * Validates a model as `eld_model_check` does and makes a context for it at the start of `memory`. Memory and model are lent as long as
 * the context is used; the model is read in place. Writes the context to `*context`. If refused, writes NULL (nothing if `context` itself
 * lies in the memory or the model), and `memory` is unchanged.
 */
eld_status_t eld_init(void *memory,
                      size_t memory_bytes,
                      const void *model,
                      size_t model_bytes,
                      eld_context_t **context);

/**
 * As `eld_init`, without a second validation: `check` is finished (`eld_model_check_step`).
 */
eld_status_t eld_init_checked(void *memory,
                              size_t memory_bytes,
                              const void *model,
                              size_t model_bytes,
                              const eld_check_t *check,
                              eld_context_t **context);

/**
 * Begins a tile: validates, fills and normalises it, finds its light, and prepares for the first step. `tile->struct_bytes` must be set. The
 * maps are not needed after this call, which does all of the work at once; `eld_begin_step` does it in pieces. A tile in progress is dropped,
 * with a notice; if the new tile is refused, it continues.
 */
eld_status_t eld_begin(eld_context_t *context,
                       const eld_tile_t *tile);

/**
 * Begins a tile as `eld_begin` does, a piece of about `budget_macs` multiply-accumulates at a time. `ELD_RUNNING`: call again with the same
 * structure, and unchanged maps; any other structure begins another tile. If the maps have changed, call `eld_abort` first: a structure with
 * the same fields goes on. Every other status is that of `eld_begin`.
 */
eld_status_t eld_begin_step(eld_context_t *context,
                            const eld_tile_t *tile,
                            uint64_t budget_macs);

/**
 * Works until `budget_macs` multiply-accumulates are spent or the tile is done. It does at least one unit of work, and exceeds the budget
 * by less than one unit (`largest_unit_macs`). Other work, such as rounding and comparing, counts as well. It does not depend on the
 * data. `ELD_RUNNING`: call again; `ELD_OK`: the tile is done.
 */
eld_status_t eld_step(eld_context_t *context,
                      uint64_t budget_macs);

/**
 * Gives the tile or the self test up, whether it is prepared, in progress or finished. `ELD_NOTICE_DROPPED` if it was not finished.
 */
eld_status_t eld_abort(eld_context_t *context);

/**
 * Copies the finished tile: heights in metres above the 1737.4 km sphere, and for each height 1 if it is valid, 0 where image or coarse
 * DTM are void; heights there are filled. `valid` may be NULL with length 0. May be called again until the next tile begins.
 */
eld_status_t eld_output(eld_context_t *context,
                        float *heights_m,
                        size_t heights_len,
                        uint8_t *valid,
                        size_t valid_len);

/**
 * Copies the errors that the finished tile's heights and slopes are expected to have. `out->struct_bytes` must be set. Refused unless the
 * model's light is `ELD_LIGHT_WEIGHED` or `ELD_LIGHT_SLOPED`. Reads only the context.
 */
eld_status_t eld_errors(eld_context_t *context,
                        eld_errors_t *out);

/**
 * Writes the errors that the finished tile's heights and slopes are expected to have, standard deviations: of each height, metres, and of the
 * slope along either axis, metres per metre; and the origin of each height, one of `ELD_ORIGIN_*`. Errors are NaN where heights are not valid.
 * Each map has `len` samples, one per pixel, or is NULL. Refused as `eld_errors`.
 */
eld_status_t eld_error_maps(eld_context_t *context,
                            float *height_m,
                            float *slope,
                            uint8_t *origin,
                            size_t len);

/**
 * Compares up to `max_bytes` of the model with its checksums. Each call continues after the last one, and starts again at the end. It may
 * be called at any time between other calls. A fault means that a chunk has changed since it was loaded; the next call continues behind
 * it.
 */
eld_status_t eld_scrub(eld_context_t *context,
                       size_t max_bytes);

/**
 * Begins the built-in tile, which the first steps load. Call `eld_step` until done, then `eld_self_test_check`. A tile in progress is dropped, with a notice.
 */
eld_status_t eld_self_test_begin(eld_context_t *context);

/**
 * Compares the finished self test with the result stored in the model, byte for byte.
 */
eld_status_t eld_self_test_check(eld_context_t *context);

/**
 * Copies the counters. `out->struct_bytes` must be set. Reads only the context, so it works with a damaged model.
 */
eld_status_t eld_telemetry(eld_context_t *context, eld_telemetry_t *out);

/**
 * Adds what a tile shows of the light of its scene, a piece of about `budget_macs` multiply-accumulates at a time. `ELD_RUNNING`: call again with
 * the same structure, and unchanged maps. The angles of the Sun and `light` do not matter here. A tile in progress is dropped, with a notice.
 */
eld_status_t eld_light_add(eld_context_t *context,
                           const eld_tile_t *tile,
                           uint64_t budget_macs);

/**
 * Decides the light of the scene whose tiles were added: stated angles of the Sun are kept (degrees as in `eld_tile_t`, NaN if unknown), the rest is
 * fitted to all of them. `out->struct_bytes` must be set. The light is for the tiles of the scene (`eld_tile_t.light`).
 */
eld_status_t eld_light_decide(eld_context_t *context,
                              float sun_azimuth_deg,
                              float sun_elevation_deg,
                              eld_lighting_t *out);

/**
 * Forgets what was added by `eld_light_add`, before another scene.
 */
eld_status_t eld_light_clear(eld_context_t *context);

/**
 * Makes the work on slots at the start of `memory` of `ELD_SLOTS_BYTES`, which is lent as long as it is used. Reads nothing of the storage. Writes
 * it to `*slots`, NULL if refused. `eld_slots_boot` follows.
 */
eld_status_t eld_slots_init(void *memory,
                            size_t memory_bytes,
                            const eld_slots_storage_t *storage,
                            eld_slots_t **slots);

/**
 * Begins to find out which model to run: after every reset, and at any time to give up what is at work. Call `eld_slots_step` while it returns
 * `ELD_RUNNING`; then `ELD_OK`: the confirmed model runs; `ELD_NOTICE_SLOTS_TRIAL`, `ELD_NOTICE_SLOTS_SALVAGED`: run its self test, then call
 * `eld_slots_confirm` or `eld_slots_reject`. An upload must be begun again.
 */
eld_status_t eld_slots_boot(eld_slots_t *slots);

/**
 * Does a piece of the work of about `budget_macs` multiply-accumulates, and says in `*want` what the caller shall do before the next call:
 * nothing of the storage is touched here. `data` has the bytes that were wanted, else NULL and 0. `storage_error` is 0, or the driver's number if
 * it could not read, erase or write. `ELD_RUNNING`: do it and call again. `want->struct_bytes` must be set.
 */
eld_status_t eld_slots_step(eld_slots_t *slots,
                            const void *data,
                            size_t data_bytes,
                            uint32_t storage_error,
                            uint64_t budget_macs,
                            eld_slots_want_t *want);

/**
 * Begins to record the model that runs as confirmed. `context` is one of that model whose self test is finished: it is compared here
 * (`eld_self_test_check`). `ELD_RUNNING`: call `eld_slots_step`.
 */
eld_status_t eld_slots_confirm(eld_slots_t *slots,
                               eld_context_t *context);

/**
 * Begins to end the trial of the model that runs, after its self test has failed, and to find out which model to run instead; the end is that of
 * `eld_slots_boot`. While the confirmed model runs, a trial that has not begun is withdrawn.
 */
eld_status_t eld_slots_reject(eld_slots_t *slots);

/**
 * Begins the upload of a model into the free slot, or goes on with it after a reset: length of the file and the last word of its header, as a
 * number. At the end `uploaded_bytes` of `eld_slots_state` says which chunk comes next.
 */
eld_status_t eld_slots_upload(eld_slots_t *slots,
                              uint32_t file_bytes,
                              uint32_t header_crc);

/**
 * Begins to write the next chunk of the file. The bytes stay where they are, unchanged, until `eld_slots_step` does not return `ELD_RUNNING`.
 */
eld_status_t eld_slots_write(eld_slots_t *slots,
                             uint64_t offset_bytes,
                             const void *chunk,
                             size_t chunk_bytes);

/**
 * Begins to validate the upload and to put it on trial: the next 1 to 16 `boots` run it, unless it is confirmed or rejected before.
 */
eld_status_t eld_slots_start_trial(eld_slots_t *slots,
                                   uint32_t boots);

/**
 * Copies what is known of the slots. `out->struct_bytes` must be set.
 */
eld_status_t eld_slots_state(eld_slots_t *slots, eld_slots_state_t *out);

/**
 * Validates a model, unless the settings have its check, and the settings of a strip; writes the number of bytes of memory for
 * `eld_strip_init`, which needs alignment as `eld_init`. `settings->struct_bytes` must be set.
 */
eld_status_t eld_strip_plan(const void *model,
                            size_t model_bytes,
                            const eld_strip_settings_t *settings,
                            uint64_t *memory_bytes);

/**
 * Validates as `eld_strip_plan` does and makes a strip at the start of `memory`. Memory and model are lent as long as the strip is used; the
 * model is read in place. Writes the strip to `*strip`; NULL if refused, and `memory` is unchanged. Lines may be pushed then.
 */
eld_status_t eld_strip_init(void *memory,
                            size_t memory_bytes,
                            const void *model,
                            size_t model_bytes,
                            const eld_strip_settings_t *settings,
                            eld_strip_t **strip);

/**
 * Takes the next line: its pixels as the camera has them, in the form of the settings, and the coarse DTM on the same pixels, metres above
 * the 1737.4 km sphere; with posts NULL and 0. The buffers are not needed after the call.
 */
eld_status_t eld_strip_push(eld_strip_t *strip,
                            const void *line,
                            size_t line_bytes,
                            const float *coarse_m,
                            size_t coarse_len);

/**
 * Takes the next row of the coarse DTM's posts, metres above the 1737.4 km sphere.
 */
eld_status_t eld_strip_push_posts(eld_strip_t *strip, const float *posts_m, size_t posts_len);

/**
 * Ends the rows of posts: lines up to the outer edge of the last row are continued from it, lines beyond are voids.
 */
eld_status_t eld_strip_finish_posts(eld_strip_t *strip);

/**
 * Ends the strip with the last line taken in.
 */
eld_status_t eld_strip_finish(eld_strip_t *strip);

/**
 * Works until `budget_macs` multiply-accumulates are spent, or a tile is done; nothing if a line must be pushed or taken first. Returns what
 * the strip needs next: `ELD_RUNNING` this function, `ELD_NOTICE_STRIP_*` another.
 */
eld_status_t eld_strip_step(eld_strip_t *strip,
                            uint64_t budget_macs);

/**
 * Copies the next finished line: heights in metres above the 1737.4 km sphere, NaN in voids, and its number. `ELD_NOTICE_STRIP_NO_LINE`: none
 * is finished, and nothing is written. With expected errors in the settings: standard deviations of heights, metres, and slopes, metres per
 * metre, and the origin of each height: 0 the image, 1 image and coarse DTM, 2 the coarse DTM, 3 a shadow, 4 a void. Each buffer has
 * `heights_len` values. They may be NULL, all or none.
 */
eld_status_t eld_strip_take(eld_strip_t *strip,
                            float *heights_m,
                            float *height_errors_m,
                            float *slope_errors,
                            uint8_t *origins,
                            size_t heights_len,
                            uint64_t *line);

/**
 * Compares up to `max_bytes` of the model with its checksums, as `eld_scrub`. A model that was loaded again at its place serves the strip on.
 */
eld_status_t eld_strip_scrub(eld_strip_t *strip,
                             size_t max_bytes);

/**
 * Copies the counters. `out->struct_bytes` must be set.
 */
eld_status_t eld_strip_telemetry(eld_strip_t *strip, eld_strip_telemetry_t *out);

/**
 * Writes where the Sun stands at a place of the Moon, within 0.02 degrees from 1960 to 2060. `utc_days`: days of 86,400 s since 2000-01-01T12:00:00
 * UTC, the years 1900 to 2100 (seconds of Unix less 946728000, over 86400). Degrees north, and east from -360 to 360, in the mean-Earth system.
 * `out->struct_bytes` must be set. Needs no context. `eld_tile_t` counts azimuths from the direction of decreasing rows, which is north only on a
 * map whose up is north there.
 */
eld_status_t eld_sun_position(double utc_days,
                              double lat_deg,
                              double lon_deg,
                              eld_sun_t *out);

/**
 * Writes how much memory terrain maps with these options need. `options->struct_bytes` must be set.
 */
eld_status_t eld_terrain_plan(const eld_terrain_options_t *options, uint64_t *memory_bytes);

/**
 * Makes terrain maps at the start of `memory`, which is lent as long as they are used, and zeroes it. Writes them to `*terrain`, NULL if refused.
 */
eld_status_t eld_terrain_init(void *memory,
                              size_t memory_bytes,
                              const eld_terrain_options_t *options,
                              eld_terrain_t **terrain);

/**
 * Takes the next line of the grid: `len` heights, metres, NaN for voids; and, if the options ask for standard deviations, those of the errors of its
 * slopes (as `eld_error_maps` writes them), or NULL if unknown. If the maps of a line are complete, they are written, and its number, counted from 0,
 * to `*row`; otherwise `ELD_NOTICE_NO_LINE`. A line comes out `radius_px` lines after it was pushed.
 */
eld_status_t eld_terrain_push(eld_terrain_t *terrain,
                              const float *line_m,
                              const float *slope_sd,
                              size_t len,
                              const eld_terrain_maps_t *maps,
                              uint64_t *row);

/**
 * Writes the maps of the next line after the last push, and its number to `*row`; `ELD_NOTICE_NO_LINE` when all are out. Then the next grid may
 * begin.
 */
eld_status_t eld_terrain_finish(eld_terrain_t *terrain,
                                const eld_terrain_maps_t *maps,
                                uint64_t *row);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* ELUNAR_H */
