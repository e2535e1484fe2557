#!/usr/bin/env python3
"""freeze.py SCENES: prints scenes.csv for the scenes that scenes.sh made, when the synthetic Moon has changed. Needs what score.py needs."""
import csv
import sys
import tomllib
from pathlib import Path

from score import HERE, KINDS, map_of, sample_hash

scenes, out = Path(sys.argv[1]), csv.writer(sys.stdout, lineterminator="\n")
out.writerow(("suite", "name", "kind", "sun_azimuth_deg", "sun_elevation_deg", "pixel_m", *(f"{kind}_sha256" for kind in KINDS)))
for suite in ("held-out", "landforms"):
    list_ = tomllib.loads((HERE.parent / f"suites/{suite}.toml").read_text())
    with open(scenes / suite / "scenes/scenes.csv", newline="") as table:
        for entry, (name, *facts) in zip(list_["scene"], list(csv.reader(table))[1:], strict=True):
            assert entry["name"] == name, (entry, name)
            hashes = (sample_hash(map_of(scenes, {"suite": suite, "name": name}, kind)) for kind in KINDS)
            out.writerow((suite, name, entry["kind"], *facts, *hashes))
