//! Laser altimeter tracks over a prediction: the points of tables, and the DTM's heights at them.

use elunar_base::{Error, Result};
use elunar_core::tile::Window;
use elunar_evaluate::lola::csv;
use elunar_evaluate::lola::place::{SpotGrid, bilinear};
use elunar_evaluate::lola::track::{TRACK_GAP_S, split};
use elunar_scene::predict::Scene;
use elunar_scene::predict::job::for_each_row;
use elunar_scene::predict::sigma::{CoarseSigma, Covered, SpotError, along_tracks};
use std::path::PathBuf;

/// The samples that a point lies between.
const PATCH: Window = Window { row: 0, col: 0, rows: 2, cols: 2 };

/// Points of tracks on a scene's grid.
pub(super) struct Tracks {
    /// The tables, for messages.
    name: String,
    spots: Vec<Spot>,
    cols: usize,
    coarse_pixel_m: f32,
}

/// A laser spot inside the image.
struct Spot {
    track: usize,
    row: f64,
    col: f64,
    cell: (usize, usize),
    height_m: f64,
}

impl Tracks {
    /// Reads the points of tables that lie inside the image.
    ///
    /// # Errors
    /// As [`csv::read`], or if too few lie inside.
    pub(super) fn open(tables: &[PathBuf], scene: &Scene, image: &str) -> Result<Self> {
        let grid = SpotGrid::new(Some(&scene.georef), (scene.rows, scene.cols), image)?;
        let coarse_px = f64::from(scene.coarse_px);
        let cell = |at: f64| (at / coarse_px) as usize;
        let (mut spots, mut count) = (vec![], 0);
        for path in tables {
            let table = csv::read(path, None, grid.sphere_m())?;
            for track in split(&table.points, TRACK_GAP_S) {
                spots.extend(track.iter().filter_map(|point| {
                    let (row, col) = grid.place(point)?;
                    Some(Spot { track: count, row, col, cell: (cell(row), cell(col)), height_m: point.height_m })
                }));
                count += 1;
            }
        }
        let names: Vec<String> = tables.iter().map(|path| path.display().to_string()).collect();
        let coarse_pixel_m = scene.coarse_px * scene.pixel_m;
        let tracks = Self { name: names.join(", "), spots, cols: scene.cols, coarse_pixel_m };
        let covered = Covered::of(tracks.spots.iter().map(|spot| (spot.track, spot.cell)));
        if covered.is_enough() { Ok(tracks) } else { Err(tracks.too_few(covered, "inside the image")) }
    }

    /// Returns what sees the finished rows, from the first to the last.
    pub(super) fn seen(&self) -> Seen<'_> {
        let mut wanted: Vec<(usize, usize)> = vec![];
        for (index, spot) in self.spots.iter().enumerate() {
            wanted.extend([(spot.row as usize, index), (spot.row as usize + 1, index)]);
        }
        wanted.sort_unstable();
        Seen { tracks: self, wanted, next: 0, row: 0, patches: vec![[[f32::NAN; 4]; 2]; self.spots.len()] }
    }

    fn too_few(&self, Covered { cells, tracks }: Covered, place: &str) -> Error {
        let (least_cells, least_tracks) = (Covered::LEAST_CELLS, Covered::LEAST_TRACKS);
        Error::input(format!(
            "{}: points in at least {least_cells} coarse pixels on {least_tracks} tracks expected {place}, found in {cells} on {tracks} \
             (times cut tracks; a table without times is one): --coarse-sigma M tells the standard deviation instead",
            self.name
        ))
    }
}

/// The rows of a DTM at the points of tracks.
pub(super) struct Seen<'a> {
    tracks: &'a Tracks,
    /// Rows with the points that need them, in order.
    wanted: Vec<(usize, usize)>,
    next: usize,
    row: usize,
    /// Heights about each point, and the standard deviations that the image leaves.
    patches: Vec<[[f32; 4]; 2]>,
}

impl Seen<'_> {
    /// Sees the next rows.
    pub(super) fn add(&mut self, rows: &[f32]) {
        let cols = self.tracks.cols;
        for_each_row(rows, cols, |heights_m, expected_m| {
            while let Some(&(row, index)) = self.wanted.get(self.next).filter(|wanted| wanted.0 == self.row) {
                let spot = &self.tracks.spots[index];
                let (first, left) = (2 * (row - spot.row as usize), spot.col as usize);
                for (patch, samples) in self.patches[index].iter_mut().zip([heights_m, expected_m]) {
                    let right = samples.get(left + 1).copied().unwrap_or(f32::NAN);
                    patch[first..first + 2].copy_from_slice(&[samples[left], right]);
                }
                self.next += 1;
            }
            self.row += 1;
        });
    }

    /// Returns the standard deviation of the coarse DTM's own heights.
    ///
    /// # Errors
    /// If too few points lie on heights.
    pub(super) fn sigma(self) -> Result<CoarseSigma> {
        let error = |(spot, [heights_m, expected_m]): (&Spot, &[[f32; 4]; 2])| {
            let at = |patch: &[f32; 4]| bilinear(patch, PATCH, spot.row.fract(), spot.col.fract());
            let (error_m, expected_m) = (at(heights_m) - spot.height_m, at(expected_m));
            let found = SpotError { track: spot.track, cell: spot.cell, error_m, expected_m };
            (error_m.is_finite() && expected_m.is_finite()).then_some(found)
        };
        let errors: Vec<SpotError> = self.tracks.spots.iter().zip(&self.patches).filter_map(error).collect();
        let too_few = |covered| self.tracks.too_few(covered, "on heights of the DTM, gross errors left out,");
        let found = along_tracks(&errors).map_err(too_few)?;
        Ok(CoarseSigma::found(found, self.tracks.coarse_pixel_m))
    }
}
