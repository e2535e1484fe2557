//! Laser altimeter tracks beside DTMs: the paper's Eq. 18.
//!
//! [`csv`] reads points, [`track`] cuts them into tracks, [`shift`] moves each track over a DTM to where it fits best. LOLA spots are
//! placed on the ground to some ten metres, a DTM of an orbiter image lies where its own camera model put it: only what is left
//! after the best shift says how good the DTM's shape is.

pub mod csv;
pub mod report;
pub mod shift;
pub mod track;

#[cfg(test)]
mod tests;
