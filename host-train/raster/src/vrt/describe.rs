//! What a VRT says. Elements that would change a pixel and are not read here are refused.

use super::super::pds3::{Defect, Refusal};
use super::super::sun::StatedSun;
use super::super::{Crs, GeoRef, GeoTransform};
use super::pieces::Piece;
use super::{Conversion, Element, Info, Sample, Window, nodata, unit};
use elunar_base::{Error, Result, folder_of};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Most pieces of a VRT (our choice).
const MOST_PIECES: usize = 100_000;

/// What users may do about a VRT that is not read.
pub(super) const CONVERT: &str = "convert it first: gdal_translate -of GTiff FILE.vrt FILE.tif";

/// Elements that are read, or that change no pixel: of the data set, of its band, of a source.
const DATASET: [&str; 6] = ["SRS", "GeoTransform", "Metadata", "VRTRasterBand", "OverviewList", "BlockXSize"];
const BAND: [&str; 11] = [
    "NoDataValue",
    "ColorInterp",
    "Description",
    "Metadata",
    "Histograms",
    "Scale",
    "Offset",
    "UnitType",
    "SimpleSource",
    "ComplexSource",
    "Overview",
];
const SOURCE: [&str; 6] = ["SourceFilename", "SourceBand", "SourceProperties", "SrcRect", "DstRect", "NODATA"];

/// The types of numbers.
const TYPES: [(&str, Sample); 8] = [
    ("Byte", Sample::U8),
    ("Int8", Sample::I8),
    ("UInt16", Sample::U16),
    ("Int16", Sample::I16),
    ("UInt32", Sample::U32),
    ("Int32", Sample::I32),
    ("Float32", Sample::F32),
    ("Float64", Sample::F64),
];

/// A file of a VRT.
struct Named {
    name: String,
    /// Whether the name counts from the VRT's folder.
    is_relative: bool,
    /// Rows and columns that its pieces need.
    least: (usize, usize),
}

/// Pieces of files side by side.
pub(super) struct Mosaic {
    pub(super) rows: usize,
    pub(super) cols: usize,
    pub(super) georef: Option<GeoRef>,
    pub(super) sample: Sample,
    pub(super) nodata: Option<f64>,
    scale: f64,
    offset: f64,
    pub(super) unit: Option<String>,
    pub(super) sun: StatedSun,
    names: Vec<Named>,
    numbers: HashMap<String, usize>,
    /// Later ones lie above earlier ones.
    pub(super) pieces: Vec<Piece>,
}

impl Mosaic {
    /// Returns the paths of the files of the VRT at `path`.
    pub(super) fn files(&self, path: &Path) -> Vec<PathBuf> {
        let of = |file: &Named| match file.is_relative && !file.name.contains("://") {
            true => folder_of(path).join(&file.name),
            false => file.name.clone().into(),
        };
        self.names.iter().map(of).collect()
    }

    /// Returns the conversion of stored numbers in this unit.
    pub(super) fn conversion(&self, unit_in_file: Option<&str>) -> Conversion {
        let radius_m = self.georef.as_ref().and_then(|georef| georef.crs.sphere_radius_m());
        unit::conversion(unit_in_file, self.scale, self.offset, radius_m)
    }

    /// Refuses a file that is smaller than its pieces, or has other numbers than the VRT. Numbers of any type are floats.
    pub(super) fn check(&self, path: &Path, file: &Path, index: usize, info: &Info) -> Result<()> {
        let (rows, cols) = self.names[index].least;
        if rows > info.rows || cols > info.cols {
            let what = format!("{} of {rows} x {cols} pixels at least (SrcRect) expected", file.display());
            return Err(Error::broken(path, format!("{what}, found {} x {}", info.rows, info.cols)));
        }
        let wanted = self.sample.name();
        let is_float = matches!(self.sample, Sample::F32 | Sample::F64);
        if is_float || info.format.split([' ', ',']).any(|word| word == wanted) {
            return Ok(());
        }
        let what = format!("{} of {wanted} samples expected, found {}; {CONVERT}", file.display(), info.format);
        Err(Error::unsupported(path, what))
    }
}

/// Reads a VRT.
pub(super) fn describe(vrt: Element) -> std::result::Result<Mosaic, Refusal> {
    if vrt.name() != "VRTDataset" {
        return Err(Defect::missing(format!("VRTDataset as outermost element expected, found {}", vrt.name())).into());
    }
    refuse_others(vrt, &DATASET)?;
    let size = |name: &str| -> std::result::Result<usize, Defect> {
        let found: u64 = vrt.number_of(name)?;
        let size = usize::try_from(found).ok().filter(|&size| size > 0 && i64::try_from(size).is_ok());
        size.ok_or_else(|| Defect::at(vrt.line(), format!("{name} from 1 to 2^63 expected, found {found}")))
    };
    let (rows, cols) = (size("rasterYSize")?, size("rasterXSize")?);
    let bands: Vec<Element> = vrt.children().filter(|child| child.name() == "VRTRasterBand").collect();
    let [band] = bands[..] else {
        let what =
            format!("{} bands found, one expected; take one out: gdal_translate -b 1 FILE.vrt FILE.tif", bands.len());
        return Err(Refusal::Unsupported(what));
    };
    refuse_others(band, &BAND)?;
    let data_type = band.attribute("dataType").unwrap_or("Byte");
    let Some(&(_, sample)) = TYPES.iter().find(|(name, _)| *name == data_type) else {
        let read = TYPES.map(|(name, _)| name).join(", ");
        let what = format!("line {}: dataType {data_type}; {read} are read", band.line());
        return Err(Refusal::Unsupported(what));
    };
    let number = |name: &str, default: f64| band.child(name).map_or(Ok(default), Element::number);
    let (scale, offset) = (number("Scale", 1.0)?, number("Offset", 0.0)?);
    if scale == 0.0 {
        return Err(Defect::at(band.line(), "a Scale other than 0 expected, found 0").into());
    }
    let unit = band.child("UnitType").map(|unit| unit.text().to_owned()).filter(|unit| !unit.is_empty());
    let (nodata, georef, sun) = (band.child("NoDataValue").map(value).transpose()?, georef(vrt)?, sun(vrt));
    let mut mosaic = Mosaic {
        rows,
        cols,
        georef,
        sample,
        nodata,
        scale,
        offset,
        unit,
        sun,
        names: vec![],
        numbers: HashMap::new(),
        pieces: vec![],
    };
    for source in band.children().filter(|child| child.name().ends_with("Source")) {
        if mosaic.pieces.len() == MOST_PIECES {
            return Err(Refusal::Unsupported(format!("at most {MOST_PIECES} sources expected, found more")));
        }
        mosaic.add(source)?;
    }
    Ok(mosaic)
}

/// Refuses elements that are not read, and classes of VRTs that compute.
fn refuse_others(element: Element, known: &[&str]) -> std::result::Result<(), Refusal> {
    let refuse =
        |line: usize, what: &str| Err(Refusal::Unsupported(format!("line {line}: {what} is not read; {CONVERT}")));
    if let Some(class) = element.attribute("subClass") {
        return refuse(element.line(), class);
    }
    match element.children().find(|child| !known.contains(&child.name())) {
        Some(other) => refuse(other.line(), &format!("{} in {}", other.name(), element.name())),
        None => Ok(()),
    }
}

/// Returns a NODATA value, which may be NaN.
fn value(element: Element) -> std::result::Result<f64, Defect> {
    nodata::number(element.text()).ok_or_else(|| {
        Defect::at(element.line(), format!("a number as {} expected, found {:?}", element.name(), element.text()))
    })
}

fn georef(vrt: Element) -> std::result::Result<Option<GeoRef>, Refusal> {
    let Some(item) = vrt.child("GeoTransform") else { return Ok(None) };
    let numbers: Vec<f64> = item.text().split(',').filter_map(|number| number.trim().parse().ok()).collect();
    let Ok(transform) = GeoTransform::try_from(numbers) else {
        return Err(Defect::at(item.line(), "six numbers as GeoTransform expected, found others").into());
    };
    let t = transform;
    if !t.iter().all(|v| v.is_finite()) || t[1] * t[5] == t[2] * t[4] {
        return Err(Defect::at(item.line(), format!("a GeoTransform with an inverse expected, found {t:?}")).into());
    }
    let srs = vrt.child("SRS").filter(|srs| !srs.text().is_empty());
    let crs = srs.map(|srs| {
        let read = Crs::parse(srs.text());
        read.map_err(|error| Refusal::Unsupported(format!("line {}: SRS: {error}", srs.line())))
    });
    let crs = crs.transpose()?.unwrap_or_default();
    match crs.defect() {
        Some(defect) => Err(Defect::at(item.line(), defect).into()),
        None => Ok(Some(GeoRef { transform, crs })),
    }
}

/// Reads the Sun from the items that this program writes into its GeoTIFFs.
fn sun(vrt: Element) -> StatedSun {
    let all = vrt.children().filter(|child| child.name() == "Metadata" && child.attribute("domain").is_none());
    let mut sun = StatedSun::default();
    all.flat_map(Element::children).for_each(|item| sun.add(item.attribute("key").unwrap_or(""), item.text()));
    sun
}

impl Mosaic {
    fn add(&mut self, source: Element) -> std::result::Result<(), Refusal> {
        refuse_others(source, &SOURCE)?;
        let file = source.required("SourceFilename")?;
        let band = source.child("SourceBand").map_or("1", Element::text);
        if band != "1" {
            return Err(Refusal::Unsupported(format!(
                "line {}: SourceBand {band}; 1 expected; {CONVERT}",
                source.line()
            )));
        }
        let [src, dst] = ["SrcRect", "DstRect"].map(|name| source.required(name).and_then(rectangle));
        let (src, dst) = (src?, dst?);
        if (src.rows, src.cols) != (dst.rows, dst.cols) {
            let what = format!(
                "SrcRect of {} x {} as DstRect expected, found {} x {}",
                dst.rows, dst.cols, src.rows, src.cols
            );
            return Err(Refusal::Unsupported(format!("line {}: {what}; {CONVERT}", source.line())));
        }
        let (Ok(row), Ok(col)) = (usize::try_from(src.row), usize::try_from(src.col)) else {
            return Err(Defect::at(source.line(), format!("SrcRect within its file expected, found {src:?}")).into());
        };
        let clear = source.child("NODATA").filter(|_| source.name() == "ComplexSource").map(value).transpose()?;
        let (Some(end_row), Some(end_col)) = (row.checked_add(src.rows), col.checked_add(src.cols)) else {
            return Err(Defect::at(source.line(), format!("SrcRect within its file expected, found {src:?}")).into());
        };
        let file = self.number_of(file);
        let least = &mut self.names[file].least;
        *least = (least.0.max(end_row), least.1.max(end_col));
        let from = Window { row, col, rows: src.rows, cols: src.cols };
        self.pieces.push(Piece { file, from, to: (dst.row, dst.col), clear });
        Ok(())
    }

    /// Returns the number of a file.
    fn number_of(&mut self, file: Element) -> usize {
        let is_relative = file.attribute("relativeToVRT") == Some("1");
        *self.numbers.entry(file.text().to_owned()).or_insert_with(|| {
            self.names.push(Named { name: file.text().to_owned(), is_relative, least: (0, 0) });
            self.names.len() - 1
        })
    }
}

/// A rectangle in pixels.
#[derive(Debug)]
struct Rectangle {
    row: i64,
    col: i64,
    rows: usize,
    cols: usize,
}

/// Reads a rectangle of whole pixels.
fn rectangle(element: Element) -> std::result::Result<Rectangle, Defect> {
    let whole = |name: &str| -> std::result::Result<i64, Defect> {
        let found: f64 = element.number_of(name)?;
        if found.fract() == 0.0 && found.abs() < 2_f64.powi(53) {
            return Ok(found as i64);
        }
        Err(Defect::at(element.line(), format!("whole pixels as {name} expected, found {found}; {CONVERT}")))
    };
    let size = |name: &str| -> std::result::Result<usize, Defect> {
        let found = whole(name)?;
        let size = usize::try_from(found).ok().filter(|&size| size > 0);
        size.ok_or_else(|| Defect::at(element.line(), format!("at least 1 as {name} expected, found {found}")))
    };
    Ok(Rectangle { row: whole("yOff")?, col: whole("xOff")?, rows: size("ySize")?, cols: size("xSize")? })
}
