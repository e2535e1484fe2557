/* An RTEMS task, classic API, with a rate-monotonic period: a cycle that exceeds its period returns RTEMS_TIMEOUT. */
#include "duty.h"
#include "platform.h"

#include <rtems.h>

/* The library's bound (onboard/docs/budgets.md, stack, plus that of the C interface), the task's own frames, and a margin. */
#define TERRAIN_STACK_BYTES (24u * 1024u)
#define TERRAIN_PRIORITY 200u
#define TERRAIN_PERIOD_MS 100u
#define HOUSEKEEPING_CYCLES 50u

rtems_task terrain_task(rtems_task_argument nothing);
rtems_status_code terrain_task_create(void);

static uint32_t overruns;

rtems_task terrain_task(rtems_task_argument nothing) {
    rtems_id period;
    uint32_t cycle = 0;
    const rtems_interval ticks = TERRAIN_PERIOD_MS * rtems_clock_get_ticks_per_second() / 1000u;
    (void)nothing;
    if (rtems_rate_monotonic_create(rtems_build_name('T', 'E', 'R', 'R'), &period) != RTEMS_SUCCESSFUL) {
        rtems_task_exit();
    }
    while (duty_start() == 0) {
        platform_kick_watchdog();
        (void)rtems_task_wake_after(rtems_clock_get_ticks_per_second());
    }
    for (;;) {
        if (rtems_rate_monotonic_period(period, ticks) == RTEMS_TIMEOUT) { overruns++; }
        (void)duty_cycle();
        platform_kick_watchdog();
        if (++cycle % HOUSEKEEPING_CYCLES == 0u) { duty_housekeeping(); }
    }
}

rtems_status_code terrain_task_create(void) {
    rtems_id task;
    /* Uses the floating-point unit: the first and the last layer compute in floats. */
    rtems_status_code made = rtems_task_create(rtems_build_name('T', 'E', 'R', 'R'), TERRAIN_PRIORITY, TERRAIN_STACK_BYTES,
                                               RTEMS_DEFAULT_MODES, RTEMS_FLOATING_POINT, &task);
    return made == RTEMS_SUCCESSFUL ? rtems_task_start(task, terrain_task, 0) : made;
}
