//! Checks whether a tile is useful for training.

use super::manifest::{PrepareOptions, Reason};
use super::offset::{Offset, measure};
use super::scene::{PreparedScene, SceneMaps};
use elunar_base::Result;
use elunar_core::norm::RELIEF_EPS_M;
use elunar_core::terrain::Sun;
use elunar_core::tile::{TILE_COLS, TILE_ROWS, Window};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Elevation of the Sun if none is listed, degrees. The hillshade's pattern hardly depends on it.
const ELEVATION_DEG: f64 = 45.0;

/// If a greater share of pixels has the darkest value, the tile lies in shadow or is clipped (our choice).
const DARKEST_SHARE: f64 = 0.25;

/// Results of the inspection of one tile.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Tile {
    /// First row in the scene.
    pub(super) row: usize,
    /// First column.
    pub(super) col: usize,
    /// ΔZ_N: relief of the true DTM, metres.
    pub(super) relief_truth_m: f32,
    /// ΔZ_S: relief of the coarse DTM, metres.
    pub(super) relief_coarse_m: f32,
    /// Offset of the true DTM from the image; `None` if it could not be measured.
    pub(super) offset: Option<Offset>,
    /// Reason for dropping the tile, if it was dropped.
    pub(super) dropped: Option<Reason>,
}

/// Inspects every tile of a scene separately. Calls `done` after each.
pub(super) fn tiles(
    scene: &PreparedScene,
    sun_elevation_deg: Option<f64>,
    parameters: &PrepareOptions,
    done: impl Fn() + Sync,
) -> Result<Vec<Tile>> {
    let sun = scene.sun_azimuth_deg.map(|azimuth_deg| Sun {
        azimuth_deg,
        elevation_deg: sun_elevation_deg.unwrap_or(ELEVATION_DEG),
        exaggeration: 1.0,
    });
    let windows = scene.windows();
    let inspected: Result<Vec<Tile>> = windows
        .into_par_iter()
        .map(|window| {
            let tile = tile(&scene.maps(window)?, window, scene, sun, parameters);
            done();
            tile
        })
        .collect();
    let mut inspected = inspected?;
    drop_displaced(&mut inspected, parameters);
    Ok(inspected)
}

fn tile(
    maps: &SceneMaps,
    window: Window,
    scene: &PreparedScene,
    sun: Option<Sun>,
    parameters: &PrepareOptions,
) -> Result<Tile> {
    let (relief_truth_m, relief_coarse_m) = (relief(&maps.truth_m), relief(&maps.coarse_m));
    let mut tile =
        Tile { row: window.row, col: window.col, relief_truth_m, relief_coarse_m, offset: None, dropped: None };
    let gaps = [&maps.image, &maps.coarse_m, &maps.truth_m].iter().any(|map| map.iter().any(|v| !v.is_finite()));
    tile.dropped = if gaps {
        Some(Reason::Nulls)
    } else if relief(&maps.image) <= 0.0 {
        Some(Reason::ConstantImage)
    } else if is_saturated(&maps.image, parameters.max_saturated) {
        Some(Reason::SaturatedImage)
    } else if relief_truth_m <= RELIEF_EPS_M || relief_coarse_m <= RELIEF_EPS_M {
        Some(Reason::NoRelief)
    } else {
        None
    };
    if let (None, Some(sun)) = (tile.dropped, sun) {
        let shape = (TILE_ROWS, TILE_COLS);
        tile.offset = measure(&maps.image, &maps.truth_m, shape, scene.pixel, sun, parameters.search_px)?
            .filter(|offset| offset.correlation >= parameters.min_correlation);
    }
    Ok(tile)
}

/// Drops tiles with too large an offset. A tile without a measured offset gets the median of its scene; if there is no median, it is kept.
fn drop_displaced(tiles: &mut [Tile], parameters: &PrepareOptions) {
    let mut distances: Vec<f64> = tiles.iter().filter_map(|t| t.offset).map(|o| o.distance_px()).collect();
    let median_px = elunar_base::quantile::quantile(&mut distances, 0.5);
    for tile in tiles.iter_mut().filter(|t| t.dropped.is_none()) {
        let distance_px = tile.offset.map(|o| o.distance_px()).or(median_px);
        if distance_px.is_some_and(|d| d > parameters.max_offset_px) {
            tile.dropped = Some(Reason::Offset);
        }
    }
}

fn range(map: &[f32]) -> (f32, f32) {
    map.iter()
        .filter(|v| v.is_finite())
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &v| (low.min(v), high.max(v)))
}

fn relief(map: &[f32]) -> f32 {
    let (low, high) = range(map);
    if low < high { high - low } else { 0.0 }
}

fn is_saturated(image: &[f32], max_saturated: f64) -> bool {
    let (low, high) = range(image);
    let share = |value: f32| image.iter().filter(|&&v| v == value).count() as f64 / image.len() as f64;
    share(high) > max_saturated || share(low) > DARKEST_SHARE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn saturation_is_about_shares() {
        let mut image: Vec<f32> = (0..1000).map(|i| i as f32).collect();
        assert!(!is_saturated(&image, 0.01));
        image[980..].fill(2000.0);
        assert!(is_saturated(&image, 0.01) && !is_saturated(&image, 0.05));
        image[..300].fill(-1.0);
        assert!(is_saturated(&image, 0.05), "a shadow over a quarter and more");
    }

    #[test]
    fn tiles_without_a_measure_follow_their_scene() {
        let tile = |distance: Option<f64>| Tile {
            row: 0,
            col: 0,
            relief_truth_m: 1.0,
            relief_coarse_m: 1.0,
            offset: distance.map(|d| Offset { rows_px: d, cols_px: 0.0, correlation: 0.9 }),
            dropped: None,
        };
        let parameters = PrepareOptions { max_offset_px: 2.0, ..PrepareOptions::default() };
        let dropped = |mut tiles: Vec<Tile>| {
            drop_displaced(&mut tiles, &parameters);
            tiles.iter().map(|t| t.dropped == Some(Reason::Offset)).collect::<Vec<_>>()
        };
        assert_eq!(
            dropped(vec![tile(Some(0.5)), tile(Some(-1.0)), tile(None), tile(Some(-5.0))]),
            [false, false, false, true]
        );
        assert_eq!(dropped(vec![tile(Some(3.0)), tile(None)]), [true, true]);
        assert_eq!(dropped(vec![tile(None)]), [false]);
    }
}
