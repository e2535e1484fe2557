//! The fuzz targets `c_abi` and `c_lines` on seeded bytes, without a nightly compiler.

use elunar_provoke::Random;
use elunar_provoke::c_abi::{Tally, c_abi};
use elunar_provoke::c_lines::c_lines;

#[test]
fn calls_in_any_order_return_with_a_status_that_fits() {
    let mut random = Random(4);
    let (mut all, mut most) = (Tally::default(), 0);
    for _ in 0..1500 {
        let len = 20 + random.number() as usize % 400;
        let one = c_abi(&random.bytes(len));
        all.calls += one.calls;
        all.worked += one.worked;
        all.refused += one.refused;
        all.faults += one.faults;
        all.tiles += one.tiles;
        all.repairs += one.repairs;
        most = most.max(one.calls);
    }
    println!("{all:?}, {most} calls at most");
    // Each kind of call occurs often enough; otherwise the driver has an error.
    assert!(all.calls > 50_000 && all.worked > all.calls / 5 && all.refused > all.calls / 5, "{all:?}");
    assert!(all.faults > 1000 && all.tiles > 50 && all.repairs > 1000, "{all:?}");
}

#[test]
fn strips_maps_slots_and_checks_in_any_order_return_with_a_status_that_fits() {
    let (mut random, mut all) = (Random(5), Tally::default());
    for _ in 0..400 {
        let len = 200 + random.number() as usize % 4000;
        let one = c_lines(&random.bytes(len));
        all.calls += one.calls;
        all.worked += one.worked;
        all.refused += one.refused;
        all.faults += one.faults;
    }
    println!("{all:?}");
    assert!(
        all.calls > 10_000 && all.worked > all.calls / 5 && all.refused > all.calls / 20 && all.faults > 50,
        "{all:?}"
    );
}
