#!/usr/bin/env python3
"""Compares what cppcheck's MISRA C:2012 addon finds in the header, the guides' C code and the cFS application with the list of deviations.

    misra.py            more findings than misra.csv has, or a rule without a reason, are errors; fewer ask for --write
    misra.py --write    writes the counts into misra.csv; a new rule gets an empty reason, which is an error
    misra.py --lines    prints every finding

misra.csv: rule, category of the rule, reason of the deviation, file:count. Findings of cppcheck itself (warnings, portability, syntax) are errors.
Stubs of other systems' headers are not reported.
"""

import collections
import csv
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ONBOARD = HERE.parent
TABLE = HERE / "misra.csv"
COLUMNS = ["rule", "category", "reason", "files"]
# The version whose findings are counted: another one finds more or less in the same files.
VERSION = "Cppcheck 2.10"
# Each is a program of its own: its names do not meet those of another.
PROGRAMS = {
    "super-loop": ["super_loop.c", "duty.c", "service.c"],
    "strip": ["strip_service.c"],
    "FreeRTOS": ["freertos_task.c"],
    "RTEMS": ["rtems_task.c"],
    "Zephyr": ["zephyr_thread.c"],
}
INCLUDES = [HERE / "include", HERE / "examples", HERE / "tests/c/stubs"]


def check(sources, includes):
    """Returns the findings in a program as (file, line, what)."""
    command = ["cppcheck", "--quiet", "--std=c99", "--language=c", "--addon=misra", "--enable=warning,portability",
               "-DUINT32_C(c)=c##U", "--suppress=missingIncludeSystem", "--template={file}\t{line}\t{id}"]
    found = subprocess.run(command + [f"-I{folder}" for folder in includes] + sources, check=True, capture_output=True, text=True)
    return {tuple(line.split("\t")) for line in found.stderr.splitlines() if line}


def findings():
    found = set()
    for names in PROGRAMS.values():
        found |= check([HERE / "examples" / name for name in names], INCLUDES)
    cfs = ONBOARD / "cfs"
    with tempfile.TemporaryDirectory() as folder:
        # As a mission's build does: a header for every default of the configuration.
        for header in (cfs / "config").glob("default_*.h"):
            (pathlib.Path(folder) / header.name.removeprefix("default_")).write_text(f'#include "{header}"\n')
        sources = sorted((cfs / "fsw").glob("*/*.c")) + [HERE / "examples/service.c"]
        includes = [*INCLUDES[:2], cfs / "fsw/inc", cfs / "fsw/src", folder, cfs / "test/stubs"]
        found |= check(sources, includes)
    ours = {(str(pathlib.Path(file).resolve().relative_to(ONBOARD)), int(line), what) for file, line, what in found if "/stubs/" not in file}
    for file, line, what in sorted(ours):
        if "--lines" in sys.argv[1:] or not what.startswith("misra-c2012-"):
            print(f"onboard/{file}:{line}: {what}")
    return collections.Counter((what, file) for file, _, what in ours)


def order(rule):
    return [int(number) for number in re.findall(r"\d+", rule)]


def complaints(found, listed, reasons):
    """Returns what is wrong, given counts of (rule, file) found and listed, and the reasons of the rules."""
    for (rule, file), count in sorted(found.items()):
        if count > listed[rule, file]:
            yield f"{file}: {rule}: expected at most {listed[rule, file]} findings, found {count} (misra.py --lines)"
    for (rule, file), count in sorted(listed.items()):
        if count > found[rule, file]:
            yield f"{file}: {rule}: {count} findings are listed, found {found[rule, file]}: lower it by misra.py --write"
    for rule in sorted({rule for rule, _ in found}):
        if not reasons.get(rule):
            yield f"{rule}: expected a reason in misra.csv, found none"


def write(found, rows):
    known = {row["rule"]: row for row in rows}
    with TABLE.open("w", newline="") as file:
        out = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        out.writeheader()
        for rule in sorted({rule.removeprefix("misra-c2012-") for rule, _ in found}, key=order):
            here = sorted((file, count) for (what, file), count in found.items() if what == f"misra-c2012-{rule}")
            old = known.get(rule, {"category": "", "reason": ""})
            out.writerow({**old, "rule": rule, "files": " ".join(f"{file}:{count}" for file, count in here)})


def main():
    if not shutil.which("cppcheck"):
        print("SKIPPED: misra: cppcheck is not here (Debian package cppcheck)")
        return
    version = subprocess.run(["cppcheck", "--version"], capture_output=True, text=True, check=True).stdout.strip()
    if version != VERSION:
        print(f"SKIPPED: misra: the deviations are those of {VERSION}, found {version}")
        return
    with TABLE.open(newline="") as file:
        rows = list(csv.DictReader(file))
    found = findings()
    if "--write" in sys.argv[1:]:
        write(found, rows)
        return
    listed = collections.Counter()
    for row in rows:
        for one in row["files"].split():
            file, _, count = one.rpartition(":")
            listed[f"misra-c2012-{row['rule']}", file] = int(count)
    wrong = list(complaints(found, listed, {f"misra-c2012-{row['rule']}": row["reason"] for row in rows}))
    for complaint in wrong:
        print(f"ERROR: {complaint}", file=sys.stderr)
    print(f"misra: {found.total()} findings of {len({rule for rule, _ in found})} rules, all listed" if not wrong else f"misra: {len(wrong)} faults")
    sys.exit(bool(wrong))


main()
