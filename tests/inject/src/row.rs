//! An injection with its outcome: a line of the record, from which the injection can be made again.

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Heights that differ from the clean tile's by more than this are wrong, metres.
pub(crate) const LIMIT_M: f32 = 0.1;
/// Farthest flipped byte of the stack above the stack pointer, and of the code before and behind the instruction, bytes.
const REACH: [i64; 2] = [2048, 128];
/// Names of the registers, in the order of their numbers.
pub(crate) const REGISTERS: [&str; 17] = [
    "rax", "rbx", "rcx", "rdx", "rsi", "rdi", "rbp", "rsp", "r8", "r9", "r10", "r11", "r12", "r13", "r14", "r15", "rip",
];

/// What is hit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Class {
    /// A general register, or the instruction pointer.
    Register,
    /// The library's part of the stack, at most 2,048 bytes above the stack pointer.
    Stack,
    /// The program, at most 128 bytes from the instruction. The bit stays flipped.
    Code,
}

impl Class {
    /// All classes.
    pub(crate) const ALL: [Self; 3] = [Self::Register, Self::Stack, Self::Code];

    /// Returns the name in tables.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Register => "general registers",
            Self::Stack => "stack",
            Self::Code => "code",
        }
    }
}

/// What an injection led to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Outcome {
    /// Not made yet.
    Planned,
    /// The tile ended with an error.
    Detected,
    /// The process ended: an illegal address or instruction, a panic. On a board the processor's exception says so.
    Crash,
    /// The tile took three times its time. In flight a watchdog ends it.
    Hang,
    /// No height differs by more than [`LIMIT_M`], and the same heights are valid.
    Masked,
    /// Heights differ by more, or others are valid, and nothing said so.
    Silent,
}

impl Outcome {
    /// All outcomes of an injection that was made.
    pub(crate) const ALL: [Self; 5] = [Self::Detected, Self::Crash, Self::Hang, Self::Masked, Self::Silent];

    /// Returns the name in tables.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Planned => "planned",
            Self::Detected => "detected",
            Self::Crash => "crash",
            Self::Hang => "hang",
            Self::Masked => "masked",
            Self::Silent => "silent, above 0.1 m",
        }
    }
}

/// Where a process was when it was looked at.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(crate) struct Sample {
    /// Number of the job's unit of work.
    pub(crate) unit: u64,
    /// Offset of the instruction in the program, bytes.
    pub(crate) at: u64,
    /// Bytes of the stack that are the library's.
    pub(crate) depth: u64,
}

/// An injection and its outcome.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Row {
    /// Number of the injection.
    pub(crate) injection: u64,
    /// What is hit.
    pub(crate) class: Class,
    /// The moment: number of the job's unit of work, offset of an instruction in the program, and how often the unit comes to it before.
    pub(crate) unit: u64,
    /// See `unit`.
    pub(crate) at: u64,
    /// See `unit`; 1 for the first time.
    pub(crate) hit: u32,
    /// Number of the register ([`REGISTERS`]), or bytes from the stack pointer or the instruction to the byte.
    pub(crate) place: i64,
    /// The bit, 0 for the lowest: of 64 of a register, of 8 of a byte.
    pub(crate) bit: u32,
    /// What is worked on in that unit.
    pub(crate) phase: String,
    /// The outcome.
    pub(crate) outcome: Outcome,
    /// Largest difference of a valid height, metres; infinite if it is not a number.
    pub(crate) error_m: f32,
    /// Number of heights that differ by more than [`LIMIT_M`] or of whose validity the opposite is said.
    pub(crate) wrong_px: u32,
    /// The error that was reported, or the signal.
    pub(crate) message: String,
}

impl Row {
    /// Draws what is hit at the moment of a sample.
    pub(crate) fn draw(injection: u64, class: Class, sample: &Sample, rng: &mut ChaCha8Rng) -> Self {
        let (place, bits) = match class {
            Class::Register => (rng.random_range(0..REGISTERS.len() as i64), 64),
            Class::Stack => (rng.random_range(0..(sample.depth as i64).clamp(1, REACH[0])), 8),
            Class::Code => (rng.random_range(-REACH[1]..REACH[1]), 8),
        };
        let bit = rng.random_range(0..bits);
        // An instruction of a loop: as often an early turn as one of the next order of magnitude, up to 4,096.
        let hit = (4096f64.powf(rng.random::<f64>())) as u32;
        let &Sample { unit, at, .. } = sample;
        let (phase, message, outcome) = (String::new(), String::new(), Outcome::Planned);
        Self { injection, class, unit, at, hit, place, bit, phase, outcome, error_m: 0.0, wrong_px: 0, message }
    }
}
