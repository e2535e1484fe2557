//! Bit flips in the context between two calls are repaired or reported, and the heights stay the same.
#![allow(unsafe_code)] // C functions

mod common;
use common::*;
use elunar_capi::status::*;
use elunar_capi::types::*;

/// Does one of the calls that use the context, by number, and returns its status.
fn call(context: &mut Context, number: usize) -> eld_status_t {
    match number % 5 {
        0 => context.step(1),
        1 => context.try_telemetry().1,
        2 => context.scrub(64),
        3 => context.output().map_or_else(|status| status, |_| ELD_OK),
        _ => context.self_test_check(),
    }
}

/// Returns reproducible random numbers (xorshift64*).
fn random(state: &mut u64) -> usize {
    *state ^= *state >> 12;
    *state ^= *state << 25;
    *state ^= *state >> 27;
    (state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33) as usize
}

#[test]
fn every_flipped_bit_of_the_context_is_repaired() {
    let (tile, mut context) = (Tile::golden(), Context::new(nano()));
    assert_eq!(context.begin(&tile), ELD_OK);
    let bits_all = 8 * context.head_bytes();
    let mut untold = 0;
    for bit in 0..bits_all {
        context.flip(bit);
        let status = call(&mut context, bit);
        let legal = [ELD_RUNNING, ELD_NOTICE_REPAIRED, ELD_REFUSED_NOT_DONE, ELD_REFUSED_OTHER_TILE];
        assert!(legal.contains(&status), "bit {bit}: {:?}", text(status));
        untold += usize::from(status != ELD_NOTICE_REPAIRED);
    }
    let counters = context.telemetry();
    assert_eq!((counters.context_repairs as usize, counters.faults), (bits_all, 0));
    assert!(untold > 0 && untold < bits_all);
    println!("{bits_all} bits flipped, each repaired");
    context.finish();
    let found = context.output().unwrap();
    assert_eq!((bits(&found.0), found.1), (bits(&tile.expected().0), tile.expected().1));
}

#[test]
fn two_flipped_bits_are_repaired_or_reported() {
    let (tile, mut context) = (Tile::golden(), Context::new(nano()));
    assert_eq!(context.begin(&tile), ELD_OK);
    context.step(STEP_MACS);
    let clean = context.memory.clone();
    let (bits_all, mut state) = (8 * context.head_bytes(), 5);
    let (mut repaired, mut reported) = (0, 0);
    for round in 0..20_000 {
        let flips = [random(&mut state) % bits_all, random(&mut state) % bits_all];
        context.flip(flips[0]);
        context.flip(flips[1]);
        let both = flips.map(|bit| bit < bits_all / 2);
        let status = call(&mut context, 1 + round % 2);
        if both[0] != both[1] {
            assert_eq!(status, ELD_FAULT_CONTEXT_LOST, "{flips:?}");
            context.memory.copy_from_slice(&clean);
            reported += 1;
        } else if flips[0] != flips[1] {
            assert_eq!(status, ELD_NOTICE_REPAIRED, "{flips:?}");
            repaired += 1;
        }
    }
    println!("{repaired} repaired, {reported} reported");
    assert!(repaired > 5000 && reported > 5000);
    context.finish();
    assert_eq!(bits(&context.output().unwrap().0), bits(&tile.expected().0));
}

#[test]
fn rubbish_instead_of_a_context_is_reported() {
    let mut context = Context::new(nano());
    let (clean, bytes) = (context.memory.clone(), context.head_bytes());
    let mut state = 11;
    for round in 0..3000 {
        // Overwrites a range of one copy or of both.
        let (start, len) = (random(&mut state) % bytes, 1 + random(&mut state) % bytes);
        let end = bytes.min(start + len);
        for byte in &mut context.bytes()[start..end] {
            *byte = if round % 3 == 0 { 0 } else { random(&mut state) as u8 };
        }
        let changed = context.memory != clean;
        let status = context.try_telemetry().1;
        if start < bytes / 2 && end > bytes / 2 {
            assert!(status == ELD_FAULT_CONTEXT_LOST || status == ELD_NOTICE_REPAIRED || status == ELD_OK);
        } else {
            let expected = if changed { ELD_NOTICE_REPAIRED } else { ELD_OK };
            assert_eq!(status, expected, "bytes {start} to {end}");
        }
        context.memory.copy_from_slice(&clean);
    }
}

#[test]
fn every_flipped_bit_of_the_job_is_repaired() {
    let (tile, mut context) = (Tile::golden(), Context::new(nano()));
    let job = context.parts().job;
    let (mut bit, mut flips) = (8 * job.start, 0);
    // Bits all over the words, in every phase that uses the job.
    let mut next = |context: &mut Context| {
        context.flip(bit);
        bit += 53;
        if bit >= 8 * job.end {
            bit = 8 * job.start + (bit - 8 * job.end);
        }
        flips += 1;
    };
    assert_eq!(context.begin_step(&tile.c(), 1), ELD_RUNNING);
    loop {
        next(&mut context);
        match context.begin_step(&tile.c(), STEP_MACS / 50) {
            ELD_RUNNING => {}
            status => break assert_eq!(status, ELD_NOTICE_REPAIRED),
        }
    }
    loop {
        next(&mut context);
        match context.step(STEP_MACS) {
            ELD_RUNNING => {}
            status => break assert_eq!(status, ELD_NOTICE_REPAIRED),
        }
    }
    let counters = context.telemetry();
    assert_eq!((counters.context_repairs, counters.faults), (flips, 0));
    assert!(flips > 100);
    assert_eq!(bits(&context.output().unwrap().0), bits(&tile.expected().0));
}

#[test]
fn flipped_heights_are_reported() {
    let (tile, mut context) = (Tile::golden(), Context::new(nano()));
    assert_eq!(context.begin(&tile), ELD_OK);
    context.finish();
    let (clean, first) = (context.memory.clone(), 8 * context.parts().scratch.start);
    for bit in (first..first + 32 * PX).step_by(32_771) {
        context.flip(bit);
        assert_eq!(context.output(), Err(ELD_FAULT_DATA_CHANGED), "bit {bit}");
        context.memory.copy_from_slice(&clean);
    }
    assert!(context.output().is_ok());
}

#[test]
fn flipped_coarse_heights_are_reported() {
    let (tile, mut context) = (Tile::golden(), Context::new(nano()));
    let coarse = context.parts().coarse;
    assert_eq!(context.begin(&tile), ELD_OK);
    let clean = context.memory.clone();
    for bit in (8 * coarse.start..8 * coarse.end).step_by(131_101) {
        context.flip(bit);
        let mut status = ELD_RUNNING;
        while status == ELD_RUNNING {
            status = context.step(u64::MAX >> 1);
        }
        assert_eq!(status, ELD_FAULT_DATA_CHANGED, "bit {bit}");
        context.memory.copy_from_slice(&clean);
    }
    context.finish();
    assert_eq!(bits(&context.output().unwrap().0), bits(&tile.expected().0));
}

#[test]
fn flipped_bits_of_valid_and_dark_pixels_are_reported() {
    let (tile, mut context) = (Tile::golden(), Context::new(nano()));
    assert_eq!(context.begin(&tile), ELD_OK);
    context.finish();
    let clean = context.memory.clone();
    let parts = context.parts();
    for (first, in_output) in [(parts.valid, true), (parts.dark, false)].map(|(part, is)| (8 * part.start, is)) {
        for bit in (first..first + PX).step_by(1994) {
            context.flip(bit);
            assert_eq!(context.output().err(), in_output.then_some(ELD_FAULT_VALIDITY), "bit {bit}");
            context.memory.copy_from_slice(&clean);
            context.flip(bit);
            assert_eq!(context.error_maps(), Err(ELD_FAULT_VALIDITY), "bit {bit}");
            context.memory.copy_from_slice(&clean);
        }
    }
    assert!(context.output().is_ok() && context.error_maps().is_ok());
}

/// Flips a bit of the tile's memory between two calls, while it is prepared and while heights are finished.
#[test]
fn flipped_bits_between_two_calls_are_reported_or_unused() {
    let (tile, mut context) = (Tile::golden(), Context::new(nano()));
    let Parts { coarse, scratch, valid, .. } = context.parts();
    let (expected, mut state) = (tile.expected(), 7);
    let (mut reported, mut unused) = ([0; 3], 0);
    for round in 0..60 {
        let kind = round % 3;
        let part = [&coarse, &scratch, &valid][kind];
        let (bit, mut wait) = (8 * part.start + random(&mut state) % (8 * part.len()), random(&mut state) % 14);
        let mut flip = |context: &mut Context| {
            if wait == 0 {
                context.flip(bit);
            }
            wait = wait.wrapping_sub(1);
        };
        let mut status = context.begin_step(&tile.c(), STEP_MACS);
        while status == ELD_RUNNING {
            flip(&mut context);
            status = context.begin_step(&tile.c(), STEP_MACS);
        }
        if worked(status) {
            // The network at once: its memory is the arena.
            status = context.step(u64::MAX >> 1);
            while status == ELD_RUNNING {
                flip(&mut context);
                status = context.step(STEP_MACS);
            }
        }
        match status {
            ELD_OK => {
                flip(&mut context);
                match context.output() {
                    Ok(found) => {
                        assert_eq!((bits(&found.0), found.1), (bits(&expected.0), expected.1.clone()), "bit {bit}");
                        unused += 1;
                    }
                    Err(status) => {
                        assert!([ELD_FAULT_DATA_CHANGED, ELD_FAULT_VALIDITY].contains(&status));
                        reported[kind] += 1;
                    }
                }
            }
            status => {
                let expected = if kind == 2 { ELD_FAULT_VALIDITY } else { ELD_FAULT_DATA_CHANGED };
                assert_eq!(status, expected, "bit {bit}");
                reported[kind] += 1;
            }
        }
    }
    println!("{reported:?} reported, {unused} unused");
    assert!(reported.iter().all(|reported| *reported > 8), "{reported:?}");
}
