//! Inputs of commands: what all of them refuse and convert.

#[cfg(test)]
mod tests {
    use crate::cli::{Cli, run};
    use clap::Parser;
    use elunar_core::sun::Body;
    use elunar_raster::geotiff::{SampleType, WriteOptions, read, write};
    use elunar_raster::{Crs, GeoRef, Raster};

    /// Runs `elunar` in a folder: `@` stands for it. Returns the error.
    fn refused(folder: &std::path::Path, line: &str) -> Option<String> {
        let words = line.split(' ').map(|word| word.replace('@', &format!("{}/", folder.display())));
        let cli = Cli::try_parse_from(["elunar".to_string()].into_iter().chain(words)).unwrap();
        run(cli.command).err().map(|error| error.to_string())
    }

    /// A DTM of 40 x 40 pixels of 2 m.
    fn ridges() -> Raster {
        let georef = GeoRef {
            transform: [0.0, 2.0, 0.0, 0.0, 0.0, -2.0],
            crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0),
        };
        let height = |i: usize| ((i % 40) as f32 * 0.3).sin() * 9.0 + (i / 40) as f32;
        Raster { rows: 40, cols: 40, samples: (0..1600).map(height).collect(), georef: Some(georef) }
    }

    #[test]
    fn every_command_refuses_heights_in_an_unknown_unit() {
        let folder = tempfile::tempdir().unwrap();
        let (folder, raster) = (folder.path(), ridges());
        for (name, unit) in [("m.tif", "m"), ("deg.tif", "degree")] {
            let mut options = WriteOptions::heights("heights");
            options.unit = Some(unit.into());
            write(&folder.join(name), &raster, &options).unwrap();
        }
        let image = Raster { samples: raster.samples.iter().map(|z| z + 50.0).collect(), ..raster };
        write(&folder.join("i.tif"), &image, &WriteOptions::image(SampleType::U8, "image")).unwrap();
        std::fs::write(folder.join("t.csv"), "lon,lat,height_m\n0.0005,-0.0005,1\n").unwrap();
        let model = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/nano.eld");
        for line in [
            "hillshade @deg.tif -o @o.png",
            "mosaic @m.tif @deg.tif -o @o.tif",
            "diff @deg.tif @m.tif",
            "diff @m.tif @deg.tif",
            "evaluate --dtm @deg.tif --truth @m.tif",
            "evaluate --dtm @m.tif --truth @deg.tif",
            "evaluate --dtm @m.tif --truth @m.tif --coarse @deg.tif",
            "lola --dtm @deg.tif --tracks @t.csv",
            "render @deg.tif -o @o.tif --sun-azimuth 300 --sun-elevation 30",
            "sfs --image @i.tif --coarse @deg.tif --sun-azimuth 300 --sun-elevation 30 -o @o.tif",
            &format!("predict --image @i.tif --coarse @deg.tif --model {model} -o @o.tif"),
        ] {
            let text = refused(folder, line).unwrap_or_else(|| panic!("{line}"));
            assert!(text.contains("deg.tif: heights in m, km") && text.contains("found \"degree\""), "{line}: {text}");
            assert!(!folder.join("o.tif").exists() && !folder.join("o.png").exists(), "{line}");
        }
    }

    #[test]
    fn feet_and_lows_of_a_dtm_do_not_reach_a_mosaic() {
        let folder = tempfile::tempdir().unwrap();
        let (folder, mut raster) = (folder.path(), ridges());
        (raster.samples[0], raster.samples[1]) = (-3.4e38, 1.701_41e38);
        let mut options = WriteOptions::heights("heights");
        options.unit = Some("ft".into());
        write(&folder.join("ft.tif"), &raster, &options).unwrap();
        assert_eq!(refused(folder, "mosaic @ft.tif -o @o.tif"), None);
        let mosaic = read(folder.join("o.tif")).unwrap();
        assert_eq!(mosaic.valid_count(), 1598);
        let differs = mosaic.samples.iter().zip(&raster.samples).filter(|(a, _)| a.is_finite());
        assert!(differs.map(|(a, b)| (a - b * 0.3048).abs()).fold(0.0, f32::max) < 1e-4);
    }
}
