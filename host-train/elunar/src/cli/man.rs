//! `elunar man`: manual pages of all commands.

use super::Cli;
use crate::outputs as output;
use clap::CommandFactory;
use elunar_base::{Error, Result, atomic_write};
use std::path::PathBuf;

/// Options of `man`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  elunar man man1")]
pub struct Args {
    /// Folder for elunar.1 and a page of each command, elunar-predict.1 and so on. It must exist.
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// [`Error::Io`] if a page cannot be written.
pub fn run(args: &Args) -> Result<()> {
    let mut program = Cli::command().disable_help_subcommand(true);
    // Global options reach the commands.
    program.build();
    let pages: Vec<(PathBuf, Vec<u8>)> = std::iter::once(&program)
        .chain(program.get_subcommands())
        .map(|command| {
            let (man, mut page) = (clap_mangen::Man::new(command.clone()), vec![]);
            let path = args.folder.join(man.get_filename());
            man.render(&mut page).map_err(Error::io(&path))?;
            Ok((path, page))
        })
        .collect::<Result<_>>()?;
    let _owners = output::take_all(pages.iter().map(|(path, _)| path), &[])?;
    pages.iter().try_for_each(|(path, page)| atomic_write(path, page))?;
    println!("{}: {} pages", args.folder.display(), pages.len());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_has_a_page_that_names_its_options() {
        let folder = tempfile::tempdir().unwrap();
        run(&Args { folder: folder.path().into() }).unwrap();
        let page = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
        assert!(page("elunar-predict.1").contains("coarse\\-sigma") && page("elunar.1").contains("elunar\\-predict"));
        for command in Cli::command().get_subcommands() {
            assert!(page(&format!("elunar-{}.1", command.get_name())).starts_with(".ie"), "{}", command.get_name());
        }
        assert!(run(&Args { folder: folder.path().join("absent") }).is_err());
    }
}
