//! How much a program says besides its results, and how. All commands have these options.

use elunar_base::say::{Amount, choose};

/// Options of all commands.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct Talk {
    /// Say errors and results alone: no progress, warnings and notes.
    #[arg(short, long, global = true, conflicts_with = "verbose", help_heading = "All commands")]
    pub quiet: bool,
    /// Say also what was chosen and how long it took.
    #[arg(short, long, global = true, help_heading = "All commands")]
    pub verbose: bool,
    /// Form of progress, warnings and notes on stderr: for people, or for programs as JSON lines, one object each.
    #[arg(long, global = true, value_name = "FORM", default_value = "text", help_heading = "All commands")]
    pub progress: Form,
}

/// Form of what is said.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Form {
    /// Text, and bars on a terminal.
    #[default]
    Text,
    /// JSON lines.
    Json,
}

impl Talk {
    /// Lets the program speak so from now on.
    pub fn begin(self) {
        let amount = match self {
            Self { quiet: true, .. } => Amount::Quiet,
            Self { verbose: true, .. } => Amount::Verbose,
            _ => Amount::Usual,
        };
        choose(amount, self.progress == Form::Json);
    }
}
