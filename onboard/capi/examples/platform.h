/* The functions that the integrator provides for the guides. */
#ifndef ELUNAR_PLATFORM_H
#define ELUNAR_PLATFORM_H

#include "elunar.h"

/* Returns the model in memory or in mapped flash, and its length in bytes; no alignment needed. */
const void *platform_model(size_t *bytes);
/* Writes the model to the same address from its second copy; 0 if there is none. Not called while a model in ROM reads correctly. */
int platform_reload_model(void);
/* Returns the next tile, whose maps stay valid until platform_heights or platform_dropped; 0 if there is none. */
int platform_next_tile(eld_tile_t *tile);
/* Takes the heights, metres above the 1737.4 km sphere; valid is 1 for valid heights. */
void platform_heights(const float *heights_m, const uint8_t *valid, size_t px);
/* Reports that the current tile was dropped. */
void platform_dropped(eld_status_t status);
/* Logs a status other than "continue". */
void platform_event(eld_status_t status, const char *text);
/* Sends the counters for housekeeping. */
void platform_housekeeping(const eld_telemetry_t *telemetry);
/* Resets the watchdog. */
void platform_kick_watchdog(void);
/* Returns whether to continue; always 1 on a spacecraft. */
int platform_goes_on(void);

#endif
