/* The work of one cycle, shared by the super-loop and the tasks. */
#ifndef ELUNAR_DUTY_H
#define ELUNAR_DUTY_H

#include "service.h"

/* Pixels of the largest tile, and bytes of a context for the flight model, from eld_model_check on the ground: onboard/docs/budgets.md. */
#define DUTY_PX (256u * 320u)
#define DUTY_MEMORY_BYTES 2266576u

/* Work between two resets of the watchdog. See "Budget and watchdog" in onboard/docs/integration.md. */
#define DUTY_BUDGET_MACS 5000000u
/* Bytes scrubbed in an idle cycle. */
#define DUTY_SCRUB_BYTES 16384u

/* Begins to start the service; returns 0 if it cannot start. Cycles do the rest. */
int duty_start(void);
/* Runs one cycle; returns its status. */
eld_status_t duty_cycle(void);
/* Sends the counters. */
void duty_housekeeping(void);

#endif
