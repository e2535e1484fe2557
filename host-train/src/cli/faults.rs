//! `host-train faults`: measures the effect of bit flips on a tile or a strip.

use crate::faults::{
    Campaign, CampaignJournal, CampaignResults, FaultOutcome, InjectionTarget, Moments, StripCampaign, markdown,
    picture, run, run_strip,
};
use elunar_base::output::Owner;
use elunar_base::{Error, Result, atomic_write, interrupt, progress};
use elunar_picture::write_png;
use elunar_scene::predict::int8::{self, Int8Model};
use elunar_scene::predict::network::TileModel as _;
use std::path::PathBuf;

/// Options of `faults`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Flips one or two bits in the model, in the memory of a tile at work, or in its place, and lets the tile go on; with --strip in the memory \
of a strip of lines. Writes faults.md, \
faults.png and injections.csv; after a stop the same command goes on. --unprotected shows what the runner's checks bring.

Examples:
  host-train faults nano.eld --injections 100000 --out out/faults
  host-train faults nano.eld --injections 7000 --unprotected")]
pub struct Args {
    /// Model: `ground` or `nano`, which are in this program, or an `.eld` file.
    #[arg(value_name = "MODEL.eld")]
    pub model: PathBuf,
    /// Number of injections.
    #[arg(long, default_value_t = 7_000, value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    pub injections: u64,
    /// Seed of the injections and of the tile.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Number of threads; 0 takes as many as the machine offers.
    #[arg(long, default_value_t = 0, value_parser = elunar::threads::number)]
    pub threads: usize,
    /// Run the runner without checks of its memory.
    #[arg(long, conflicts_with = "strip")]
    pub unprotected: bool,
    /// Flip bits in what a strip keeps between its calls.
    #[arg(long)]
    pub strip: bool,
    /// Folder for the table and the picture.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// Number of moments of the run at which bits flip. Kinds of operators without a moment get one more.
const MOMENTS: usize = 64;

/// The files in its folder: table, picture, journal.
const FILES: [&str; 3] = ["faults.md", "faults.png", "injections.csv"];

/// Runs the command.
///
/// # Errors
/// If the model cannot be read, or a run hung or crashed.
pub fn run_command(args: &Args) -> Result<()> {
    interrupt::listen();
    let model = int8::open(&args.model)?;
    let owner = args.out.as_deref().map(|out| Owner::of_folder(out, "faults", FILES.map(String::from)));
    let _owner = owner.transpose()?;
    let subject = FaultSubject::record(args, &model)?;
    let available = std::thread::available_parallelism().map_or(1, |n| n.get());
    let threads = if args.threads == 0 { available } else { args.threads };
    let campaign = Campaign { injections: args.injections, seed: args.seed, threads };
    let (moments, heights) = subject.identity();
    let what = format!("seed {}, {moments} moments, {}", args.seed, subject.kind());
    let journal = args.out.as_deref().map(|out| {
        CampaignJournal::open(&out.join(FILES[2]), &format!("{what}; {}, heights {heights}", model.description()))
    });
    let journal = journal.transpose()?;
    let known = journal.as_ref().map_or(0, |journal| journal.count_below(args.injections));
    let bar = progress::bar("", args.injections, "injections").with_position(known);
    // The work of an earlier run does not count for this run's rate.
    bar.reset_eta();
    // Panics are counted, but not printed.
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| {}));
    let results = subject.run(&model, &campaign, journal.as_ref(), || bar.inc(1));
    std::panic::set_hook(hook);
    bar.finish_and_clear();
    let results = results?;
    let done = results.all().all();
    let mut text = format!("{done} injections, {what}\n\n{}", markdown(&results));
    if done < args.injections {
        text.push_str(&format!("\nStopped after {done} of {} injections.\n", args.injections));
    }
    println!("{text}");
    if let Some(out) = &args.out {
        let path = out.join(FILES[0]);
        atomic_write(&path, text.as_bytes())?;
        write_png(&out.join(FILES[1]), picture(&results)?)?;
        println!("{}: {}", out.display(), FILES.join(", "));
    }
    if done < args.injections {
        let goes_on = if args.out.is_some() { "; the same command goes on from there" } else { "" };
        return Err(Error::stopped(format!("stopped after {done} of {} injections{goes_on}", args.injections)));
    }
    let all = results.all();
    let (hangs, crashes) = (all.of(FaultOutcome::Hang), all.of(FaultOutcome::Crash));
    if hangs + crashes > 0 {
        return Err(Error::input(format!("faults: expected no hang and no crash, found {hangs} and {crashes}")));
    }
    if args.strip {
        println!("silent: {} of {done}", all.of(FaultOutcome::Silent));
        return Ok(());
    }
    let silent = |target: InjectionTarget| 100.0 * results.of(target).share(FaultOutcome::Silent);
    println!(
        "silent: {:.3} % of flips in constants, {:.3} % in maps",
        silent(InjectionTarget::Constants),
        silent(InjectionTarget::Maps)
    );
    Ok(())
}

/// What bits flip in.
enum FaultSubject<'a> {
    Tile(Moments),
    Strip(Box<StripCampaign<'a>>),
}

impl<'a> FaultSubject<'a> {
    fn record(args: &Args, model: &'a Int8Model) -> Result<Self> {
        Ok(match args.strip {
            true => Self::Strip(Box::new(StripCampaign::record(model, args.seed, MOMENTS)?)),
            false => Self::Tile(Moments::record(model, args.seed, MOMENTS, !args.unprotected)?),
        })
    }

    fn kind(&self) -> &'static str {
        match self {
            Self::Strip(_) => "memory of a strip",
            Self::Tile(moments) if moments.protected => "with protection",
            Self::Tile(_) => "without protection",
        }
    }

    /// Returns the number of moments, and the digest of the clean run's heights.
    fn identity(&self) -> (usize, String) {
        match self {
            Self::Strip(strip) => (strip.moments(), strip.digest()),
            Self::Tile(moments) => (moments.moments.len(), moments.digest()),
        }
    }

    fn run(
        &self,
        model: &Int8Model,
        campaign: &Campaign,
        journal: Option<&CampaignJournal>,
        progress: impl Fn() + Sync,
    ) -> Result<CampaignResults> {
        match self {
            Self::Strip(strip) => run_strip(strip, campaign, journal, progress),
            Self::Tile(moments) => run(model, moments, campaign, journal, progress),
        }
    }
}
