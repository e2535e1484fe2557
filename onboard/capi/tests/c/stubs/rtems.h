/* A STUB for tests: the declarations that the guide needs, from the public documentation of RTEMS' classic API. It has no code. */
#ifndef STUB_RTEMS_H
#define STUB_RTEMS_H

#include <stddef.h>
#include <stdint.h>

typedef uint32_t rtems_id;
typedef uint32_t rtems_name;
typedef uint32_t rtems_interval;
typedef uint32_t rtems_task_priority;
typedef uint32_t rtems_mode;
typedef uint32_t rtems_attribute;
typedef uintptr_t rtems_task_argument;
typedef void rtems_task;
typedef rtems_task (*rtems_task_entry)(rtems_task_argument);
typedef enum { RTEMS_SUCCESSFUL = 0, RTEMS_TIMEOUT = 6 } rtems_status_code;

#define RTEMS_DEFAULT_MODES ((rtems_mode)0)
#define RTEMS_FLOATING_POINT ((rtems_attribute)1)

rtems_name rtems_build_name(char c1, char c2, char c3, char c4);
rtems_interval rtems_clock_get_ticks_per_second(void);
rtems_status_code rtems_rate_monotonic_create(rtems_name name, rtems_id *id);
rtems_status_code rtems_rate_monotonic_period(rtems_id id, rtems_interval length);
rtems_status_code rtems_task_create(rtems_name name, rtems_task_priority priority, size_t stack_bytes, rtems_mode modes,
                                    rtems_attribute attributes, rtems_id *id);
rtems_status_code rtems_task_start(rtems_id id, rtems_task_entry entry, rtems_task_argument argument);
rtems_status_code rtems_task_wake_after(rtems_interval ticks);
void rtems_task_exit(void);

#endif
