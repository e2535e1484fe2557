/* The table of ELUNAR_APP: the work of a wakeup, and the limits for hazards. */
#ifndef ELUNAR_APP_TBL_H
#define ELUNAR_APP_TBL_H

#include "common_types.h"

typedef struct {
    uint32 StepBudgetMacs;    /* work of a wakeup, multiply-accumulates, above 0; see onboard/docs/integration.md, Budget and watchdog */
    uint32 ScrubBytes;        /* bytes scrubbed in an idle wakeup, above 0 */
    float  MaxSlopeDeg;       /* largest safe slope of the plane under the vehicle's footprint, degrees, above 0, at most 90 */
    float  MaxRoughnessM;     /* largest safe distance of a pixel of the footprint from that plane, metres, above 0 */
    uint32 FootprintRadiusPx; /* r, above 0: the footprint is a square of 2r + 1 pixels a side; it must fit ELUNAR_APP_TERRAIN_BYTES */
    float  MinSunElevationDeg; /* tiles with a lower Sun are refused; degrees, 0 to 90 */
    float  MaxSunElevationDeg; /* tiles with a higher Sun are refused; degrees, above the lower limit, at most 90 */
} ELUNAR_APP_Table_t;

#endif
