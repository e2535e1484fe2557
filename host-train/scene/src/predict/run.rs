//! All tiles of a scene, on several threads, in one order.

use super::network::Model;
use super::scene::{Band, Scene};
use super::tile::{Outcome, Rules, TileWorker};
use crate::mosaic::{Blend, Mosaic};
use elunar_core::tile::{INFERENCE_OVERLAP_PX, Shape, TILE_ROWS, Tiling, Window};
use elunar_net::illumination::{KnownSun, LightSource};
use elunar_raster::{Error, Raster, Result};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};

/// How a scene is cut, shared out and joined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// Pixels by which neighbouring tiles overlap; less than either side of a tile. See [`Options::overlap_for`].
    pub overlap_px: usize,
    /// How overlapping tiles are weighed.
    pub blend: Blend,
    /// Whether each tile keeps the low frequencies of the coarse DTM ([`elunar_core::norm::Anchor`]; our choice) or those the
    /// network gives it (the paper).
    pub anchor: bool,
    /// Threads; 0 takes as many as the machine offers.
    pub threads: usize,
    /// What is known of the Sun; the rest is fitted to image and coarse DTM. Models that know any light do not ask for it.
    pub sun: KnownSun,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            overlap_px: INFERENCE_OVERLAP_PX,
            blend: Blend::DemMosaic,
            anchor: true,
            threads: 0,
            sun: KnownSun::default(),
        }
    }
}

impl Options {
    /// The overlap for tiles of this shape: 100 px as in the paper ("padding (100 pixels)", Sec. V-B); for tiles smaller than
    /// the paper's a third of their shorter side (our choice).
    #[must_use]
    pub fn overlap_for(tile: Shape) -> usize {
        let side = tile.rows.min(tile.cols);
        if side >= TILE_ROWS { INFERENCE_OVERLAP_PX } else { side / 3 }
    }
}

/// What became of the tiles of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tally {
    /// Tiles the scene was cut into.
    pub tiles: usize,
    /// Tiles left out because their rows were made before.
    pub tiles_before: usize,
    /// Of those made now, tiles without image contrast or coarse relief: there the coarse heights stand.
    pub tiles_coarse: usize,
    /// Of those made now, tiles without a valid pixel.
    pub tiles_empty: usize,
    /// Where the scene's light comes from.
    pub light: LightSource,
}

/// What [`predict`] made.
#[derive(Debug, Clone)]
pub struct Prediction {
    /// Heights, metres, on the image's grid; NaN where image or coarse DTM are invalid.
    pub dtm: Raster,
    /// What became of the tiles.
    pub tally: Tally,
}

/// Hears (tiles done, tiles in all) at the start and after each tile, and may stop the run.
pub type Progress<'a> = &'a mut dyn FnMut(usize, usize) -> ControlFlow<()>;

/// As [`predict_rows`], into memory.
///
/// # Errors
/// As there.
pub fn predict(scene: &Scene, model: &dyn Model, options: &Options, progress: Progress) -> Result<Prediction> {
    let mut samples = Vec::with_capacity(scene.rows * scene.cols);
    let mut keep = |rows: &[f32]| {
        samples.extend_from_slice(rows);
        Ok(())
    };
    let tally = predict_rows(scene, model, options, 0, &mut keep, progress)?;
    let dtm = Raster { rows: scene.rows, cols: scene.cols, samples, georef: Some(scene.georef.clone()) };
    Ok(Prediction { dtm, tally })
}

/// Runs `model` over `scene` from row `from` on and hands finished rows to `keep`, in order, heights in metres, NaN where image or
/// coarse DTM are invalid. Memory does not depend on the number of rows.
///
/// The scene is cut into overlapping tiles ([`Tiling`]); one smaller than a tile is continued by its last row and column to the tile's
/// size. Every tile is mirrored if it is lit from elsewhere than the model knows ([`elunar_net::illumination`]), normalised by its own
/// ranges, predicted, recovered to metres (Eq. 8), anchored to the coarse DTM if `options` says so, mirrored back and blended.
/// The result is the same for every number of threads and every `from`: tiles are blended in reading order, whoever finished first.
///
/// # Errors
/// [`Error::Usage`] if the overlap does not fit the model's tile, no pixel of the scene has both a valid image sample and a valid
/// coarse height, or the run was stopped; the model's, the files' and `keep`'s own errors.
pub fn predict_rows(
    scene: &Scene,
    model: &dyn Model,
    options: &Options,
    from: usize,
    keep: &mut dyn FnMut(&[f32]) -> Result<()>,
    progress: Progress,
) -> Result<Tally> {
    let input = model.input_rules();
    let lighting = scene.light_for(input.illumination, options.sun)?;
    let rules = Rules::new(input, lighting, scene, options);
    let makers = || -> Result<Box<dyn TileMaker + '_>> { Ok(Box::new(TileWorker::new(model.worker()?, rules))) };
    let cut = Cut { tile: model.tile(), overlap_px: options.overlap_px, threads: options.threads };
    Ok(Tally { light: lighting.source, ..make_rows(scene, cut, &makers, from, keep, progress)? })
}

/// How a scene is cut into tiles and shared out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Cut {
    /// Rows and columns of a tile.
    pub(crate) tile: Shape,
    /// Pixels by which neighbouring tiles overlap; less than either side of a tile.
    pub(crate) overlap_px: usize,
    /// Threads; 0 takes as many as the machine offers.
    pub(crate) threads: usize,
}

/// What makes the heights of a tile, with its own scratch memory: one per thread.
pub(crate) trait TileMaker {
    /// Makes the heights of `window` of the scene, of which `band` holds the rows.
    ///
    /// # Errors
    /// The maker's own; they end the run.
    fn make(&mut self, band: &Band, window: Window) -> Result<Outcome>;
}

impl TileMaker for TileWorker<'_> {
    fn make(&mut self, band: &Band, window: Window) -> Result<Outcome> {
        self.run(band, window)
    }
}

/// Where each thread gets its maker from.
pub(crate) type Makers<'a> = dyn Fn() -> Result<Box<dyn TileMaker + 'a>> + Sync + 'a;

/// As [`predict_rows`], whoever makes the tiles.
///
/// # Errors
/// As there, with the makers' errors in place of the model's.
pub(crate) fn make_rows<'a>(
    scene: &Scene,
    cut: Cut,
    makers: &'a Makers<'a>,
    from: usize,
    keep: &mut dyn FnMut(&[f32]) -> Result<()>,
    progress: Progress,
) -> Result<Tally> {
    let covered = Shape::new(scene.rows.max(cut.tile.rows), scene.cols.max(cut.tile.cols));
    let tiling = Tiling::new(covered, cut.tile, cut.overlap_px).map_err(|e| Error::usage(format!("overlap: {e}")))?;
    let first = tiling.iter().take_while(|window| window.row + window.rows <= from).count();
    let threads = match cut.threads {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        threads => threads,
    };
    let mosaic = Mosaic::from_row(from, scene.rows, scene.cols);
    let tally = Tally { tiles: tiling.len(), tiles_before: first, ..Tally::default() };
    let mut sink = Sink { mosaic, tiling, keep, tally };
    let stopped = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let (give, take) = sync_channel(2 * threads);
        let (send, receive) = sync_channel(2 * threads);
        let take = Arc::new(Mutex::new(take));
        for _ in 0..threads.min(tiling.len()) {
            let (take, send, stopped) = (take.clone(), send.clone(), &stopped);
            scope.spawn(move || work(makers, &take, stopped, &send));
        }
        // With the last worker its end of the channel goes, so the reader does not wait for anybody.
        drop(take);
        scope.spawn(move || read(scene, tiling, first, &give, &send));
        let joined = sink.collect(first, &receive, progress);
        stopped.store(true, Ordering::Relaxed);
        // A worker may be waiting for room in the channel: it must see that nobody listens any more.
        drop(receive);
        joined
    })?;
    if from == 0 && sink.tally.tiles_empty == sink.tally.tiles {
        return Err(scene.nothing_valid());
    }
    sink.finish()
}

/// A tile to be made: its number, its place, and the rows it lies in.
type Job = (usize, Window, Arc<Band>);
/// A tile that was made, or why not.
type Made = (usize, Result<Outcome>);

/// Reads the scene band by band and hands out its tiles in reading order.
fn read(scene: &Scene, tiling: Tiling, first: usize, give: &SyncSender<Job>, send: &SyncSender<Made>) {
    let mut band: Option<Arc<Band>> = None;
    for (index, window) in tiling.iter().enumerate().skip(first) {
        let current = match band.take().filter(|band| band.first == window.row) {
            Some(band) => band,
            None => match scene.band(window.row, window.rows.min(scene.rows - window.row)) {
                Ok(band) => Arc::new(band),
                Err(error) => {
                    // Nobody listens only if the run ended for another reason.
                    let _ = send.send((index, Err(error)));
                    return;
                }
            },
        };
        if give.send((index, window, current.clone())).is_err() {
            return;
        }
        band = Some(current);
    }
}

/// One thread: makes tiles until none is left.
fn work<'a>(makers: &'a Makers<'a>, take: &Mutex<Receiver<Job>>, stopped: &AtomicBool, send: &SyncSender<Made>) {
    let mut worker = makers();
    while !stopped.load(Ordering::Relaxed) {
        let worker = match &mut worker {
            Ok(worker) => worker,
            Err(_) => break,
        };
        // The lock is held while waiting: whoever waits longest gets the next tile.
        let job = take.lock().map(|take| take.recv());
        let Ok(Ok((index, window, band))) = job else { return };
        if send.send((index, worker.make(&band, window))).is_err() {
            return;
        }
    }
    if let Err(error) = worker {
        // Nobody listens only if another thread reported first.
        let _ = send.send((0, Err(error)));
    }
}

/// Puts outcomes back into order and joins them.
struct Sink<'a> {
    mosaic: Mosaic,
    tiling: Tiling,
    keep: &'a mut dyn FnMut(&[f32]) -> Result<()>,
    tally: Tally,
}

impl Sink<'_> {
    fn collect(&mut self, first: usize, receive: &Receiver<Made>, progress: Progress) -> Result<()> {
        let mut waiting = BTreeMap::new();
        let (mut done, mut joined, all) = (first, first, self.tiling.len());
        while done < all {
            if progress(done, all).is_break() {
                return Err(Error::usage(format!("stopped after {done} of {all} tiles")));
            }
            let Ok((index, outcome)) = receive.recv() else {
                return Err(Error::usage(format!("{done} of {all} tiles were predicted before the threads ended")));
            };
            waiting.insert(index, outcome?);
            done += 1;
            while let Some(outcome) = waiting.remove(&joined) {
                self.join(joined, outcome)?;
                joined += 1;
            }
        }
        // Too late to stop: the work is done.
        let _ = progress(done, all);
        Ok(())
    }

    fn join(&mut self, index: usize, outcome: Outcome) -> Result<()> {
        let Some(window) = self.tiling.get(index) else { return Ok(()) };
        let (heights_m, weights) = match outcome {
            Outcome::Predicted { heights_m, weights } => (heights_m, weights),
            Outcome::Coarse { heights_m, weights } => {
                self.tally.tiles_coarse += 1;
                (heights_m, weights)
            }
            Outcome::Empty => {
                self.tally.tiles_empty += 1;
                return Ok(());
            }
        };
        self.mosaic.add(window.row, window.col, window.cols, &heights_m, &weights)?;
        let finished = self.mosaic.take_finished();
        if finished.is_empty() { Ok(()) } else { (self.keep)(&finished) }
    }

    fn finish(self) -> Result<Tally> {
        (self.keep)(&self.mosaic.finish())?;
        Ok(self.tally)
    }
}
