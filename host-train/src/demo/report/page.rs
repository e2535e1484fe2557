//! The page itself, section by section.

use super::{Pictures, Story};
use crate::demo::console::minutes;
use crate::demo::folder::{FLOAT_MODEL, INT8_MODEL, NAMES};
use crate::demo::{InitialWeights, SHIPPED_MODEL};
use crate::report::html::{Cell, document, escaped, figure, table};
use elunar_base::Result;
use elunar_evaluate::Scores;
use elunar_learn::train::validate::ValidationScores as TileScores;

/// Returns the report as one HTML document.
///
/// # Errors
/// If a picture cannot be read.
pub(super) fn page(story: &Story, pictures: &Pictures, relief: &str) -> Result<String> {
    let sections = [
        opening(story),
        relief.into(),
        scene(story),
        accuracy(story, pictures)?,
        training(story, pictures)?,
        int8(story),
        commands(story),
        provenance(story),
    ];
    Ok(document("ELunarDTM: a tour", &sections.concat()))
}

/// Returns the scores of coarse DTM, the pipeline without training, float and int8.
fn scores(story: &Story) -> Vec<Scores> {
    story.verdict.against_truth.scored.iter().map(|scored| scored.scores).collect()
}

/// Returns a change as `from 3.21° to 1.70° (−47 %)`.
fn change(from: f64, to: f64, unit: &str) -> String {
    let percent = 100.0 * (to / from - 1.0);
    format!("from {from:.2}{unit} to {to:.2}{unit} ({})", format!("{percent:+.0} %").replace('-', "−"))
}

/// What went in, what came out, how good it is. The relief stands below.
fn opening(story: &Story) -> String {
    let Story { scene, predicted: [.., int8], .. } = story;
    let found = match scores(story).as_slice() {
        [coarse, .., int8] => format!(
            "its slopes are off by {:.2}° in the mean where the coarse DTM's are off by {:.2}°, its heights by {:.2} m (RMSE) and not by {:.2} m.",
            int8.slope_mae_deg, coarse.slope_mae_deg, int8.rmse_m, coarse.rmse_m
        ),
        _ => String::new(),
    };
    format!(
        "<h1>A DTM from one image: a synthetic scene</h1>\n<p>An image of {} × {} pixels of {} m and a coarse DTM of 59 m went in. A DTM at the \
         image's resolution came out, by the int8 network in {}: {found}</p>\n",
        scene.truth.rows,
        scene.truth.cols,
        scene.pixel_m,
        minutes(int8.seconds),
    )
}

fn scene(story: &Story) -> String {
    let scene = &story.scene;
    let step = match scores(story).as_slice() {
        [coarse, untrained, float, int8, ..] => format!(
            "The mean slope error goes {} without any training (photoclinometry), to {:.2}° with the float network and to {:.2}° with the int8 \
             one; the height RMSE goes {}, to {:.2} m and to {:.2} m.",
            change(coarse.slope_mae_deg, untrained.slope_mae_deg, "°"),
            float.slope_mae_deg,
            int8.slope_mae_deg,
            change(coarse.rmse_m, untrained.rmse_m, " m"),
            float.rmse_m,
            int8.rmse_m
        ),
        _ => String::new(),
    };
    format!(
        "<p class=\"warn\"><strong>Synthetic data.</strong> Image, coarse DTM and truth on this page come from a generator of \
         synthetic lunar terrain. All figures were measured in this run, on this scene; they are <strong>not a reproduction of the \
         paper's tables</strong> and say nothing yet about real ground.</p>\n\
         <h2>The scene</h2>\n<p>The ground is {}, the image's Sun {:.0}° high from azimuth {:.0}°. The network saw image and coarse DTM, not the \
         truth. {step}</p>\n",
        format!("{:?}", scene.about.kind).to_lowercase(),
        scene.about.sun_elevation_deg,
        scene.about.sun_azimuth_deg
    )
}

/// A row of the accuracy table: heading, figure, and whether a larger figure is better. Otherwise, the figure nearest to 0 is best.
type Row = (&'static str, fn(&Scores) -> f64, bool);

const ROWS: [Row; 9] = [
    ("Height RMSE, m", |s| s.rmse_m, false),
    ("Height RMSE, median removed, m", |s| s.rmse_median_removed_m, false),
    ("Height MAE, m", |s| s.mae_m, false),
    ("Share within 2 m, %", |s| 100.0 * s.share_within[0], true),
    ("Share within 4 m, %", |s| 100.0 * s.share_within[1], true),
    ("Share within 10 m, %", |s| 100.0 * s.share_within[2], true),
    ("Slope MAE, °", |s| s.slope_mae_deg, false),
    ("Slope RMSE, °", |s| s.slope_rmse_deg, false),
    ("Slope mean error, ° (below 0: too smooth)", |s| s.slope_bias_deg, false),
];

fn accuracy(story: &Story, pictures: &Pictures) -> Result<String> {
    let all = scores(story);
    let rows: Vec<Vec<Cell>> = ROWS
        .iter()
        .map(|(heading, figure, more)| {
            // The best figure is chosen by the printed digits, so differences beyond them do not count.
            let shown: Vec<String> = all.iter().map(|s| format!("{:.2}", figure(s)).replace('-', "−")).collect();
            let merit = |text: &String| {
                let figure: f64 = text.trim_start_matches('−').parse().unwrap_or(f64::NAN);
                if *more { figure } else { -figure }
            };
            let (worst, best) = shown
                .iter()
                .map(merit)
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), m| (low.min(m), high.max(m)));
            let cell = |text: &String| Cell { best: worst < best && merit(text) == best, text: text.clone() };
            std::iter::once(Cell::plain(*heading)).chain(shown.iter().map(cell)).collect()
        })
        .collect();
    let errors: String = pictures.errors.iter().map(figure).collect::<Result<_>>()?;
    let comparison = &story.verdict.against_truth;
    let [a, b, c] = story.verdict.limits.metres().map(|limit_m| (limit_m * 1e6).round() / 1e6);
    Ok(format!(
        "<h2>Against the truth</h2>\n{}<p class=\"faint\">{} of {} pixels, the ones all four DTMs have. Untrained: coarse DTM plus photoclinometry, the \
         pipeline with a network that corrects nothing. Slopes are Horn's over \
         3 × 3 pixels of {} m. Errors are DTM minus truth. The coarse DTM carries an error that changes slowly over hundreds of \
         metres, as global DTMs do; an image does not tell it, so that heights gain less than slopes. \
         Maps: white within {a} m, then classes up to {b} m, up to {c} m and beyond; reds are too high, blues too low.</p>\n\
         <div class=\"grid\">\n{errors}</div>\n",
        table(&[&[""], NAMES.as_slice()].concat(), &rows),
        comparison.common_pixels,
        comparison.truth_pixels,
        comparison.pixel.row_m,
    ))
}

fn training(story: &Story, pictures: &Pictures) -> Result<String> {
    let (tuned, recipe) = (&story.tuned, &story.settings.recipe);
    let kept = if tuned.improved {
        "The tour went on with the trained weights."
    } else {
        "Training found nothing better than what it started from, so the tour went on with that."
    };
    let (before, after) = (&tuned.before, &tuned.after);
    let row = |name: &str, figure: fn(&TileScores) -> f64| {
        let all = [Some(&before.coarse), before.untrained.as_ref(), Some(&before.network), Some(&after.network)];
        let cell = |scores: Option<&TileScores>| {
            Cell::plain(scores.map_or_else(|| "–".into(), |scores| format!("{:.2}", figure(scores))))
        };
        std::iter::once(Cell::plain(name)).chain(all.map(cell)).collect::<Vec<_>>()
    };
    let rows = [
        row("Height RMSE, m", |s| s.rmse_m),
        row("Height MAE, m", |s| s.mae_m),
        row("Slope MAE, °", |s| s.slope_mae_deg),
    ];
    Ok(format!(
        "<h2>Training</h2>\n<p>{} parameters, from {}, {} steps of {} crops of {} × {} pixels at a learning rate of {:.0e} falling to \
         0 ({:.2} steps/s), on tiles of Moons of other seeds with the scene's kind of ground and the Sun {:.0}° to {:.0}° high. {kept} \
         Below: {} tiles held out, scored by the truth with the coarse DTM's long wavelengths, as trained for; \
         the weights with the lowest RMSE in normalised units are the best.</p>\n{}\
         <div class=\"chart\">{}</div>\n",
        tuned.parameters,
        escaped(&tuned.started_from),
        recipe.steps,
        recipe.batch,
        recipe.crop[0],
        recipe.crop[1],
        recipe.learning_rate,
        tuned.steps_per_s,
        tuned.sun_deg.0,
        tuned.sun_deg.1,
        recipe.validation_tiles,
        table(&["", NAMES[0], NAMES[1], "before", "best of the run"], &rows),
        figure(&pictures.curves)?
    ))
}

fn int8(story: &Story) -> String {
    let shrunk = &story.shrunk;
    let megabytes = |bytes: usize| format!("{:.2} MB", bytes as f64 / 1e6);
    let mut rows = vec![
        ("Float weights".to_string(), megabytes(shrunk.float_bytes)),
        ("Model file (flash)".into(), megabytes(shrunk.flash_bytes)),
        ("Working memory (RAM)".into(), megabytes(shrunk.arena_bytes)),
        ("Multiply-accumulates per tile of 256 × 320".into(), format!("{:.3} G", shrunk.macs as f64 / 1e9)),
        ("Operators".into(), shrunk.operators.to_string()),
    ];
    if let Some(ground) = &shrunk.comparison.ground {
        let tiles = shrunk.comparison.tiles;
        let difference = format!("{:.3} m, {:.3}°", ground.rmse_m, ground.slope_rmse_deg);
        rows.push((format!("Int8 minus float, heights and slopes, RMS over {tiles} new tiles"), difference));
    }
    let on_scene = &story.verdict.int8_against_float;
    let difference = format!("{:.3} m, {:.3}°", on_scene.rmse_m, on_scene.slope_rmse_deg);
    rows.push(("The same over the scene".into(), difference));
    rows.push(("Largest height difference on the scene".into(), format!("{:.2} m", on_scene.largest_m)));
    for predicted in &story.predicted {
        let name = format!("The scene with {}, {} tiles", predicted.name, predicted.made.tally.tiles);
        rows.push((name, minutes(predicted.seconds)));
    }
    let rows: Vec<Vec<Cell>> =
        rows.into_iter().map(|(name, figure)| vec![Cell::plain(name), Cell::plain(figure)]).collect();
    format!(
        "<h2>The int8 model</h2>\n<p>Batch norm folded, ranges measured on {} tiles of yet another Moon, weights of 8 bits, maps of 8 \
         bits with 16 where 8 would show in the DTM. The runner uses integers only, no heap, and gives the same bytes on every \
         machine; times are of this machine and of this build.</p>\n{}",
        story.settings.calibration_tiles,
        table(&["", "measured"], &rows)
    )
}

fn commands(story: &Story) -> String {
    let (scene, tuned, seeds) = (&story.scene, &story.tuned, story.seeds);
    let kind = format!("{:?}", scene.about.kind).to_lowercase();
    let (rows, cols) = (scene.truth.rows, scene.truth.cols);
    let start = match &story.settings.start {
        InitialWeights::Weights(path) if path.as_os_str() == SHIPPED_MODEL => {
            "--start-from host-train/models/nano.safetensors".to_string()
        }
        InitialWeights::Weights(path) => format!("--start-from {}", path.display()),
        InitialWeights::Scratch(_) => "--preset nano".into(),
    };
    let moon =
        format!("--rows 256 --cols 320 --kind {kind} --sun-elevation-deg {} {}", tuned.sun_deg.0, tuned.sun_deg.1);
    let files: Vec<String> = ["image", "coarse", "truth"].map(|what| format!("scenes/{}", scene.file(what))).into();
    let recipe = &story.settings.recipe;
    let text = format!(
        "# a scene; tiles to train, to validate and to calibrate on\n\
         host-train synth --out scenes --scenes 1 --seed {} --rows {rows} --cols {cols}\n\
         host-train synth --out tiles --scenes 240 --seed {} {moon}\n\
         host-train synth --out held-out --scenes {} --seed {} {moon}\n\
         host-train synth --out calibration --scenes 10 --seed {} {moon}\n\
         # training, export, prediction (also with {FLOAT_MODEL}), evaluation\n\
         host-train train {start} --data tiles --validation held-out --steps {} --learning-rate {:e} --out run\n\
         host-train export --weights run/best.safetensors --calibrate calibration -o {INT8_MODEL}\n\
         host-train predict --image {} --coarse {} --model {INT8_MODEL} --sun-azimuth {:.1} -o dtm.tif\n\
         host-train evaluate --dtm dtm.tif --truth {} --coarse {} --error-map error.png\n",
        seeds.scene,
        seeds.training,
        recipe.validation_tiles,
        seeds.validation,
        seeds.calibration,
        recipe.steps,
        recipe.learning_rate,
        files[0],
        files[1],
        scene.about.sun_azimuth_deg,
        files[2],
        files[1],
    );
    format!(
        "<h2>Each step alone</h2>\n<p>With <code>cargo run -p host-train --</code> in place of <code>host-train</code>; \
         <code>--help</code> of every command tells more. The tour makes its training tiles as it goes, so a run on the 240 tiles \
         below ends a little differently.</p>\n<pre>{}</pre>\n",
        escaped(&text)
    )
}

fn provenance(story: &Story) -> String {
    let times: Vec<Vec<Cell>> =
        story.times.iter().map(|step| vec![Cell::plain(&step.title), Cell::plain(minutes(step.seconds))]).collect();
    let models: String =
        story.predicted.iter().map(|p| format!("<li><code>{}</code></li>\n", escaped(&p.model))).collect();
    let seeds = story.seeds;
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    format!(
        "<h2>How this page was made</h2>\n<p>host-train {}, <code>demo --seed {} --steps {}</code>, on a machine with {threads} hardware \
         threads. Moons: scene {}, training {}, validation {}, calibration {}. The same seed on the same machine gives the \
         same scene and, with the default backend, the same weights.</p>\n<ul>\n{models}</ul>\n{}",
        env!("CARGO_PKG_VERSION"),
        story.settings.seed,
        story.settings.recipe.steps,
        seeds.scene,
        seeds.training,
        seeds.validation,
        seeds.calibration,
        table(&["Step", "time"], &times)
    )
}
