//! A sensitivity as a table.

use super::sensitivity::Sensitivity;
use std::fmt;

impl fmt::Display for Sensitivity {
    /// Writes the table, sorted by the effect on slope.
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
