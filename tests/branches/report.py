#!/usr/bin/env python3
"""Compares Memcheck's reports with expected.csv; run.sh calls it: report.py FOLDER [--write].

expected.csv: kind of report (branch or look-up), source file, code of the line, reason. record.csv: what ran. A frame of this repository's sources that is
nearest to the instruction gives the line.
"""

import csv
import pathlib
import sys
import xml.etree.ElementTree as tree

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
KINDS = {"UninitCondition": "branch", "UninitValue": "look-up"}
COLUMNS = ["kernel", "network", "tiles", "steps", "macs", "branches", "look-ups"]
PLANTED = "tests/branches/src/main.rs"


def place(error):
    """Returns the file, line and code of a report."""
    for frame in error.find("stack").iter("frame"):
        path = pathlib.Path(frame.findtext("dir", "")) / frame.findtext("file", "")
        if path.is_relative_to(ROOT):
            line = int(frame.findtext("line"))
            return path.relative_to(ROOT).as_posix(), line, path.read_text().splitlines()[line - 1].strip()
    return error.find("stack").findtext("frame/fn", "?"), 0, ""


def reports(path):
    """Returns the set of (kind, file, line, code) in a report of Memcheck."""
    root = tree.parse(path).getroot()
    return {(KINDS.get(error.findtext("kind"), error.findtext("kind")), *place(error)) for error in root.iter("error")}


def main(folder, options):
    with open(HERE / "expected.csv", newline="") as text:
        expected = [tuple(row[column] for column in ("kind", "file", "code")) for row in csv.DictReader(text)]
    faults, met, rows = set(), set(), []
    for path in sorted(folder.glob("*.xml")):
        found = reports(path)
        listed = {row: [e for e in expected if (row[0], row[1]) == e[:2] and row[3].startswith(e[2])] for row in found}
        met |= {e for of_row in listed.values() for e in of_row}
        others = [row for row, of_row in listed.items() if not of_row]
        if path.stem.endswith("-planted"):
            if sorted((kind, file) for kind, file, *_ in others) != [("branch", PLANTED), ("look-up", PLANTED)]:
                faults.add(f"planted: expected a branch and a look-up in {PLANTED}, found {others}")
            continue
        faults |= {f"{kind} at {file}:{line}: {code}" for kind, file, line, code in others}
        kernel, tiles, steps, macs = path.with_suffix(".counts").read_text().strip().split(",")
        count = [len({e for of_row in listed.values() for e in of_row if e[0] == kind}) for kind in ("branch", "look-up")]
        rows.append([kernel, path.stem.split("-", 1)[1], tiles, steps, macs, *map(str, count)])
    faults |= {f"listed, but not found: {' '.join(e)}" for e in set(expected) - met}
    lines = [COLUMNS, *rows]
    if "--write" in options:
        with open(HERE / "record.csv", "w", newline="") as text:
            csv.writer(text, lineterminator="\n").writerows(lines)
    elif list(csv.reader(open(HERE / "record.csv", newline=""))) != lines:
        faults.add(f"expected what record.csv has (--write writes it), found {rows}")
    for fault in sorted(faults):
        print(f"FAIL {fault}")
    if faults:
        sys.exit(1)
    macs = sum(int(row[4]) for row in rows)
    print(f"PASS {len(rows)} runs, {macs} multiply-accumulates; {len(expected)} listed reports, no other; the planted branch and look-up found")


main(pathlib.Path(sys.argv[1]), sys.argv[2:])
