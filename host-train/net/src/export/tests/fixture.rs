//! The small model file for tests and examples of `core`.

use super::*;
use crate::config::OutputHead;

/// Writes `core/fixtures/tile-v4.eld`: a network with every operator and random weights. Its head makes small corrections of the coarse
/// DTM.
#[test]
#[ignore = "writes core/fixtures/tile-v4.eld, which is kept as it is for as long as its version is read"]
fn write_the_fixture_of_core() {
    let config = NetConfig {
        embed: 2,
        heads: [1, 1, 2, 4],
        stem: 2,
        dtm: [2, 2, 2, 2, 2],
        decoder: [2, 2, 2, 2, 2],
        head: OutputHead::Residual,
        range_margin: 0.1,
        ..small_config()
    };
    let tile = (32, 32);
    let tiles = [random_tile(tile.0, tile.1, 1), random_tile(tile.0, tile.1, 2)];
    let mut weights = random_weights(&config, 1);
    for (name, array) in &mut weights.tensors {
        match name.as_str() {
            "head.weight" => array.data.iter_mut().for_each(|w| *w *= 0.05),
            "head.bias" => array.data.fill(0.0),
            _ => {}
        }
    }
    let options = CompileOptions { tile, precision: MapBits::Mixed, name: "fixture".into() };
    let made = export(&config, &weights, Path::new("fixture"), &tiles, &options, |_| {}).unwrap();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../core/fixtures/tile-v4.eld");
    std::fs::write(path, made.bytes).unwrap();
}
