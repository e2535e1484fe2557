#!/usr/bin/env python3
"""Draws injections, runs the board once for each, and records what comes of them. Called by inject.sh."""

import argparse
import concurrent.futures
import csv
import pathlib
import random
import re
import struct
import subprocess
import sys
import tempfile

CLASSES = ["register", "stack", "code"]
# Registers that are flipped, and their bits: r0 to r12, lr, pc; the instruction and x1 to x31.
REGISTERS = {"an500": (15, 32), "rv64": (32, 64)}
COLUMNS = ["board", "class", "injection", "when", "place", "bit", "outcome", "error_m", "wrong_px", "message"]
WORDS = 7


def arguments():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--injections", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--replay", type=pathlib.Path)
    parser.add_argument("--no-checks", action="store_true")
    parser.add_argument("--board", required=True)
    parser.add_argument("--program", required=True)
    parser.add_argument("--model", required=True)
    parser.add_argument("--start", type=lambda text: int(text, 16), required=True)
    parser.add_argument("--end", type=lambda text: int(text, 16), required=True)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("qemu", nargs="+")
    args = parser.parse_args()
    if args.board not in REGISTERS:
        sys.exit(f"ERROR: {args.board}: expected one of {', '.join(REGISTERS)}")
    return args


def run(args, words, reference):
    """Runs the board with an injection; returns what it printed, or None after an hour, when the board itself no longer works."""
    with tempfile.NamedTemporaryFile() as file:
        file.write(reference + struct.pack("<7I", *words, len(reference) // 4, not args.no_checks))
        file.flush()
        place = args.end - 4 * WORDS - len(reference)
        # Timers count instructions: 1 ns of the board's time each.
        command = [*args.qemu, args.program, "-icount", "shift=0,sleep=off"]
        command += ["-device", f"loader,file={args.model},addr={args.start:#x},force-raw=on"]
        command += ["-device", f"loader,file={file.name},addr={place:#x},force-raw=on"]
        try:
            done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=3600)
        except subprocess.TimeoutExpired:
            return None
        return (done.stdout + done.stderr).decode(errors="replace").replace("\r", "")


def outcome(text):
    """Returns outcome, largest error (metres), number of wrong heights, message."""
    if text is None:
        return "hang", "", "", "no end"
    found = re.search(r"^outcome (\w+) (\S+) (\d+) (\S+)$", text, re.M)
    if found is None:
        lines = [line for line in text.splitlines() if line not in ("", "FAIL")]
        return "crash", "", "", lines[0][:100] if lines else "the board ended"
    name, error_m, wrong, status = found.groups()
    if name == "hang":
        return name, "", "", "no end in three times the work"
    return name, error_m, wrong, {"0x0": "", "0x1": "the code's checksum"}.get(status, f"status {status}")


def drawn(args, ticks):
    source = random.Random(f"{args.seed} {args.board}")
    registers, bits = REGISTERS[args.board]
    for name in CLASSES:
        for number in range(args.injections):
            place = source.randrange({"register": registers, "stack": 2048, "code": 256}[name])
            bit = source.randrange(bits if name == "register" else 8)
            yield [args.board, name, number, source.randrange(1, ticks), place, bit]


def replayed(args):
    with open(args.replay, newline="") as file:
        for row in csv.DictReader(file):
            if row["board"] == args.board:
                yield [row["board"], row["class"], *(int(row[name]) for name in COLUMNS[2:6])]


def main():
    args = arguments()
    args.out.mkdir(parents=True, exist_ok=True)
    clean = run(args, [2**32 - 1, 0, 0, 0, 0], b"") or ""
    found = re.search(r"^ticks (\d+) pixels (\d+) status 0x0\n([0-9a-f]+)$", clean, re.M)
    if found is None:
        sys.exit(f"ERROR: {args.board}: a tile expected, found:\n{clean[:500]}")
    ticks = int(found[1])
    reference = struct.pack(f"<{int(found[2])}I", *(int(found[3][k : k + 8], 16) for k in range(0, len(found[3]), 8)))
    injections = list(replayed(args) if args.replay else drawn(args, ticks))
    path = args.out / "injections.csv"
    is_new = not path.exists()
    counts = {name: {} for name in CLASSES}
    largest = 0.0
    with concurrent.futures.ThreadPoolExecutor(args.jobs) as pool, open(path, "a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if is_new:
            writer.writerow(COLUMNS)
        make = lambda row: run(args, [row[3], CLASSES.index(row[1]) + 1, row[4], row[5], 3 * ticks], reference)
        for done, (row, text) in enumerate(zip(injections, pool.map(make, injections)), 1):
            came = outcome(text)
            writer.writerow([*row, *came])
            file.flush()
            of_class = counts[row[1]]
            of_class[came[0]] = of_class.get(came[0], 0) + 1
            if came[0] == "silent":
                largest = max(largest, float(came[1]))
            print(f"\r{args.board}: {done} of {len(injections)}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    for name, of_class in counts.items():
        all_of_them = sum(of_class.values())
        shares = [f"{what} {100 * of_class.get(what, 0) / max(all_of_them, 1):.1f} %" for what in ("detected", "crash", "hang", "masked", "silent")]
        print(f"{args.board} {name}: {all_of_them} injections, {', '.join(shares)}")
    print(f"{args.board}: largest silent error {largest:.1f} m")


main()
