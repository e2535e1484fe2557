//! Compares loss terms and metrics of `core` with those of PyTorch in the golden files.

use elunar_core::loss::Pair;
use elunar_core::loss::hybrid::{ElevationTerm, terms};
use elunar_core::metrics::{HeightErrors, RelativeErrors};
use elunar_core::tile::Shape;
use elunar_net::weights::{Array, NetWeights};
use elunar_tests::{golden_networks, tolerance};
use std::collections::BTreeMap;

/// Calls `check` with weights, truth and prediction of every golden case.
fn each_case(check: impl Fn(&NetWeights, &Array, &Array)) {
    for path in golden_networks() {
        println!("{}", path.display());
        let file = NetWeights::read(&path).unwrap();
        check(&file, &file.tensors["truth"], &file.tensors["output"]);
    }
}

fn assert_close(name: &str, found: f64, expected: f64, relative: f64) {
    assert!((found - expected).abs() <= relative * expected.abs(), "{name}: {found} instead of {expected}");
}

#[test]
fn loss_terms_match_pytorch() {
    each_case(|file, truth, predicted| {
        let expected: [f64; 3] = serde_json::from_str(&file.metadata["loss_terms"]).unwrap();
        let shape = Shape::new(truth.shape[2], truth.shape[3]);
        let pair = Pair::new(&truth.data, &predicted.data, None, shape).unwrap();
        let found = terms(&pair, ElevationTerm::MeanNormalised).unwrap();
        assert_close("elevation", found.elevation, expected[0], tolerance::LOSS_TERM);
        assert_close("gradient", found.gradient, expected[1], tolerance::LOSS_TERM);
        assert_close("normal", found.normal, expected[2], tolerance::LOSS_TERM);
    });
}

#[test]
fn metrics_match_pytorch() {
    each_case(|file, truth, predicted| {
        let expected: BTreeMap<String, f64> = serde_json::from_str(&file.metadata["metrics"]).unwrap();
        let (mut heights, mut relative) = (HeightErrors::default(), RelativeErrors::default());
        heights.extend(&truth.data, &predicted.data, None).unwrap();
        relative.extend(&truth.data, &predicted.data, None).unwrap();
        let [a1, a2, a3] = relative.share_within_ratio().unwrap();
        let [re_2m, re_4m, re_10m] = heights.share_within().unwrap();
        let found = [
            ("rel", relative.rel().unwrap()),
            ("rmse", relative.rmse().unwrap()),
            ("log10", relative.log10().unwrap()),
            ("psnr", relative.psnr_db().unwrap()),
            ("mae", heights.mae_m().unwrap()),
            ("a1", a1),
            ("a2", a2),
            ("a3", a3),
            ("re_2m", re_2m),
            ("re_4m", re_4m),
            ("re_10m", re_10m),
        ];
        assert_eq!(found.len(), expected.len(), "every metric of the file is compared");
        for (name, value) in found {
            assert_close(name, value, expected[name], tolerance::METRIC);
        }
        assert_close("rmse", heights.rmse_m().unwrap(), expected["rmse"], tolerance::METRIC);
    });
}
