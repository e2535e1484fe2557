//! Commands that are killed at random moments, and pairs of them that write one output at the same time. Campaigns are commands:
//!
//! ```sh
//! ELUNAR_KILLS=50 ELUNAR_RACES=20 cargo test -p host-train --test kills -- --ignored --nocapture --test-threads 1
//! ```
#![cfg(unix)]

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Child, ExitStatus, Stdio};
use std::time::{Duration, Instant};
use support::Shell;

mod support;

/// The exit code that asks to try again.
const TRY_AGAIN: i32 = 75;

/// A command with one output, `out`.
struct Job {
    name: &'static str,
    words: Vec<&'static str>,
    /// Options of another run on the same output, whose result differs; none if it does not race.
    other: Vec<&'static str>,
    /// What goes on with the output, if that is not the same command; it needs this file in the output.
    resume: Option<(&'static str, Vec<&'static str>)>,
}

impl Job {
    fn other_words(&self) -> Vec<&'static str> {
        [&self.words[..], &self.other].concat()
    }

    /// Returns the command that goes on with what a killed run has left.
    fn again(&self, shell: &Shell) -> &[&'static str] {
        match &self.resume {
            Some((file, words)) if shell.path("out").join(file).exists() => words,
            _ => &self.words,
        }
    }
}

/// Returns all jobs; each takes a second or a few.
fn jobs() -> Vec<Job> {
    let scene = "--image s/scene_0000_image.tif --coarse s/scene_0000_coarse.tif";
    let job = |name, words: &str, other: &str| {
        let split = |text: &str| text.split_whitespace().map(|word| &*word.to_string().leak()).collect::<Vec<_>>();
        Job { name, words: split(&format!("{name} {words}")), other: split(other), resume: None }
    };
    let small = "--start-from small.safetensors --steps 8 --batch 1 --set recipe.crop=[32,32] recipe.crops_per_tile=8 recipe.pool=1 recipe.balanced=false";
    let often = "recipe.validation_tiles=1 recipe.validate_every=4 recipe.checkpoint_every=2 --out out";
    let mut train = job("train", &format!("{small} {often}"), "--seed 9");
    train.resume = Some(("run.json", vec!["train", "--out", "out", "--resume"]));
    vec![
        job("mosaic", "s/scene_0000_truth.tif s/scene_0000_coarse.tif -o out.tif", "--tr 3"),
        job("predict", &format!("{scene} --model nano.eld --threads 1 -o out.tif"), "--no-anchor"),
        job("prepare", &format!("{scene} --dtm s/scene_0000_truth.tif --shard-tiles 1 --out out"), "--seed 9"),
        job("export", "--weights small.safetensors --tiles 1 --compare 0 -o out.eld", "--precision int8"),
        // What a killed `batch` has started goes on without it, and is waited for.
        job("batch", "--manifest list.jsonl --jobs 2 --wait 120", ""),
        train,
    ]
}

/// Returns a folder with what the jobs read.
fn bench() -> Shell {
    let shell = Shell::with_scene("640", "512");
    let scene = "s/scene_0000_image.tif,s/scene_0000_coarse.tif,nano.eld";
    let table = format!(
        "id,image,coarse,model,output,options.no_anchor\na,{scene},out/a.tif,false\nb,{scene},out/b.tif,true\n"
    );
    std::fs::write(shell.path("list.csv"), table).unwrap();
    shell.made(&["manifest", "--table", "list.csv", "-o", "list.jsonl"]);
    shell
}

/// Returns a number of `0..=most` (xorshift64*).
fn number(state: &mut u64, most: u64) -> u64 {
    *state ^= *state >> 12;
    *state ^= *state << 25;
    *state ^= *state >> 27;
    (state.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 11) % (most + 1)
}

/// Returns the files of the output, with their names.
fn result(shell: &Shell) -> BTreeMap<String, Vec<u8>> {
    fn add(path: &Path, name: &str, to: &mut BTreeMap<String, Vec<u8>>) {
        if path.is_dir() {
            for entry in std::fs::read_dir(path).unwrap().map(Result::unwrap) {
                let inner = format!("{name}/{}", entry.file_name().to_str().unwrap());
                add(&entry.path(), &inner, to);
            }
        } else {
            let bytes = std::fs::read(path).unwrap();
            // Of a claim that was killed before its first byte, nobody can say whose it is.
            if !(bytes.is_empty() && name.contains("/.tmp") && name.ends_with(".lock")) {
                to.insert(name.into(), bytes);
            }
        }
    }
    let mut all = BTreeMap::new();
    for name in shell.files().iter().filter(|name| name.starts_with("out")) {
        add(&shell.path(name), name, &mut all);
    }
    all
}

/// Removes the output, and what is beside it.
fn clear(shell: &Shell) {
    for name in shell.files().iter().filter(|name| name.starts_with("out")) {
        let path = shell.path(name);
        if path.is_dir() { std::fs::remove_dir_all(path) } else { std::fs::remove_file(path) }.unwrap();
    }
}

fn start(shell: &Shell, words: &[&str]) -> Child {
    shell.command(words).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// Removes the output and makes it without a disturbance; returns it and the time.
fn alone(shell: &Shell, words: &[&str]) -> (BTreeMap<String, Vec<u8>>, Duration) {
    clear(shell);
    let begin = Instant::now();
    let out = shell.run(words);
    assert!(out.status.success(), "{words:?}: {}", String::from_utf8_lossy(&out.stderr));
    (result(shell), begin.elapsed())
}

/// Says in which files two outputs differ.
fn differences(a: &BTreeMap<String, Vec<u8>>, b: &BTreeMap<String, Vec<u8>>) -> Vec<String> {
    let names: std::collections::BTreeSet<_> = a.keys().chain(b.keys()).collect();
    names.into_iter().filter(|name| a.get(*name) != b.get(*name)).cloned().collect()
}

/// Kills a job and goes on with it, `count` times; each time the output must be the one of a run that nothing disturbs.
fn kill(shell: &Shell, job: &Job, count: u64, state: &mut u64) {
    let (expected, took) = alone(shell, &job.words);
    let (again, other_took) = alone(shell, &job.words);
    assert_eq!(differences(&expected, &again), [""; 0], "{}: without a kill", job.name);
    let window = u64::try_from(took.max(other_took).as_micros()).unwrap() * 11 / 10;
    // Kills before there was anything of an output, while there was, and too late.
    let (mut early, mut midst, mut late) = (0, 0, 0);
    for round in 0..count {
        clear(shell);
        let mut done = false;
        // Now and then, what goes on is killed, too.
        for _ in 0..=number(state, 2) / 2 {
            let mut child = start(shell, job.again(shell));
            std::thread::sleep(Duration::from_micros(number(state, window)));
            _ = child.kill();
            let status = child.wait().unwrap();
            done = status.success();
            assert!(done || status.code().is_none(), "{} {round}: {status}", job.name);
            let some = shell.files().iter().any(|name| name.starts_with("out"));
            *if done {
                &mut late
            } else if some {
                &mut midst
            } else {
                &mut early
            } += 1;
            if done {
                break;
            }
        }
        if !done {
            let words = job.again(shell);
            let out = shell.run(words);
            assert!(out.status.success(), "{} {round}: {words:?}: {}", job.name, String::from_utf8_lossy(&out.stderr));
        }
        assert_eq!(differences(&result(shell), &expected), [""; 0], "{} {round}", job.name);
    }
    println!(
        "{}: {early} kills before an output, {midst} with a part of one, {late} too late; {took:?} alone",
        job.name
    );
    assert!(midst >= count / 4, "{}: too few kills while it worked", job.name);
}

/// Starts two runs of a job on one output, `count` times; the output must be the one of a run that says it succeeded.
fn race(shell: &Shell, job: &Job, count: u64, state: &mut u64) {
    let words = [job.words.clone(), job.other_words()];
    let (results, times): (Vec<_>, Vec<_>) = words.iter().map(|words| alone(shell, words)).unzip();
    assert_ne!(differences(&results[0], &results[1]), [""; 0], "{}: options without an effect", job.name);
    let window = u64::try_from(times.iter().max().unwrap().as_micros()).unwrap();
    let (mut apart, mut refused) = (0, 0);
    for round in 0..count {
        clear(shell);
        let first = number(state, 1) as usize;
        // Half of the pairs start together.
        let pause = if number(state, 1) == 0 { number(state, 20_000) } else { number(state, window) };
        let mut one = start(shell, &words[first]);
        std::thread::sleep(Duration::from_micros(pause));
        let over = one.try_wait().unwrap().is_some();
        let mut two = start(shell, &words[1 - first]);
        let ends: [ExitStatus; 2] = [one.wait().unwrap(), two.wait().unwrap()];
        let found = result(shell);
        let fits = |run: usize| differences(&found, &results[if run == 0 { first } else { 1 - first }]).is_empty();
        let which = format!("{} {round}: {ends:?} after {pause} us", job.name);
        let codes = ends.map(|end| end.code().expect("an exit code"));
        match codes {
            [0, 0] => assert!(fits(1) || (!over && fits(0)), "{which}: neither"),
            [0, TRY_AGAIN] => assert!(fits(0), "{which}"),
            [TRY_AGAIN, 0] => assert!(fits(1), "{which}"),
            // Some folders are not made anew by another run.
            [0, 64 | 65] => assert!(fits(0) && ["train", "prepare"].contains(&job.name), "{which}"),
            _ => panic!("{which}"),
        }
        *if codes.contains(&TRY_AGAIN) { &mut refused } else { &mut apart } += 1;
    }
    println!("{}: {refused} races in which one was refused, {apart} one after the other", job.name);
}

/// Returns a count from the environment.
fn count(name: &str, default: u64) -> u64 {
    std::env::var(name)
        .map_or(default, |text| text.parse().unwrap_or_else(|_| panic!("{name}: expected a number, found {text}")))
}

/// Returns whether the environment asks for this job; without a wish, all are asked for.
fn asked(job: &Job) -> bool {
    std::env::var("ELUNAR_JOBS").map_or(true, |names| names.split(',').any(|name| name == job.name))
}

#[test]
fn a_few_kills_and_races() {
    let (shell, mut state) = (bench(), 7);
    for job in jobs().iter().filter(|job| ["mosaic", "prepare"].contains(&job.name)) {
        kill(&shell, job, 4, &mut state);
        race(&shell, job, 2, &mut state);
    }
}

/// A campaign that runs seldom would not notice that one of its commands is refused.
#[test]
fn every_command_of_the_campaign_runs() {
    let shell = bench();
    jobs().iter().for_each(|job| kill(&shell, job, 0, &mut 7));
}

#[test]
#[ignore = "a campaign: minutes to hours"]
fn many_kills() {
    let shell = bench();
    for job in jobs().iter().filter(|job| asked(job)) {
        kill(&shell, job, count("ELUNAR_KILLS", 50), &mut count("ELUNAR_SEED", 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    }
}

#[test]
#[ignore = "a campaign: minutes to hours"]
fn many_races() {
    let shell = bench();
    for job in jobs().iter().filter(|job| asked(job) && !job.other.is_empty()) {
        race(&shell, job, count("ELUNAR_RACES", 20), &mut count("ELUNAR_SEED", 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    }
}
