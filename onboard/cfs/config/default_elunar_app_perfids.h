/* Performance ids of ELUNAR_APP. */
#ifndef ELUNAR_APP_PERFIDS_H
#define ELUNAR_APP_PERFIDS_H

#define ELUNAR_APP_PERF_ID 0x60      /* the whole application */
#define ELUNAR_APP_WORK_PERF_ID 0x61 /* the work of a wakeup */

#endif
