//! Overlapping tiles joined into one map.
