//! Brightness unlike that of the images that networks were trained on.

use super::super::ImageBrightness;
use super::percent;

/// Share of pixels with exactly the lowest or the highest value above which an image is clipped, or has voids without a nodata value.
const CLIPPED: f64 = 0.2;
/// Standard deviation of the brightness, as a share of its mean, below which an image is nearly constant. Of the synthetic scenes of the test
/// none has less than 0.02.
const CONSTANT: f64 = 5e-3;

/// Warns of clipped and of nearly constant images, and of values that are no brightness.
pub(super) fn suspected(name: &str, brightness: &ImageBrightness) -> Vec<String> {
    if brightness.pixels == 0 {
        return vec![];
    }
    let contrast = brightness.contrast();
    if contrast < CONSTANT {
        let contrast = percent(contrast);
        return vec![format!("{name}: nearly constant, brightness varies by {contrast}: it shows no relief")];
    }
    let mean = brightness.mean();
    let no_brightness = (mean <= 0.0).then(|| {
        // No minus before a zero.
        let mean = mean + 0.0;
        format!("{name}: mean {mean:.3}, expected above 0: not a brightness? Contrast is brightness over its mean, so this image shows none")
    });
    let ends = [("lowest", brightness.lowest()), ("highest", brightness.highest())];
    let clipped = ends.into_iter().filter(|(_, (_, share))| *share > CLIPPED);
    let warning = |(which, (value, share)): (&str, (f32, f64))| {
        // No minus before a zero.
        let (share, value) = (percent(share), value + 0.0);
        format!(
            "{name}: {share} of its pixels have the {which} value, {value}: clipped, or voids? If voids, say --image-nodata {value}"
        )
    };
    no_brightness.into_iter().chain(clipped.map(warning)).collect()
}
