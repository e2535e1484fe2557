//! Finds out which ARM extensions for microcontrollers the target has. The compiler has this information, but stable Rust does not show it
//! to crates.
//!
//! `arm_dsp`: the DSP instructions, which all `thumbv7em` processors have. `arm_mve`: Helium, integer part. A target has it if the
//! compiler's flags name a processor with Helium (`-C target-cpu=cortex-m55`), or contain `-C target-feature=+mve`.

use std::env;

/// Processors with Helium.
const HELIUM: [&str; 3] = ["cortex-m52", "cortex-m55", "cortex-m85"];

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-env-changed=CARGO_ENCODED_RUSTFLAGS");
    println!("cargo:rustc-check-cfg=cfg(arm_dsp, arm_mve)");
    let target = env::var("TARGET").unwrap_or_default();
    if target.starts_with("thumbv7em") {
        println!("cargo:rustc-cfg=arm_dsp");
    }
    let flags = env::var("CARGO_ENCODED_RUSTFLAGS").unwrap_or_default();
    let mut words = flags.split(['\x1f', '=', ',', ' ']);
    if target.starts_with("thumbv8m.main") && words.any(|word| HELIUM.contains(&word) || word.starts_with("+mve")) {
        println!("cargo:rustc-cfg=arm_mve");
    }
}
