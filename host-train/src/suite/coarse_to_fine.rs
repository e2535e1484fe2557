//! Prediction from coarse to fine: the multi-scale coupling of MADNet 2.0 (Tao et al. 2021, doi:10.3390/rs13214220), of which this has the
//! use of one network at several scales, each DTM the next scale's coarse DTM.

use super::real::means;
use elunar_base::Result;
use elunar_raster::Raster;
use elunar_scene::predict::{NamedRaster, Scene};

/// Image and coarse DTM, each on its own grid.
pub struct ImageAndCoarse<'a> {
    /// The scene's name, for errors.
    pub name: &'a str,
    /// The image.
    pub image: &'a Raster,
    /// The coarse DTM, metres.
    pub coarse: &'a Raster,
}

impl ImageAndCoarse<'_> {
    /// Predicts with pixels 2^`scales` times as wide as the image's, then with half of that, until twice the image's. Returns the scene at
    /// the image's resolution whose coarse DTM is the last of these DTMs.
    ///
    /// # Errors
    /// If the image is narrower than the widest pixel, or a scene cannot be made or predicted.
    pub fn refined(&self, scales: u32, predict: &mut dyn FnMut(&Scene) -> Result<Raster>) -> Result<Scene> {
        let Self { name, image, coarse } = *self;
        let input = |what: &str, raster: Raster| NamedRaster::in_memory(format!("{name}: {what}"), raster);
        let mut coarse = coarse.clone();
        for scale in (1..=scales).rev() {
            let wide = input("averaged image", means(image, name, 1 << scale, 1.0)?);
            coarse = predict(&Scene::new(wide, input("coarse DTM", coarse))?)?;
        }
        Scene::new(input("image", image.clone()), input("DTM of twice the pixel", coarse))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_raster::{Crs, GeoRef};

    const MOON: &str = "+proj=eqc +R=1737400 +units=m +no_defs";

    fn raster(rows: usize, cols: usize, pixel_m: f64, value: impl Fn(f64, f64) -> f32) -> Raster {
        let georef = GeoRef { transform: [100.0, pixel_m, 0.0, 50.0, 0.0, -pixel_m], crs: Crs::parse(MOON).unwrap() };
        let at = |i: usize| georef.centre((i / cols) as f64, (i % cols) as f64);
        let samples = (0..rows * cols).map(|i| value(at(i).0, at(i).1)).collect();
        Raster { rows, cols, samples, georef: Some(georef) }
    }

    /// Every scale sees the image's average and the DTM of the scale before, and the last scene has that of twice the pixel.
    #[test]
    fn every_scale_hands_its_dtm_to_the_next() {
        let (image, coarse) = (raster(64, 80, 2.0, |_, _| 1.0), raster(16, 20, 32.0, |_, _| -7.0));
        let pair = ImageAndCoarse { name: "a", image: &image, coarse: &coarse };
        let mut seen = vec![];
        let last = pair
            .refined(2, &mut |scene| {
                let mut dtm = scene.coarse_raster()?;
                seen.push((scene.pixel_m, scene.coarse_px, dtm.samples[0]));
                dtm.samples.iter_mut().for_each(|z| *z += 1.0);
                Ok(dtm)
            })
            .unwrap();
        assert_eq!(seen, [(8.0, 4.0, -7.0), (4.0, 2.0, -6.0)]);
        assert_eq!((last.pixel_m, last.coarse_px, last.coarse_raster().unwrap().samples[0]), (2.0, 2.0, -5.0));
        let refused = pair.refined(7, &mut |scene| scene.coarse_raster()).err().unwrap().to_string();
        assert!(refused.contains("a: expected at least 128 x 128 pixels, found 64 x 80"), "{refused}");
    }
}
