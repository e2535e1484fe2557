//! Calls about the light of a scene.

use super::{Phase, Play, Slot, TILES, Tile};
use crate::model::Reader;
use elunar_capi::ffi;
use elunar_capi::status::*;
use elunar_capi::types::*;

/// Returns a light that a decision may give, or nearly.
pub(crate) fn odd_light(reader: &mut Reader<'_>) -> eld_lighting_t {
    let mut one_of = |values: [f32; 8]| values[reader.byte() as usize % 8];
    let [east, south] = [(); 2].map(|()| one_of([0.0, 0.0, 0.0, 0.5, -0.5, 2.0, -2.0, f32::INFINITY]));
    let [trust, related, long_share] = [(); 3].map(|()| one_of([0.0, 0.1, 0.5, 0.5, 0.9, 1.0, 1.0, 1.5]));
    let log_strength_sd = one_of([0.0, 0.1, 0.1, 0.5, 0.5, 1.0, -0.1, f32::INFINITY]);
    let azimuth_sd_deg = one_of([0.0, 0.1, 10.0, 10.0, 20.0, 180.0, 180.0, 181.0]);
    let long_share = if east < 0.0 { f32::NAN } else { long_share };
    let (struct_bytes, source) = (size_of::<eld_lighting_t>() as u32, u32::from(reader.byte()) % 5);
    eld_lighting_t { struct_bytes, source, east, south, trust, related, long_share, log_strength_sd, azimuth_sd_deg }
}

impl Play<'_> {
    /// Adds a tile to the light of the scene, decides it, or forgets it.
    pub(super) fn light(&mut self, slot: &mut Slot) -> eld_status_t {
        let (how, good) = (self.reader.byte(), self.reader.byte() as usize % TILES);
        if how >= 224 {
            // SAFETY: a context of the test, here and below.
            return unsafe { ffi::eld_light_clear(slot.handle) };
        }
        if how >= 160 {
            let struct_bytes = size_of::<eld_lighting_t>() as u32;
            let mut light = eld_lighting_t { struct_bytes, ..Default::default() };
            let known = |known: bool, deg: f32| if known { deg } else { f32::NAN };
            let sun = (known(how & 1 == 0, 70.0), known(how & 2 == 0, 30.0));
            // SAFETY: as above, and a structure of the test.
            let status = unsafe { ffi::eld_light_decide(slot.handle, sun.0, sun.1, &raw mut light) };
            assert!(!worked(status) || light.source <= ELD_SOURCE_ASSUMED && light.east.is_finite());
            if how & 12 == 12 {
                light = odd_light(&mut self.reader);
            }
            if worked(status) {
                let mut tile = Tile::good(good, slot.shape());
                tile.c.light = &raw const light;
                self.count(status);
                return Self::begin_step(slot, &tile.c, u64::MAX, None);
            }
            return status;
        }
        let tile = Tile::good(good, slot.shape());
        let budget = if how % 2 == 0 { u64::MAX } else { 1 << 14 };
        loop {
            // SAFETY: as above, and a tile of the test.
            let status = unsafe { ffi::eld_light_add(slot.handle, &tile.c, budget) };
            let is_running = status == ELD_RUNNING;
            slot.phase = match (is_running, worked(status)) {
                (true, _) => Phase::Light,
                (_, true) => Phase::Empty,
                _ => slot.phase,
            };
            if !is_running || how % 8 == 7 {
                return status;
            }
        }
    }
}
