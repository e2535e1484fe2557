/* The table of ELUNAR_APP: how much work a wakeup does, and what counts as a hazard. */
#ifndef ELUNAR_APP_TBL_H
#define ELUNAR_APP_TBL_H

#include "common_types.h"

typedef struct {
    uint32 StepBudgetMacs;    /* work of a wakeup, multiply-accumulates, above 0; see onboard/docs/integration.md, Budget and watchdog */
    uint32 ScrubBytes;        /* scrubbing of an idle wakeup, above 0 */
    float  MaxSlope;          /* steepest safe ground, rise over run, above 0 */
    float  MaxRoughnessM;     /* largest safe distance of a height from the mean of its four neighbours, metres, above 0 */
    float  MinSunElevationDeg; /* tiles with a lower Sun are refused: 0 to 90 */
    float  MaxSunElevationDeg; /* tiles with a higher one, too: above the lower limit, at most 90 */
} ELUNAR_APP_Table_t;

#endif
