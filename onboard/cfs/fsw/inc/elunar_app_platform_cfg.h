/* Sizes and paths of ELUNAR_APP; other values may be defined on the command line. */
#ifndef ELUNAR_APP_PLATFORM_CFG_H
#define ELUNAR_APP_PLATFORM_CFG_H

#define ELUNAR_APP_PIPE_DEPTH 16
#define ELUNAR_APP_PIPE_NAME "ELUNAR_CMD"
#define ELUNAR_APP_TABLE_NAME "Limits"

#ifndef ELUNAR_APP_TABLE_FILE
#define ELUNAR_APP_TABLE_FILE "/cf/elunar_app_tbl.tbl"
#endif
#ifndef ELUNAR_APP_MODEL_FILE
#define ELUNAR_APP_MODEL_FILE "/cf/nano.eld"
#endif
/* Bytes of the largest model and of the largest context, and pixels of the largest tile: onboard/docs/budgets.md has those of nano. */
#ifndef ELUNAR_APP_MODEL_BYTES
#define ELUNAR_APP_MODEL_BYTES (6u << 20)
#endif
#ifndef ELUNAR_APP_MEMORY_BYTES
#define ELUNAR_APP_MEMORY_BYTES (1u << 21)
#endif
#ifndef ELUNAR_APP_TILE_PX
#define ELUNAR_APP_TILE_PX (256u * 320u)
#endif
/* Largest number of bytes of one SCRUB command. */
#define ELUNAR_APP_SCRUB_BYTES 65536u
/* Characters of a path in a command, with the terminating NUL. */
#define ELUNAR_APP_PATH_LEN 64

#endif
