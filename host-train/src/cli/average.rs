//! `host-train average`: takes the mean of several weight files.

use elunar::outputs as output;
use elunar_base::{Error, Result};
use elunar_net::config::config_of;
use elunar_net::weights::NetWeights;
use std::path::PathBuf;

/// Options of `average`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
For runs that started from the same weights: their mean is often better than each of them (Wortsman et al. 2022). The mean of \
weights from different random starts is useless.

Example:
  host-train average runs/a/best.safetensors runs/b/best.safetensors -o both.safetensors")]
pub struct Args {
    /// Weight files of one network, at least two.
    #[arg(required = true, num_args = 2.., value_name = "W.safetensors")]
    pub weights: Vec<PathBuf>,
    /// File to write.
    #[arg(short, long, value_name = "W.safetensors")]
    pub output: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// If a file cannot be read, belongs to another network than the first, or the mean cannot be written.
pub fn run(args: Args) -> Result<()> {
    let _owner = output::take(&args.output, &args.weights.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
    let read = |path: &PathBuf| {
        let weights = NetWeights::read(path)?;
        Ok((config_of(&weights, path)?, weights))
    };
    let (first, rest) = args.weights.split_first().ok_or_else(|| Error::usage("expected weight files, found none"))?;
    let (config, mut sum) = read(first)?;
    for path in rest {
        let (other, weights) = read(path)?;
        if other != config {
            let what = format!("expected the network of {}, found another", first.display());
            return Err(Error::broken(path, what));
        }
        sum.add(&weights).map_err(|what| Error::broken(path, format!("{what} as in {}", first.display())))?;
    }
    let share = 1.0 / args.weights.len() as f32;
    sum.tensors.values_mut().flat_map(|array| &mut array.data).for_each(|value| *value *= share);
    sum.write(&args.output)?;
    println!("{}: mean of {} files, {} tensors", args.output.display(), args.weights.len(), sum.tensors.len());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_learn::model::init::initial_weights;
    use elunar_net::config::miniature_network;

    #[test]
    fn the_mean_lies_in_the_middle_and_strangers_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let (a, b) = (initial_weights(&miniature_network(), 1), initial_weights(&miniature_network(), 2));
        a.write(&path("a")).unwrap();
        b.write(&path("b")).unwrap();
        let average =
            |names: &[&str]| run(Args { weights: names.iter().map(|name| path(name)).collect(), output: path("mean") });
        average(&["a", "b", "b", "b"]).unwrap();
        let mean = NetWeights::read(&path("mean")).unwrap();
        assert_eq!((&mean.metadata, mean.tensors.len()), (&a.metadata, a.tensors.len()));
        for (name, array) in &mean.tensors {
            for ((m, a), b) in array.data.iter().zip(&a.tensors[name].data).zip(&b.tensors[name].data) {
                assert!((m - (0.25 * a + 0.75 * b)).abs() < 1e-6, "{name}");
            }
        }
        average(&["a", "a"]).unwrap();
        assert!(NetWeights::read(&path("mean")).unwrap() == a);

        let mut other = miniature_network();
        other.stem = 8;
        initial_weights(&other, 1).write(&path("other")).unwrap();
        let refused = average(&["a", "other"]).unwrap_err().to_string();
        assert!(refused.contains("other") && refused.contains("found another"), "{refused}");
        let mut lacking = a.clone();
        let (name, _) = lacking.tensors.pop_first().unwrap();
        lacking.write(&path("lacking")).unwrap();
        let refused = average(&["a", "lacking"]).unwrap_err().to_string();
        assert!(refused.contains("lacking") && refused.contains(&name), "{refused}");
        assert!(NetWeights::read(&path("mean")).unwrap() == a, "a refusal touches nothing");
    }
}
