//! Where the Sun stands: what C gets is the core's, and what is out of range is refused.
#![allow(unsafe_code)] // C functions

use elunar_capi::elunar_core::sun::{Body, UtcTime, sub_solar};
use elunar_capi::ffi::eld_sun_position;
use elunar_capi::status::*;
use elunar_capi::types::{eld_status_t, eld_sun_t};

const EMPTY: eld_sun_t = eld_sun_t {
    struct_bytes: size_of::<eld_sun_t>() as u32,
    azimuth_deg: -1.0,
    elevation_deg: -1.0,
    sub_solar_lat_deg: -1.0,
    sub_solar_lon_deg: -1.0,
    distance_au: -1.0,
};

fn position(days: f64, lat_deg: f64, lon_deg: f64) -> (eld_status_t, eld_sun_t) {
    let mut out = EMPTY;
    // SAFETY: a structure of the test.
    (unsafe { eld_sun_position(days, lat_deg, lon_deg, &raw mut out) }, out)
}

#[test]
fn c_gets_what_the_core_finds() {
    // Apollo 15, 2009-08-30T12:00:00: 107.71 and 29.92 degrees by the ephemeris (core/fixtures/sun.py).
    let (status, found) = position(3529.0, 26.13, 3.63);
    assert_eq!(status, ELD_OK);
    assert!((found.azimuth_deg - 107.71).abs() < 0.05 && (found.elevation_deg - 29.92).abs() < 0.05, "{found:?}");
    for (days, lat_deg, lon_deg) in
        [(-14_610.0, -90.0, 0.0), (0.0, 90.0, -360.0), (9000.25, -33.3, 359.0), (36_889.5, 0.0, 0.0)]
    {
        let below = sub_solar(Body::Moon, UtcTime::from_days(days).unwrap());
        let seen = below.seen_from(lat_deg, lon_deg);
        let expected = eld_sun_t {
            azimuth_deg: seen.azimuth_deg as f32,
            elevation_deg: seen.elevation_deg as f32,
            sub_solar_lat_deg: below.lat_deg as f32,
            sub_solar_lon_deg: below.lon_deg as f32,
            distance_au: below.distance_au as f32,
            ..EMPTY
        };
        assert_eq!(position(days, lat_deg, lon_deg), (ELD_OK, expected));
    }
}

#[test]
fn what_is_out_of_range_is_refused_and_nothing_is_written() {
    for days in [-36_525.0, 36_890.0, f64::NAN, f64::INFINITY] {
        assert_eq!(position(days, 0.0, 0.0), (ELD_REFUSED_TIME, EMPTY), "{days}");
    }
    for (lat_deg, lon_deg) in
        [(90.1, 0.0), (-91.0, 0.0), (f64::NAN, 0.0), (0.0, 360.5), (0.0, f64::NAN), (0.0, f64::NEG_INFINITY)]
    {
        assert_eq!(position(0.0, lat_deg, lon_deg), (ELD_REFUSED_PLACE, EMPTY), "{lat_deg} {lon_deg}");
    }
    let mut short = eld_sun_t { struct_bytes: 8, ..EMPTY };
    // SAFETY: a structure of the test, NULL, and an odd place that is not read.
    unsafe {
        assert_eq!(eld_sun_position(0.0, 0.0, 0.0, &raw mut short), ELD_REFUSED_STRUCT_BYTES);
        assert_eq!(eld_sun_position(0.0, 0.0, 0.0, core::ptr::null_mut()), ELD_REFUSED_NULL);
        let odd = (&raw mut short).cast::<u8>().wrapping_add(1).cast();
        assert_eq!(eld_sun_position(0.0, 0.0, 0.0, odd), ELD_REFUSED_ALIGNMENT);
    }
}
