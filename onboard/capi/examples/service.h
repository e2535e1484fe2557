/* A terrain service on top of elunar.h: one context, one tile at a time, and a response to every status. C99, no heap.
 *
 * The executive calls service_cycle at its own rate; every call does one bounded piece of work. All guides share this file: the
 * super-loop, the FreeRTOS task, the RTEMS task and the cFS application differ only in the caller and its timing. */
#ifndef ELUNAR_SERVICE_H
#define ELUNAR_SERVICE_H

#include "elunar.h"

/* Largest number of attempts for a tile or a self test that ends with a fault. Then it is given up. */
#define SERVICE_ATTEMPTS 3u

/* The caller's action after a status; the columns of onboard/README.md as code. */
typedef enum {
    SERVICE_GO_ON,       /* no action */
    SERVICE_SKIP,        /* the call was wrong, or the tile is not usable: correct it or take the next one */
    SERVICE_BEGIN_AGAIN, /* the tile is lost, model and context are intact */
    SERVICE_RELOAD,      /* the model has changed: load it again, at the same address */
    SERVICE_START_AGAIN, /* the context is lost: call eld_init again */
    SERVICE_DISTRUST     /* the self test failed: as SERVICE_RELOAD; if it fails again, do not use the heights */
} service_action_t;

typedef enum {
    SERVICE_DOWN,        /* no context: call service_start */
    SERVICE_WANTS_MODEL, /* the model has changed in memory: load it again, then call service_model_reloaded */
    SERVICE_SELF_TEST,   /* the self test is in progress */
    SERVICE_IDLE,        /* ready for a tile; cycles scrub the model */
    SERVICE_TILE,        /* a tile is prepared or in progress */
    SERVICE_READY,       /* a tile is done: call service_take */
    SERVICE_FAILED,      /* the self test failed twice, the second time with the model loaded again: do not use the heights */
    SERVICE_CHECK        /* the model is being validated, a piece a cycle; then the self test begins */
} service_state_t;

/* A service. All bytes must be zero before its first start, as in a static variable. Callers only read the fields. */
typedef struct {
    void *memory; /* aligned to 8 bytes, length from eld_model_check; static, for this service only */
    size_t memory_bytes;
    const void *model; /* in flash or RAM; must stay at this address as long as the service is used */
    size_t model_bytes;
    size_t max_px;       /* pixels of the largest tile that the caller has room for */
    eld_check_t check;   /* how far the model is validated */
    eld_context_t *context;
    eld_model_info_t info;
    eld_tile_t tile; /* its maps must stay valid until the tile is ready or dropped, because it may begin again */
    service_state_t state;
    unsigned attempts;   /* attempts for the current tile or self test */
    int has_tile;        /* a tile is waiting or in progress */
    int begun;           /* the tile is prepared: eld_step follows eld_begin_step */
    int doubted;         /* the self test has failed once */
    eld_status_t status; /* the latest status */
    uint32_t drops;      /* tiles dropped: refused, or given up after SERVICE_ATTEMPTS faults */
} service_t;

/* Begins to validate the model: at boot, and after SERVICE_DOWN. Only the smallest piece is done: ELD_RUNNING. Cycles do the rest, make the
 * context and begin the self test; if they cannot, the state is SERVICE_DOWN. A tile in progress begins again. */
eld_status_t service_start(service_t *service, void *memory, size_t memory_bytes, const void *model, size_t model_bytes, size_t max_px);

/* Describes an image of floats. */
eld_pixels_t service_floats(const void *map, size_t bytes);

/* Takes a tile; refused (ELD_REFUSED_NOT_DONE) except in SERVICE_IDLE. Its maps must stay valid and unchanged until SERVICE_READY or
 * SERVICE_IDLE. Only the smallest piece of its preparation is done: ELD_RUNNING. Cycles do the rest. */
eld_status_t service_give(service_t *service, const eld_tile_t *tile);

/* Does one bounded piece of work: budget_macs of the model's validation, or of preparation or a step while a tile or self test is in
 * progress, else scrub_bytes of scrubbing. */
eld_status_t service_cycle(service_t *service, uint64_t budget_macs, size_t scrub_bytes);

/* Compares up to max_bytes of the model with its checksums; refused (ELD_REFUSED_NOT_DONE) without a context or a model. */
eld_status_t service_scrub(service_t *service, size_t max_bytes);

/* Begins the self test in SERVICE_IDLE; refused (ELD_REFUSED_NOT_DONE) in other states. */
eld_status_t service_self_test(service_t *service);

/* Copies the heights of a finished tile; then the state is SERVICE_IDLE. valid may be NULL. */
eld_status_t service_take(service_t *service, float *heights_m, uint8_t *valid);

/* To be called when the model is loaded again at its address, unchanged. Begins to validate it: ELD_RUNNING. Cycles do the rest and begin the
 * self test; if they cannot, the state is SERVICE_WANTS_MODEL again. */
eld_status_t service_model_reloaded(service_t *service);

/* Returns the action after a status. */
service_action_t service_action(eld_status_t status);

#endif
