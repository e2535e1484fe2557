/* A FreeRTOS task. Another task serves the watchdog; this one counts a heartbeat and waits for its next period. */
#include "duty.h"

#include "FreeRTOS.h"
#include "task.h"

#include "freertos_task.h"

/* Words of stack: the bounds of library and C interface (onboard/docs/budgets.md, stack), the task's own frames, and a margin. */
#define TERRAIN_STACK_WORDS (24576u / sizeof(StackType_t))
/* Low priority: the task computes when no other task needs the processor. */
#define TERRAIN_PRIORITY (tskIDLE_PRIORITY + 1u)
#define TERRAIN_PERIOD_MS 100u
/* Cycles between two reports of the counters. */
#define HOUSEKEEPING_CYCLES 50u

static StackType_t stack[TERRAIN_STACK_WORDS];
static StaticTask_t block;
/* Written by this task alone, read by the watchdog's task: the task is alive as long as the value changes. */
static volatile uint32_t heartbeat;

uint32_t terrain_heartbeat(void) { return heartbeat; }

static void terrain_task(void *nothing) {
    TickType_t woken = xTaskGetTickCount();
    (void)nothing;
    while (duty_start() == 0) {
        heartbeat++;
        vTaskDelay(pdMS_TO_TICKS(1000u));
    }
    for (;;) {
        (void)duty_cycle();
        if (++heartbeat % HOUSEKEEPING_CYCLES == 0u) { duty_housekeeping(); }
        /* The context belongs to this task. No other task calls the library with it, not even for telemetry. */
        vTaskDelayUntil(&woken, pdMS_TO_TICKS(TERRAIN_PERIOD_MS));
    }
}

void terrain_task_create(void) {
    /* Static memory instead of a heap. */
    (void)xTaskCreateStatic(terrain_task, "terrain", TERRAIN_STACK_WORDS, NULL, TERRAIN_PRIORITY, stack, &block);
}
