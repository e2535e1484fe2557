//! Predictions for callers that hold arrays instead of files.

use super::network::TileModel;
use super::run::{PredictOptions, predict};
use super::scene::{NamedRaster, Scene};
use elunar_base::{Error, Result};
use elunar_raster::{Crs, GeoRef, Raster};
use ndarray::{Array2, ArrayView2};
use std::ops::ControlFlow;

/// Predicts heights of an image, metres, from arrays. The result is that of [`predict`] for a [`Scene`] whose coarse DTM is already on the
/// image's grid.
///
/// `image` holds relative brightness and `coarse_m` heights in metres, both (rows, columns) on one grid, rows from north to south, NaN
/// where invalid. Any strides are accepted. `pixel_m` is the side of a pixel of that grid on the ground, metres. `coarse_px` is the side of
/// a pixel of the coarse DTM before it was interpolated, in pixels of the image, at least 1. The result has the shape of the inputs, NaN
/// where either is invalid.
///
/// # Errors
/// [`Error::Usage`] if the shapes differ, there is no pixel, or `pixel_m` or `coarse_px` is out of range. Otherwise as [`predict`].
///
/// # Examples
/// A model that returns the coarse DTM gives the coarse DTM back:
/// ```
/// use elunar_core::nn::{Illumination, InputRules, TruthRange};
/// use elunar_core::tile::Shape;
/// use elunar_scene::predict::network::{TileModel, TileNetwork};
/// use elunar_scene::predict::{PredictOptions, predict_array};
/// use ndarray::Array2;
///
/// struct Coarse;
///
/// impl TileNetwork for Coarse {
///     fn predict(&mut self, _image: &[f32], coarse: &[f32], output: &mut [f32]) -> elunar_base::Result<()> {
///         output.copy_from_slice(coarse);
///         Ok(())
///     }
/// }
///
/// impl TileModel for Coarse {
///     fn tile(&self) -> Shape {
///         Shape::new(32, 32)
///     }
///     fn input_rules(&self) -> InputRules {
///         let (truth_range, illumination) = (TruthRange::Reference, Illumination::Any);
///         InputRules { nr: 50.0, range_margin: 0.1, truth_range, illumination }
///     }
///     fn description(&self) -> String {
///         "the coarse DTM".into()
///     }
///     fn worker(&self) -> elunar_base::Result<Box<dyn TileNetwork + '_>> {
///         Ok(Box::new(Coarse))
///     }
/// }
///
/// let image = Array2::from_shape_fn((40, 50), |(row, col)| ((7 * row + 3 * col) % 11) as f32);
/// let mut coarse_m = Array2::from_shape_fn((40, 50), |(row, col)| -1900.0 + row as f32 + 0.5 * col as f32);
/// coarse_m[[3, 4]] = f32::NAN;
/// let options = PredictOptions { overlap_px: PredictOptions::overlap_for(Coarse.tile()), ..PredictOptions::default() };
/// let heights_m = predict_array(image.view(), coarse_m.view(), 2.0, 30.0, &Coarse, &options)?;
/// assert_eq!(heights_m.dim(), (40, 50));
/// assert!(heights_m[[3, 4]].is_nan());
/// assert!((heights_m[[20, 30]] - coarse_m[[20, 30]]).abs() < 1e-2);
/// # Ok::<(), elunar_base::Error>(())
/// ```
pub fn predict_array(
    image: ArrayView2<'_, f32>,
    coarse_m: ArrayView2<'_, f32>,
    pixel_m: f32,
    coarse_px: f32,
    model: &dyn TileModel,
    options: &PredictOptions,
) -> Result<Array2<f32>> {
    let (rows, cols) = image.dim();
    if coarse_m.dim() != (rows, cols) || image.is_empty() {
        let (coarse_rows, coarse_cols) = coarse_m.dim();
        return Err(Error::usage(format!(
            "predict_array: image and coarse DTM of one shape expected, 1 x 1 pixels at least, found {rows} x {cols} and {coarse_rows} x {coarse_cols}"
        )));
    }
    if !(pixel_m > 0.0 && pixel_m.is_finite() && coarse_px >= 1.0 && coarse_px.is_finite()) {
        return Err(Error::usage(format!(
            "predict_array: pixel_m above 0 and coarse_px of at least 1 expected, found {pixel_m} and {coarse_px}"
        )));
    }
    // The position of the grid does not matter. Both inputs have the same position.
    let side_m = f64::from(pixel_m);
    let georef = GeoRef { transform: [0.0, side_m, 0.0, 0.0, 0.0, -side_m], crs: Crs::moon_equirectangular(0.0, 0.0) };
    let input = |name: &str, samples: ArrayView2<'_, f32>| {
        let samples = samples.iter().copied().collect();
        NamedRaster::in_memory(name, Raster { rows, cols, samples, georef: Some(georef.clone()) })
    };
    let mut scene = Scene::new(input("image", image), input("coarse DTM", coarse_m))?;
    scene.coarse_px = coarse_px;
    let made = predict(&scene, model, options, &mut |_, _| ControlFlow::Continue(()))?;
    Array2::from_shape_vec((rows, cols), made.dtm.samples).map_err(|e| Error::usage(format!("predict_array: {e}")))
}

#[cfg(test)]
mod tests {
    use super::super::network::TileNetwork;
    use super::super::tests::{place, silent};
    use super::*;
    use elunar_core::nn::{Illumination, InputRules, TruthRange};
    use elunar_core::tile::Shape;
    use ndarray::s;

    /// Adds the image to the coarse DTM. Its light comes from one quadrant and its heights are in pixels, so that all properties of a scene
    /// are used.
    struct Raised;

    impl TileNetwork for Raised {
        fn predict(&mut self, image: &[f32], coarse: &[f32], output: &mut [f32]) -> Result<()> {
            output.iter_mut().zip(image).zip(coarse).for_each(|((z, i), c)| *z = c + 3.0 * i);
            Ok(())
        }
    }

    impl TileModel for Raised {
        fn tile(&self) -> Shape {
            Shape::new(32, 48)
        }
        fn input_rules(&self) -> InputRules {
            let (truth_range, illumination) = (TruthRange::Pixel, Illumination::Northwest);
            InputRules { nr: 50.0, range_margin: 0.0, truth_range, illumination }
        }
        fn description(&self) -> String {
            "raised".into()
        }
        fn worker(&self) -> Result<Box<dyn TileNetwork + '_>> {
            Ok(Box::new(Raised))
        }
    }

    const SHAPE: (usize, usize) = (70, 90);

    fn options() -> PredictOptions {
        PredictOptions { overlap_px: 10, threads: 2, ..PredictOptions::default() }
    }

    /// Returns a scene of two rasters, and their samples as arrays.
    fn scene() -> (Scene, Array2<f32>, Array2<f32>) {
        let (rows, cols) = SHAPE;
        let mut image = Array2::from_shape_fn(SHAPE, |(row, col)| 100.0 + ((row * 90 + col) * 7919 % 251) as f32);
        image[[5, 6]] = f32::NAN;
        let raster =
            Raster { rows, cols, samples: image.iter().copied().collect(), georef: place((300.0, 500.0), 2.0) };
        let height = |i: usize| -1900.0 + 40.0 * ((i / 12) as f32).sin() * ((i % 12) as f32 / 3.0).cos();
        let coarse =
            Raster { rows: 12, cols: 12, samples: (0..144).map(height).collect(), georef: place((280.0, 520.0), 30.0) };
        let scene =
            Scene::new(NamedRaster::in_memory("image", raster), NamedRaster::in_memory("coarse", coarse)).unwrap();
        let coarse_m = Array2::from_shape_vec(SHAPE, scene.band(0, rows).unwrap().coarse_m).unwrap();
        (scene, image, coarse_m)
    }

    fn same(a: &Array2<f32>, b: &Array2<f32>) -> bool {
        a.iter().map(|v| v.to_bits()).eq(b.iter().map(|v| v.to_bits()))
    }

    #[test]
    fn arrays_are_predicted_as_rasters_are() {
        let (scene, image, coarse_m) = scene();
        let made = predict(&scene, &Raised, &options(), &mut silent).unwrap();
        let expected = Array2::from_shape_vec(SHAPE, made.dtm.samples).unwrap();
        let of = |pixel_m, coarse_px| {
            predict_array(image.view(), coarse_m.view(), pixel_m, coarse_px, &Raised, &options()).unwrap()
        };
        assert!(same(&of(2.0, 15.0), &expected));
        assert!(expected[[5, 6]].is_nan() && expected.iter().filter(|z| z.is_nan()).count() == 1);
        assert!(!same(&of(4.0, 15.0), &expected), "the size of a pixel counts");
    }

    #[test]
    fn views_of_any_strides_are_taken() {
        let (_, image, coarse_m) = scene();
        let expected = predict_array(image.view(), coarse_m.view(), 2.0, 15.0, &Raised, &options()).unwrap();
        // In column-major order, and as every second column of a wider array.
        let turned = image.t().as_standard_layout().into_owned();
        let wide = Array2::from_shape_fn((70, 180), |(row, col)| coarse_m[[row, col / 2]]);
        let (image, coarse_m) = (turned.t(), wide.slice(s![.., ..;2]));
        assert!(image.as_slice().is_none() && coarse_m.as_slice().is_none());
        assert!(same(&predict_array(image, coarse_m, 2.0, 15.0, &Raised, &options()).unwrap(), &expected));
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let zeros = |rows, cols| Array2::<f32>::zeros((rows, cols));
        let refused = |image: Array2<f32>, coarse_m: Array2<f32>, pixel_m, coarse_px| {
            let made = predict_array(image.view(), coarse_m.view(), pixel_m, coarse_px, &Raised, &options());
            made.unwrap_err().to_string()
        };
        let text = refused(zeros(4, 5), zeros(5, 4), 2.0, 15.0);
        assert!(text.contains("one shape expected") && text.contains("found 4 x 5 and 5 x 4"), "{text}");
        assert!(refused(zeros(0, 5), zeros(0, 5), 2.0, 15.0).contains("1 x 1 pixels at least"));
        for (pixel_m, coarse_px) in [(0.0, 15.0), (f32::NAN, 15.0), (f32::INFINITY, 15.0), (2.0, 0.5), (2.0, f32::NAN)]
        {
            assert!(refused(zeros(4, 5), zeros(4, 5), pixel_m, coarse_px).contains("coarse_px of at least 1 expected"));
        }
        let nothing = Array2::from_elem((4, 5), f32::NAN);
        assert!(refused(nothing, zeros(4, 5), 2.0, 15.0).contains("found none"));
    }
}
