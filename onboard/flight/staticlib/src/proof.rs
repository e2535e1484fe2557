//! The program that `../../proofs` links to prove that no panic is reachable: a panic handler that cannot be linked, and roots for the Rust
//! interfaces of the runner, the slots and the terrain maps beside the C functions. Never part of a flight archive.
#![allow(unsafe_code)]

use elunar_capi::elunar_core::job::TileScale;
use elunar_capi::elunar_core::nn::slots::{
    Boot, ModelId, Region, SelfTestPassed, Slot, SlotError, SlotRecord, Slots, Storage, StorageError,
};
use elunar_capi::elunar_core::nn::{
    InputRules, Kernel, Lighting, Model, ModelError, Progress, RunError, Runner, required,
};
use elunar_capi::elunar_core::photoclinometry::ExpectedErrors;
use elunar_capi::elunar_core::pixels::Pixels;
use elunar_capi::elunar_core::samples::{Masked, Samples};
use elunar_capi::elunar_core::strip::{
    LineErrors, Next, PostGrid, Posts, Strip, StripError, StripMemory, StripPaused, StripPlan, StripSettings,
};
use elunar_capi::elunar_core::terrain::TerrainError;
use elunar_capi::elunar_core::terrain::{HazardLimits, LineMaps, LineOptions, TerrainLines};
use elunar_capi::elunar_core::tile::Shape;
use elunar_capi::elunar_core::{JobError, Made, TileInput, TileJob, TileMemory, TileRules};

unsafe extern "C" {
    /// Not defined anywhere: a program that refers to it does not link. Its argument is the panic's location, so that the location stays in
    /// the program for `panic_sites.py`.
    fn elunar_a_panic_is_reachable(info: *const ()) -> !;
}

#[panic_handler]
fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
    // SAFETY: never executed, because it never links.
    unsafe { elunar_a_panic_is_reachable((&raw const *info).cast()) }
}

/// Storage in plain memory.
struct Memory {
    regions: [&'static mut [u8]; 4],
    sector_bytes: usize,
}

impl Memory {
    fn region(&mut self, region: Region, offset_bytes: usize, len: usize) -> &mut [u8] {
        let region = self.regions.get_mut(index(region)).and_then(|region| region.get_mut(offset_bytes..));
        region.and_then(|region| region.get_mut(..len)).unwrap_or_default()
    }
}

fn index(region: Region) -> usize {
    match region {
        Region::Model(Slot::A) => 0,
        Region::Model(Slot::B) => 1,
        Region::Record => 2,
        Region::RecordCopy => 3,
    }
}

impl Storage for Memory {
    fn bytes(&self, region: Region) -> &[u8] {
        self.regions.get(index(region)).map_or(&[], |region| region)
    }

    fn sector_bytes(&self, _: Region) -> usize {
        self.sector_bytes
    }

    fn erase(&mut self, region: Region, offset_bytes: usize) -> Result<(), StorageError> {
        self.region(region, offset_bytes, self.sector_bytes).fill(0xff);
        Ok(())
    }

    fn write(&mut self, region: Region, offset_bytes: usize, bytes: &[u8]) -> Result<(), StorageError> {
        let to = self.region(region, offset_bytes, bytes.len());
        if to.len() != bytes.len() {
            return Err(StorageError { code: 1 });
        }
        to.copy_from_slice(bytes);
        Ok(())
    }
}

/// Defines a function with its own symbol.
macro_rules! root {
    ($($name:ident($($argument:ident: $type:ty),*) -> $result:ty { $body:expr })*) => { $(
        #[unsafe(no_mangle)]
        fn $name($($argument: $type),*) -> $result {
            $body
        }
    )* };
}

root! {
    elunar_root_model(bytes: &'static [u8]) -> Result<Model<'static>, ModelError> { Model::new(bytes) }
    elunar_root_required(model: &Model<'_>) -> usize { required(model) }
    elunar_root_runner(model: Model<'static>, arena: &'static mut [u8]) -> Result<Runner<'static, 'static>, RunError> {
        Runner::new(model, arena)
    }
    elunar_root_scalar(model: Model<'static>, arena: &'static mut [u8]) -> Result<Runner<'static, 'static>, RunError> {
        Runner::with_kernel(Kernel::SCALAR, model, arena)
    }
    elunar_root_begin(runner: &mut Runner<'_, '_>, image: &[f32], coarse: &[f32]) -> Result<(), RunError> {
        runner.begin(image, coarse)
    }
    elunar_root_begin_self_test(runner: &mut Runner<'_, '_>) -> Result<(), RunError> { runner.begin_self_test() }
    elunar_root_step(runner: &mut Runner<'_, '_>, macs: u64) -> Result<Progress, RunError> { runner.step(macs) }
    elunar_root_output(runner: &Runner<'_, '_>, out: &mut [f32]) -> Result<(), RunError> { runner.output(out) }
    elunar_root_job(rules: TileRules, input: InputRules, tile: Shape) -> TileJob { TileJob::new(rules, input, tile) }
    elunar_root_job_lens(input: &InputRules, tile: Shape) -> [usize; 3] {
        [TileMemory::valid_len(tile), TileMemory::scratch_len(input, tile), TileMemory::lines_len(tile)]
    }
    elunar_root_job_prepare(
        job: &mut TileJob, runner: &mut Runner<'_, '_>, tile: &TileInput<&[f32], &[f32]>, memory: &mut TileMemory<'_>, macs: u64
    ) -> Result<Progress, JobError<RunError>> { job.prepare(runner, tile, memory, macs) }
    elunar_root_job_prepare_pixels(
        job: &mut TileJob, runner: &mut Runner<'_, '_>, tile: &TileInput<Masked<'_, Pixels<'_>>, &[f32]>, memory: &mut TileMemory<'_>,
        macs: u64
    ) -> Result<Progress, JobError<RunError>> { job.prepare(runner, tile, memory, macs) }
    elunar_root_job_run(job: &mut TileJob, runner: &mut Runner<'_, '_>, memory: &mut TileMemory<'_>, macs: u64)
        -> Result<Progress, JobError<RunError>> { job.run(runner, memory, macs) }
    elunar_root_job_give_up(job: &mut TileJob) -> () { job.give_up() }
    elunar_root_job_results(job: &TileJob) -> (Option<Made>, usize, Lighting, Option<ExpectedErrors>, Option<TileScale>) {
        (job.made(), job.valid_px(), job.lighting(), job.expected(), job.scale())
    }
    elunar_root_job_heights(job: &TileJob, memory: &TileMemory<'_>, out_m: &mut [f32], valid: &mut [u8]) -> () {{
        out_m.iter_mut().zip(job.heights_m(memory)).for_each(|(to, z)| *to = *z);
        valid.iter_mut().zip(job.valid(memory)).for_each(|(to, bits)| *to = *bits);
    }}
    elunar_root_job_words(job: TileJob) -> [u64; TileJob::WORDS] { job.to_words() }
    elunar_root_job_of_words(words: [u64; TileJob::WORDS], input: InputRules, tile: Shape) -> Option<TileJob> {
        TileJob::from_words(words, input, tile)
    }
    elunar_root_pixels(pixels: &Pixels<'_>, first: usize, out: &mut [f32]) -> bool {{
        pixels.read(first, out);
        pixels.is_whole()
    }}
    elunar_root_scale_recover(scale: &TileScale, tile: Shape, heights: &mut [f32]) -> () { scale.recover(tile, heights) }
    elunar_root_check(runner: &mut Runner<'_, '_>) -> Result<u32, RunError> {
        runner.check_self_test().and_then(|()| runner.output_crc())
    }
    elunar_root_limits(slope_deg: f32, roughness_m: f32) -> Result<HazardLimits, TerrainError> {
        HazardLimits::new(slope_deg, roughness_m)
    }
    elunar_root_lines(options: LineOptions, memory: &'static mut [f32]) -> Result<TerrainLines<'static>, TerrainError> {
        TerrainLines::new(options, memory)
    }
    elunar_root_lines_push(lines: &mut TerrainLines<'_>, line_m: &[f32], maps: &mut LineMaps<'_>)
        -> Result<Option<u64>, TerrainError> { lines.push(line_m, maps) }
    elunar_root_limits_sigmas(limits: HazardLimits, sigmas: f32) -> Result<HazardLimits, TerrainError> { limits.with_sigmas(sigmas) }
    elunar_root_lines_push_with(lines: &mut TerrainLines<'_>, line_m: &[f32], slope_sd: &[f32], maps: &mut LineMaps<'_>)
        -> Result<Option<u64>, TerrainError> { lines.push_with(line_m, slope_sd, maps) }
    elunar_root_lines_finish(lines: &mut TerrainLines<'_>, maps: &mut LineMaps<'_>) -> Result<Option<u64>, TerrainError> {
        lines.finish(maps)
    }
    elunar_root_slots_boot(slots: &mut Slots<Memory>) -> Result<Boot, SlotError> { slots.boot() }
    elunar_root_slots_model(slots: &Slots<Memory>) -> Result<Model<'_>, SlotError> { slots.model() }
    elunar_root_slots_record(slots: &Slots<Memory>) -> (Option<SlotRecord>, usize) { (slots.record(), slots.record_copies()) }
    elunar_root_slots_passed(runner: &mut Runner<'_, '_>) -> Result<SelfTestPassed, RunError> { SelfTestPassed::of(runner) }
    elunar_root_slots_confirm(slots: &mut Slots<Memory>, passed: SelfTestPassed) -> Result<(), SlotError> { slots.confirm(passed) }
    elunar_root_slots_reject(slots: &mut Slots<Memory>) -> Result<Boot, SlotError> { slots.reject() }
    elunar_root_slots_begin(slots: &mut Slots<Memory>, id: ModelId) -> Result<usize, SlotError> { slots.begin_upload(id) }
    elunar_root_slots_write(slots: &mut Slots<Memory>, offset_bytes: usize, bytes: &[u8]) -> Result<usize, SlotError> {
        slots.write(offset_bytes, bytes)
    }
    elunar_root_slots_trial(slots: &mut Slots<Memory>, boots: u32) -> Result<(), SlotError> { slots.start_trial(boots) }
    elunar_root_strip_plan(model: &Model<'_>, settings: StripSettings) -> Result<StripPlan, StripError> {
        StripPlan::new(model, settings)
    }
    elunar_root_strip_bytes(plan: &StripPlan) -> usize { plan.bytes() }
    elunar_root_strip(plan: StripPlan, runner: Runner<'static, 'static>, memory: StripMemory<'static>)
        -> Result<Strip<'static, 'static>, StripError> { Strip::new(plan, runner, memory) }
    elunar_root_strip_resume(
        plan: StripPlan, runner: Runner<'static, 'static>, memory: StripMemory<'static>, paused: &StripPaused
    ) -> Result<Strip<'static, 'static>, StripError> { Strip::resume(plan, runner, memory, paused) }
    elunar_root_strip_pause(strip: &Strip<'_, '_>) -> StripPaused { strip.pause() }
    elunar_root_strip_push(strip: &mut Strip<'_, '_>, image: &[f32], coarse_m: &[f32]) -> Result<usize, StripError> {
        strip.push_line(image, coarse_m)
    }
    elunar_root_strip_pixels(strip: &mut Strip<'_, '_>, image: &[u8], coarse_m: &[f32]) -> Result<usize, StripError> {
        strip.push_pixels(image, coarse_m)
    }
    elunar_root_strip_posts(strip: &mut Strip<'_, '_>, posts_m: &[f32]) -> Result<(), StripError> { strip.push_posts(posts_m) }
    elunar_root_strip_finish(strip: &mut Strip<'_, '_>) -> () { strip.finish() }
    elunar_root_strip_step(strip: &mut Strip<'_, '_>, macs: u64) -> Next { strip.step(macs) }
    elunar_root_strip_ready(strip: &Strip<'_, '_>) -> usize { strip.ready() }
    elunar_root_strip_take(strip: &mut Strip<'_, '_>, out_m: &mut [f32]) -> Result<Option<usize>, StripError> {
        strip.take_line(out_m)
    }
    elunar_root_strip_take_with(strip: &mut Strip<'_, '_>, out_m: &mut [f32], errors: LineErrors<'_>)
        -> Result<Option<usize>, StripError> { strip.take_line_with(out_m, errors) }
    elunar_root_strip_scrub(strip: &mut Strip<'_, '_>, max_bytes: usize) -> Result<(), RunError> {
        strip.scrub(max_bytes)
    }
    elunar_root_posts(grid: PostGrid, memory: &'static mut [f32]) -> Result<Posts<'static>, StripError> {
        Posts::new(grid, memory)
    }
    elunar_root_posts_push(posts: &mut Posts<'_>, posts_m: &[f32]) -> Result<(), StripError> { posts.push_row(posts_m) }
    elunar_root_posts_line(posts: &mut Posts<'_>, out_m: &mut [f32]) -> Option<usize> { posts.line(out_m) }
    elunar_root_scrub(runner: &mut Runner<'_, '_>, max_bytes: usize) -> Result<(), RunError> { runner.scrub(max_bytes) }
}
