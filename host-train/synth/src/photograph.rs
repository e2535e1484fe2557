//! An image of given ground, with the generator's light and camera.

use super::camera::{BLUR_PX, Exposure};
use super::light::{Sun, reflectance};
use elunar_base::{Error, Result};
use elunar_raster::Raster;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Takes an image of `dtm` (heights in metres) under a Sun of (azimuth, elevation) degrees, as on the synthetic Moon: Lunar-Lambert
/// reflectance, cast shadows, blur, noise, relative DN from 0 to 4095. The albedo is one everywhere. `seed` determines blur, exposure and
/// noise.
///
/// # Errors
/// [`Error::Usage`] if a height is missing, the pixel size is unknown or not square, or the Sun's elevation is not within 2 to 90 degrees.
pub fn photograph(dtm: &Raster, (azimuth_deg, elevation_deg): (f64, f64), seed: u64) -> Result<Raster> {
    let missing = dtm.samples.len() - dtm.valid_count();
    if missing > 0 {
        return Err(Error::usage(format!("image of a DTM: expected a height in every pixel, found {missing} without")));
    }
    if !(2.0..=90.0).contains(&elevation_deg) || !azimuth_deg.is_finite() {
        let found = format!("azimuth {azimuth_deg}, elevation {elevation_deg}");
        return Err(Error::usage(format!("image of a DTM: expected a Sun 2 to 90 degrees high, found {found}")));
    }
    let (row_m, col_m) = dtm.pixel_m().ok_or_else(|| Error::usage("image of a DTM: pixel size in metres unknown"))?;
    if (row_m / col_m - 1.0).abs() > 0.01 {
        return Err(Error::usage(format!("image of a DTM: expected square pixels, found {row_m} x {col_m} m")));
    }
    let sun = Sun { azimuth_deg, elevation_deg };
    let radiance = reflectance(&dtm.samples, [dtm.rows, dtm.cols], (row_m * col_m).sqrt(), &sun, 0.0);
    let rng = &mut ChaCha8Rng::seed_from_u64(seed);
    let samples = Exposure::draw(rng, BLUR_PX).take(rng, &radiance, dtm.rows, dtm.cols);
    Ok(Raster { samples, ..dtm.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Moon, SynthOptions};

    #[test]
    fn ground_does_not_depend_on_the_sun_and_its_images_do() {
        let lit = |azimuth_deg: f64| {
            let options = SynthOptions {
                rows: 64,
                cols: 80,
                sun_azimuth_deg: (azimuth_deg, azimuth_deg),
                sun_elevation_deg: (30.0, 30.0),
                ..SynthOptions::default()
            };
            Moon::new(3, options).unwrap().tile(5)
        };
        let (west, east) = (lit(270.0), lit(90.0));
        assert_eq!((&west.truth_m, &west.coarse_m), (&east.truth_m, &east.coarse_m));
        assert_eq!((west.sun_azimuth_deg, east.sun_azimuth_deg), (270.0, 90.0));
        assert_ne!(west.image, east.image);
    }

    #[test]
    fn given_ground_is_lit_from_where_the_sun_stands() {
        let scene = Moon::new(3, SynthOptions::default()).unwrap().scene(1, 64, 80).unwrap();
        let dtm = scene.truth_raster();
        let [west, east] = [270.0, 90.0].map(|azimuth| photograph(&dtm, (azimuth, 30.0), 7).unwrap());
        // Where the ground rises eastwards, a Sun in the west makes it brighter than a Sun in the east.
        let (mut agree, mut all) = (0, 0);
        for i in (0..64 * 80).filter(|i| (2..78).contains(&(i % 80))) {
            let rise = dtm.samples[i + 1] - dtm.samples[i - 1];
            if rise.abs() > 0.4 {
                all += 1;
                agree += i32::from((rise > 0.0) == (west.samples[i] > east.samples[i]));
            }
        }
        assert!(all > 300 && agree * 10 > all * 9, "{agree} of {all}");
        assert_eq!(photograph(&dtm, (270.0, 30.0), 7).unwrap(), west);
        assert!(photograph(&dtm, (270.0, 1.0), 7).is_err());
        let mut holed = dtm.clone();
        holed.samples[9] = f32::NAN;
        assert!(photograph(&holed, (270.0, 30.0), 7).unwrap_err().to_string().contains("found 1 without"));
    }
}
