//! `host-train devices`: lists the devices of every backend.

use elunar_base::Result;
use elunar_learn::model::backend::Backend;

/// Options of `devices`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
`--backend auto` of other commands takes the first GPU of this list, or flex if there is none. bf16: whether --precision bf16 \
works.

Example:
  host-train devices")]
pub struct Args {}

/// Runs the command.
///
/// # Errors
/// None: a backend without a device has a line that says so.
pub fn run(_: &Args) -> Result<()> {
    for backend in Backend::ALL {
        let name = backend.name();
        if !backend.is_built() {
            println!("{name:8} not in this build (--features {name})");
            continue;
        }
        let found = backend.found()?;
        if found.is_empty() {
            println!("{name:8} no device: expected {}", backend.wants());
        }
        for (i, device) in found.iter().enumerate() {
            let kind = if device.gpu { "GPU" } else { "processor" };
            let bf16 = if device.bf16 { "bf16" } else { "no bf16" };
            println!("{name:8} {i}  {kind:9}  {bf16:7}  {}", device.name);
        }
    }
    Ok(())
}
