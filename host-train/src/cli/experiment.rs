//! `host-train experiment`: runs experiments and writes their comparison.

use crate::config::Configuration;
use crate::experiment::{self, ExperimentOptions, table, train};
use crate::suite::list::List;
use elunar_base::{Error, Result, interrupt};
use std::path::{Path, PathBuf};

/// Options of `experiment`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Trains every experiment, validates it (Table V of the paper), and tests all on the same scenes (Table VI). Does not train a \
finished one again; after Ctrl-C or a kill, the same command with --resume goes on. Writes comparison.md, .json and .csv, and \
the test's tables and pictures; `report` makes a page of the folder. host-train/docs/experiments.md says how to write an \
experiment.

Examples:
  host-train experiment host-train/experiments/*.toml --out out/experiments
  host-train experiment host-train/experiments/full.toml --seeds 5 --task 3 --out out/experiments
  host-train experiment host-train/experiments/full.toml host-train/experiments/no-coarse.toml --steps 200 --out out/short")]
pub struct Args {
    /// Files of the experiments.
    #[arg(required = true, value_name = "FILE.toml")]
    pub files: Vec<PathBuf>,
    /// Folder to write into; created if absent.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Number of training steps, instead of the number in the files.
    #[arg(long, value_name = "N")]
    pub steps: Option<usize>,
    /// Train every experiment from this many seeds: that of its file and the next ones. Their names end in -seedN.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub seeds: u64,
    /// Train only experiment K, counted from 1 in the order of files and seeds, as a task of a job array. It goes on if it was started. The
    /// same command without --task, with --resume, then tests and compares all.
    #[arg(long, value_name = "K")]
    pub task: Option<usize>,
    /// Continue experiments that were started.
    #[arg(long)]
    pub resume: bool,
    /// List of test scenes [default: built-in synthetic scenes].
    #[arg(long, value_name = "LIST.toml")]
    pub suite: Option<PathBuf>,
    /// Number of threads for the test scenes; 0 takes as many as the machine offers.
    #[arg(long, default_value_t = 0, value_parser = elunar::threads::number)]
    pub threads: usize,
}

/// Runs the command.
///
/// # Errors
/// If a file cannot be read, or training, testing or writing fails.
pub fn run(args: Args) -> Result<()> {
    let list = args.suite.as_deref().map_or_else(List::built_in, List::read)?;
    let read = |path: &PathBuf| {
        let experiment = Configuration::read(path)?;
        args.steps.map_or(Ok(experiment.clone()), |steps| experiment.with_steps(steps))
    };
    let experiments: Vec<Configuration> = args.files.iter().map(read).collect::<Result<_>>()?;
    let experiments: Vec<Configuration> = experiments.iter().flat_map(|one| one.with_seeds(args.seeds)).collect();
    if let Some(task) = args.task {
        return run_task(&experiments, task, &args.out);
    }
    interrupt::listen();
    let manner = ExperimentOptions { resume: args.resume, threads: args.threads };
    let found = experiment::run(&experiments, &list, &args.out, manner, &mut |line| elunar_base::say::note(line))?;
    print!("{}", table::validation(&found).markdown());
    println!();
    print!("{}", crate::suite::tables::sums(&found.test).markdown());
    let out = args.out.display();
    println!("\n{out}: comparison.md, .json, .csv and pictures; a page of it: host-train report {out} -o report.html");
    Ok(())
}

/// Trains one experiment. Its training owns the folder of the experiment alone, so that tasks run side by side.
fn run_task(experiments: &[Configuration], task: usize, out: &Path) -> Result<()> {
    let all = experiments.len();
    let wrong = || Error::usage(format!("--task: a number from 1 to {all} expected, {task} found"));
    let experiment = task.checked_sub(1).and_then(|index| experiments.get(index)).ok_or_else(wrong)?;
    let trained =
        train::train(experiment, &out.join(&experiment.name), true, &mut |line| elunar_base::say::note(line))?;
    let network = &trained.validation.network;
    println!("{}: RMSE {:.3} m, slope error {:.3}°", experiment.name, network.rmse_m, network.slope_mae_deg);
    Ok(())
}
