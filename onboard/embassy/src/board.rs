//! Start, tasks and memory of the board.

use crate::terrain::{LINES, Terrain};
use core::slice::{from_raw_parts, from_raw_parts_mut};
use cortex_m_semihosting::{debug, hprintln};
use embassy_executor::{Executor, Spawner};
use embassy_futures::yield_now;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::channel::Channel;
use panic_halt as _;
use static_cell::StaticCell;

/// The model's place and length (run.sh), and the place of the strip.
const MODEL: usize = 0x6000_0000;
const MODEL_BYTES: usize = parse(env!("MODEL_BYTES"));
const MEMORY: usize = 0x6080_0000;
const MEMORY_BYTES: usize = 8 << 20;

/// Lines on their way from the camera; `None` behind the last.
static LINE: Channel<CriticalSectionRawMutex, Option<usize>, 4> = Channel::new();

/// Reads a decimal number.
const fn parse(text: &str) -> usize {
    let (mut number, mut at) = (0, 0);
    while at < text.len() {
        number = 10 * number + (text.as_bytes()[at] - b'0') as usize;
        at += 1;
    }
    number
}

#[embassy_executor::task]
async fn camera() {
    for number in 0..LINES {
        LINE.send(Some(number)).await;
    }
    LINE.send(None).await;
}

#[embassy_executor::task]
async fn work() {
    // SAFETY: the loader wrote the model there; nothing else is in this memory, and the task runs once.
    let (file, memory) = unsafe {
        (from_raw_parts(MODEL as *const u8, MODEL_BYTES), from_raw_parts_mut(MEMORY as *mut u64, MEMORY_BYTES / 8))
    };
    let Some(mut terrain) = Terrain::new(file, memory) else {
        hprintln!("ERROR: expected a model that fits 8 MiB");
        return debug::exit(debug::EXIT_FAILURE);
    };
    // Other tasks run between two steps.
    while let Some(number) = LINE.receive().await {
        while !terrain.push(number) {
            terrain.step();
            yield_now().await;
        }
    }
    terrain.finish();
    while terrain.step() {
        yield_now().await;
    }
    hprintln!("{}", terrain.report());
    debug::exit(debug::EXIT_SUCCESS);
}

#[cortex_m_rt::entry]
fn main() -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    EXECUTOR.init(Executor::new()).run(|spawner: Spawner| {
        let spawned = spawner.spawn(camera()).and_then(|()| spawner.spawn(work()));
        spawned.unwrap_or_else(|_| debug::exit(debug::EXIT_FAILURE));
    })
}
