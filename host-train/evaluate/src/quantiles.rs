//! Exact quantiles of more values than fit into memory, by reading the values several times.
//!
//! A value is a whole number of 64 bits that grows with it. The first reading counts the values by their first 20 bits. Of the cells in which a
//! wanted rank lies, the next reading keeps all values, or if they are many, counts them by the next 20 bits.

use std::collections::BTreeMap;

/// Values that are kept at once. More are counted.
const KEPT: u64 = 1 << 20;
/// Bits of a level.
const LEVEL_BITS: u32 = 20;
const ALL_BITS: u32 = u64::BITS;

/// Quantiles that are being found.
#[derive(Debug)]
pub(super) struct Quantiles {
    shares: Vec<f64>,
    /// Number of values; known after the first reading.
    count: Option<u64>,
    cells: Vec<Cell>,
    /// Values by their rank.
    found: BTreeMap<u64, f64>,
}

/// Values that begin with the same bits.
#[derive(Debug)]
struct Cell {
    /// The bits, and their number.
    start: u64,
    bits: u32,
    /// Values in lower cells.
    before: u64,
    content: Content,
}

#[derive(Debug)]
enum Content {
    Values(Vec<f64>),
    Counts(Vec<u64>),
}

impl Quantiles {
    /// Prepares for at most `most` values. Shares are from 0 to 1.
    pub(super) fn new(shares: &[f64], most: usize) -> Self {
        // Few enough are kept in the first reading.
        let content = Content::of(if most as u64 <= 4 * KEPT { 0 } else { u64::MAX }, 0);
        let cells = vec![Cell { start: 0, bits: 0, before: 0, content }];
        Self { shares: shares.to_vec(), count: None, cells, found: BTreeMap::new() }
    }

    /// Returns whether no further reading is needed.
    pub(super) fn is_done(&self) -> bool {
        self.cells.is_empty()
    }

    /// Adds a value. Every reading must have the same values, in any order.
    pub(super) fn push(&mut self, value: f64) {
        let key = key(value);
        for cell in &mut self.cells {
            if top(key, cell.bits) == cell.start {
                match &mut cell.content {
                    Content::Values(values) => values.push(value),
                    Content::Counts(counts) => counts[cell_of(key, cell.bits)] += 1,
                }
            }
        }
    }

    /// Ends a reading.
    pub(super) fn end_reading(&mut self) {
        let cells = std::mem::take(&mut self.cells);
        let count = *self.count.get_or_insert_with(|| cells.iter().map(|cell| cell.content.count()).sum());
        let ranks: Vec<u64> = self.shares.iter().flat_map(|share| ranks(*share, count)).flatten().collect();
        for mut cell in cells {
            let within = cell.before..cell.before + cell.content.count();
            let mut wanted: Vec<u64> = ranks.iter().copied().filter(|rank| within.contains(rank)).collect();
            wanted.sort_unstable();
            wanted.dedup();
            if let Content::Values(values) = &mut cell.content {
                values.sort_unstable_by(f64::total_cmp);
            }
            match &cell.content {
                Content::Values(values) => {
                    self.found.extend(wanted.iter().map(|rank| (*rank, values[(rank - cell.before) as usize])));
                }
                Content::Counts(counts) => self.split(&cell, counts, &wanted),
            }
        }
    }

    /// Makes cells of the next level for the wanted ranks of a cell.
    fn split(&mut self, cell: &Cell, counts: &[u64], wanted: &[u64]) {
        let bits = (cell.bits + LEVEL_BITS).min(ALL_BITS);
        let mut before = cell.before;
        for (k, &count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
            let inside = |rank: &&u64| (before..before + count).contains(*rank);
            if wanted.iter().any(|rank| inside(&rank)) {
                let start = if cell.bits == 0 { k as u64 } else { cell.start << (bits - cell.bits) | k as u64 };
                if bits == ALL_BITS {
                    let equal = wanted.iter().filter(inside).map(|rank| (*rank, value(start)));
                    self.found.extend(equal);
                } else {
                    self.cells.push(Cell { start, bits, before, content: Content::of(count, bits) });
                }
            }
            before += count;
        }
    }

    /// Returns the quantiles, linear between neighbours in order, as [`elunar_base::quantile::quantile`]; `None` without values.
    pub(super) fn of(&self) -> Option<Vec<f64>> {
        let count = self.count.filter(|count| *count > 0)?;
        let quantile = |share: &f64| {
            let [lower, upper] = ranks(*share, count).map(|rank| rank.and_then(|rank| self.found.get(&rank)).copied());
            let fraction = position(*share, count).fract();
            lower.map(|lower| upper.map_or(lower, |upper| lower + fraction * (upper - lower)))
        };
        self.shares.iter().map(quantile).collect()
    }
}

impl Content {
    /// Returns room for `count` values whose first `bits` bits are known.
    fn of(count: u64, bits: u32) -> Self {
        let cells = 1 << LEVEL_BITS.min(ALL_BITS - bits);
        if count <= KEPT { Self::Values(vec![]) } else { Self::Counts(vec![0; cells]) }
    }

    fn count(&self) -> u64 {
        match self {
            Self::Values(values) => values.len() as u64,
            Self::Counts(counts) => counts.iter().sum(),
        }
    }
}

fn position(share: f64, count: u64) -> f64 {
    share.clamp(0.0, 1.0) * count.saturating_sub(1) as f64
}

/// Returns the ranks between which a quantile lies; the second is absent where it is the first.
fn ranks(share: f64, count: u64) -> [Option<u64>; 2] {
    let position = position(share, count);
    let first = position.floor() as u64;
    [(count > 0).then_some(first), (count > 0 && position.fract() > 0.0).then_some(first + 1)]
}

/// Returns a number that grows with the value, in the order of `f64::total_cmp`.
fn key(value: f64) -> u64 {
    let bits = value.to_bits();
    if bits >> 63 == 0 { bits | 1 << 63 } else { !bits }
}

fn value(key: u64) -> f64 {
    f64::from_bits(if key >> 63 == 1 { key & !(1 << 63) } else { !key })
}

/// Returns the first `bits` bits.
fn top(key: u64, bits: u32) -> u64 {
    if bits == 0 { 0 } else { key >> (ALL_BITS - bits) }
}

/// Returns the bits of the next level after the first `bits`.
fn cell_of(key: u64, bits: u32) -> usize {
    let width = LEVEL_BITS.min(ALL_BITS - bits);
    (key << bits >> (ALL_BITS - width)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_base::quantile::quantile;
    use rand::{Rng, SeedableRng};

    const SHARES: [f64; 7] = [0.0, 0.01, 0.5, 0.68, 0.95, 0.999_999, 1.0];

    /// Finds quantiles as of more values than are kept.
    fn of_many(values: &[f64]) -> (Option<Vec<f64>>, usize) {
        let mut found = Quantiles::new(&SHARES, usize::MAX);
        let mut readings = 0;
        while !found.is_done() {
            values.iter().for_each(|v| found.push(*v));
            found.end_reading();
            readings += 1;
        }
        (found.of(), readings)
    }

    #[test]
    fn quantiles_are_those_of_sorting() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let mut noise = |count: usize, scale: f64| -> Vec<f64> {
            (0..count).map(|_| scale * (random.random::<f64>() - 0.4)).collect()
        };
        let cases =
            [noise(1, 1.0), noise(2, 1.0), noise(30_000, 5.0), vec![-3.5; 4000], vec![-1.0, 0.0, -0.0, 1e300, 1e-300]];
        for mut values in cases {
            let expected: Vec<f64> = SHARES.iter().map(|share| quantile(&mut values, *share).unwrap()).collect();
            assert_eq!(of_many(&values).0.unwrap(), expected);
            let mut few = Quantiles::new(&SHARES, values.len());
            values.iter().for_each(|v| few.push(*v));
            few.end_reading();
            assert!(few.is_done());
            assert_eq!(few.of().unwrap(), expected);
        }
        assert_eq!(of_many(&[]), (None, 1));
    }

    /// More equal or nearly equal values than are kept.
    #[test]
    fn many_alike_values_take_more_readings() {
        let count = KEPT as usize + 10;
        assert_eq!(of_many(&vec![2.5; count]), (Some(vec![2.5; SHARES.len()]), 4));
        let mut near: Vec<f64> = (0..count).map(|i| 1.0 + i as f64 * f64::EPSILON).collect();
        let (found, readings) = of_many(&near);
        let expected: Vec<f64> = SHARES.iter().map(|share| quantile(&mut near, *share).unwrap()).collect();
        assert_eq!((found.unwrap(), readings), (expected, 4));
    }
}
