//! The error type of all ground programs. Every message names the thing, what was expected and what was found.

use std::path::{Path, PathBuf};

/// Short form of a result with [`Error`].
pub type Result<T> = std::result::Result<T, Error>;

/// An error, of one of seven kinds. The kind decides the exit code of a program.
#[derive(Debug)]
pub enum Error {
    /// The content of the file is not valid in its format (truncated, bit-flipped, contradictory).
    Broken {
        /// The file.
        path: PathBuf,
        /// What was expected and what was found.
        what: String,
    },
    /// The file is valid, but uses something that this program does not read.
    Unsupported {
        /// The file.
        path: PathBuf,
        /// What was found, and what is supported.
        what: String,
    },
    /// The request cannot be met: impossible options, an output that must not be written.
    Usage(String),
    /// The inputs are readable, but do not serve: wrong sizes, no overlap, no valid pixel.
    Input(String),
    /// The run stopped at a safe point, because it was asked to. The same command goes on.
    Stopped(String),
    /// The operating system reported an error.
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// Another process writes the output. The request may be met later.
    Busy {
        /// The output.
        path: PathBuf,
        /// Who writes it, and what to do.
        what: String,
    },
}

impl Error {
    /// Makes an [`Error::Broken`] about `path`.
    pub fn broken(path: impl AsRef<Path>, what: impl Into<String>) -> Self {
        Self::Broken { path: path.as_ref().into(), what: what.into() }
    }

    /// Makes an [`Error::Unsupported`] about `path`.
    pub fn unsupported(path: impl AsRef<Path>, what: impl Into<String>) -> Self {
        Self::Unsupported { path: path.as_ref().into(), what: what.into() }
    }

    /// Makes an [`Error::Usage`].
    pub fn usage(what: impl Into<String>) -> Self {
        Self::Usage(what.into())
    }

    /// Makes an [`Error::Busy`] about `path`.
    pub fn busy(path: impl AsRef<Path>, what: impl Into<String>) -> Self {
        Self::Busy { path: path.as_ref().into(), what: what.into() }
    }

    /// Makes an [`Error::Input`].
    pub fn input(what: impl Into<String>) -> Self {
        Self::Input(what.into())
    }

    /// Makes an [`Error::Stopped`].
    pub fn stopped(what: impl Into<String>) -> Self {
        Self::Stopped(what.into())
    }

    /// Says what the message is about: before it, or, if it begins with a file, behind it. The kind stays.
    #[must_use]
    pub fn about(self, what: &str) -> Self {
        match self {
            Self::Usage(text) => Self::Usage(format!("{what}: {text}")),
            Self::Input(text) => Self::Input(format!("{what}: {text}")),
            Self::Stopped(text) => Self::Stopped(format!("{what}: {text}")),
            of_file => of_file.and(&format!(" ({what})")),
        }
    }

    /// Adds to the message. The kind stays.
    #[must_use]
    pub fn and(self, more: &str) -> Self {
        let add = |what: String| what + more;
        match self {
            Self::Broken { path, what } => Self::Broken { path, what: add(what) },
            Self::Unsupported { path, what } => Self::Unsupported { path, what: add(what) },
            Self::Busy { path, what } => Self::Busy { path, what: add(what) },
            Self::Usage(what) => Self::Usage(add(what)),
            Self::Input(what) => Self::Input(add(what)),
            Self::Stopped(what) => Self::Stopped(add(what)),
            Self::Io { path, source } => {
                let source = std::io::Error::new(source.kind(), add(source.to_string()));
                Self::Io { path, source }
            }
        }
    }

    /// Makes an [`Error::Io`] about `path`, for `map_err`.
    pub fn io(path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.as_ref().to_path_buf();
        move |source| Self::Io { path, source }
    }
}

impl std::fmt::Display for Error {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Broken { path, what } => write!(f, "{}: broken file: {what}", path.display()),
            Self::Unsupported { path, what } => write!(f, "{}: not supported: {what}", path.display()),
            Self::Busy { path, what } => write!(f, "{}: another run writes it: {what}", path.display()),
            Self::Usage(what) | Self::Input(what) | Self::Stopped(what) => f.write_str(what),
            Self::Io { path, source } => write!(f, "{}: {source}", path.display()),
        }
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Io { source, .. } => Some(source),
            _ => None,
        }
    }
}
