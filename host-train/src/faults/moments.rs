//! A clean run, and its memory at some moments.

use elunar_base::digest::sha256_hex;
use elunar_base::{Error, Result};
use elunar_core::job::{TileInput, TileJob, TileRules, TileScale};
use elunar_core::nn::{Kernel, KnownSun, Model, Progress, RunError, Runner, Suspended, TileLight, Verdict, required};
use elunar_core::tile::Shape;
use elunar_net::job::JobMemory;
use elunar_scene::predict::int8::Int8Model;
use elunar_scene::predict::network::TileModel as _;
use elunar_synth::{COARSE_PIXEL_M, Moon, SynthOptions};
use std::collections::BTreeMap;
use std::fmt::Display;

/// Multiply-accumulates per step.
pub(super) const STEP_MACS: u64 = 20_000_000;

/// The memory at a moment.
pub struct Moment {
    /// Position of the run.
    pub place: Suspended,
    /// The arena.
    pub arena: Vec<u8>,
    /// Kind of the current operator.
    pub operator: &'static str,
}

/// A clean run of a tile.
pub struct Moments {
    /// The moments: the even ones in order, then the others.
    pub moments: Vec<Moment>,
    /// Scale recovery of the tile.
    pub scale: TileScale,
    /// Heights of the clean run, metres.
    pub heights_m: Vec<f32>,
    /// Result of the model's validation.
    pub verdict: Verdict,
    /// Whether the runner checks its memory.
    pub protected: bool,
}

impl Moments {
    /// Returns the SHA-256 of the clean run's heights. A library with other results makes another campaign.
    #[must_use]
    pub fn digest(&self) -> String {
        sha256_hex(self.heights_m.iter().flat_map(|z| z.to_le_bytes()).collect::<Vec<_>>())
    }

    /// Runs a tile of the synthetic Moon of `seed` and saves its memory at `count` moments. The first is directly after the start. The
    /// others lie within operators, evenly spread over the multiply-accumulates. Every kind of operator without a moment gets one more, and
    /// so does the comparison of the model.
    ///
    /// # Errors
    /// If the model cannot take such a tile.
    pub fn record(model: &Int8Model, seed: u64, count: usize, protected: bool) -> Result<Self> {
        let Shape { rows, cols } = model.tile();
        let options = SynthOptions { rows, cols, ..SynthOptions::default() };
        let tile = Moon::new(seed, options)?.tile(0);
        let model = model.model();
        let coarse_px = (COARSE_PIXEL_M / tile.pixel_m) as f32;
        let (azimuth_deg, elevation_deg) = (Some(tile.sun_azimuth_deg), Some(tile.sun_elevation_deg));
        let (image, coarse_m) = (&tile.image[..], &tile.coarse_m[..]);
        let light = TileLight::Own(KnownSun { azimuth_deg, elevation_deg });
        let input = TileInput { image, coarse_m, inside: model.tile(), light };
        let mut arena = vec![0; required(&model)];
        let mut runner = Runner::new(model, &mut arena).map_err(fault)?;
        runner.protect(protected);
        let rules = TileRules { pixel_m: tile.pixel_m as f32, coarse_px, anchor: true, checked: false };
        let (mut memory, mut job) = (JobMemory::default(), TileJob::new(rules, model.input_rules(), model.tile()));
        let mut memory = memory.lend(&model.input_rules(), model.tile());
        let unusable = |e: &dyn Display| Error::input(format!("faults: the tile: {e}"));
        while job.prepare(&mut runner, &input, &mut memory, u64::MAX).map_err(|e| unusable(&e))? == Progress::Running {}
        let scale = job.scale().ok_or_else(|| unusable(&"no relief or no contrast"))?;
        let mut place = runner.suspend();
        let kernel = Kernel::best();
        let (mut moments, mut first) = (Vec::with_capacity(count), BTreeMap::new());
        let (mut next_macs, distance) = (0, model.macs() / count.max(1) as u64);
        loop {
            let mut runner = Runner::resume(kernel, model, &mut arena, &place).map_err(fault)?;
            // A unit at a time: the shortest operators have a single one.
            let finished = runner.step(1).map_err(fault)?;
            place = runner.suspend();
            let operator = operator_at(&model, &place);
            if finished == Progress::Done {
                break;
            }
            let now = || Moment { place, arena: arena.clone(), operator };
            first.entry(operator).or_insert_with(now);
            if place.telemetry.macs >= next_macs && moments.len() < count {
                moments.push(now());
                next_macs += distance.max(1);
            }
        }
        let missed = first.into_values().filter(|one| moments.iter().all(|other| other.operator != one.operator));
        let missed: Vec<Moment> = missed.collect();
        moments.extend(missed);
        let mut heights_m = vec![0.0; rows * cols];
        let runner = Runner::resume(kernel, model, &mut arena, &place).map_err(fault)?;
        runner.output(&mut heights_m).map_err(fault)?;
        scale.recover(model.tile(), &mut heights_m);
        Ok(Self { moments, scale, heights_m, verdict: model.verdict(), protected })
    }
}

fn operator_at(model: &Model<'_>, place: &Suspended) -> &'static str {
    let entry = model.entry(place.entry as usize).filter(|_| place.phase == Suspended::AT_WORK);
    entry.and_then(|entry| model.operator(entry.operator)).map_or("verification", |operator| operator.name())
}

/// Converts a runner's error.
fn fault(error: RunError) -> Error {
    Error::input(format!("faults: {error}"))
}
