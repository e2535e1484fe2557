//! What a report says beyond the scores.

use super::Calibration;

/// Further figures of a comparison. What is absent is left out of the report.
#[derive(Debug, Clone, Default)]
pub struct Details {
    /// Coverage of the first candidate's expected errors.
    pub calibration: Option<Calibration>,
}
