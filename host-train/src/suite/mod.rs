//! Test suites: models, other programs' DTMs, the pipeline without training and the coarse DTM on scenes with a truth, on the same pixels.
//!
//! A [`list`] names the scenes, and [`files`] all files to write; [`real`] makes the built-in one of real scenes. [`scene`] makes or reads them. A [`method`] makes the DTMs;
//! [`linear`] has the bounds for linear ones, [`coarse_to_fine`] the use of a network at several scales. [`score`] compares them. [`summary`] and [`tables`] summarise the scores, and [`pictures`] draws them. [`results`] stores them. [`run`] does all of this.

pub mod coarse_to_fine;
pub mod files;
pub mod linear;
pub mod list;
pub mod method;
pub mod pictures;
pub mod real;
pub mod results;
pub mod scene;
pub mod score;
pub mod summary;
pub mod tables;

use elunar_base::output::Owner;
use elunar_base::table::to_csv;
use elunar_base::{Error, Result, atomic_write};
use elunar_raster::geotiff::{WriteOptions, write};
use linear::Teacher;
use list::List;
use method::{Method, Usage};
use results::{COARSE, MethodInfo, SuiteResults};
use scene::TestScene;
use score::Seen;
use std::path::Path;

/// Folder of the scenes' files, within the suite's folder.
pub const SCENES: &str = "scenes";
/// Folder of the DTMs. It has one folder per method.
pub const DTMS: &str = "dtm";

/// Methods that a suite scores of itself, besides the coarse DTM.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Baselines {
    /// Usage of the pipeline without training ([`Method::untrained`]), which is always scored.
    pub usage: Usage,
    /// Whether the bound for linear methods from other grounds is scored ([`linear::Teacher::OtherGrounds`]).
    pub linear_bound: bool,
    /// Whether the bound from the scene's own truth is scored ([`linear::Teacher::OwnTruth`]).
    pub linear_own: bool,
}

impl Baselines {
    /// Makes the methods.
    #[must_use]
    pub fn methods(self) -> Vec<Method> {
        let teachers = [(self.linear_bound, Teacher::OtherGrounds), (self.linear_own, Teacher::OwnTruth)];
        let bounds = teachers.into_iter().filter(|(wanted, _)| *wanted);
        let bounds = bounds.map(|(_, teacher)| Method::linear(teacher, self.usage));
        std::iter::once(Method::untrained(self.usage)).chain(bounds).collect()
    }
}

/// Scores the `baselines` and `methods` on the scenes of `list` and writes results, tables, pictures, scenes and DTMs into `out`. Calls
/// `progress` with the name of every scene before its work.
///
/// # Errors
/// If two methods share a name, or making scenes, predicting or writing fails. Results are written last.
#[expect(clippy::too_many_lines, reason = "the steps of a suite, in their order")]
pub fn run(
    list: &List,
    baselines: Baselines,
    methods: &[Method],
    out: &Path,
    progress: &mut dyn FnMut(&str),
) -> Result<SuiteResults> {
    if let Some(scene) = linear::without_sun(&list.scene).filter(|_| baselines.linear_bound) {
        let what = "expected the Sun's azimuth and elevation in every scene for the linear bound, found none in";
        return Err(Error::input(format!("{}: {what} {}", list.name, scene.name)));
    }
    let own = baselines.methods();
    let methods: Vec<&Method> = own.iter().chain(methods).collect();
    for (k, method) in methods.iter().enumerate() {
        if methods[..k].iter().any(|other| other.name == method.name) {
            return Err(Error::input(format!("{}: expected methods of different names, found it twice", method.name)));
        }
    }
    let names: Vec<&str> = methods.iter().map(|method| method.name.as_str()).collect();
    let _owner = Owner::of_folder(out, files::COMMAND, files::of_suite(&list.scene, &names))?;
    let of_methods = names.iter().map(|name| out.join(DTMS).join(name));
    for folder in of_methods.chain([SCENES, files::PICTURES].map(|name| out.join(name))) {
        std::fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
    }
    let mut results = empty(list, &methods);
    let mut grounds: Vec<(String, Vec<Seen>)> = vec![];
    for entry in &list.scene {
        progress(&entry.name);
        let scene = TestScene::make(entry)?;
        scene.write(&out.join(SCENES))?;
        let scored = score::score(&scene, &methods)?;
        for (method, found) in methods.iter().zip(&scored.comparison.scored[1..]) {
            let path = out.join(files::dtm_file(&method.name, &entry.name));
            write(
                &path,
                &found.as_it_is,
                &WriteOptions::heights(format!("DTM of a test scene: {}", method.description)),
            )?;
        }
        let mut result = scored.result;
        result.pictures = pictures::scene(out, &scene, &scored.comparison)?;
        results.scenes.push(result);
        if let Some(ground) = &entry.ground {
            let dtms = scored.comparison.scored.into_iter().map(|j| (j.name, j.as_it_is)).collect();
            let seen = Seen { name: entry.name.clone(), truth: scene.truth, high_pass_m: scene.high_pass_m, dtms };
            match grounds.iter_mut().find(|(name, _)| name == ground) {
                Some((_, all)) => all.push(seen),
                None => grounds.push((ground.clone(), vec![seen])),
            }
        }
    }
    for (ground, seen) in &grounds {
        let pairs = (0..seen.len()).flat_map(|i| (i + 1..seen.len()).map(move |j| (i, j)));
        for (i, j) in pairs {
            let found = score::cross(ground, &seen[i], &seen[j])?;
            if !found.is_empty() {
                let picture = pictures::cross(out, ground, &seen[i], &seen[j])?;
                let scene = results.scenes.iter_mut().find(|scene| scene.name == seen[j].name);
                scene.into_iter().for_each(|scene| scene.pictures.push(picture.clone()));
            }
            results.cross.extend(found);
        }
    }
    let texts = [
        tables::learning(&results).csv()?,
        tables::markdown(&results).into_bytes(),
        tables::scenes(&results).csv()?,
        tables::sums(&results).csv()?,
        tables::cross(&results).csv()?,
    ];
    for (file, text) in files::TABLES.iter().zip(texts) {
        atomic_write(&out.join(file), &text)?;
    }
    results.write(out)?;
    Ok(results)
}

/// Writes the scenes' files, and a table of them for other programs: name, direction to the Sun (degrees) and side of the
/// image's pixels (metres).
///
/// # Errors
/// If scenes cannot be made or written.
pub fn write_scenes(list: &List, out: &Path) -> Result<()> {
    let names = list.scene.iter().map(|entry| entry.name.as_str());
    let _owner = Owner::of_folder(out, files::COMMAND, files::of_scenes(names))?;
    let folder = out.join(SCENES);
    std::fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
    let mut rows = vec![["name", "sun_azimuth_deg", "sun_elevation_deg", "pixel_m"].map(String::from)];
    for entry in &list.scene {
        let scene = TestScene::make(entry)?;
        scene.write(&folder)?;
        let angle = |deg: Option<f64>| deg.map_or_else(String::new, |deg| format!("{deg:.3}"));
        let (row_m, col_m) = scene.raw_image.pixel_m().unwrap_or(scene.pixel_m);
        let side = format!("{:.3}", (row_m * col_m).sqrt());
        rows.push([entry.name.clone(), angle(scene.sun_deg.0), angle(scene.sun_deg.1), side]);
    }
    atomic_write(&folder.join(files::TABLE), &to_csv(rows)?)
}

fn empty(list: &List, methods: &[&Method]) -> SuiteResults {
    let coarse = MethodInfo {
        name: COARSE.into(),
        description: "coarse DTM, interpolated bicubically".into(),
        anchor: false,
        co_alignment: Default::default(),
        sun_told: false,
    };
    SuiteResults {
        software: concat!("host-train ", env!("CARGO_PKG_VERSION")).into(),
        suite: list.name.clone(),
        about: list.about.clone(),
        list_sha256: list.sha256(),
        methods: std::iter::once(coarse).chain(methods.iter().map(|method| method.info())).collect(),
        scenes: vec![],
        cross: vec![],
    }
}
