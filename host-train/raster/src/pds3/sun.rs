//! The Sun's direction in a label.

use super::super::sun::StatedSun;
use super::label::{LabelBlock, LabelItem};
use super::value::ValueKind;
use elunar_core::sun::UtcTime;

/// Returns the Sun that a label states.
///
/// - The elevation is 90 degrees minus `INCIDENCE_ANGLE`.
/// - The azimuth is `SUB_SOLAR_AZIMUTH` plus 90 degrees: the keyword counts clockwise from the line between the image's centre and the middle
///   of its right edge (PDS3 Data Dictionary). It holds for the camera's frame, so it is left out for a map-projected image (`mapped`).
///
/// - The time is `IMAGE_TIME`, else `START_TIME`.
///
/// A keyword may stand in any block; the first one counts. One in another unit than degrees is left out.
pub(super) fn stated(label: &LabelBlock, mapped: bool) -> StatedSun {
    let angle = |key: &str| first(label, key).and_then(degrees);
    StatedSun {
        azimuth_deg: angle("SUB_SOLAR_AZIMUTH").filter(|_| !mapped).map(|deg| (deg + 90.0).rem_euclid(360.0)),
        elevation_deg: angle("INCIDENCE_ANGLE").map(|deg| 90.0 - deg),
        time: ["IMAGE_TIME", "START_TIME"].iter().find_map(|key| moment(first(label, key)?)),
    }
}

pub(crate) fn first<'a>(block: &'a LabelBlock, key: &str) -> Option<&'a LabelItem> {
    let here = block.items.iter().find(|item| item.key == key && !item.value.is_absent());
    here.or_else(|| block.blocks.iter().find_map(|inner| first(inner, key)))
}

pub(crate) fn moment(item: &LabelItem) -> Option<UtcTime> {
    match &item.value.kind {
        ValueKind::Time(text) | ValueKind::Text(text) => text.parse().ok(),
        _ => None,
    }
}

fn degrees(item: &LabelItem) -> Option<f64> {
    let unit = item.value.unit.as_deref().unwrap_or("DEG").trim().to_ascii_uppercase();
    item.value.number().filter(|_| unit.starts_with("DEG"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sun(text: &str, mapped: bool) -> (Option<f64>, Option<f64>) {
        let found = stated(&LabelBlock::parse(text.as_bytes()).unwrap(), mapped);
        (found.azimuth_deg, found.elevation_deg)
    }

    #[test]
    fn the_azimuth_is_counted_from_the_right_and_only_in_the_cameras_frame() {
        let label = "SUB_SOLAR_AZIMUTH = 200.5 <DEG>\nINCIDENCE_ANGLE = 62.25 <degree>\nEND\n";
        assert_eq!(sun(label, false), (Some(290.5), Some(27.75)));
        assert_eq!(sun(label, true), (None, Some(27.75)));
        // Beyond a whole turn, and within a block.
        let inside = "GROUP = A\nSUB_SOLAR_AZIMUTH = 300\nEND_GROUP\nEND\n";
        assert_eq!(sun(inside, false), (Some(30.0), None));
    }

    #[test]
    fn the_time_is_the_images_or_its_start() {
        let time = |text: &str| stated(&LabelBlock::parse(text.as_bytes()).unwrap(), true).time;
        let known = "2009-08-30T12:00:00".parse().ok();
        assert!(known.is_some());
        assert_eq!(time("START_TIME = 2009-08-30T12:00:00.000\nSTOP_TIME = 2009-08-30T12:01:00\nEND\n"), known);
        assert_eq!(
            time("GROUP = A\nSTART_TIME = 2009-242T11:59:00\nIMAGE_TIME = 2009-242T12:00:00\nEND_GROUP\nEND\n"),
            known
        );
        assert_eq!(time("START_TIME = \"UNK\"\nEND\n"), None);
        assert_eq!(time("START_TIME = 12:00:00\nEND\n"), None);
    }

    #[test]
    fn what_is_no_angle_in_degrees_is_left_out() {
        assert_eq!(sun("INCIDENCE_ANGLE = 1.1 <RAD>\nSUB_SOLAR_AZIMUTH = \"N/A\"\nEND\n", false), (None, None));
        assert_eq!(sun("A = 1\nEND\n", false), (None, None));
    }
}
