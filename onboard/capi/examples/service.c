/* See service.h. */
#include "service.h"

#include <stdbool.h>
#include <string.h>

service_action_t service_action(eld_status_t status) {
    switch (status) {
    case ELD_FAULT_MODEL_CHANGED:
        return SERVICE_RELOAD;
    case ELD_FAULT_SELF_TEST:
        return SERVICE_DISTRUST;
    case ELD_FAULT_CONTEXT_LOST:
    case ELD_FAULT_CONTEXT_MOVED:
        return SERVICE_START_AGAIN;
    default:
        if (ELD_WORKED(status)) { return SERVICE_GO_ON; }
        return ELD_SEVERITY(status) == ELD_REFUSED ? SERVICE_SKIP : SERVICE_BEGIN_AGAIN;
    }
}

/* Does a piece of the preparation of the tile. */
static eld_status_t prepare(service_t *service, uint64_t budget_macs) {
    eld_status_t status = eld_begin_step(service->context, &service->tile, budget_macs);
    service->begun = ELD_WORKED(status) && status != ELD_RUNNING;
    return status;
}

/* Begins the tile or the self test that the state names: of a tile the smallest piece, which refuses what is wrong with its structure. */
static eld_status_t begin(service_t *service) {
    service->attempts++;
    return service->state == SERVICE_SELF_TEST ? eld_self_test_begin(service->context) : prepare(service, 1);
}

static void settle(service_t *service) {
    service->state = service->has_tile ? SERVICE_TILE : SERVICE_IDLE;
    service->attempts = 0;
}

static void drop(service_t *service) {
    service->drops++;
    /* The next tile may be in the same buffers, with the same structure: it must not go on with what is prepared. */
    (void)eld_abort(service->context);
    service->has_tile = 0;
    settle(service);
}

/* Sets the state that a status requires, and begins again if that can help. The loop ends, because attempts are counted. */
static eld_status_t respond(service_t *service, eld_status_t first) {
    eld_status_t status = first;
    for (;;) {
        bool at_work = service->state == SERVICE_SELF_TEST || service->state == SERVICE_TILE;
        service->status = status;
        switch (service_action(status)) {
        case SERVICE_GO_ON:
            return status;
        case SERVICE_SKIP:
            /* The tile is refused permanently. */
            if (service->state == SERVICE_TILE || service->state == SERVICE_READY) { drop(service); }
            return status;
        case SERVICE_BEGIN_AGAIN:
            if (service->state == SERVICE_READY) {
                /* The heights were lost before they were taken. */
                service->state = SERVICE_TILE;
                at_work = true;
            }
            if (!at_work) { return status; }
            if (service->attempts >= SERVICE_ATTEMPTS) {
                if (service->state == SERVICE_SELF_TEST) { service->state = SERVICE_FAILED; }
                else { drop(service); }
                return status;
            }
            status = begin(service);
            break;
        case SERVICE_DISTRUST:
            service->state = service->doubted ? SERVICE_FAILED : SERVICE_WANTS_MODEL;
            service->doubted = 1;
            return status;
        case SERVICE_RELOAD:
            service->state = SERVICE_WANTS_MODEL;
            return status;
        case SERVICE_START_AGAIN:
        default:
            service->state = SERVICE_DOWN;
            return status;
        }
    }
}

/* Begins a tile or a self test for the first time, and responds to its status. */
static eld_status_t begin_first(service_t *service, service_state_t state) {
    service->state = state;
    service->attempts = 0;
    return respond(service, begin(service));
}

/* Makes the context of a validated model, or compares the model with the one that the context has. */
static eld_status_t accept(service_t *service, const eld_model_info_t *found) {
    if ((size_t)found->tile_rows * found->tile_cols > service->max_px) { return ELD_REFUSED_BUFFER; }
    if (service->context != NULL) {
        /* Another model needs another context, and possibly more memory. */
        return found->header_crc == service->info.header_crc ? ELD_OK : ELD_FAULT_MODEL_CHANGED;
    }
    service->info = *found;
    return eld_init_checked(service->memory, service->memory_bytes, service->model, service->model_bytes, &service->check,
                            &service->context);
}

/* Validates a piece of the model; behind the last one, begins the self test. */
static eld_status_t check(service_t *service, uint64_t budget_macs) {
    eld_model_info_t found;
    eld_status_t status;
    found.struct_bytes = sizeof found;
    status = eld_model_check_step(service->model, service->model_bytes, budget_macs, &service->check, &found);
    if (status == ELD_OK) { status = accept(service, &found); }
    service->status = status;
    if (status == ELD_RUNNING) { return status; }
    if (ELD_WORKED(status)) { return begin_first(service, SERVICE_SELF_TEST); }
    service->state = service->context == NULL ? SERVICE_DOWN : SERVICE_WANTS_MODEL;
    return status;
}

/* Begins to validate the model: the smallest piece, which refuses what is wrong with its header. Cycles do the rest. */
static eld_status_t begin_check(service_t *service) {
    (void)memset(&service->check, 0, sizeof service->check);
    service->state = SERVICE_CHECK;
    return check(service, 1);
}

eld_status_t service_start(service_t *service, void *memory, size_t memory_bytes, const void *model, size_t model_bytes, size_t max_px) {
    eld_tile_t tile = service->tile;
    int has_tile = service->has_tile;
    uint32_t drops = service->drops;
    (void)memset(service, 0, sizeof *service);
    service->tile = tile;
    service->has_tile = has_tile;
    service->drops = drops;
    service->memory = memory;
    service->memory_bytes = memory_bytes;
    service->model = model;
    service->model_bytes = model_bytes;
    service->max_px = max_px;
    return begin_check(service);
}

eld_pixels_t service_floats(const void *map, size_t bytes) {
    eld_pixels_t pixels;
    (void)memset(&pixels, 0, sizeof pixels);
    pixels.data = map;
    pixels.data_bytes = bytes;
    pixels.format = ELD_PIXELS_F32;
    pixels.gain = 1.0f;
    return pixels;
}

eld_status_t service_give(service_t *service, const eld_tile_t *tile) {
    if (service->state != SERVICE_IDLE) { return ELD_REFUSED_NOT_DONE; }
    service->tile = *tile;
    service->has_tile = 1;
    return begin_first(service, SERVICE_TILE);
}

eld_status_t service_self_test(service_t *service) {
    if (service->state != SERVICE_IDLE) { return ELD_REFUSED_NOT_DONE; }
    return begin_first(service, SERVICE_SELF_TEST);
}

eld_status_t service_scrub(service_t *service, size_t max_bytes) {
    if (service->state == SERVICE_DOWN || service->state == SERVICE_WANTS_MODEL || service->state == SERVICE_CHECK) {
        return ELD_REFUSED_NOT_DONE;
    }
    return respond(service, eld_scrub(service->context, max_bytes));
}

eld_status_t service_cycle(service_t *service, uint64_t budget_macs, size_t scrub_bytes) {
    eld_status_t status;
    switch (service->state) {
    case SERVICE_CHECK:
        return check(service, budget_macs);
    case SERVICE_SELF_TEST:
        status = eld_step(service->context, budget_macs);
        if (!ELD_WORKED(status) || status == ELD_RUNNING) { return respond(service, status); }
        status = eld_self_test_check(service->context);
        if (!ELD_WORKED(status)) { return respond(service, status); }
        service->doubted = 0;
        service->status = status;
        settle(service);
        return service->has_tile ? begin_first(service, SERVICE_TILE) : status;
    case SERVICE_TILE:
        if (!service->begun) { return respond(service, prepare(service, budget_macs)); }
        status = eld_step(service->context, budget_macs);
        if (ELD_WORKED(status) && status != ELD_RUNNING) { service->state = SERVICE_READY; }
        return respond(service, status);
    case SERVICE_IDLE:
    case SERVICE_READY:
        return service_scrub(service, scrub_bytes);
    default:
        return service->status;
    }
}

eld_status_t service_take(service_t *service, float *heights_m, uint8_t *valid) {
    size_t px = (size_t)service->info.tile_rows * service->info.tile_cols;
    eld_status_t status;
    if (service->state != SERVICE_READY) { return ELD_REFUSED_NOT_DONE; }
    status = eld_output(service->context, heights_m, px, valid, valid == NULL ? 0u : px);
    if (!ELD_WORKED(status)) { return respond(service, status); }
    service->has_tile = 0;
    settle(service);
    return status;
}

eld_status_t service_model_reloaded(service_t *service) {
    if (service->state != SERVICE_WANTS_MODEL) { return ELD_REFUSED_NOT_DONE; }
    return begin_check(service);
}
