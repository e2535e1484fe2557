//! A short campaign. Each of its injections, made again from its line, leads to the same.
#![cfg(all(target_os = "linux", target_arch = "x86_64"))]

use std::path::{Path, PathBuf};
use std::process::Command;

const INJECTIONS: usize = 24;

/// Runs the program; returns the lines of its record, as cells. `None` if processes cannot be watched here.
fn inject(folder: &Path, more: &[&str]) -> Vec<Vec<String>> {
    let model = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../host-train/models/nano.eld");
    let mut command = Command::new(env!("CARGO_BIN_EXE_elunar-inject"));
    let out = command.arg(model).arg("--out").arg(folder).args(more).output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let record = std::fs::read_to_string(folder.join("injections.csv")).unwrap();
    record.lines().skip(1).map(|line| line.split(',').map(String::from).collect()).collect()
}

#[test]
fn flipped_bits_are_seen_and_every_injection_can_be_made_again() {
    let folder = tempfile::tempdir().unwrap();
    let (first, second) = (folder.path().join("first"), folder.path().join("second"));
    let rows = inject(&first, &["--injections", &INJECTIONS.to_string()]);
    for class in ["register", "stack", "code"] {
        let of = |outcome: &str| rows.iter().filter(|row| row[1] == class && row[8] == outcome).count();
        let all = rows.iter().filter(|row| row[1] == class).count();
        assert_eq!((all, of("planned")), (INJECTIONS, 0), "{class}");
        // Without a flip there is neither. In a long campaign six of ten in registers end so, and all in code, half of them detected: by chance
        // the bounds are missed once in 100,000 runs.
        match class {
            "register" => assert!(of("crash") + of("detected") > 0, "{rows:?}"),
            "code" => assert!(of("detected") > INJECTIONS / 8 && of("silent") + of("masked") == 0, "{rows:?}"),
            _ => (),
        }
    }
    let record = first.join("injections.csv");
    let again = inject(&second, &["--replay", record.to_str().unwrap(), "--workers", "1"]);
    assert_eq!(again, rows);
    assert!(second.join("inject.md").exists() && second.join("inject.png").exists());
}
