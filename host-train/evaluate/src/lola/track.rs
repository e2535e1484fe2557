//! Points in the order the spacecraft passed over them.

/// One laser spot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaserSpot {
    /// Longitude, degrees east.
    pub lon_deg: f64,
    /// Planetocentric latitude, degrees.
    pub lat_deg: f64,
    /// Metres above the sphere.
    pub height_m: f64,
    /// Seconds since a moment that all points of the table share; `None` if the table has no times.
    pub time_s: Option<f64>,
}

/// A longer pause ends a track (our choice), seconds. Spots of one pass over a scene follow each other within a second; passes of an
/// orbiter are two hours apart.
pub const TRACK_GAP_S: f64 = 600.0;

/// Cuts points, in their order, where the time jumps by more than `gap_s` in either direction. Points without times are one track.
#[must_use]
pub fn split(points: &[LaserSpot], gap_s: f64) -> Vec<&[LaserSpot]> {
    let same = |a: &LaserSpot, b: &LaserSpot| match (a.time_s, b.time_s) {
        (Some(a), Some(b)) => (b - a).abs() <= gap_s,
        _ => true,
    };
    points.chunk_by(same).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_cut() {
        let at = |time_s: Option<f64>| LaserSpot { lon_deg: 0.0, lat_deg: 0.0, height_m: 0.0, time_s };
        let times = [0.0, 1.0, 601.5, 601.6, -100.0].map(|t| at(Some(t)));
        let lengths: Vec<usize> = split(&times, TRACK_GAP_S).iter().map(|t| t.len()).collect();
        assert_eq!(lengths, [2, 2, 1]);
        assert_eq!(split(&[at(None), at(None)], 0.0).len(), 1);
        assert!(split(&[], 1.0).is_empty());
    }
}
