//! Pixels unlike those that networks were trained on.

/// Sides of a coarse pixel, in pixels of the image, without a warning. Networks were trained on 12 to 59. On synthetic scenes whose coarse DTM is
/// a mean of the truth, slope errors are within a sixth of their least from 8 to 80; outside the range of this constant they rise steeply.
const COARSE_PX: std::ops::RangeInclusive<f32> = 4.0..=120.0;

/// Warns of a coarse DTM that is nearly as fine as the image, or so coarse that a tile has only a few of its pixels.
pub(super) fn suspected(image: &str, coarse: &str, coarse_px: f32) -> Option<String> {
    (!COARSE_PX.contains(&coarse_px)).then(|| {
        format!(
            "{coarse}: its pixels are {coarse_px:.1} pixels of {image} wide, those of the training scenes are 12 to 59: expect less"
        )
    })
}
