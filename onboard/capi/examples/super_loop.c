/* Plain C with one loop and one watchdog. */
#include "duty.h"
#include "platform.h"

int main(void) {
    unsigned cycle = 0u;
    if (duty_start() == 0) { return 1; }
    while (platform_goes_on() != 0) {
        /* One bounded piece of work, then the watchdog, which detects a call that does not return. */
        (void)duty_cycle();
        platform_kick_watchdog();
        /* Counters from time to time. */
        if (++cycle % 64u == 0u) { duty_housekeeping(); }
    }
    duty_housekeeping();
    return 0;
}
