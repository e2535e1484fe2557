/* A STUB for tests: the types of cFS' common_types.h that the application uses, from its public documentation. */
#ifndef STUB_COMMON_TYPES_H
#define STUB_COMMON_TYPES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef int16_t  int16;
typedef int32_t  int32;
typedef uint8_t  uint8;
typedef uint16_t uint16;
typedef uint32_t uint32;
typedef uint64_t uint64;

/* A type of its own, not a number, as in cFS. */
typedef struct {
    uint32 Value;
} osal_id_t;

#if defined(__GNUC__)
#define OS_USED        __attribute__((used))
#define OS_PRINTF(n, m) __attribute__((format(printf, n, m)))
#else
#define OS_USED
#define OS_PRINTF(n, m)
#endif

#endif
