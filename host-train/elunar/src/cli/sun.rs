//! `elunar sun`: where the Sun stands.

use elunar_base::Result;
use elunar_core::sun::{Body, UtcTime, sub_solar};
use serde_json::json;

/// Help text below the options.
pub const HELP: &str = "\
Azimuths are clockwise from north. Latitudes are from the body's centre, longitudes east. From 1960 to 2060 the direction is within 0.02 \
degrees of JPL's ephemeris DE421. `predict --time` turns it into the image's grid.

Example:
  elunar sun 2009-08-30T12:00:00 --at 3.63,26.13";

/// Options of `sun`.
#[derive(Debug, clap::Args)]
#[command(after_help = HELP)]
pub struct Args {
    /// Moment in UTC: 2009-08-30T12:00:00, or 2009-242T12:00:00 with the day of the year.
    #[arg(value_name = "TIME")]
    pub time: UtcTime,
    /// Longitude and latitude of a place, degrees.
    #[arg(long, value_name = "LON,LAT", value_parser = place, allow_hyphen_values = true)]
    pub at: Option<(f64, f64)>,
    /// On Mars instead of the Moon.
    #[arg(long)]
    pub mars: bool,
    /// Print one JSON object.
    #[arg(long)]
    pub json: bool,
}

fn place(text: &str) -> std::result::Result<(f64, f64), String> {
    let numbers =
        text.split_once(',').and_then(|(lon, lat)| Some((lon.trim().parse().ok()?, lat.trim().parse().ok()?)));
    let legal = |(lon, lat): &(f64, f64)| (-360.0..=360.0).contains(lon) && (-90.0..=90.0).contains(lat);
    numbers.filter(legal).ok_or_else(|| format!("longitude,latitude in degrees expected, found {text}"))
}

/// Runs the command.
///
/// # Errors
/// None.
pub fn run(args: &Args) -> Result<()> {
    let body = if args.mars { Body::Mars } else { Body::Moon };
    let point = sub_solar(body, args.time);
    let direction = args.at.map(|(lon_deg, lat_deg)| point.seen_from(lat_deg, lon_deg));
    if args.json {
        let angles = direction.map(|sun| json!({ "azimuth_deg": sun.azimuth_deg, "elevation_deg": sun.elevation_deg }));
        let lit = json!({ "lon_deg": point.lon_deg, "lat_deg": point.lat_deg, "distance_au": point.distance_au });
        println!("{}", json!({ "sun": angles, "sub_solar": lit }));
        return Ok(());
    }
    println!(
        "{:?}: the Sun is above {:.3} E, {:.3} N, {:.5} AU away",
        body, point.lon_deg, point.lat_deg, point.distance_au
    );
    if let (Some(sun), Some((lon_deg, lat_deg))) = (direction, args.at) {
        let night = if sun.elevation_deg < 0.0 { " (night)" } else { "" };
        println!(
            "at {lon_deg} E, {lat_deg} N: azimuth {:.2}, elevation {:.2} degrees{night}",
            sun.azimuth_deg, sun.elevation_deg
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_read() {
        assert_eq!(place("3.63,26.13"), Ok((3.63, 26.13)));
        assert_eq!(place("-120, -89.5"), Ok((-120.0, -89.5)));
        for text in ["", "3", "3,91", "400,0", "a,b", "1,2,3"] {
            assert!(place(text).is_err(), "{text}");
        }
    }
}
