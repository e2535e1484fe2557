//! Training, validation and test never share ground. Whole sites go to one split, or whole blocks of a map.

use super::manifest::Split;
use elunar_base::{Error, Result};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use std::collections::BTreeMap;

/// Number of sites needed to divide by site. With fewer, the map is divided.
const SITES: usize = 3;

/// The position of a kept tile, for dividing the ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ground<'a> {
    /// Site of the tile.
    pub(super) site: &'a str,
    /// Reference system of its scene.
    pub(super) system: &'a str,
    /// Least and greatest x, least and greatest y of the tile's edges, map units.
    pub(super) span: [[f64; 2]; 2],
}

impl<'a> Ground<'a> {
    /// Makes the ground of a tile of `rows` x `cols` pixels with this transform.
    pub(super) fn new(site: &'a str, system: &'a str, t: &[f64; 6], rows: usize, cols: usize) -> Self {
        let (rows, cols) = (rows as f64, cols as f64);
        let corners = [(0.0, 0.0), (rows, 0.0), (0.0, cols), (rows, cols)];
        let points = corners.map(|(row, col)| [t[0] + col * t[1] + row * t[2], t[3] + col * t[4] + row * t[5]]);
        let of = |axis: usize| {
            let values = points.map(|p| p[axis]);
            [
                values.iter().copied().fold(f64::INFINITY, f64::min),
                values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
            ]
        };
        Self { site, system, span: [of(0), of(1)] }
    }
}

/// Returns the split of every tile (`None`: across a border), and a description of the division.
///
/// With three or more sites, whole sites go to one split. The largest come first, each to the split that lacks most of its share, but every
/// split gets at least one. The order of equally large sites is drawn from `seed`. With fewer sites, each site's map is cut across its
/// longer axis into three blocks, training first. Tiles that lie across a cut are left out.
///
/// # Errors
/// [`Error::Input`] if a site that must be cut has scenes in different reference systems.
pub(super) fn divide(tiles: &[Ground], shares: [f64; 3], seed: u64) -> Result<(Vec<Option<Split>>, String)> {
    let mut sites: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    tiles.iter().enumerate().for_each(|(i, tile)| sites.entry(tile.site).or_default().push(i));
    let mut splits = vec![None; tiles.len()];
    if sites.len() >= SITES {
        for (site, split) in whole_sites(&sites, shares, seed) {
            sites[site].iter().for_each(|&i| splits[i] = Some(split));
        }
        return Ok((splits, format!("site ({} sites)", sites.len())));
    }
    let mut axes = vec![];
    for (site, members) in &sites {
        if let Some(&other) = members.iter().find(|&&i| tiles[i].system != tiles[members[0]].system) {
            return Err(Error::input(format!(
                "site {site}: one reference system, or at least {SITES} sites, expected to divide it; {} and {} found",
                tiles[members[0]].system, tiles[other].system
            )));
        }
        let axis = longer_axis(tiles, members);
        cut(tiles, members, axis, shares, &mut splits);
        axes.push(format!("{site} along {}", ["x", "y"][axis]));
    }
    Ok((splits, format!("blocks of the map, cut across: {}", axes.join("; "))))
}

fn whole_sites<'a>(sites: &BTreeMap<&'a str, Vec<usize>>, shares: [f64; 3], seed: u64) -> Vec<(&'a str, Split)> {
    let mut order: Vec<(&str, usize)> = sites.iter().map(|(site, members)| (*site, members.len())).collect();
    order.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    order.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    let all: usize = order.iter().map(|(_, count)| count).sum();
    let mut missing = shares.map(|share| share * all as f64);
    let mut given = vec![];
    let mut without: Vec<usize> = (0..3).filter(|&k| shares[k] > 0.0).collect();
    for (k, &(site, count)) in order.iter().enumerate() {
        // The last sites are for those that have none yet.
        let open = if order.len() - k <= without.len() { without.clone() } else { vec![0, 1, 2] };
        let neediest = open.iter().copied().fold(open[0], |best, k| if missing[k] > missing[best] { k } else { best });
        missing[neediest] -= count as f64;
        without.retain(|&k| k != neediest);
        given.push((site, Split::ALL[neediest]));
    }
    given
}

fn longer_axis(tiles: &[Ground], members: &[usize]) -> usize {
    let extent = |axis: usize| {
        let low = members.iter().map(|&i| tiles[i].span[axis][0]).fold(f64::INFINITY, f64::min);
        let high = members.iter().map(|&i| tiles[i].span[axis][1]).fold(f64::NEG_INFINITY, f64::max);
        high - low
    };
    usize::from(extent(1) > extent(0))
}

/// Cuts at the lower edges of tiles, so that no cut crosses a scene's own rows of tiles.
fn cut(tiles: &[Ground], members: &[usize], axis: usize, shares: [f64; 3], splits: &mut [Option<Split>]) {
    let mut edges: Vec<f64> = members.iter().map(|&i| tiles[i].span[axis][0]).collect();
    edges.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let k = (share * edges.len() as f64).round() as usize;
        edges.get(k).copied().unwrap_or(f64::INFINITY)
    };
    let (first, second) = (at(shares[0]), at(shares[0] + shares[1]));
    for &i in members {
        let [low, high] = tiles[i].span[axis];
        // Neighbouring tiles share an edge. Rounding must not turn it into an overlap.
        let slack = 1e-6 * (high - low);
        splits[i] = if high <= first + slack {
            Some(Split::Train)
        } else if low >= second - slack {
            Some(Split::Test)
        } else if low >= first - slack && high <= second + slack {
            Some(Split::Validation)
        } else {
            None
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SHARES: [f64; 3] = [0.8, 0.1, 0.1];

    fn tile(site: &str, x: f64, y: f64) -> Ground<'_> {
        Ground::new(site, "a system", &[x, 2.0, 0.0, y, 0.0, -2.0], 256, 320)
    }

    #[test]
    fn sites_stay_whole_and_shares_are_about_met() {
        let names: Vec<String> = (0..12).map(|k| format!("site {k}")).collect();
        let tiles: Vec<Ground> = (0..600).map(|i| tile(&names[(i * i + i / 7) % 12], 0.0, 0.0)).collect();
        let (splits, how) = divide(&tiles, SHARES, 3).unwrap();
        assert!(how.starts_with("site ("), "{how}");
        let mut of_site = BTreeMap::new();
        for (tile, split) in tiles.iter().zip(&splits) {
            assert_eq!(*of_site.entry(tile.site).or_insert(*split), *split, "{}", tile.site);
        }
        let share = |split| splits.iter().filter(|s| **s == Some(split)).count() as f64 / 600.0;
        for (split, wanted) in Split::ALL.into_iter().zip(SHARES) {
            assert!((share(split) - wanted).abs() < 0.06, "{split:?}: {}", share(split));
        }
        assert_eq!(divide(&tiles, SHARES, 3).unwrap().0, splits, "the same seed divides alike");
    }

    #[test]
    fn few_sites_serve_every_split() {
        let tiles: Vec<Ground> =
            (0..60).map(|i| tile(["A", "B", "C", "D"][[0, 0, 1, 1, 2, 3][i % 6]], 0.0, 0.0)).collect();
        let count = |of: &[Option<Split>], split| of.iter().filter(|s| **s == Some(split)).count();
        let (splits, _) = divide(&tiles, SHARES, 0).unwrap();
        assert_eq!(Split::ALL.map(|split| count(&splits, split)), [40, 10, 10]);
        let (splits, _) = divide(&tiles, [0.8, 0.0, 0.2], 0).unwrap();
        assert_eq!(Split::ALL.map(|split| count(&splits, split)), [50, 0, 10]);
    }

    #[test]
    fn one_site_is_cut_into_blocks_that_share_no_ground() {
        // A strip of 4 x 30 tiles, and a second image of the same ground, a third of a tile further north.
        let mut tiles: Vec<Ground> =
            (0..120).map(|i| tile("A", (i % 4) as f64 * 640.0, (i / 4) as f64 * 512.0)).collect();
        tiles.extend((0..120).map(|i| tile("A", (i % 4) as f64 * 640.0, (i / 4) as f64 * 512.0 + 170.0)));
        let (splits, how) = divide(&tiles, SHARES, 0).unwrap();
        assert!(how.contains("A along y"), "{how}");
        let extent = |split: Split| {
            let of = tiles.iter().zip(&splits).filter(|(_, s)| **s == Some(split));
            of.fold([f64::INFINITY, f64::NEG_INFINITY], |e, (t, _)| [e[0].min(t.span[1][0]), e[1].max(t.span[1][1])])
        };
        let [train, validation, test] = Split::ALL.map(extent);
        assert!(
            train[1] <= validation[0] + 1e-3 && validation[1] <= test[0] + 1e-3,
            "{train:?} {validation:?} {test:?}"
        );
        let left_out = splits.iter().filter(|s| s.is_none()).count();
        assert!(left_out > 0 && left_out <= 16, "{left_out} of 240 tiles lie across a cut");
        let count = |split| splits.iter().filter(|s| **s == Some(split)).count();
        assert!(count(Split::Train) > 170 && count(Split::Validation) > 8 && count(Split::Test) > 8);
    }

    #[test]
    fn a_site_in_two_systems_cannot_be_cut() {
        let tiles = [tile("A", 0.0, 0.0), Ground { system: "another", ..tile("A", 0.0, 0.0) }];
        let refused = divide(&tiles, SHARES, 0).unwrap_err().to_string();
        assert!(refused.contains("site A") && refused.contains("another"), "{refused}");
        assert_eq!(divide(&[], SHARES, 0).unwrap().0, []);
    }
}
