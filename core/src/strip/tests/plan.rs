//! Requirements of a strip.

use super::rig::{TILE, file, settings};
use crate::nn::Model;
use crate::pixels::{PixelForm, PixelFormat};
use crate::strip::{PostGrid, StripError, StripPlan, StripSettings};
use crate::tile::TilingError;

#[test]
fn memory_grows_by_what_a_line_and_a_column_hold() {
    let file = file();
    let model = Model::new(&file).unwrap();
    let plan = |cols, ring| StripPlan::new(&model, settings(cols, ring)).unwrap();
    assert_eq!(StripPlan::least_lines(&model), TILE.rows + 1);
    let (least, longer, wider) = (plan(100, 13), plan(100, 14), plan(101, 13));
    assert_eq!(longer.bytes() - least.bytes(), 2 * (4 * 100 + 4), "image and coarse heights of a line, with checksums");
    // In addition to the lines, means of a tile's rows.
    assert_eq!(wider.bytes() - least.bytes(), 2 * 4 * 13 + 5 * TILE.rows);
    // Of a line of 16 bits two bytes a pixel, and nothing but posts of the coarse DTM.
    let posts = Some(PostGrid::spaced(6, (0.0, 0.0), (20.0, 20.0)));
    let pixels = PixelForm { format: PixelFormat::U16Le, ..PixelForm::F32 };
    let lean = |ring| StripPlan::new(&model, StripSettings { pixels, posts, ..settings(100, ring) }).unwrap();
    assert_eq!(lean(33).bytes() - lean(13).bytes(), 20 * (2 * 100 + 4) + (6 + 4) * 4 + 4, "and one more row of posts");
    let parts = [least.arena_bytes(), 4 * least.samples_len(), 8 * least.sums_len(), least.bytes_len()];
    assert_eq!(least.bytes(), parts.iter().sum());
}

#[test]
fn settings_that_cannot_be_are_refused() {
    let file = file();
    let model = Model::new(&file).unwrap();
    let good = settings(25, 20);
    let refused = |settings| StripPlan::new(&model, settings).unwrap_err();
    assert_eq!(refused(StripSettings { cols: 0, ..good }), StripError::Columns { found: 0 });
    for (cols, ring_lines) in [(usize::MAX, 20), (usize::MAX / 40, 20), (25, usize::MAX), (usize::MAX >> 7, 13)] {
        let settings = StripSettings { cols, ring_lines, ..good };
        assert_eq!(refused(settings), StripError::Columns { found: cols });
    }
    let overlap = TilingError::Overlap { overlap_px: 10, tile: TILE };
    assert_eq!(refused(StripSettings { overlap_px: 10, ..good }), StripError::Tile(overlap));
    assert_eq!(refused(StripSettings { ring_lines: 12, ..good }), StripError::Ring { expected: 13, found: 12 });
    for bad in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        assert_eq!(refused(StripSettings { pixel_m: bad, ..good }), StripError::Pixel);
        assert_eq!(refused(StripSettings { coarse_px: bad, ..good }), StripError::Pixel);
    }
    let pixels = PixelForm { gain: f32::NAN, ..PixelForm::F32 };
    assert_eq!(refused(StripSettings { pixels, ..good }), StripError::Pixel);
    let posts = Some(PostGrid::spaced(0, (0.0, 0.0), (4.0, 4.0)));
    assert_eq!(refused(StripSettings { posts, ..good }), StripError::Posts);
    let dense = Some(PostGrid::spaced(9, (0.0, 0.0), (1e-18, 4.0)));
    assert_eq!(refused(StripSettings { posts: dense, ..good }), StripError::Columns { found: 25 });
    assert_eq!(StripPlan::new(&model, good).unwrap().settings(), good);
    for settings in [good, StripSettings { posts: dense, anchor: false, ..good }] {
        assert_eq!(StripSettings::from_words(settings.to_words()), Some(settings));
    }
}

#[test]
fn a_light_is_decided_for_a_model_that_wants_one() {
    use crate::nn::file::{seal_file, word};
    use crate::nn::{Illumination, KnownSun, LightSource, Lighting};
    use crate::norm::LightFit;
    let mut file = file();
    file[4 * word::ILLUMINATION..][..4].copy_from_slice(&1u32.to_le_bytes());
    seal_file(&mut file);
    let model = Model::new(&file).unwrap();
    // The light was not decided.
    assert_eq!(StripPlan::new(&model, settings(25, 20)), Err(StripError::Light));
    let with = |azimuth_deg, source| {
        let sun = KnownSun { azimuth_deg, elevation_deg: None };
        let light = Lighting::decide(Illumination::Northwest, sun, &LightFit::default());
        assert_eq!(light.source, source);
        StripPlan::new(&model, StripSettings { light, ..settings(25, 20) }).unwrap()
    };
    with(Some(120.0), LightSource::Given);
    // Without a known Sun one is assumed, and the plan says so.
    assert_eq!(with(None, LightSource::Assumed).settings().light.source, LightSource::Assumed);
}
