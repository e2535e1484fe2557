//! What a report says beyond the scores.

use super::spectral::{Spectral, spectral};
use super::{Calibration, Comparison};

/// Further figures of a comparison. What is absent is left out of the report.
#[derive(Debug, Clone, Default)]
pub struct Details {
    /// Coverage of the first candidate's expected errors.
    pub calibration: Option<Calibration>,
    /// Spectra of every candidate; empty if they were not computed.
    pub spectra: Vec<Option<Spectral>>,
}

impl Details {
    /// Returns the details that need nothing but the comparison.
    #[must_use]
    pub fn of(comparison: &Comparison) -> Self {
        let spectra = comparison.scored.iter().map(|scored| spectral(comparison, scored)).collect();
        Self { calibration: None, spectra }
    }
}
