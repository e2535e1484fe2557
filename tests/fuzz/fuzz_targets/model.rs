//! Any bytes are a model that runs without memory errors, or refused: as the whole file, and as changes to a valid model.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    elunar_provoke::model::raw_model(bytes);
    elunar_provoke::model::mutated_model(bytes);
});
