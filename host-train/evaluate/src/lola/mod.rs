//! Comparison of DTMs with laser altimeter tracks (the paper's Eq. 18).
//!
//! [`csv`] reads points, [`track`] cuts them into tracks, [`place`] finds them on a raster, [`shift`] moves each track over a DTM to the best
//! fit. The position of a LOLA spot has an error of about ten metres. The position of a DTM depends on the camera model of its image. Only the
//! difference that remains after the best shift shows the error of the DTM's shape.

pub mod csv;
pub mod place;
pub mod report;
pub mod shift;
pub mod track;

#[cfg(test)]
mod tests;
