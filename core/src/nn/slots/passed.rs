//! The proof that a model has passed its self test.

use super::ModelId;
use crate::nn::{RunError, Runner};

/// Evidence that a runner has computed the self test of this model with the result that the model contains.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SelfTestPassed(ModelId);

impl SelfTestPassed {
    /// Compares the result of a self test that was begun by [`Runner::begin_self_test`] and is done.
    ///
    /// # Errors
    /// Those of [`Runner::check_self_test`].
    pub fn of(runner: &mut Runner<'_, '_>) -> Result<Self, RunError> {
        runner.check_self_test()?;
        Ok(Self(ModelId::of(runner.model().raw().bytes())))
    }

    pub(super) fn id(self) -> ModelId {
        self.0
    }
}
