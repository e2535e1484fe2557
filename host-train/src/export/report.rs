//! Measures of an export.
