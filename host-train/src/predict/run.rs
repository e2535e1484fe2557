//! All tiles of a scene, on several threads, in one order.

use super::network::Model;
use super::scene::Scene;
use super::tile::{Outcome, TileWorker};
use crate::illumination::Turn;
use crate::mosaic::{Blend, Mosaic};
use crate::raster::Raster;
use crate::{Error, Result};
use elunar_core::tile::{INFERENCE_OVERLAP_PX, TILE_ROWS, Tiling};
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc;

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
    /// Azimuth of the Sun, degrees clockwise from the grid's up; `None` estimates it from image and coarse DTM. Only models that
    /// know one light ask for it.
    pub sun_azimuth_deg: Option<f64>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            overlap_px: INFERENCE_OVERLAP_PX,
            blend: Blend::DemMosaic,
            anchor: true,
            threads: 0,
            sun_azimuth_deg: None,
        }
    }
}

impl Options {
    /// The overlap for tiles of (rows, columns): 100 px as in the paper ("padding (100 pixels)", Sec. V-B); for tiles smaller than
    /// the paper's a third of their shorter side (our choice).
    #[must_use]
    pub fn overlap_for(tile: (usize, usize)) -> usize {
        let side = tile.0.min(tile.1);
        if side >= TILE_ROWS { INFERENCE_OVERLAP_PX } else { side / 3 }
    }
}

/// What [`predict`] made.
#[derive(Debug, Clone)]
pub struct Prediction {
    /// Heights, metres, on the image's grid; NaN where image or coarse DTM are invalid.
    pub dtm: Raster,
    /// Tiles the scene was cut into.
    pub tiles: usize,
    /// Of these, tiles without image contrast or coarse relief: there the coarse heights stand.
    pub tiles_coarse: usize,
    /// Of these, tiles without a valid pixel.
    pub tiles_empty: usize,
}

/// Runs `model` over `scene`. `progress` hears (tiles done, tiles in all) at the start and after each tile, and may stop the run.
///
/// A scene lit from elsewhere than the model knows is mirrored first, and the result mirrored back ([`crate::illumination`]).
/// The scene is cut into overlapping tiles ([`Tiling`]); one smaller than a tile is continued by its last row and column to the tile's
/// size. Every tile is normalised by its own ranges, predicted, recovered to metres (Eq. 8), anchored to the coarse DTM if `options` says so, and blended. The result is the same for
/// every number of threads: tiles are blended in reading order, whoever finished first.
///
/// # Errors
/// [`Error::Usage`] if the overlap does not fit the model's tile or the run was stopped; the model's own errors.
pub fn predict(
    scene: &Scene,
    model: &dyn Model,
    options: &Options,
    progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<Prediction> {
    let illumination = model.normalisation().illumination;
    let shape = (scene.rows, scene.cols);
    let turn = Turn::wanted(illumination, options.sun_azimuth_deg, &scene.image, &scene.coarse_m, shape);
    let turned = (!turn.is_none()).then(|| scene.turned(turn));
    let scene = turned.as_ref().unwrap_or(scene);
    let tile = model.tile();
    let covered = (scene.rows.max(tile.0), scene.cols.max(tile.1));
    let tiling = Tiling::new(covered, tile, options.overlap_px).map_err(|e| Error::usage(format!("overlap: {e}")))?;
    let mut sink = Sink { mosaic: Mosaic::new(scene.rows, scene.cols), tiling, tiles_coarse: 0, tiles_empty: 0 };
    let threads = match options.threads {
        0 => std::thread::available_parallelism().map_or(1, usize::from),
        threads => threads,
    };
    let (next, stopped) = (AtomicUsize::new(0), AtomicBool::new(false));
    std::thread::scope(|scope| {
        let (send, receive) = mpsc::sync_channel(2 * threads);
        for _ in 0..threads.min(tiling.len()) {
            let (send, next, stopped) = (send.clone(), &next, &stopped);
            scope.spawn(move || work(scene, model, options, tiling, next, stopped, &send));
        }
        drop(send);
        let joined = sink.collect(&receive, progress);
        stopped.store(true, Ordering::Relaxed);
        // A worker may be waiting for room in the channel: it must see that nobody listens any more.
        drop(receive);
        joined
    })?;
    let mut prediction = sink.finish(scene);
    prediction.dtm.samples = turn.apply(&prediction.dtm.samples, scene.cols);
    Ok(prediction)
}

/// One thread: takes the next tile until none is left.
fn work(
    scene: &Scene,
    model: &dyn Model,
    options: &Options,
    tiling: Tiling,
    next: &AtomicUsize,
    stopped: &AtomicBool,
    send: &mpsc::SyncSender<(usize, Result<Outcome>)>,
) {
    let mut worker = model.worker().map(|network| TileWorker::new(scene, network, model.normalisation(), options));
    while !stopped.load(Ordering::Relaxed) {
        let index = next.fetch_add(1, Ordering::Relaxed);
        let Some(window) = tiling.get(index) else { return };
        let outcome = match &mut worker {
            Ok(worker) => worker.run(window),
            Err(_) => break,
        };
        if send.send((index, outcome)).is_err() {
            return;
        }
    }
    if let Err(error) = worker {
        // Nobody listens only if another thread reported first.
        let _ = send.send((0, Err(error)));
    }
}

/// Puts outcomes back into order and joins them.
struct Sink {
    mosaic: Mosaic,
    tiling: Tiling,
    tiles_coarse: usize,
    tiles_empty: usize,
}

impl Sink {
    fn collect(
        &mut self,
        receive: &mpsc::Receiver<(usize, Result<Outcome>)>,
        progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
    ) -> Result<()> {
        let mut waiting = BTreeMap::new();
        let (mut done, mut joined, all) = (0, 0, self.tiling.len());
        while done < all {
            if progress(done, all).is_break() {
                return Err(Error::usage(format!("stopped after {done} of {all} tiles; nothing was written")));
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
                self.tiles_coarse += 1;
                (heights_m, weights)
            }
            Outcome::Empty => {
                self.tiles_empty += 1;
                return Ok(());
            }
        };
        self.mosaic.add(window.row, window.col, window.cols, &heights_m, &weights)
    }

    fn finish(self, scene: &Scene) -> Prediction {
        let (rows, cols, georef) = (scene.rows, scene.cols, Some(scene.georef.clone()));
        let dtm = Raster { rows, cols, samples: self.mosaic.finish(), georef };
        Prediction { dtm, tiles: self.tiling.len(), tiles_coarse: self.tiles_coarse, tiles_empty: self.tiles_empty }
    }
}
