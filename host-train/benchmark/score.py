#!/usr/bin/env python3
"""Scores DTMs of the benchmark's scenes. Needs numpy and rasterio.

    score.py SCENES DTMS      errors of DTMS/SCENE.tif (or SCENE_dtm.tif), and their ratios to those of the interpolated coarse DTM
    score.py SCENES --check   compares the scenes with scenes.csv

SCENES is the folder that `host-train suite --scenes-only --out bench` writes: bench/scenes. A DTM has the grid of its scene's truth, heights in
metres, voids as nodata or NaN. All pixels are scored where DTM and truth are real. Exit status: 0, or 1 if a scene differs or a DTM is absent.
"""
import csv
import hashlib
import sys
from pathlib import Path

import numpy as np
import rasterio

HERE = Path(__file__).parent
FIGURES = ("rmse_m", "mae_m", "nmad_m", "slope_rmse_deg", "slope_vector")


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
    ours, true = (m[:, real] for m in maps)
    slopes = [np.degrees(np.arctan(np.hypot(*m))) for m in (ours, true)]
    return {
        "pixels": int(error.size),
        "rmse_m": float(np.sqrt(np.mean(error**2))),
        "mae_m": float(size.mean()),
        "nmad_m": float(1.4826 * np.median(np.abs(error - np.median(error)))),
        "slope_rmse_deg": float(np.sqrt(np.mean((slopes[0] - slopes[1]) ** 2))),
        "slope_vector": float(np.hypot(*(ours - true)).mean()),
    }


def check(scenes):
    wrong = 0
    for scene in rows_of("scenes.csv"):
        for kind in ("image", "coarse", "truth"):
            path = scenes / f"{scene['name']}_{kind}.tif"
            found, expected = sample_hash(path), scene[f"{kind}_sha256"]
            if found != expected:
                print(f"{path}: samples with SHA-256 {expected} expected, {found} found")
                wrong += 1
    print(f"{wrong} files differ" if wrong else "all scenes are those of scenes.csv")
    return wrong


def dtm_of(folder, name):
    for path in (folder / f"{name}.tif", folder / f"{name}_dtm.tif"):
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
        (dtm_m, grid), (truth_m, expected) = read(path), read(scenes / f"{name}_truth.tif")
        if dtm_m.shape != truth_m.shape or not grid.almost_equals(expected, 1e-6):
            fail(f"{path}: the grid of {name}_truth.tif expected, {dtm_m.shape} with {tuple(grid)[:6]} found")
        found[name] = score(dtm_m, truth_m, float(scene["pixel_m"]))
        share = found[name]["pixels"] / truth_m.size
        if share < 0.99:
            print(f"note: {name}: {share:.1%} of the pixels have a height", file=sys.stderr)
    return found, absent


def compare(scenes, folder):
    coarse = {row["scene"]: row for row in rows_of("baselines.csv") if row["method"] == "coarse"}
    found, absent = scored(scenes, folder)
    out = csv.writer(sys.stdout, lineterminator="\n")
    out.writerow(("scene", "pixels", *FIGURES, *(f"{figure} ratio" for figure in FIGURES)))
    ratios = []
    for name, figures in found.items():
        ratios.append([figures[figure] / float(coarse[name][figure]) for figure in FIGURES])
        out.writerow((name, *table_row(figures), *(f"{r:.4f}" for r in ratios[-1])))
    for what, of in (("mean", np.mean), ("worst", np.max)):
        if ratios:
            out.writerow((what, "", *("" for _ in FIGURES), *(f"{r:.4f}" for r in of(ratios, 0))))
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
