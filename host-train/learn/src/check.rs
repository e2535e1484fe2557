//! Compares the network with a golden file, map by map, and the gradients of its weights with those on the CPU.

mod kinks;
mod weights;

pub use kinks::Kinks;

use crate::model::store;
use crate::train::loss::{Elevation, LossWeights, terms};
use burn::tensor::{Device, Tensor, TensorData};
use elunar_base::{Error, Result};
use elunar_core::error::LengthError;
use elunar_core::loss::hybrid::{ElevationTerm, add_gradient};
use elunar_core::loss::{LossError, Pair};
use elunar_core::metrics::{HeightErrors, RelativeErrors};
use elunar_core::tile::Shape;
use elunar_net::config::config_of;
use elunar_net::weights::{Array, NetWeights};
use std::collections::BTreeMap;
use std::path::Path;

/// Greatest accepted relative error of a map, the output or a loss term.
pub const MAP_TOLERANCE: f64 = 1e-4;
/// Greatest accepted relative error of the gradients of the weights ([`weights::compare_gradients`]). Sums of thousands of products in another
/// order, on the way back through all layers.
pub const GRADIENT_TOLERANCE: f64 = 1e-3;
/// Greatest accepted relative error of a metric.
pub const METRIC_TOLERANCE: f64 = 1e-5;

/// One compared quantity.
#[derive(Debug, Clone)]
pub struct Line {
    /// Map, term or metric.
    pub name: String,
    /// Relative error: greatest difference over the greatest expected magnitude.
    pub error: f64,
    /// Greatest accepted error.
    pub tolerance: f64,
    /// Remark on the comparison; may be empty.
    pub note: String,
}

impl Line {
    fn new(name: impl Into<String>, error: f64, tolerance: f64) -> Self {
        Self { name: name.into(), error, tolerance, note: String::new() }
    }
}

/// Runs the network of a golden file on its inputs and compares all contents of the file.
///
/// # Errors
/// If the file cannot be read, is broken or incomplete.
pub fn compare(path: &Path, device: &Device) -> Result<Vec<Line>> {
    let golden = NetWeights::read(path)?;
    let config = config_of(&golden, path)?;
    let net = store::load(&config, &golden, path, device)?;
    let map = |name: &str| tensor(&golden, name, path, device);
    let (output, trace) = net.forward_traced(map("input.image")?, map("input.coarse")?);

    let mut lines = Vec::new();
    for (name, found) in trace.iter().map(|(n, t)| (format!("trace.{n}"), t)).chain([("output".into(), &output)]) {
        let error = relative_error(&golden.tensors.get(&name), found);
        let error =
            error.ok_or_else(|| Error::broken(path, format!("expected tensor {name} of the network's shape")))?;
        lines.push(Line::new(name, error, MAP_TOLERANCE));
    }

    let t = terms(map("truth")?, output.clone(), Elevation::MeanNormalised, None);
    let expected: Vec<f64> = json(&golden, "loss_terms", path)?;
    let found = [("elevation", t.elevation), ("gradient", t.gradient), ("normal", t.normal)];
    for ((name, value), e) in found.into_iter().zip(&expected) {
        let error = (f64::from(value.into_scalar::<f32>()) - e).abs() / e.abs();
        lines.push(Line::new(format!("loss.{name}"), error, MAP_TOLERANCE));
    }
    lines.extend(compare_metrics(&golden, path)?);
    lines.push(compare_gradient(&golden, path, device)?);
    lines.push(weights::compare_gradients(&golden, path, device)?);
    Ok(lines)
}

/// Compares the metrics (Eq. 11–17) of the golden output against the golden truth.
fn compare_metrics(golden: &NetWeights, path: &Path) -> Result<Vec<Line>> {
    let (truth, output) = (flat(golden, "truth", path)?, flat(golden, "output", path)?);
    let wrong = |e: LengthError| Error::broken(path, format!("truth against output: {e}"));
    let (mut relative, mut height) = (RelativeErrors::default(), HeightErrors::default());
    relative.extend(truth, output, None).map_err(wrong)?;
    height.extend(truth, output, None).map_err(wrong)?;
    let ratio = relative.share_within_ratio();
    let within = height.share_within();
    let found = [
        ("rel", relative.rel()),
        ("rmse", relative.rmse()),
        ("log10", relative.log10()),
        ("psnr", relative.psnr_db()),
        ("mae", height.mae_m()),
        ("a1", ratio.map(|r| r[0])),
        ("a2", ratio.map(|r| r[1])),
        ("a3", ratio.map(|r| r[2])),
        ("re_2m", within.map(|w| w[0])),
        ("re_4m", within.map(|w| w[1])),
        ("re_10m", within.map(|w| w[2])),
    ];
    let expected: BTreeMap<String, f64> = json(golden, "metrics", path)?;
    found
        .into_iter()
        .map(|(name, value)| {
            let expected = expected
                .get(name)
                .ok_or_else(|| Error::broken(path, format!("metadata `metrics`: expected {name}")))?;
            let error = value.map_or(f64::INFINITY, |v| (v - expected).abs() / expected.abs().max(f64::MIN_POSITIVE));
            Ok(Line::new(format!("metric.{name}"), error, METRIC_TOLERANCE))
        })
        .collect()
}

/// Compares automatic differentiation of the hybrid loss with the analytic gradient on plain slices, at the golden output. At kinks of the
/// loss ([`Kinks`]) the two may differ by as much as the derivative jumps there.
fn compare_gradient(golden: &NetWeights, path: &Path, device: &Device) -> Result<Line> {
    let (found, shape) = automatic_gradient(golden, path, device)?;
    let expected = analytic_gradient(golden, path, shape)?;
    let kinks = Kinks::find(flat(golden, "truth", path)?, flat(golden, "output", path)?, shape, &LossWeights::PAPER);
    let mut line = Line::new("gradient", kinks.difference(&expected, &found) / peak(&expected), MAP_TOLERANCE);
    if kinks.count > 0 {
        let (count, of) = (kinks.count, kinks.of);
        line.note =
            format!("({count} of {of} absolute values at a kink: any derivative between its two slopes passes)");
    }
    Ok(line)
}

/// Returns the gradient of the paper's loss at the golden output by automatic differentiation, and its shape.
fn automatic_gradient(golden: &NetWeights, path: &Path, device: &Device) -> Result<(Vec<f32>, Shape)> {
    let device = device.clone().autodiff();
    let prediction = tensor(golden, "output", path, &device)?.require_grad();
    let [_, _, rows, cols] = prediction.dims();
    let terms = terms(tensor(golden, "truth", path, &device)?, prediction.clone(), Elevation::MeanNormalised, None);
    let grads = LossWeights::PAPER.total(&terms).backward();
    let found = prediction.grad(&grads).ok_or_else(|| Error::input("the backend gave no gradient"))?;
    let found = found.into_data().try_to_vec::<f32>().map_err(|e| Error::input(format!("the gradient: {e}")))?;
    Ok((found, Shape::new(rows, cols)))
}

/// Returns the same gradient, computed by `core`.
fn analytic_gradient(golden: &NetWeights, path: &Path, shape: Shape) -> Result<Vec<f32>> {
    let (truth, output) = (flat(golden, "truth", path)?, flat(golden, "output", path)?);
    let wrong = |e: LossError| Error::broken(path, format!("truth against output: {e}"));
    let pair = Pair::new(truth, output, None, shape).map_err(wrong)?;
    let mut gradient = vec![0.0; truth.len()];
    add_gradient(&pair, ElevationTerm::MeanNormalised, Default::default(), &mut gradient).map_err(wrong)?;
    Ok(gradient)
}

/// Returns the greatest magnitude.
fn peak(values: &[f32]) -> f64 {
    values.iter().fold(0.0, |m, v| m.max(f64::from(v.abs())))
}

fn flat<'a>(golden: &'a NetWeights, name: &str, path: &Path) -> Result<&'a [f32]> {
    let array = golden.tensors.get(name).ok_or_else(|| Error::broken(path, format!("expected tensor {name}")))?;
    Ok(&array.data)
}

fn tensor(golden: &NetWeights, name: &str, path: &Path, device: &Device) -> Result<Tensor<4>> {
    let array = golden.tensors.get(name).filter(|a| a.shape.len() == 4);
    let array = array.ok_or_else(|| Error::broken(path, format!("expected tensor {name} of rank 4")))?;
    Ok(Tensor::from_data(TensorData::new(array.data.clone(), array.shape.clone()), device))
}

fn json<T: serde::de::DeserializeOwned>(golden: &NetWeights, key: &str, path: &Path) -> Result<T> {
    let text = golden.metadata.get(key).ok_or_else(|| Error::broken(path, format!("expected metadata `{key}`")))?;
    serde_json::from_str(text).map_err(|e| Error::broken(path, format!("metadata `{key}`: {e}")))
}

/// Returns the greatest difference over the greatest expected magnitude; `None` if shapes differ.
fn relative_error(expected: &Option<&Array>, found: &Tensor<4>) -> Option<f64> {
    let expected = (*expected)?;
    if expected.shape != found.dims() {
        return None;
    }
    let found = found.to_data().try_to_vec::<f32>().ok()?;
    let worst = expected.data.iter().zip(&found).map(|(e, f)| f64::from((e - f).abs()));
    // A NaN must not count as "no difference".
    Some(worst.fold(0.0, |m: f64, d| if d.is_nan() { f64::INFINITY } else { m.max(d) }) / peak(&expected.data))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::backend::Backend;

    /// Returns the golden case with windows of 5. Its truth has the output's slopes in three pixels, in exact arithmetic.
    fn touching() -> NetWeights {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/golden/mini/case.safetensors");
        let mut golden = NetWeights::read(&path).unwrap();
        let [_, _, _, cols] = golden.tensors["output"].shape[..] else { panic!("a map") };
        let output = golden.tensors["output"].data.clone();
        let truth = &mut golden.tensors.get_mut("truth").unwrap().data;
        for (row, col) in (20..23).flat_map(|row| (30..35).map(move |col| (row, col))) {
            truth[row * cols + col] = output[row * cols + col] + 1.7;
        }
        golden
    }

    #[test]
    fn a_kink_of_the_loss_is_no_error_of_its_gradient() {
        let golden = touching();
        let (path, device) = (Path::new("touching"), Backend::Flex.device().unwrap());
        let line = compare_gradient(&golden, path, &device).unwrap();
        assert!(line.error <= line.tolerance, "{line:?}");
        let (truth, output) = (&golden.tensors["truth"], &golden.tensors["output"]);
        let shape = Shape::new(truth.shape[2], truth.shape[3]);
        let kinks = Kinks::find(&truth.data, &output.data, shape, &LossWeights::PAPER);
        assert!((6..20).contains(&kinks.count) && kinks.of == 3 * truth.data.len(), "{}", kinks.count);
        assert!(line.note.starts_with(&format!("({} of 18432 absolute values", kinks.count)), "{}", line.note);
        let gradient = analytic_gradient(&golden, path, shape).unwrap();
        let strict = Kinks { count: 0, of: 0, slack: vec![0.0; truth.data.len()], offset: 0.0 };
        let (found, _) = automatic_gradient(&golden, path, &device).unwrap();
        let apart = strict.difference(&gradient, &found) / peak(&gradient);
        assert!(apart > 100.0 * MAP_TOLERANCE, "both fall on the same side, so the case shows nothing: {apart}");
        // Larger differences, and differences elsewhere, are errors.
        let error = |at: usize, by: f64| {
            let mut found = gradient.clone();
            found[at] += by as f32;
            kinks.difference(&gradient, &found) / peak(&gradient)
        };
        let (kink, elsewhere, small) =
            (21 * shape.cols + 31, 50 * shape.cols + 70, 2.0 * MAP_TOLERANCE * peak(&gradient));
        assert!(kinks.slack[kink] > 100.0 * small && kinks.slack[elsewhere] == 0.0 && kinks.offset == 0.0);
        assert!(error(kink, 0.9 * kinks.slack[kink]) == 0.0 && error(kink, kinks.slack[kink] + small) > MAP_TOLERANCE);
        assert!(error(elsewhere, small) > MAP_TOLERANCE);
        assert_eq!(kinks.difference(&gradient, &vec![f32::NAN; gradient.len()]), f64::INFINITY);
    }

    #[test]
    fn what_goes_through_the_mean_is_the_same_everywhere() {
        // Equal maps have a kink in every pixel.
        let (truth, prediction) = ([2.0f32; 12], [2.0f32; 12]);
        let kinks = Kinks::find(&truth, &prediction, Shape::new(3, 4), &LossWeights::PAPER);
        assert_eq!((kinks.count, kinks.of), (36, 36));
        // Twelve pixels, each with weight 10 / 12, two slopes 2 apart, and its share z* / N of the mean's derivative.
        let expected = 12.0 * 2.0 * 10.0 / 12.0 * 2.0 / 2.001 / 2.001 / 12.0;
        assert!((kinks.offset - expected).abs() < 1e-12, "{}", kinks.offset);
        let alone = Kinks { count: 1, of: 36, slack: vec![0.0; 12], offset: 0.5 };
        assert_eq!(alone.difference(&[1.4; 12], &[1.0; 12]), 0.0, "within the offset");
        assert!((alone.difference(&[1.4; 12], &[0.8; 12]) - 0.1).abs() < 1e-6, "beyond it");
    }
}
