#!/usr/bin/env python3
"""What the overlap of tiles costs and brings: seams, slopes, heights and time over overlaps, on lists of scenes.

    host-train/suites/overlaps.py PROGRAM OUT [--lists hills,built-in,large,real] [--real DATA] [--model ground]
        [--overlaps 32,48,64,80,100,128]

PROGRAM is host-train. Lists: smooth hills; the built-in suite; `large`, four of its grounds as scenes of 1,536 x 1,920 pixels, where tiles lie as
densely as the overlap says (in small scenes the last ones overlap more); the real ones, whose Sun is not told. OUT/LIST.csv has a row per overlap:

    tiles, cpu_s             tiles of all scenes, and processor seconds of the whole commands on one thread
    slope_error, rmse_ratio  means over the scenes: length of the slope vector's error, and the heights' RMSE, both over those of the coarse DTM
                             (real scenes: after a Gaussian of 2 pixels, as their truths resolve no more)
    step_m, elsewhere_m      mean step across a line at the tiles' first and last lines, and across all lines (as in tests/seams.rs)
    worst_m                  the largest step at seams of the hills

A DTM that is there is not made again. Needs numpy, scipy and rasterio.
"""
import argparse
import csv
import json
import os
import re
import subprocess
from pathlib import Path

import numpy as np
import rasterio
from rasterio.transform import from_origin
from rasterio.warp import Resampling, reproject
from scipy.ndimage import binary_erosion, gaussian_filter

TILE = 256, 320  # of every shipped model
LARGE = ["mare-a-sun1", "mare-b-sun2", "highland-a-sun1", "highland-b-sun2"]
LISTS = ["hills", "built-in", "large", "real"]
MOON = "+proj=eqc +lat_ts=0 +lat_0=0 +lon_0=0 +R=1737400 +units=m"
COLUMNS = ["overlap_px", "scenes", "tiles", "cpu_s", "slope_error", "rmse_ratio", "step_m", "elsewhere_m", "worst_m"]


def run(command):
    """Runs a command; returns what it prints and its processor seconds."""
    before = os.times()
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    after = os.times()
    if done.returncode:
        raise SystemExit(f"ERROR: {' '.join(map(str, command))}: {done.stderr.strip()}")
    return done.stdout, after.children_user + after.children_system - before.children_user - before.children_system


def large_list(folder):
    """Writes the list of large scenes, made of entries of the built-in one."""
    entries = (Path(__file__).parent / "held-out.toml").read_text().split("[[scene]]\n")[1:]
    entries = [entry for entry in entries if any(f'name = "{name}"' in entry for name in LARGE)]
    entries = [re.sub(r"ground = .*\n", "", entry).replace("rows = 512, cols = 640", "rows = 1536, cols = 1920") for entry in entries]
    path = folder / "large.toml"
    path.write_text('name = "large"\nabout = "Four grounds of the built-in list, larger."\n\n' + "".join("[[scene]]\n" + entry for entry in entries))
    return path


def hills(folder):
    """Writes image and coarse DTM of the smooth hills of tests/seams.rs."""
    def height(x, y):
        return 20 * np.sin(x / 180) * np.cos(y / 140) + 3 * np.sin(x / 31 + y / 53) + 2 * np.cos(y / 24 - x / 47)

    def brightness(x, y):
        dx, dy = (height(x + 1, y) - height(x - 1, y)) / 2, (height(x, y + 1) - height(x, y - 1)) / 2
        up, side = np.sin(np.radians(35)), np.cos(np.radians(35)) / np.sqrt(2)
        return 1000 * np.maximum(up + side * dx - side * dy, 0) / np.sqrt(1 + dx**2 + dy**2)

    folder.mkdir(parents=True, exist_ok=True)
    for name, (rows, cols), pixel_m, value in [("image", (500, 700), 2, brightness), ("coarse", (24, 32), 60, height), ("truth", (500, 700), 2, height)]:
        x, y = (np.arange(cols) + 0.5) * pixel_m, -(np.arange(rows) + 0.5) * pixel_m
        place = dict(crs=MOON, transform=from_origin(0, 0, pixel_m, pixel_m))
        with rasterio.open(folder / f"hills_{name}.tif", "w", driver="GTiff", height=rows, width=cols, count=1, dtype="float32", **place) as file:
            file.write(value(*np.meshgrid(x, y)).astype("f4"), 1)
    return [dict(name="hills", sun_azimuth_deg="315", sun_elevation_deg="")]


def read(path):
    with rasterio.open(path) as file:
        return file.read(1, masked=True).astype("f8").filled(np.nan), dict(transform=file.transform, crs=file.crs or MOON)


def onto(path, shape, place, resampling):
    """The heights of a file on another grid."""
    heights, own = read(path)
    if heights.shape == shape and own["transform"] == place["transform"]:
        return heights
    to = np.full(shape, np.nan)
    reproject(heights, to, src_transform=own["transform"], src_crs=own["crs"], dst_transform=place["transform"], dst_crs=place["crs"],
              src_nodata=np.nan, dst_nodata=np.nan, resampling=resampling)
    return to


def errors(scenes, name, dtm, smooth):
    """The mean length of the slope vector's error and the heights' RMSE, over those of the coarse DTM, on the same pixels."""
    truth, place = read(scenes / f"{name}_truth.tif")
    maps = [truth, onto(dtm, truth.shape, place, Resampling.bilinear), onto(scenes / f"{name}_coarse.tif", truth.shape, place, Resampling.cubic)]
    valid = np.isfinite(maps).all(axis=0)
    maps = [np.where(valid, z, truth[valid].mean()) for z in maps]
    inner = binary_erosion(valid, iterations=9 if smooth else 1)
    if smooth:
        maps = [gaussian_filter(z, 2) for z in maps]
    wrong = [z - maps[0] for z in maps[1:]]
    slope = [np.hypot(*np.gradient(z, abs(place["transform"].a)))[inner].mean() for z in wrong]
    rmse = [np.sqrt((z[inner] ** 2).mean()) for z in wrong]
    return slope[0] / slope[1], rmse[0] / rmse[1]


def edges(size, tile, overlap):
    """The last line before the first one of each tile, and the last line of each tile."""
    firsts = {min(i * (tile - overlap), size - tile) for i in range(-(-(size - tile) // (tile - overlap)) + 1)} if size > tile else {0}
    return np.array(sorted({e for first in firsts for e in (first, first + tile) if 2 < e < size - 2}), int) - 1


def steps(heights, overlap):
    """Steps across lines at seams, and across all lines."""
    seams, everywhere = [], []
    for z, tile in ((heights, TILE[0]), (heights.T, TILE[1])):
        slope = np.diff(z, axis=0)
        step = np.abs(slope[1:-1] - (slope[:-2] + slope[2:]) / 2)  # step[i] is across lines i + 1 and i + 2
        seams.append(step[edges(len(z), tile, overlap) - 1].ravel())
        everywhere.append(step.ravel())
    return [values[np.isfinite(values)] for values in (np.concatenate(seams), np.concatenate(everywhere))]


def predicted(a, scenes, row, overlap, dtm):
    """Predicts a scene, if that has not been done; returns the command's record."""
    kept = dtm.with_suffix(".json")
    if not kept.exists():
        sun = [word for key in ("azimuth", "elevation") if row[f"sun_{key}_deg"] for word in (f"--sun-{key}", row[f"sun_{key}_deg"])]
        files = ["--image", scenes / f"{row['name']}_image.tif", "--coarse", scenes / f"{row['name']}_coarse.tif", "-o", dtm]
        text, seconds = run([a.program, "predict", *files, "--model", a.model, "--overlap", overlap, "--threads", 1, "--json", "-q", *sun])
        kept.write_text(json.dumps(dict(json.loads(text), cpu_s=seconds)))
    return json.loads(kept.read_text())


def figures(a, name, scenes, rows, overlap):
    """The row of an overlap."""
    to = a.out / name / f"overlap-{overlap}"
    to.mkdir(parents=True, exist_ok=True)
    records, judged, found = [], [], []
    for row in rows:
        dtm = to / f"{row['name']}.tif"
        records.append(predicted(a, scenes, row, overlap, dtm))
        judged.append(errors(scenes, row["name"], dtm, name == "real"))
        found.append(steps(read(dtm)[0], overlap))
    at_seams, everywhere = (np.concatenate(values) for values in zip(*found))
    slope, rmse = np.mean(judged, axis=0)
    measured = dict(overlap_px=overlap, scenes=len(rows), tiles=sum(r["tiles"]["all"] for r in records), cpu_s=sum(r["cpu_s"] for r in records))
    measured |= dict(slope_error=slope, rmse_ratio=rmse, step_m=at_seams.mean() if at_seams.size else None, elsewhere_m=everywhere.mean())
    return measured | dict(worst_m=at_seams.max() if name == "hills" else None)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=lambda word: Path(word).resolve())
    parser.add_argument("out", type=Path)
    parser.add_argument("--lists", default="hills,built-in,large")
    parser.add_argument("--real", type=Path)
    parser.add_argument("--model", default="ground")
    parser.add_argument("--overlaps", default="32,48,64,80,100,128")
    a = parser.parse_args()
    if unknown := [name for name in a.lists.split(",") if name not in LISTS or (name == "real" and not a.real)]:
        raise SystemExit(f"ERROR: --lists: expected {', '.join(LISTS)} (the last with --real), found {', '.join(unknown)}")
    a.out.mkdir(parents=True, exist_ok=True)
    for name in a.lists.split(","):
        scenes = a.out / name / "made" / "scenes"
        if name == "hills":
            rows = hills(scenes)
        else:
            words = {"built-in": [], "large": ["--suite", large_list(a.out)], "real": ["--real", a.real]}[name]
            if not (scenes / "scenes.csv").exists():
                run([a.program, "suite", *words, "--scenes-only", "--out", scenes.parent])
            rows = list(csv.DictReader((scenes / "scenes.csv").open()))
        table = [figures(a, name, scenes, rows, int(overlap)) for overlap in a.overlaps.split(",")]
        with (a.out / f"{name}.csv").open("w") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows({key: f"{value:.4g}" if isinstance(value, float) else value for key, value in row.items()} for row in table)
        print(name, (a.out / f"{name}.csv").read_text(), sep="\n", flush=True)


if __name__ == "__main__":
    main()
