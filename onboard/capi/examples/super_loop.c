/* Plain C, one loop, one watchdog. */
#include "duty.h"
#include "platform.h"

int main(void) {
    unsigned cycle = 0;
    if (!duty_start()) return 1;
    while (platform_goes_on()) {
        /* One bounded piece of work, then the watchdog: a call that hangs is what it is there for. */
        duty_cycle();
        platform_kick_watchdog();
        /* Counters now and then. */
        if (++cycle % 64 == 0) duty_housekeeping();
    }
    duty_housekeeping();
    return 0;
}
