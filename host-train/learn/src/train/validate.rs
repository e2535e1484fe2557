//! Validation of the network on a fixed set of tiles that are not used for training. Baselines are the
//! interpolated coarse DTM and the pipeline without training.

use super::feed::tensors;
use super::recipe::TrainingTarget;
use super::sample::{Sample, untrained_m};
use super::source::TileSource;
use crate::model::elunar::ELunarDtmNet;
use burn::tensor::Device;
use elunar_base::{Error, Result};
use elunar_core::grid::GridView;
use elunar_core::metrics::{HeightErrors, RelativeErrors, SlopeErrors};
use elunar_core::norm::ElevationScale;
use elunar_core::terrain::PixelSize;
use elunar_core::tile::Shape;
use elunar_net::config::{NetConfig, TruthRange};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Scores of heights and slopes of one DTM against the target of training ([`TrainingTarget`]), over the whole set.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ValidationScores {
    /// Root mean square height error, metres.
    pub rmse_m: f64,
    /// Mean absolute height error, metres.
    pub mae_m: f64,
    /// Mean absolute slope error, degrees.
    pub slope_mae_deg: f64,
}

/// Result of a validation.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ValidationResult {
    /// RMSE in normalised units. It selects the best weights, as in the paper.
    pub rmse: f64,
    /// Mean relative difference REL, normalised units.
    pub rel: f64,
    /// Share of pixels with ratio below 1.25.
    pub a1: f64,
    /// Share of pixels with ratio below 1.25².
    pub a2: f64,
    /// Share of pixels with ratio below 1.25³.
    pub a3: f64,
    /// Mean |log10 z − log10 z*|.
    pub log10: f64,
    /// Peak signal-to-noise ratio, dB.
    pub psnr_db: f64,
    /// Scores of the network, in metres and degrees.
    pub network: ValidationScores,
    /// Scores of the interpolated coarse DTM, in metres and degrees.
    pub coarse: ValidationScores,
    /// Scores of the coarse DTM plus photoclinometry ([`untrained_m`]), the baseline of all learning; `None` in results of older programs.
    #[serde(default)]
    pub untrained: Option<ValidationScores>,
}

/// One validation tile: the normalised maps, and the target of training in metres.
struct Case {
    sample: Sample,
    /// Range for relative errors, if heights are not normalised to a range.
    range: Option<ElevationScale>,
    coarse_m: Vec<f32>,
    untrained_m: Vec<f32>,
    truth_m: Vec<f32>,
    pixel_m: f32,
}

/// A fixed set of tiles.
pub struct ValidationSet {
    cases: Vec<Case>,
}

impl ValidationSet {
    /// Makes a set of the first `count` tiles of `source` that can be normalised, compared with `target`.
    ///
    /// # Errors
    /// If tiles cannot be made, or none can be normalised.
    pub fn new(source: &dyn TileSource, config: &NetConfig, target: TrainingTarget, count: usize) -> Result<Self> {
        let cases: Result<Vec<Option<Case>>> = (0..count as u64)
            .into_par_iter()
            .map(|index| {
                let tile = target.of(source.tile(index)?)?;
                let sample = Sample::new(config, &tile).ok();
                let range = match config.target_range {
                    TruthRange::Pixel => ElevationScale::from_heights(&tile.coarse_m, None, config.nr).ok(),
                    _ => None,
                };
                Ok(sample.map(|sample| Case {
                    sample,
                    range,
                    untrained_m: untrained_m(&tile),
                    coarse_m: tile.coarse_m,
                    truth_m: tile.truth_m,
                    pixel_m: tile.pixel_m,
                }))
            })
            .collect();
        let cases: Vec<Case> = cases?.into_iter().flatten().collect();
        if cases.is_empty() {
            return Err(Error::input(format!("validation: expected usable tiles among {count}, found none")));
        }
        Ok(Self { cases })
    }

    /// Runs `net` (without gradients) on the set.
    ///
    /// # Errors
    /// If the network's output has the wrong size, or no finite height.
    pub fn run(&self, net: &ELunarDtmNet, device: &Device) -> Result<ValidationResult> {
        let mut relative = RelativeErrors::default();
        let [mut network, mut coarse, mut untrained] = [(); 3].map(|()| Tally::default());
        for case in &self.cases {
            let sample = &case.sample;
            let [image, input, _] = tensors(std::slice::from_ref(sample), device);
            let output = net.forward(image, input).into_data().try_to_vec::<f32>();
            let output = output.map_err(|e| Error::input(format!("network output: {e:?}")))?;
            let wrong = |e: &dyn std::fmt::Display| Error::input(format!("network output: {e}"));
            let mut output_m = output.clone();
            sample.scale.recover(Shape::new(sample.rows, sample.cols), &mut output_m);
            match &case.range {
                None => relative.extend(&sample.truth, &output, None).map_err(|e| wrong(&e))?,
                Some(range) => {
                    let (mut truth, mut found) = (vec![0.0; output.len()], vec![0.0; output.len()]);
                    range.normalise(&case.truth_m, &mut truth).map_err(|e| wrong(&e))?;
                    range.normalise(&output_m, &mut found).map_err(|e| wrong(&e))?;
                    relative.extend(&truth, &found, None).map_err(|e| wrong(&e))?;
                }
            }
            network.add(case, &output_m)?;
            coarse.add(case, &case.coarse_m)?;
            untrained.add(case, &case.untrained_m)?;
        }
        let none = || Error::input("validation: the network's output has no finite height");
        let [a1, a2, a3] = relative.share_within_ratio().ok_or_else(none)?;
        Ok(ValidationResult {
            rmse: relative.rmse().ok_or_else(none)?,
            rel: relative.rel().ok_or_else(none)?,
            a1,
            a2,
            a3,
            log10: relative.log10().ok_or_else(none)?,
            psnr_db: relative.psnr_db().ok_or_else(none)?,
            network: network.scores().ok_or_else(none)?,
            coarse: coarse.scores().ok_or_else(none)?,
            untrained: untrained.scores(),
        })
    }
}

#[derive(Default)]
struct Tally {
    heights: HeightErrors,
    slopes: SlopeErrors,
}

impl Tally {
    fn add(&mut self, case: &Case, dtm_m: &[f32]) -> Result<()> {
        let wrong = |e: elunar_core::error::LengthError| Error::input(format!("validation tile: {e}"));
        let (rows, cols) = (case.sample.rows, case.sample.cols);
        let view = |map| GridView::new(map, rows, cols).map_err(wrong);
        self.heights.extend(&case.truth_m, dtm_m, None).map_err(wrong)?;
        let pixel = PixelSize::square(f64::from(case.pixel_m));
        self.slopes.extend(view(&case.truth_m)?, view(dtm_m)?, pixel).map_err(wrong)
    }

    fn scores(&self) -> Option<ValidationScores> {
        Some(ValidationScores {
            rmse_m: self.heights.rmse_m()?,
            mae_m: self.heights.mae_m()?,
            slope_mae_deg: self.slopes.mae_deg()?,
        })
    }
}
