/* Sizes and paths of ELUNAR_APP aboard. */
#ifndef ELUNAR_APP_PLATFORM_CFG_H
#define ELUNAR_APP_PLATFORM_CFG_H

#define ELUNAR_APP_PIPE_DEPTH 16
#define ELUNAR_APP_PIPE_NAME "ELUNAR_CMD"
#define ELUNAR_APP_TABLE_NAME "Limits"

#ifndef ELUNAR_APP_TABLE_FILE
#define ELUNAR_APP_TABLE_FILE "/cf/elunar_app_tbl.tbl"
#endif
/* Slots of the model: two copies of one file. The second is read if the first is missing or damaged. */
#ifndef ELUNAR_APP_MODEL_FILE
#define ELUNAR_APP_MODEL_FILE "/cf/nano.eld"
#endif
#ifndef ELUNAR_APP_MODEL_FILE_2
#define ELUNAR_APP_MODEL_FILE_2 "/cf/nano2.eld"
#endif
/* Largest number of wakeups between two tries of a model that cannot be had: it is tried at the next wakeup, then after 2, 4, 8 ... */
#ifndef ELUNAR_APP_RETRY_WAKEUPS
#define ELUNAR_APP_RETRY_WAKEUPS 1000u
#endif
/* Bytes of the largest model and of the largest context, and pixels of the largest tile: onboard/docs/budgets.md has those of nano. */
#ifndef ELUNAR_APP_MODEL_BYTES
#define ELUNAR_APP_MODEL_BYTES (6u * 1024u * 1024u)
#endif
#ifndef ELUNAR_APP_MEMORY_BYTES
#define ELUNAR_APP_MEMORY_BYTES (9u * 256u * 1024u)
#endif
#ifndef ELUNAR_APP_TILE_PX
#define ELUNAR_APP_TILE_PX (256u * 320u)
#endif
/* Columns of the widest tile, and bytes for hazards: 16 KiB hold a footprint of 11 pixels a side (eld_terrain_plan). */
#ifndef ELUNAR_APP_TILE_COLS
#define ELUNAR_APP_TILE_COLS 320u
#endif
#ifndef ELUNAR_APP_TERRAIN_BYTES
#define ELUNAR_APP_TERRAIN_BYTES (16u * 1024u)
#endif

#endif
