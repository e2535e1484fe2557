/* A terrain service over elunar.h: one context, one tile at a time, and what to do after every status. C99, no heap.
 *
 * The executive calls service_cycle in its own rhythm; every call does one bounded piece of work. All the guides share this file:
 * a super-loop, a FreeRTOS task, an RTEMS task, and the cFS application differ in who calls it, and when. */
#ifndef ELUNAR_SERVICE_H
#define ELUNAR_SERVICE_H

#include "elunar.h"

/* Times that a tile or a self test is begun in all, when faults end it, before it is given up. */
#define SERVICE_ATTEMPTS 3u

/* What the caller has to do after a status. The columns of onboard/README.md, as code. */
typedef enum {
    SERVICE_GO_ON,       /* nothing */
    SERVICE_SKIP,        /* the call was wrong, or the tile is of no use: mend it or take the next one */
    SERVICE_BEGIN_AGAIN, /* the tile is lost, model and context are sound */
    SERVICE_RELOAD,      /* the model has changed: load it again, at the same place */
    SERVICE_START_AGAIN, /* the context is lost: eld_init again */
    SERVICE_DISTRUST     /* the self test failed: as SERVICE_RELOAD; if it stays, do not use the heights */
} service_action_t;

typedef enum {
    SERVICE_DOWN,        /* no context: call service_start */
    SERVICE_WANTS_MODEL, /* the model has changed in memory: load it again, then call service_model_reloaded */
    SERVICE_SELF_TEST,   /* the self test is at work */
    SERVICE_IDLE,        /* ready for a tile; cycles scrub the model */
    SERVICE_TILE,        /* a tile is at work */
    SERVICE_READY,       /* a tile is done: call service_take */
    SERVICE_FAILED       /* the self test failed, and again with the model loaded anew: do not use the heights */
} service_state_t;

/* A service, all zero before its first start (a static one is). Fields are to be read; write none. */
typedef struct {
    void *memory; /* aligned to 8 bytes, as long as eld_model_check says; static, and nobody else's */
    size_t memory_bytes;
    const void *model; /* in flash or RAM; at this place as long as the service lives */
    size_t model_bytes;
    eld_context_t *context;
    eld_model_info_t info;
    eld_tile_t tile; /* its maps stay the caller's until the tile is ready or dropped: it may have to be begun again */
    service_state_t state;
    unsigned attempts;   /* of the tile or self test at work */
    int has_tile;        /* a tile waits or is at work */
    int doubted;         /* the self test has failed once */
    eld_status_t status; /* the latest */
    uint32_t drops;      /* tiles that came to nothing: refused, or given up after SERVICE_ATTEMPTS faults */
} service_t;

/* Validates the model, makes the context, and begins the self test: at boot, and after SERVICE_DOWN. A tile that was at work is begun again. */
eld_status_t service_start(service_t *service, void *memory, size_t memory_bytes, const void *model, size_t model_bytes);

/* Takes a tile; refused (ELD_REFUSED_NOT_DONE) but in SERVICE_IDLE. Its maps must stay until SERVICE_READY or SERVICE_IDLE. */
eld_status_t service_give(service_t *service, const eld_tile_t *tile);

/* One bounded piece of work: a step of budget_macs while something is at work, else scrub_bytes of scrubbing. */
eld_status_t service_cycle(service_t *service, uint64_t budget_macs, size_t scrub_bytes);

/* Looks over up to max_bytes of the model, a tile at work or not; refused (ELD_REFUSED_NOT_DONE) while there is no context or no model. */
eld_status_t service_scrub(service_t *service, size_t max_bytes);

/* Begins the self test, in SERVICE_IDLE; refused (ELD_REFUSED_NOT_DONE) else. */
eld_status_t service_self_test(service_t *service);

/* Hands out the heights of a tile that is ready; SERVICE_IDLE after it. valid may be NULL. */
eld_status_t service_take(service_t *service, float *heights_m, uint8_t *valid);

/* The model stands at its place again, as it was: validates it, and goes on. */
eld_status_t service_model_reloaded(service_t *service);

/* What to do after a status. */
service_action_t service_action(eld_status_t status);

#endif
