//! Flips bits in registers, stack and code of a process that makes a tile, by the debugger's interface of Linux on x86-64. Each injection can be
//! made again from its line of the record.
//!
//! ```text
//! this program      draws injections, or reads a record; starts workers, collects their lines, draws table and picture
//!   worker          makes the tile a unit at a time; before the unit of an injection it copies itself
//!     copy          finishes the tile; its worker stops it at the injection's instruction and flips the bit
//! ```

#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod linux;
mod plan;
mod row;
mod table;
mod tile;

use clap::Parser;
use std::path::PathBuf;
use std::process::ExitCode;

/// Options.
#[derive(Debug, Clone, Parser)]
#[command(about = "Flips bits in registers, stack and code while a tile is made, and records what comes of it.")]
pub(crate) struct Args {
    /// Model with tiles of the golden flight tile's size.
    #[arg(value_name = "MODEL.eld")]
    pub(crate) model: PathBuf,
    /// Folder for `injections.csv`, `inject.md` and `inject.png`.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Number of injections of each class.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    pub(crate) injections: u64,
    /// Seed of what is drawn. The moments are taken by a clock; a record has them.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Makes the injections of this record again, instead of new ones.
    #[arg(long, value_name = "CSV")]
    pub(crate) replay: Option<PathBuf>,
    /// Number of workers.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u64).range(1..=256))]
    pub(crate) workers: u64,
    /// Does not compare the program with its checksum at the end of a tile.
    #[arg(long)]
    pub(crate) trust_code: bool,
    /// Kernel, by the start of its name.
    #[arg(long, default_value = "scalar")]
    pub(crate) kernel: String,
    /// Folder of the tile.
    #[arg(long, default_value = concat!(env!("CARGO_MANIFEST_DIR"), "/../golden/flight_tile"))]
    pub(crate) tile: PathBuf,
    /// For this program's own use: a worker looks at so many moments (0: makes the injections of its input).
    #[arg(long, hide = true)]
    pub(crate) worker: Option<u64>,
}

fn main() -> ExitCode {
    match plan::run(&Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("ERROR: {error}");
            ExitCode::FAILURE
        }
    }
}
