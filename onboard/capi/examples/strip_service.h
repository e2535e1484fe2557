/* A strip on top of elunar.h, one bounded piece of work a cycle: lines and posts come from the caller's functions, heights go to one. C99, no
 * heap. */
#ifndef ELUNAR_STRIP_SERVICE_H
#define ELUNAR_STRIP_SERVICE_H

#include "elunar.h"

/* What the functions of the caller answer. */
#define STRIP_HERE 1    /* done */
#define STRIP_END 0     /* there is no further one */
#define STRIP_LATER 2   /* not there yet: the next cycle asks again */
#define STRIP_BROKEN 3  /* it cannot be had, or not be kept: the strip is given up */

/* Where lines come from and go to. */
typedef struct {
    /* Writes the next line of pixels, and with it a line of coarse heights if the strip has no posts (otherwise coarse_m is NULL). */
    int (*line)(void *caller, void *pixels, float *coarse_m);
    /* Writes the next row of posts; NULL if the strip has none. */
    int (*posts)(void *caller, float *posts_m);
    /* Takes a line of heights, NaN in voids. STRIP_HERE or STRIP_BROKEN. */
    int (*heights)(void *caller, uint64_t line, const float *heights_m);
    void *caller;
} strip_lines_t;

/* Memory of the caller, for this strip only. */
typedef struct {
    void *strip; /* aligned to 8 bytes, length from eld_strip_plan */
    size_t strip_bytes;
    const void *model; /* must stay at this address as long as the strip is made */
    size_t model_bytes;
    void *pixels; /* a line, in the format of the settings */
    size_t pixels_bytes;
    float *line_m; /* a line of heights, or a row of posts */
    size_t line_len;
} strip_memory_t;

typedef enum {
    STRIP_NONE,  /* no strip: call strip_begin */
    STRIP_CHECK, /* the model is being validated, a piece a cycle */
    STRIP_WORK,  /* the strip is being made */
    STRIP_DONE,  /* all lines of heights are given to the caller */
    STRIP_FAILED /* given up: status says why */
} strip_state_t;

typedef struct {
    strip_memory_t memory;
    strip_lines_t lines;
    eld_strip_settings_t settings;
    eld_check_t check;
    eld_strip_t *strip;
    strip_state_t state;
    eld_status_t status; /* the latest status */
    uint64_t lines_in;   /* lines of pixels */
    uint64_t lines_out;  /* lines of heights */
} strip_service_t;

/* Begins a strip in any state; check of the settings is set by the service. Only the smallest piece is done: ELD_RUNNING, or a refusal. */
eld_status_t strip_begin(strip_service_t *service, const strip_memory_t *memory, const strip_lines_t *lines,
                         const eld_strip_settings_t *settings);

/* Does one bounded piece of work, and gives or takes at most one line. */
eld_status_t strip_cycle(strip_service_t *service, uint64_t budget_macs);

#endif
