//! From float weights to the model file of the runner.
