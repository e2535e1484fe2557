use super::*;
use crate::fill::fill_gaps;
use crate::nn::{Illumination, KnownSun, LightSource, Runner, TruthRange};
use crate::norm::Anchor;
use crate::photoclinometry::{Contrast, Guide, GuideInput, Photoclinometry, SLOPED_MAPS, Share, Weight};
use crate::samples::is_set;

/// The lent memory of a job.
pub(crate) struct Lent {
    coarse_m: Vec<f32>,
    valid: Vec<u8>,
    scratch: Vec<f32>,
    lines: Vec<f64>,
}

impl Lent {
    pub(crate) fn new(rules: &InputRules, tile: Shape) -> Self {
        Self {
            coarse_m: vec![7.5; tile.pixels()],
            valid: vec![0xA5; TileMemory::valid_len(tile)],
            scratch: vec![-7.5; TileMemory::scratch_len(rules, tile)],
            lines: vec![7.5; TileMemory::lines_len(tile)],
        }
    }

    pub(crate) fn memory(&mut self) -> TileMemory<'_> {
        let Self { coarse_m, valid, scratch, lines } = self;
        TileMemory { coarse_m, valid, scratch, lines }
    }
}

const RULES: TileRules = TileRules { pixel_m: 2.0, coarse_px: 6.0, anchor: true, checked: true };

/// Makes a tile with steps of a budget.
pub(crate) fn made(
    runner: &mut Runner<'_, '_>,
    tile: &TileInput<impl Samples, impl Samples>,
    budget: u64,
) -> (Made, Vec<f32>) {
    let (rules, shape) = (runner.model().input_rules(), runner.model().tile());
    let mut lent = Lent::new(&rules, shape);
    let mut memory = lent.memory();
    let mut job = TileJob::new(RULES, rules, shape);
    while job.prepare(runner, tile, &mut memory, budget).unwrap() == Progress::Running {}
    while job.run(runner, &mut memory, budget).unwrap() == Progress::Running {}
    (job.made().unwrap(), job.heights_m(&memory).to_vec())
}

const TILE: Shape = Shape::new(48, 56);

/// A network whose heights are those that it is given, plus a tenth of the first map of its image.
struct Echo {
    maps: usize,
    image: Vec<f32>,
    coarse: Vec<f32>,
    steps: u32,
    begun: u32,
}

impl Echo {
    fn new(maps: usize) -> Self {
        let pixels = TILE.pixels();
        Self { maps, image: vec![f32::NAN; maps * pixels], coarse: vec![f32::NAN; pixels], steps: 0, begun: 0 }
    }
}

impl Network for Echo {
    type Fault = ();

    fn begin(&mut self, _checked: bool) -> Result<(), ()> {
        (self.begun, self.steps) = (self.begun + 1, 0);
        Ok(())
    }

    fn load_row(&mut self, map: InputMap, row: usize, samples: impl Fn(usize, &mut [f32])) -> Result<(), ()> {
        let (to, maps) = if map == InputMap::Image { (&mut self.image, self.maps) } else { (&mut self.coarse, 1) };
        // In pieces, as the runner asks.
        let line = maps * TILE.cols;
        if row >= TILE.rows {
            return Err(());
        }
        for (first, piece) in (row * line..).step_by(8 * maps).zip(to[row * line..][..line].chunks_mut(8 * maps)) {
            samples(first, piece);
        }
        Ok(())
    }

    fn start(&mut self) -> Result<(), ()> {
        Ok(())
    }

    fn step(&mut self, _: u64) -> Result<Progress, ()> {
        self.steps += 1;
        Ok(if self.steps == 3 { Progress::Done } else { Progress::Running })
    }

    fn output(&self, out: &mut [f32]) -> Result<(), ()> {
        for ((out, z), v) in out.iter_mut().zip(&self.coarse).zip(self.image.iter().step_by(self.maps)) {
            *out = z + 0.1 * v;
        }
        Ok(())
    }
}

fn rules(illumination: Illumination) -> InputRules {
    let truth_range = if illumination.is_guided() { TruthRange::Pixel } else { TruthRange::Reference };
    InputRules { nr: 50.0, range_margin: 0.25, truth_range, illumination }
}

/// Rough ground with voids in both maps, and its image under a Sun in the south-east.
fn ground() -> (Vec<f32>, Vec<f32>) {
    let noise = |i: usize, k: usize| ((i * 2_654_435_761 + k * 40_503) >> 7 & 0xFFFF) as f32 / 65_536.0;
    let place = |i: usize| ((i / TILE.cols) as f32, (i % TILE.cols) as f32);
    let height = |(r, c): (f32, f32)| 6.0 * (r / 5.0).sin() + 5.0 * ((c + 0.5 * r) / 7.0).cos();
    let shade = |(r, c): (f32, f32)| {
        let (x, y) = (height((r, c + 0.5)) - height((r, c - 0.5)), height((r + 0.5, c)) - height((r - 0.5, c)));
        100.0 + 18.0 * (y - x)
    };
    let image = (0..TILE.pixels()).map(|i| if noise(i, 1) < 0.02 { f32::NAN } else { shade(place(i)) + noise(i, 2) });
    let coarse = (0..TILE.pixels()).map(|i| if noise(i, 3) < 0.002 { -3.4e38 } else { -1900.0 + height(place(i)) });
    (image.collect(), coarse.collect())
}

/// Runs a job with steps of a budget; returns it with its heights, its bits and its network.
fn run(
    illumination: Illumination,
    tile: &TileInput<&[f32], &[f32]>,
    budget: u64,
) -> (TileJob, Vec<f32>, Vec<u8>, Echo) {
    let input = rules(illumination);
    let (mut echo, mut lent) = (Echo::new(illumination.image_maps()), Lent::new(&input, TILE));
    let (mut memory, mut job) = (lent.memory(), TileJob::new(RULES, input, TILE));
    // Between two calls a job is words.
    let kept = |job: &mut TileJob| *job = TileJob::from_words(job.to_words(), input, TILE).expect("its own words");
    while job.prepare(&mut echo, tile, &mut memory, budget).unwrap() == Progress::Running {
        assert!(job.made().is_none() && job.heights_m(&memory).is_empty());
        kept(&mut job);
    }
    while job.run(&mut echo, &mut memory, budget).unwrap() == Progress::Running {
        kept(&mut job);
    }
    let (heights_m, valid) = (job.heights_m(&memory).to_vec(), job.valid(&memory).to_vec());
    (job, heights_m, valid, echo)
}

/// The heights of the whole tile at once, from the parts of the crate.
fn plainly(illumination: Illumination, image: &[f32], coarse_m: &[f32], sun: KnownSun) -> (Vec<f32>, Lighting) {
    let real = |v: &f32| if v.abs() < 1e30 { *v } else { f32::NAN };
    let (mut image, mut coarse_m): (Vec<f32>, Vec<f32>) =
        (image.iter().map(real).collect(), coarse_m.iter().map(real).collect());
    let mut queue = vec![0.0; TILE.pixels()];
    let plan = Photoclinometry::new(TILE);
    let mut scratch = vec![0.0; plan.scratch_len()];
    let fit = LightFit::of_tile(&image[..], &coarse_m, TILE.cols, f64::from(RULES.pixel_m), RULES.coarse_px);
    let axis = Contrast::of_image(&image[..], TILE, RULES.coarse_px, &mut scratch).unwrap().axis();
    image.iter_mut().zip(&coarse_m).filter(|(_, z)| z.is_nan()).for_each(|(v, _)| *v = f32::NAN);
    fill_gaps(&mut coarse_m, TILE.cols, &mut queue).unwrap();
    let scale = ElevationScale::from_pixel(&coarse_m, None, RULES.pixel_m, 50.0).unwrap();
    let lighting = Lighting::decide(illumination, sun, &fit.with_axis(axis));
    let mirror = lighting.mirror();
    let weight = Weight::Trust { trust: lighting.trust, long_share: lighting.long_share };
    let tile = GuideInput { image: &image[..], coarse_m: &coarse_m, mirror, coarse_px: RULES.coarse_px, weight };
    let guide = Guide::new(&plan, tile, &scale, lighting.light.mirrored(mirror), &mut scratch).unwrap();
    let fine = FineWaves::of_share(guide.share());
    let (mut maps, mut heights_m) = (vec![0.0; SLOPED_MAPS * TILE.pixels()], vec![0.0; TILE.pixels()]);
    guide.fill_sloped(&mut maps, &mut heights_m).unwrap();
    heights_m.iter_mut().zip(maps.iter().step_by(SLOPED_MAPS)).for_each(|(z, v)| *z += 0.1 * v);
    TileScale { elevation: scale, mirror }.recover(TILE, &mut heights_m);
    let (mut aside, mut lines) = (vec![0.0; TILE.pixels()], vec![0.0; TileMemory::lines_len(TILE)]);
    let anchor = Anchor::new(RULES.coarse_px);
    anchor.apply(&mut heights_m, &coarse_m, TILE.cols, &mut aside, &mut lines).unwrap();
    fine.apply(&mut heights_m, &coarse_m, TILE.cols, &mut aside, &mut lines).unwrap();
    lighting.settle(&mut heights_m, &coarse_m);
    (heights_m, lighting)
}

#[test]
fn heights_are_those_of_the_parts_whatever_the_budget() {
    let (image, coarse_m) = ground();
    for (azimuth_deg, elevation_deg) in [(None, None), (Some(135.0), Some(30.0)), (Some(200.0), None)] {
        let sun = KnownSun { azimuth_deg, elevation_deg };
        let tile = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: TILE, light: TileLight::Own(sun) };
        let (expected, lighting) = plainly(Illumination::Sloped, &image, &coarse_m, sun);
        assert!(lighting.trust > 0.5);
        for budget in [1, 5_000, 1 << 40] {
            let (job, heights_m, valid, echo) = run(Illumination::Sloped, &tile, budget);
            assert_eq!((job.made(), job.lighting(), echo.begun), (Some(Made::Predicted), lighting, 1));
            assert!(heights_m.iter().zip(&expected).all(|(a, b)| a.to_bits() == b.to_bits()), "{sun:?} {budget}");
            let is_valid = |i: usize| image[i].is_finite() && coarse_m[i] > -1e30;
            assert!((0..TILE.pixels()).all(|i| is_set(&valid, i) == is_valid(i)));
            assert_eq!(job.valid_px(), (0..TILE.pixels()).filter(|i| is_valid(*i)).count());
            assert!(job.expected().unwrap().lit().slope > 0.0);
        }
    }
}

#[test]
fn heights_that_change_after_they_were_checked_are_no_result() {
    let (image, coarse_m) = ground();
    let sun = KnownSun { azimuth_deg: Some(135.0), elevation_deg: Some(30.0) };
    let tile = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: TILE, light: TileLight::Own(sun) };
    let (rules, mut echo) = (rules(Illumination::Sloped), Echo::new(SLOPED_MAPS));
    for broken in [f32::INFINITY, f32::NAN] {
        let mut lent = Lent::new(&rules, TILE);
        let mut memory = lent.memory();
        let mut job = TileJob::new(RULES, rules, TILE);
        while job.prepare(&mut echo, &tile, &mut memory, u64::MAX).unwrap() == Progress::Running {}
        while job.pass != Pass::Settle {
            assert_eq!(job.run(&mut echo, &mut memory, 1), Ok(Progress::Running));
        }
        memory.scratch[TILE.pixels() - 1] = broken;
        // A change that no checksum of the memory has seen.
        assert!(matches!(job.finish_unit(&echo, &mut memory), Err(JobError::Height { .. })), "{broken}");
    }
}

#[test]
fn a_survey_of_one_tile_finds_the_light_of_the_tile() {
    let (image, coarse_m) = ground();
    let sun = KnownSun { azimuth_deg: None, elevation_deg: Some(30.0) };
    let tile = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: TILE, light: TileLight::Own(sun) };
    for illumination in [Illumination::Sloped, Illumination::Given, Illumination::Northwest, Illumination::Any] {
        let (job, ..) = run(illumination, &tile, u64::MAX);
        for budget in [1, 20_000, u64::MAX] {
            let (rules, mut pieces) = (rules(illumination), 0);
            let mut lent = Lent::new(&rules, TILE);
            let mut memory = lent.memory();
            let mut survey = TileJob::new(RULES, rules, TILE);
            while survey.survey(&tile, &mut memory, budget).unwrap() == Progress::Running {
                pieces += 1;
                survey = TileJob::from_words(survey.to_words(), rules, TILE).unwrap();
            }
            assert_eq!(pieces == 0, budget == u64::MAX);
            let mut all = LightSurvey::default();
            all.add(&survey.shown());
            assert_eq!(all, survey.shown());
            let words = all.to_words();
            assert_eq!(LightSurvey::from_words(words), Some(all));
            assert_eq!(all.decide(illumination, sun), job.lighting(), "{illumination:?} {budget}");
            // Twice the same ground is known better.
            all.add(&survey.shown());
            let (once, twice) = (survey.shown().decide(illumination, sun), all.decide(illumination, sun));
            assert!(twice.azimuth_sd_deg <= once.azimuth_sd_deg && twice.source == once.source);
        }
    }
    let mut spoilt = LightSurvey::default().to_words();
    spoilt[16] = 2;
    assert_eq!(LightSurvey::from_words(spoilt), None);
}

#[test]
fn a_survey_of_nothing_shows_nothing() {
    let (image, coarse_m) = ground();
    let void = vec![f32::NAN; TILE.pixels()];
    let (rules, light) = (rules(Illumination::Sloped), TileLight::default());
    for (image, is_dark) in [(&void, false), (&vec![7.0; TILE.pixels()], true), (&image, false)] {
        let coarse_m = if is_dark { &coarse_m } else { &void };
        let tile = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: TILE, light };
        let mut lent = Lent::new(&rules, TILE);
        let mut survey = TileJob::new(RULES, rules, TILE);
        assert_eq!(survey.survey(&tile, &mut lent.memory(), u64::MAX), Ok(Progress::Done));
        let found = survey.shown().decide(Illumination::Sloped, KnownSun::default());
        assert_eq!(found.source, crate::nn::LightSource::Assumed);
        let short = TileInput { image: &image[1..], ..tile };
        assert!(TileJob::new(RULES, rules, TILE).survey(&short, &mut lent.memory(), 1).is_err());
    }
}

#[test]
fn dark_pixels_are_marked() {
    let (mut image, coarse_m) = ground();
    image[9 * TILE.cols..9 * TILE.cols + 30].fill(1.0);
    let sun = KnownSun { azimuth_deg: Some(135.0), elevation_deg: Some(30.0) };
    let tile = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: TILE, light: TileLight::Own(sun) };
    let (job, ..) = run(Illumination::Sloped, &tile, u64::MAX);
    let mut dark = vec![0xA5; TileMemory::valid_len(TILE)];
    job.mark_dark(tile.image, &mut dark);
    assert!((0..TILE.pixels()).all(|i| is_set(&dark, i) == (image[i] == 1.0)));
    let (job, ..) = run(Illumination::Any, &tile, u64::MAX);
    job.mark_dark(tile.image, &mut dark);
    assert!(dark.iter().all(|byte| *byte == 0), "without expected errors nothing is dark");
}

#[test]
fn every_kind_of_input_gives_the_same_heights_for_every_budget() {
    use Illumination::*;
    let (image, coarse_m) = ground();
    for illumination in [Any, Northwest, Given, Weighed, Sloped] {
        let light = TileLight::default();
        let tile = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: Shape::new(40, 50), light };
        let (whole, expected, bits, _) = run(illumination, &tile, u64::MAX);
        let (job, heights_m, again, echo) = run(illumination, &tile, 1);
        assert_eq!((whole, bits), (job, again.clone()));
        assert_eq!(heights_m, expected);
        assert!(
            heights_m.iter().all(|z| z.is_finite()) && echo.image.iter().chain(&echo.coarse).all(|v| v.is_finite())
        );
        // Pixels beyond the scene are not valid.
        assert!((0..TILE.pixels()).all(|i| !is_set(&again, i) || i / TILE.cols < 40 && i % TILE.cols < 50));
        assert!(job.valid_px() > 1800 && job.valid_px() <= 2000, "{}", job.valid_px());
    }
}

#[test]
fn tiles_that_show_nothing_keep_their_coarse_heights() {
    let (image, coarse_m) = ground();
    let (flat, void) = (vec![3.0; TILE.pixels()], vec![f32::NAN; TILE.pixels()]);
    let light = TileLight::default();
    let of = |image: &[f32], coarse_m: &[f32], illumination| {
        let (job, heights_m, ..) = run(illumination, &TileInput { image, coarse_m, inside: TILE, light }, 10_000);
        (job.made().unwrap(), heights_m)
    };
    for illumination in [Illumination::Any, Illumination::Sloped] {
        let (made, heights_m) = of(&flat, &coarse_m, illumination);
        assert_eq!(made, Made::Coarse);
        let kept = heights_m.iter().zip(&coarse_m).filter(|(_, z)| **z > -1e30);
        assert!(kept.clone().count() > 2000 && kept.clone().all(|(a, b)| a == b));
        for (image, coarse_m) in [(&void, &coarse_m), (&image, &void)] {
            assert_eq!(of(image, coarse_m, illumination), (Made::Empty, vec![]));
        }
    }
    // Level ground is no obstacle for heights counted in pixels.
    assert_eq!(of(&image, &flat, Illumination::Any).0, Made::Coarse);
    assert_eq!(of(&image, &flat, Illumination::Sloped).0, Made::Predicted);
}

#[test]
fn rules_that_no_model_has_are_refused() {
    let (image, coarse_m) = ground();
    let tile = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: TILE, light: TileLight::default() };
    let input = InputRules { range_margin: -1.0, ..rules(Illumination::Any) };
    let (mut echo, mut lent) = (Echo::new(1), Lent::new(&input, TILE));
    let (mut memory, mut job) = (lent.memory(), TileJob::new(RULES, input, TILE));
    let refused = loop {
        match job.prepare(&mut echo, &tile, &mut memory, 1) {
            Ok(progress) => assert_eq!(progress, Progress::Running),
            Err(error) => break error,
        }
    };
    assert_eq!(refused, JobError::Rules(crate::norm::NormError::Margin { share: -1.0 }));
}

#[test]
fn a_tile_smaller_than_the_cells_of_a_fit_shows_no_light() {
    let (image, coarse_m) = ground();
    let tile = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: TILE, light: TileLight::default() };
    let input = rules(Illumination::Weighed);
    let (mut echo, mut lent) = (Echo::new(Illumination::Weighed.image_maps()), Lent::new(&input, TILE));
    let rules = TileRules { coarse_px: 600.0, ..RULES };
    let (mut memory, mut job) = (lent.memory(), TileJob::new(rules, input, TILE));
    while job.prepare(&mut echo, &tile, &mut memory, u64::MAX).unwrap() == Progress::Running {}
    assert_eq!(job.lighting().source, LightSource::Assumed);
}

#[test]
fn a_plain_guide_takes_all_contrast_for_relief() {
    let (mut image, mut coarse_m) = ground();
    for map in [&mut image, &mut coarse_m] {
        map.iter_mut().filter(|v| v.abs() > 1e30).for_each(|v| *v = f32::NAN);
        fill_gaps(map, TILE.cols, &mut vec![0.0; TILE.pixels()]).unwrap();
    }
    let (plan, mirror) = (Photoclinometry::new(TILE), Mirror::default());
    let scale = ElevationScale::from_pixel(&coarse_m, None, RULES.pixel_m, 50.0).unwrap();
    let light = crate::norm::Light::from_sun(135.0, 40.0).unwrap();
    let of = |weight| {
        let mut scratch = vec![0.0; plan.scratch_len()];
        let tile = GuideInput { image: &image[..], coarse_m: &coarse_m, mirror, coarse_px: RULES.coarse_px, weight };
        let guide = Guide::new(&plan, tile, &scale, light, &mut scratch).unwrap();
        let mut maps = [[0.0; 4]];
        guide.image(0, &mut maps);
        (*guide.share(), maps[0][3])
    };
    assert_eq!(of(Weight::Plain), (Share::WHOLE, 1.0 / light.strength()));
    assert!(of(Weight::Trust { trust: 1.0, long_share: None }).0.mean() < 1.0);
}

#[test]
fn heights_beyond_those_that_are_there_are_not_swapped() {
    let elevation = ElevationScale::from_heights(&[100.0, 140.0], None, 40.0).unwrap();
    let scale = TileScale { elevation, mirror: Mirror { rows: true, cols: false } };
    let (shape, mut whole, mut half) = (Shape::new(2, 2), [1.0, 2.0, 3.0, 4.0], [1.0, 2.0]);
    scale.recover(shape, &mut whole);
    scale.recover(shape, &mut half);
    assert_eq!((whole, half), ([103.0, 104.0, 101.0, 102.0], [101.0, 102.0]));
}

#[test]
fn a_tile_that_is_given_up_keeps_its_coarse_heights() {
    let (image, coarse_m) = ground();
    let (input, light) = (rules(Illumination::Sloped), TileLight::default());
    let tile = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: TILE, light };
    let mut steps = 0;
    for at in [0, 10, 100, 300, usize::MAX] {
        let (mut echo, mut lent) = (Echo::new(SLOPED_MAPS), Lent::new(&input, TILE));
        let (mut memory, mut job) = (lent.memory(), TileJob::new(RULES, input, TILE));
        for _ in 0..at {
            steps += 1;
            if job.prepare(&mut echo, &tile, &mut memory, 1).unwrap() == Progress::Done {
                break;
            }
        }
        job.give_up();
        while job.prepare(&mut echo, &tile, &mut memory, 1000).unwrap() == Progress::Running {}
        while job.run(&mut echo, &mut memory, 1000).unwrap() == Progress::Running {}
        assert_eq!(job.made(), Some(Made::Coarse));
        assert_eq!(job.heights_m(&memory), &memory.coarse_m[..]);
        assert!(memory.coarse_m.iter().all(|z| z.is_finite()) && job.expected().unwrap().lit().explained == 0.0);
    }
    assert!(steps > 500);
}

#[test]
fn heights_that_differ_the_second_time_end_the_tile() {
    let (image, coarse_m) = ground();
    let input = rules(Illumination::Sloped);
    let tile = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: TILE, light: TileLight::default() };
    let (mut echo, mut lent) = (Echo::new(SLOPED_MAPS), Lent::new(&input, TILE));
    let (mut memory, mut job) = (lent.memory(), TileJob::new(RULES, input, TILE));
    while job.prepare(&mut echo, &tile, &mut memory, 1).unwrap() == Progress::Running {}
    while job.first_round.is_none() {
        assert_eq!(job.run(&mut echo, &mut memory, 1), Ok(Progress::Running));
    }
    let mut wrong = job;
    assert_eq!(job.run(&mut echo, &mut memory, u64::MAX), Ok(Progress::Done));
    echo.coarse[77] += 1e-3;
    assert_eq!(wrong.run(&mut echo, &mut memory, u64::MAX), Err(JobError::Unequal));
}

#[test]
fn calls_out_of_order_and_short_memory_are_refused() {
    let (image, coarse_m) = ground();
    let (input, light) = (rules(Illumination::Sloped), TileLight::default());
    let tile = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: TILE, light };
    let (mut echo, mut lent) = (Echo::new(SLOPED_MAPS), Lent::new(&input, TILE));
    let mut job = TileJob::new(RULES, input, TILE);
    assert_eq!(job.run(&mut echo, &mut lent.memory(), 1), Err(JobError::State));
    let short = TileInput { image: &image[1..], ..tile };
    assert!(matches!(job.prepare(&mut echo, &short, &mut lent.memory(), 1), Err(JobError::Length(_))));
    for block in 0..4 {
        let Lent { coarse_m, valid, scratch, lines } = &mut Lent::new(&input, TILE);
        let less = |len: usize, own: usize| len - usize::from(block == own);
        let (a, b, c, d) = (coarse_m.len(), valid.len(), scratch.len(), lines.len());
        let mut memory = TileMemory {
            coarse_m: &mut coarse_m[..less(a, 0)],
            valid: &mut valid[..less(b, 1)],
            scratch: &mut scratch[..less(c, 2)],
            lines: &mut lines[..less(d, 3)],
        };
        assert!(matches!(job.prepare(&mut echo, &tile, &mut memory, 1), Err(JobError::Length(_))), "{block}");
    }
}

#[test]
fn any_words_are_harmless() {
    let (image, coarse_m) = ground();
    let tile = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: TILE, light: TileLight::default() };
    let (job, ..) = run(Illumination::Sloped, &tile, u64::MAX);
    let (input, words) = (rules(Illumination::Sloped), job.to_words());
    let (mut refused, mut mad) = (0, 0);
    for at in 0..TileJob::WORDS {
        for value in [0, 1, 5, 77, 1 << 31, u64::MAX, 0x7ff8_0000_0000_0000, 0x7fc0_0000] {
            let mut spoilt = words;
            spoilt[at] = value;
            // In the middle of the preparation, and of the finish.
            for pass in [value % 22, 10, 11, 12, 17] {
                spoilt[3] = if at == 3 { value } else { pass };
                let Some(mut job) = TileJob::from_words(spoilt, input, TILE) else {
                    refused += 1;
                    continue;
                };
                let _expected = crate::part::defaults::Expected::new();
                let (mut echo, mut lent) = (Echo::new(SLOPED_MAPS), Lent::new(&input, TILE));
                let mut memory = lent.memory();
                let ready = job.prepare(&mut echo, &tile, &mut memory, 20_000);
                let ran =
                    ready.and_then(|_| if job.is_prepared() { job.run(&mut echo, &mut memory, 20_000) } else { ready });
                mad += usize::from(ran.is_err());
            }
        }
    }
    assert!(refused > 100 && mad > 0, "{refused} {mad}");
}

#[test]
fn memory_that_changes_between_two_calls_is_found() {
    let (image, coarse_m) = ground();
    for illumination in [Illumination::Any, Illumination::Sloped] {
        let (input, light) = (rules(illumination), TileLight::default());
        let tile = TileInput { image: &image[..], coarse_m: &coarse_m[..], inside: TILE, light };
        let (_, expected, ..) = run(illumination, &tile, u64::MAX);
        let (mut found, mut unused) = ([0; 3], 0);
        for at in (0..400).step_by(3) {
            let (mut echo, mut lent) = (Echo::new(illumination.image_maps()), Lent::new(&input, TILE));
            let (mut job, mut step, mut part) = (TileJob::new(RULES, input, TILE), 0, at % 3);
            let end = loop {
                let mut memory = lent.memory();
                let worked = if job.is_prepared() {
                    job.run(&mut echo, &mut memory, 40_000)
                } else {
                    job.prepare(&mut echo, &tile, &mut memory, 40_000).map(|_| Progress::Running)
                };
                if worked != Ok(Progress::Running) {
                    break worked;
                }
                step += 1;
                if step == at / 3 {
                    part = at / 3 % 3;
                    let bit = 1 << (at % 31);
                    let flip = |v: &mut f32| *v = f32::from_bits(v.to_bits() ^ bit);
                    match part {
                        0 => flip(&mut lent.coarse_m[at * 6]),
                        1 => lent.valid[at % 330] ^= bit as u8 | 1,
                        _ => flip(&mut lent.scratch[at * 13]),
                    }
                }
            };
            match end {
                Err(JobError::Changed { part: found_part }) => {
                    assert_eq!(found_part, [TilePart::Coarse, TilePart::Valid, TilePart::Scratch][part]);
                    found[part] += 1;
                }
                Ok(Progress::Done) => {
                    assert_eq!(job.heights_m(&lent.memory()), expected, "scratch memory that is not used any more");
                    unused += 1;
                }
                other => panic!("{other:?}"),
            }
        }
        assert!(found.iter().all(|found| *found > 5), "{found:?}, {unused} unused");
    }
}
