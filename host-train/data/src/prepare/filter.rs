//! The 3-sigma rule (Eq. 9–10) and NR (Eq. 1) over all tiles.

use super::inspect::Tile;
use super::manifest::{Reason, ThreeSigma};
use elunar_core::norm::nr_from_reliefs;

/// Drops tiles whose relief differs unusually between truth and coarse DTM. A tile is kept if |ΔZ_N − ΔZ_S − μ| < 3σ (Eq. 9–10). Mean μ and
/// standard deviation σ (divided by the number) are over the tiles not dropped before. If all differences are equal, nothing is dropped.
/// Returns `None` without such tiles.
pub(super) fn three_sigma<'a>(tiles: impl IntoIterator<Item = &'a mut Tile>) -> Option<ThreeSigma> {
    let mut tiles: Vec<&mut Tile> = tiles.into_iter().filter(|t| t.dropped.is_none()).collect();
    let count = tiles.len() as f64;
    let mean_m = tiles.iter().map(|t| difference_m(t)).sum::<f64>() / count;
    let variance = tiles.iter().map(|t| (difference_m(t) - mean_m).powi(2)).sum::<f64>() / count;
    let rule = ThreeSigma { mean_m, sigma_m: variance.sqrt() };
    for tile in &mut tiles {
        if rule.sigma_m > 0.0 && (difference_m(tile) - mean_m).abs() >= 3.0 * rule.sigma_m {
            tile.dropped = Some(Reason::ThreeSigma);
        }
    }
    (!tiles.is_empty()).then_some(rule)
}

/// Returns ΔZ_N − ΔZ_S, metres.
pub(super) fn difference_m(tile: &Tile) -> f64 {
    f64::from(tile.relief_truth_m) - f64::from(tile.relief_coarse_m)
}

/// Returns NR (Eq. 1) from the true reliefs of these tiles; `None` without tiles.
pub(super) fn nr<'a>(tiles: impl IntoIterator<Item = &'a Tile>) -> Option<f32> {
    nr_from_reliefs(tiles.into_iter().map(|t| t.relief_truth_m)).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(truth_m: f32, coarse_m: f32) -> Tile {
        Tile { row: 0, col: 0, relief_truth_m: truth_m, relief_coarse_m: coarse_m, offset: None, dropped: None }
    }

    #[test]
    fn outliers_go_and_the_figures_are_those_of_the_definition() {
        // Twenty-four tiles differ by 4 or 6 m, one by 100 m: mean 8.8, sigma 18.6. The last one lies 4.9 sigma away.
        let mut tiles: Vec<Tile> = (0..24).map(|i| tile(50.0 + if i % 2 == 0 { 4.0 } else { 6.0 }, 50.0)).collect();
        tiles.push(tile(150.0, 50.0));
        tiles.push(Tile { dropped: Some(Reason::Nulls), ..tile(1e6, 0.0) });
        let rule = three_sigma(&mut tiles).unwrap();
        let expected = ((12.0 * (4.0_f64 - 8.8).powi(2) + 12.0 * (6.0_f64 - 8.8).powi(2) + (100.0_f64 - 8.8).powi(2))
            / 25.0)
            .sqrt();
        assert!((rule.mean_m - 8.8).abs() < 1e-9 && (rule.sigma_m - expected).abs() < 1e-9, "{rule:?}");
        let dropped: Vec<usize> = (0..26).filter(|&i| tiles[i].dropped == Some(Reason::ThreeSigma)).collect();
        assert_eq!(dropped, [24]);
        assert_eq!(tiles[25].dropped, Some(Reason::Nulls), "what was dropped before keeps its reason");
    }

    #[test]
    fn tiles_that_are_all_alike_stay() {
        let mut tiles = vec![tile(12.0, 10.0); 3];
        assert_eq!(three_sigma(&mut tiles), Some(ThreeSigma { mean_m: 2.0, sigma_m: 0.0 }));
        assert!(tiles.iter().all(|t| t.dropped.is_none()));
        assert_eq!(three_sigma([].into_iter()), None);
        assert_eq!(nr(&[tile(30.0, 1.0), tile(60.0, 1.0)]), Some(40.0));
        assert_eq!(nr([]), None);
    }
}
