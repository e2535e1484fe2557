use super::*;
use elunar_core::terrain::PixelSize;

fn bowl(rows: usize, cols: usize) -> Vec<f32> {
    let height = |k: usize| ((k / cols) as f32 - 30.0).hypot((k % cols) as f32 - 40.0);
    (0..rows * cols).map(height).collect()
}

#[test]
fn hillshade_is_lit_from_the_north_west() {
    let shade = hillshade(&bowl(60, 80), 60, 80, PixelSize::square(2.0)).unwrap();
    // In a bowl the south-eastern slope faces north-west.
    assert!(shade.get_pixel(60, 50).0[0] > shade.get_pixel(20, 10).0[0] + 50);
    assert!(shade.pixels().all(|p| p.0[0] > 0), "no black margin");
    let mut heights_m = bowl(60, 80);
    heights_m[80 * 30 + 40] = f32::NAN;
    let shade = hillshade(&heights_m, 60, 80, PixelSize::square(2.0)).unwrap();
    assert_eq!(shade.pixels().filter(|p| p.0[0] == 0).count(), 1);
}

#[test]
fn hillshades_of_a_row_have_one_stretch() {
    let (mut steep, pixel) = (bowl(60, 80), PixelSize::square(9.0));
    let flat: Vec<f32> = steep.iter().map(|z| z / 4.0).collect();
    steep[0] = f32::NAN;
    let made = hillshades(&[&steep, &flat], 60, 80, pixel).unwrap();
    let range = |shade: &image::GrayImage| {
        let valid = || shade.pixels().map(|p| p.0[0]).filter(|v| *v > 0);
        u32::from(valid().max().unwrap() - valid().min().unwrap())
    };
    assert_eq!(made[0].pixels().filter(|p| p.0[0] == 0).count(), 1);
    assert!(range(&made[0]) == 254 && range(&made[1]) < 100, "{} {}", range(&made[0]), range(&made[1]));
    assert!(hillshades(&[&flat, &flat[1..]], 60, 80, pixel).is_err());
}

#[test]
fn stretch_ignores_outliers_and_voids() {
    let mut samples: Vec<f32> = (0..10_000).map(|k| (k % 100) as f32).collect();
    samples[0] = f32::NAN;
    samples[1] = 1e9;
    let picture = stretch(&samples, 100, 100).unwrap();
    assert_eq!([0, 1, 99].map(|col| picture.get_pixel(col, 0).0[0]), [0, 255, 255]);
    assert!((120..136).contains(&picture.get_pixel(50, 5).0[0]));
    assert!(stretch(&[f32::NAN; 4], 2, 2).is_ok());
}

#[test]
fn errors_have_the_colours_of_their_class() {
    let error = [0.5, -0.5, 2.0, -2.0, 5.0, -5.0, 11.0, -11.0, f32::NAN, 1.99];
    let picture = error_map(&error, 1, 10, ErrorLimits::PAPER).unwrap();
    let colours: Vec<[u8; 3]> = (0..10).map(|col| picture.get_pixel(col, 0).0).collect();
    assert_eq!(colours[8], [0; 3]);
    assert_eq!(colours[0], colours[9]);
    let distinct: std::collections::HashSet<_> = colours[..9].iter().collect();
    assert_eq!(distinct.len(), 9);
    let large = error_map(&vec![0.0; 40 * 300], 40, 300, ErrorLimits::PAPER).unwrap();
    assert!(large.rows().skip(48).flatten().any(|p| p.0[0] < 100 && p.0[2] < 100), "the legend has letters");
}

#[test]
fn relief_goes_from_dark_to_bright() {
    let ramp: Vec<f32> = (0..400).map(|k| (k % 20) as f32 * 0.01).collect();
    let picture = relief(&ramp, 20, 20, PixelSize::square(2.0), None).unwrap();
    let sum = |col| picture.get_pixel(col, 10).0.iter().map(|c| u32::from(*c)).sum::<u32>();
    assert!(sum(1) + 100 < sum(18));
}

#[test]
fn sheets_hold_all_panels() {
    let black = |w, h| Panel::new("a caption", image::RgbImage::new(w, h));
    let made = sheet(&[black(50, 40), black(400, 200), black(30, 30)], 2, 100);
    assert_eq!(made.width(), 8 + 2 * 108);
    assert_eq!(made.height(), 8 + (50 + 28) + (30 + 28));
    let black_pixels = made.pixels().filter(|p| p.0 == [0; 3]).count();
    assert!((50 * 40 + 100 * 50 + 30 * 30..8500).contains(&black_pixels), "{black_pixels}");
    assert!(sheet(&[], 3, 100).width() > 0);
    let six = sheet(&vec![black(50, 40); 6], 4, 100);
    assert_eq!((six.width(), six.height()), (8 + 3 * 58, 8 + 2 * 68), "three and three, not four and two");
}

#[test]
fn curves_are_drawn_and_bad_ones_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("curves.png");
    let points = |f: fn(f64) -> f64| (1..200).map(|k| (f64::from(k), f(f64::from(k)))).collect();
    let series = [
        Series { name: "training".into(), points: points(|x| 10.0 / x) },
        Series { name: "validation".into(), points: points(|x| if x < 50.0 { f64::NAN } else { 12.0 / x }) },
        Series { name: "coarse".into(), points: vec![(100.0, 3.0)] },
    ];
    for log_y in [false, true] {
        let chart = Chart { title: "Loss", x: "step", y: "loss", log_y };
        curves(&path, &chart, &series).unwrap();
        let picture = image::load_from_memory(&std::fs::read(&path).unwrap()).unwrap().into_rgb8();
        let blue = picture.pixels().filter(|p| p.0 == [31, 90, 165]).count();
        assert!(blue > 300, "{blue} pixels of the first curve");
    }
    let nothing = Series { name: "nothing".into(), points: vec![(1.0, f64::NAN)] };
    let chart = Chart { title: "Empty", x: "x", y: "y", log_y: false };
    assert!(curves(&folder.path().join("no.png"), &chart, &[nothing]).is_err());
    assert!(!folder.path().join("no.png").exists());
}

#[test]
fn wrong_sizes_are_refused() {
    assert!(stretch(&[0.0; 5], 2, 3).is_err());
    assert!(error_map(&[0.0; 5], usize::MAX, 2, ErrorLimits::PAPER).is_err());
}

#[test]
fn a_logarithmic_axis_without_a_power_of_ten_is_linear() {
    let same = |high: f64| {
        let series = [Series { name: "a".into(), points: vec![(0.0, 2.0), (1.0, high)] }];
        let chart = |log_y| Chart { title: "t", x: "x", y: "y", log_y };
        plot(&chart(true), &series).unwrap() == plot(&chart(false), &series).unwrap()
    };
    assert!(same(5.0));
    assert!(!same(20.0));
}
