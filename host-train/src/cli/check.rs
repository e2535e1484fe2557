//! `host-train check`: the network against a golden file, map by map.

use crate::model::backend::Backend;
use crate::model::config::config_of;
use crate::model::store;
use crate::model::weights::{Array, Weights};
use crate::train::loss::{Elevation, LossWeights, terms};
use crate::{Error, Result};
use burn::tensor::{Device, Tensor, TensorData};
use elunar_core::error::LengthError;
use elunar_core::loss::LossError;
use elunar_core::loss::Pair;
use elunar_core::loss::hybrid::{ElevationTerm, add_gradient};
use elunar_core::metrics::{HeightErrors, RelativeErrors};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Largest accepted relative error of a map, the output or a loss term.
pub const MAP_TOLERANCE: f64 = 1e-4;
/// Largest accepted relative error of a metric.
pub const METRIC_TOLERANCE: f64 = 1e-5;

/// Options of `check`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  host-train check tests/golden/mini/case.safetensors")]
pub struct Args {
    /// Golden files: weights, inputs, traced maps, output, loss terms and metrics.
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// Backend to run on.
    #[arg(long, default_value = "flex")]
    pub backend: Backend,
}

/// One compared quantity.
#[derive(Debug, Clone)]
pub struct Line {
    /// Map, term or metric.
    pub name: String,
    /// Relative error: maximum difference over the maximum magnitude expected.
    pub error: f64,
    /// What is accepted.
    pub tolerance: f64,
}

/// Runs the command.
///
/// # Errors
/// If a file is unreadable or broken, or any quantity leaves its tolerance.
pub fn run(args: Args) -> Result<()> {
    let device = args.backend.device()?;
    let mut failed = Vec::new();
    for path in &args.files {
        println!("{} on {:?}", path.display(), args.backend);
        for line in compare(path, &device)? {
            let ok = line.error <= line.tolerance;
            println!("  {:24} {:10.3e}  {}", line.name, line.error, if ok { "ok" } else { "FAILED" });
            if !ok {
                failed.push(format!("{}: {} off by {:.3e}", path.display(), line.name, line.error));
            }
        }
    }
    match failed.first() {
        None => Ok(()),
        Some(first) => {
            let what = format!("{first}: expected at most {MAP_TOLERANCE:e} (metrics {METRIC_TOLERANCE:e})");
            Err(Error::usage(if failed.len() == 1 { what } else { format!("{what}; {} more", failed.len() - 1) }))
        }
    }
}

/// Runs the network of a golden file on its inputs and compares everything the file holds.
///
/// # Errors
/// If the file is unreadable, broken or incomplete.
pub fn compare(path: &Path, device: &Device) -> Result<Vec<Line>> {
    let golden = Weights::read(path)?;
    let config = config_of(&golden, path)?;
    let net = store::load(&config, &golden, path, device)?;
    let map = |name: &str| tensor(&golden, name, path, device);
    let (output, trace) = net.forward_traced(map("input.image")?, map("input.coarse")?);

    let mut lines = Vec::new();
    for (name, found) in trace.iter().map(|(n, t)| (format!("trace.{n}"), t)).chain([("output".into(), &output)]) {
        let error = relative_error(&golden.tensors.get(&name), found);
        let error =
            error.ok_or_else(|| Error::broken(path, format!("expected tensor {name} of the network's shape")))?;
        lines.push(Line { name, error, tolerance: MAP_TOLERANCE });
    }

    let t = terms(map("truth")?, output.clone(), Elevation::MeanNormalised);
    let expected: Vec<f64> = json(&golden, "loss_terms", path)?;
    let found = [("elevation", t.elevation), ("gradient", t.gradient), ("normal", t.normal)];
    for ((name, value), e) in found.into_iter().zip(&expected) {
        let error = (f64::from(value.into_scalar::<f32>()) - e).abs() / e.abs();
        lines.push(Line { name: format!("loss.{name}"), error, tolerance: MAP_TOLERANCE });
    }
    lines.extend(compare_metrics(&golden, path)?);
    lines.push(compare_gradient(&golden, path, device)?);
    Ok(lines)
}

/// The metrics (Eq. 11–17) of the golden output against the golden truth.
fn compare_metrics(golden: &Weights, path: &Path) -> Result<Vec<Line>> {
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
            Ok(Line { name: format!("metric.{name}"), error, tolerance: METRIC_TOLERANCE })
        })
        .collect()
}

/// Automatic differentiation of the hybrid loss against the analytic gradient on plain slices, at the golden output.
fn compare_gradient(golden: &Weights, path: &Path, device: &Device) -> Result<Line> {
    let device = device.clone().autodiff();
    let prediction = tensor(golden, "output", path, &device)?.require_grad();
    let [_, _, rows, cols] = prediction.dims();
    let terms = terms(tensor(golden, "truth", path, &device)?, prediction.clone(), Elevation::MeanNormalised);
    let grads = LossWeights::PAPER.total(&terms).backward();
    let found = prediction.grad(&grads).ok_or_else(|| Error::usage("the backend gave no gradient"))?;

    let (truth, output) = (flat(golden, "truth", path)?, flat(golden, "output", path)?);
    let wrong = |e: LossError| Error::broken(path, format!("truth against output: {e}"));
    let pair = Pair::new(truth, output, None, (rows, cols)).map_err(wrong)?;
    let mut data = vec![0.0; truth.len()];
    add_gradient(&pair, ElevationTerm::MeanNormalised, Default::default(), &mut data).map_err(wrong)?;
    let expected = Array { shape: vec![1, 1, rows, cols], data };
    let error = relative_error(&Some(&expected), &found).unwrap_or(f64::INFINITY);
    Ok(Line { name: "gradient".into(), error, tolerance: MAP_TOLERANCE })
}

fn flat<'a>(golden: &'a Weights, name: &str, path: &Path) -> Result<&'a [f32]> {
    let array = golden.tensors.get(name).ok_or_else(|| Error::broken(path, format!("expected tensor {name}")))?;
    Ok(&array.data)
}

fn tensor(golden: &Weights, name: &str, path: &Path, device: &Device) -> Result<Tensor<4>> {
    let array = golden.tensors.get(name).filter(|a| a.shape.len() == 4);
    let array = array.ok_or_else(|| Error::broken(path, format!("expected tensor {name} of rank 4")))?;
    Ok(Tensor::from_data(TensorData::new(array.data.clone(), array.shape.clone()), device))
}

fn json<T: serde::de::DeserializeOwned>(golden: &Weights, key: &str, path: &Path) -> Result<T> {
    let text = golden.metadata.get(key).ok_or_else(|| Error::broken(path, format!("expected metadata `{key}`")))?;
    serde_json::from_str(text).map_err(|e| Error::broken(path, format!("metadata `{key}`: {e}")))
}

/// Maximum difference over the maximum magnitude expected; `None` if shapes differ.
fn relative_error(expected: &Option<&Array>, found: &Tensor<4>) -> Option<f64> {
    let expected = (*expected)?;
    if expected.shape != found.dims() {
        return None;
    }
    let found = found.to_data().try_to_vec::<f32>().ok()?;
    let peak = expected.data.iter().fold(0.0f64, |m, v| m.max(f64::from(v.abs())));
    let worst = expected.data.iter().zip(&found).map(|(e, f)| f64::from((e - f).abs()));
    // A NaN must not pass as "no difference".
    Some(worst.fold(0.0, |m: f64, d| if d.is_nan() { f64::INFINITY } else { m.max(d) }) / peak)
}
