//! A sensitivity as a table and as a picture.

use super::sensitivity::{Effect, Layer, Sensitivity};
use crate::Result;
use crate::picture::{Bars, bars};
use image::RgbImage;
use std::fmt;

/// Layers in a picture: those with the largest effect.
const BARS: usize = 40;

/// A bar chart of the layers with the largest effect on slope.
///
/// # Errors
/// [`Error::Usage`](crate::Error::Usage) if nothing has any effect.
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

impl fmt::Display for Sensitivity {
    /// The table, sorted by the effect on slope.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "one rounding at a time, on {} tiles: difference to float in metres and degrees of slope, growth of the slope error",
            self.tiles
        )?;
        writeln!(
            f,
            "{:44} {:17} {:>4}  {:^25}  {:^25}  {:^25}",
            "", "", "", "map in 8 bits", "map in 16", "weights in 8"
        )?;
        write!(f, "{:44} {:17} {:>4}", "layer", "map", "bits")?;
        for _ in 0..3 {
            write!(f, "  {:>8} {:>8} {:>7}", "m", "deg", "growth")?;
        }
        write!(f, " {:>9}", "cut ppm")?;
        for layer in self.ranked() {
            let [rows, cols, channels] = layer.shape;
            let bits = layer.bits.map_or_else(|| "f32".into(), |bits| bits.to_string());
            write!(f, "\n{:44} {:17} {bits:>4}", layer.name, format!("[{rows}, {cols}, {channels}]"))?;
            for effect in [layer.map8, layer.map16, layer.weights8] {
                match effect {
                    None => write!(f, "  {:>8} {:>8} {:>7}", "-", "-", "-")?,
                    Some(e) => write!(
                        f,
                        "  {:>8.5} {:>8.5} {:>6.2}%",
                        e.rmse_m, e.slope_rmse_deg, e.slope_error_growth_percent
                    )?,
                }
            }
            let cut = layer.map8.or(layer.map16).map_or_else(|| "-".into(), |e| format!("{:.1}", e.cut_ppm));
            write!(f, " {cut:>9}")?;
        }
        let (all, of) = (&self.predicted, (self.float_error_m, self.float_slope_error_deg));
        write!(
            f,
            "\nall of them as kept, if independent: {:.3} m, {:.3} deg; errors of {:.3} m and {:.3} deg grow by {:.2} % and {:.2} %",
            all.rmse_m, all.slope_rmse_deg, of.0, of.1, all.error_growth_percent, all.slope_error_growth_percent
        )
    }
}
