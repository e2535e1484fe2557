//! Bit flips in the memory of a strip, between any two of its calls.

use super::injection::{Injection, InjectionTarget};
use super::journal::CampaignJournal;
use super::outcome::{FaultOutcome, LIMIT_M, Tried};
use super::run::{Campaign, repeat};
use super::table::CampaignResults;
use elunar_base::digest::sha256_hex;
use elunar_base::{Error, Result};
use elunar_core::nn::{KnownSun, Lighting, Model, Runner};
use elunar_core::norm::LightFit;
use elunar_core::pixels::{PixelForm, PixelFormat};
use elunar_core::strip::{
    LineErrors, Next, PostGrid, Strip, StripCounters, StripMemory, StripPaused, StripPlan, StripSettings,
};
use elunar_scene::predict::int8::Int8Model;
use elunar_synth::{COARSE_PIXEL_M, Moon, SynthOptions, SynthScene};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Lines of the strip beyond a tile: two rows of tiles, which overlap.
const MORE_LINES: usize = 44;
/// Multiply-accumulates per step, so few that a tile is prepared and finished in many.
const BUDGET: u64 = 4_000_000;
/// Multiply-accumulates per step of the network, whose memory is not hit here.
const NETWORK_BUDGET: u64 = 400_000_000;

/// What a strip keeps between two calls, and its caller.
#[derive(Clone)]
struct Kept {
    paused: StripPaused,
    arena: Vec<u8>,
    bytes: Vec<u8>,
    samples: Vec<f32>,
    lines: usize,
    post_rows: usize,
    taken: usize,
}

/// What a network changes.
type Network = (StripPaused, Vec<u8>);

/// A clean run of a strip, with its memory at some moments.
pub struct StripCampaign<'a> {
    model: &'a Int8Model,
    plan: StripPlan,
    image: Vec<u8>,
    posts: Vec<f32>,
    grid: PostGrid,
    lines: usize,
    /// The kept memory, and the call that comes next.
    moments: Vec<(Kept, &'static str)>,
    /// The memory before and after the network of each tile of the clean run. Nothing else changes meanwhile, so a run that begins a network with
    /// the same memory goes on behind it.
    networks: Vec<[Network; 2]>,
    /// Heights, their expected errors and origins of the clean run, line by line.
    clean: Vec<f32>,
    calls: usize,
}

impl<'a> StripCampaign<'a> {
    /// Runs a strip of the synthetic Moon of `seed`, as wide as a tile, and saves its memory at `count` moments.
    ///
    /// # Errors
    /// If the model cannot take such a strip.
    pub fn record(model: &'a Int8Model, seed: u64, count: usize) -> Result<Self> {
        let unusable = |e: &dyn std::fmt::Display| Error::input(format!("faults: the strip: {e}"));
        let tile = model.model().tile();
        let lines = tile.rows + MORE_LINES;
        let scene = Moon::new(seed, SynthOptions::default())?.scene(0, lines, tile.cols)?;
        let (settings, grid) = settings(&model.model(), &scene);
        let plan = StripPlan::new(&model.model(), settings).map_err(|e| unusable(&e))?;
        let image = scene.image.iter().flat_map(|v| (*v as u16).to_le_bytes()).collect();
        let posts = scene.coarse.heights_m.clone();
        let (moments, networks, clean) = (vec![], vec![], vec![]);
        let mut all = Self { model, plan, image, posts, grid, lines, moments, networks, clean, calls: usize::MAX };
        let kept = all.begin()?;
        let (mut moments, mut now) = (vec![], kept.clone());
        let mut run = LineRun::default();
        while let Some(call) = all.call(&mut now, &mut run) {
            moments.push(call);
        }
        (all.calls, all.clean) = (moments.len(), std::mem::take(&mut run.made));
        // Again, with the memory put aside before evenly spread calls: half of them steps, the others lines in and out.
        let is_step = |call: &str| ["tile", "network"].contains(&call);
        let steps: Vec<bool> = moments.iter().map(|call| is_step(call)).collect();
        let wanted = |call: usize| {
            let kind = steps.iter().filter(|step| **step == steps[call]).count();
            let before = steps[..call].iter().filter(|step| **step == steps[call]).count();
            before * count / (2 * kind) != (before + 1) * count / (2 * kind)
        };
        let (mut saved, mut networks, mut now): (Vec<_>, Vec<[Network; 2]>, _) = (vec![], vec![], kept);
        for (number, call) in moments.iter().enumerate() {
            if wanted(number) {
                saved.push((now.clone(), *call));
            }
            let network = |kept: &Kept| (kept.paused, kept.arena.clone());
            let begins = *call == "network" && number.checked_sub(1).is_some_and(|before| moments[before] != "network");
            if begins {
                networks.push([network(&now), network(&now)]);
            }
            all.call(&mut now, &mut run);
            if let Some([_, after]) = networks.last_mut().filter(|_| *call == "network") {
                *after = network(&now);
            }
        }
        (all.moments, all.networks) = (saved, networks);
        Ok(all)
    }

    /// Number of moments.
    #[must_use]
    pub fn moments(&self) -> usize {
        self.moments.len()
    }

    /// Returns the SHA-256 of the clean run's heights and errors.
    #[must_use]
    pub fn digest(&self) -> String {
        sha256_hex(self.clean.iter().flat_map(|z| z.to_le_bytes()).collect::<Vec<_>>())
    }

    fn begin(&self) -> Result<Kept> {
        let plan = &self.plan;
        let (mut arena, mut bytes) = (vec![0; plan.arena_bytes()], vec![0; plan.bytes_len()]);
        let (mut samples, mut sums) = (vec![0.0; plan.samples_len()], vec![0.0; plan.sums_len()]);
        let memory = StripMemory { bytes: &mut bytes, samples: &mut samples, sums: &mut sums };
        let runner = Runner::new(self.model.model(), &mut arena).map_err(|e| Error::input(e.to_string()))?;
        let paused = Strip::new(*plan, runner, memory).map_err(|e| Error::input(e.to_string()))?.pause();
        Ok(Kept { paused, arena, bytes, samples, lines: 0, post_rows: 0, taken: 0 })
    }

    /// Makes the call that a strip needs; returns its name, or `None` if the strip is at its end.
    fn call(&self, kept: &mut Kept, run: &mut LineRun) -> Option<&'static str> {
        let Kept { paused, arena, bytes, samples, lines, post_rows, taken } = kept;
        if let Some([_, after]) = self.networks.iter().find(|[before, _]| before.0 == *paused && before.1 == *arena) {
            (*paused, *arena) = after.clone();
            return Some("network");
        }
        run.sums.resize(self.plan.sums_len(), 0.0);
        let memory = StripMemory { bytes, samples, sums: &mut run.sums };
        let runner = Runner::resume(self.model.kernel(), self.model.model(), arena, &paused.runner).ok()?;
        let mut strip = Strip::resume(self.plan, runner, memory, paused).ok()?;
        let cols = self.plan.settings().cols;
        let name = match strip.wants() {
            Next::Step => {
                let is_running = strip.is_running();
                strip.step(if is_running { NETWORK_BUDGET } else { BUDGET });
                if is_running { "network" } else { "tile" }
            }
            Next::Posts => {
                match self.posts.chunks_exact(self.grid.cols).nth(*post_rows) {
                    Some(row) => strip.push_posts(row).ok()?,
                    None => strip.finish_posts(),
                }
                *post_rows += 1;
                "push"
            }
            Next::Push if *lines < self.lines => {
                strip.push_pixels(&self.image[2 * cols * *lines..][..2 * cols], &[]).ok()?;
                *lines += 1;
                "push"
            }
            Next::Push => {
                strip.finish();
                "push"
            }
            Next::Done if strip.ready() == 0 => return None,
            Next::Take | Next::Done => {
                let mut line = vec![0.0; 3 * cols];
                let mut origin = vec![0; cols];
                let (line_m, rest) = line.split_at_mut(cols);
                let (height_m, slope) = rest.split_at_mut(cols);
                strip.take_line_with(line_m, LineErrors { height_m, slope, origin: &mut origin }).ok()?;
                run.made.extend(line);
                run.made.extend(origin.iter().map(|code| f32::from(*code)));
                *taken += 1;
                "take"
            }
        };
        *paused = strip.pause();
        Some(name)
    }

    /// Returns the bytes of a target, from the begin of its block.
    fn place(&self, target: InjectionTarget) -> std::ops::Range<usize> {
        let [lines, posts, means, errors, valid] = self.plan.parts();
        match target {
            InjectionTarget::Lines => lines,
            InjectionTarget::Posts => posts,
            InjectionTarget::Means => means,
            InjectionTarget::Errors => errors,
            InjectionTarget::Valid => valid,
            _ => 0..4 * self.plan.samples_len(),
        }
    }

    fn try_one(&self, injection: &Injection, run: &mut LineRun) -> FaultOutcome {
        let Some((kept, _)) = self.moments.get(injection.moment) else { return FaultOutcome::Masked };
        let mut kept = kept.clone();
        let first = kept.taken;
        if injection.target == InjectionTarget::Buffers {
            flip_floats(injection, &mut kept.samples);
        } else {
            injection.flip(&mut kept.bytes);
        }
        run.made.clear();
        let ended = catch_unwind(AssertUnwindSafe(|| {
            let calls = (0..2 * self.calls).take_while(|_| self.call(&mut kept, run).is_some()).count();
            calls < 2 * self.calls
        }));
        match ended {
            Err(_) => FaultOutcome::Crash,
            Ok(false) => FaultOutcome::Hang,
            Ok(true) => self.compare(first, &run.made, &kept.paused.counters()),
        }
    }

    /// Compares heights, errors and origins with those of the clean run.
    fn compare(&self, first: usize, made: &[f32], counters: &StripCounters) -> FaultOutcome {
        let cols = self.plan.settings().cols;
        let clean = self.clean.get(4 * cols * first..).unwrap_or_default();
        let told = counters.pieces_lost + counters.memory_faults + counters.tiles_again > 0;
        // Without a report every bit counts. A void counts as a difference.
        let limit = if told { LIMIT_M } else { 0.0 };
        let near = |(a, b): (&f32, &f32)| a.is_nan() && b.is_nan() || (a - b).abs() <= limit;
        let same = made.len() == clean.len() && made.iter().zip(clean).all(near);
        match (told, same) {
            (true, true) => FaultOutcome::Recovered,
            (true, false) => FaultOutcome::Reported,
            (false, true) => FaultOutcome::Masked,
            (false, false) => FaultOutcome::Silent,
        }
    }
}

/// What a thread needs to run a strip: memory for sums, and the lines that have left.
#[derive(Debug, Default)]
struct LineRun {
    sums: Vec<f64>,
    made: Vec<f32>,
}

fn settings(model: &Model<'_>, scene: &SynthScene) -> (StripSettings, PostGrid) {
    let (step, coarse) = (scene.pixel_m / COARSE_PIXEL_M, &scene.coarse);
    let grid = PostGrid {
        cols: coarse.cols,
        row0: -coarse.south_m / COARSE_PIXEL_M + 0.5 * step - 0.5,
        rows_per_line: step,
        col0: -coarse.east_m / COARSE_PIXEL_M + 0.5 * step - 0.5,
        cols_per_px: step,
    };
    let sun = KnownSun { azimuth_deg: Some(scene.sun_azimuth_deg), elevation_deg: Some(scene.sun_elevation_deg) };
    let settings = StripSettings {
        cols: scene.cols,
        ring_lines: StripPlan::least_lines(model),
        overlap_px: 100,
        pixel_m: scene.pixel_m as f32,
        coarse_px: (COARSE_PIXEL_M / scene.pixel_m) as f32,
        anchor: true,
        checked: false,
        light: Lighting::decide(model.illumination(), sun, &LightFit::default()),
        pixels: PixelForm { format: PixelFormat::U16Le, ..PixelForm::F32 },
        posts: Some(grid),
        expected_errors: true,
    };
    (settings, grid)
}

/// Flips the bits of an injection in floats.
fn flip_floats(injection: &Injection, values: &mut [f32]) {
    for &bit in &injection.bits[..injection.count()] {
        values[bit / 32] = f32::from_bits(values[bit / 32].to_bits() ^ 1 << (bit % 32));
    }
}

/// Runs the injections of a campaign that its journal lacks, as [`super::run`].
///
/// # Errors
/// As [`super::run`].
pub fn run_strip(
    strip: &StripCampaign<'_>,
    campaign: &Campaign,
    journal: Option<&CampaignJournal>,
    progress: impl Fn() + Sync,
) -> Result<CampaignResults> {
    repeat(campaign, journal, progress, || {
        let mut run = LineRun::default();
        move |index| {
            let place = |target| strip.place(target);
            let injection = Injection::draw(&InjectionTarget::STRIP, place, strip.moments(), campaign.seed, index);
            let outcome = strip.try_one(&injection, &mut run);
            let operator = strip.moments.get(injection.moment).map_or("none", |(_, call)| call).into();
            Tried { index, target: injection.target, bits: injection.count(), operator, outcome }
        }
    })
}
