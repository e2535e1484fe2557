//! Errors as Python's exceptions. The kind is that of the programs' exit codes, the text their one line.

use elunar::program::{code_of, kind_of};
use elunar_base::Error;
use pyo3::exceptions::{PyMemoryError, PyRuntimeError};
use pyo3::prelude::*;
use pyo3::types::PyType;

/// Returns the exception for an error.
pub(crate) fn raise(py: Python<'_>, error: &Error) -> PyErr {
    named(py, kind_of(code_of(error)), error.to_string())
}

/// Returns the exception for a kind of error.
pub(crate) fn named(py: Python<'_>, kind: &str, text: String) -> PyErr {
    let class = match kind {
        "usage" => "UsageError",
        "bad_input" => "InputError",
        "try_again" => "TryAgainError",
        "no_memory" => return PyMemoryError::new_err(text),
        _ => return PyRuntimeError::new_err(text),
    };
    let class = py.import("elunardtm._errors").and_then(|module| module.getattr(class));
    match class.and_then(|class| Ok(class.cast_into::<PyType>()?)) {
        Ok(class) => PyErr::from_type(class, text),
        Err(missing) => missing,
    }
}
