//! With the feature `packed`, compresses the shipped models for the programs that hold them.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    #[cfg(feature = "packed")]
    for name in ["ground", "nano"] {
        let model = format!("../models/{name}.eld");
        println!("cargo::rerun-if-changed={model}");
        let bytes = std::fs::read(&model).expect("the shipped models lie in host-train/models");
        // 0.3 MB less than at the usual level, and half a minute.
        let packed = zstd::bulk::compress(&bytes, 19).expect("zstd compresses any bytes");
        let folder = std::env::var("OUT_DIR").expect("Cargo names a folder");
        std::fs::write(format!("{folder}/{name}.zst"), packed).expect("Cargo's folder can be written");
    }
}
