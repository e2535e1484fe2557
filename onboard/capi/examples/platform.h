/* What the guides want from the spacecraft around them; all of it is the integrator's. */
#ifndef ELUNAR_PLATFORM_H
#define ELUNAR_PLATFORM_H

#include "elunar.h"

/* The model in memory or in mapped flash, and its bytes; no alignment needed. */
const void *platform_model(size_t *bytes);
/* Writes the model to that place again, from its second copy; 0 if there is none. Never called for a model in ROM that reads back well. */
int platform_reload_model(void);
/* The next tile, with maps that stay until platform_heights or platform_dropped; 0 if there is none. */
int platform_next_tile(eld_tile_t *tile);
/* Takes the heights, metres above the 1737.4 km sphere, and 1 where they mean something. */
void platform_heights(const float *heights_m, const uint8_t *valid, size_t px);
/* The tile at work came to nothing. */
void platform_dropped(eld_status_t status);
/* A status that is more than "go on": for the event log. */
void platform_event(eld_status_t status, const char *text);
/* Counters for housekeeping. */
void platform_housekeeping(const eld_telemetry_t *telemetry);
/* Serves the watchdog. */
void platform_kick_watchdog(void);
/* Whether to go on; a spacecraft always says 1. */
int platform_goes_on(void);

#endif
