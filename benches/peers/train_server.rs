//! Runs training steps with input and output by pipes, so that they can be measured in turn with those of PyTorch; see `README.md`.
//!
//! `train_server WEIGHTS.safetensors BATCH ROWS COLS` takes one batch on standard input (images, coarse DTMs, truths, each
//! `[BATCH, maps, ROWS, COLS]`, little-endian `f32`). Then it answers every line with a number N by training N steps on that batch and
//! printing one line of JSON: the total seconds, and the loss before each step. The backend is flex; the recipe is that of `tiny` and
//! `nano` with a constant learning rate.

use elunar_learn::model::backend::Backend;
use elunar_learn::train::recipe::Recipe;
use elunar_learn::train::step::Trainer;
use elunar_net::config::Preset;
use elunar_net::config::config_of;
use elunar_net::weights::NetWeights;
use std::error::Error;
use std::io::{BufRead, Read, Write};
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let result = match &arguments[..] {
        [path, batch, rows, cols] => serve(Path::new(path), [batch, rows, cols]),
        _ => Err("expected WEIGHTS.safetensors BATCH ROWS COLS".into()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("ERROR: train_server: {error}");
            ExitCode::FAILURE
        }
    }
}

fn serve(path: &Path, size: [&String; 3]) -> Result<(), Box<dyn Error>> {
    let [batch, rows, cols] = size.map(|n| n.parse::<usize>());
    let size = [batch?, rows?, cols?];
    // With so many steps the cosine schedule stays constant.
    let recipe = Recipe { warm_up: 0, steps: 1_000_000_000, ..Recipe::preset(Preset::Nano) };
    let weights = NetWeights::read(path)?;
    let config = config_of(&weights, path)?;
    let mut trainer = Trainer::new(&config, &recipe, &weights, path, vec![Backend::Flex.device()?])?;
    let mut input = std::io::stdin().lock();
    let mut maps = |count: usize| -> Result<Vec<f32>, Box<dyn Error>> {
        let mut bytes = vec![0; 4 * count * size.iter().product::<usize>()];
        input.read_exact(&mut bytes)?;
        Ok(bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
    };
    let maps = trainer.tensors([maps(config.image_maps())?, maps(1)?, maps(1)?], size);
    let mut done = 0;
    for line in input.lines() {
        let steps: usize = line?.trim().parse()?;
        let (start, mut losses) = (Instant::now(), Vec::new());
        for _ in 0..steps {
            losses.push(trainer.step(&recipe, done, vec![maps.clone()])?.loss);
            done += 1;
        }
        let seconds = start.elapsed().as_secs_f64();
        let mut output = std::io::stdout().lock();
        writeln!(output, r#"{{"seconds": {seconds}, "losses": {losses:?}}}"#)?;
        output.flush()?;
    }
    Ok(())
}
