/* The FreeRTOS task of the guide, for the rest of the application. */
#ifndef ELUNAR_FREERTOS_TASK_H
#define ELUNAR_FREERTOS_TASK_H

#include <stdint.h>

/* Creates the task. Call it before the scheduler starts. */
void terrain_task_create(void);
/* Returns a value that changes as long as the task runs. The time between two changes is at most a period plus a step. */
uint32_t terrain_heartbeat(void);

#endif
