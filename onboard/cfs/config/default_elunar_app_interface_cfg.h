/* Sizes in messages of ELUNAR_APP: application and ground must agree about them. */
#ifndef ELUNAR_APP_INTERFACE_CFG_H
#define ELUNAR_APP_INTERFACE_CFG_H

/* Characters of a path in a command, with the terminating NUL. */
#define ELUNAR_APP_PATH_LEN 64
/* Largest number of bytes of one SCRUB command. */
#define ELUNAR_APP_SCRUB_BYTES 65536u

#endif
