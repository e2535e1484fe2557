//! GDAL's side file of a raster, `NAME.aux.xml`. What it states is not applied here: one warning names it.

use super::source::{Info, Source};
use elunar_base::{Result, read};
use elunar_core::tile::Window;
use std::path::{Path, PathBuf};

/// Elements that change how GDAL reads a raster, and what they state. Others are statistics and pictures.
const MEANT: [(&str, &str); 6] = [
    ("<NoDataValue", "a nodata value"),
    ("<UnitType", "a unit"),
    ("<Scale>", "a scale"),
    ("<Offset>", "an offset"),
    ("<SRS", "a reference system"),
    ("<GeoTransform", "a geotransform"),
];

/// Adds the warning about the side file of `path`, if one states something that is not read, to those of its raster.
pub(crate) fn told(path: &Path, source: Box<dyn Source>) -> Box<dyn Source> {
    let Some(warning) = warning(path) else { return source };
    let mut info = source.info().clone();
    info.warnings.push(warning);
    Box::new(Told { info, source })
}

fn warning(path: &Path) -> Option<String> {
    let mut name = path.as_os_str().to_owned();
    name.push(".aux.xml");
    let side = PathBuf::from(name);
    if !side.is_file() {
        return None;
    }
    let text = read::bytes(&side, read::MOST_SETTINGS_BYTES).unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    let found: Vec<&str> = MEANT.iter().filter(|(mark, _)| text.contains(mark)).map(|(_, what)| *what).collect();
    let mend = format!("gdal_translate {} OUT.tif writes what GDAL reads into one file", path.display());
    (!found.is_empty()).then(|| format!("{} states {}, which is not read; {mend}", side.display(), found.join(", ")))
}

/// A raster with one more warning.
struct Told {
    info: Info,
    source: Box<dyn Source>,
}

impl Source for Told {
    fn info(&self) -> &Info {
        &self.info
    }

    fn read(&self, window: Window) -> Result<Vec<f32>> {
        self.source.read(window)
    }
}

#[cfg(test)]
mod tests {
    use crate::geotiff::{WriteOptions, write};
    use crate::{Raster, heights};
    use elunar_testing::rasterio;

    #[test]
    fn a_side_file_is_named_where_it_says_more_than_statistics() {
        let folder = tempfile::tempdir().unwrap();
        let (path, side) = (folder.path().join("a.tif"), folder.path().join("a.tif.aux.xml"));
        let raster = Raster { rows: 1, cols: 2, samples: vec![1.0, -9999.0], georef: None };
        write(&path, &raster, &WriteOptions::heights("t")).unwrap();
        let warnings = || heights::open(&path).unwrap().info().warnings.clone();
        assert_eq!(warnings(), [""; 0]);
        let statistics = "<Metadata><MDI key=\"STATISTICS_MAXIMUM\">9</MDI></Metadata>";
        let band = |more: &str| {
            let text = format!("<PAMDataset><PAMRasterBand band=\"1\">{more}{statistics}</PAMRasterBand></PAMDataset>");
            std::fs::write(&side, text).unwrap();
        };
        band("");
        assert_eq!(warnings(), [""; 0]);
        band("<NoDataValue>-9.99900000000000000E+03</NoDataValue><UnitType>km</UnitType>");
        let (path, side) = (path.display(), side.display());
        let text = format!(
            "{side} states a nodata value, a unit, which is not read; gdal_translate {path} OUT.tif writes what GDAL reads into one file"
        );
        assert_eq!(warnings(), [text]);
    }

    #[test]
    fn all_that_gdal_reads_from_it_is_known() {
        let folder = tempfile::tempdir().unwrap();
        let script = "
with rasterio.open('a.tif', 'w', driver='GTiff', width=2, height=1, count=1, dtype='float32') as d:
    d.write(np.array([[[1, -9999]]], 'float32'))
open('a.tif.aux.xml', 'w').write('''<PAMDataset><SRS>+proj=longlat +R=1737400 +no_defs</SRS>
<GeoTransform>5, 1, 0, 6, 0, -1</GeoTransform><PAMRasterBand band=\"1\"><NoDataValue>-9999</NoDataValue>
<UnitType>km</UnitType><Offset>3</Offset><Scale>2</Scale></PAMRasterBand></PAMDataset>''')
with rasterio.open('a.tif') as d:
    print(d.nodata, d.units[0], d.scales[0], d.offsets[0], d.crs is not None, d.transform.c)
";
        let Some(read) = rasterio(script, folder.path()) else { return };
        assert_eq!(read.trim(), "-9999.0 km 2.0 3.0 True 5.0");
        let warnings = heights::open(&folder.path().join("a.tif")).unwrap().info().warnings.clone();
        assert!(warnings.len() == 1 && super::MEANT.iter().all(|(_, what)| warnings[0].contains(what)), "{warnings:?}");
    }
}
