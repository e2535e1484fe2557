#!/usr/bin/env python3
"""Writes the tables that `card.sh OUT` has made into README.md, nano's card and docs/accuracy.md, between `<!-- table NAME -->` and `<!-- end -->`.

    host-train/models/card.py OUT [--check]      --check: only says which tables would change
"""

import csv
import json
import pathlib
import re
import sys

OUT = pathlib.Path(sys.argv[1])
HERE = pathlib.Path(__file__).resolve().parent
PAGES = HERE.parent.parent / "README.md", HERE / "README.md", HERE.parent / "docs/accuracy.md"
HEIGHTS, SLOPES, WAVES = "RMSE / coarse", "its ratio to coarse", "correlation short waves"
RMSE_M, SLOPE_DEG, SECONDS = "RMSE, m", "slope MAE, °", "time, s"
COARSE, METHODS = "coarse DTM", ("untrained", "nano", "ground")


def rows(part, file):
    with open(OUT / part / file, newline="") as opened:
        return list(csv.DictReader(opened))


def named(part, method):
    """The suite with its float weights names the int8 file so."""
    return "int8" if (part, method) == ("suite", "nano") else method


def scenes(part, method, only=""):
    return [row for row in rows(part, "scenes.csv") if row["method"] == named(part, method) and only in row["scene"]]


def column(part, method, figure, only=""):
    return [float(row[figure]) for row in scenes(part, method, only)]


def mean(part, method, figure, only=""):
    values = column(part, method, figure, only)
    return sum(values) / len(values)


def total(part, kind, method):
    """The row of a kind of scenes, or of all; a list with one kind has no row of all."""
    of = [row for row in rows(part, "sums.csv") if row["method"] == named(part, method)]
    return of[0] if len(of) == 1 else next(row for row in of if row["scenes"] == kind)


def digits(value, count=3):
    return f"{float(value):.{count}f}"


def best(values):
    low = min(map(float, values))
    return [f"**{value}**" if float(value) == low else str(value) for value in values]


def table(heading, lines):
    line = lambda cells: ("| " + " | ".join(cells) + " |").replace("|  |", "| |")
    return "\n".join([line(heading), "|" + "---|" * len(heading), *map(line, lines)])


SETS = [
    ("ten [real images](#real-ground), light fitted", "real"),
    ("the same, azimuth told where there is one", "real-azimuth"),
    ("ray-traced images of real topography, light fitted", "stereolunar-hide"),
    ("crop of a NAC DTM (Apollo 15), rendered under four Suns", "apollo15"),
    ("another generator, one scene", "independent"),
    ("built-in suite, twelve synthetic scenes", "suite"),
]


def adds():
    lines = []
    for name, part in SETS:
        heights, slopes = ([digits(mean(part, method, figure)) for method in METHODS] for figure in (HEIGHTS, SLOPES))
        gains = ", ".join(f"{100 * (1 - float(one) / float(slopes[0])):.0f} %" for one in slopes[1:])
        lines.append([name, *best(heights), *best(slopes), gains])
    heading = ["data", "RMSE: untrained", "`nano`", "`ground`", "slope vectors: untrained", "`nano`", "`ground`", "learning removes"]
    return table(heading, lines)


def front():
    """The README's: slope vectors, mean and worst scene."""
    of = lambda part: [f"{mean(part, method, SLOPES):.3f} ({max(column(part, method, SLOPES)):.3f})" for method in METHODS]
    lines = [[re.sub(r"\[(.*?)\]\(.*?\)", r"\1", name), *of(part)] for name, part in SETS if part in ("real", "real-azimuth", "suite")]
    return table(["data", "untrained", "`nano`", "`ground`"], lines)


REAL = {
    "moon_aristarchus_cp_wac": "Moon, Aristarchus, WAC",
    "north_pole_0": "Moon, north pole, WAC, 1",
    "north_pole_1": "Moon, north pole, WAC, 2",
    "north_pole_2": "Moon, north pole, WAC, 3",
    "north_pole_3": "Moon, north pole, WAC, 4",
    "mars_noctis_hirise": "Mars, Noctis, HiRISE*",
    "mars_cerberus_hirise": "Mars, Cerberus, HiRISE*",
    "mars_gale_hirise_1m": "Mars, Gale, HiRISE, dark dunes",
    "mars_candor_hirise": "Mars, Candor, HiRISE*",
    "mars_gale_hrsc": "Mars, Gale, HRSC",
}


def real(part):
    lines = []
    for scene, name in REAL.items():
        of = {row["method"]: row for row in rows(part, "scenes.csv") if row["scene"] == scene}
        metres = [digits(of[method][RMSE_M], 1) for method in (COARSE, "ground")]
        degrees = [digits(of[method][SLOPE_DEG], 2) for method in (COARSE, "ground")]
        ratios = [best([digits(of[method][figure]) for method in METHODS]) for figure in (HEIGHTS, SLOPES)]
        lines.append([name, *metres, *degrees, *ratios[0], *ratios[1]])
    means = [best([digits(mean(part, method, figure)) for method in METHODS]) for figure in (HEIGHTS, SLOPES)]
    lines.append(["mean", "", "", "", "", *means[0], *means[1]])
    heading = ["scene", "RMSE, m: coarse DTM", "`ground`", "slopes, °: coarse DTM", "`ground`"]
    return table(heading + ["RMSE ratio: untrained", "`nano`", "`ground`", "slopes' ratio: untrained", "`nano`", "`ground`"], lines)


def hard():
    """Scenes that were made harder, and images that show other ground."""
    lists = [
        ("the ten images coarser, or with albedo added", "variants"),
        ("images of other ground, light fitted", "unrelated"),
        ("images of other ground, azimuth told", "unrelated-azimuth"),
    ]
    lines = []
    for name, part in lists:
        cells = [f"{mean(part, m, f):.3f} ({max(column(part, m, f)):.2f})" for f in (HEIGHTS, SLOPES) for m in ("untrained", "ground")]
        lines.append([name, str(len(column(part, "ground", SLOPES))), *cells])
    return table(["list", "scenes", "RMSE: untrained", "`ground`", "slope vectors: untrained", "`ground`"], lines)


def sfs():
    methods = {"shape from shading, default weights": "sfs", "shape from shading, weights chosen on the truths": "tuned"}
    methods |= {"untrained": "untrained", "`nano`": "nano"}
    lines = [[name, *(digits(mean("real-against", method, figure)) for figure in (HEIGHTS, SLOPES))] for name, method in methods.items()]
    return table(["real ground", "RMSE", "slope vectors"], lines)


KINDS = {
    "mare (4)": "mare",
    "highland (4)": "highland",
    "pixels of 1 m": "1 m pixels",
    "pixels of 4 m": "4 m pixels",
    "Sun 9° high": "low Sun",
    "albedo four times as contrasty": "strong albedo",
    "all": "all",
}


def suite():
    lines = []
    for name, kind in KINDS.items():
        of = lambda method, figure: total("suite", kind, method)[figure]
        metres = [digits(of(method, RMSE_M), 2) for method in (COARSE, "ground")]
        degrees = [digits(of(method, SLOPE_DEG), 2) for method in (COARSE, "ground")]
        slopes = best([digits(of(method, SLOPES)) for method in ("linear-bound", "sfs", *METHODS)])
        lines.append([name, *metres, *degrees, *slopes])
    heading = ["scenes", "RMSE, m: coarse DTM", "`ground`", "slopes, °: coarse DTM", "`ground`"]
    return table(heading + ["slope vectors: linear filter", "shape from shading", "untrained", "`nano`", "`ground`"], lines)


def limits():
    left_out = {"nothing": "usual", "albedo": "no albedo", "blur of the camera": "no blur"}
    left_out |= {"error and misregistration of the coarse DTM": "exact coarse", "all three": "none of them"}
    lines = [[name, *(total("limits", kind, method)[SLOPES] for method in ("untrained", "sfs", "nano"))] for name, kind in left_out.items()]
    return table(["left out", "untrained", "shape from shading", "`nano`"], lines)


def landforms():
    methods = {"untrained": "untrained", "linear filter of other grounds": "linear-bound", "shape from shading": "sfs"}
    methods |= {"`nano`": "nano", "`ground`": "ground"}
    lines = [[name, *(digits(mean("landforms", method, figure)) for figure in (HEIGHTS, SLOPES))] for name, method in methods.items()]
    return table(["eight grounds without craters", "RMSE", "slope vectors"], lines)


def shares(name):
    """Percent of heights and slopes within one and 1.96 expected standard deviations, from the table of `evaluate`."""
    text = (OUT / "sure" / f"{name}.txt").read_text()
    numbers = [float(word) for word in re.search(r"^all +(.*)$", text, re.M).group(1).split()]
    return numbers[1:3] + numbers[4:6]


def half_coherence(scene, method):
    """The half-coherence wavelength in pixels of the truth."""
    found = next(one for one in json.loads((OUT / "real/results.json").read_text())["scenes"] if one["name"] == scene)
    half = next(one for one in found["judged"] if one["method"] == method)["spectral"]["half_coherence"]
    return ("≤ " if half["at_most"] else "") + digits(half["wavelength_m"] / found["pixel_m"][0], 1)


def sure():
    lines = []
    for scene, name in REAL.items():
        of = [f"{value / 100:.2f}" for value in shares(scene)]
        lines.append([name, *(half_coherence(scene, method) for method in (COARSE, "nano")), *of])
    synthetic = [shares(path.name[: -len("_image.tif")]) for path in (OUT / "suite/scenes").glob("*_image.tif")]
    lines.append(["built-in suite, mean", "", "", *(f"{sum(one[i] for one in synthetic) / len(synthetic) / 100:.2f}" for i in range(4))])
    return table(["scene", "half coherence, px: coarse DTM", "`nano`", "heights: 1 sd", "1.96 sd", "slopes: 1 sd", "1.96 sd"], lines)


def shaded():
    places = [
        ("built-in suite", "suite", "all"),
        ("another generator", "independent", "all"),
        ("Apollo 15 crop", "apollo15", "all"),
        ("ray-traced, Sun told", "stereolunar", "all"),
        ("Sun 9° high", "suite", "low Sun"),
    ]
    figures = ("slope vector error, bright", "slope vector error, shaded")
    of = lambda part, kind: [digits(total(part, kind, method)[figure], 4) for method in ("nano", COARSE) for figure in figures]
    return table(["scenes", "bright", "shaded", "coarse DTM: bright", "shaded"], [[name, *of(part, kind)] for name, part, kind in places])


TABLES = {
    "adds": adds,
    "front": front,
    "real": lambda: real("real"),
    "real-azimuth": lambda: real("real-azimuth"),
    "hard": hard,
    "sfs": sfs,
    "suite": suite,
    "limits": limits,
    "landforms": landforms,
    "sure": sure,
    "shaded": shaded,
}


def main():
    used = set()
    for page in PAGES:
        text = page.read_text()

        def made(match):
            used.add(match.group(1))
            return f"<!-- table {match.group(1)} -->\n{TABLES[match.group(1)]()}\n<!-- end -->"

        new = re.sub(r"<!-- table (\S+) -->\n.*?<!-- end -->", made, text, flags=re.S)
        if new != text:
            print(f"{page.name}: tables differ")
            if "--check" not in sys.argv:
                page.write_text(new)
    if unused := TABLES.keys() - used:
        sys.exit(f"ERROR: no page has the tables {', '.join(sorted(unused))}")


main()
