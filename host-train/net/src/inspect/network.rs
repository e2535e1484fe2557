//! Descriptions of model files and tensors.

use super::model::{ModelFigures, OperatorLine};
use crate::weights::NetWeights;
use elunar_base::digest::sha256_hex;
use elunar_base::{Result, read};
use std::path::Path;

/// Describes the tensors of a safetensors file: weights, a golden case, or neither.
///
/// # Errors
/// If the file cannot be read, or is broken.
pub fn tensors(path: &Path) -> Result<String> {
    let bytes = read::bytes(path, read::MOST_WEIGHTS_BYTES)?;
    let weights = NetWeights::from_bytes(path, &bytes)?;
    let count: usize = weights.tensors.values().map(|a| a.data.len()).sum();
    let is_golden = weights.tensors.contains_key("input.image") && weights.metadata.contains_key("loss_terms");
    let kind = match (is_golden, weights.metadata.contains_key("config")) {
        (true, _) => "golden case (weights, inputs and what they give)",
        (false, true) => "float weights",
        (false, false) => "tensors without a configuration",
    };
    let mut out = format!("{kind}: {} tensors, {count} numbers\n{}\n", weights.tensors.len(), digest(&bytes));
    weights.metadata.iter().for_each(|(key, value)| out += &format!("{key}: {value}\n"));
    for (name, array) in &weights.tensors {
        out += &format!("{name:60} {:?}\n", array.shape);
    }
    Ok(out.trim_end().into())
}

/// Describes a plan in several lines, without a newline at the end.
pub fn model(plan: &ModelFigures) -> String {
    let ModelFigures { tile: (rows, cols), .. } = plan;
    let mut out = format!("int8 model for tiles of {rows} x {cols}, normalised to [0, {}]", plan.nr);
    out += &format!(", range widened by {}, truth range {}\n", plan.range_margin, plan.truth_range);
    out += &format!("sha256:{}\n", plan.sha256);
    out += &format!("name: {}\nprecision: {}\nconfig: {}\n", plan.name, plan.precision, plan.config);
    out += &format!(
        "arena {} bytes, of which scratch {}; tensors alive together take {} at most; constants {} bytes\n",
        plan.arena_bytes, plan.scratch_bytes, plan.live_peak_bytes, plan.constants_bytes
    );
    let gmac = plan.macs as f64 / 1e9;
    out += &format!("{} operators in {} entries, {gmac:.3} GMAC per tile\n", plan.operators.len(), plan.entries);
    if let Some(time) = &plan.time {
        let rate = plan.macs as f64 / time.tile_ms / 1e6;
        out += &format!("kernel {}: {:.1} ms per tile, {rate:.2} GMAC/s, medians of ", time.kernel, time.tile_ms);
        out += &format!("{} tiles; the overhead of stepping is contained\n", time.tiles);
    }
    out += &format!(
        "{:>4} {:44} {:11} {:21} {:>5} {:>6} {:>9} {:>9} {:>9} {:>9}",
        "#", "name", "kind", "output", "kept", "margin", "MMAC", "weights", "bytes", "at byte"
    );
    let header = format!(" {:>8} {:>6} {:>7}", "ms", "share", "GMAC/s");
    out += if plan.time.is_some() { &header } else { "" };
    for (index, line) in plan.operators.iter().enumerate() {
        out += &format!("\n{index:>4} {}", operator(line));
    }
    out
}

fn operator(line: &OperatorLine) -> String {
    let [rows, cols, channels] = line.shape;
    let mut out = format!(
        "{:44} {:11} {:21} {:>5} {:>6} {:>9.2} {:>9} {:>9} {:>9}",
        line.name,
        line.kind,
        format!("[{rows}, {cols}, {channels}] {}", line.dtype),
        line.rows_kept,
        line.margin,
        line.macs as f64 / 1e6,
        line.weight_bytes,
        line.activation_bytes,
        line.offset
    );
    if let (Some(ms), Some(share)) = (line.ms, line.share) {
        let rate = line.gmac_per_s.map_or_else(String::new, |rate| format!("{rate:.2}"));
        out += &format!(" {ms:>8.3} {:>5.1}% {rate:>7}", 100.0 * share);
    }
    out
}

fn digest(bytes: &[u8]) -> String {
    format!("sha256:{}", sha256_hex(bytes))
}
