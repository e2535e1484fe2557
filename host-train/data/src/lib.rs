//! Tiles for training and calibration. [`mod@source`] names their sources, and [`sample`] makes them the input of a network. [`prepare`] makes a
//! training set of images and DTMs; [`prepared`] reads it.

pub mod calibration;
pub mod folder;
pub mod prepare;
pub mod prepared;
pub mod sample;
pub mod source;
