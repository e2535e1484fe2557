//! Runs networks on data that Valgrind takes for undefined. `../run.sh` starts it and reads the reports.
//!
//! `elunar-branches KERNEL MODEL|programs [planted]`: `KERNEL` is the beginning of a kernel's name. With `planted` there are also a branch
//! and a look-up that follow the output. They must be reported.

mod valgrind;

use elunar_core::nn::{Kernel, Model, Progress, Runner, required};
use elunar_provoke::Random;
use elunar_provoke::programs::{Sizes, program};
use std::process::ExitCode;

/// Number of random programs of each size. The small ones are those whose outputs are recorded in `../../golden/programs`.
const PROGRAMS: usize = 100;
/// Multiply-accumulates of one step, as in the counts of C functions on boards.
const BUDGET: u64 = 5_000_000;

/// How a tile is computed.
struct How {
    kernel: Kernel,
    checked: bool,
    planted: bool,
}

/// Computes a tile of undefined samples in an arena of undefined bytes; returns the number of steps and of multiply-accumulates.
fn tile(model: Model<'_>, how: &How, random: &mut Random) -> Result<(u64, u64), String> {
    let pixels = model.tile().pixels();
    let image: Vec<f32> = (0..pixels * model.image_maps()).map(|_| 0.5 + 0.5 * random.sample()).collect();
    let coarse: Vec<f32> = (0..pixels).map(|_| model.nr() * (0.5 + 0.5 * random.sample())).collect();
    let mut memory = vec![0u8; required(&model)];
    let arena = (memory.as_ptr().addr(), memory.len());
    let mut runner = Runner::with_kernel(how.kernel, model, &mut memory).map_err(|e| e.to_string())?;
    runner.check_products(how.checked);
    valgrind::undefine(image.as_ptr().addr(), size_of_val(&image[..]));
    valgrind::undefine(coarse.as_ptr().addr(), size_of_val(&coarse[..]));
    runner.begin(&image, &coarse).map_err(|e| e.to_string())?;
    valgrind::undefine(arena.0, arena.1);
    while runner.step(BUDGET).map_err(|e| e.to_string())? == Progress::Running {}
    let mut out = vec![0.0; pixels];
    runner.output(&mut out).map_err(|e| e.to_string())?;
    if how.planted {
        plant(&out);
    }
    let telemetry = runner.telemetry();
    Ok((telemetry.steps, telemetry.macs))
}

/// Branches and looks up as the data say.
#[inline(never)]
fn plant(out: &[f32]) {
    let table: [u8; 256] = std::array::from_fn(|i| i as u8 ^ 0x55);
    let code = out.first().map_or(0, |v| v.to_bits() as u8);
    if std::hint::black_box(code) > 100 {
        std::hint::black_box("bright");
    }
    std::hint::black_box(std::hint::black_box(&table)[usize::from(code)]);
}

fn run(words: &[String]) -> Result<String, String> {
    let (kernel, what, planted) = match words {
        [kernel, what] => (kernel, what, false),
        [kernel, what, planted] if planted == "planted" => (kernel, what, true),
        _ => return Err(format!("expected KERNEL MODEL|programs [planted], found {words:?}")),
    };
    if !valgrind::is_running() {
        return Err("expected Valgrind around this program: see tests/branches/run.sh".into());
    }
    let names: Vec<&str> = Kernel::available().map(|kernel| kernel.name()).collect();
    let kernel = Kernel::available()
        .find(|k| k.name().starts_with(kernel.as_str()))
        .ok_or(format!("expected one of the kernels {names:?}, found {kernel}"))?;
    let mut random = Random::of_seed(1);
    let (mut tiles, mut steps, mut macs) = (0, 0, 0);
    let mut add = |file: &[u8], random: &mut Random| -> Result<(), String> {
        for checked in [false, true] {
            let model = Model::new(file).map_err(|e| e.to_string())?;
            let done = tile(model, &How { kernel, checked, planted }, random)?;
            (tiles, steps, macs) = (tiles + 1, steps + done.0, macs + done.1);
        }
        Ok(())
    };
    if what == "programs" {
        for sizes in [&Sizes::SMALL, &Sizes::USUAL] {
            let files = (1..).filter_map(|seed| Some(program(&mut Random::of_seed(seed), sizes)?.file()));
            for file in files.filter(|file| Model::new(file).is_ok()).take(PROGRAMS) {
                add(&file, &mut random)?;
            }
        }
    } else {
        add(&std::fs::read(what).map_err(|e| format!("{what}: {e}"))?, &mut random)?;
    }
    Ok(format!("{},{tiles},{steps},{macs}", kernel.name()))
}

fn main() -> ExitCode {
    match run(&std::env::args().skip(1).collect::<Vec<_>>()) {
        Ok(line) => {
            println!("{line}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("ERROR: {error}");
            ExitCode::FAILURE
        }
    }
}
