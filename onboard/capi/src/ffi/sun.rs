//! Where the Sun stands.

use super::pointers::*;
use crate::status::*;
use crate::types::*;
use elunar_core::sun::{Body, UtcTime, sub_solar};

/// Writes where the Sun stands at a place of the Moon, within 0.02 degrees from 1960 to 2060. `utc_days`: days of 86,400 s since 2000-01-01T12:00:00
/// UTC, the years 1900 to 2100 (seconds of Unix less 946728000, over 86400). Degrees north, and east from -360 to 360, in the mean-Earth system.
/// `out->struct_bytes` must be set. Needs no context. `eld_tile_t` counts azimuths from the direction of decreasing rows, which is north only on a
/// map whose up is north there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eld_sun_position(
    utc_days: f64,
    lat_deg: f64,
    lon_deg: f64,
    out: *mut eld_sun_t,
) -> eld_status_t {
    let position = || {
        // SAFETY: the caller's promise.
        let struct_bytes = unsafe { structure(out) }?.struct_bytes;
        let time = UtcTime::from_days(utc_days).map_err(|_| ELD_REFUSED_TIME)?;
        if !(-90.0..=90.0).contains(&lat_deg) || !(-360.0..=360.0).contains(&lon_deg) {
            return Err(ELD_REFUSED_PLACE);
        }
        let below = sub_solar(Body::Moon, time);
        let seen = below.seen_from(lat_deg, lon_deg);
        let found = eld_sun_t {
            struct_bytes,
            azimuth_deg: seen.azimuth_deg as f32,
            elevation_deg: seen.elevation_deg as f32,
            sub_solar_lat_deg: below.lat_deg as f32,
            sub_solar_lon_deg: below.lon_deg as f32,
            distance_au: below.distance_au as f32,
        };
        // SAFETY: validated by `structure`.
        unsafe { out.write(found) };
        Ok(ELD_OK)
    };
    status_of(position())
}
