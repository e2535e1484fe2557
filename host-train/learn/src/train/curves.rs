//! Pictures of a run's two CSV files: training loss and validation.

use super::journal::{STEPS, VALIDATIONS};
use elunar_base::{Error, Result, read};
use elunar_picture::{Chart, Panel, Series, plot, sheet};
use std::path::Path;

/// File name of the picture in a run's folder.
pub const CURVES: &str = "curves.png";

/// Number of steps over which the loss is averaged for its second curve.
const SMOOTHED_STEPS: usize = 25;

/// Data of the curves. Points are (step, figure).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct History {
    /// Weighted training loss of every step.
    pub loss: Vec<(f64, f64)>,
    /// Validation: RMSE of the network, metres.
    pub rmse_m: Vec<(f64, f64)>,
    /// Validation: RMSE of the interpolated coarse DTM, metres.
    pub coarse_rmse_m: Vec<(f64, f64)>,
    /// Validation: mean absolute slope error of the network, degrees.
    pub slope_deg: Vec<(f64, f64)>,
    /// Validation: mean absolute slope error of the interpolated coarse DTM, degrees.
    pub coarse_slope_deg: Vec<(f64, f64)>,
}

impl History {
    /// Reads the journal of a run.
    ///
    /// # Errors
    /// [`Error::Io`] if a file cannot be read, [`Error::Broken`] if a column is missing or holds a value that is not a number.
    pub fn read(run: &Path) -> Result<Self> {
        let steps = run.join(STEPS);
        let found = run.join(VALIDATIONS);
        let (steps_text, found_text) = (text(&steps)?, text(&found)?);
        let of = |name| column(&found, &found_text, name);
        Ok(Self {
            loss: column(&steps, &steps_text, "loss")?,
            rmse_m: of("rmse_m")?,
            coarse_rmse_m: of("coarse_rmse_m")?,
            slope_deg: of("slope_mae_deg")?,
            coarse_slope_deg: of("coarse_slope_mae_deg")?,
        })
    }

    /// Writes the charts below each other as one PNG, whole or not at all. Charts without a point are left out. Without any chart, no file
    /// is written.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let one = |name: &str, points: &[(f64, f64)]| Series { name: name.into(), points: points.to_vec() };
        let mean = format!("mean of {SMOOTHED_STEPS} steps");
        let of_validation = |network: &[(f64, f64)], coarse: &[(f64, f64)]| {
            vec![one("network", network), one("coarse DTM, interpolated", coarse)]
        };
        let charts = [
            ("Training loss", "weighted loss", vec![one("each step", &self.loss), one(&mean, &smoothed(&self.loss))]),
            ("Validation: heights", "RMSE, m", of_validation(&self.rmse_m, &self.coarse_rmse_m)),
            (
                "Validation: slopes",
                "mean |slope error|, degrees",
                of_validation(&self.slope_deg, &self.coarse_slope_deg),
            ),
        ];
        let drawable = |series: &[Series]| series[0].points.iter().any(|(_, y)| y.is_finite());
        let panels: Result<Vec<Panel>> = charts
            .iter()
            .filter(|(_, _, series)| drawable(series))
            .map(|(title, y, series)| Ok(Panel::new("", plot(&Chart { title, x: "step", y, log_y: false }, series)?)))
            .collect();
        let panels = panels?;
        if panels.is_empty() { Ok(()) } else { elunar_picture::write_png(path, sheet(&panels, 1, u32::MAX)) }
    }
}

/// Draws the curves of a run into its folder.
///
/// # Errors
/// As [`History::read`] and [`History::write`].
pub fn draw(run: &Path) -> Result<()> {
    History::read(run)?.write(&run.join(CURVES))
}

fn text(path: &Path) -> Result<String> {
    read::text(path, read::MOST_BYTES)
}

/// Returns (step, value) of every row. The step is the first column.
fn column(path: &Path, text: &str, name: &str) -> Result<Vec<(f64, f64)>> {
    let mut lines = text.lines();
    let header = lines.next().unwrap_or_default();
    let index = header
        .split(',')
        .position(|column| column == name)
        .ok_or_else(|| Error::broken(path, format!("expected a column {name}, found {header}")))?;
    lines
        .map(|line| {
            let number = |index| line.split(',').nth(index).and_then(|cell: &str| cell.parse::<f64>().ok());
            let point = number(0).zip(number(index));
            point.ok_or_else(|| Error::broken(path, format!("expected numbers in step and {name}, found {line}")))
        })
        .collect()
}

/// Returns running means over [`SMOOTHED_STEPS`], each at its last step.
fn smoothed(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let mean = |window: &[(f64, f64)]| window.iter().map(|p| p.1).sum::<f64>() / window.len() as f64;
    let last = |window: &[(f64, f64)]| window.last().map_or(0.0, |p| p.0);
    points.windows(SMOOTHED_STEPS).map(|window| (last(window), mean(window))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(steps: &str, validations: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join(STEPS), steps).unwrap();
        std::fs::write(folder.path().join(VALIDATIONS), validations).unwrap();
        folder
    }

    const VALIDATION: &str = "step,rmse_m,slope_mae_deg,coarse_rmse_m,coarse_slope_mae_deg\n";

    #[test]
    fn columns_are_found_by_name() {
        let folder = run("step,learning_rate,loss\n1,0.1,5\n2,0.1,4\n", &format!("{VALIDATION}2,1,2,3,4\n"));
        let found = History::read(folder.path()).unwrap();
        assert_eq!(found.loss, [(1.0, 5.0), (2.0, 4.0)]);
        assert_eq!((found.slope_deg[0], found.coarse_rmse_m[0]), ((2.0, 2.0), (2.0, 3.0)));
        draw(folder.path()).unwrap();
        let all = image::open(folder.path().join(CURVES)).unwrap();
        std::fs::write(folder.path().join(VALIDATIONS), VALIDATION).unwrap();
        draw(folder.path()).unwrap();
        let loss_only = image::open(folder.path().join(CURVES)).unwrap();
        assert!(all.height() > 2 * loss_only.height(), "three charts, then one");
    }

    #[test]
    fn a_run_without_a_step_has_no_picture_and_a_broken_journal_is_named() {
        let folder = run("step,loss\n", VALIDATION);
        draw(folder.path()).unwrap();
        assert!(!folder.path().join(CURVES).exists());
        std::fs::write(folder.path().join(STEPS), "step,loss\n1,x\n").unwrap();
        let refused = draw(folder.path()).unwrap_err().to_string();
        assert!(refused.contains(STEPS) && refused.contains("1,x"), "{refused}");
    }

    #[test]
    fn means_stand_at_their_last_step() {
        let points: Vec<(f64, f64)> = (1..=30).map(|k| (f64::from(k), f64::from(k))).collect();
        let found = smoothed(&points);
        assert_eq!((found.len(), found[0]), (6, (25.0, 13.0)));
    }
}
