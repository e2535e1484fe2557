/* Command codes of ELUNAR_APP. Numbers do not change their meaning. */
#ifndef ELUNAR_APP_FCNCODES_H
#define ELUNAR_APP_FCNCODES_H

#define ELUNAR_APP_NOOP_CC 0           /* counts, and reports versions */
#define ELUNAR_APP_RESET_COUNTERS_CC 1 /* command counters and event filters to 0, and tries a missing model at the next wakeup */
#define ELUNAR_APP_SELF_TEST_CC 2      /* begins the self test */
#define ELUNAR_APP_PROCESS_TILE_CC 3   /* begins a tile from files */
#define ELUNAR_APP_SCRUB_CC 4          /* scrubs some bytes of the model at once */

#endif
