//! Parts of a scene: whole rows that one machine makes, so that many machines share an image.

use elunar_base::{Error, Result};
use elunar_core::tile::{Tiling, Window};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::Range;
use std::str::FromStr;

/// A part of a scene: number `k` of `n`, counted from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PartOf {
    /// Number of the part, from 1 to `n`.
    pub k: usize,
    /// Number of parts.
    pub n: usize,
}

/// Greatest number of parts.
const MOST_PARTS: usize = 100_000;

impl FromStr for PartOf {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let wrong = || format!("K/N with 1 <= K <= N <= {MOST_PARTS} expected, {text:?} found");
        let (k, n) = text.split_once('/').ok_or_else(wrong)?;
        let (Ok(k), Ok(n)) = (k.parse(), n.parse()) else { return Err(wrong()) };
        if k >= 1 && k <= n && n <= MOST_PARTS { Ok(Self { k, n }) } else { Err(wrong()) }
    }
}

impl fmt::Display for PartOf {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.k, self.n)
    }
}

impl PartOf {
    /// Returns which of `count` things belong to the part: a range without gaps. Sizes differ by one at most.
    #[must_use]
    pub fn share(self, count: usize) -> Range<usize> {
        let at = |k: usize| (k as u128 * count as u128 / self.n as u128) as usize;
        at(self.k - 1)..at(self.k)
    }

    /// Returns the rows of the part in a scene of `rows`. Parts are cut where a row of tiles begins: the rows above are then finished by the
    /// tiles above. Of more parts than rows of tiles some are empty.
    #[must_use]
    pub fn rows(self, tiling: &Tiling, rows: usize) -> Range<usize> {
        let mut tops: Vec<usize> = tiling.iter().map(|window: Window| window.row).collect();
        tops.dedup();
        let at = |i: usize| tops.get(i).copied().unwrap_or(rows).min(rows);
        let share = self.share(tops.len());
        at(share.start)..at(share.end)
    }
}

/// The rows that a run makes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Span {
    /// Rows of the part: all rows of a scene, or the rows of a [`PartOf`].
    pub rows: Range<usize>,
    /// First row that is still to be made.
    pub from: usize,
}

impl Span {
    /// Checks the span against a scene.
    ///
    /// # Errors
    /// [`Error::Usage`] if it is not within the scene's rows.
    pub(super) fn check(&self, rows: usize) -> Result<()> {
        if self.rows.start <= self.from && self.from <= self.rows.end && self.rows.end <= rows {
            return Ok(());
        }
        Err(Error::usage(format!("rows within 0 to {rows} expected, {:?} from {} found", self.rows, self.from)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_core::tile::Shape;

    #[test]
    fn parts_cover_all_rows_once() {
        for (rows, n) in [(2000, 1), (2000, 2), (2000, 5), (2000, 40), (100, 3), (256, 2)] {
            let tiling = Tiling::new(Shape::new(rows.max(256), 320), Shape::new(256, 320), 100).unwrap();
            let mut next = 0;
            for k in 1..=n {
                let part = PartOf { k, n }.rows(&tiling, rows);
                assert_eq!(part.start, next, "{k}/{n}");
                next = part.end;
            }
            assert_eq!(next, rows);
        }
    }

    #[test]
    fn a_part_is_named_by_two_numbers() {
        assert_eq!("2/5".parse(), Ok(PartOf { k: 2, n: 5 }));
        for wrong in ["", "2", "0/5", "6/5", "1/0", "-1/2", "a/b", "1/2/3", "1/100001"] {
            let error = wrong.parse::<PartOf>().unwrap_err();
            assert!(error.contains("K/N") && error.contains(&format!("{wrong:?}")), "{error}");
        }
    }
}
