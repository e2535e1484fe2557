//! A job as words.

use super::{Made, Pass, TileJob, TileRules};
use crate::nn::InputRules;
use crate::norm::ElevationScale;
use crate::photoclinometry::{ExpectedErrors, GuideForm};
use crate::tile::Shape;
use crate::words::Words;

const PASSES: [Pass; 22] = {
    use Pass::*;
    [
        Take, FitMeasure, FitLit, Fit, Axis, FillCoarse, FillImage, Measure, Lit, Decide, Weigh, Relief, LoadImage,
        LoadCoarse, Network, Output, Check, Anchor, Fine, Settle, Keep, Finished,
    ]
};

impl TileJob {
    /// Number of words of a job.
    pub const WORDS: usize = 137;

    /// Returns the job as words.
    #[must_use]
    pub fn to_words(mut self) -> [u64; Self::WORDS] {
        let mut words = [0; Self::WORDS];
        self.visit(&mut Words::writing(&mut words));
        words
    }

    /// Returns the job of these words, for a network with these rules and a tile of this shape; `None` if they are not those of a job. Any words
    /// are harmless: the worst they can do is to make other heights.
    #[must_use]
    pub fn from_words(mut words: [u64; Self::WORDS], input: InputRules, tile: Shape) -> Option<Self> {
        let mut job = Self::new(TileRules { pixel_m: 0.0, coarse_px: 0.0, anchor: false, checked: false }, input, tile);
        let mut words = Words::reading(&mut words);
        job.visit(&mut words);
        words.is_legal().then_some(job)
    }

    /// Writes or reads it.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        let TileRules { pixel_m, coarse_px, anchor, checked } = &mut self.rules;
        words.f32(pixel_m);
        words.f32(coarse_px);
        words.bool(anchor);
        words.bool(checked);
        words.choice(&mut self.pass, &PASSES);
        words.u32(&mut self.unit);
        words.choice(&mut self.made, &[Made::Predicted, Made::Coarse, Made::Empty]);
        words.usize(&mut self.valid_px);
        words.bool(&mut self.has_gaps);
        words.bool(&mut self.has_image_gaps);
        self.fill.visit(words);
        self.coarse.visit(words);
        self.coarse_mean.visit(words);
        self.brightness.visit(words);
        self.fit.visit(words);
        self.field.visit(words);
        self.lighting.visit(words);
        words.option(&mut self.elevation, ElevationScale::NONE, ElevationScale::visit);
        words.option(&mut self.form, GuideForm::NONE, GuideForm::visit);
        words.option(&mut self.expected, ExpectedErrors::UNKNOWN, |errors, words| {
            let mut values = errors.to_values();
            values.iter_mut().for_each(|v| words.f32(v));
            *errors = ExpectedErrors::from_values(values);
        });
        self.fine.visit(words);
        self.seals.visit(words);
        words.option(&mut self.first_round, 0, |sum, words| words.u32(sum));
    }
}
