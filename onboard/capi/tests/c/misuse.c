/* Errors of a C caller that need no model; each one has a status. C99 and C++17. */
#include "elunar.h"
#include "elunar.h" /* a second inclusion is harmless */

#include <stdio.h>
#include <string.h>

static int wrong = 0;

static void expect(const char *what, eld_status_t found, eld_status_t expected) {
    if (found != expected) {
        printf("%s: expected %08lx (%s), found %08lx (%s)\n", what, (unsigned long)expected, eld_status_text(expected),
               (unsigned long)found, eld_status_text(found));
        wrong++;
    }
}

int main(void) {
    static uint64_t memory[512];
    static const uint8_t no_model[64] = {0x89, 'P', 'N', 'G'};
    eld_context_t *context = (eld_context_t *)memory;
    eld_model_info_t info;
    eld_check_t check;
    eld_telemetry_t telemetry;
    char name[4];
    uint32_t sum = 0;
    eld_sun_t sun;

    memset(&info, 0, sizeof info);
    expect("info of no size", eld_model_check(no_model, sizeof no_model, &info), ELD_REFUSED_STRUCT_BYTES);
    info.struct_bytes = sizeof info;
    expect("no model", eld_model_check(no_model, sizeof no_model, &info), ELD_REFUSED_MODEL_MAGIC);
    expect("model NULL", eld_model_check(NULL, 0, &info), ELD_REFUSED_NULL);
    expect("init without model", eld_init(memory, sizeof memory, no_model, sizeof no_model, &context), ELD_REFUSED_MODEL_MAGIC);
    if (context != NULL) wrong++;
    memset(&check, 0, sizeof check);
    expect("check of no model", eld_model_check_step(no_model, sizeof no_model, 1, &check, &info), ELD_REFUSED_MODEL_MAGIC);
    check.words[0] = 1;
    expect("a check of its own", eld_model_check_step(no_model, sizeof no_model, 1, &check, &info), ELD_FAULT_CHECK);
    expect("no check", eld_init_checked(memory, sizeof memory, no_model, sizeof no_model, NULL, &context), ELD_REFUSED_NULL);
    if (context != NULL) wrong++;
    expect("after a refused init", eld_step(context, 1), ELD_REFUSED_NULL);
    context = (eld_context_t *)memory;
    expect("memory without context", eld_step(context, 1), ELD_FAULT_CONTEXT_LOST);
    expect("begin nothing", eld_begin(context, NULL), ELD_FAULT_CONTEXT_LOST);
    telemetry.struct_bytes = sizeof telemetry;
    expect("telemetry of nothing", eld_telemetry(context, &telemetry), ELD_FAULT_CONTEXT_LOST);
    memset(&sun, 0, sizeof sun);
    expect("a Sun of no size", eld_sun_position(0.0, 0.0, 0.0, &sun), ELD_REFUSED_STRUCT_BYTES);
    sun.struct_bytes = sizeof sun;
    expect("a Sun of 2200", eld_sun_position(73000.0, 0.0, 0.0, &sun), ELD_REFUSED_TIME);
    expect("the Sun", eld_sun_position(3529.0, 26.13, 3.63, &sun), ELD_OK);
    if (sun.elevation_deg < 29.8f || sun.elevation_deg > 30.0f) wrong++;
    expect("no program", eld_code_sum(NULL, 1, &sum), ELD_REFUSED_NULL);
    expect("a short name", eld_kernel_name(name, sizeof name), ELD_REFUSED_BUFFER);

    if (ELD_SEVERITY(ELD_OK) != ELD_GOOD || ELD_SEVERITY(ELD_RUNNING) != ELD_NOTICE) wrong++;
    if (ELD_SEVERITY(ELD_REFUSED_NULL) != ELD_REFUSED || ELD_SEVERITY(ELD_FAULT_RUN) != ELD_FAULT) wrong++;
    if (!ELD_WORKED(ELD_RUNNING) || ELD_WORKED(ELD_REFUSED_NULL) || ELD_WORKED(ELD_FAULT_SELF_TEST)) wrong++;
    if (strcmp(eld_status_text(ELD_OK), "done") != 0) wrong++;
    printf("%d wrong\n", wrong);
    return wrong != 0;
}
