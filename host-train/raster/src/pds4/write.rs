//! Writing: heights as an array of reals, and the label that describes them.
//!
//! The structure is that of GDAL's driver, which reads it. An archive replaces the logical identifier and what is `Unknown`.

use super::super::footprint::{bounds, footprint};
use super::super::geotiff::{NODATA, NODATA_TEXT};
use super::super::named_map::NamedMap;
use super::super::source::{Info, Source};
use super::super::sun::body_of;
use super::super::xml;
use super::super::{GeoRef, Projection};
use super::image_of;
use elunar_base::digest::sha256;
use elunar_base::output::Staged;
use elunar_base::{Error, Result};
use elunar_core::sun::{Body, UtcTime};
use elunar_core::tile::Window;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Rows that are read and written together: those of a GeoTIFF's block.
const BAND_ROWS: usize = 512;

/// What a label says besides samples and place.
#[derive(Debug, Clone, Copy)]
pub struct Product<'a> {
    /// The title.
    pub title: &'a str,
    /// What the heights are, and from what they were made.
    pub comment: &'a str,
    /// A text by which the maker knows the product again ([`note`], [`holds`]): one line without `;`.
    pub note: &'a str,
    /// When the image was taken, if that is known.
    pub time: Option<UtcTime>,
}

/// Returns the file of samples that belongs to a label to write.
#[must_use]
pub fn samples_path(label: &Path) -> PathBuf {
    label.with_extension("img")
}

/// Writes heights, metres above the sphere, as 32-bit reals into [`samples_path`], and the label. Samples that are NaN are stored as
/// [`NODATA`]. The label appears first, and states the samples' SHA-256.
///
/// # Errors
/// [`Error::Input`] if the raster has no place on the Moon or on Mars, is not north up, or its map has no name in PDS4's dictionary of
/// cartography; otherwise as [`Source::read`] and [`Staged`].
pub fn write(label: &Path, source: &dyn Source, product: &Product) -> Result<()> {
    let name = label.display().to_string();
    let info = source.info();
    let cartography = cartography(info.place(&name)?, info).map_err(|what| Error::input(format!("{name}: {what}")))?;
    let samples = samples_path(label);
    let mut staged = Staged::create(&samples)?;
    for row in (0..info.rows).step_by(BAND_ROWS) {
        let rows = BAND_ROWS.min(info.rows - row);
        let band = source.read(Window { row, col: 0, rows, cols: info.cols })?;
        let stored = |value: f32| if value.is_nan() { NODATA } else { value };
        let bytes: Vec<u8> = band.into_iter().flat_map(|value| stored(value).to_le_bytes()).collect();
        staged.file().write_all(&bytes).map_err(Error::io(&samples))?;
    }
    let sum = staged.sha256()?;
    let mut label_staged = Staged::create(label)?;
    let text = text(label, info, product, &cartography, &sum);
    label_staged.file().write_all(text.as_bytes()).map_err(Error::io(label))?;
    label_staged.publish()?;
    staged.publish()
}

/// Returns the note of a label that [`write`] wrote.
#[must_use]
pub fn note(label: &Path) -> Option<String> {
    stated(label).map(|(note, _)| note)
}

/// Returns whether a label has this note, and its samples the SHA-256 that it states.
#[must_use]
pub fn holds(label: &Path, note: &str) -> bool {
    let sum = stated(label).filter(|(found, _)| found == note).map(|(_, sum)| sum);
    let found = || image_of(label).and_then(|path| sha256(&path)).ok();
    sum.is_some_and(|sum| found() == Some(sum))
}

/// Returns note and SHA-256.
fn stated(label: &Path) -> Option<(String, String)> {
    let text = xml::text(label).ok()?;
    let tree = xml::tree(label, &text).ok()?;
    let file = xml::Element(tree.root_element()).inside("File")?;
    let (note, sum) = file.child("comment")?.text().rsplit_once("; SHA-256 ")?;
    Some((note.into(), sum.into()))
}

/// Returns the element of the map and the target's name and type.
fn cartography(georef: &GeoRef, info: &Info) -> std::result::Result<(String, [&'static str; 2]), String> {
    let target = match body_of(georef) {
        Some(Body::Moon) => ["Moon", "Satellite"],
        Some(Body::Mars) => ["Mars", "Planet"],
        None => return Err("a map of the Moon or of Mars expected for a PDS4 label".into()),
    };
    let projection = Projection::of(&georef.crs);
    let named = projection.and_then(|projection| projection.named().map(|map| (map, projection)));
    let (map, projection) = named.ok_or_else(|| {
        format!("a projection of PDS4's dictionary of cartography expected, found {}", georef.crs.summary())
    })?;
    let [x0, x_col, x_row, y0, y_col, y_row] = georef.transform;
    if x_row != 0.0 || y_col != 0.0 || x_col <= 0.0 || y_row >= 0.0 {
        return Err("a raster with north up expected for a PDS4 label, found a turned one".into());
    }
    let ring =
        footprint(georef, info.rows, info.cols).ok_or("an outline on the map expected, found points beside it")?;
    let [(west, east), (south, north)] = bounds(&ring);
    let turn = if west < -180.0 { 360.0 } else { 0.0 };
    let (left, top) = projection.in_metres((x0, y0));
    let (right, below) = projection.in_metres((x0 + x_col, y0 + y_row));
    let degree_m = projection.radius_m().to_radians();
    let mut out = Lines::new(3);
    out.open("cart:Cartography");
    out.reference("cartography_parameters_to_image_object");
    out.open("cart:Spatial_Domain").open("cart:Bounding_Coordinates");
    for (side, value) in [("west", west + turn), ("east", east + turn), ("north", north), ("south", south)] {
        out.of_unit(&format!("cart:{side}_bounding_coordinate"), "deg", value);
    }
    out.close("cart:Bounding_Coordinates").close("cart:Spatial_Domain");
    out.open("cart:Spatial_Reference_Information").open("cart:Horizontal_Coordinate_System_Definition");
    out.open("cart:Planar").open("cart:Map_Projection").item("cart:map_projection_name", &map.name);
    parameters(&map, &mut out);
    out.close("cart:Map_Projection").open("cart:Planar_Coordinate_Information");
    out.item("cart:planar_coordinate_encoding_method", "Coordinate Pair").open("cart:Coordinate_Representation");
    for (axis, side_m) in [("x", right - left), ("y", top - below)] {
        out.of_unit(&format!("cart:pixel_resolution_{axis}"), "m/pixel", side_m);
    }
    for (axis, side_m) in [("x", right - left), ("y", top - below)] {
        out.of_unit(&format!("cart:pixel_scale_{axis}"), "pixel/deg", degree_m / side_m);
    }
    out.close("cart:Coordinate_Representation").close("cart:Planar_Coordinate_Information");
    out.open("cart:Geo_Transformation");
    out.of_unit("cart:upperleft_corner_x", "m", left).of_unit("cart:upperleft_corner_y", "m", top);
    out.close("cart:Geo_Transformation").close("cart:Planar").open("cart:Geodetic_Model");
    out.item("cart:latitude_type", "Planetocentric").item("cart:spheroid_name", target[0]);
    for axis in ["a", "b", "c"] {
        out.of_unit(&format!("cart:{axis}_axis_radius"), "m", projection.radius_m());
    }
    out.item("cart:longitude_direction", "Positive East").close("cart:Geodetic_Model");
    out.close("cart:Horizontal_Coordinate_System_Definition").close("cart:Spatial_Reference_Information");
    out.close("cart:Cartography");
    Ok((out.text, target))
}

/// Writes the parameters of a map, in the order of the dictionary.
fn parameters(map: &NamedMap, out: &mut Lines) {
    let element = format!("cart:{}", map.name.replace(' ', "_"));
    let is = |name: &str| map.name == name;
    out.open(&element);
    if is("Transverse Mercator") {
        out.item("cart:scale_factor_at_central_meridian", &map.scale.to_string());
    }
    if is("Equirectangular") {
        out.of_unit("cart:latitude_of_projection_origin", "deg", map.origin_deg);
        out.of_unit("cart:standard_parallel_1", "deg", map.lat_deg);
    }
    for (number, parallel_deg) in map.parallels_deg.into_iter().flatten().enumerate() {
        out.of_unit(&format!("cart:standard_parallel_{}", number + 1), "deg", parallel_deg);
    }
    out.of_unit("cart:longitude_of_central_meridian", "deg", map.lon_deg);
    if !is("Equirectangular") {
        out.of_unit("cart:latitude_of_projection_origin", "deg", map.origin_deg);
    }
    if is("Polar Stereographic") || is("Mercator") {
        out.item("cart:scale_factor_at_projection_origin", &map.scale.to_string());
    }
    out.close(&element);
}

/// Returns the label.
fn text(
    label: &Path,
    info: &Info,
    product: &Product,
    (cartography, [target, kind]): &(String, [&str; 2]),
    sum: &str,
) -> String {
    let stem = label.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
    let plain = |c: char| if c.is_ascii_alphanumeric() || "-._".contains(c) { c } else { '_' };
    let id: String = stem.chars().map(plain).collect();
    let file = samples_path(label).file_name().unwrap_or_default().to_string_lossy().into_owned();
    let mut out = Lines { text: HEAD.into(), depth: 1 };
    out.open("Identification_Area").item("logical_identifier", &format!("urn:nasa:pds:elunardtm:data:{id}"));
    out.item("version_id", "1.0").item("title", product.title).item("information_model_version", "1.16.0.0");
    out.item("product_class", super::PRODUCT).close("Identification_Area");
    out.open("Observation_Area").item("comment", product.comment).open("Time_Coordinates");
    for name in ["start_date_time", "stop_date_time"] {
        match product.time {
            Some(time) => out.item(name, &time.to_string()),
            None => out.line(&format!("<{name} xsi:nil=\"true\" nilReason=\"unknown\" />")),
        };
    }
    out.close("Time_Coordinates").open("Primary_Result_Summary").item("purpose", "Science");
    out.item("processing_level", "Derived").close("Primary_Result_Summary");
    out.open("Investigation_Area").item("name", "Unknown").item("type", "Mission").close("Investigation_Area");
    out.open("Observing_System").open("Observing_System_Component").item("name", "Unknown").item("type", "Spacecraft");
    out.close("Observing_System_Component").close("Observing_System").open("Target_Identification");
    out.item("name", target).item("type", kind).open("Internal_Reference");
    let context = format!("urn:nasa:pds:context:target:{kind}.{target}").to_lowercase();
    out.item("lid_reference", &context).item("reference_type", "data_to_target").close("Internal_Reference");
    out.close("Target_Identification").open("Discipline_Area").open("disp:Display_Settings");
    out.reference("display_settings_to_array").open("disp:Display_Direction");
    out.item("disp:horizontal_display_axis", "Sample").item("disp:horizontal_display_direction", "Left to Right");
    out.item("disp:vertical_display_axis", "Line").item("disp:vertical_display_direction", "Top to Bottom");
    out.close("disp:Display_Direction").close("disp:Display_Settings");
    out.text += cartography;
    out.close("Discipline_Area").close("Observation_Area").open("File_Area_Observational").open("File");
    let bytes = info.rows as u64 * info.cols as u64 * size_of::<f32>() as u64;
    out.item("file_name", &file).of_unit("file_size", "byte", bytes);
    out.item("comment", &format!("{}; SHA-256 {sum}", product.note)).close("File");
    out.open("Array_2D_Image").item("local_identifier", IMAGE).of_unit("offset", "byte", 0).item("axes", "2");
    out.item("axis_index_order", "Last Index Fastest").open("Element_Array").item("data_type", "IEEE754LSBSingle");
    out.item("unit", "m").close("Element_Array");
    for (number, (axis, elements)) in [("Line", info.rows), ("Sample", info.cols)].into_iter().enumerate() {
        out.open("Axis_Array").item("axis_name", axis).item("elements", &elements.to_string());
        out.item("sequence_number", &(number + 1).to_string()).close("Axis_Array");
    }
    out.open("Special_Constants").item("missing_constant", NODATA_TEXT).close("Special_Constants");
    out.close("Array_2D_Image").close("File_Area_Observational");
    out.depth = 0;
    out.close(super::PRODUCT);
    out.text
}

/// Local name of the array.
const IMAGE: &str = "image";

/// Schemas, of the editions that GDAL 3.6 names.
const HEAD: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<?xml-model href="https://pds.nasa.gov/pds4/pds/v1/PDS4_PDS_1G00.sch" schematypens="http://purl.oclc.org/dsdl/schematron"?>
<?xml-model href="https://pds.nasa.gov/pds4/disp/v1/PDS4_DISP_1G00_1500.sch" schematypens="http://purl.oclc.org/dsdl/schematron"?>
<?xml-model href="https://pds.nasa.gov/pds4/cart/v1/PDS4_CART_1G00_1950.sch" schematypens="http://purl.oclc.org/dsdl/schematron"?>
<Product_Observational xmlns="http://pds.nasa.gov/pds4/pds/v1" xmlns:disp="http://pds.nasa.gov/pds4/disp/v1" xmlns:cart="http://pds.nasa.gov/pds4/cart/v1" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:schemaLocation="
    http://pds.nasa.gov/pds4/pds/v1 https://pds.nasa.gov/pds4/pds/v1/PDS4_PDS_1G00.xsd
    http://pds.nasa.gov/pds4/disp/v1 https://pds.nasa.gov/pds4/disp/v1/PDS4_DISP_1G00_1500.xsd
    http://pds.nasa.gov/pds4/cart/v1 https://pds.nasa.gov/pds4/cart/v1/PDS4_CART_1G00_1950.xsd">
"#;

/// Elements, one a line, indented.
struct Lines {
    text: String,
    depth: usize,
}

impl Lines {
    fn new(depth: usize) -> Self {
        Self { text: String::new(), depth }
    }

    fn line(&mut self, line: &str) -> &mut Self {
        let _ = writeln!(self.text, "{:1$}{line}", "", 2 * self.depth);
        self
    }

    fn open(&mut self, name: &str) -> &mut Self {
        self.line(&format!("<{name}>")).depth += 1;
        self
    }

    fn close(&mut self, name: &str) -> &mut Self {
        self.depth = self.depth.saturating_sub(1);
        self.line(&format!("</{name}>"))
    }

    fn item(&mut self, name: &str, text: &str) -> &mut Self {
        let text = text.replace(char::is_control, " ").replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
        self.line(&format!("<{name}>{text}</{name}>"))
    }

    fn of_unit(&mut self, name: &str, unit: &str, value: impl std::fmt::Display) -> &mut Self {
        self.line(&format!("<{name} unit=\"{unit}\">{value}</{name}>"))
    }

    /// Writes a reference to the array.
    fn reference(&mut self, kind: &str) -> &mut Self {
        self.open("Local_Internal_Reference").item("local_identifier_reference", IMAGE);
        self.item("local_reference_type", kind).close("Local_Internal_Reference")
    }
}
