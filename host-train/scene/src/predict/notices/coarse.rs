//! Heights that are not metres, or not heights.

use super::super::{Scene, Survey};
use super::percent;
use crate::body;
use elunar_base::Result;
use elunar_core::tile::Window;

/// Share of the image's valid pixels with a height below which a coarse DTM covers too little.
const COVERED: f64 = 0.9;
/// Heights of the Moon are within so many kilometres of its sphere.
const FARTHEST_KM: f32 = 12.0;
/// Relief over extent below which heights are more likely kilometres read as metres. It is 0.06 degrees from end to end; the Moon's
/// flattest maria have a degree or two.
const FLATTEST: f64 = 1e-3;
/// Values that files use for voids. Floats 1e30 or more from zero and signed 16-bit integers at or below -32764 are voids in any case.
const VOID_VALUES: [f32; 3] = [-9999.0, -32768.0, 0.0];
/// Share of heights with exactly such a value above which it is suspected.
const VOID_SHARE: f64 = 0.005;
/// Least share of a plateau's neighbours that are farther from it than a pixel is wide: cliffs of 45 degrees all around.
const CLIFFS: f64 = 0.5;
/// Greatest number of heights that are looked at. Of a larger piece the middle rows count.
const MOST_HEIGHTS: usize = 1 << 24;

/// Heights of the coarse DTM on its own grid, under the image.
pub(super) struct Heights {
    pub(super) cols: usize,
    pub(super) samples_m: Vec<f32>,
    /// Side of a pixel, metres.
    pub(super) pixel_m: f32,
}

impl Heights {
    /// Reads the heights under a scene's image; `None` if there are none.
    fn under(scene: &Scene) -> Result<Option<Self>> {
        let Some(window) = scene.coarse.under(scene.rows, scene.cols) else { return Ok(None) };
        let Window { row, col, rows, cols } = window;
        let fewer = rows.min(MOST_HEIGHTS / cols.max(1)).max(1);
        let middle = Window { row: row + (rows - fewer) / 2, col, rows: fewer, cols };
        let samples_m = scene.coarse.source().read(middle)?;
        Ok(Some(Self { cols, samples_m, pixel_m: scene.pixel_m * scene.coarse_px }))
    }

    /// Returns the value of [`VOID_VALUES`] that stands for voids, and its share of the heights: it is frequent, and its plateaus have
    /// cliffs all around or nothing beside them.
    pub(super) fn plateau(&self) -> Option<(f32, f64)> {
        let valid = self.samples_m.iter().filter(|z| z.is_finite()).count().max(1) as f64;
        let share = |value: f32| self.samples_m.iter().filter(|z| **z == value).count() as f64 / valid;
        let suspected = VOID_VALUES.into_iter().map(|value| (value, share(value)));
        let mut suspected = suspected.filter(|(_, share)| *share > VOID_SHARE);
        suspected.find(|(value, share)| *share == 1.0 || self.has_cliffs(*value))
    }

    /// Returns whether most valid neighbours of pixels with this value are farther from it than a pixel is wide.
    fn has_cliffs(&self, value: f32) -> bool {
        let (mut edges, mut cliffs) = (0u64, 0u64);
        let mut pair = |a: f32, b: f32| {
            let beside = if a == value { b } else { a };
            if (a == value) != (b == value) && beside.is_finite() {
                edges += 1;
                cliffs += u64::from((beside - value).abs() > self.pixel_m);
            }
        };
        let rows: Vec<&[f32]> = self.samples_m.chunks_exact(self.cols.max(1)).collect();
        rows.iter().for_each(|row| row.windows(2).for_each(|z| pair(z[0], z[1])));
        rows.windows(2).for_each(|rows| rows[0].iter().zip(rows[1]).for_each(|(&a, &b)| pair(a, b)));
        edges > 0 && cliffs as f64 >= CLIFFS * edges as f64
    }

    /// Returns the lowest and the highest height other than `void`; `None` without one.
    fn range(&self, void: Option<f32>) -> Option<(f32, f32)> {
        let heights = self.samples_m.iter().filter(|z| z.is_finite() && Some(**z) != void);
        heights.fold(None, |range, &z| {
            range.map_or(Some((z, z)), |(low, high): (f32, f32)| Some((low.min(z), high.max(z))))
        })
    }
}

/// Returns whether heights look like kilometres: all are within the Moon's range in kilometres, and the ground would be flatter than any
/// plain of the Moon.
pub(super) fn are_kilometres(survey: &Survey) -> bool {
    let Survey { lowest_m, highest_m, extent_m, .. } = *survey;
    let relief_m = highest_m - lowest_m;
    let farthest = lowest_m.abs().max(highest_m.abs());
    relief_m > 0.0 && f64::from(relief_m) < FLATTEST * extent_m && farthest < FARTHEST_KM
}

/// Warns of a coarse DTM that covers only a part of the image.
pub(super) fn coverage(scene: &Scene, survey: &Survey) -> Option<String> {
    let share = survey.coverage()?;
    (share < COVERED).then(|| {
        let (coarse, image, share) = (&scene.coarse_name, &scene.image.name, percent(share));
        format!("{coarse}: covers {share} of the valid pixels of {image}: the DTM is void in the others")
    })
}

/// Warns of voids without a nodata value, of heights that the Moon does not have, and of kilometres.
pub(super) fn suspected(scene: &Scene, survey: &Survey, unit_stated: bool) -> Result<Vec<String>> {
    let (name, mut found) = (&scene.coarse_name, vec![]);
    let Some(heights) = Heights::under(scene)? else { return Ok(found) };
    let plateau = heights.plateau();
    if let Some((value, share)) = plateau {
        let found_as = if share == 1.0 {
            format!("all heights under the image are exactly {value}")
        } else {
            let share = percent(share);
            format!("{share} of the heights under the image are exactly {value}, with cliffs around them")
        };
        found.push(format!("{name}: {found_as}: voids? If so, say --coarse-nodata {value}"));
    }
    let range = heights.range(plateau.map(|(value, _)| value));
    if let Some(what) = range.and_then(|range| body::beyond(scene.georef.crs.sphere_radius_m(), range)) {
        found.push(format!("{name}: {what}: radii, another unit, or voids without a nodata value?"));
    }
    if !unit_stated && are_kilometres(survey) {
        let (relief_m, extent_m) = (survey.highest_m - survey.lowest_m, survey.extent_m);
        found.push(format!(
            "{name}: {relief_m:.3} m of relief over {extent_m:.0} m: kilometres taken for metres? Say --coarse-unit km, or m"
        ));
    }
    Ok(found)
}
