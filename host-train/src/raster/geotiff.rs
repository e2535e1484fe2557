//! GeoTIFF in and out.
