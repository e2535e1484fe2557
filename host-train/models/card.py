#!/usr/bin/env python3
"""Writes the figures that `card.sh OUT` has made into the rows of README.md, of nano's card and of docs/accuracy.md, and prints the others.

    host-train/models/card.py OUT [--check]      --check: only prints what would change
"""

import csv
import json
import pathlib
import re
import sys

OUT = pathlib.Path(sys.argv[1])
HERE = pathlib.Path(__file__).resolve().parent
README, CARD, ACCURACY = HERE.parent.parent / "README.md", HERE / "README.md", HERE.parent / "docs/accuracy.md"
SLOPES, HEIGHTS = "its ratio to coarse", "RMSE / coarse"
BRIGHT, SHADED = "slope vector error, bright", "slope vector error, shaded"
texts = {path: path.read_text() for path in (README, CARD, ACCURACY)}


def table(part, file):
    with open(OUT / part / file, newline="") as opened:
        return list(csv.DictReader(opened))


def total(part, scenes, method):
    """The row of a kind of scenes, or of all; a list with one kind has no row of all."""
    rows = [row for row in table(part, "sums.csv") if row["method"] == method]
    return rows[0] if len(rows) == 1 else next(row for row in rows if row["scenes"] == scenes)


def scenes(part, method, only=""):
    return [row for row in table(part, "scenes.csv") if row["method"] == method and only in row["scene"]]


def mean(part, method, figure, only=""):
    rows = scenes(part, method, only)
    return sum(float(row[figure]) for row in rows) / len(rows)


def digits(value, count=3):
    return f"{float(value):.{count}f}"


def lowest_bold(values):
    low = min(float(value) for value in values)
    return [f"**{value}**" if float(value) == low else value for value in values]


def row(path, section, start, cells, nth=0):
    """Replaces the cells of the nth line of a table that begins with `start`, after the text `section`. None keeps a cell."""
    text = texts[path]
    lines = re.finditer("^" + re.escape(start) + ".*$", text[text.index(section) :], re.M)
    line = list(lines)[nth]
    old = line.group(0)
    kept = [cell.strip() for cell in re.split(r"(?<!\\)\|", old)[1:-1]]
    new = [cell if cell is not None else kept[i] for i, cell in enumerate(cells)]
    new = re.sub(r"\|  (?=\|)", "| ", "| " + " | ".join(new) + " |")
    if new != old:
        print(f"{path.name}\n  - {old}\n  + {new}")
    at = text.index(section) + line.start()
    texts[path] = text[:at] + new + text[at + len(old) :]


def adds():
    """What learning adds: the head of accuracy.md, and the README."""
    lines = [
        ("| eight real images, light fitted", "real", "nano", None),
        ("| the same, azimuth told", "real-azimuth", "nano", None),
        ("| ray-traced images of real", "stereolunar-hide", "nano", "all"),
        ("| crop of a NAC DTM (Apollo 15), rendered", "apollo15", "nano", "all"),
        ("| another generator, one scene", "independent", "nano", "all"),
        ("| built-in suite, twelve scenes", "suite", "int8", "all"),
    ]
    for start, part, method, kind in lines:
        of = (lambda m, f: mean(part, m, f)) if kind is None else (lambda m, f: float(total(part, kind, m)[f]))
        heights, slopes = ([of(name, figure) for name in ("untrained", method, "ground")] for figure in (HEIGHTS, SLOPES))
        gains = [f"{gain:.1f} %" if gain < 5 else f"{gain:.0f} %" for gain in (100 * (1 - one / slopes[0]) for one in slopes[1:])]
        row(ACCURACY, "## What learning adds", start, [None, None, *map(digits, heights + slopes), ", ".join(gains)])
    for start, part in (("| eight [real pairs]", "real"), ("| the same, azimuth", "real-azimuth")):
        worst = lambda method: max(float(one[SLOPES]) for one in scenes(part, method))
        row(README, "| ", start, [None, *(f"{mean(part, m, SLOPES):.3f} ({worst(m):.3f})" for m in ("untrained", "nano", "ground"))])
    suite = (digits(total("suite", "all", m)[SLOPES]) for m in ("untrained", "int8", "ground"))
    row(README, "| ", "| built-in suite, synthetic", [None, *suite])


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
    for name, kind in KINDS.items():
        of = lambda method: total("suite", kind, method)
        slopes = [digits(of(method)[SLOPES]) for method in ("untrained", "linear-bound", "sfs", "int8")]
        row(ACCURACY, "The built-in suite by kind of scene", f"| {name} |", [None, *lowest_bold(slopes)])
        ours, start, coarse, sfs = (of(method) for method in ("int8", "untrained", "coarse DTM", "sfs"))
        waves = "correlation short waves"
        cells = [None, digits(ours["RMSE, m"], 2), ours[HEIGHTS], start[HEIGHTS], ours["slope MAE, °"] + "°", coarse["slope MAE, °"] + "°"]
        cells += [ours[SLOPES], start[SLOPES], ours[waves], coarse[waves], sfs[HEIGHTS], sfs[SLOPES]]
        row(CARD, "| scenes | RMSE, m | ratio", f"| {name} |", cells)
    left_out = {"nothing": "usual", "albedo": "no albedo", "blur": "no blur", "error and": "exact coarse", "all three": "none of them"}
    for name, kind in left_out.items():
        cells = [total("limits", kind, method)[SLOPES] for method in ("untrained", "sfs", "nano")]
        row(ACCURACY, "### What limits it", f"| {name}", [None, *cells])
    found = [digits(mean("landforms", "nano", figure)) for figure in (HEIGHTS, SLOPES)]
    row(ACCURACY, "### Ground without craters", "| `nano` |", [None, *(f"**{value}**" for value in found)])


REAL = {
    "Moon, Aristarchus": "moon_aristarchus_cp_wac",
    "Moon, north pole, WAC, 1": "north_pole_0",
    "Moon, north pole, WAC, 2": "north_pole_1",
    "Moon, north pole, WAC, 3": "north_pole_2",
    "Moon, north pole, WAC, 4": "north_pole_3",
    "Mars, Noctis": "mars_noctis_hirise",
    "Mars, Cerberus": "mars_cerberus_hirise",
    "Mars, Gale": "mars_gale_hirise_1m",
}


def shares(name):
    """Percent of heights and slopes within one and 1.96 expected standard deviations, from the table of `evaluate`."""
    text = (OUT / "sure" / f"{name}.txt").read_text()
    numbers = [float(word) for word in re.search(r"^all +(.*)$", text, re.M).group(1).split()]
    return numbers[1:3] + numbers[4:6]


def real():
    methods = ("untrained", "linear-own", "nano")
    for name, scene in REAL.items():
        by_method = {one["method"]: one for one in table("real", "scenes.csv") if one["scene"] == scene}
        found = [lowest_bold([by_method[method][figure] for method in methods]) for figure in (HEIGHTS, SLOPES)]
        row(ACCURACY, "| scene | RMSE: untrained", f"| {name}", [None, *found[0], *found[1]])
        coarse, ours = by_method["coarse DTM"], by_method["nano"]
        half = [half_coherence(scene, method) for method in ("coarse DTM", "nano")]
        offset = [digits((float(one["offset down, px"]) ** 2 + float(one["offset right, px"]) ** 2) ** 0.5, 2) for one in (coarse, ours)]
        heights, slopes = [[f"{part[0]:.0f}, {part[1]:.0f}"] for part in (shares(scene)[:2], shares(scene)[2:])]
        row(ACCURACY, "| scene | half coherence: coarse", f"| {name}", [None, *half, *offset, *heights, *slopes])
    found = [lowest_bold([digits(mean("real", method, figure)) for method in methods]) for figure in (HEIGHTS, SLOPES)]
    row(ACCURACY, "| scene | RMSE: untrained", "| mean |", [None, *found[0], *found[1]])
    against = [("shape from shading, default", "sfs"), ("shape from shading, weights", "tuned"), ("untrained", "untrained"), ("`nano`", "nano")]
    best = [min(mean("real-against", method, figure) for _, method in against) for figure in (HEIGHTS, SLOPES)]
    for name, method in against:
        cells = [mean("real-against", method, figure) for figure in (HEIGHTS, SLOPES)]
        cells = [("**%s**" if cell == low else "%s") % digits(cell, 2 if cell > 1 else 3) for cell, low in zip(cells, best)]
        row(ACCURACY, "### Shape from shading on real ground", f"| {name}", [None, *cells])


def half_coherence(scene, method):
    """The half-coherence wavelength in pixels of the truth."""
    found = next(one for one in json.loads((OUT / "real/results.json").read_text())["scenes"] if one["name"] == scene)
    half = next(one for one in found["judged"] if one["method"] == method)["spectral"]["half_coherence"]
    return ("≤ " if half["at_most"] else "") + digits(half["wavelength_m"] / found["pixel_m"][0], 1)


def sure():
    groups = {
        "| built-in suite, 12": [path.name[: -len("_image.tif")] for path in (OUT / "suite/scenes").glob("*_image.tif")],
        "| real ground, 8": list(REAL.values()),
        "| real ground without Noctis": [scene for scene in REAL.values() if "noctis" not in scene],
    }
    for start, names in groups.items():
        of = [shares(name) for name in names]
        cells = [digits(sum(one[i] for one in of) / len(of) / 100, 2) for i in range(4)]
        row(ACCURACY, "## How sure", start, [None, *cells])


def other():
    parts = ["independent", "apollo15", "stereolunar"]
    starts = ["| another generator, rough", "| crop of a NAC DTM (Apollo 15)", "| ray-traced images of real"]
    for number, (part, start) in enumerate(zip(parts, starts)):
        waves = "correlation short waves"
        cells = lambda of: [of[HEIGHTS], of[SLOPES], of[waves]]
        coarse = total(part, "all", "coarse DTM")[waves]
        row(CARD, "| scenes | light | RMSE ratio", start, [None, None, *cells(total(part, "all", "nano")), coarse])
        row(CARD, "| scenes | light | RMSE ratio", "| | fitted", [None, None, *cells(total(part + "-hide", "all", "nano")), None], number)
    places = [
        ("built-in suite, 12 scenes", "suite", "all", "int8"),
        ("another generator", "independent", "all", "nano"),
        ("Apollo 15 crop, four Suns", "apollo15", "all", "nano"),
        ("ray-traced, two places, Sun given", "stereolunar", "all", "nano"),
        ("Sun 9° high", "suite", "low Sun", "int8"),
    ]
    for name, part, kind, method in places:
        cells = [digits(total(part, kind, one)[figure], 4) for one in (method, "coarse DTM") for figure in (BRIGHT, SHADED)]
        row(ACCURACY, "## Bright and shaded slopes", f"| {name} |", [None, *cells])


def sentences():
    """Figures in running text."""
    ours = total("stereolunar-hide", "all", "nano")
    place = lambda one, two: digits(sum(mean("stereolunar-hide", "nano", SLOPES, ground) for ground in (one, two)) / 2)
    print("Mars, slopes:", digits(mean("real", "untrained", SLOPES, "mars")), digits(mean("real", "nano", SLOPES, "mars")))
    print("real, worst:", *(max(one[figure] for one in scenes("real", "nano")) for figure in (HEIGHTS, SLOPES)))
    print("ray-traced: two places", place("540", "541"), place("576", "577"), "bright, shaded", ours[BRIGHT], ours[SHADED])
    for part, method in (("suite", "int8"), ("apollo15", "nano"), ("stereolunar", "nano")):
        two = [one for one in table(part, "cross.csv") if one["method"] == method]
        print("two Suns,", part, *((one["ratio"], one["difference of short waves, m"], one["error of short waves, m"]) for one in two))
    print("NAC:", *((one["method"], one["hillshade–image correlation"], one[HEIGHTS]) for one in table("nac", "scenes.csv")))
    for figure in (HEIGHTS, SLOPES):
        pairs = [(float(total("suite", kind, "float")[figure]), float(total("suite", kind, "int8")[figure])) for kind in KINDS.values()]
        print("int8 against float, largest:", digits(max(abs(a - b) for a, b in pairs)))


adds()
suite()
real()
sure()
other()
sentences()
if "--check" not in sys.argv:
    for path, text in texts.items():
        path.write_text(text)
