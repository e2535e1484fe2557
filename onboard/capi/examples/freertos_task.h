/* The FreeRTOS task of the guide, for the rest of the application. */
#ifndef ELUNAR_FREERTOS_TASK_H
#define ELUNAR_FREERTOS_TASK_H

#include <stdint.h>

/* Creates the task; before the scheduler starts. */
void terrain_task_create(void);
/* Changes as long as the task lives; at most a period and a step apart. */
uint32_t terrain_heartbeat(void);

#endif
