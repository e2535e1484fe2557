//! The documented exit codes, command by command.

use std::path::Path;
use std::process::{Command, Output};

/// A command of a program.
#[derive(Debug, Clone, Copy)]
pub struct Called<'a> {
    /// Its name and arguments. Its inputs do not exist.
    pub words: &'a [&'a str],
    /// How it ends. `None`: it needs no input, and would do its work.
    pub code: Option<i32>,
    /// Lock of its output, if it takes that before it reads inputs.
    pub lock: Option<&'a str>,
}

/// Runs every command of a program with an unknown option (64), for help (0), with inputs that are absent ([`Called::code`], one line of error),
/// and with an output that another machine owns (75). With `--json`, where a command has it, each of these errors is also an object on
/// standard output. `elsewhere` names commands that the program lists and another test calls.
///
/// # Panics
/// If a command ends otherwise, or the program lists one that has no entry.
pub fn check(program: &Path, commands: &[Called], elsewhere: &[&str]) {
    let ended = |folder: &Path, words: &[&str]| {
        let Output { status, stdout, stderr } = Command::new(program).args(words).current_dir(folder).output().unwrap();
        (status.code(), String::from_utf8_lossy(&stdout).into_owned(), String::from_utf8_lossy(&stderr).into_owned())
    };
    let known: Vec<&str> = commands.iter().map(|called| called.words[0]).chain(elsewhere.iter().copied()).collect();
    let (_, help, _) = ended(Path::new("."), &["--help"]);
    let listed = help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| line.starts_with("  "));
    for name in listed.filter_map(|line| line.split_whitespace().next()).filter(|name| *name != "help") {
        assert!(known.contains(&name), "{name}: an entry in this test expected, none found");
    }
    for Called { words, code: expected, lock } in commands {
        let folder = tempfile::tempdir().unwrap();
        let at = folder.path();
        let (code, _, text) = ended(at, &[words, &["--no-such-option"][..]].concat());
        assert_eq!(code, Some(64), "{words:?}: {text}");
        let (code, help, text) = ended(at, &[words[0], "--help"]);
        assert_eq!(code, Some(0), "{words:?}: {text}");
        let has_json = help.lines().any(|line| line.trim_start().starts_with("--json"));
        let json: &[&str] = if has_json { &["--json"] } else { &[] };
        if has_json {
            let (_, object, text) = ended(at, &[words, &["--json", "--no-such-option"][..]].concat());
            check_object(&object, 64, None).unwrap_or_else(|what| panic!("{words:?}: {what}: {object} {text}"));
        }
        if expected.is_some() {
            let (code, object, text) = ended(at, &[words, json].concat());
            assert_eq!(code, *expected, "{words:?}: {text}");
            assert!(text.lines().count() == 1 && text.starts_with("ERROR: "), "{words:?}: {text}");
            if let (Some(code), true) = (code, has_json) {
                check_object(&object, code, Some(&text)).unwrap_or_else(|what| panic!("{words:?}: {what}: {object}"));
            }
        }
        let Some(lock) = lock else { continue };
        let record = "elunar owner 1\nhost elsewhere\nboot b\nnamespace pid:[1]\npid 7\nprocess-start 9\nsince 1\n";
        std::fs::create_dir_all(at.join(lock).parent().unwrap()).unwrap();
        std::fs::write(at.join(lock), record).unwrap();
        let (code, object, text) = ended(at, &[words, json].concat());
        if has_json {
            check_object(&object, 75, Some(&text)).unwrap_or_else(|what| panic!("{words:?}: {what}: {object}"));
        }
        assert!(code == Some(75) && text.contains("another run writes it"), "{words:?}: {code:?} {text}");
    }
}

/// Checks the object of an error on standard output: its code, the kind of that code, and the message, which is that of the error line.
///
/// # Errors
/// What is wrong.
pub fn check_object(stdout: &str, code: i32, line: Option<&str>) -> Result<(), String> {
    let found: serde_json::Value = serde_json::from_str(stdout).map_err(|e| e.to_string())?;
    let kind = match code {
        64 => "usage",
        65 => "bad_input",
        70 => "defect",
        71 => "no_memory",
        _ => "try_again",
    };
    let error = &found["error"];
    let message = error["message"].as_str().unwrap_or_default();
    if found.as_object().map(|all| all.len()) != Some(1) || error["code"] != code || error["kind"] != kind {
        return Err(format!("one error of code {code} and kind {kind} expected"));
    }
    match line {
        Some(line) if line != format!("ERROR: {message}\n") => Err(format!("the message of {line:?} expected")),
        None if message.is_empty() || message.contains('\n') => Err("a message of one line expected".into()),
        _ => Ok(()),
    }
}
