//! Picture of a sensitivity.

use elunar_base::Result;
use elunar_net::export::sensitivity::{Effect, Layer, Sensitivity};
use elunar_picture::{Bars, bars};
use image::RgbImage;

/// Number of layers in a picture, those with the largest effect.
const BARS: usize = 40;

/// Draws a bar chart of the layers with the largest effect on slope.
///
/// # Errors
/// [`elunar_base::Error::Usage`] if no layer has an effect.
pub fn picture(sensitivity: &Sensitivity) -> Result<RgbImage> {
    let degrees = |effect: Option<Effect>| effect.map(|e| e.slope_rmse_deg);
    let line = |l: &&Layer| {
        let kept = l.bits.map_or_else(String::new, |bits| format!(" ({bits})"));
        (format!("{}{kept}", l.name), vec![degrees(l.map8), degrees(l.map16), degrees(l.weights8)])
    };
    let ranked = sensitivity.ranked();
    let lines: Vec<_> = ranked.iter().take(BARS).map(line).collect();
    let title = format!(
        "Slope, degrees rms against float, one rounding at a time ({} of {} layers, {} tiles)",
        lines.len(),
        ranked.len(),
        sensitivity.tiles
    );
    bars(&Bars { title: &title, legend: &["map in 8 bits", "map in 16 bits", "weights in 8 bits"], lines })
}
