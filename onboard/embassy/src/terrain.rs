//! The work, which knows no executor: lines in, lines out, a bounded step at a time.

use elunar_core::nn::file::Crc32c;
use elunar_core::nn::{KnownSun, Lighting, Model, Runner};
use elunar_core::norm::LightFit;
use elunar_core::pixels::PixelForm;
use elunar_core::strip::{Next, Strip, StripMemory, StripPlan, StripSettings};

/// Pixels of a line.
pub const COLS: usize = 80;
/// Lines of the strip.
pub const LINES: usize = 150;
/// Multiply-accumulates of a step.
const STEP_MACS: u64 = 1_000_000;

/// What came out.
#[derive(Debug, Clone, Copy)]
pub struct LineReport {
    /// Lines of heights.
    pub lines: usize,
    /// Tiles.
    pub tiles: u64,
    /// Tiles that were lost.
    pub lost: u64,
    /// Checksum of all heights.
    pub crc: u32,
}

impl core::fmt::Display for LineReport {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let Self { lines, tiles, lost, crc } = self;
        write!(f, "{lines} lines of {tiles} tiles, {lost} lost, heights {crc:08x}")
    }
}

/// A strip with its memory.
pub struct Terrain<'m> {
    strip: Strip<'m, 'm>,
    lines: usize,
    crc: Crc32c,
}

impl<'m> Terrain<'m> {
    /// Makes a strip for a model in lent memory; `None` if it is no model, or the memory is too short.
    pub fn new(file: &'m [u8], memory: &'m mut [u64]) -> Option<Self> {
        let model = Model::new(file).ok()?;
        let sun = KnownSun { azimuth_deg: Some(300.0), elevation_deg: Some(30.0) };
        let settings = StripSettings {
            cols: COLS,
            ring_lines: StripPlan::least_lines(&model),
            overlap_px: 8,
            pixel_m: 2.0,
            coarse_px: 8.0,
            anchor: true,
            light: Lighting::decide(model.illumination(), sun, &LightFit::default()),
            pixels: PixelForm::F32,
            posts: None,
            expected_errors: false,
            checked: false,
        };
        let plan = StripPlan::new(&model, settings).ok()?;
        let mut take = {
            let mut rest = memory;
            move |bytes: usize| {
                let (taken, left) = core::mem::take(&mut rest).split_at_mut_checked(bytes.div_ceil(8))?;
                rest = left;
                Some(taken)
            }
        };
        let [arena, bytes, samples] = [plan.arena_bytes(), plan.bytes_len(), 4 * plan.samples_len()].map(&mut take);
        let sums = take(8 * plan.sums_len())?;
        // SAFETY: any bits are numbers; eight bytes are aligned for shorter ones.
        let (arena, bytes, samples, sums) = unsafe {
            (arena?.align_to_mut().1, bytes?.align_to_mut().1, samples?.align_to_mut().1, sums.align_to_mut().1)
        };
        let runner = Runner::new(model, arena).ok()?;
        let strip = Strip::new(plan, runner, StripMemory { bytes, samples, sums }).ok()?;
        Some(Self { strip, lines: 0, crc: Crc32c::default() })
    }

    /// Takes the next line, if there is room for it.
    pub fn push(&mut self, number: usize) -> bool {
        let image = core::array::from_fn::<f32, COLS, _>(|col| ((number * 37 + col * 91) % 251) as f32);
        let coarse_m = core::array::from_fn::<f32, COLS, _>(|col| ((number / 3 + col / 2) % 29) as f32);
        self.strip.push_line(&image, &coarse_m).is_ok()
    }

    /// Ends the strip with the last line.
    pub fn finish(&mut self) {
        self.strip.finish();
    }

    /// Does a bounded piece of work and takes finished lines; returns whether there is more to do without another line.
    pub fn step(&mut self) -> bool {
        let next = self.strip.step(STEP_MACS);
        let mut heights_m = [0f32; COLS];
        while let Ok(Some(_)) = self.strip.take_line(&mut heights_m) {
            self.lines += 1;
            heights_m.iter().for_each(|z| self.crc.update(&z.to_bits().to_le_bytes()));
        }
        matches!(next, Next::Step | Next::Take)
    }

    /// Returns what came out.
    pub fn report(&self) -> LineReport {
        let counters = self.strip.counters();
        LineReport { lines: self.lines, tiles: counters.tiles, lost: counters.tiles_lost, crc: self.crc.value() }
    }
}
