//! The light of a scene: what its tiles show of it, added up, and the decision.

use crate::begin::{job_of, stated_sun};
use crate::context::{Context, Lent, Outcome};
use crate::record::{DROPPED, EMPTY, SURVEY};
use crate::run::job_status;
use crate::sealed::{read_survey, write_job, write_survey};
use crate::status::*;
use crate::tile::CallerTile;
use crate::types::{
    ELD_SOURCE_ASSUMED, ELD_SOURCE_FITTED, ELD_SOURCE_GIVEN, ELD_SOURCE_NOT_ASKED, eld_lighting_t, eld_status_t,
};
use elunar_core::Progress;
use elunar_core::job::LightSurvey;
use elunar_core::nn::{Illumination, LightSource, Lighting, Model};
use elunar_core::norm::Light;

/// Adds what a tile shows, a bounded piece of work at a time.
pub(crate) fn add(
    context: &mut Context<'_>,
    model: Model<'_>,
    mut lent: Lent<'_>,
    tile: &CallerTile<'_>,
    budget_macs: u64,
) -> Outcome {
    let mut job = job_of(context, &model, lent.job, tile, (SURVEY, true))?;
    let surveyed = job.survey(&tile.input(), &mut lent.tile, budget_macs).map_err(job_status)?;
    write_job(lent.job, &job);
    if surveyed == Progress::Running {
        return Ok(ELD_RUNNING);
    }
    context.record.tile = EMPTY;
    let mut all = survey(context, lent.survey)?;
    all.add(&job.shown());
    write_survey(lent.survey, &all);
    context.record.lights_added = context.record.lights_added.saturating_add(1);
    Ok(if context.record.notices & DROPPED != 0 { ELD_NOTICE_DROPPED } else { ELD_OK })
}

/// Returns what all tiles showed.
///
/// # Errors
/// [`ELD_FAULT_LIGHT`] if both copies are damaged.
fn survey(context: &mut Context<'_>, block: &[u8]) -> Result<LightSurvey, eld_status_t> {
    if context.record.lights_added == 0 {
        return Ok(LightSurvey::default());
    }
    let (survey, damaged) = read_survey(block).ok_or(ELD_FAULT_LIGHT)?;
    context.repaired(damaged);
    Ok(survey)
}

/// Decides the light of the scene.
pub(crate) fn decide(
    context: &mut Context<'_>,
    model: &Model<'_>,
    lent: Lent<'_>,
    (azimuth_deg, elevation_deg): (f32, f32),
    struct_bytes: u32,
) -> Result<eld_lighting_t, eld_status_t> {
    let sun = stated_sun(azimuth_deg, elevation_deg)?;
    let survey = survey(context, lent.survey)?;
    if context.record.lights_added > 0 {
        // Repairs a damaged copy.
        write_survey(lent.survey, &survey);
    }
    Ok(for_c(&survey.decide(model.illumination(), sun), struct_bytes))
}

/// Forgets what was added.
pub(crate) fn clear(context: &mut Context<'_>) -> Outcome {
    context.record.lights_added = 0;
    Ok(ELD_OK)
}

fn for_c(lighting: &Lighting, struct_bytes: u32) -> eld_lighting_t {
    let Lighting { light, source, trust, related, long_share, log_strength_sd, azimuth_sd_deg } = *lighting;
    eld_lighting_t {
        struct_bytes,
        source: match source {
            LightSource::NotAsked => ELD_SOURCE_NOT_ASKED,
            LightSource::Given => ELD_SOURCE_GIVEN,
            LightSource::Fitted => ELD_SOURCE_FITTED,
            LightSource::Assumed => ELD_SOURCE_ASSUMED,
        },
        east: light.east,
        south: light.south,
        trust,
        related,
        long_share: long_share.unwrap_or(f32::NAN),
        log_strength_sd,
        azimuth_sd_deg,
    }
}

/// Returns the light of a caller for a network.
///
/// # Errors
/// [`ELD_REFUSED_TILE_LIGHT`] for numbers that no decision gives.
pub(crate) fn of_c(c: &eld_lighting_t, illumination: Illumination) -> Result<Lighting, eld_status_t> {
    let eld_lighting_t { east, south, trust, related, long_share, log_strength_sd, azimuth_sd_deg, .. } = *c;
    let source = match c.source {
        ELD_SOURCE_NOT_ASKED => LightSource::NotAsked,
        ELD_SOURCE_GIVEN => LightSource::Given,
        ELD_SOURCE_FITTED => LightSource::Fitted,
        ELD_SOURCE_ASSUMED => LightSource::Assumed,
        _ => return Err(ELD_REFUSED_TILE_LIGHT),
    };
    let long_share = (!long_share.is_nan()).then_some(long_share);
    let shares = [Some(trust), Some(related), long_share];
    let legal = shares.iter().flatten().all(|share| (0.0..=1.0).contains(share))
        && [east, south].iter().all(|v| v.is_finite())
        && (east != 0.0 || south != 0.0)
        && log_strength_sd >= 0.0
        && log_strength_sd.is_finite()
        && (0.0..=180.0).contains(&azimuth_sd_deg)
        && (source == LightSource::NotAsked) == (illumination == Illumination::Any);
    let light = Light { east, south };
    let lighting = Lighting { light, source, trust, related, long_share, log_strength_sd, azimuth_sd_deg };
    if legal { Ok(lighting) } else { Err(ELD_REFUSED_TILE_LIGHT) }
}
