#!/usr/bin/env python3
"""Writes the tables that `card.sh OUT` has made into README.md, nano's card and docs/accuracy.md, between `<!-- table NAME -->` and `<!-- end -->`,
and docs/real.csv.

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
RECORD = HERE.parent / "docs/real.csv"
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
    ("azimuth told where known", "real-azimuth"),
    ("coarse DTMs that [err](#coarse-dtms-that-err), light fitted", "real-erring"),
    ("azimuth told", "real-erring-azimuth"),
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
    "moon_aristarchus_cp_wac": "Moon, Aristarchus",
    "north_pole_0": "Moon, north pole 1",
    "north_pole_1": "Moon, north pole 2",
    "north_pole_2": "Moon, north pole 3",
    "north_pole_3": "Moon, north pole 4",
    "mars_noctis_hirise": "Mars, Noctis*",
    "mars_cerberus_hirise": "Mars, Cerberus*",
    "mars_gale_hirise_1m": "Mars, Gale, HiRISE, dark dunes",
    "mars_candor_hirise": "Mars, Candor*",
    "mars_gale_hrsc": "Mars, Gale, HRSC",
}


def real_scene(part, scene):
    """Figures of a real scene: metres and degrees of the coarse DTM and of `ground`; ratios of heights and of slopes of the methods."""
    of = {row["method"]: row for row in rows(part, "scenes.csv") if row["scene"] == scene}
    metres = [digits(of[method][RMSE_M], 1) for method in (COARSE, "ground")]
    degrees = [digits(of[method][SLOPE_DEG], 2) for method in (COARSE, "ground")]
    return [*metres, *degrees], *([digits(of[method][figure]) for method in METHODS] for figure in (HEIGHTS, SLOPES))


RECORDED = (
    ("fitted", "real"),
    ("azimuth told", "real-azimuth"),
    ("fitted, coarse DTM errs", "real-erring"),
    ("azimuth told, coarse DTM errs", "real-erring-azimuth"),
)


def record():
    """All figures of the real scenes, as a table of CSV."""
    yield ["scene", "light", *(f"{method} {figure}" for figure in ("RMSE m", "slope deg") for method in ("coarse", "ground")),
           *(f"{method} {figure} ratio" for figure in ("RMSE", "slope") for method in METHODS),
           *(f"{method} half coherence px" for method in ("coarse", "nano")),
           *(f"nano {what} within {sd} sd" for what in ("heights", "slopes") for sd in ("1", "1.96"))]
    for light, part in RECORDED:
        for scene, name in REAL.items():
            row = [name, light, *sum(real_scene(part, scene), [])]
            if part in ("real", "real-erring"):
                row += [half_coherence(part, scene, method) for method in (COARSE, "nano")]
                row += [f"{share / 100:.2f}" for share in shares(part, scene)]
            yield row + [""] * (18 - len(row))


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


def free():
    """RMSE without the anchor; what it is with the anchor says the table of `adds`."""
    lists = {
        "exact, fitted": "real-free",
        "told": "real-azimuth-free",
        "erring, fitted": "real-erring-free",
        "told ": "real-erring-azimuth-free",
    }
    lines = [[f"`{method}`", *(digits(mean(part, method, HEIGHTS)) for part in lists.values())] for method in METHODS[1:]]
    return table(["real:", *map(str.strip, lists)], lines)


def weighed():
    """RMSE of `ground` without the anchor, with the shipped one, and with other weights of the coarse DTM (suites/estimates.py)."""
    lists = {
        "real, exact": "real",
        "erring": "real-erring",
        "Apollo 15": "apollo15",
        "another generator": "independent",
        "ray-traced": "stereolunar",
        "built-in": "suite",
    }
    heading, *lines = [line.split() for line in (OUT / "anchor.txt").read_text().splitlines()]
    of = {cells[1]: dict(zip(heading, cells)) for cells in lines if cells[0] == "ground"}
    kinds = {"0": "none", "0.5": "half-width-0.5-weight-0.5", "0.7, shipped": "anchor", "1": "half-width-0.5-weight-1.0"}
    return table(["`ground`, weight", *lists], [[name, *(of[part][kind] for part in lists.values())] for name, kind in kinds.items()])


def sfs():
    methods = {"shape from shading, default weights": "sfs", "chosen on the truths": "tuned"}
    return heights_and_slopes("real ground", "real-against", methods)


def heights_and_slopes(corner, part, methods):
    """Two rows of means, a column for each method."""
    figures = {"RMSE": HEIGHTS, "slope vectors": SLOPES}
    return table([corner, *methods], [[name, *(digits(mean(part, method, figure)) for method in methods.values())] for name, figure in figures.items()])


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
    methods = {"untrained": "untrained", "shape from shading": "sfs", "`nano`": "nano"}
    lines = [[name, *(total("limits", kind, method)[SLOPES] for kind in left_out.values())] for name, method in methods.items()]
    return table(["left out", *left_out], lines)


def landforms():
    methods = {"untrained": "untrained", "linear filter": "linear-bound", "shape from shading": "sfs", "`nano`": "nano", "`ground`": "ground"}
    return heights_and_slopes("", "landforms", methods)


def shares(part, name):
    """Percent of heights and slopes within one and 1.96 expected standard deviations, from the table of `evaluate`."""
    text = (OUT / "sure" / part / f"{name}.txt").read_text()
    numbers = [float(word) for word in re.search(r"^all +(.*)$", text, re.M).group(1).split()]
    return numbers[1:3] + numbers[4:6]


def half_coherence(part, scene, method):
    """The half-coherence wavelength in pixels of the truth."""
    found = next(one for one in json.loads((OUT / part / "results.json").read_text())["scenes"] if one["name"] == scene)
    half = next(one for one in found["judged"] if one["method"] == method)["spectral"]["half_coherence"]
    if half is None:
        return "none"
    return ("<=" if half["at_most"] else "") + digits(half["wavelength_m"] / found["pixel_m"][0], 1)


def sure():
    """Mean, least and most of the scenes' shares, and how many scenes are within the range that we aim at."""
    lists = [("real, exact", "real", REAL), ("real, erring", "real-erring", REAL)]
    built_in = sorted(path.name[: -len("_image.tif")] for path in (OUT / "suite/scenes").glob("*_image.tif"))
    lines = []
    for name, part, scenes in [*lists, ("built-in suite", "suite", built_in)]:
        of = [[share / 100 for share in shares(part, scene)] for scene in scenes]
        near = [sum(low <= share <= high for share in one) for (low, high), one in zip(2 * [(0.55, 0.8), (0.88, 0.99)], zip(*of))]
        cells = (f"{sum(one) / len(one):.2f} ({min(one):.2f}, {max(one):.2f}) {count}" for one, count in zip(zip(*of), near))
        lines.append([name, *cells])
    return table(["scenes", "heights: 1 sd", "1.96 sd", "slopes: 1 sd", "1.96 sd"], lines)


def means():
    """Shares of mean errors of drawn maps within one and 1.96 expected standard deviations (suites/estimates.py)."""
    found = re.findall(r"^120 x 120 +(.+?) +(\d+) ([\d.]+) ([\d.]+) ", (OUT / "fields.txt").read_text(), re.M)
    of = {(how, int(radius)): f"{one}/{more}" for how, radius, one, more in found}
    radii = (1, 4, 16)
    hows = {"along four tracks": "found", "assumed": "assumed", "uncorrelated": "assumed, independent"}
    return table(["radius", *map(str, radii)], [[name, *(of[how, radius] for radius in radii)] for name, how in hows.items()])


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
    "hard": hard,
    "free": free,
    "weighed": weighed,
    "sfs": sfs,
    "suite": suite,
    "limits": limits,
    "landforms": landforms,
    "sure": sure,
    "means": means,
    "shaded": shaded,
}


def main():
    with open(RECORD, newline="") as old:
        known = list(csv.reader(old))
    if (new := list(record())) != known:
        print(f"{RECORD.name}: differs")
        if "--check" not in sys.argv:
            with open(RECORD, "w", newline="") as file:
                csv.writer(file, lineterminator="\n").writerows(new)
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
