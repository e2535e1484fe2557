//! Measures the cost of the C interface in addition to the work: `cargo test -p elunar-capi --test overhead -- --ignored --nocapture`.

mod common;
use common::*;
use elunar_capi::status::*;
use elunar_core::nn::{Kernel, Model, Progress, Runner, required};
use std::time::Instant;

/// Returns the seconds of the fastest of some rounds.
fn fastest(rounds: usize, mut round: impl FnMut()) -> f64 {
    let one = |()| {
        let start = Instant::now();
        round();
        start.elapsed().as_secs_f64()
    };
    std::iter::repeat_n((), rounds).map(one).fold(f64::INFINITY, f64::min)
}

#[test]
#[ignore = "a measurement"]
fn calls_cost_little_beside_their_work() {
    let mut context = Context::new(nano());
    let telemetry = fastest(200, || _ = context.telemetry());
    let scrub = fastest(200, || assert_eq!(context.scrub(1), ELD_OK));
    // A query for the features of an x86 processor leaves a virtual machine three times.
    let asking = fastest(200, || _ = Kernel::best());
    println!(
        "a call that does nothing: telemetry {:.2} us, scrub of 1 byte {:.2} us, of which {:.2} us ask for the kernel",
        1e6 * telemetry,
        1e6 * scrub,
        1e6 * asking
    );

    let mut arena = vec![0; required(&Model::new(nano()).unwrap())];
    let mut runner = Runner::new(Model::new(nano()).unwrap(), &mut arena).unwrap();
    for budget in [u64::MAX, 50_000_000, 5_000_000] {
        let (mut steps, mut through_c, mut without) = (0, f64::INFINITY, f64::INFINITY);
        // In turn, so that both run under the same conditions.
        for _ in 0..15 {
            through_c = through_c.min(fastest(1, || {
                assert!(worked(context.self_test_begin()));
                steps = 1;
                while context.step(budget) == ELD_RUNNING {
                    steps += 1;
                }
            }));
            without = without.min(fastest(1, || {
                runner.begin_self_test().expect("the model is as it was");
                while runner.step(budget).unwrap() == Progress::Running {}
            }));
        }
        println!(
            "{steps} steps: {:.2} ms through C, {:.2} ms without, {:+.2} %",
            1e3 * through_c,
            1e3 * without,
            100.0 * (through_c / without - 1.0)
        );
    }
}
