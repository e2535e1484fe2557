//! The array of an image: where it is, its axes, its numbers.

use super::super::binary::{Layout, Sample};
use super::super::pds3::{Defect, Refusal};
use super::super::xml::Element;

/// Arrays that may be images.
const ARRAYS: [&str; 5] = ["Array_2D_Image", "Array_2D_Map", "Array_2D", "Array_3D_Image", "Array_3D"];

/// Constants that mean "no measurement" (PDS4 information model, `Special_Constants`). `valid_minimum` and `valid_maximum` are none.
const CONSTANTS: [&str; 10] = [
    "saturated_constant",
    "missing_constant",
    "error_constant",
    "invalid_constant",
    "unknown_constant",
    "not_applicable_constant",
    "high_instrument_saturation",
    "high_representation_saturation",
    "low_instrument_saturation",
    "low_representation_saturation",
];

/// The array that is read.
pub(super) struct Found<'a> {
    /// The file area that names its file.
    pub(super) area: Element<'a>,
    pub(super) array: Element<'a>,
    /// How many further arrays the label has.
    pub(super) others: usize,
}

/// Finds the first array that may be an image.
pub(super) fn find(product: Element<'_>) -> Result<Found<'_>, Refusal> {
    let areas = product.children().filter(|child| child.name() == "File_Area_Observational");
    let mut all = areas.flat_map(|area| area.children().map(move |array| (area, array)));
    let mut arrays = all.by_ref().filter(|(_, array)| ARRAYS.contains(&array.name()));
    let Some((area, array)) = arrays.next() else {
        let what = format!("{} in a File_Area_Observational expected, found none", ARRAYS.join(", "));
        return Err(Refusal::Unsupported(what));
    };
    Ok(Found { area, array, others: arrays.count() })
}

/// Reads offset, axes and numbers of an array.
pub(super) fn layout(array: Element) -> Result<Layout, Refusal> {
    if let Some(order) = array.child("axis_index_order").filter(|order| order.text() != "Last Index Fastest") {
        let what = format!("line {}: axis_index_order {}; Last Index Fastest expected", order.line(), order.text());
        return Err(Refusal::Unsupported(what));
    }
    let (rows, cols) = axes(array)?;
    let (sample, big_endian) = sample(array.required("Element_Array")?.required("data_type")?)?;
    let offset = array.required("offset")?;
    if let Some(unit) = offset.attribute("unit").filter(|unit| *unit != "byte") {
        return Err(Defect::at(offset.line(), format!("offset in byte expected, found {unit}")).into());
    }
    let Some(row_bytes) = (cols as u64).checked_mul(sample.bytes() as u64) else {
        return Err(
            Defect::at(array.line(), format!("rows of less than 2^64 bytes expected, found {cols} samples")).into()
        );
    };
    Ok(Layout { sample, big_endian, rows, cols, start: offset.count()?, row_bytes, tile: None })
}

/// Returns the sizes of the axes Line and Sample, in this order; of an axis Band, one band.
fn axes(array: Element) -> Result<(usize, usize), Refusal> {
    let mut axes = vec![];
    for axis in array.children().filter(|child| child.name() == "Axis_Array") {
        let elements = axis.required("elements")?;
        let size = usize::try_from(elements.count()?).ok().filter(|&size| size > 0);
        let size = size.ok_or_else(|| {
            Defect::at(elements.line(), format!("at least 1 as elements expected, found {}", elements.text()))
        })?;
        axes.push((axis.required("sequence_number")?.count()?, axis.required("axis_name")?.text(), size));
    }
    axes.sort_unstable();
    if axes.iter().zip(1..).any(|(axis, number)| axis.0 != number) {
        return Err(Defect::at(array.line(), "axes of sequence_number 1, 2, ... expected, found others").into());
    }
    let bands = axes.iter().find(|(_, name, _)| name.eq_ignore_ascii_case("Band")).map_or(1, |(.., size)| *size);
    if bands != 1 {
        let what = format!("{bands} bands found, one expected; take one out: gdal_translate -b 1 FILE.xml FILE.tif");
        return Err(Refusal::Unsupported(what));
    }
    axes.retain(|(_, name, _)| !name.eq_ignore_ascii_case("Band"));
    match axes[..] {
        [(_, line, rows), (_, sample, cols)]
            if line.eq_ignore_ascii_case("Line") && sample.eq_ignore_ascii_case("Sample") =>
        {
            Ok((rows, cols))
        }
        _ => {
            let names: Vec<&str> = axes.iter().map(|(_, name, _)| *name).collect();
            let what = format!("axes Line, Sample expected, found {:?}", names.join(", "));
            Err(Refusal::Unsupported(format!("line {}: {what}", array.line())))
        }
    }
}

/// Reads a type of numbers: `UnsignedByte`, `SignedLSB2`, `IEEE754MSBSingle`, and so on.
fn sample(item: Element) -> Result<(Sample, bool), Refusal> {
    let name = item.text();
    let big_endian = name.contains("MSB");
    let sample = match name.replace("MSB", "LSB").as_str() {
        "UnsignedByte" => Some(Sample::U8),
        "SignedByte" => Some(Sample::I8),
        "UnsignedLSB2" => Some(Sample::U16),
        "SignedLSB2" => Some(Sample::I16),
        "UnsignedLSB4" => Some(Sample::U32),
        "SignedLSB4" => Some(Sample::I32),
        "IEEE754LSBSingle" => Some(Sample::F32),
        "IEEE754LSBDouble" => Some(Sample::F64),
        _ => None,
    };
    let read = "integers of 1, 2 and 4 bytes, IEEE754LSBSingle and Double, and MSB, are read";
    let refuse = || Refusal::Unsupported(format!("line {}: data_type {name:?}; {read}", item.line()));
    sample.map(|sample| (sample, big_endian)).ok_or_else(refuse)
}

/// Returns the stored numbers that mean "no measurement". Those of reals may be bits: `0xFF7FFFFB`, `16#FF7FFFFB#`.
pub(super) fn missing(array: Element, sample: Sample) -> Result<Vec<f64>, Defect> {
    let Some(all) = array.child("Special_Constants") else { return Ok(vec![]) };
    let constants = all.children().filter(|one| CONSTANTS.contains(&one.name()) && !one.text().is_empty());
    constants.map(|one| of_bits(one.text(), sample).map_or_else(|| one.number(), Ok)).collect()
}

fn of_bits(text: &str, sample: Sample) -> Option<f64> {
    let digits = text.strip_prefix("0x").or_else(|| text.strip_prefix("0X"));
    let digits = digits.or_else(|| text.strip_prefix("16#")?.strip_suffix('#'))?;
    let bits = u64::from_str_radix(digits, 16).ok()?;
    match sample {
        Sample::F32 => Some(f64::from(f32::from_bits(u32::try_from(bits).ok()?))),
        Sample::F64 => Some(f64::from_bits(bits)),
        Sample::I8 => Some(f64::from(u8::try_from(bits).ok()?.cast_signed())),
        Sample::I16 => Some(f64::from(u16::try_from(bits).ok()?.cast_signed())),
        Sample::I32 => Some(f64::from(u32::try_from(bits).ok()?.cast_signed())),
        Sample::U8 | Sample::U16 | Sample::U32 => Some(bits as f64),
    }
}
