//! Compares the model file in the page with the code: constants, header words and records.

use crate::pages::{read, section, table};
use crate::reader::entry_seal;
use crate::{number, numbered, page};
use elunar_core::nn::file::*;
use elunar_core::nn::*;
use elunar_core::quant::lut::{CODE_TABLE_LEN, EXP_COARSE, EXP_FINE};
use elunar_core::quant::{MULTIPLIER_LIMIT, SHIFT_LIMIT};
use std::collections::{BTreeMap, BTreeSet};

#[test]
fn constants_are_the_codes() {
    let code: BTreeMap<&str, u64> = [
        ("VERSION", file::VERSION as u64),
        ("HEADER_BYTES", HEADER_BYTES as u64),
        ("CHUNK_BYTES", file::CHUNK_BYTES as u64),
        ("CHUNK_RECORD_BYTES", file::CHUNK_RECORD_BYTES as u64),
        ("TENSOR_BYTES", TENSOR_BYTES as u64),
        ("OPERATOR_BYTES", OPERATOR_BYTES as u64),
        ("ENTRY_BYTES", ENTRY_BYTES as u64),
        ("NONE", file::NONE as u64),
        ("MAX_RECORDS", MAX_RECORDS as u64),
        ("MAX_EXTENT", MAX_EXTENT as u64),
        ("MAX_SAMPLES", MAX_SAMPLES),
        ("MAX_MARGIN", MAX_MARGIN as u64),
        ("MAX_KERNEL", MAX_KERNEL as u64),
        ("MAX_BLOCK", MAX_BLOCK as u64),
        ("MAX_WINDOW", MAX_WINDOW as u64),
        ("MAX_NORM_CHANNELS", MAX_NORM_CHANNELS as u64),
        ("MAX_ADD_SHIFT", MAX_ADD_SHIFT as u64),
        ("MAX_OUTPUT", MAX_OUTPUT as u64),
        ("MAX_WORK", MAX_WORK),
        ("MULTIPLIER_LIMIT", MULTIPLIER_LIMIT as u64),
        ("SHIFT_LIMIT", SHIFT_LIMIT as u64),
        ("PANEL", PANEL as u64),
        ("CODE_TABLE_LEN", CODE_TABLE_LEN as u64),
        ("EXP_COARSE", EXP_COARSE as u64),
        ("EXP_FINE", EXP_FINE as u64),
    ]
    .into();
    let page = page();
    let rows = table(section(&page, "1.1 Constants"));
    let found: BTreeMap<&str, u64> = rows.iter().map(|row| (row[0].as_str(), number(&row[1]))).collect();
    assert_eq!(found, code);
    assert!(page.contains(&format!("Version {}. A stream", file::VERSION)));
}

#[test]
fn every_word_of_the_header_is_described_and_numbered_as_the_code_does() {
    let rows = numbered("1.3 Header");
    let numbers: Vec<u64> = rows.iter().map(|(word, _)| *word).collect();
    assert_eq!(numbers, (0..HEADER_BYTES as u64 / 4).collect::<Vec<_>>());
    let source = read("core/src/nn/file/layout.rs");
    let (_, words) = source.split_once("pub mod word {").unwrap();
    let (words, _) = words.split_once("\n}").unwrap();
    let code: BTreeSet<(u64, String)> = words
        .lines()
        .filter_map(|line| line.trim().strip_prefix("pub const ")?.split_once(": usize = "))
        .map(|(name, value)| (number(value.trim_end_matches(';')), name.to_string()))
        .collect();
    assert!(code.len() > 20, "{code:?}");
    let named = |name: &String| name != "magic" && name != "spare" && !name.ends_with("+ 1");
    let found: BTreeSet<(u64, String)> = rows.into_iter().filter(|(_, name)| named(name)).collect();
    assert_eq!(found, code);
}

/// Compares a table of fields with a record in which every field has a different value; words without a row must be 0.
fn compare_record(heading: &str, record: &[u8], last: &str, fields: &[(&str, u32)]) {
    let mut rows = numbered(heading);
    if last == "kind" {
        rows.push((0, "kind".into()));
    }
    let values: BTreeMap<&str, u32> = fields.iter().copied().collect();
    assert_eq!(values.len(), rows.len(), "{heading}: {rows:?}");
    let mut left: BTreeMap<u64, u32> = (0..).zip(record.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b))).collect();
    let seal = (record.len() / 4 - 1) as u64;
    for (word, name) in rows {
        let expected = *values.get(name.as_str()).unwrap_or_else(|| panic!("{heading}: no field {name} in the code"));
        assert_eq!(left.remove(&word), Some(expected), "{heading}: word {word}, {name}");
    }
    left.retain(|word, value| *word != seal && *value != 0);
    assert!(left.is_empty(), "{heading}: words that the page does not name: {left:?}");
}

#[test]
fn tensor_records_are_as_described() {
    let t = Tensor {
        dtype: Dtype::I16,
        rows: 101,
        cols: 102,
        channels: 103,
        offset: 104,
        zero: 105,
        lo: -106,
        hi: 107,
        scale: 1.5,
        ring: 109,
        margin: 10,
        edge: Edge::Nearest,
        pitch: 112,
        sums: 113,
    };
    let record = t.encode();
    let seal = u32::from_le_bytes(*record.last_chunk().unwrap());
    let fields = [
        ("dtype", t.dtype.code()),
        ("rows", 101),
        ("cols", 102),
        ("channels", 103),
        ("offset", 104),
        ("zero", 105),
        ("lo", -106i32 as u32),
        ("hi", 107),
        ("scale", 1.5f32.to_bits()),
        ("ring", 109),
        ("margin", 10),
        ("edge", 1),
        ("pitch", 112),
        ("sums", 113),
        ("seal", seal),
    ];
    compare_record("1.5 Tensor", &record, "", &fields);
}

#[test]
fn convolution_records_are_as_described() {
    let conv = Conv {
        out: 201,
        first: 202,
        second: Some(203),
        kernel_rows: 204,
        kernel_cols: 205,
        stride: 206,
        pad: 207,
        fold: true,
        weights: 209,
        bias: 210,
        multipliers: 211,
        shift: 212,
        add: Some(213),
        add_multipliers: 214,
        add_shift: 215,
        table: Some(216),
        table_zero: -217,
        relu: true,
        stride_cols: 219,
        block: 220,
    };
    let fields = [
        ("kind", 1),
        ("out", 201),
        ("first", 202),
        ("second", 203),
        ("kernel_rows", 204),
        ("kernel_cols", 205),
        ("stride", 206),
        ("pad", 207),
        ("fold", 1),
        ("weights", 209),
        ("bias", 210),
        ("multipliers", 211),
        ("shift", 212),
        ("add", 213),
        ("add_multipliers", 214),
        ("add_shift", 215),
        ("table", 216),
        ("table_zero", -217i32 as u32),
        ("relu", 1),
        ("stride_cols", 219),
        ("block", 220),
    ];
    compare_record("1.7 Convolution: kind 1", &Operator::Conv(conv).encode(), "kind", &fields);
    // "None" has the number of the page.
    let none = Operator::Conv(Conv { second: None, add: None, table: None, ..conv }).encode();
    for word in [3, 13, 16] {
        assert_eq!(file::u32_at(&none, 4 * word), file::NONE, "word {word}");
    }
}

#[test]
fn other_operator_records_are_as_described() {
    // The page gives the long number by its first word. The second is checked here and left out of the comparison.
    let norm =
        LayerNorm { out: 301, input: 302, merge: 303, gains: 304, biases: 305, shift: 306, epsilon: 307 << 32 | 308 };
    let mut record = Operator::LayerNorm(norm).encode();
    assert_eq!(file::u32_at(&record, 36), 307);
    record[36..40].fill(0);
    let fields = [
        ("kind", 2),
        ("out", 301),
        ("input", 302),
        ("merge", 303),
        ("gains", 304),
        ("biases", 305),
        ("shift", 306),
        ("epsilon", 308),
    ];
    compare_record("1.8 Layer norm: kind 2, attention: kind 3", &record, "kind", &fields);

    let attention = Attention {
        out: 401,
        input: 402,
        heads: 403,
        window: 404,
        shift_rows: 405,
        shift_cols: 406,
        pad_codes: 407,
        logit_multipliers: 408,
        logit_shift: 409,
        position_bias: 410,
        exp_table: 411,
        multipliers: 412,
        shift: 413,
    };
    let fields = [
        ("kind", 3),
        ("out", 401),
        ("input", 402),
        ("heads", 403),
        ("window", 404),
        ("shift_rows", 405),
        ("shift_cols", 406),
        ("pad_codes", 407),
        ("logit_multipliers", 408),
        ("logit_shift", 409),
        ("position_bias", 410),
        ("exp_table", 411),
        ("multipliers", 412),
        ("shift", 413),
    ];
    compare_record("Attention", &Operator::Attention(attention).encode(), "kind", &fields);
    let upsample = Operator::Upsample2(Upsample2 { out: 501, input: 502 }).encode();
    compare_record("1.9 Upsampling: kind 4", &upsample, "kind", &[("kind", 4), ("out", 501), ("input", 502)]);

    let entry = Entry { operator: 601, first: 602, count: 603 }.encode();
    let halves: Vec<u16> = entry.as_chunks().0.iter().map(|b| u16::from_le_bytes(*b)).collect();
    let names: Vec<String> = numbered("1.10 Schedule").into_iter().map(|(_, name)| name).collect();
    assert_eq!(names, ["operator", "first", "count", "seal"]);
    assert_eq!((&halves[..3], halves[3]), (&[601, 602, 603][..], entry_seal([601, 602, 603])));
}
