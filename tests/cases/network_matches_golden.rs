//! The Burn network against the golden files: every traced map, the output, the losses.

use elunar_learn::model::backend::Backend;
use elunar_tests::golden_networks;
use host_train::cli::check::compare;

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
    let mut file = elunar_net::weights::Weights::read(path).unwrap();
    file.tensors.get_mut("decoder.2.shortcut.bn.running_var").unwrap().data[0] *= 1.01;
    let folder = tempfile::tempdir().unwrap();
    let changed = folder.path().join("changed.safetensors");
    file.write(&changed).unwrap();
    let lines = compare(&changed, &Backend::Flex.device().unwrap()).unwrap();
    let wrong: Vec<&str> = lines.iter().filter(|l| l.error > l.tolerance).map(|l| l.name.as_str()).collect();
    assert!(wrong.contains(&"trace.d3") && !wrong.contains(&"trace.d2"), "noticed in {wrong:?}");
}
