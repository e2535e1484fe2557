/* Plain C with one loop and one watchdog. */
#include "duty.h"
#include "platform.h"

int main(void) {
    unsigned cycle = 0;
    if (!duty_start()) return 1;
    while (platform_goes_on()) {
        /* One bounded piece of work, then the watchdog, which detects a call that does not return. */
        duty_cycle();
        platform_kick_watchdog();
        /* Counters from time to time. */
        if (++cycle % 64 == 0) duty_housekeeping();
    }
    duty_housekeeping();
    return 0;
}
