#!/usr/bin/env python3
"""The best other runtime on every processor that has a record, as the table of `README.md`.

    benches/peers/best.py            prints it; fails where README.md has another
    benches/peers/best.py --write    writes it there

Of a processor, the newest record of a network and a number of threads counts. Needs nothing but Python.
"""
import csv
import re
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
RECORDS = HERE.parent / "record"
README = HERE / "README.md"
NETWORKS = ("nano", "tiny", "small", "paper")
PLACE = re.compile(r"(<!-- table best -->\n).*?(<!-- end -->)", re.S)


def best():
    """By processor and number of threads, then by network: fastest time over our fastest, which other users of a machine disturb least, and the
    runtime's name."""
    found = {}
    for path in sorted(RECORDS.glob("*/*-peers*/tiles.csv")):
        threads = re.fullmatch(r"\d{4}-\d\d-\d\d-peers(?:-(\d+)-threads)?", path.parent.name)[1] or "1"
        of = found.setdefault((path.parent.parent.name, threads), {})
        rows = list(csv.DictReader(path.open()))
        for network in {row["network"]: None for row in rows}:
            others = [row for row in rows if row["network"] == network and not row["runtime"].startswith("ours,")]
            fastest = min(others, key=lambda row: float(row["fastest"]))
            of[network] = f"{fastest['fastest / ours']} {fastest['runtime'].removesuffix(' (NNCF)')}"
    return found


def table(found):
    """Its lines."""
    rows = [["processor", "threads", *NETWORKS], ["---"] * (2 + len(NETWORKS))]
    rows += [[*place, *(of.get(network, "") for network in NETWORKS)] for place, of in sorted(found.items())]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def main():
    lines = table(best())
    text = README.read_text()
    new = PLACE.sub(lambda place: place[1] + lines + place[2], text)
    print(lines, end="")
    if "--write" in sys.argv[1:]:
        README.write_text(new)
    elif new != text:
        raise SystemExit(f"ERROR: {README.name}: another table of the best runtimes found than the records have; see --write")


if __name__ == "__main__":
    main()
