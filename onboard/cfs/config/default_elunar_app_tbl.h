/* The table of ELUNAR_APP: the work of a wakeup, and the limits for hazards. */
#ifndef ELUNAR_APP_TBL_H
#define ELUNAR_APP_TBL_H

#include "common_types.h"

typedef struct {
    uint32 StepBudgetMacs;    /* work of a wakeup, multiply-accumulates, above 0; see onboard/docs/integration.md, Budget and watchdog */
    uint32 ScrubBytes;        /* bytes scrubbed in an idle wakeup, above 0 */
    float  MaxSlope;          /* largest safe slope, rise over run, above 0 */
    float  MaxRoughnessM;     /* largest safe difference of a height from the mean of its four neighbours, metres, above 0 */
    float  MinSunElevationDeg; /* tiles with a lower Sun are refused; degrees, 0 to 90 */
    float  MaxSunElevationDeg; /* tiles with a higher Sun are refused; degrees, above the lower limit, at most 90 */
} ELUNAR_APP_Table_t;

#endif
