//! The Sun's direction in a label.

use super::super::sun::StatedSun;
use super::label::{LabelBlock, LabelItem};

/// Returns the Sun that a label states.
///
/// - The elevation is 90 degrees minus `INCIDENCE_ANGLE`.
/// - The azimuth is `SUB_SOLAR_AZIMUTH` plus 90 degrees: the keyword counts clockwise from the line between the image's centre and the middle
///   of its right edge (PDS3 Data Dictionary). It holds for the camera's frame, so it is left out for a map-projected image (`mapped`).
///
/// A keyword may stand in any block; the first one counts. One in another unit than degrees is left out.
pub(super) fn stated(label: &LabelBlock, mapped: bool) -> StatedSun {
    let angle = |key: &str| first(label, key).and_then(degrees);
    StatedSun {
        azimuth_deg: angle("SUB_SOLAR_AZIMUTH").filter(|_| !mapped).map(|deg| (deg + 90.0).rem_euclid(360.0)),
        elevation_deg: angle("INCIDENCE_ANGLE").map(|deg| 90.0 - deg),
    }
}

fn first<'a>(block: &'a LabelBlock, key: &str) -> Option<&'a LabelItem> {
    let here = block.items.iter().find(|item| item.key == key && !item.value.is_absent());
    here.or_else(|| block.blocks.iter().find_map(|inner| first(inner, key)))
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
    fn what_is_no_angle_in_degrees_is_left_out() {
        assert_eq!(sun("INCIDENCE_ANGLE = 1.1 <RAD>\nSUB_SOLAR_AZIMUTH = \"N/A\"\nEND\n", false), (None, None));
        assert_eq!(sun("A = 1\nEND\n", false), (None, None));
    }
}
