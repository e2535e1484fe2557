#!/usr/bin/env python3
"""What other weights of the anchor, and laser tracks, are worth: computed from the DTMs and expected errors that models/card.sh has made in OUT.

    host-train/suites/estimates.py OUT anchor     RMSE over the coarse DTM's: the shipped anchor, none, and other weights and widths of it
    host-train/suites/estimates.py OUT sigma      scenes whose heights are within 0.55-0.80 and 0.88-0.99 of 1 and 1.96 expected standard
                                                  deviations: as they are, with the coarse DTM's sigma told, or as `predict --tracks` finds it
                                                  along simulated laser tracks; from the coarse DTM itself, too (`without relief`)
    host-train/suites/estimates.py OUT floor      the same for fewer laser spots than `predict` takes, without the program
    host-train/suites/estimates.py OUT ceiling    the same if the error's standard deviation is known, and its map is not
    host-train/suites/estimates.py OUT means      mean heights over ellipses that are within 1 and 1.96 expected standard deviations, with what is
                                                  assumed of the coarse DTM's error and as `predict --tracks` finds it along four tracks; how far
                                                  apart the errors that an image leaves are alike
    host-train/suites/estimates.py OUT fields     the same of drawn errors alone; their covariance, and what is nearest to it

Other anchors are computed as core/src/norm/anchor.rs has it, but over the whole scene instead of tile by tile. PROGRAM: host-train (default: built by cargo). Needs numpy, scipy and rasterio.
"""

import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import zlib

import numpy as np
import rasterio
import rasterio.warp
from external import SLDEM_PIXEL_M, sldem_errors
from means import sigma_of_mean
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates, uniform_filter1d

LISTS = "real", "real-erring", "apollo15", "independent", "stereolunar", "suite"
WEIGHTS, HALF_WIDTHS_COARSE_PX = (0.5, 0.7, 1.0), (0.5, 0.75)
# Standard deviation of the errors in `real-erring` in coarse pixels: 2.6 m and 1.5 m for 59.2 m.
ERRING_SIGMA_PX = np.hypot(2.6, 1.5) / 59.2
TRACKS, DRAWS = (4, 2, 8), 2
# As in host-train/scene/src/predict/sigma.rs and correlation.rs.
ASSUMED_SIGMA_M, ASSUMED_PX, LONGEST_PX = 0.04 * SLDEM_PIXEL_M, 9, 100
RADII_PX, ELLIPSES = (1, 2, 4, 8, 16), 6
FEW_SPOTS, FEW_TRACKS, FEW_DRAWS = (5, 10, 15, 20, 30), (1, 2, 3), 12
PROGRAM = os.environ.get("PROGRAM", "cargo run --release --quiet --package host-train --").split()
RANGES = np.array([[0.55, 0.80], [0.88, 0.99]])


def read(path, band=1):
    with rasterio.open(path) as file:
        return file.read(band, masked=True).astype("f8").filled(np.nan), file.transform, file.tags()


def filled(map_):
    return map_[tuple(distance_transform_edt(~np.isfinite(map_), return_distances=False, return_indices=True))]


def bicubic(map_, place, grid, shape):
    """Catmull-Rom between the samples, as the coarse DTM is brought onto the image's grid."""
    for axis, (first, step) in enumerate((((grid.f - place.f) / place.e, grid.e / place.e), ((grid.c - place.c) / place.a, grid.a / place.a))):
        at = first + (np.arange(shape[axis]) + 0.5) * step - 0.5
        whole = np.floor(at).astype(int)
        out = 0
        for tap in (-1, 0, 1, 2):
            far = np.abs(at - whole - tap)
            weight = np.where(far <= 1, 1.5 * far**3 - 2.5 * far**2 + 1, -0.5 * far**3 + 2.5 * far**2 - 4 * far + 2)
            taken = np.take(map_, np.clip(whole + tap, 0, map_.shape[axis] - 1), axis)
            out = out + taken * weight.reshape((-1, 1) if axis == 0 else (1, -1))
        map_ = out
    return map_


def means(map_, half_px):
    """Means over squares, of the pixels inside the map."""
    def sums(values):
        for axis in (0, 1):
            values = uniform_filter1d(values, 2 * int(half_px + 0.5) + 1, axis, mode="constant")
        return values
    return sums(map_) / sums(np.ones_like(map_))


class Scene:
    """Maps of a scene on the image's grid."""

    def __init__(self, out, part, name, dtm):
        self.dtm, self.grid, _ = read(dtm)
        self.coarse, place, _ = read(out / part / "scenes" / f"{name}_coarse.tif")
        truth, of_truth, _ = read(out / part / "scenes" / f"{name}_truth.tif")
        self.coarse = bicubic(filled(self.coarse), place, self.grid, self.dtm.shape)
        self.coarse_m, self.coarse_px = abs(place.a), abs(place.a / self.grid.a)
        rows, cols = (np.arange(n) + 0.5 for n in self.dtm.shape)
        down = (self.grid.f + self.grid.e * rows - of_truth.f) / of_truth.e - 0.5
        right = (self.grid.c + self.grid.a * cols - of_truth.c) / of_truth.a - 0.5
        at = np.meshgrid(down, right, indexing="ij")
        finer = self.grid.a / of_truth.a
        smooth = gaussian_filter(filled(truth), 0.4 * finer) if finer > 1.5 else filled(truth)
        self.truth = map_coordinates(smooth, at, order=1, mode="nearest")
        self.truth[map_coordinates(np.isfinite(truth).astype("f8"), at, order=1, mode="nearest") < 0.99] = np.nan


def names(out, part):
    return sorted(path.name.removesuffix("_truth.tif") for path in (out / part / "scenes").glob("*_truth.tif"))


def found(folder, name):
    return next(path for path in (folder / f"{name}.tif", folder / f"{name}_dtm.tif") if path.exists())


def anchor(out):
    kinds = [(half, weight) for half in HALF_WIDTHS_COARSE_PX for weight in WEIGHTS]
    print("model list", "anchor", "none", *(f"half-width-{half}-weight-{weight}" for half, weight in kinds))
    for model in ("nano", "ground"):
        for part in LISTS:
            if not (out / f"{part}-free").is_dir():
                print(f"SKIPPED: {out / part}-free: not there")
                continue
            ratios = []
            for name in names(out, part):
                folder = "int8" if (out / part / "dtm/int8").is_dir() and model == "nano" else model
                anchored = Scene(out, part, name, found(out / part / "dtm" / folder, name))
                free, _, _ = read(found(out / f"{part}-free/dtm" / model, name))
                valid = np.isfinite(anchored.dtm + free + anchored.truth)
                rms = lambda dtm: np.sqrt(np.mean((dtm - anchored.truth)[valid] ** 2))
                whole = np.where(np.isfinite(free), free, anchored.coarse)
                apart = means(whole, 0.5 * anchored.coarse_px) - anchored.coarse
                made = [anchored.dtm, free]
                for half, weight in kinds:
                    low = apart
                    for _ in range(3):
                        low = means(low, half * anchored.coarse_px)
                    made.append(free - weight * low)
                ratios.append([rms(dtm) / rms(anchored.coarse) for dtm in made])
            print(model, part, *(f"{mean:.3f}" for mean in np.mean(ratios, 0)), flush=True)


def shares(errors, sds):
    ratio = np.abs(errors / sds)
    return [np.mean(ratio[np.isfinite(ratio)] < limit) for limit in (1, 1.96)]


def report(part, how, of):
    inside = np.mean((RANGES[:, 0] <= of) & (of <= RANGES[:, 1]), 0)
    cells = (f"{mean:.2f} ({least:.2f}, {most:.2f}) {100 * share:.0f} %" for mean, least, most, share in zip(np.mean(of, 0), np.min(of, 0), np.max(of, 0), inside))
    print(f"{part:12} {how:22}", *cells, flush=True)


def along_tracks(scene, sds, tracks, random):
    """Pixels of laser spots, track by track: one for each coarse pixel's length along slanted tracks from the upper edge to the lower."""
    rows, cols = scene.dtm.shape
    step, spots = max(1, round(scene.coarse_px)), []
    for track in range(tracks):
        row = np.arange(random.integers(step), rows, step)
        col = np.round((track + random.random()) * cols / tracks + 0.15 * (2 * random.random() - 1) * (row - rows / 2)).astype(int)
        inside = (0 <= col) & (col < cols)
        row, col = row[inside], col[inside]
        valid = np.isfinite((scene.dtm - scene.truth + sds)[row, col])
        spots.append((row[valid], col[valid]))
    return spots


def square_along(errors, from_image, at):
    """Mean square of the coarse DTM's own error along tracks, as host-train/scene/src/predict/sigma.rs has it."""
    off = np.abs(errors[at] - np.median(errors[at]))
    kept = off <= max(1.0, 5 * 1.4826 * np.median(off))
    return max(0.0, np.mean((errors**2 - from_image**2)[at][kept]))


def by_program(out, part, name, scene, spots):
    """The standard deviations of heights, and that of the coarse DTM, from `predict --tracks`; None where it refuses the tracks."""
    with rasterio.open(out / part / "scenes" / f"{name}_image.tif") as file:
        known = file.crs.to_dict()
        sphere = rasterio.crs.CRS.from_proj4(f"+proj=longlat +R={known.get('R', known.get('a'))} +no_defs")
        place = lambda at: rasterio.warp.transform(file.crs, sphere, *rasterio.transform.xy(file.transform, *at))
        places = [place(at) if at[0].size else ((), ()) for at in spots]
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        with open(folder / "tracks.csv", "w") as table:
            print("time,lon,lat,height_m", file=table)
            for track, (at, (lon, lat)) in enumerate(zip(spots, places)):
                for one in zip(lon, lat, scene.truth[at]):
                    print(10_000 * track, *(f"{value:.9f}" for value in one), sep=",", file=table)
        words = ["predict", "-q", "--fit-sun", "--threads", "1", "--json", "--model", "nano"]
        for option, kind in (("--image", "image"), ("--coarse", "coarse")):
            words += [option, out / part / "scenes" / f"{name}_{kind}.tif"]
        words += ["-o", folder / "dtm.tif", "--uncertainty", folder / "e.tif", "--tracks", folder / "tracks.csv"]
        made = subprocess.run([*PROGRAM, *words], capture_output=True, text=True)
        if made.returncode == 65 and "coarse pixels on 2 tracks expected" in made.stderr:
            return None
        if made.returncode:
            sys.exit(f"{part} {name}: {made.stderr}")
        return read(folder / "e.tif")[0], json.loads(made.stdout)["uncertainty"]


def sure(out, part):
    """Scenes with their expected errors, without and with the coarse DTM's."""
    for name in names(out, part):
        scene = Scene(out, part, name, out / "sure" / part / f"{name}.tif")
        sds, _, tags = read(out / "sure" / part / f"{name}_e.tif")
        yield name, scene, np.sqrt(np.maximum(sds**2 - float(tags["COARSE_SIGMA_M"]) ** 2, 0)), sds


def sigma(out):
    print("list, sigma of the coarse DTM; heights within 1 and 1.96 sd: mean (least, most), scenes in range")
    for part in ("real", "real-erring", "suite"):
        of, refused = {}, 0
        for name, scene, from_image, sds in sure(out, part):
            errors = scene.dtm - scene.truth
            add = lambda how, sigma_m: of.setdefault(how, []).append(shares(errors, np.hypot(from_image, sigma_m)))
            of.setdefault("assumed", []).append(shares(errors, sds))
            if part != "suite":
                add("told", ERRING_SIGMA_PX * scene.coarse_m if part == "real-erring" else 1e-6)
            for tracks in TRACKS:
                for draw in range(DRAWS):
                    spots = along_tracks(scene, sds, tracks, np.random.default_rng([zlib.crc32(name.encode()), tracks, draw]))
                    found = by_program(out, part, name, scene, spots)
                    if not found:
                        refused += 1
                        continue
                    at = tuple(np.concatenate(spots, 1))
                    expected = np.sqrt(square_along(errors, from_image, at))
                    sigma_m = found[1]["tracks"]["sigma_m"]
                    if abs(sigma_m - expected) > 0.02 * expected + 0.02:
                        sys.exit(f"{part} {name}, {tracks} tracks, draw {draw}: {expected} m expected, the program found {sigma_m} m")
                    of.setdefault(f"from {tracks} tracks", []).append(shares(errors, found[0]))
                    add(f"{tracks}, without relief", np.sqrt(np.mean((scene.coarse - scene.truth)[at] ** 2)))
        for how, one in of.items():
            report(part, how, np.array(one))
        print(f"{part:12} {refused} draws refused: too few spots", flush=True)


def floor(out):
    """Pieces of so many spots in a row of each track."""
    print("list, spots of tracks; heights within 1 and 1.96 sd: mean (least, most), scenes in range")
    for part in ("real", "real-erring", "suite"):
        of = {}
        for name, scene, from_image, sds in sure(out, part):
            errors, random = scene.dtm - scene.truth, np.random.default_rng(zlib.crc32(name.encode()))
            of.setdefault("assumed", []).append(shares(errors, sds))
            for tracks, number in ((tracks, number) for tracks in FEW_TRACKS for number in FEW_SPOTS):
                for _ in range(FEW_DRAWS):
                    lengths = [number // tracks + (track < number % tracks) for track in range(tracks)]
                    spots = along_tracks(scene, sds, tracks, random)
                    if any(row.size < length for (row, _), length in zip(spots, lengths)):
                        continue
                    first = [random.integers(row.size - length + 1) for (row, _), length in zip(spots, lengths)]
                    pieces = [(row[at : at + n], col[at : at + n]) for (row, col), at, n in zip(spots, first, lengths)]
                    more = square_along(errors, from_image, tuple(np.concatenate(pieces, 1)))
                    of.setdefault(f"{number} of {tracks}", []).append(shares(errors, np.sqrt(from_image**2 + more + 1e-12)))
        for how, one in of.items():
            report(part, how, np.array(one))


def ceiling():
    """Errors drawn as for `real-erring`."""
    print("coarse pixels, what is known of the error; within 1 and 1.96 sd")
    for shape in ((6, 6), (10, 10), (12, 12), (14, 15), (25, 10)):
        maps = np.array([sldem_errors(np.array(shape), np.random.default_rng(1000 + seed)) for seed in range(400)])
        for how, sds in (("sd of all maps", np.sqrt(np.mean(maps**2))), ("rms of each map", np.sqrt(np.mean(maps**2, (1, 2), keepdims=True)))):
            report(f"{shape[0]} x {shape[1]}", how, np.array([shares(*pair) for pair in zip(maps, np.broadcast_to(sds, maps.shape))]))


def length_along(errors, spots, coarse_px, square):
    """Correlation length of errors along tracks, coarse pixels, as host-train/scene/src/predict/correlation.rs has it; None if they do not tell."""
    counts, sums = np.zeros((2, LONGEST_PX + 1))
    for row, col in spots:
        cells, index = np.unique((np.array((row, col)) / coarse_px).astype(int), axis=1, return_inverse=True)
        means = np.bincount(index.ravel(), errors[row, col]) / np.bincount(index.ravel())
        first, second = np.triu_indices(means.size, 1)
        lag = np.rint(np.hypot(*(cells[:, first] - cells[:, second]))).astype(int)
        near = lag <= LONGEST_PX
        np.add.at(counts, lag[near], 1)
        np.add.at(sums, lag[near], (means[first] * means[second])[near])
    lags = np.flatnonzero(counts)
    if not lags.size or lags[-1] < 2 * ASSUMED_PX or square <= 0:
        return None
    lengths = np.append(np.exp(np.arange(np.log(0.25), np.log(lags[-1] / 2), np.log(1.02))), lags[-1] / 2)
    misfits = [np.sum(counts[lags] * (sums[lags] / counts[lags] / square - np.exp(-lags / length)) ** 2) for length in lengths]
    return lengths[np.argmin(misfits)]


def ellipses(shape, radius, random):
    """Ellipses inside a map with the area of a disc of this radius, pixels, at most twice as long as wide."""
    rows, cols = np.ogrid[: shape[0], : shape[1]]
    longer = radius * np.sqrt(2)
    for _ in range(ELLIPSES if 2 * longer + 1 <= min(shape) else 0):
        half, angle = radius * np.sqrt(1 + random.random()), np.pi * random.random()
        row, col = (longer + random.random() * (side - 1 - 2 * longer) for side in shape)
        along = (rows - row) * np.sin(angle) + (cols - col) * np.cos(angle)
        across = (rows - row) * np.cos(angle) - (cols - col) * np.sin(angle)
        yield (along / half) ** 2 + (across * half / radius**2) ** 2 <= 1


def report_means(part, of):
    for (how, radius), ratios in sorted(of.items()):
        inside = (f"{np.mean(np.abs(ratios) < limit):.2f}" for limit in (1, 1.96))
        print(f"{part:12} {how:28} {radius:2}", *inside, f"{np.sqrt(np.mean(np.square(ratios))):.2f} of {len(ratios)}", flush=True)


def means_of(errors, pixel_m, coarse_px, known, random, of):
    """Adds the ratios of mean errors over ellipses to their standard deviations. `known`: map of those of heights, sigma and length of the coarse
    DTM's errors in metres, by how they are known."""
    valid = np.isfinite(errors + sum(map_ for map_, _, _ in known.values()))
    for radius in RADII_PX:
        for inside in ellipses(errors.shape, radius * coarse_px, random):
            if np.count_nonzero(inside & valid) < 0.9 * np.count_nonzero(inside):
                continue
            inside &= valid
            for how, (map_, *sigma_and_length) in known.items():
                sd = sigma_of_mean(map_, inside, pixel_m, coarse_px * pixel_m, *sigma_and_length)
                of.setdefault((how, radius), []).append(errors[inside].mean() / sd)


def mean_heights(out):
    print("list, sigma and length of the coarse DTM's error; radius in coarse pixels, within 1 and 1.96 sd, rms error in sd")
    for part in ("real", "real-erring", "suite"):
        of, lengths = {}, []
        for name, scene, from_image, sds in sure(out, part):
            errors, random = scene.dtm - scene.truth, np.random.default_rng(zlib.crc32(name.encode()))
            pixel_m, sigma_m = scene.coarse_m / scene.coarse_px, min(3, 0.04 * scene.coarse_m)
            known = {"assumed, independent": (sds, sigma_m, 1e-3), "assumed": (sds, sigma_m, ASSUMED_PX * scene.coarse_m)}
            spots = along_tracks(scene, sds, TRACKS[0], random)
            found = by_program(out, part, name, scene, spots)
            if found:
                told = found[1]["coarse_sigma_m"], found[1]["coarse_correlation_m"]
                off = np.abs(errors - np.median(errors[tuple(np.concatenate(spots, 1))]))
                limit = max(1.0, 5 * 1.4826 * np.median(off[tuple(np.concatenate(spots, 1))]))
                kept = [(row[off[row, col] <= limit], col[off[row, col] <= limit]) for row, col in spots]
                length = length_along(errors, kept, scene.coarse_px, told[0] ** 2)
                expected = (ASSUMED_PX if length is None else length) * scene.coarse_m
                if abs(told[1] / expected - 1) > 0.05:
                    sys.exit(f"{part} {name}: a length of {expected} m expected, the program found {told[1]} m")
                lengths.append(length)
                known["found"] = found[0], *told
                known["sigma found, length assumed"] = found[0], told[0], ASSUMED_PX * scene.coarse_m
            means_of(errors, pixel_m, scene.coarse_px, known, random, of)
        report_means(part, of)
        print(f"{part:12} lengths found, coarse pixels:", *("too short" if one is None else f"{one:.1f}" for one in lengths))
    of_image(out)


def of_image(out):
    """What the image leaves is the whole error where the coarse DTM has none."""
    lags, of = (0.5, 1, 2, 3, 4), []
    for _, scene, _, _ in sure(out, "real"):
        errors = scene.dtm - scene.truth
        square, products = np.nanmean(errors**2), []
        for lag in lags:
            far = max(1, round(lag * scene.coarse_px))
            products.append(np.mean([np.nanmean(errors[far:] * errors[:-far]), np.nanmean(errors[:, far:] * errors[:, :-far])]))
        of.append(np.array(products) / square)
    print("correlation of the image's errors at", *lags, "coarse pixels:", *(f"{one:.2f}" for one in np.mean(of, 0)))


def fields():
    print("covariance of drawn errors at distances in coarse pixels, over the variance: without direction, down the stripes; nearest models")
    side, number, random = 64, 300, np.random.default_rng(1)
    squares = sum(np.abs(np.fft.fft2(sldem_errors((side, side), random), (2 * side, 2 * side))) ** 2 for _ in range(number))
    pairs = np.fft.ifft2(np.abs(np.fft.fft2(np.ones((side, side)), (2 * side, 2 * side))) ** 2).real
    products = np.fft.ifft2(squares / number).real
    far = np.abs(np.fft.fftfreq(2 * side, 1 / (2 * side)))
    lag = np.rint(np.hypot(*np.meshgrid(far, far, indexing="ij"))).astype(int)
    every = np.bincount(lag.ravel(), products.ravel()) / np.bincount(lag.ravel(), pairs.ravel()) / products[0, 0] * pairs[0, 0]
    down = products[:, 0] / np.maximum(pairs[:, 0], 1) / products[0, 0] * pairs[0, 0]
    for distance in (1, 2, 4, 6, 9, 12, 16, 24, 32):
        print(f"{distance:2} {every[distance]:.2f} {down[distance]:.2f}")
    lengths = np.arange(1, 30, 0.1)
    for how, curve in (("without direction", every), ("down the stripes", down)):
        for form, power in (("exponential", 1), ("Gaussian", 2)):
            for last in (12, 24, 40):
                misfit = [np.sqrt(np.mean((curve[1 : last + 1] - np.exp(-((np.arange(1, last + 1) / one) ** power))) ** 2)) for one in lengths]
                print(f"{how}, to {last}: {form} of {lengths[np.argmin(misfit)]:.1f} coarse pixels, rms {min(misfit):.3f}")
    print("shape; radius in coarse pixels, within 1 and 1.96 sd, rms error in sd")
    for shape in ((12, 12), (25, 25), (60, 60), (120, 120)):
        of, told = {}, []
        for seed in range(400 if shape[0] < 100 else 200):
            random = np.random.default_rng(1000 + seed)
            scene = argparse.Namespace(dtm=sldem_errors(np.array(shape), random), truth=0, coarse_px=1)
            spots = along_tracks(scene, 0, TRACKS[0], random)
            sigma_m = np.sqrt(square_along(scene.dtm, 0, tuple(np.concatenate(spots, 1))))
            length = length_along(scene.dtm, spots, 1, sigma_m**2)
            told.append(length or np.nan)
            ways = {"assumed, independent": (ASSUMED_SIGMA_M, 1e-3), "assumed": (ASSUMED_SIGMA_M, ASSUMED_PX), "found": (sigma_m, length or ASSUMED_PX),
                    "sigma found, length assumed": (sigma_m, ASSUMED_PX)}
            known = {how: (np.full(shape, sigma), sigma, of_pixels * SLDEM_PIXEL_M) for how, (sigma, of_pixels) in ways.items()}
            means_of(scene.dtm, SLDEM_PIXEL_M, 1, known, random, of)
        report_means(f"{shape[0]} x {shape[1]}", of)
        if np.any(np.isfinite(told)):
            print("lengths found, coarse pixels, 10, 50 and 90 %:", *(f"{one:.1f}" for one in np.nanquantile(told, (0.1, 0.5, 0.9))))


def main():
    of_files = {"anchor": anchor, "sigma": sigma, "floor": floor, "means": mean_heights}
    if len(sys.argv) != 3 or sys.argv[2] not in (*of_files, "ceiling", "fields"):
        sys.exit(__doc__)
    drawn = {"ceiling": ceiling, "fields": fields}.get(sys.argv[2])
    drawn() if drawn else of_files[sys.argv[2]](pathlib.Path(sys.argv[1]))


main()
