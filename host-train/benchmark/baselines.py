#!/usr/bin/env python3
"""baselines.py SUITE: prints baselines.csv from the folder that `host-train suite` filled: the figures of every method on every scene.

The coarse DTM's figures are those of results.json. Those of the DTMs are score.py's; they must agree with results.json to 1e-6.
"""
import csv
import json
import sys
from pathlib import Path

from score import FIGURES, scored, table_row

COARSE = "coarse DTM"


def figures_of(judged):
    heights, relief = judged["heights"], judged["relief"]
    figures = {name: heights[name] for name in ("pixels", *FIGURES) if name in heights}
    return figures | {"slope_vector": relief["slope_vector_error"]}


suite = Path(sys.argv[1])
results = json.loads((suite / "results.json").read_text())
theirs = {(j["method"], s["name"]): figures_of(j) for s in results["scenes"] for j in s["judged"]}
out = csv.writer(sys.stdout, lineterminator="\n")
out.writerow(("method", "scene", "pixels", *FIGURES))
for method in results["methods"]:
    name = method if isinstance(method, str) else method["name"]
    if name.endswith(".safetensors"):
        continue  # the float networks; the int8 files are what people run
    found = {scene: figures for (of, scene), figures in theirs.items() if of == name}
    if name != COARSE:
        ours, absent = scored(suite / "scenes", suite / "dtm" / name)
        assert not absent, (name, absent)
        for scene, figures in ours.items():
            for figure in FIGURES:
                difference = abs(figures[figure] / found[scene][figure] - 1)
                assert difference < 1e-6, (name, scene, figure, difference)
        found = ours
    for scene, figures in found.items():
        out.writerow(("coarse" if name == COARSE else name.removesuffix(".eld"), scene, *table_row(figures)))
