#!/usr/bin/env python3
"""Scores DTMs of the benchmark's scenes. Needs numpy and rasterio.

    score.py SCENES DTMS      errors of DTMS/SCENE_dtm.tif (or SCENE.tif), and their ratios to those of the interpolated coarse DTM
    score.py SCENES --check   compares the scenes with scenes.csv

SCENES is the folder that scenes.sh fills. A DTM has the grid of its scene's truth, heights in metres, voids as nodata or NaN. Errors are those of the
pixels that have a height, as `elunar evaluate` gives them. In ratios every pixel without one counts, too: VOID times the coarse DTM's figure. Exit
status: 0, or 1 if a scene differs, or a DTM is absent or on another grid.
"""
import csv
import hashlib
import sys
from pathlib import Path

import numpy as np
import rasterio

HERE = Path(__file__).parent
FIGURES = ("rmse_m", "mae_m", "nmad_m", "slope_rmse_deg", "slope_vector")
# What a pixel without a height counts, in the coarse DTM's figures: more than any error that is worth hiding.
VOID = 30.0
# The maps of a scene.
KINDS = ("image", "coarse", "truth")


def fail(text):
    sys.exit(f"ERROR: {text}")


def rows_of(name):
    with open(HERE / name, newline="") as table:
        return list(csv.DictReader(table))


def read(path):
    """Heights or brightness as float32, NaN where void; and the transform."""
    try:
        with rasterio.open(path) as raster:
            return raster.read(1, masked=True).astype("f4").filled(np.nan), raster.transform
    except rasterio.errors.RasterioIOError as error:
        fail(f"{path}: a GeoTIFF expected, found: {error}")


def sample_hash(path):
    """SHA-256 of the samples, row by row from the top, as little-endian float32; -0 counts as 0."""
    return hashlib.sha256((read(path)[0] + 0).astype("<f4").tobytes()).hexdigest()


def gradient(heights_m, pixel_m):
    """Horn's gradient, metres per metre, of the pixels with eight neighbours."""
    z = heights_m.astype("f8")
    part = lambda row, col: z[1 + row : z.shape[0] - 1 + row, 1 + col : z.shape[1] - 1 + col]
    along = lambda at: at(-1) + 2 * at(0) + at(1)
    east = along(lambda k: part(k, 1)) - along(lambda k: part(k, -1))
    south = along(lambda k: part(1, k)) - along(lambda k: part(-1, k))
    return np.stack((east, south)) / (8 * pixel_m)


def score(dtm_m, truth_m, pixel_m):
    """The figures of a DTM; both maps are on one grid."""
    void = ~(np.isfinite(dtm_m) & np.isfinite(truth_m))
    if void.all():
        fail("a pixel that is real in DTM and truth expected, none found")
    # Differences of float32, as `elunar evaluate` takes them.
    error = (dtm_m - truth_m)[~void].astype("f8")
    size = np.abs(error)
    maps = [gradient(np.where(void, np.nan, map_m), pixel_m) for map_m in (dtm_m, truth_m)]
    real = np.isfinite(maps[0]).all(0) & np.isfinite(maps[1]).all(0)
    if not real.any():
        fail("nine real heights around a pixel expected, found none")
    ours, true = (m[:, real] for m in maps)
    slopes_of_truth = np.isfinite(gradient(truth_m, pixel_m)).all(0)
    slopes = [np.degrees(np.arctan(np.hypot(*m))) for m in (ours, true)]
    return {
        "pixels": int(error.size),
        "void": 1 - error.size / np.isfinite(truth_m).sum(),
        "void_slopes": 1 - real.sum() / slopes_of_truth.sum(),
        "rmse_m": float(np.sqrt(np.mean(error**2))),
        "mae_m": float(size.mean()),
        "nmad_m": float(1.4826 * np.median(np.abs(error - np.median(error)))),
        "slope_rmse_deg": float(np.sqrt(np.mean((slopes[0] - slopes[1]) ** 2))),
        "slope_vector": float(np.hypot(*(ours - true)).mean()),
    }


def ratio(figure, found, coarse):
    """A figure over the coarse DTM's, with the pixels that have none."""
    own, void = found[figure] / coarse[figure], found["void_slopes" if "slope" in figure else "void"]
    power = 2 if "rmse" in figure else 1
    return float(((1 - void) * own**power + void * VOID**power) ** (1 / power))


def map_of(scenes, scene, kind):
    return scenes / scene["suite"] / "scenes" / f"{scene['name']}_{kind}.tif"


def check(scenes):
    wrong = 0
    for scene in rows_of("scenes.csv"):
        for kind in KINDS:
            path = map_of(scenes, scene, kind)
            found, expected = sample_hash(path), scene[f"{kind}_sha256"]
            if found != expected:
                print(f"{path}: samples with SHA-256 {expected} expected, {found} found")
                wrong += 1
    print(f"{wrong} files differ" if wrong else "all scenes are those of scenes.csv")
    return wrong


def dtm_of(folder, name):
    for path in (folder / f"{name}_dtm.tif", folder / f"{name}.tif"):
        if path.exists():
            return path
    return None


def scored(scenes, folder):
    """The scenes that have a DTM, with their figures; and the names of the others."""
    found, absent = {}, []
    for scene in rows_of("scenes.csv"):
        name = scene["name"]
        path = dtm_of(folder, name)
        if path is None:
            absent.append(name)
            continue
        (dtm_m, grid), (truth_m, expected) = read(path), read(map_of(scenes, scene, "truth"))
        if dtm_m.shape != truth_m.shape or not grid.almost_equals(expected, 1e-6):
            places = [f"{shape[0]} x {shape[1]} pixels with {tuple(place)[:6]}" for shape, place in
                      ((truth_m.shape, expected), (dtm_m.shape, grid))]
            fail(f"{path}: the grid of {name}_truth.tif expected, {places[0]}; found {places[1]}")
        found[name] = score(dtm_m, truth_m, float(scene["pixel_m"]))
    return found, absent


def compare(scenes, folder):
    coarse = {row["scene"]: {f: float(row[f]) for f in FIGURES} for row in rows_of("baselines.csv") if row["method"] == "coarse"}
    kinds = {row["name"]: row["kind"] for row in rows_of("scenes.csv")}
    found, absent = scored(scenes, folder)
    out = csv.writer(sys.stdout, lineterminator="\n")
    out.writerow(("scene", "kind", "pixels", "void", *FIGURES, *(f"{figure} ratio" for figure in FIGURES)))
    ratios = {name: [ratio(figure, figures, coarse[name]) for figure in FIGURES] for name, figures in found.items()}

    def line(name, kind, cells, of):
        out.writerow((name, kind, *cells, *(f"{r:.4f}" for r in of)))

    for name, figures in found.items():
        pixels, *errors = table_row(figures)
        line(name, kinds[name], (pixels, f"{figures['void']:.6f}", *errors), ratios[name])
    blank = [""] * (2 + len(FIGURES))
    for kind in dict.fromkeys(kinds[name] for name in ratios):
        line("mean", kind, blank, np.mean([ratios[name] for name in ratios if kinds[name] == kind], 0))
    for what, of in (("mean", np.mean), ("worst", np.max)):
        if ratios:
            line(what, "all", blank, of(list(ratios.values()), 0))
    if absent:
        fail(f"{folder}: DTMs of {len(absent)} scenes are absent: {', '.join(absent)}")


def table_row(figures):
    return figures["pixels"], *(f"{figures[figure]:.6f}" for figure in FIGURES)


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    if sys.argv[2] == "--check":
        sys.exit(1 if check(Path(sys.argv[1])) else 0)
    compare(Path(sys.argv[1]), Path(sys.argv[2]))
