//! Tolerances of the tests in `cases/`, each with its reason.

/// Loss terms of `core` (sums in `f64`) compared with PyTorch (sums in `f32`), relative. Some thousand `f32` additions in pairwise order
/// lose about 1e-6; the cosine of the normal term loses digits in 1 − cos.
pub const LOSS_TERM: f64 = 5e-6;

/// Metrics of `core` compared with PyTorch in `f64`, relative: both sum the same numbers, in another order.
pub const METRIC: f64 = 1e-12;

/// Slope compared with GDAL, degrees: GDAL stores `f32` and computes with `f32` coefficients.
pub const SLOPE_DEG: f64 = 1e-5;

/// Slope (degrees) and roughness (metres) of footprints compared with numpy in `f64`: those of `core` are rounded to `f32`, below 90 and
/// below 16.
pub const FOOTPRINT: f64 = 5e-6;

/// Loss gradients by automatic differentiation in `f32` compared with the analytic ones, relative to the largest derivative.
pub const LOSS_GRADIENT: f32 = 1e-5;
