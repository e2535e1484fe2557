#!/usr/bin/env python3
"""The report of coverage.sh, which calls it: coverage.py FOLDER [--write] [--missed] PACKAGE.. compares what llvm-cov found with coverage.csv."""

import csv
import json
import pathlib
import re
import sys

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent
TABLE = HERE / "coverage.csv"
MISSED = HERE / "missed.csv"
COLUMNS = ["package", "lines", "missed lines", "branches", "missed branches"]
SOURCES = {"elunar-core": "core/src", "elunar-capi": "onboard/capi/src", "elunar-raster": "host-train/raster/src"}
# Kernels for one kind of processor, and the choice among them.
MACHINES = re.compile(r"core/src/nn/kernels/x86_|core/src/nn/dispatch/")


def test_code(folder):
    """Returns the files below a folder that are tests, and the lines of tests in the other ones."""
    files, lines = set(), set()
    for path in sorted(folder.rglob("*.rs")):
        text = path.read_text().splitlines()
        for number, line in enumerate(text):
            if line.strip() != "#[cfg(test)]":
                continue
            item = text[number + 1]
            if named := re.fullmatch(r"\s*(?:pub.* )?mod (\w+);", item):
                home = path.parent if path.name in ("mod.rs", "lib.rs") else path.with_suffix("")
                files |= {home / f"{named[1]}.rs", *(home / named[1]).rglob("*.rs")}
            # The sources are formatted: an item of several lines ends at the first closing brace as far to the left as it begins.
            indent = item[: len(item) - len(item.lstrip())]
            end = number + 1
            while not item.endswith((";", ",")) and text[end].rstrip(",;") != indent + "}":
                end += 1
            lines |= {(path, one) for one in range(number + 1, end + 2)}
    return files, lines


def read(made, package):
    """Returns {(file, line): times} and {(file, place, outcome): times} of a package's own code."""
    folder = ROOT / SOURCES[package]
    files, tests = test_code(folder)

    def ours(path, line):
        name = path.relative_to(ROOT).as_posix() if path.is_relative_to(folder) else ""
        return name and path not in files and (path, line) not in tests and not MACHINES.match(name)

    lines, branches = {}, {}
    path = None
    for line in (line for found in sorted(made.glob("*.info")) for line in found.read_text().splitlines()):
        kind, _, rest = line.partition(":")
        if kind == "SF":
            path = pathlib.Path(rest)
        elif kind == "DA":
            number, times = map(int, rest.split(",")[:2])
            if ours(path, number):
                lines[path, number] = lines.get((path, number), 0) + times
    for file in (file for found in sorted(made.glob("*.json")) for file in json.loads(found.read_text())["data"][0]["files"]):
        path = pathlib.Path(file["filename"])
        for branch in file["branches"]:
            place = tuple(branch[:4])
            if not ours(path, place[0]):
                continue
            for outcome, times in (("true", branch[4]), ("false", branch[5])):
                key = path, place, outcome
                branches[key] = branches.get(key, 0) + times
    return lines, branches


def argued():
    """Returns [(file, code)] of the table of what no test can reach; a row whose code is not there is an error."""
    with (HERE / "unreached.csv").open(newline="") as file:
        rows = [(ROOT / row["file"], row["code"]) for row in csv.DictReader(file) if row["reason"]]
    for path, code in rows:
        if not path.is_file() or code not in path.read_text():
            sys.exit(f"ERROR: tests/unreached.csv: {path.relative_to(ROOT)}: expected the code {code!r}, found none")
    return rows


def share(missed, of):
    return f"{100 * (of - missed) / max(of, 1):.2f} %"


def show(lines, branches, every):
    """Prints what is missed in each file, and how many branches no test can reach."""
    missed = [key for key, times in branches.items() if not times]
    unrun = [key for key, times in lines.items() if not times]
    rows, open_ = argued(), []
    for key in missed:
        text = key[0].read_text().splitlines()[key[1][0] - 1]
        if not any(path == key[0] and code in text for path, code in rows):
            open_.append(key)
    print(f"  {len(missed) - len(open_)} of {len(missed)} missed branches cannot be reached (tests/unreached.csv)")
    for path in sorted({key[0] for key in missed + unrun}):
        name = path.relative_to(ROOT)
        of_file, lines_of = [key for key in missed if key[0] == path], [key for key in unrun if key[0] == path]
        print(f"  {len(of_file):4} branches {len(lines_of):4} lines  {name}")
        if every:
            text = path.read_text().splitlines()
            for _, (row, col, *_rest), outcome in sorted(of_file):
                mark = "" if (path, (row, col, *_rest), outcome) in open_ else "argued: "
                print(f"    {name}:{row}:{col}: {mark}never {outcome}: {text[row - 1].strip()}")
            for _, row in sorted(lines_of):
                print(f"    {name}:{row}: never run: {text[row - 1].strip()}")


def write_missed(package, lines, branches):
    """Writes the source lines that tests miss, wholly or in one outcome, each by its text and by how often the file has it up to there; and a row
    `*` for each file that was measured."""
    rows = set()
    for path in {key[0] for key in lines}:
        text, name = path.read_text().splitlines(), path.relative_to(ROOT).as_posix()
        numbers = {row for at, row in (key for key, times in lines.items() if not times) if at == path}
        numbers |= {place[0] for at, place, _ in (key for key, times in branches.items() if not times) if at == path}
        stripped = [line.strip() for line in text]
        rows |= {(name, "*", 1)} | {(name, stripped[row - 1], stripped[:row].count(stripped[row - 1])) for row in numbers}
    if MISSED.exists():
        with MISSED.open(newline="") as file:
            others = [row for row in csv.DictReader(file) if not row["file"].startswith(SOURCES[package] + "/")]
        rows |= {(row["file"], row["code"], int(row["occurrence"])) for row in others}
    with MISSED.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([("file", "code", "occurrence"), *sorted(rows)])


def main():
    folder, options = pathlib.Path(sys.argv[1]), [word for word in sys.argv[2:] if word.startswith("--")]
    packages = [word for word in sys.argv[2:] if not word.startswith("--")]
    with TABLE.open(newline="") as file:
        limits = {row["package"]: row for row in csv.DictReader(file)}
    wrong = []
    for package in packages:
        lines, branches = read(folder / package, package)
        found = [len(lines), sum(not times for times in lines.values()), len(branches), sum(not times for times in branches.values())]
        print(f"{package}: lines {share(found[1], found[0])} ({found[1]} of {found[0]} missed), "
              f"branches {share(found[3], found[2])} ({found[3]} of {found[2]} missed)")
        show(lines, branches, "--missed" in options)
        if "--write" in options:
            limits[package] = dict(zip(COLUMNS, [package, *found]))
            write_missed(package, lines, branches)
        for what, number in (("missed lines", found[1]), ("missed branches", found[3])):
            limit = int(limits.get(package, {}).get(what, 0))
            if number > limit:
                wrong.append(f"{package}: expected at most {limit} {what}, found {number} (tests/coverage.sh --missed {package})")
            if number < limit:
                print(f"{package}: {limit} {what} are stated, found {number}: lower it by tests/coverage.sh --write {package}")
    if "--write" in options:
        with TABLE.open("w", newline="") as file:
            out = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            out.writeheader()
            out.writerows(limits[package] for package in sorted(limits))
    for complaint in wrong:
        print(f"ERROR: {complaint}", file=sys.stderr)
    sys.exit(bool(wrong))


main()
