//! Pictures of a prepared set: samples, and the histograms for the 3-sigma rule and NR.

use super::filter::difference_m;
use super::inspect::Tile;
use super::manifest::ThreeSigma;
use super::shard::ShardFile;
use crate::sample::RawTile;
use elunar_base::Result;
use elunar_core::terrain::PixelSize;
use elunar_picture::{Panel, histogram, relief, sheet, stretch, write_png};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use std::path::{Path, PathBuf};

/// Names of the pictures: contact sheet, reliefs, differences of reliefs.
pub(super) const FILES: [&str; 3] = ["contact_sheet.png", "relief.png", "relief_difference.png"];
/// Number of samples on the contact sheet.
const SAMPLES: usize = 6;
/// Width of a picture on the contact sheet, pixels.
const PANEL_PX: u32 = 240;

/// Writes `contact_sheet.png`: random samples of the shards, in rows of images, coarse DTMs and true DTMs (after Fig. 9). The two DTMs of a
/// sample have the same colour scale.
pub(super) fn write_sheet(folder: &Path, shards: &[(&str, PathBuf)], seed: u64) -> Result<()> {
    let mut files = vec![];
    for (name, path) in shards {
        files.push((*name, ShardFile::open(path)?));
    }
    let places: Vec<(usize, usize)> =
        files.iter().enumerate().flat_map(|(f, (_, file))| (0..file.len()).map(move |tile| (f, tile))).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut chosen = rand::seq::index::sample(&mut rng, places.len(), SAMPLES.min(places.len())).into_vec();
    chosen.sort_unstable();
    let mut rows: [Vec<Panel>; 3] = Default::default();
    for index in chosen {
        let (f, index) = places[index];
        let tile = files[f].1.tile(index)?;
        for (row, panel) in rows.iter_mut().zip(panels(files[f].0, index, &tile)?) {
            row.push(panel);
        }
    }
    let columns = rows[0].len();
    write_png(&folder.join(FILES[0]), sheet(&rows.concat(), columns, PANEL_PX))
}

fn panels(name: &str, index: usize, tile: &RawTile) -> Result<[Panel; 3]> {
    let RawTile { rows, cols, .. } = *tile;
    let pixel = PixelSize::square(f64::from(tile.pixel_m));
    let both = tile.truth_m.iter().chain(&tile.coarse_m);
    let range = both.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &z| (low.min(z), high.max(z)));
    let dtm = |heights_m: &[f32]| relief(heights_m, rows, cols, pixel, Some(range));
    Ok([
        Panel::new(format!("{name}, tile {index}: image"), stretch(&tile.image, rows, cols)?),
        Panel::new("coarse DTM, interpolated", dtm(&tile.coarse_m)?),
        Panel::new(format!("true DTM, {:.0} m of relief", range.1 - range.0), dtm(&tile.truth_m)?),
    ])
}

/// Writes two histograms. `relief.png` shows the true reliefs of the kept tiles with NR (after Fig. 3). `relief_difference.png` shows ΔZ_N
/// − ΔZ_S of all tiles under the 3-sigma rule, with its limits (after Fig. 7).
pub(super) fn write_histograms(folder: &Path, seen: &[&Tile], kept: &[&Tile], rule: ThreeSigma, nr: f32) -> Result<()> {
    let reliefs: Vec<f64> = kept.iter().map(|t| f64::from(t.relief_truth_m)).collect();
    let lines = [(format!("NR {nr:.1} m"), f64::from(nr))];
    let title = format!("Relief of {} tiles", reliefs.len());
    write_png(&folder.join(FILES[1]), histogram(&title, "true relief, m", &reliefs, &lines)?)?;
    let differences: Vec<f64> = seen.iter().map(|t| difference_m(t)).collect();
    let ThreeSigma { mean_m, sigma_m } = rule;
    let lines = [("mean - 3 sigma", -3.0), ("mean", 0.0), ("mean + 3 sigma", 3.0)]
        .map(|(label, k)| (label.to_owned(), mean_m + k * sigma_m));
    let title = format!("True minus coarse relief of {} tiles", differences.len());
    let picture = histogram(&title, "true relief - coarse relief, m", &differences, &lines)?;
    write_png(&folder.join(FILES[2]), picture)
}
