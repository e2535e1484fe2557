/* See duty.h. Memory is static, so that the linker fixes its address and size. */
#include "duty.h"
#include "platform.h"

static uint64_t memory[(DUTY_MEMORY_BYTES + 7u) / 8u]; /* uint64_t: aligned to 8 bytes */
static float heights_m[DUTY_PX];
static uint8_t valid[DUTY_PX];
static service_t service;
static uint32_t drops_told;

static void tell(eld_status_t status) {
    if (status != ELD_OK && status != ELD_RUNNING) { platform_event(status, eld_status_text(status)); }
    if (service.drops != drops_told) { platform_dropped(status); }
    drops_told = service.drops;
}

int duty_start(void) {
    size_t model_bytes;
    const void *model = platform_model(&model_bytes);
    eld_status_t status;
    /* The linked library and the compiled header must have the same major version. */
    if (eld_version() >> 16 != (uint32_t)ELD_VERSION >> 16) { return 0; }
    status = service_start(&service, memory, sizeof memory, model, model_bytes, DUTY_PX);
    tell(status);
    return service.state != SERVICE_DOWN;
}

eld_status_t duty_cycle(void) {
    eld_status_t status = ELD_OK;
    eld_tile_t tile;
    switch (service.state) {
    case SERVICE_DOWN:
        /* Both copies of the context are damaged: tile and counters are lost, and the model is validated again. */
        (void)duty_start();
        return service.status;
    case SERVICE_WANTS_MODEL:
        if (platform_reload_model() != 0) { status = service_model_reloaded(&service); }
        break;
    case SERVICE_READY:
        status = service_take(&service, heights_m, valid);
        if (ELD_WORKED(status)) { platform_heights(heights_m, valid, (size_t)service.info.tile_rows * service.info.tile_cols); }
        break;
    case SERVICE_IDLE:
        if (platform_next_tile(&tile) != 0) {
            tile.struct_bytes = sizeof tile;
            status = service_give(&service, &tile);
            break;
        }
        status = service_cycle(&service, DUTY_BUDGET_MACS, DUTY_SCRUB_BYTES);
        break;
    default:
        status = service_cycle(&service, DUTY_BUDGET_MACS, DUTY_SCRUB_BYTES);
        break;
    }
    tell(status);
    return status;
}

void duty_housekeeping(void) {
    eld_telemetry_t telemetry;
    telemetry.struct_bytes = sizeof telemetry;
    if (service.context != NULL && ELD_WORKED(eld_telemetry(service.context, &telemetry))) { platform_housekeeping(&telemetry); }
}
