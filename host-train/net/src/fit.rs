//! Check that weights fit a configuration.

use crate::weights::NetWeights;
use elunar_base::{Error, Result};
use std::collections::BTreeMap;
use std::path::Path;

/// Checks that `found` holds every tensor of `expected` in its shape, that all numbers are finite, and that there is no other tensor.
/// Messages call the file `path`.
///
/// # Errors
/// [`Error::Broken`] with a list of all misfits.
pub fn check_fit(expected: &BTreeMap<String, Vec<usize>>, found: &NetWeights, path: &Path) -> Result<()> {
    let mut misfits = Vec::new();
    for (name, shape) in expected {
        match found.tensors.get(name) {
            None => misfits.push(format!("{name}: expected {shape:?}, found none")),
            Some(array) if array.shape != *shape => {
                misfits.push(format!("{name}: expected {shape:?}, found {:?}", array.shape));
            }
            Some(array) if array.data.iter().any(|v| !v.is_finite()) => {
                misfits.push(format!("{name}: expected finite numbers, found NaN or infinity"));
            }
            Some(_) => {}
        }
    }
    let extra = found.tensors.iter().filter(|(name, _)| !expected.contains_key(*name) && !is_payload(name));
    misfits.extend(extra.map(|(name, array)| format!("{name}: expected none, found {:?}", array.shape)));
    if misfits.is_empty() {
        return Ok(());
    }
    let what = format!("the weights do not fit the configuration ({} misfits): {}", misfits.len(), misfits.join("; "));
    Err(Error::broken(path, what))
}

/// Returns whether a name is not a parameter. Golden files hold their inputs and outputs beside the weights.
fn is_payload(name: &str) -> bool {
    name.starts_with("input.") || name.starts_with("trace.") || name == "output" || name == "truth"
}
