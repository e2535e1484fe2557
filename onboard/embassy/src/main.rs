//! A strip as a task of Embassy: a camera's task sends lines, the terrain's task works in bounded steps and gives way after each. Built for the
//! host (`cargo run -- MODEL.eld`) it does the same work without an executor, and prints what the board must print.
#![cfg_attr(target_os = "none", no_std, no_main)]

#[cfg(target_os = "none")]
mod board;
mod terrain;

#[cfg(not(target_os = "none"))]
fn main() -> std::process::ExitCode {
    use terrain::{LINES, Terrain};
    let Some(file) = std::env::args().nth(1).and_then(|path| std::fs::read(path).ok()) else {
        eprintln!("ERROR: expected a model file: elunar-embassy MODEL.eld");
        return std::process::ExitCode::FAILURE;
    };
    let mut memory = vec![0; 1 << 20];
    let Some(mut terrain) = Terrain::new(&file, &mut memory) else {
        eprintln!("ERROR: expected a model that fits 8 MiB");
        return std::process::ExitCode::FAILURE;
    };
    for number in 0..LINES {
        while !terrain.push(number) {
            terrain.step();
        }
    }
    terrain.finish();
    while terrain.step() {}
    println!("{}", terrain.report());
    std::process::ExitCode::SUCCESS
}
