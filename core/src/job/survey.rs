//! What the tiles of a scene show of its light.

use super::{JobError, Made, Pass, TileInput, TileJob, TileMemory};
use crate::error::{LengthError, same_length};
use crate::nn::{Illumination, KnownSun, Lighting, Progress, RunError, TileLight};
use crate::norm::LightFit;
use crate::photoclinometry::{Contrast, Photoclinometry};
use crate::samples::Samples;
use crate::words::Words;

/// What tiles show of the light that they have in common: a scene, and so a strip, has one light, which is decided before its tiles are made.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LightSurvey {
    fit: LightFit,
    contrast: Contrast,
}

impl LightSurvey {
    /// Number of words of a survey.
    pub const WORDS: usize = 52;

    /// Adds what other tiles show.
    pub fn add(&mut self, other: &Self) {
        self.fit.add_fit(&other.fit, 1.0);
        self.contrast.add(&other.contrast);
    }

    /// Decides the light of all tiles for a network ([`Lighting::decide`]).
    #[must_use]
    pub fn decide(&self, illumination: Illumination, sun: KnownSun) -> Lighting {
        Lighting::decide(illumination, sun, &self.fit())
    }

    /// Returns the fit to all tiles, with the axis that their images show.
    #[must_use]
    pub fn fit(&self) -> LightFit {
        self.fit.with_axis(self.contrast.axis())
    }

    /// Returns the survey as words.
    #[must_use]
    pub fn to_words(mut self) -> [u64; Self::WORDS] {
        let mut words = [0; Self::WORDS];
        self.visit(&mut Words::writing(&mut words));
        words
    }

    /// Returns the survey of these words; `None` if they are not those of one.
    #[must_use]
    pub fn from_words(mut words: [u64; Self::WORDS]) -> Option<Self> {
        let mut survey = Self::default();
        let mut words = Words::reading(&mut words);
        survey.visit(&mut words);
        words.is_legal().then_some(survey)
    }

    fn visit(&mut self, words: &mut Words<'_>) {
        self.fit.visit(words);
        self.contrast.visit(words);
    }
}

impl TileJob {
    /// Finds what a tile shows of the light, instead of preparing it: takes its samples and fits its light. Does at least one unit of work, and
    /// further ones until their cost, about that of so many multiply-accumulates, reaches `budget`. `tile` and `memory` are the same in all
    /// calls; the light of `tile` is not used.
    ///
    /// # Errors
    /// [`JobError::Length`], [`JobError::Changed`].
    pub fn survey<S: Samples, C: Samples>(
        &mut self,
        tile: &TileInput<S, C>,
        memory: &mut TileMemory<'_>,
        budget: u64,
    ) -> Result<Progress, JobError<RunError>> {
        memory.check(&self.input, self.tile).map_err(JobError::Length)?;
        for found in [tile.image.len(), tile.coarse_m.len()] {
            same_length(self.tile.pixels(), found).map_err(JobError::Length)?;
        }
        let tile = TileInput { light: TileLight::default(), ..*tile };
        self.guarded(memory, budget.max(1), |job, memory, mut spent| {
            while job.pass != Pass::Finished && spent < budget.max(1) {
                spent += job.survey_unit(&tile, memory).map_err(JobError::Length)?;
            }
            Ok(if job.pass == Pass::Finished { Progress::Done } else { Progress::Running })
        })
    }

    /// Does a unit of a survey; returns its cost.
    fn survey_unit<S: Samples, C: Samples>(
        &mut self,
        tile: &TileInput<S, C>,
        memory: &mut TileMemory<'_>,
    ) -> Result<u64, LengthError> {
        Ok(match self.pass {
            Pass::Take => self.take(tile, memory),
            Pass::Axis => self.axis(tile.image, memory)?.unwrap_or_else(|| self.end_survey()),
            Pass::FitMeasure | Pass::FitLit | Pass::Fit => self.fit_unit(tile.image, memory)?,
            // The network takes no light.
            _ => self.end_survey(),
        })
    }

    /// Returns what the tile shows, once [`Self::survey`] is done.
    #[must_use]
    pub fn shown(&self) -> LightSurvey {
        let has_contrast = self.field.pass > 0;
        let contrast =
            if has_contrast { Photoclinometry::new(self.tile).measured(&self.field) } else { Contrast::default() };
        LightSurvey { fit: self.fit, contrast }
    }

    /// Ends the survey: there are no heights.
    fn end_survey(&mut self) -> u64 {
        self.made = Made::Empty;
        self.to(Pass::Finished);
        1
    }
}
