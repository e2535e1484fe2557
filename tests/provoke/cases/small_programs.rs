//! A hundred small random programs give what is recorded: with every kernel of this machine, and with the scalar one under Miri, which finds
//! what the language forbids. The record is ../../golden/programs; the command under Miri is in ../../campaigns.

use elunar_core::nn::Kernel;
#[cfg(not(miri))]
use elunar_core::nn::file::Operator;
use elunar_provoke::Random;
#[cfg(not(miri))]
use elunar_provoke::programs::Program;
use elunar_provoke::programs::{Output, Sizes, output, program};

const RECORD: &str = include_str!("../../golden/programs/outputs.txt");
const PROGRAMS: usize = 100;

/// Returns the line of a record.
fn line(seed: u64, (crc, saturated, macs): Output) -> String {
    format!("seed {seed} crc {crc:08x} saturated {saturated} macs {macs}")
}

/// Returns the programs that the validation accepts, laid out apart, with their seeds and what they give with one kernel.
#[cfg(not(miri))]
fn programs(kernel: Kernel) -> impl Iterator<Item = (u64, Program, Output)> {
    let programs = (1..).filter_map(|seed| Some((seed, program(&mut Random::of_seed(seed), &Sizes::SMALL)?)));
    let ran = programs.filter_map(move |(seed, program)| {
        let found = output(&program, kernel).ok()?;
        Some((seed, program, found))
    });
    ran.take(PROGRAMS)
}

/// `ELUNAR_PART=2/5` is the second fifth of the programs.
#[cfg(miri)]
fn part() -> (usize, usize) {
    let Ok(text) = std::env::var("ELUNAR_PART") else { return (0, 1) };
    let (part, of) = text.split_once('/').expect("a part, such as 2/5");
    let (part, of): (usize, usize) = (part.parse().expect("a number"), of.parse().expect("a number"));
    assert!((1..=of).contains(&part), "ELUNAR_PART={text}: expected a part from 1 to {of}");
    (part - 1, of)
}

#[test]
#[cfg(not(miri))]
fn every_kernel_gives_what_is_recorded() {
    for kernel in Kernel::available() {
        let lines: Vec<String> = programs(kernel).map(|(seed, _, found)| line(seed, found)).collect();
        assert!(lines == RECORD.lines().collect::<Vec<_>>(), "{kernel:?}: {lines:#?}");
    }
}

#[test]
#[cfg(not(miri))]
fn all_operators_occur() {
    let (mut counts, mut wide) = ([0; 4], 0);
    for (_, program, _) in programs(Kernel::SCALAR) {
        for operator in &program.operators {
            let kind = match operator {
                Operator::Conv(_) => 0,
                Operator::Attention(_) => 1,
                Operator::LayerNorm(_) => 2,
                Operator::Upsample2(_) => 3,
            };
            counts[kind] += 1;
        }
        wide += program.tensors.iter().filter(|t| t.channels > 16).count();
    }
    assert!(
        counts.iter().all(|count| *count >= 15) && wide > 15,
        "{counts:?}, {wide} tensors of more than 16 channels"
    );
}

#[test]
#[ignore = "writes ../../golden/programs anew, with the fastest kernel"]
#[cfg(not(miri))]
fn write_the_record_anew() {
    let text: String = programs(Kernel::best()).map(|(seed, _, found)| line(seed, found) + "\n").collect();
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../golden/programs/outputs.txt");
    std::fs::write(path, text).expect("a folder that can be written");
}

#[test]
#[cfg(miri)]
fn the_scalar_kernel_gives_what_is_recorded() {
    let (part, of) = part();
    let recorded: Vec<&str> = RECORD.lines().collect();
    assert_eq!(recorded.len(), PROGRAMS);
    for (index, recorded) in recorded.into_iter().enumerate().filter(|(index, _)| index % of == part) {
        let seed = recorded.split(' ').nth(1).and_then(|word| word.parse().ok()).expect("a seed");
        let program = program(&mut Random::of_seed(seed), &Sizes::SMALL).expect("a program");
        let found = output(&program, Kernel::SCALAR).expect("accepted");
        assert_eq!(line(seed, found), recorded);
        println!("{index}: {recorded}");
    }
}
