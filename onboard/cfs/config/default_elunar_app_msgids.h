/* Message ids of ELUNAR_APP. The mission assigns the values: these are free in the sample mission. */
#ifndef ELUNAR_APP_MSGIDS_H
#define ELUNAR_APP_MSGIDS_H

#ifndef ELUNAR_APP_CMD_MID
#define ELUNAR_APP_CMD_MID 0x18C0 /* commands */
#endif
#ifndef ELUNAR_APP_SEND_HK_MID
#define ELUNAR_APP_SEND_HK_MID 0x18C1 /* request for housekeeping */
#endif
#ifndef ELUNAR_APP_WAKEUP_MID
#define ELUNAR_APP_WAKEUP_MID 0x18C2 /* request for one bounded piece of work */
#endif
#ifndef ELUNAR_APP_HK_TLM_MID
#define ELUNAR_APP_HK_TLM_MID 0x08C0 /* housekeeping packet */
#endif

#endif
