//! Memory for jobs ([`elunar_core::job`]) on the ground, and a network's input without a network.

use elunar_core::job::{InputMap, JobError, Made, Network, TileInput, TileJob, TileMemory, TileRules};
use elunar_core::nn::{InputRules, Progress};
use elunar_core::samples::Samples;
use elunar_core::tile::Shape;

/// The memory of a tile's job. It grows as needed and can be used again.
#[derive(Debug, Default)]
pub struct JobMemory {
    coarse_m: Vec<f32>,
    valid: Vec<u8>,
    scratch: Vec<f32>,
    lines: Vec<f64>,
}

impl JobMemory {
    /// Lends the memory for a tile of this shape and a network with these rules.
    pub fn lend(&mut self, rules: &InputRules, tile: Shape) -> TileMemory<'_> {
        self.coarse_m.resize(tile.pixels(), 0.0);
        self.valid.resize(TileMemory::valid_len(tile), 0);
        self.scratch.resize(TileMemory::scratch_len(rules, tile), 0.0);
        // Room for eight lines side by side, which is faster.
        self.lines.resize(8 * TileMemory::lines_len(tile), 0.0);
        let Self { coarse_m, valid, scratch, lines } = self;
        TileMemory { coarse_m, valid, scratch, lines }
    }
}

/// The network's input for one tile. Maps are row-major and mirrored as the job's scale says.
#[derive(Debug, Default)]
pub struct InputMaps {
    /// The image's maps, side by side in every pixel.
    pub image: Vec<f32>,
    /// The coarse DTM, normalised.
    pub coarse: Vec<f32>,
    rows: usize,
}

impl InputMaps {
    /// Makes room for the maps of a tile of this shape.
    #[must_use]
    pub fn new(rules: &InputRules, tile: Shape) -> Self {
        let maps = rules.illumination.image_maps();
        Self { image: vec![0.0; maps * tile.pixels()], coarse: vec![0.0; tile.pixels()], rows: tile.rows }
    }

    /// Takes a row, as [`Network::load_row`] does.
    pub fn take(&mut self, map: InputMap, row: usize, samples: impl Fn(usize, &mut [f32])) {
        let rows = self.rows;
        let to = if map == InputMap::Image { &mut self.image } else { &mut self.coarse };
        let line = to.len() / rows.max(1);
        samples(row * line, &mut to[row * line..][..line]);
    }

    /// Prepares a tile that no network shall run; returns the maps, and the job for its scale.
    ///
    /// # Errors
    /// As [`TileJob::prepare`]; [`JobError::State`] for a tile that a network cannot use.
    pub fn of(
        rules: TileRules,
        input: InputRules,
        shape: Shape,
        tile: &TileInput<impl Samples, impl Samples>,
    ) -> Result<(Self, TileJob), JobError<String>> {
        let (mut maps, mut memory) = (Self::new(&input, shape), JobMemory::default());
        let mut job = TileJob::new(rules, input, shape);
        while job.prepare(&mut maps, tile, &mut memory.lend(&input, shape), u64::MAX)? == Progress::Running {}
        if job.made() == Some(Made::Predicted) { Ok((maps, job)) } else { Err(JobError::State) }
    }
}

impl Network for InputMaps {
    type Fault = String;

    fn begin(&mut self, _checked: bool) -> Result<(), String> {
        Ok(())
    }

    fn load_row(&mut self, map: InputMap, row: usize, samples: impl Fn(usize, &mut [f32])) -> Result<(), String> {
        self.take(map, row, samples);
        Ok(())
    }

    fn start(&mut self) -> Result<(), String> {
        Ok(())
    }

    fn step(&mut self, _: u64) -> Result<Progress, String> {
        Err("no network".into())
    }

    fn output(&self, _: &mut [f32]) -> Result<(), String> {
        Err("no network".into())
    }
}
