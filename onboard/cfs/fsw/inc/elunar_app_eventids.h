/* Event ids of ELUNAR_APP. Numbers do not change their meaning. */
#ifndef ELUNAR_APP_EVENTIDS_H
#define ELUNAR_APP_EVENTIDS_H

#define ELUNAR_APP_STARTUP_INF_EID 1   /* started: library, kernel, model and slot; an error without a model, with the reason */
#define ELUNAR_APP_NOOP_INF_EID 2      /* NOOP */
#define ELUNAR_APP_RESET_INF_EID 3     /* RESET_COUNTERS */
#define ELUNAR_APP_MID_ERR_EID 4       /* message with an unknown id */
#define ELUNAR_APP_CC_ERR_EID 5        /* unknown command code */
#define ELUNAR_APP_LEN_ERR_EID 6       /* message with a wrong length */
#define ELUNAR_APP_PIPE_ERR_EID 7      /* the pipe cannot be read; the application ends */
#define ELUNAR_APP_TBL_ERR_EID 8       /* the table is not legal or not available */
#define ELUNAR_APP_FILE_ERR_EID 9      /* a file cannot be read or written, or has another length */
#define ELUNAR_APP_STATUS_INF_EID 10   /* the library reports a notice */
#define ELUNAR_APP_STATUS_ERR_EID 11   /* the library refuses, or reports a fault */
#define ELUNAR_APP_TILE_INF_EID 12     /* a tile has begun */
#define ELUNAR_APP_HEIGHTS_INF_EID 13  /* heights are written, hazards counted */
#define ELUNAR_APP_DROPPED_ERR_EID 14  /* a tile was dropped */
#define ELUNAR_APP_BUSY_ERR_EID 15     /* a command arrived while a tile or self test is in progress */
#define ELUNAR_APP_SUN_ERR_EID 16      /* the Sun is outside the table's limits */
#define ELUNAR_APP_SELF_TEST_INF_EID 17 /* the self test has begun */
#define ELUNAR_APP_IDLE_INF_EID 18     /* ready: the self test has passed */
#define ELUNAR_APP_MODEL_INF_EID 19    /* the model was loaded, from which slot */
#define ELUNAR_APP_FAILED_ERR_EID 20   /* the self test fails with the model loaded again: do not use the heights */

#endif
