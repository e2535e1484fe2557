//! Shape from shading: heights from one image and a coarse DTM without a network. The paper compares itself with this method (Sec. V-B).
//!
//! The scene is cut into tiles as in [`crate::predict`]. The ground has a Lunar–Lambert reflectance, seen from straight above under a known
//! Sun. The solver finds the heights whose brightness fits the image best. Roughness and departure from the coarse DTM add to the cost
//! (`level` defines it, in the form of the Ames Stereo Pipeline's `sfs`). Gauss–Newton steps with conjugate gradients minimise the cost
//! (`solver`), on a pyramid from coarse to fine that starts from the coarse DTM (`pyramid`, `tile`). The albedo is one number per tile.
//! [`SfsJournal`] records every step.

mod curve;
mod journal;
mod level;
mod pyramid;
mod reflectance;
mod settings;
mod solver;
mod tile;

#[cfg(test)]
mod tests;

pub use curve::{CurvePoint, curve, json, seconds_per_tile, write_curve};
pub use journal::{LevelLog, SfsJournal, StepLog, TileLog};
pub use reflectance::{SfsLight, Shade};
pub use settings::{DEM_CONSTRAINT_PER_PX, SMOOTHNESS_PX, SfsSettings};

use crate::predict::span::Span;
use crate::predict::{Cut, Scene, Tally, TileMaker, TileProgress, make_rows};
use elunar_base::{Error, Result};
use elunar_core::tile::Shape;

/// Solves `scene` from row `from` on. Passes finished rows to `keep` in order: heights in metres, NaN where image or coarse DTM is invalid.
/// The result is the same for every number of threads and every `from`.
///
/// # Errors
/// [`Error::Usage`] for settings out of range and an overlap that does not fit the tile; [`Error::Input`] for a scene without a valid pixel or
/// without a pixel size in metres; [`Error::Stopped`] if the run was stopped. Errors of the files and of `keep` are passed on.
pub fn solve_rows(
    scene: &Scene,
    settings: &SfsSettings,
    journal: &SfsJournal,
    from: usize,
    keep: &mut dyn FnMut(&[f32]) -> Result<()>,
    progress: TileProgress,
) -> Result<Tally> {
    settings.light()?;
    let unknown = || Error::input("image: a pixel size in metres expected, none found");
    let pixel_m = scene.georef.pixel_m(scene.rows, scene.cols).ok_or_else(unknown)?;
    let makers = || -> Result<Box<dyn TileMaker + '_>> {
        Ok(Box::new(tile::Solver::new(*settings, Shape::new(scene.rows, scene.cols), pixel_m, journal)?))
    };
    let tile = Shape::new(settings.tile.0, settings.tile.1);
    let cut = Cut::new(tile, settings.overlap_px, settings.threads, 1);
    make_rows(scene, cut, &makers, &Span { rows: 0..scene.rows, from }, keep, progress)
}
