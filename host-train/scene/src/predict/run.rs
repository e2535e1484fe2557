//! All tiles of a scene on several threads, joined in a fixed order.

use super::neighbourhoods::{Change, SceneLight};
use super::network::TileModel;
use super::scene::{Band, Scene};
use super::span::Span;
use super::tile::{Rules, TileOutcome, TileResult, TileWorker};
use crate::mosaic::Mosaic;
use elunar_base::{Error, HAS_THREADS, Result};
use elunar_core::tile::{INFERENCE_OVERLAP_PX, Shape, TILE_ROWS, Tiling, Window};
use elunar_net::illumination::{KnownSun, Lighting};
use elunar_net::sun::check_sun;
use elunar_raster::Raster;
use std::collections::BTreeMap;
use std::ops::{ControlFlow, Range};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};

/// Options of a prediction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PredictOptions {
    /// Overlap of neighbouring tiles, pixels; less than either side of a tile. See [`PredictOptions::overlap_for`].
    pub overlap_px: usize,
    /// Whether each tile's long waves are drawn to the coarse DTM's ([`elunar_core::norm::Anchor`]), and of its short waves what the image
    /// shows ([`elunar_core::norm::FineWaves`]); our choice. Otherwise they come from the network (the paper).
    pub anchor: bool,
    /// Number of threads; 0 takes as many as the machine offers.
    pub threads: usize,
    /// The known parts of the Sun's direction. The unknown parts are fitted to image and coarse DTM. Models for any light do not use it.
    pub sun: KnownSun,
    /// Whether expected errors are made with the heights ([`PredictOptions::layers`]). The model must have weighed maps; otherwise they are NaN.
    pub expected_errors: bool,
}

impl Default for PredictOptions {
    fn default() -> Self {
        Self {
            overlap_px: INFERENCE_OVERLAP_PX,
            anchor: true,
            threads: 0,
            sun: KnownSun::default(),
            expected_errors: false,
        }
    }
}

impl PredictOptions {
    /// Number of maps in a finished row, one after the other: heights, metres; and if wanted the parts of
    /// [`elunar_core::photoclinometry::Errors`].
    #[must_use]
    pub fn layers(&self) -> usize {
        if self.expected_errors { TileResult::LAYERS } else { 1 }
    }

    /// Returns the tiles of a scene.
    ///
    /// # Errors
    /// [`Error::Usage`] if the overlap does not fit the tile.
    pub fn tiling(&self, scene: &Scene, tile: Shape) -> Result<Tiling> {
        Cut::new(tile, self.overlap_px, 1, 1).tiling(scene)
    }

    /// Returns the overlap for tiles of this shape: 100 px as in the paper ("padding (100 pixels)", Sec. V-B). For tiles smaller than the
    /// paper's it is a third of their shorter side (our choice).
    #[must_use]
    pub fn overlap_for(tile: Shape) -> usize {
        let side = tile.rows.min(tile.cols);
        if side >= TILE_ROWS { INFERENCE_OVERLAP_PX } else { side / 3 }
    }
}

/// Number of tiles of a scene, by their result.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tally {
    /// Tiles of the scene.
    pub tiles: usize,
    /// Tiles left out because their rows existed already.
    pub tiles_before: usize,
    /// Tiles of this run without image contrast or coarse relief. They keep the coarse heights.
    pub tiles_coarse: usize,
    /// Tiles of this run without a valid pixel.
    pub tiles_empty: usize,
    /// The light of the whole scene.
    pub light: Lighting,
    /// How it changes across the scene; `None` if the scene has one light.
    pub change: Option<Change>,
}

/// The result of [`predict`].
#[derive(Debug, Clone)]
pub struct Prediction {
    /// Heights, metres, on the image's grid; NaN where image or coarse DTM is invalid.
    pub dtm: Raster,
    /// Number of tiles, by their result.
    pub tally: Tally,
}

/// Receives (tiles done, all tiles) at the start and after each tile, and can stop the run.
pub type TileProgress<'a> = &'a mut dyn FnMut(usize, usize) -> ControlFlow<()>;

/// Predicts a scene as [`predict_rows`] does, in memory: the heights alone.
///
/// # Errors
/// As [`predict_rows`].
pub fn predict(
    scene: &Scene,
    model: &dyn TileModel,
    options: &PredictOptions,
    progress: TileProgress,
) -> Result<Prediction> {
    let mut samples = Vec::with_capacity(scene.rows * scene.cols);
    let mut keep = |rows: &[f32]| {
        samples.extend_from_slice(rows);
        Ok(())
    };
    let options = PredictOptions { expected_errors: false, ..*options };
    let tally = predict_rows(scene, model, &options, 0, &mut keep, progress)?;
    let dtm = Raster { rows: scene.rows, cols: scene.cols, samples, georef: Some(scene.georef.clone()) };
    Ok(Prediction { dtm, tally })
}

/// Runs `model` on `scene` from row `from` on. Passes finished rows to `keep` in order: heights in metres, NaN where image or coarse DTM is
/// invalid, each followed by its other maps if `options` asks for them ([`PredictOptions::layers`]). Memory does not depend on the number of rows.
///
/// The scene is cut into overlapping tiles ([`Tiling`]). A scene smaller than a tile is extended to the tile's size by its last row and
/// column. Every tile is mirrored if its light does not come from the model's direction ([`elunar_net::illumination`]), normalised by its
/// own ranges, predicted, recovered to metres (Eq. 8), anchored to the coarse DTM if `options` says so, mirrored back and blended. Tiles
/// are blended in reading order, whichever thread finishes first. The result is the same for every number of threads and every `from`.
///
/// # Errors
/// [`Error::Usage`] if an angle of the Sun is out of range, or the overlap does not fit the model's tile; [`Error::Input`] if no pixel of the
/// scene has both a valid image sample and a valid coarse height; [`Error::Stopped`] if the run was stopped. Errors of the model, the files and `keep` are passed on.
pub fn predict_rows(
    scene: &Scene,
    model: &dyn TileModel,
    options: &PredictOptions,
    from: usize,
    keep: &mut dyn FnMut(&[f32]) -> Result<()>,
    progress: TileProgress,
) -> Result<Tally> {
    check_sun(options.sun)?;
    let light = scene.light_for(model.input_rules().illumination, options.sun)?;
    predict_span(scene, model, options, light, &Span { rows: 0..scene.rows, from }, keep, progress)
}

/// Runs `model` as [`predict_rows`] does, under a known light, on the rows of `span`. The rows of all parts of a scene are those of the whole.
///
/// # Errors
/// As [`predict_rows`]. [`Error::Usage`] if the scene lacks the rows.
pub fn predict_span(
    scene: &Scene,
    model: &dyn TileModel,
    options: &PredictOptions,
    light: SceneLight,
    span: &Span,
    keep: &mut dyn FnMut(&[f32]) -> Result<()>,
    progress: TileProgress,
) -> Result<Tally> {
    let (whole, change) = (light.whole, light.change());
    let rules = Rules::new(model, light, scene, options);
    let makers = || -> Result<Box<dyn TileMaker + '_>> {
        Ok(Box::new(TileWorker::new(model.worker()?, model.tile(), rules.clone())))
    };
    let cut = Cut::new(model.tile(), options.overlap_px, options.threads, options.layers());
    Ok(Tally { light: whole, change, ..make_rows(scene, cut, &makers, span, keep, progress)? })
}

/// How a scene is cut into tiles and shared between threads.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Cut {
    /// Rows and columns of a tile.
    pub(crate) tile: Shape,
    /// Overlap of neighbouring tiles, pixels; less than either side of a tile.
    pub(crate) overlap_px: usize,
    /// Number of threads; 0 takes as many as the machine offers.
    pub(crate) threads: usize,
    /// Number of maps of a tile.
    pub(crate) layers: usize,
    /// Whether this thread makes all tiles.
    pub(super) alone: bool,
}

impl Cut {
    pub(crate) fn new(tile: Shape, overlap_px: usize, threads: usize, layers: usize) -> Self {
        Self { tile, overlap_px, threads, layers, alone: !HAS_THREADS }
    }

    /// Returns the tiles of a scene.
    ///
    /// # Errors
    /// [`Error::Usage`] if the overlap does not fit the tile.
    fn tiling(&self, scene: &Scene) -> Result<Tiling> {
        let covered = Shape::new(scene.rows.max(self.tile.rows), scene.cols.max(self.tile.cols));
        Tiling::new(covered, self.tile, self.overlap_px).map_err(|e| Error::usage(format!("overlap: {e}")))
    }
}

/// Makes the heights of a tile, with its own scratch memory. Each thread has one.
pub(crate) trait TileMaker {
    /// Makes the heights of `window` of the scene. `band` holds the window's rows.
    ///
    /// # Errors
    /// Errors of the maker. They end the run.
    fn make(&mut self, band: &Band, window: Window) -> Result<TileOutcome>;
}

impl TileMaker for TileWorker<'_> {
    fn make(&mut self, band: &Band, window: Window) -> Result<TileOutcome> {
        self.run(band, window)
    }
}

/// Makes the maker of each thread.
pub(crate) type Makers<'a> = dyn Fn() -> Result<Box<dyn TileMaker + 'a>> + Sync + 'a;

/// Makes rows as [`predict_rows`] does, with any maker of tiles.
///
/// # Errors
/// As [`predict_rows`], with the makers' errors in place of the model's.
pub(crate) fn make_rows<'a>(
    scene: &Scene,
    cut: Cut,
    makers: &'a Makers<'a>,
    span: &Span,
    keep: &mut dyn FnMut(&[f32]) -> Result<()>,
    progress: TileProgress,
) -> Result<Tally> {
    span.check(scene.rows)?;
    let tiling = cut.tiling(scene)?;
    let reaches_above = |row: usize| tiling.iter().take_while(|window| window.row + window.rows <= row).count();
    let (before, first) = (reaches_above(span.rows.start), reaches_above(span.from));
    // What begins below the last row reaches none of the span.
    let last = tiling.iter().take_while(|window| window.row < span.rows.end).count().max(first);
    let threads = match cut.threads {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        threads => threads,
    };
    let mosaics = (0..cut.layers).map(|_| Mosaic::from_row(span.from, span.rows.end, scene.cols)).collect();
    let tally = Tally { tiles: last - before, tiles_before: first - before, ..Tally::default() };
    let own_from = span.rows.start;
    let mut sink = Sink { mosaics, scene, tiling, own_from, keep, tally };
    if cut.alone {
        one_by_one(makers, (before, first..last), &mut sink, progress)?;
    } else {
        with_threads(threads, makers, (before, first..last), &mut sink, progress)?;
    }
    if span.from == 0 && span.rows.end == scene.rows && sink.tally.tiles_empty == sink.tally.tiles {
        return Err(scene.nothing_valid());
    }
    sink.finish()
}

/// Makes the tiles of a sink on this thread.
fn one_by_one<'a>(
    makers: &'a Makers<'a>,
    (before, tiles): (usize, Range<usize>),
    sink: &mut Sink,
    progress: TileProgress,
) -> Result<()> {
    let mut maker = makers()?;
    let mut cut = cut_tiles(sink.scene, sink.tiling, tiles.clone());
    let mut next = || cut.next().map(|(index, window, band)| (index, band.and_then(|band| maker.make(&band, window))));
    sink.collect((before, tiles), &mut next, progress)
}

/// Makes the tiles of a sink on several threads, beside one that reads the scene.
fn with_threads<'a>(
    threads: usize,
    makers: &'a Makers<'a>,
    (before, tiles): (usize, Range<usize>),
    sink: &mut Sink,
    progress: TileProgress,
) -> Result<()> {
    let (scene, tiling) = (sink.scene, sink.tiling);
    let stopped = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let (give, take) = sync_channel(2 * threads);
        let (send, receive) = sync_channel(2 * threads);
        let take = Arc::new(Mutex::new(take));
        for _ in 0..threads.min(tiles.len()) {
            let (take, send, stopped) = (take.clone(), send.clone(), &stopped);
            scope.spawn(move || work(makers, &take, stopped, &send));
        }
        // The channel closes with the last worker, so that the reader does not block.
        drop(take);
        let wanted = tiles.clone();
        scope.spawn(move || read(scene, tiling, wanted, &give, &send));
        let joined = sink.collect((before, tiles), &mut || receive.recv().ok(), progress);
        stopped.store(true, Ordering::Relaxed);
        // A worker may wait for room in the channel. It must notice that the receiver is gone.
        drop(receive);
        joined
    })
}

/// A tile to be made: its number, its window, and the band that holds its rows.
type Job = (usize, Window, Arc<Band>);
/// A tile that was made, or the error.
type Made = (usize, Result<TileOutcome>);

/// Reads the scene band by band and sends its tiles in reading order.
fn read(scene: &Scene, tiling: Tiling, tiles: Range<usize>, give: &SyncSender<Job>, send: &SyncSender<Made>) {
    for (index, window, band) in cut_tiles(scene, tiling, tiles) {
        let is_taken = match band {
            Ok(band) => give.send((index, window, band)).is_ok(),
            Err(error) => {
                // Sending fails only if the run has ended for another reason.
                let _ = send.send((index, Err(error)));
                false
            }
        };
        if !is_taken {
            return;
        }
    }
}

/// Returns tiles in reading order, each with the band that holds its rows.
fn cut_tiles(
    scene: &Scene,
    tiling: Tiling,
    tiles: Range<usize>,
) -> impl Iterator<Item = (usize, Window, Result<Arc<Band>>)> {
    let mut band: Option<Arc<Band>> = None;
    tiling.iter().enumerate().take(tiles.end).skip(tiles.start).map(move |(index, window)| {
        let rows = window.rows.min(scene.rows - window.row);
        let current = match band.take() {
            Some(band) if band.first == window.row => Ok(band),
            before => scene.band_after(before.as_deref(), window.row, rows).map(Arc::new),
        };
        band = current.as_ref().ok().cloned();
        (index, window, current)
    })
}

/// Makes tiles on one thread until none is left.
fn work<'a>(makers: &'a Makers<'a>, take: &Mutex<Receiver<Job>>, stopped: &AtomicBool, send: &SyncSender<Made>) {
    let mut worker = makers();
    while !stopped.load(Ordering::Relaxed) {
        let worker = match &mut worker {
            Ok(worker) => worker,
            Err(_) => break,
        };
        // The lock is held during the wait, so that the thread that waits longest gets the next tile.
        let job = take.lock().map(|take| take.recv());
        let Ok(Ok((index, window, band))) = job else { return };
        if send.send((index, worker.make(&band, window))).is_err() {
            return;
        }
    }
    if let Err(error) = worker {
        // Sending fails only if another thread has reported first.
        let _ = send.send((0, Err(error)));
    }
}

/// Sorts the results of tiles into reading order and joins them.
struct Sink<'a> {
    /// One for each map.
    mosaics: Vec<Mosaic>,
    scene: &'a Scene,
    tiling: Tiling,
    /// Tiles above this row belong to another part, which counts them.
    own_from: usize,
    keep: &'a mut dyn FnMut(&[f32]) -> Result<()>,
    tally: Tally,
}

impl Sink<'_> {
    fn collect(
        &mut self,
        (before, tiles): (usize, Range<usize>),
        next: &mut dyn FnMut() -> Option<Made>,
        progress: TileProgress,
    ) -> Result<()> {
        let mut waiting = BTreeMap::new();
        let (mut done, mut joined, all) = (tiles.start, tiles.start, tiles.end);
        while done < all {
            let (made, asked) = (done - before, all - before);
            if progress(made, asked).is_break() {
                return Err(Error::stopped(format!("stopped after {made} of {asked} tiles")));
            }
            let Some((index, outcome)) = next() else {
                return Err(Error::input(format!("{made} of {asked} tiles were predicted before the threads ended")));
            };
            waiting.insert(index, outcome?);
            done += 1;
            while let Some(outcome) = waiting.remove(&joined) {
                self.join(joined, outcome)?;
                joined += 1;
            }
        }
        // The work is complete, so a request to stop has no effect.
        let _ = progress(done - before, all - before);
        Ok(())
    }

    fn join(&mut self, index: usize, outcome: TileOutcome) -> Result<()> {
        let Some(window) = self.tiling.get(index) else { return Ok(()) };
        let (maps, weights) = match outcome {
            TileOutcome::Predicted { maps, weights } => (maps, weights),
            TileOutcome::Coarse { maps, weights } => {
                self.tally.tiles_coarse += usize::from(window.row >= self.own_from);
                (maps, weights)
            }
            TileOutcome::Empty => {
                self.tally.tiles_empty += usize::from(window.row >= self.own_from);
                return Ok(());
            }
        };
        for (mosaic, map) in self.mosaics.iter_mut().zip(&maps.0) {
            mosaic.add(window.row, window.col, window.cols, map, &weights)?;
        }
        let finished = self.mosaics.iter_mut().map(Mosaic::take_finished).collect();
        let rows = interleaved(finished, self.scene.cols);
        if rows.is_empty() { Ok(()) } else { (self.keep)(&rows) }
    }

    fn finish(self) -> Result<Tally> {
        let rest = self.mosaics.into_iter().map(Mosaic::finish).collect();
        (self.keep)(&interleaved(rest, self.scene.cols))?;
        Ok(self.tally)
    }
}

/// Returns the rows of maps, of each row one map after the other.
fn interleaved(mut maps: Vec<Vec<f32>>, cols: usize) -> Vec<f32> {
    if maps.len() == 1 {
        return maps.pop().unwrap_or_default();
    }
    let rows = maps.first().map_or(0, |map| map.len() / cols.max(1));
    let row = |row: usize| maps.iter().flat_map(move |map| &map[row * cols..][..cols]).copied();
    (0..rows).flat_map(row).collect()
}
