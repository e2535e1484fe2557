//! Compares the Burn network with PyTorch: every traced map of the golden files, the output, the losses; published checkpoints; names and
//! shapes.

use burn::tensor::{Tensor, TensorData};
use elunar_learn::check::{MAP_TOLERANCE, compare};
use elunar_learn::model::backend::Backend;
use elunar_learn::model::init::initial_weights;
use elunar_learn::model::store;
use elunar_net::config::{DecoderKind, ImageEncoderKind, NetConfig, Preset};
use elunar_net::published::load_swin;
use elunar_net::weights::NetWeights;
use elunar_tests::{golden_networks, repository};
use std::collections::BTreeMap;

#[test]
fn every_map_of_every_golden_case_matches() {
    let device = Backend::Flex.device().unwrap();
    for path in golden_networks() {
        let lines = compare(&path, &device).unwrap();
        assert!(lines.len() >= 16, "{}: only {} quantities compared", path.display(), lines.len());
        for line in lines {
            assert!(line.error <= line.tolerance, "{}: {} off by {:e}", path.display(), line.name, line.error);
        }
    }
}

#[test]
fn a_changed_weight_is_noticed() {
    let path = &golden_networks()[0];
    let mut file = NetWeights::read(path).unwrap();
    file.tensors.get_mut("decoder.2.shortcut.bn.running_var").unwrap().data[0] *= 1.01;
    let folder = tempfile::tempdir().unwrap();
    let changed = folder.path().join("changed.safetensors");
    file.write(&changed).unwrap();
    let lines = compare(&changed, &Backend::Flex.device().unwrap()).unwrap();
    let wrong: Vec<&str> = lines.iter().filter(|l| l.error > l.tolerance).map(|l| l.name.as_str()).collect();
    assert!(wrong.contains(&"trace.d3") && !wrong.contains(&"trace.d2"), "noticed in {wrong:?}");
}

/// Returns the maps of a new encoder with the weights of a published checkpoint, on the image of `tests/golden/published`.
fn published_maps(checkpoint: &str, change: impl FnOnce(&mut NetWeights)) -> Vec<(String, f64)> {
    let folder = repository().join("tests/golden/published");
    let read = |name: &str| (folder.join(name), NetWeights::read(&folder.join(name)).unwrap());
    let ((maps_path, maps), (path, mut published)) = (read("maps.safetensors"), read(checkpoint));
    change(&mut published);
    let widths: serde_json::Value = serde_json::from_str(&maps.metadata["config"]).unwrap();
    let mut config = serde_json::to_value(NetConfig::preset(Preset::Nano)).unwrap();
    config.as_object_mut().unwrap().extend(widths.as_object().unwrap().clone());
    let config: NetConfig = serde_json::from_value(config).unwrap();
    let mut weights = initial_weights(&config, 1);
    load_swin(&mut weights, &published, &path).unwrap();
    let device = Backend::Flex.device().unwrap();
    let net = store::load(&config, &weights, &maps_path, &device).unwrap();
    let image = &maps.tensors["input.image"];
    let image: Tensor<4> = Tensor::from_data(TensorData::new(image.data.clone(), image.shape.clone()), &device);
    let (_, trace) = net.forward_traced(image.clone(), image);
    let compare = |(name, map): (String, Tensor<4>)| {
        let expected = maps.tensors.get(&format!("trace.{name}"))?;
        assert_eq!(expected.shape, map.dims(), "{name}");
        let found = map.into_data().try_to_vec::<f32>().unwrap();
        let peak = expected.data.iter().fold(0.0f32, |m, e| m.max(e.abs()));
        let worst = expected.data.iter().zip(&found).fold(0.0f32, |m, (e, f)| m.max((e - f).abs()));
        Some((name, f64::from(worst / peak)))
    };
    trace.into_iter().filter_map(compare).collect()
}

#[test]
fn published_swin_checkpoints_compute_what_timm_computes() {
    for checkpoint in ["timm.safetensors", "original.safetensors"] {
        let maps = published_maps(checkpoint, |_| {});
        assert_eq!(maps.len(), 4, "{maps:?}");
        assert!(maps.iter().all(|(_, error)| *error <= MAP_TOLERANCE), "{checkpoint}: {maps:?}");
    }
    // A colour that is missing in the first output channel changes every map.
    let wrong = published_maps("timm.safetensors", |published| {
        let kernel = &mut published.tensors.get_mut("patch_embed.proj.weight").unwrap();
        kernel.data.iter_mut().skip(16).step_by(48).for_each(|w| *w = 0.0);
    });
    assert!(wrong.iter().all(|(_, error)| *error > MAP_TOLERANCE), "{wrong:?}");
}

#[test]
fn the_papers_network_has_pytorchs_tensors() {
    let text = std::fs::read_to_string(repository().join("tests/golden/shapes/case.json")).unwrap();
    let golden: BTreeMap<String, serde_json::Value> = serde_json::from_str(&text).unwrap();
    assert_eq!(golden.len(), 3);
    let device = Backend::Flex.device().unwrap();
    for (name, case) in golden {
        let mut config = NetConfig::preset(Preset::Paper);
        match name.as_str() {
            "upb" => config.decoder_kind = DecoderKind::Upb,
            "resnet" => config.image_encoder = ImageEncoderKind::Resnet,
            _ => assert_eq!(name, "paper"),
        }
        let found = store::outline(&config, &device);
        let expected: BTreeMap<String, Vec<usize>> = serde_json::from_value(case["shapes"].clone()).unwrap();
        let differ: Vec<_> = expected.iter().filter(|(name, shape)| found.get(*name) != Some(shape)).collect();
        assert!(differ.is_empty() && found.len() == expected.len(), "{name}: {differ:?}");
        let trained = found.iter().filter(|(name, _)| !name.contains(".running_"));
        let parameters: usize = trained.map(|(_, shape)| shape.iter().product::<usize>()).sum();
        assert_eq!(Some(parameters as u64), case["parameters"].as_u64(), "{name}");
        assert!(name != "paper" || parameters == 321_282_245);
    }
}
