#!/usr/bin/env python3
"""Bytes that a tile of the int8 runner moves between caches, by Valgrind's cache simulator.

    python3 benches/traffic.py PROGRAM [MODEL] [--first 49152,12,64] [--last 2097152,16,64] [--kept FOLDER]

PROGRAM is elunar or host-train; MODEL `nano`. The caches are a core's first (bytes, ways, bytes of a line) and its last own one. Valgrind knows no
AVX-512, so the kernel is that of AVX2. A tile is a sixth of the difference between `inspect MODEL --time`, which runs six, and `inspect MODEL`. CSV rows:
part of the runner, and bytes read and written beyond either cache, whole lines; then the model's constants and arena for comparison. With --kept the
files of an earlier run in FOLDER are used if they are there. Needs valgrind; 5 to 30 minutes.
"""
import argparse
import collections
import re
import subprocess
import tempfile
from pathlib import Path

TILES = 6
EVENTS = ["D1mr", "D1mw", "DLmr", "DLmw"]


def part(function):
    if "::sum::" in function or function.endswith("::sum"):
        return "checksums"
    return "operators" if "::unit::" in function else "rest"


def counts(path):
    """Events by part of the runner."""
    found, events, function = collections.defaultdict(lambda: dict.fromkeys(EVENTS, 0)), [], ""
    for line in path.read_text().splitlines():
        if line.startswith("events:"):
            events = line.split()[1:]
        elif line.startswith("fn="):
            function = part(line[3:])
        elif line[:1].isdigit():
            row = dict(zip(events, map(int, line.split()[1:])))
            for event in EVENTS:
                found[function][event] += row.get(event, 0)
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=lambda word: Path(word).resolve())
    parser.add_argument("model", nargs="?", default="nano")
    parser.add_argument("--first", default="49152,12,64")
    parser.add_argument("--last", default="2097152,16,64")
    parser.add_argument("--kept", type=Path)
    a = parser.parse_args()
    line_bytes = int(a.first.split(",")[2])
    with tempfile.TemporaryDirectory() as made:
        folder = a.kept or Path(made)
        folder.mkdir(parents=True, exist_ok=True)
        for name, words in [("alone", []), ("timed", ["--time"])]:
            if (folder / f"{name}.txt").exists():
                continue
            how = ["--tool=cachegrind", "--cache-sim=yes", f"--D1={a.first}", f"--LL={a.last}", f"--cachegrind-out-file={folder / name}.out"]
            done = subprocess.run(["valgrind", *how, a.program, "inspect", a.model, *words], capture_output=True, text=True)
            if done.returncode:
                raise SystemExit(f"ERROR: valgrind: {done.stderr.strip().splitlines()[-1]}")
            (folder / f"{name}.txt").write_text(done.stdout)
        alone, timed = counts(folder / "alone.out"), counts(folder / "timed.out")
        text = (folder / "timed.txt").read_text()
    print("part,read_beyond_first,written_beyond_first,read_beyond_last,written_beyond_last")
    rows = {name: [(timed[name][event] - alone[name][event]) * line_bytes / TILES for event in EVENTS] for name in ("operators", "checksums", "rest")}
    rows["all"] = [sum(values) for values in zip(*rows.values())]
    for name, values in rows.items():
        print(name, *(f"{value:.0f}" for value in values), sep=",")
    kernel = re.search(r"kernel (\S+):", text)[1]
    arena, constants = re.search(r"arena (\d+) bytes", text)[1], re.search(r"constants (\d+) bytes", text)[1]
    print(f"# {a.model}, kernel {kernel}: constants {constants} bytes, arena {arena} bytes; caches {a.first} and {a.last}")


if __name__ == "__main__":
    main()
