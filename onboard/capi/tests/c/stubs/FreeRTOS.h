/* A STUB for tests: the declarations that the guide needs, from FreeRTOS's public documentation. It has no code. */
#ifndef STUB_FREERTOS_H
#define STUB_FREERTOS_H

#include <stdint.h>

typedef uint32_t TickType_t;
typedef uint32_t StackType_t;
typedef unsigned long UBaseType_t;
typedef struct {
    void *opaque[16];
} StaticTask_t;

#define configTICK_RATE_HZ ((TickType_t)1000)
#define pdMS_TO_TICKS(ms) ((TickType_t)(((uint64_t)(ms) * configTICK_RATE_HZ) / 1000u))

#endif
