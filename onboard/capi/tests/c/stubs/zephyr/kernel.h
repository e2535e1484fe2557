/* What zephyr_thread.c uses of Zephyr's kernel, from its public documentation. */
#ifndef ZEPHYR_KERNEL_H
#define ZEPHYR_KERNEL_H
#include <stddef.h>
#include <stdint.h>
#define CONFIG_NUM_PREEMPT_PRIORITIES 15
#define K_FP_REGS 2u
int32_t k_msleep(int32_t ms);
void k_yield(void);
int64_t k_uptime_get(void);
typedef void (*k_thread_entry_t)(void *p1, void *p2, void *p3);
struct k_thread_stub {
    k_thread_entry_t entry;
    void *arguments[3];
    size_t stack_bytes;
    int priority;
    unsigned options;
    int32_t delay_ms;
};
#define K_THREAD_DEFINE(name, stack_size, entry, p1, p2, p3, prio, options, delay) \
    const struct k_thread_stub name = {entry, {p1, p2, p3}, stack_size, prio, options, delay}
#endif
