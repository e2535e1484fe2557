#!/usr/bin/env python3
"""baselines.py OUT: prints baselines.csv from the folder that baselines.sh fills: the figures of every method on every scene, on both tracks.

The coarse DTM's figures are those of results.json. Those of the DTMs are score.py's; they must agree with results.json to 1e-6.
"""
import csv
import json
import sys
from pathlib import Path

from score import FIGURES, rows_of, scored, table_row

COARSE = "coarse DTM"


def figures_of(judged):
    heights, relief = judged["heights"], judged["relief"]
    figures = {name: heights[name] for name in ("pixels", *FIGURES) if name in heights}
    return figures | {"slope_vector": relief["slope_vector_error"]}


def method_rows(scenes, results, name):
    """A method's figures on the scenes of a suite, after a comparison of both programs'."""
    theirs = {s["name"]: figures_of(j) for s in results["scenes"] for j in s["judged"] if j["method"] == name}
    if name == COARSE:
        return theirs
    ours, _ = scored(scenes, scenes / results["suite"] / "dtm" / name)
    assert ours.keys() == theirs.keys(), (name, ours.keys() ^ theirs.keys())
    for scene, figures in ours.items():
        for figure in FIGURES:
            difference = abs(figures[figure] / theirs[scene][figure] - 1)
            assert difference < 1e-6, (name, scene, figure, difference)
    return ours


def main():
    out = csv.writer(sys.stdout, lineterminator="\n")
    out.writerow(("track", "method", "scene", "pixels", *FIGURES))
    suites = dict.fromkeys(scene["suite"] for scene in rows_of("scenes.csv"))
    for track in ("told", "untold"):
        scenes = Path(sys.argv[1]) / track
        found = {}
        for suite in suites:
            results = json.loads((scenes / suite / "results.json").read_text())
            for method in results["methods"]:
                found.setdefault(method["name"], {}).update(method_rows(scenes, results, method["name"]))
        for name, rows in found.items():
            for scene, figures in rows.items():
                out.writerow((track, "coarse" if name == COARSE else name, scene, *table_row(figures)))


if __name__ == "__main__":
    main()
