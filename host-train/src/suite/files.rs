//! The names of all files of a suite, so that they are known before the work starts.

use super::list::SuiteScene;
use super::results::RESULTS;
use super::{DTMS, SCENES};

/// The command whose files these are.
pub const COMMAND: &str = "suite";
/// Table of the scenes' files, within their folder.
pub const TABLE: &str = "scenes.csv";
/// Tables, within the suite's folder.
pub(super) const TABLES: [&str; 5] = ["learning.csv", "tables.md", "scenes.csv", "sums.csv", "cross.csv"];
/// Folder of the pictures, within the suite's folder.
pub const PICTURES: &str = "pictures";
/// The maps of a scene.
pub(super) const MAPS: [&str; 3] = ["image", "coarse", "truth"];

/// Returns the name of a scene's map, within the folder of the scenes.
pub(crate) fn map_file(scene: &str, what: &str) -> String {
    format!("{scene}_{what}.tif")
}

/// Returns the name of a scene's picture, within the suite's folder.
pub(super) fn picture_file(scene: &str, what: &str) -> String {
    format!("{PICTURES}/{scene}_{what}.png")
}

/// Returns the names of a scene's pictures, within the suite's folder.
fn pictures(scene: &str) -> [String; 2] {
    ["relief", "errors"].map(|what| picture_file(scene, what))
}

/// Returns the name of the picture of a ground's two scenes, within the suite's folder.
pub(super) fn cross_file(ground: &str, a: &str, b: &str) -> String {
    format!("{PICTURES}/ground_{ground}_{a}_{b}.png")
}

/// Returns the names of the scenes' files, within the suite's folder.
pub fn of_scenes<'a>(scenes: impl Iterator<Item = &'a str> + 'a) -> impl Iterator<Item = String> + 'a {
    let maps = |scene: &'a str| MAPS.map(|what| format!("{SCENES}/{}", map_file(scene, what)));
    scenes.flat_map(maps).chain([format!("{SCENES}/{TABLE}")])
}

/// Returns the names of the other files of a suite of these scenes: tables, pictures, and the DTMs of `methods`. `grounds` are names of
/// grounds, with the names of two scenes of each.
pub fn of_results<'a>(scenes: impl Iterator<Item = &'a str>, methods: &[&str], grounds: &[[&str; 3]]) -> Vec<String> {
    let mut all: Vec<String> = TABLES.iter().chain([&RESULTS]).map(|name| (*name).into()).collect();
    for scene in scenes {
        all.extend(methods.iter().map(|method| dtm_file(method, scene)));
        all.extend(pictures(scene));
    }
    all.extend(grounds.iter().map(|[ground, a, b]| cross_file(ground, a, b)));
    all
}

/// Returns the name of a method's DTM of a scene, within the suite's folder.
pub(crate) fn dtm_file(method: &str, scene: &str) -> String {
    format!("{DTMS}/{method}/{scene}.tif")
}

/// Returns all files of a suite of the scenes of a list.
pub fn of_suite(list: &[SuiteScene], methods: &[&str]) -> Vec<String> {
    let names = || list.iter().map(|entry| entry.name.as_str());
    let mut grounds = vec![];
    for (k, second) in list.iter().enumerate() {
        let Some(ground) = &second.ground else { continue };
        let earlier = list[..k].iter().filter(|first| first.ground.as_ref() == Some(ground));
        grounds.extend(earlier.map(|first| [ground.as_str(), first.name.as_str(), second.name.as_str()]));
    }
    of_scenes(names()).chain(of_results(names(), methods, &grounds)).collect()
}
