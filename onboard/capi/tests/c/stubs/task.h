/* A STUB for tests: see FreeRTOS.h beside it. */
#ifndef STUB_TASK_H
#define STUB_TASK_H

#include "FreeRTOS.h"

typedef void (*TaskFunction_t)(void *);
typedef struct tskTaskControlBlock *TaskHandle_t;

#define tskIDLE_PRIORITY ((UBaseType_t)0)

TaskHandle_t xTaskCreateStatic(TaskFunction_t task, const char *name, uint32_t stack_words, void *argument, UBaseType_t priority,
                               StackType_t *stack, StaticTask_t *block);
TickType_t xTaskGetTickCount(void);
void vTaskDelay(TickType_t ticks);
void vTaskDelayUntil(TickType_t *previous, TickType_t increment);

#endif
