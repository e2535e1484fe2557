/* The guide's FreeRTOS task on MPS2 AN500 under QEMU: one tile, then the end. See run.sh.
 *
 * The platform: the model at 0x60000000, image and coarse DTM at 0x60800000 and 0x60900000, put there by QEMU; heights go into a file of the
 * host, by semihosting. A second task serves as the watchdog's: it looks for the longest pause of the heartbeat. */
#include "FreeRTOS.h"
#include "task.h"

#include "duty.h"
#include "freertos_task.h"
#include "platform.h"

#include <string.h>

/* Semihosting: see Arm's "Semihosting for AArch32 and AArch64". */
enum { SYS_OPEN = 1, SYS_CLOSE = 2, SYS_WRITE0 = 4, SYS_WRITE = 5, SYS_EXIT = 24 };

static int semihost(int operation, const void *argument) {
    register int r0 __asm("r0") = operation;
    register const void *r1 __asm("r1") = argument;
    __asm volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static void say(const char *text) { semihost(SYS_WRITE0, text); }

static void say_number(const char *before, uint32_t number, const char *after) {
    char digits[11], *at = digits + sizeof digits - 1;
    *at = 0;
    do {
        *--at = (char)('0' + number % 10u);
        number /= 10u;
    } while (number > 0);
    say(before);
    say(at);
    say(after);
}

static void leave(int good) {
    semihost(SYS_EXIT, (const void *)(good ? 0x20026 : 0x20023));
    for (;;) {
    }
}

/* ---- platform.h ----------------------------------------------------------------------------------------------------- */

static int given, reported;
static uint32_t begun_ms, longest_pause_ms;

const void *platform_model(size_t *bytes) {
    *bytes = MODEL_BYTES;
    return (const void *)0x60000000;
}

int platform_reload_model(void) { return 0; }

int platform_next_tile(eld_tile_t *tile) {
    if (given) return 0;
    given = 1;
    begun_ms = xTaskGetTickCount();
    memset(tile, 0, sizeof *tile);
    tile->pixel_m = 2.0f;
    tile->coarse_px = 29.61f;
    tile->sun_azimuth_deg = 189.488525f;
    tile->sun_elevation_deg = 25.614722f;
    tile->image = service_floats((const void *)0x60800000, DUTY_PX * sizeof(float));
    tile->coarse_m = (const float *)0x60900000;
    tile->coarse_len = DUTY_PX;
    return 1;
}

static void write_file(const char *name, const void *first, size_t first_bytes, const void *second, size_t second_bytes) {
    const uintptr_t open[] = {(uintptr_t)name, 5 /* "wb" */, strlen(name)};
    const int file = semihost(SYS_OPEN, open);
    const uintptr_t write_first[] = {(uintptr_t)file, (uintptr_t)first, first_bytes};
    const uintptr_t write_second[] = {(uintptr_t)file, (uintptr_t)second, second_bytes};
    /* Semihosting returns how many bytes were not written. */
    if (file < 0 || semihost(SYS_WRITE, write_first) != 0 || semihost(SYS_WRITE, write_second) != 0) {
        say("FAIL: heights cannot be written\n");
        leave(0);
    }
    semihost(SYS_CLOSE, write_first);
}

void platform_heights(const float *heights_m, const uint8_t *valid, size_t px) {
    say_number("heights after ", xTaskGetTickCount() - begun_ms, " ms of the board's clock\n");
    say_number("longest pause of the heartbeat: ", longest_pause_ms, " ms\n");
    say_number("bytes of stack never used: ", (uint32_t)uxTaskGetStackHighWaterMark(NULL) * (uint32_t)sizeof(StackType_t), "\n");
    write_file("heights.f32", heights_m, px * sizeof *heights_m, valid, px);
    duty_housekeeping();
    say(reported ? "PASS\n" : "FAIL: no housekeeping\n");
    leave(reported);
}

void platform_dropped(eld_status_t status) {
    say("FAIL: tile dropped: ");
    say(eld_status_text(status));
    say("\n");
    leave(0);
}

void platform_event(eld_status_t status, const char *text) {
    (void)status;
    say(text);
    say("\n");
}

void platform_housekeeping(const eld_telemetry_t *telemetry) {
    reported = 1;
    say_number("housekeeping: steps ", (uint32_t)telemetry->steps, ", ");
    say_number("tiles ", (uint32_t)telemetry->tiles, ", ");
    say_number("faults ", (uint32_t)telemetry->faults, "\n");
}

void platform_kick_watchdog(void) {}

int platform_goes_on(void) { return 1; }

/* ---- the watchdog's task, FreeRTOS, start --------------------------------------------------------------------------- */

static void watchdog_task(void *nothing) {
    uint32_t last = terrain_heartbeat();
    TickType_t at = xTaskGetTickCount();
    (void)nothing;
    for (;;) {
        vTaskDelay(pdMS_TO_TICKS(10u));
        if (terrain_heartbeat() != last) {
            last = terrain_heartbeat();
            at = xTaskGetTickCount();
        } else if (xTaskGetTickCount() - at > longest_pause_ms) {
            longest_pause_ms = xTaskGetTickCount() - at;
        }
    }
}

void vAssertCalled(const char *file, int line) {
    say_number(file, (uint32_t)line, ": FAIL: configASSERT\n");
    leave(0);
}

void vApplicationStackOverflowHook(TaskHandle_t task, char *name) {
    (void)task;
    say(name);
    say(": FAIL: stack overflow\n");
    leave(0);
}

void vApplicationGetIdleTaskMemory(StaticTask_t **block, StackType_t **stack, configSTACK_DEPTH_TYPE *words) {
    static StaticTask_t idle_block;
    static StackType_t idle_stack[configMINIMAL_STACK_SIZE];
    *block = &idle_block;
    *stack = idle_stack;
    *words = configMINIMAL_STACK_SIZE;
}

int main(void) {
    static StackType_t stack[1024];
    static StaticTask_t block;
    char kernel[64];
    if (ELD_WORKED(eld_kernel_name(kernel, sizeof kernel))) {
        say("kernel ");
        say(kernel);
        say("\n");
    }
    terrain_task_create();
    (void)xTaskCreateStatic(watchdog_task, "watchdog", 1024, NULL, 3, stack, &block);
    vTaskStartScheduler();
    leave(0);
    return 0;
}

extern uint32_t __data_start[], __data_end[], __data_load[], __bss_start[], __bss_end[], __stack_top[];

void Reset_Handler(void) {
    uint32_t *to = __data_start;
    const uint32_t *from = __data_load;
    while (to < __data_end) *to++ = *from++;
    for (to = __bss_start; to < __bss_end; to++) *to = 0;
    *(volatile uint32_t *)0xE000ED88 |= 0xFu << 20; /* CPACR: the floating-point unit */
    __asm volatile("dsb\n isb");
    (void)main();
}

static void fault(void) {
    say("FAIL: fault of the processor\n");
    leave(0);
}

void SVC_Handler(void);
void PendSV_Handler(void);
void SysTick_Handler(void);

__attribute__((section(".isr_vector"), used)) static const void *const vectors[] = {
    __stack_top, (const void *)Reset_Handler, (const void *)fault, (const void *)fault, (const void *)fault, (const void *)fault,
    (const void *)fault, NULL, NULL, NULL, NULL, (const void *)SVC_Handler, (const void *)fault, NULL, (const void *)PendSV_Handler,
    (const void *)SysTick_Handler};
