//! The plan of a model: its operators, the places of its tensors in the arena, and when each is in use.

use super::timing::{Times, entry_macs};
use elunar_base::digest::sha256_hex;
use elunar_base::{Error, Result};
use elunar_core::nn::file::{Dtype, NONE, Operator, Tensor};
use elunar_core::nn::{Model, required};
use elunar_core::tile::Shape;
use serde::Serialize;

/// The figures of a model.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ModelFigures {
    /// Name in the file.
    pub name: String,
    /// Bits of the maps, as chosen for the export.
    pub precision: String,
    /// The network's configuration.
    pub config: serde_json::Value,
    /// SHA-256 of the whole file.
    pub sha256: String,
    /// Rows and columns of a tile.
    pub tile: (usize, usize),
    /// Upper end of the normalised range.
    pub nr: f32,
    /// Share by which the coarse relief is widened.
    pub range_margin: f32,
    /// Which DTM's range normalised the truth.
    pub truth_range: String,
    /// Bytes of the file.
    pub file_bytes: usize,
    /// Bytes of weights, multipliers and tables.
    pub constants_bytes: usize,
    /// Size of the arena, bytes.
    pub arena_bytes: usize,
    /// Part of the arena that is working memory of the current operator, behind the tensors, bytes.
    pub scratch_bytes: usize,
    /// Greatest number of bytes of tensors in use at the same time. No placement needs less. The rest of the arena is gaps.
    pub live_peak_bytes: usize,
    /// Number of entries of the schedule.
    pub entries: usize,
    /// Multiply-accumulates per tile.
    pub macs: u64,
    /// Operators in the order of the file.
    pub operators: Vec<OperatorLine>,
    /// Tensors in the order of the file. Unused tensors are left out.
    pub tensors: Vec<TensorLife>,
    /// Bytes of tensors in use from each moment on: (multiply-accumulates done, bytes).
    #[serde(skip)]
    pub live: Vec<(u64, usize)>,
    /// Times, if they were measured.
    pub time: Option<Times>,
}

/// One operator.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OperatorLine {
    /// Name.
    pub name: String,
    /// Kind, in a word.
    pub kind: &'static str,
    /// Rows, columns, channels of its output.
    pub shape: [usize; 3],
    /// Sample type of its output.
    pub dtype: &'static str,
    /// Rows of the output that are kept at a time.
    pub rows_kept: usize,
    /// Number of additional columns on both sides.
    pub margin: usize,
    /// Multiply-accumulates.
    pub macs: u64,
    /// Bytes of packed weights (convolutions only; without biases, multipliers and tables).
    pub weight_bytes: usize,
    /// Bytes of the kept rows of its output. If rows of several tensors are interleaved, they span more.
    pub activation_bytes: usize,
    /// Offset of the output in the arena, bytes.
    pub offset: usize,
    /// Milliseconds per tile, with the overhead of stepping; `None` if not measured.
    pub ms: Option<f64>,
    /// Share of the tile's time.
    pub share: Option<f64>,
    /// Multiply-accumulates per second / 10^9.
    pub gmac_per_s: Option<f64>,
}

/// The place of a tensor, and when it is in use.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TensorLife {
    /// Name of the operator that writes it.
    pub name: String,
    /// First byte in the arena.
    pub offset: usize,
    /// Bytes from there to its last byte, including gaps between its rows.
    pub bytes: usize,
    /// Number of the schedule's first entry that uses the tensor, from 1; 0 for inputs.
    pub first_entry: usize,
    /// Number of the last entry that uses the tensor.
    pub last_entry: usize,
    /// Multiply-accumulates done when its use begins.
    pub first_mac: u64,
    /// Multiply-accumulates done when it is no longer needed.
    pub last_mac: u64,
}

impl ModelFigures {
    /// Reads the plan of a validated model. The model is not run.
    pub fn of(model: &Model<'_>) -> Self {
        let Shape { rows, cols } = model.tile();
        let text: serde_json::Value = serde_json::from_str(model.text()).unwrap_or_default();
        let word = |key: &str| text[key].as_str().unwrap_or_default().to_owned();
        let names: Vec<String> = (0..model.operator_count())
            .map(|index| text["operators"][index].as_str().map_or_else(|| format!("operator {index}"), Into::into))
            .collect();
        let ends = entry_ends(model);
        let tensors = lives(model, &names, &ends);
        let live = live_bytes(&tensors, &ends);
        Self {
            name: word("name"),
            precision: word("precision"),
            config: text["config"].clone(),
            sha256: sha256_hex(model.raw().bytes()),
            tile: (rows, cols),
            nr: model.nr(),
            range_margin: model.range_margin(),
            truth_range: format!("{:?}", model.truth_range()).to_lowercase(),
            file_bytes: model.raw().bytes().len(),
            constants_bytes: model.constants_bytes(),
            arena_bytes: required(model),
            scratch_bytes: model.scratch_bytes(),
            live_peak_bytes: live.iter().map(|(_, bytes)| *bytes).max().unwrap_or(0),
            entries: model.entry_count(),
            macs: model.macs(),
            operators: names.into_iter().enumerate().filter_map(|(index, name)| line(model, index, name)).collect(),
            tensors,
            live,
            time: None,
        }
    }

    /// Adds a measurement of the same model.
    pub fn set_times(&mut self, times: Times) {
        let all: f64 = times.operators_ms.iter().sum();
        for (line, &ms) in self.operators.iter_mut().zip(&times.operators_ms) {
            line.ms = Some(ms);
            line.share = Some(ms / all.max(f64::MIN_POSITIVE));
            line.gmac_per_s = (ms > 0.0).then(|| line.macs as f64 / ms / 1e6);
        }
        self.time = Some(times);
    }

    /// Returns the plan as JSON, in one line.
    ///
    /// # Errors
    /// [`Error::Input`] if JSON cannot represent a number.
    pub fn json(&self) -> Result<String> {
        serde_json::to_string(self).map_err(|e| Error::input(format!("inspect: {e}")))
    }
}

fn line(model: &Model<'_>, index: usize, name: String) -> Option<OperatorLine> {
    let operator = model.operator(index)?;
    let out = model.tensor(operator.output());
    let weight_bytes = if let Operator::Conv(conv) = &operator { model.weight_bytes(conv) } else { 0 };
    Some(OperatorLine {
        name,
        kind: operator.name(),
        shape: [out.rows, out.cols, out.channels],
        dtype: dtype(&out),
        rows_kept: out.ring,
        margin: out.margin,
        macs: model.operator_macs(&operator),
        weight_bytes,
        activation_bytes: out.ring * out.row_bytes(),
        offset: out.offset,
        ms: None,
        share: None,
        gmac_per_s: None,
    })
}

fn dtype(t: &Tensor) -> &'static str {
    match t.dtype {
        Dtype::U8 => "u8",
        Dtype::I16 => "i16",
        Dtype::F32 => "f32",
    }
}

/// Returns the multiply-accumulates done before the first entry, after the first, after the second, ...
fn entry_ends(model: &Model<'_>) -> Vec<u64> {
    let mut done = 0;
    let after = (0..model.entry_count()).map(|index| {
        done += entry_macs(model, index);
        done
    });
    std::iter::once(0).chain(after).collect()
}

fn lives(model: &Model<'_>, names: &[String], ends: &[u64]) -> Vec<TensorLife> {
    // First and last entry, counted from 1.
    let mut touched: Vec<Option<(usize, usize)>> = vec![None; model.tensor_count()];
    let mut touch = |tensor: u32, at: usize| {
        if let Some(life) = touched.get_mut(tensor as usize) {
            life.get_or_insert((at, at)).1 = at;
        }
    };
    let inputs = [(model.image_tensor(), "image"), (model.coarse_tensor(), "coarse")];
    inputs.iter().filter(|(tensor, _)| *tensor != NONE).for_each(|(tensor, _)| touch(*tensor, 0));
    for index in 0..model.entry_count() {
        let Some(operator) = model.entry(index).and_then(|entry| model.operator(entry.operator)) else { continue };
        operator.inputs().into_iter().flatten().chain([operator.output()]).for_each(|tensor| touch(tensor, index + 1));
    }
    touch(model.output_tensor(), model.entry_count());
    let mut called: Vec<String> = vec![String::new(); model.tensor_count()];
    for (tensor, name) in inputs {
        if let Some(place) = called.get_mut(tensor as usize) {
            *place = name.into();
        }
    }
    for (index, name) in names.iter().enumerate() {
        let tensor = model.operator(index).map_or(NONE, |operator| operator.output());
        if let Some(place) = called.get_mut(tensor as usize) {
            place.clone_from(name);
        }
    }
    let life = |(index, name): (usize, String)| {
        let (first_entry, last_entry) = touched[index]?;
        let t = model.tensor(index as u32);
        let (first_mac, last_mac) = (ends[first_entry.saturating_sub(1)], ends[last_entry]);
        let (offset, bytes) = (t.offset, t.size_bytes());
        Some(TensorLife { name, offset, bytes, first_entry, last_entry, first_mac, last_mac })
    };
    called.into_iter().enumerate().filter_map(life).collect()
}

/// Returns the bytes in use during every entry. If a sum takes the place of what was added, the place counts once.
fn live_bytes(tensors: &[TensorLife], ends: &[u64]) -> Vec<(u64, usize)> {
    let during = |entry: usize| {
        let mut places: Vec<(usize, usize)> = tensors
            .iter()
            .filter(|t| (t.first_entry..=t.last_entry).contains(&entry))
            .map(|t| (t.offset, t.offset + t.bytes))
            .collect();
        places.sort_unstable();
        let (mut bytes, mut covered) = (0, 0);
        for (from, to) in places {
            bytes += to.saturating_sub(from.max(covered));
            covered = covered.max(to);
        }
        bytes
    };
    (1..ends.len()).map(|entry| (ends[entry - 1], during(entry))).collect()
}
