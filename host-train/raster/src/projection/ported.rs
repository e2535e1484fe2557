//! Projections of `proj4rs`, a port of PROJ, on the sphere.

use super::{NOWHERE, wrapped};
use crate::crs::{ProjectionMethod, ProjectionParameters};
use proj4rs::Proj;
use proj4rs::transform::transform;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

/// A position counts if it is where its longitude and latitude are shown, to this share of the radius and of the distance from the origin.
/// Far positions of stereographic and conic maps have fewer digits.
const SAME_PLACE: f64 = 1e-8;

/// Greatest excess of a longitude over half a turn by rounding, radians.
const ROUNDING_RAD: f64 = 1e-9;

/// A projection without false origin, in metres.
#[derive(Clone)]
pub(super) struct Ported {
    parameters: ProjectionParameters,
    radius_m: f64,
    /// Longitude and latitude, and the map with its meridian at 0.
    ends: Arc<[Proj; 2]>,
}

impl Ported {
    /// Returns `None` for parameters that make no map.
    pub(super) fn new(radius_m: f64, parameters: ProjectionParameters) -> Option<Self> {
        let ProjectionParameters { kind, lat0_deg, lon0_deg, scale, parallels_deg } = parameters;
        let lat_is_sound = match kind {
            ProjectionMethod::Stereographic => lat0_deg.abs() < 90.0,
            _ => lat0_deg.abs() <= 90.0,
        };
        if !(lat_is_sound && lon0_deg.is_finite() && scale.is_finite() && scale > 1e-9) {
            return None;
        }
        let [a, b] = parallels_deg;
        let map = format!(
            "+proj={} +R={radius_m} +lat_0={lat0_deg} +lat_1={a} +lat_2={b} +k_0={scale} +over",
            Self::name(kind)
        );
        let ends = [format!("+proj=longlat +R={radius_m}"), map];
        let [sphere, map] = ends.map(|text| Proj::from_proj_string(&text).ok());
        Some(Self { parameters, radius_m, ends: Arc::new([sphere?, map?]) })
    }

    /// Returns PROJ's name of a kind.
    pub(super) fn name(kind: ProjectionMethod) -> &'static str {
        match kind {
            ProjectionMethod::Orthographic => "ortho",
            ProjectionMethod::TransverseMercator => "tmerc",
            ProjectionMethod::Mercator => "merc",
            ProjectionMethod::Stereographic => "stere",
            ProjectionMethod::Sinusoidal => "sinu",
            ProjectionMethod::LambertConformal => "lcc",
        }
    }

    pub(super) fn parameters(&self) -> &ProjectionParameters {
        &self.parameters
    }

    /// Returns the period of x, metres, of a map that repeats itself.
    pub(super) fn period_m(&self) -> Option<f64> {
        (self.parameters.kind == ProjectionMethod::Mercator).then_some(TAU * self.radius_m * self.parameters.scale)
    }

    /// Returns x and y, metres; NaN for a point that the map cannot show.
    pub(super) fn forward(&self, lon_deg: f64, lat_deg: f64) -> (f64, f64) {
        self.project(wrapped(lon_deg - self.parameters.lon0_deg).to_radians(), lat_deg.to_radians())
    }

    /// Returns longitude and latitude, degrees; NaN for a position that shows no point. Formulas also answer beyond the edge of a map. So the
    /// point must lie within half a turn of the meridian, and be shown there.
    pub(super) fn inverse(&self, x_m: f64, y_m: f64) -> (f64, f64) {
        let mut point = (x_m, y_m);
        if transform(&self.ends[1], &self.ends[0], &mut point).is_err() {
            return NOWHERE;
        }
        let (mut lon, lat) = point;
        let period_m = self.period_m();
        if period_m.is_some() {
            lon -= TAU * (lon / TAU).round();
        }
        if lon.is_nan() || lon.abs() > PI + ROUNDING_RAD {
            return NOWHERE;
        }
        let lon = lon.clamp(-PI, PI);
        let (x, y) = self.project(lon, lat);
        let mut off_m = x - x_m;
        off_m -= period_m.map_or(0.0, |period_m| period_m * (off_m / period_m).round());
        let is_there = off_m.hypot(y - y_m) <= SAME_PLACE * (self.radius_m + x_m.abs() + y_m.abs());
        if is_there { (wrapped(lon.to_degrees() + self.parameters.lon0_deg), lat.to_degrees()) } else { NOWHERE }
    }

    /// `lon` counts from the map's meridian; radians.
    fn project(&self, lon: f64, lat: f64) -> (f64, f64) {
        let ProjectionParameters { kind, lat0_deg, scale, .. } = self.parameters;
        if kind == ProjectionMethod::TransverseMercator && lon.abs() > FRAC_PI_2 {
            // Beyond the pole, where PROJ goes on and `proj4rs` stops: the mirror image of the near side, since the map continues the meridian.
            let (x, y) = self.project(lon.signum() * PI - lon, lat);
            let half_turn = if lat < 0.0 { -PI } else { PI };
            return (x, scale * self.radius_m * (half_turn - 2.0 * lat0_deg.to_radians()) - y);
        }
        let mut point = (lon, lat);
        let shown = transform(&self.ends[0], &self.ends[1], &mut point).is_ok();
        if shown && point.0.is_finite() && point.1.is_finite() { point } else { NOWHERE }
    }
}

impl PartialEq for Ported {
    fn eq(&self, other: &Self) -> bool {
        (self.parameters, self.radius_m) == (other.parameters, other.radius_m)
    }
}

impl std::fmt::Debug for Ported {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:?} on a sphere of {} m", self.parameters, self.radius_m)
    }
}
