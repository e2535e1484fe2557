//! The whole preparation: inspect every tile, drop, divide, write. An interrupted run can be continued.

use super::inspect::{self, Tile};
use super::list::SceneFiles;
use super::manifest::{
    FORMAT, MADE_BY, MANIFEST, PrepareOptions, Reason, SceneRecord, ShardRecord, Split, SplitRecord,
    TrainingSetManifest,
};
use super::scene::{PreparedScene, Reading};
use super::shard::{Shard, ShardFile};
use super::split::{Ground, divide};
use super::{filter, finished, pictures};
use elunar_base::digest::{sha256, sha256_hex, sha256_while};
use elunar_base::output::Owner;
use elunar_base::progress::Bar;
use elunar_base::{Error, Result, atomic_write, interrupt, read};
use elunar_core::tile::{TILE_COLS, TILE_ROWS, Window};
use elunar_net::illumination::KnownSun;
use elunar_net::sun::check_sun;
use elunar_raster::align::Interpolation;
use elunar_raster::source;
use elunar_raster::stated::HeightUnit;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The command whose files these are.
const COMMAND: &str = "prepare";
/// Folder of intermediate files, until the manifest is written.
const UNFINISHED: &str = "unfinished/";
/// What the shards are made by, in that folder.
const PLAN: &str = "unfinished/plan";

/// Reliefs of true and coarse DTM differ by less than this factor. Kilometres and metres differ by a thousand.
const FAR_OFF: f64 = 100.0;

/// A tile: number of its scene, number within the scene.
type Place = (usize, usize);

/// The split of each kept tile, in order of tiles.
type Splits = BTreeMap<Place, Split>;

/// One scene, inspected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Inspected {
    /// Everything that the inspection depends on.
    key: String,
    record: SceneRecord,
    tiles: Vec<Tile>,
    /// Transform of each tile.
    transforms: Vec<[f64; 6]>,
}

/// Prepares `scenes` into the folder `out`, which is created if absent. `bar` shows the progress of each phase.
///
/// An interrupted run leaves a folder `unfinished` in `out`. The same call continues from there. The manifest is written last: a folder
/// with a manifest is complete. The same call on a complete folder checks inputs and shards, and changes nothing.
///
/// # Errors
/// [`Error::Busy`] if another run writes the folder; [`Error::Input`] if another run completed it, or no tile can be kept; [`Error::Usage`] if
/// parameters are out of range. Errors of reading and writing are passed on.
pub fn run(scenes: &[SceneFiles], out: &Path, parameters: &PrepareOptions, bar: &Bar) -> Result<TrainingSetManifest> {
    let reading = check(parameters)?;
    scenes.iter().try_for_each(check_sun_of)?;
    let mut owner = Owner::of_folder(out, COMMAND, [])?;
    if let Some(manifest) = finished::find(scenes, out, parameters)? {
        // A run that was killed after its manifest leaves the intermediate files.
        owner.remove(UNFINISHED)?;
        return Ok(manifest);
    }
    owner.claim(first_files(scenes.len(), out)?)?;
    let unfinished = out.join(UNFINISHED);
    std::fs::create_dir_all(&unfinished).map_err(Error::io(&unfinished))?;
    let mut inspected = vec![];
    for (number, files) in scenes.iter().enumerate() {
        stop_if_asked()?;
        bar.set_message(format!("scene {} of {}", number + 1, scenes.len()));
        let notes = out.join(notes_file(number));
        inspected.push(inspect_scene(files, &notes, parameters, reading, bar)?);
    }
    let seen = kept(&inspected);
    let rule =
        filter::three_sigma(inspected.iter_mut().flat_map(|j| &mut j.tiles)).ok_or_else(|| nothing_left(&inspected))?;
    let (splits, divided_by) = divide_ground(&mut inspected, parameters)?;
    let training =
        splits.iter().filter(|(_, split)| **split == Split::Train).map(|(place, _)| tile(&inspected, *place));
    let all = || splits.keys().map(|place| tile(&inspected, *place));
    let nr = filter::nr(training).or_else(|| filter::nr(all())).ok_or_else(|| nothing_left(&inspected))?;
    let shards = write_shards(&inspected, &splits, (out, &mut owner), parameters, reading, bar)?;
    let seen: Vec<&Tile> = seen.into_iter().map(|place| tile(&inspected, place)).collect();
    pictures::write_histograms(out, &seen, &all().collect::<Vec<_>>(), rule, nr)?;
    let named = |(split, record): (&Split, &SplitRecord)| {
        let name = split.name();
        record.shards.iter().map(|shard| (name, out.join(&shard.file))).collect::<Vec<_>>()
    };
    pictures::write_sheet(out, &shards.iter().flat_map(named).collect::<Vec<_>>(), parameters.seed)?;
    let manifest = TrainingSetManifest {
        format: FORMAT.into(),
        made_by: MADE_BY.into(),
        tile: [TILE_ROWS, TILE_COLS],
        parameters: parameters.clone(),
        nr,
        three_sigma: rule,
        tiles: inspected.iter().map(|j| j.tiles.len()).sum(),
        kept: splits.len(),
        dropped: sum_dropped(inspected.iter().map(|j| dropped(&j.tiles))),
        divided_by,
        splits: shards,
        scenes: inspected.into_iter().map(finished_record).collect(),
    };
    let wrong = |e: serde_json::Error| Error::broken(out.join(MANIFEST), e.to_string());
    let text = serde_json::to_vec_pretty(&manifest).map_err(wrong)?;
    atomic_write(&out.join(MANIFEST), &text)?;
    owner.remove(UNFINISHED)?;
    // As it reads back, so that the same call on the finished folder returns the same numbers.
    serde_json::from_slice(&text).map_err(wrong)
}

/// Returns the name of the notes on a scene.
fn notes_file(scene: usize) -> String {
    format!("{UNFINISHED}scene_{scene:04}.json")
}

/// Returns the name of a shard.
fn shard_file(split: Split, number: usize) -> String {
    format!("{}-{number:05}.safetensors", split.name())
}

fn is_shard(name: &str) -> bool {
    name.ends_with(".safetensors") && Split::ALL.iter().any(|split| name.starts_with(&format!("{}-", split.name())))
}

/// Returns the shards in a folder, of whatever plan.
fn shards_in(out: &Path) -> Result<Vec<String>> {
    let entries = std::fs::read_dir(out).map_err(Error::io(out))?;
    let names = entries.map(|entry| Ok(entry.map_err(Error::io(out))?.file_name().to_string_lossy().into_owned()));
    names.filter(|name| name.as_ref().map_or(true, |name| is_shard(name))).collect()
}

/// Returns the names of all files of a run, but of shards those that are there: how many there will be is not known before the inspection.
fn first_files(scenes: usize, out: &Path) -> Result<Vec<String>> {
    let fixed = [MANIFEST, UNFINISHED, PLAN].into_iter().chain(pictures::FILES).map(String::from);
    Ok(fixed.chain((0..scenes).map(notes_file)).chain(shards_in(out)?).collect())
}

fn tile(inspected: &[Inspected], (scene, index): Place) -> &Tile {
    &inspected[scene].tiles[index]
}

fn check(parameters: &PrepareOptions) -> Result<Reading> {
    let wrong = |what: String| Err(Error::usage(what));
    let [train, validation, test] = parameters.shares;
    if !(parameters.shares.iter().all(|s| (0.0..=1.0).contains(s)) && (train + validation + test - 1.0).abs() < 1e-6) {
        return wrong(format!("shares of 0 to 1 that sum to 1 expected, {:?} found", parameters.shares));
    }
    if !(1..=60).contains(&parameters.search_px) {
        return wrong(format!("a search of 1 to 60 pixels expected, {} found", parameters.search_px));
    }
    if !(parameters.max_offset_px > 0.0 && parameters.max_offset_px <= parameters.search_px as f64) {
        let (limit, search) = (parameters.max_offset_px, parameters.search_px);
        return wrong(format!(
            "a largest offset above 0 and up to the search of {search} pixels expected, {limit} found"
        ));
    }
    if !(1..=4096).contains(&parameters.shard_tiles) {
        return wrong(format!("1 to 4096 tiles in a shard expected, {} found", parameters.shard_tiles));
    }
    let unknown = |what: &str, found: &str| Error::usage(format!("a known {what} expected, {found:?} found"));
    let interpolation = &parameters.interpolation;
    let interpolation = interpolation.parse::<Interpolation>().map_err(|_| unknown("interpolation", interpolation))?;
    let unit = |name: &String| name.parse::<HeightUnit>().map_err(|_| unknown("unit of heights", name));
    let coarse_unit = parameters.coarse_unit.as_ref().map(unit).transpose()?;
    Ok(Reading { interpolation, coarse_unit })
}

fn stop_if_asked() -> Result<()> {
    if interrupt::requested() { Err(Error::stopped("interrupted; the same command goes on from here")) } else { Ok(()) }
}

/// Inspects a scene, or reads the inspection from `notes` if nothing it depends on has changed.
fn inspect_scene(
    files: &SceneFiles,
    notes: &Path,
    parameters: &PrepareOptions,
    reading: Reading,
    bar: &Bar,
) -> Result<Inspected> {
    let hash = |path: &Path| {
        // What is no raster is refused before all of it is read.
        source::open(path)?;
        sha256_while(path, &|| !interrupt::requested())
    };
    let sha256 = [hash(&files.image)?, hash(&files.dtm)?, hash(&files.coarse)?];
    let wrong = |e: serde_json::Error| Error::broken(notes, e.to_string());
    let version = env!("CARGO_PKG_VERSION");
    let key = sha256_hex(&serde_json::to_vec(&(version, files, &sha256, parameters)).map_err(wrong)?);
    let known =
        read::bytes(notes, read::MOST_BYTES).ok().and_then(|bytes| serde_json::from_slice::<Inspected>(&bytes).ok());
    if let Some(known) = known.filter(|known| known.key == key) {
        return Ok(known);
    }
    let scene = PreparedScene::open(files, reading)?;
    let windows = scene.windows();
    bar.set_length(windows.len() as u64);
    bar.set_position(0);
    let tiles = inspect::tiles(&scene, files.sun_elevation_deg, parameters, || bar.inc(1))?;
    if parameters.coarse_unit.is_none() {
        check_unit(files, &tiles)?;
    }
    let record = SceneRecord {
        files: files.clone(),
        sha256,
        system: scene.system(),
        pixel_m: [scene.pixel.row_m, scene.pixel.col_m],
        coarse_px: scene.coarse_px,
        azimuth_used_deg: scene.sun_azimuth_deg,
        offset_px: median_offset(&tiles),
        offset_measured: tiles.iter().filter(|t| t.offset.is_some()).count(),
        tiles: tiles.len(),
        kept: 0,
        dropped: BTreeMap::new(),
    };
    let transforms = windows.iter().map(|&window| scene.transform(window)).collect();
    let inspected = Inspected { key, record, tiles, transforms };
    atomic_write(notes, &serde_json::to_vec(&inspected).map_err(wrong)?)?;
    // Numbers are used as they read back, so that an interrupted run gives the same result as an uninterrupted one.
    serde_json::from_slice(&read::bytes(notes, read::MOST_BYTES)?).map_err(wrong)
}

/// Refuses a Sun out of range, so that no shard states one.
fn check_sun_of(scene: &SceneFiles) -> Result<()> {
    // As a shard holds it.
    let stored = |deg: Option<f64>| deg.map(|deg| f64::from(deg as f32));
    let sun = KnownSun { azimuth_deg: stored(scene.sun_azimuth_deg), elevation_deg: stored(scene.sun_elevation_deg) };
    check_sun(sun).map_err(|error| error.about(&scene.image.display().to_string()))
}

/// Refuses reliefs that differ as kilometres and metres do.
fn check_unit(files: &SceneFiles, tiles: &[Tile]) -> Result<()> {
    let ratio = |t: &Tile| f64::from(t.relief_truth_m) / f64::from(t.relief_coarse_m);
    let mut ratios: Vec<f64> = tiles.iter().map(ratio).filter(|r| r.is_finite() && *r > 0.0).collect();
    match elunar_base::quantile::quantile(&mut ratios, 0.5) {
        Some(ratio) if !(1.0 / FAR_OFF..=FAR_OFF).contains(&ratio) => Err(Error::input(format!(
            "{}: about the relief of {} expected, 1/{ratio:.0} of it found: kilometres taken for metres? Say --coarse-unit km, or m",
            files.coarse.display(),
            files.dtm.display()
        ))),
        _ => Ok(()),
    }
}

fn median_offset(tiles: &[Tile]) -> Option<[f64; 2]> {
    let median = |of: fn(&super::Offset) -> f64| {
        let mut values: Vec<f64> = tiles.iter().filter_map(|t| t.offset.as_ref()).map(of).collect();
        elunar_base::quantile::quantile(&mut values, 0.5)
    };
    Some([median(|o| o.rows_px)?, median(|o| o.cols_px)?])
}

/// Returns scene and number of every tile that has not been dropped, in order.
fn kept(inspected: &[Inspected]) -> Vec<Place> {
    let of = |(scene, inspected): (usize, &Inspected)| {
        let tiles = inspected.tiles.iter().enumerate().filter(|(_, t)| t.dropped.is_none());
        tiles.map(|(index, _)| (scene, index)).collect::<Vec<_>>()
    };
    inspected.iter().enumerate().flat_map(of).collect()
}

/// Returns the splits of the kept tiles, in order of tiles. Drops tiles across a border.
fn divide_ground(inspected: &mut [Inspected], parameters: &PrepareOptions) -> Result<(Splits, String)> {
    let places = kept(inspected);
    let ground: Vec<Ground> = places
        .iter()
        .map(|&(scene, index)| {
            let Inspected { record, transforms, .. } = &inspected[scene];
            Ground::new(&record.files.site, &record.system, &transforms[index], TILE_ROWS, TILE_COLS)
        })
        .collect();
    let (splits, how) = divide(&ground, parameters.shares, parameters.seed)?;
    let mut found = BTreeMap::new();
    for (place, split) in places.into_iter().zip(splits) {
        match split {
            Some(split) => drop(found.insert(place, split)),
            None => inspected[place.0].tiles[place.1].dropped = Some(Reason::BetweenSplits),
        }
    }
    Ok((found, how))
}

/// Writes the shards of all splits. Shards of an interrupted run with the same plan are kept.
fn write_shards(
    inspected: &[Inspected],
    splits: &Splits,
    (out, owner): (&Path, &mut Owner),
    parameters: &PrepareOptions,
    reading: Reading,
    bar: &Bar,
) -> Result<BTreeMap<Split, SplitRecord>> {
    let plan = plan(inspected, splits, out, parameters)?;
    if read::text(&out.join(PLAN), read::MOST_SETTINGS_BYTES).is_ok_and(|known| known == plan) {
        owner.claim(shard_files(splits, parameters))?;
    } else {
        // Shards of another plan.
        shards_in(out)?.iter().try_for_each(|name| owner.remove(name))?;
        owner.claim(shard_files(splits, parameters))?;
        atomic_write(&out.join(PLAN), plan.as_bytes())?;
    }
    bar.set_message("writing");
    bar.set_length(splits.len() as u64);
    bar.set_position(0);
    let mut open: Option<(usize, PreparedScene)> = None;
    let mut records = BTreeMap::new();
    for split in Split::ALL {
        let places: Vec<Place> = splits.iter().filter(|(_, s)| **s == split).map(|(place, _)| *place).collect();
        let mut record = SplitRecord { tiles: places.len(), ..SplitRecord::default() };
        record.sites = places.iter().map(|&(scene, _)| inspected[scene].record.files.site.clone()).collect();
        record.sites.sort();
        record.sites.dedup();
        for (number, part) in places.chunks(parameters.shard_tiles).enumerate() {
            stop_if_asked()?;
            let file = shard_file(split, number);
            let path = out.join(&file);
            if !path.exists() {
                let mut shard = Shard::default();
                for &(number, index) in part {
                    let scene = match open.take() {
                        Some((open_number, scene)) if open_number == number => scene,
                        _ => PreparedScene::open(&inspected[number].record.files, reading)?,
                    };
                    add_tile(&mut shard, &scene, number, &inspected[number], index)?;
                    open = Some((number, scene));
                    bar.inc(1);
                }
                shard.write(&path, &format!("{FORMAT}, {}", split.name()))?;
            }
            let found = ShardFile::open(&path)?.len();
            if found != part.len() {
                return Err(Error::broken(&path, format!("{} tiles expected, {found} found", part.len())));
            }
            record.shards.push(ShardRecord { sha256: sha256(&path)?, tiles: found, file });
        }
        records.insert(split, record);
    }
    Ok(records)
}

/// Returns the names of the shards of a plan.
fn shard_files(splits: &Splits, parameters: &PrepareOptions) -> Vec<String> {
    let of = |split: Split| {
        let tiles = splits.values().filter(|found| **found == split).count();
        (0..tiles.div_ceil(parameters.shard_tiles)).map(move |number| shard_file(split, number))
    };
    Split::ALL.into_iter().flat_map(of).collect()
}

/// Returns the SHA-256 of everything that the shards depend on.
fn plan(inspected: &[Inspected], splits: &Splits, out: &Path, parameters: &PrepareOptions) -> Result<String> {
    let keys: Vec<&str> = inspected.iter().map(|j| j.key.as_str()).collect();
    let places: Vec<_> = splits.iter().collect();
    let plan = serde_json::to_vec(&(keys, places, parameters));
    Ok(sha256_hex(&plan.map_err(|e| Error::broken(out.join(PLAN), e.to_string()))?))
}

fn add_tile(
    shard: &mut Shard,
    scene: &PreparedScene,
    number: usize,
    inspected: &Inspected,
    index: usize,
) -> Result<()> {
    let tile = &inspected.tiles[index];
    let maps = scene.maps(Window { row: tile.row, col: tile.col, rows: TILE_ROWS, cols: TILE_COLS })?;
    shard.image.extend(maps.image);
    shard.coarse_m.extend(maps.coarse_m);
    shard.truth_m.extend(maps.truth_m);
    shard.pixel_m.extend(inspected.record.pixel_m.map(|v| v as f32));
    shard.coarse_px.push(inspected.record.coarse_px);
    shard.sun_azimuth_deg.push(inspected.record.azimuth_used_deg.map_or(f32::NAN, |v| v as f32));
    shard.sun_elevation_deg.push(inspected.record.files.sun_elevation_deg.map_or(f32::NAN, |v| v as f32));
    shard.offset_px.extend(tile.offset.map_or([f32::NAN; 2], |o| [o.rows_px as f32, o.cols_px as f32]));
    shard.scene.push(number as i32);
    shard.transform.extend(inspected.transforms[index]);
    Ok(())
}

fn dropped(tiles: &[Tile]) -> BTreeMap<Reason, usize> {
    sum_dropped(tiles.iter().filter_map(|t| t.dropped).map(|reason| BTreeMap::from([(reason, 1)])))
}

fn sum_dropped(parts: impl Iterator<Item = BTreeMap<Reason, usize>>) -> BTreeMap<Reason, usize> {
    let mut sum = BTreeMap::new();
    parts.flatten().for_each(|(reason, count)| *sum.entry(reason).or_insert(0) += count);
    sum
}

fn finished_record(inspected: Inspected) -> SceneRecord {
    let dropped = dropped(&inspected.tiles);
    let kept = inspected.tiles.len() - dropped.values().sum::<usize>();
    SceneRecord { kept, dropped, ..inspected.record }
}

fn nothing_left(inspected: &[Inspected]) -> Error {
    let tiles: usize = inspected.iter().map(|j| j.tiles.len()).sum();
    let reasons = sum_dropped(inspected.iter().map(|j| dropped(&j.tiles)));
    let reasons: Vec<String> = reasons.iter().map(|(reason, count)| format!("{reason:?} {count}")).collect();
    let whole = format!("{TILE_ROWS} x {TILE_COLS}");
    Error::input(format!(
        "prepare: usable tiles of {whole} pixels expected, none of {tiles} found ({})",
        reasons.join(", ")
    ))
}
