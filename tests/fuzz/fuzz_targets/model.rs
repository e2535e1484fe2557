//! Any bytes are a model that runs without harm, or refused: as they are, and as changes to a sound model.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    elunar_provoke::model::raw_model(bytes);
    elunar_provoke::model::mutated_model(bytes);
});
