/* A thread of Zephyr with a period. The watchdog belongs to the application: it kicks it while the heartbeat moves. */
#include "duty.h"

#include <zephyr/kernel.h>

/* The bounds of library and C interface (onboard/docs/budgets.md, stack), the thread's own frames, and a margin. */
#define TERRAIN_STACK_BYTES 24576
/* Preemptible, and low: the thread computes when no other needs the processor. */
#define TERRAIN_PRIORITY (CONFIG_NUM_PREEMPT_PRIORITIES - 1)
#define TERRAIN_PERIOD_MS 100
#define HOUSEKEEPING_CYCLES 50u

/* Written by this thread alone. */
static volatile uint32_t heartbeat;

uint32_t terrain_heartbeat(void);
uint32_t terrain_heartbeat(void) { return heartbeat; }

static void terrain_thread(void *one, void *two, void *three) {
    (void)one;
    (void)two;
    (void)three;
    while (duty_start() == 0) {
        heartbeat++;
        (void)k_msleep(1000);
    }
    for (;;) {
        const int64_t began_ms = k_uptime_get();
        int64_t left_ms;
        (void)duty_cycle();
        if (++heartbeat % HOUSEKEEPING_CYCLES == 0u) { duty_housekeeping(); }
        /* The context belongs to this thread. */
        left_ms = TERRAIN_PERIOD_MS - (k_uptime_get() - began_ms);
        if (left_ms > 0) { (void)k_msleep((int32_t)left_ms); }
        else { k_yield(); }
    }
}

/* K_FP_REGS: the thread uses the floating-point unit. */
K_THREAD_DEFINE(terrain, TERRAIN_STACK_BYTES, terrain_thread, NULL, NULL, NULL, TERRAIN_PRIORITY, K_FP_REGS, 0);
