#!/usr/bin/env python3
"""Mutants: small changes of the code, each of which must fail a test. They are those of cargo-mutants (cargo install cargo-mutants --locked).

    tests/mutants/run.py [AREA..]                     tries the sample of the areas, without AREA of all
    tests/mutants/run.py --since COMMIT [AREA..]      tries all mutants of the lines of the areas that changed since then, and records nothing
    tests/mutants/run.py --write [AREA..]             writes what was found into record.csv; a survivor that survivors.csv does not name is an error
    ELUNAR_MUTANTS=DIR    copy of the source, programs and results (default: target/mutants)
    ELUNAR_EVERY=N        tries every N-th mutant of an area instead of its own sample

All mutants of a package are in one program of its unit tests, or in programs of tests where a package has no others: a changed function has a body
for each, which the environment selects. So a mutant takes seconds, not a build. Mutants outside of functions, and those that do not compile, are not
tried. Only tests with the area's names run, without the longest ones; the first failure ends them, and so does five times the processor's time that
they take without a mutant. A run that was stopped goes on where it was; what survived is tried again.
"""

import csv
import datetime
import json
import os
import pathlib
import re
import resource
import shutil
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
FOLDER = pathlib.Path(os.environ.get("ELUNAR_MUTANTS", ROOT / "target/mutants")).resolve()
TABLE, EQUIVALENT = HERE / "record.csv", HERE / "survivors.csv"
COLUMNS = ["area", "mutants", "tried every", "not tried", "killed", "equivalent", "survive", "killed %", "date", "commit"]
LEAST = 95.0
# Of the processor; at least so many.
SECONDS = 10
# Take as long as all others together.
SLOW = ["--skip", "no_flipped_bit_changes", "--skip", "whatever_", "--skip", "power_may_go_after_any_byte"]

# Package, its folder, and its programs of tests; none: its unit tests.
CORE, RASTER = ("elunar-core", "core", ()), ("elunar-raster", "host-train/raster", ())
CAPI = (
    "elunar-capi", "onboard/capi",
    ("small_calls", "check_step", "light", "sun", "terrain", "slots", "refusals", "aliasing", "program", "strips", "tiles", "flips"),
)
# Package, files, names of tests, and the sample: every so many mutants.
AREAS = {
    "quant": (CORE, ["quant/*.rs"], ["quant::", "requantise"], 4),
    "norm": (CORE, ["norm/**/*.rs"], ["norm::"], 30),
    "validate": (
        CORE, ["nn/model/validate/*.rs"],
        [*(f"nn::tests::{name}" for name in ("refusals", "work", "model", "schedule", "limits")), "a_validation"], 8,
    ),
    "ops": (
        CORE, ["nn/ops/**/*.rs"],
        ["nn::ops", *(f"nn::tests::{name}" for name in ("conv", "attention", "layer_norm", "upsample", "witness"))], 30,
    ),
    "photoclinometry": (CORE, ["photoclinometry/*.rs"], ["photoclinometry::"], 40),
    "slots": (
        CORE, [f"nn/{name}.rs" for name in ("slots/*", "file/seal", "crc", "scrub", "code", "sum")],
        ["slots::", "crc", "scrub", "sum::", "nn::code", "suspend"], 10,
    ),
    "strip": (CORE, ["strip/*.rs"], ["strip::"], 20),
    "terrain": (CORE, ["terrain/**/*.rs"], ["terrain::"], 10),
    "geotiff": (RASTER, ["geotiff/*.rs"], ["geotiff::"], 40),
    "pds3": (RASTER, ["pds3/*.rs"], ["pds3::"], 18),
    "capi": (CAPI, ["**/*.rs"], [], 12),
}
# Selects a body; in the root of each package. Programs of tests link the library that everybody links.
SELECT = """
pub(crate) fn mutant() -> u32 {
    extern crate std;
    static NUMBER: std::sync::OnceLock<u32> = std::sync::OnceLock::new();
    *NUMBER.get_or_init(|| std::env::var("MUTANT").map_or(0, |text| text.parse().unwrap()))
}
"""


def fail(text):
    sys.exit(f"ERROR: {text}")


def listed(area, *more):
    """Returns mutants of an area."""
    (package, folder, _), files, _, _ = AREAS[area]
    words = [word for name in files for word in ("--file", f"{folder}/src/{name}")]
    done = subprocess.run(["cargo", "mutants", "--list", "--json", "--package", package, *words, *more], cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        fail(f"cargo mutants: {done.stderr.strip()}")
    return [mutant | {"area": area} for mutant in json.loads(done.stdout)]


def index(text, place):
    """Returns where a line and column of cargo-mutants are in a text."""
    lines = text.split("\n")
    return sum(len(line) + 1 for line in lines[: place["line"] - 1]) + place["column"] - 1


def body_of(text):
    """Returns where the body of a function begins, and where its `const` is, if any; None if it was not found."""
    at = 0
    for line in text.split("\n"):
        if not line.strip().startswith(("//", "#[")):
            break
        at += len(line) + 1
    depth = 0
    for i in range(at, len(text)):
        depth += (text[i] in "([") - (text[i] in ")]")
        if text[i] == "{" and depth == 0:
            const = re.compile(r"\bconst (?=(?:unsafe )?fn\b)").search(text, at, i)
            return i, const
    return None


def changed(text, mutants):
    """Returns the source with a body for each mutant, and the lines of each body: (first, last, numbers of mutants, name of the function)."""
    functions = {}
    for mutant in mutants:
        span = mutant["function"]["span"]
        functions.setdefault((index(text, span["start"]), index(text, span["end"])), []).append(mutant)
    parts, bodies, end = [], [], 0
    lines = lambda: 1 + sum(part.count("\n") for part in parts)
    for (first, last), inside in sorted(functions.items()):
        found = body_of(text[first:last])
        if first < end or not found:
            bodies += [(0, -1, [mutant["number"] for mutant in inside], "")]
            continue
        begin, const = first + found[0], found[1]
        head = text[first:begin] if const is None else text[first : first + const.start()] + text[first + const.end() : begin]
        name = inside[0]["function"]["function_name"].split("::")[-1]
        parts += [text[end:first]]
        start = lines()
        parts += [head, "{ match crate::mutant() {\n"]
        for mutant in inside:
            a, b = (index(text, mutant["span"][side]) for side in ("start", "end"))
            parts += [f"{mutant['number']} => "]
            line = lines()
            parts += [text[begin:a], mutant["replacement"], text[b:last], "\n"]
            bodies += [(line, lines() - 1, [mutant["number"]], name)]
        parts += ["_ => ", text[begin:last], "\n} }"]
        bodies += [(start, lines(), [mutant["number"] for mutant in inside], name)]
        end = last
    return "".join([*parts, text[end:]]), bodies


def put(path, text):
    """Writes a file if it has other contents."""
    if not path.is_file() or path.read_text() != text:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def environment():
    # What has mutants is built once and ends soon: what it takes to optimise it would be more.
    profile = {"CARGO_PROFILE_DEV_OPT_LEVEL": "0", "CARGO_PROFILE_DEV_DEBUG": "0", "CARGO_INCREMENTAL": "0"}
    cases = {"PROPTEST_RNG_SEED": "1", "PROPTEST_DISABLE_FAILURE_PERSISTENCE": "true", "ELUNAR_SHARED": str(FOLDER / "none")}
    return os.environ | profile | cases | {"CARGO_TARGET_DIR": str(FOLDER / "programs")}


def cargo(*words):
    """Runs cargo in the copy; returns its messages."""
    done = subprocess.run(["cargo", *words, "--message-format=json"], cwd=FOLDER / "tree", env=environment(), stdout=subprocess.PIPE,
                          stderr=subprocess.DEVNULL, text=True)
    return done.returncode, [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]


def copy_the_source(but):
    """Copies what has changed, but for files that are written with mutants."""
    names = subprocess.run(["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"], cwd=ROOT, check=True, capture_output=True)
    for name in filter(None, names.stdout.decode().split("\0")):
        source, copy = ROOT / name, FOLDER / "tree" / name
        if name not in but and source.is_file() and not (copy.is_file() and copy.read_bytes() == source.read_bytes()):
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, copy)


def programs(package, folder, names, mutants):
    """Builds the tests of a package with these mutants. Returns the programs, and the numbers of those that do not compile."""
    root = f"{folder}/src/lib.rs"
    copy_the_source({mutant["file"] for mutant in mutants} | {root})
    # Those that did not compile before are not tried again: the compiler finds a few at a time.
    kept = FOLDER / f"{package}.refused.json"
    before = json.loads(kept.read_text()) if kept.is_file() else []
    refused = {mutant["number"] for mutant in mutants if mutant["name"] in before}
    for _ in range(20):
        bodies, by_file = {}, {}
        for mutant in mutants:
            by_file.setdefault(mutant["file"], []).append(mutant)
        for name, of_file in by_file.items():
            text, bodies[name] = changed((ROOT / name).read_text(), [mutant for mutant in of_file if mutant["number"] not in refused])
            refused |= {number for first, last, numbers, _ in bodies[name] if last < first for number in numbers}
            put(FOLDER / "tree" / name, text + (SELECT if name == root else ""))
        if root not in by_file:
            put(FOLDER / "tree" / root, (ROOT / root).read_text() + SELECT)
        code, messages = cargo("check", "--package", package, "--lib", "--profile", "test")
        if code == 0:
            break
        count = len(refused)
        errors = [m["message"] for m in messages if m["reason"] == "compiler-message" and m["message"]["level"] == "error"]
        for error in errors:
            # The smallest body around the error, else the function that it names.
            around = [
                (last - first, numbers)
                for span in error["spans"] if span["is_primary"]
                for first, last, numbers, _ in bodies.get(span["file_name"], [])
                if first <= span["line_start"] <= last
            ]
            named = re.findall(r"`([^`]*)`", error["message"])
            last_words = {word.split("::")[-1] for word in named}
            of_name = [numbers for of_file in bodies.values() for _, _, numbers, name in of_file if name in last_words]
            for numbers in [min(around)[1]] if around else of_name:
                refused |= set(numbers)
        kept.write_text(json.dumps([mutant["name"] for mutant in mutants if mutant["number"] in refused]))
        if len(refused) == count:
            fail(f"{package}: does not compile with its mutants: {errors[0]['rendered'] if errors else 'no message'}")
    # What has no mutants of its own takes most of such programs' time.
    quick = ["--config", "profile.dev.package.elunar-core.opt-level=2"]
    words = [word for name in names for word in ("--test", name)] + quick if names else ["--lib"]
    code, messages = cargo("test", "--package", package, *words, "--no-run")
    made = {m["target"]["name"]: m["executable"] for m in messages if m["reason"] == "compiler-artifact" and m["profile"]["test"] and m["executable"]}
    if code or len(made) != max(len(names), 1):
        fail(f"{package}: expected {len(names) or 'a program of unit'} tests, found {', '.join(made) or 'none'}")
    return [made[name] for name in names or made], refused


def killer(made, folder, names, number):
    """Returns the first of the tests with these names that fails; None if all pass. `made`: each program, and its seconds of the processor."""
    words = ["-Z", "unstable-options", "--fail-fast", "--test-threads", "1", *SLOW]
    for tests, seconds in made:
        limit = lambda: resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
        done = subprocess.run(["nice", "-n", "19", tests, *names, *words], cwd=FOLDER / "tree" / folder, preexec_fn=limit, capture_output=True,
                              env=environment() | {"MUTANT": str(number), "RUSTC_BOOTSTRAP": "1"})
        if done.returncode:
            failed = re.search(r"^test (\S+) \.\.\. FAILED", done.stdout.decode(errors="replace"), re.MULTILINE)
            return failed[1] if failed else f"ended with {done.returncode}"
    return None


def spent():
    """Returns the processor's time of all programs so far."""
    times = resource.getrusage(resource.RUSAGE_CHILDREN)
    return times.ru_utime + times.ru_stime


def results_of(area):
    path = FOLDER / f"{area}.csv"
    if not path.is_file():
        return {}
    with path.open() as file:
        return {row[0]: row[1] for row in csv.reader(file)}


def try_all(areas, since):
    FOLDER.mkdir(parents=True, exist_ok=True)
    packages = {}
    for area in areas:
        package, _, _, every = AREAS[area]
        if since:
            (FOLDER / "diff").write_text(subprocess.run(["git", "diff", since], cwd=ROOT, check=True, capture_output=True, text=True).stdout)
            (FOLDER / f"{area}.csv").unlink(missing_ok=True)
            chosen = listed(area, "--in-diff", str(FOLDER / "diff"))
        else:
            chosen = listed(area)[:: int(os.environ.get("ELUNAR_EVERY", every))]
        packages.setdefault(package, []).extend(chosen)
    for (package, folder, names), mutants in packages.items():
        for number, mutant in enumerate(mutants, 1):
            mutant["number"] = number
        inside = [mutant for mutant in mutants if mutant["function"]]
        made, refused = programs(package, folder, names, inside)
        timed = {}
        for area in dict.fromkeys(mutant["area"] for mutant in mutants):
            timed[area] = []
            for tests in made:
                before = spent()
                if by := killer([(tests, resource.RLIM_INFINITY)], folder, AREAS[area][2], 0):
                    fail(f"{area}: a test fails without a mutant: {by}")
                timed[area].append((tests, max(SECONDS, round(5 * (spent() - before)))))
            print(f"{area}: a mutant has {' + '.join(str(most) for _, most in timed[area])} s", flush=True)
        for mutant in mutants:
            area, name = mutant["area"], mutant["name"]
            if results_of(area).get(name) in ("killed", "not tried"):
                continue
            outcome, by = "not tried", None
            if mutant["function"] and mutant["number"] not in refused:
                by = killer(timed[area], folder, AREAS[area][2], mutant["number"])
                outcome = "killed" if by else "survives"
            with (FOLDER / f"{area}.csv").open("a") as file:
                csv.writer(file, lineterminator="\n").writerow([name, outcome, by])
            print(f"{area}: {outcome}: {name}" + (f" (by {by})" if by else ""), flush=True)


def without_place(name):
    """Returns file and change, without line and column, which other changes move."""
    file, _line, _column, what = name.split(":", 3)
    return file, what.strip()


def write(areas):
    rows, faults = {}, []
    if TABLE.exists():
        with TABLE.open() as file:
            rows = {row["area"]: row for row in csv.DictReader(file)}
    with EQUIVALENT.open() as file:
        equivalent = {(row["file"], row["mutant"]) for row in csv.DictReader(file)}
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.strip()
    for area in areas:
        found = results_of(area)
        if not found:
            fail(f"{FOLDER / area}.csv: expected the results of 'run.py {area}'")
        every, mutants = int(os.environ.get("ELUNAR_EVERY", AREAS[area][3])), listed(area)
        left = {mutant["name"] for mutant in mutants[::every]} - set(found)
        if left:
            fail(f"{area}: expected results of its whole sample, {len(left)} are missing: run.py {area}")
        found = {mutant["name"]: found[mutant["name"]] for mutant in mutants[::every]}
        of = lambda outcome: [without_place(name) for name, value in found.items() if value == outcome]
        killed, survivors = len(of("killed")), of("survives")
        equal = [mutant for mutant in survivors if mutant in equivalent]
        share = 100 * killed / max(killed + len(survivors), 1)
        values = [area, len(mutants), every, len(of("not tried")), killed, len(equal), len(survivors) - len(equal), f"{share:.1f}"]
        rows[area] = dict(zip(COLUMNS, [*values, datetime.date.today().isoformat(), commit]))
        new = [mutant for mutant in survivors if mutant not in equivalent]
        faults += [f"{file}: {what}: survives, expected a test or a row of survivors.csv" for file, what in new]
        if share < LEAST:
            faults.append(f"{area}: expected {LEAST:.0f} % killed, found {share:.1f}")
    with TABLE.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows.values())
    killed, left = (sum(int(row[name]) for row in rows.values()) for name in ("killed", "survive"))
    tried = killed + left + sum(int(row["equivalent"]) for row in rows.values())
    print(f"{killed} of {tried} killed")
    if faults:
        fail("\nERROR: ".join(faults))


def main(words):
    mode = words.pop(0) if words and words[0] in ("--since", "--write") else None
    if mode == "--since" and not words:
        fail("--since: expected a commit")
    since = words.pop(0) if mode == "--since" else None
    areas = words or list(AREAS)
    if unknown := [area for area in areas if area not in AREAS]:
        fail(f"expected areas ({' '.join(AREAS)}), found '{unknown[0]}'")
    if mode == "--write":
        write(areas)
    else:
        try_all(areas, since)


if __name__ == "__main__":
    main(sys.argv[1:])
