//! The status word that every function returns, and all its values.
//!
//! ```text
//!  31 30 29         24 23             16 15                              0
//! +-----+-------------+-----------------+---------------------------------+
//! | sev |  0 (unused) |      unit       |              code               |
//! +-----+-------------+-----------------+---------------------------------+
//! sev   0 good      done
//!       1 notice    done, and there is something to know
//!       2 refused   not done, and nothing has changed
//!       3 fault     memory has changed or a result is wrong: what the context or the model holds cannot be trusted
//! unit  what it is about: 1 the call, 2 the lent memory, 3 the model, 4 the tile, 5 the run, 6 the context, 7 the strip, 8 the slots
//! ```
//! (Severity, unit and code in one word follow cFE.) Values never change their meaning.

use crate::types::eld_status_t;
use core::ffi::CStr;

/// Done.
pub const GOOD: u32 = 0;
/// Done, with a notice for the caller.
pub const NOTICE: u32 = 1;
/// Not done; nothing has changed.
pub const REFUSED: u32 = 2;
/// Context, model or result cannot be trusted.
pub const FAULT: u32 = 3;

const NOTHING: u32 = 0;
const CALL: u32 = 1;
const MEMORY: u32 = 2;
const MODEL: u32 = 3;
const TILE: u32 = 4;
const RUN: u32 = 5;
const CONTEXT: u32 = 6;
const STRIP: u32 = 7;
const SLOTS: u32 = 8;

/// Returns the word of a severity, a unit and a code.
const fn word(severity: u32, unit: u32, code: u32) -> eld_status_t {
    severity << 30 | unit << 16 | code
}

/// Returns the severity of a status: [`GOOD`], [`NOTICE`], [`REFUSED`] or [`FAULT`].
pub const fn severity(status: eld_status_t) -> u32 {
    status >> 30
}

/// Returns whether the call did its work: good or notice.
pub const fn worked(status: eld_status_t) -> bool {
    severity(status) <= NOTICE
}

/// A status and its meaning.
#[derive(Debug, Clone, Copy)]
pub struct Known {
    /// The status word.
    pub status: eld_status_t,
    /// Name in C.
    pub name: &'static str,
    /// The meaning in one line, for C.
    pub text: &'static CStr,
}

/// Returns the text of a literal that ends with NUL; the compiler checks it.
const fn c_text(text: &'static str) -> &'static CStr {
    match CStr::from_bytes_with_nul(text.as_bytes()) {
        Ok(text) => text,
        Err(_) => c"",
    }
}

macro_rules! statuses {
    ($($name:ident = $severity:ident, $unit:ident, $code:literal, $text:literal;)*) => {
        $(#[doc = $text] pub const $name: eld_status_t = word($severity, $unit, $code);)*

        /// All statuses.
        pub static STATUSES: &[Known] =
            &[$(Known { status: $name, name: stringify!($name), text: c_text(concat!($text, "\0")) },)*];
    };
}

statuses! {
    ELD_OK = GOOD, NOTHING, 0, "done";

    ELD_RUNNING = NOTICE, RUN, 1, "the tile needs more steps";
    ELD_NOTICE_DROPPED = NOTICE, RUN, 2, "begun; the tile before was dropped unfinished";
    ELD_NOTICE_LIGHT_ASSUMED = NOTICE, TILE, 1, "begun; the tile does not show its light, so the light is assumed";
    ELD_NOTICE_DROPPED_LIGHT_ASSUMED = NOTICE, TILE, 2, "begun; the tile before was dropped unfinished, and the light is assumed";
    ELD_NOTICE_COARSE = NOTICE, TILE, 3, "begun; the image has no contrast or no light, or the coarse DTM no relief, so the heights will be the coarse DTM's";
    ELD_NOTICE_DROPPED_COARSE = NOTICE, TILE, 4, "begun; the tile before was dropped unfinished, and the heights will be the coarse DTM's";
    ELD_NOTICE_NO_LINE = NOTICE, CALL, 1, "done; no line of the maps came out: push the next one, or all are out";
    ELD_NOTICE_REPAIRED = NOTICE, CONTEXT, 1, "done; a damaged copy of the context was repaired from the other";

    ELD_NOTICE_STRIP_PUSH = NOTICE, STRIP, 1, "the strip needs a line, or its end";
    ELD_NOTICE_STRIP_POSTS = NOTICE, STRIP, 2, "the strip needs a row of posts, or their end, before its next line";
    ELD_NOTICE_STRIP_TAKE = NOTICE, STRIP, 3, "finished lines of the strip must be taken first";
    ELD_NOTICE_STRIP_DONE = NOTICE, STRIP, 4, "all tiles of the strip are done; its last lines can be taken";
    ELD_NOTICE_STRIP_NO_LINE = NOTICE, STRIP, 5, "no line of the strip is finished";

    ELD_NOTICE_SLOTS_TRIAL = NOTICE, SLOTS, 1, "the model on trial runs: run its self test, then confirm or reject it";
    ELD_NOTICE_SLOTS_SALVAGED = NOTICE, SLOTS, 2, "a model runs that was found without a record: run its self test, then confirm or reject it";

    ELD_REFUSED_NULL = REFUSED, CALL, 1, "a pointer is NULL";
    ELD_REFUSED_ALIGNMENT = REFUSED, CALL, 2, "a pointer is not aligned as its type demands";
    ELD_REFUSED_LENGTH = REFUSED, CALL, 3, "a length reaches beyond the address space";
    ELD_REFUSED_STRUCT_BYTES = REFUSED, CALL, 4, "struct_bytes is not the size of this library's structure";
    ELD_REFUSED_OVERLAP = REFUSED, CALL, 5, "a buffer overlaps another one, the lent memory or the model";
    ELD_REFUSED_BUFFER = REFUSED, CALL, 6, "a buffer is too short, or not of rows * cols samples";
    ELD_REFUSED_NO_TILE = REFUSED, CALL, 7, "no tile was begun";
    ELD_REFUSED_NOT_DONE = REFUSED, CALL, 8, "the tile is not finished";
    ELD_REFUSED_OTHER_TILE = REFUSED, CALL, 9, "the tile is the self test's where the caller's is asked for, or the other way round";
    ELD_REFUSED_NOT_BEGUN = REFUSED, CALL, 11, "the tile is not begun yet: call eld_begin_step until it is";
    ELD_REFUSED_NO_ERRORS = REFUSED, CALL, 10, "the model's maps are not weighed, so it expects no errors";

    ELD_REFUSED_OPTIONS = REFUSED, CALL, 12, "an option of the terrain maps is out of range";
    ELD_REFUSED_TIME = REFUSED, CALL, 15, "the time is not within the years 1900 to 2100";
    ELD_REFUSED_PLACE = REFUSED, CALL, 16, "the latitude is beyond 90 degrees, the longitude beyond 360, or one is no number";
    ELD_REFUSED_NOT_CHECKED = REFUSED, CALL, 14, "the check of the model is not finished: call eld_model_check_step until it is";
    ELD_REFUSED_UNFINISHED = REFUSED, CALL, 13, "lines of the grid before are not out yet: call eld_terrain_finish";

    ELD_REFUSED_MEMORY_SHORT = REFUSED, MEMORY, 1, "the lent memory is shorter than eld_model_check says";
    ELD_REFUSED_MEMORY_ALIGNMENT = REFUSED, MEMORY, 2, "the lent memory is not aligned as eld_model_check says";

    ELD_REFUSED_MODEL_MAGIC = REFUSED, MODEL, 1, "not a model file";
    ELD_REFUSED_MODEL_VERSION = REFUSED, MODEL, 2, "a model file of another format version";
    ELD_REFUSED_MODEL_ENDIANNESS = REFUSED, MODEL, 3, "a model file whose words have their bytes swapped";
    ELD_REFUSED_MODEL_LENGTH = REFUSED, MODEL, 4, "the model's length is not what its header says";
    ELD_REFUSED_MODEL_HEADER_CHECKSUM = REFUSED, MODEL, 5, "the checksum of the model's header does not match";
    ELD_REFUSED_MODEL_CHECKSUM = REFUSED, MODEL, 6, "a checksum of the model's body does not match";
    ELD_REFUSED_MODEL_HEADER = REFUSED, MODEL, 7, "a field of the model's header is out of range";
    ELD_REFUSED_MODEL_TENSOR = REFUSED, MODEL, 8, "a tensor of the model is not legal";
    ELD_REFUSED_MODEL_OPERATOR = REFUSED, MODEL, 9, "an operator of the model is not legal";
    ELD_REFUSED_MODEL_SCHEDULE = REFUSED, MODEL, 10, "the model's schedule is not legal";
    ELD_REFUSED_MODEL_SIZE = REFUSED, MODEL, 11, "the model needs more memory than this machine can address";
    ELD_REFUSED_MODEL_WORK = REFUSED, MODEL, 12, "validating the model takes more work than a file of its length may take";

    ELD_REFUSED_TILE_SIZE = REFUSED, TILE, 1, "a map of the tile does not have rows * cols samples";
    ELD_REFUSED_TILE_MASK = REFUSED, TILE, 2, "a byte of the mask is neither 0 nor 1";
    ELD_REFUSED_TILE_PIXEL = REFUSED, TILE, 3, "pixel_m or coarse_px is not finite and above 0";
    ELD_REFUSED_TILE_SUN = REFUSED, TILE, 4, "the Sun's azimuth is not within -360 to 360 degrees, or its elevation not above 0 and below 90; NaN stands for unknown";
    ELD_REFUSED_TILE_MASKED = REFUSED, TILE, 5, "no pixel of the tile is valid in both maps";
    ELD_REFUSED_TILE_POSTS = REFUSED, TILE, 9, "the posts are not whole rows, a number of their grid is not finite, or coarse_m is given as well";
    ELD_REFUSED_TILE_LIGHT = REFUSED, TILE, 11, "the light of the scene is none that eld_light_decide gives for this model";
    ELD_REFUSED_TILE_OPTION = REFUSED, TILE, 10, "network_alone or processor_checks is neither 0 nor 1";
    ELD_REFUSED_TILE_FORMAT = REFUSED, TILE, 8, "the image has no format of ELD_PIXELS_*, a gain or offset that is not finite, or flags that do not exist";

    ELD_REFUSED_STRIP_SETTINGS = REFUSED, STRIP, 1, "an overlap, a number of lines kept or a choice of the strip's settings that does not exist";
    ELD_REFUSED_STRIP_SIZE = REFUSED, STRIP, 2, "a strip without columns, or one that needs more memory than this machine can address";
    ELD_REFUSED_STRIP_GRID = REFUSED, STRIP, 3, "the grid of posts does not run along the strip";
    ELD_REFUSED_STRIP_FULL = REFUSED, STRIP, 4, "no room for a line or a row of posts: step, or take lines, first";
    ELD_REFUSED_STRIP_ENDED = REFUSED, STRIP, 5, "the end of the strip or of its posts was announced";
    ELD_REFUSED_STRIP_POSTS_FIRST = REFUSED, STRIP, 6, "the line needs another row of posts first";
    ELD_REFUSED_STRIP_NO_POSTS = REFUSED, STRIP, 7, "the strip's coarse heights come with its lines, not as posts";

    ELD_REFUSED_SLOTS_STORAGE = REFUSED, SLOTS, 1, "regions of the slots that cannot hold a record, or are not whole sectors";
    ELD_REFUSED_SLOTS_BUSY = REFUSED, SLOTS, 2, "other work on the slots is not finished: call eld_slots_step, or eld_slots_boot to give it up";
    ELD_REFUSED_SLOTS_IDLE = REFUSED, SLOTS, 3, "no work on the slots was begun";
    ELD_REFUSED_SLOTS_NOT_BOOTED = REFUSED, SLOTS, 4, "eld_slots_boot must be finished first";
    ELD_REFUSED_SLOTS_NOTHING_RUNS = REFUSED, SLOTS, 5, "no slot holds a model that runs; one can be uploaded";
    ELD_REFUSED_SLOTS_UNCONFIRMED = REFUSED, SLOTS, 6, "the model that runs, or one that is to be tried, must be confirmed or rejected first";
    ELD_REFUSED_SLOTS_CONFIRMED = REFUSED, SLOTS, 7, "a confirmed model is not rejected: put another one on trial";
    ELD_REFUSED_SLOTS_NO_UPLOAD = REFUSED, SLOTS, 8, "no upload was begun, or it was given up after an error";
    ELD_REFUSED_SLOTS_LENGTH = REFUSED, SLOTS, 9, "an upload that is longer than a slot or than announced, or of which bytes are missing";
    ELD_REFUSED_SLOTS_OFFSET = REFUSED, SLOTS, 10, "a chunk that does not follow the one before";
    ELD_REFUSED_SLOTS_OTHER_MODEL = REFUSED, SLOTS, 11, "another model than the one announced or running";
    ELD_REFUSED_SLOTS_BOOTS = REFUSED, SLOTS, 12, "a trial of none or of more than 16 boots";

    ELD_FAULT_SLOTS_STORAGE = FAULT, SLOTS, 1, "the storage could not read, erase or write";
    ELD_FAULT_SLOTS_NOT_WRITTEN = FAULT, SLOTS, 2, "what was written to the storage is not there";
    ELD_FAULT_MODEL_CHANGED = FAULT, MODEL, 1, "the model is not as it was when it was checked";
    ELD_FAULT_CHECK = FAULT, MODEL, 2, "the check of the model has changed in memory, or is that of another model: zero it and begin again";
    ELD_FAULT_VALIDITY = FAULT, TILE, 1, "the bits of valid or dark pixels have changed in memory; the tile is lost";
    ELD_FAULT_LIGHT = FAULT, TILE, 2, "what was added of the scene's light has changed in memory, in both copies; it is forgotten: add it again";
    ELD_FAULT_LINES = FAULT, TILE, 3, "a line that is kept for the terrain maps has changed in memory; the grid is lost: begin it again";
    ELD_FAULT_SELF_TEST = FAULT, RUN, 1, "the self test's output is not the one stored in the model";
    ELD_FAULT_RUN = FAULT, RUN, 2, "the run stands at a place that the model does not have; the tile is lost";
    ELD_FAULT_DATA_CHANGED = FAULT, RUN, 4, "a map of the tile has changed in memory, or the processor has erred; the tile is lost: begin it again";
    ELD_FAULT_HEIGHT = FAULT, RUN, 5, "the network gave a height that no ground has; the tile is lost";
    ELD_FAULT_INTERRUPTED = FAULT, RUN, 3, "the call before did not return; the tile is lost";
    ELD_FAULT_CONTEXT_LOST = FAULT, CONTEXT, 1, "no context there, or both its copies are damaged: call eld_init again";
    ELD_FAULT_CONTEXT_MOVED = FAULT, CONTEXT, 2, "the context is not where it was made: call eld_init again";
}

/// Returns the meaning of a status; for any other word, a text that says so.
pub fn text(status: eld_status_t) -> &'static CStr {
    STATUSES.iter().find(|known| known.status == status).map_or(c"not a status of this library", |known| known.text)
}

#[cfg(test)]
mod tests {
    extern crate std;
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn words_are_unique_and_laid_out_as_drawn() {
        let mut words = BTreeSet::new();
        for known in STATUSES {
            assert!(words.insert(known.status), "{}: {:#x} twice", known.name, known.status);
            assert_eq!(known.status & 0x3f00_0000, 0, "{}", known.name);
            let expected = match known.name {
                "ELD_OK" => GOOD,
                "ELD_RUNNING" => NOTICE,
                name if name.starts_with("ELD_NOTICE_") => NOTICE,
                name if name.starts_with("ELD_REFUSED_") => REFUSED,
                _ => FAULT,
            };
            assert_eq!(severity(known.status), expected, "{}", known.name);
            assert_eq!(worked(known.status), expected < REFUSED);
            assert!(!known.text.is_empty() && text(known.status) == known.text, "{}", known.name);
        }
        assert!(words.len() > 40);
        assert_eq!((ELD_OK, ELD_RUNNING, ELD_REFUSED_NULL), (0, 0x4005_0001, 0x8001_0001));
        assert_eq!(text(0x1234_5678), c"not a status of this library");
    }
}
