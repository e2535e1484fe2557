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
/// and with an output that another machine owns (75). `elsewhere` names commands that the program lists and another test calls.
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
        let (code, _, text) = ended(at, &[words[0], "--help"]);
        assert_eq!(code, Some(0), "{words:?}: {text}");
        if expected.is_some() {
            let (code, _, text) = ended(at, words);
            assert_eq!(code, *expected, "{words:?}: {text}");
            assert!(text.lines().count() == 1 && text.starts_with("ERROR: "), "{words:?}: {text}");
        }
        let Some(lock) = lock else { continue };
        let record = "elunar owner 1\nhost elsewhere\nboot b\nnamespace pid:[1]\npid 7\nprocess-start 9\nsince 1\n";
        std::fs::create_dir_all(at.join(lock).parent().unwrap()).unwrap();
        std::fs::write(at.join(lock), record).unwrap();
        let (code, _, text) = ended(at, words);
        assert!(code == Some(75) && text.contains("another run writes it"), "{words:?}: {code:?} {text}");
    }
}
