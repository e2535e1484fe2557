/* See strip_service.h. */
#include "strip_service.h"

#include <stdbool.h>
#include <string.h>

static eld_status_t give_up(strip_service_t *service, eld_status_t status) {
    service->state = STRIP_FAILED;
    service->status = status;
    return status;
}

/* Makes the strip of a validated model. */
static eld_status_t start(strip_service_t *service) {
    strip_memory_t *own = &service->memory;
    eld_status_t status;
    /* A line of heights, and a row of posts. */
    if (own->line_len < service->settings.cols || own->line_len < service->settings.post_cols) { return ELD_REFUSED_BUFFER; }
    service->settings.check = &service->check;
    status = eld_strip_init(own->strip, own->strip_bytes, own->model, own->model_bytes, &service->settings, &service->strip);
    service->settings.check = NULL;
    return status;
}

static eld_status_t validate(strip_service_t *service, uint64_t budget_macs) {
    const strip_memory_t *own = &service->memory;
    eld_model_info_t info;
    eld_status_t status;
    info.struct_bytes = sizeof info;
    status = eld_model_check_step(own->model, own->model_bytes, budget_macs, &service->check, &info);
    if (status == ELD_OK) {
        status = start(service);
        if (ELD_WORKED(status)) { service->state = STRIP_WORK; }
    }
    if (!ELD_WORKED(status)) { return give_up(service, status); }
    service->status = status;
    return status;
}

/* Pushes a line, or ends the strip. */
static eld_status_t push(strip_service_t *service) {
    const strip_memory_t *own = &service->memory;
    const bool with_posts = service->settings.post_cols > 0u;
    const size_t coarse_len = with_posts ? 0u : service->settings.cols;
    float *coarse_m = with_posts ? NULL : own->line_m;
    eld_status_t status;
    switch (service->lines.line(service->lines.caller, own->pixels, coarse_m)) {
    case STRIP_HERE:
        status = eld_strip_push(service->strip, own->pixels, own->pixels_bytes, coarse_m, coarse_len);
        if (ELD_WORKED(status)) { service->lines_in++; }
        return status;
    case STRIP_END:
        return eld_strip_finish(service->strip);
    case STRIP_LATER:
        return ELD_NOTICE_STRIP_PUSH;
    case STRIP_BROKEN:
    default:
        return ELD_REFUSED_BUFFER;
    }
}

/* Pushes a row of posts, or ends them. */
static eld_status_t push_posts(strip_service_t *service) {
    switch (service->lines.posts(service->lines.caller, service->memory.line_m)) {
    case STRIP_HERE:
        return eld_strip_push_posts(service->strip, service->memory.line_m, service->settings.post_cols);
    case STRIP_END:
        return eld_strip_finish_posts(service->strip);
    case STRIP_LATER:
        return ELD_NOTICE_STRIP_POSTS;
    case STRIP_BROKEN:
    default:
        return ELD_REFUSED_BUFFER;
    }
}

/* Gives a finished line to the caller. */
static eld_status_t take(strip_service_t *service) {
    uint64_t line = 0;
    eld_status_t status = eld_strip_take(service->strip, service->memory.line_m, NULL, NULL, NULL, service->settings.cols, &line);
    if (status != ELD_OK) { return status; }
    service->lines_out++;
    return service->lines.heights(service->lines.caller, line, service->memory.line_m) == STRIP_HERE ? status : ELD_REFUSED_BUFFER;
}

static eld_status_t work(strip_service_t *service, uint64_t budget_macs) {
    const eld_status_t wants = eld_strip_step(service->strip, budget_macs);
    eld_status_t status = wants;
    switch (wants) {
    case ELD_NOTICE_STRIP_PUSH:
        status = push(service);
        break;
    case ELD_NOTICE_STRIP_POSTS:
        status = push_posts(service);
        break;
    case ELD_NOTICE_STRIP_TAKE:
        status = take(service);
        break;
    case ELD_NOTICE_STRIP_DONE:
        status = take(service);
        if (status == ELD_NOTICE_STRIP_NO_LINE) { service->state = STRIP_DONE; }
        break;
    default:
        break;
    }
    if (!ELD_WORKED(status)) { return give_up(service, status); }
    service->status = status;
    return status;
}

eld_status_t strip_begin(strip_service_t *service, const strip_memory_t *memory, const strip_lines_t *lines,
                         const eld_strip_settings_t *settings) {
    (void)memset(service, 0, sizeof *service);
    service->memory = *memory;
    service->lines = *lines;
    service->settings = *settings;
    service->state = STRIP_CHECK;
    return validate(service, 1);
}

eld_status_t strip_cycle(strip_service_t *service, uint64_t budget_macs) {
    switch (service->state) {
    case STRIP_CHECK:
        return validate(service, budget_macs);
    case STRIP_WORK:
        return work(service, budget_macs);
    default:
        return service->status;
    }
}
