//! The proof that a model has passed its self test.

use super::ModelId;
use crate::nn::{RunError, Runner};

/// Holding one proves that a runner has computed the self test of this model, and found what the model says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SelfTestPassed(ModelId);

impl SelfTestPassed {
    /// Validates a self test that was begun by [`Runner::begin_self_test`] and is done.
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
