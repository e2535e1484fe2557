#!/usr/bin/env python3
"""A synthetic strip as long as one of the NAC's: 16-bit image of 2 m a pixel and coarse DTM of 60 m, written row by row.

    python3 benches/strip.py FOLDER [--lines 50000] [--samples 5000] [--seed 1] [--truth]

Writes strip_image.tif, strip_coarse.tif and, with --truth, strip_truth.tif: for measuring memory and speed on sizes that
`host-train synth` does not make. The terrain (fractal, no craters) is periodic down the strip. Needs numpy, scipy, rasterio.
"""
import argparse
from pathlib import Path

import numpy as np
import rasterio
from rasterio.transform import from_origin
from rasterio.windows import Window
from scipy.ndimage import uniform_filter

PIXEL_M, COARSE_PX, PERIOD = 2.0, 30, 4096
CRS = "+proj=eqc +lat_ts=0 +lat_0=0 +lon_0=0 +x_0=0 +y_0=0 +R=1737400 +units=m +no_defs"
COMMON = dict(driver="GTiff", count=1, crs=CRS, compress="deflate")


def terrain(rng, cols):
    """Fractal heights in metres, PERIOD rows, periodic in both directions, 5 degrees steep on average."""
    f = np.hypot(*np.meshgrid(np.fft.fftfreq(PERIOD), np.fft.rfftfreq(cols), indexing="ij"))
    f[0, 0] = 1
    spectrum = (rng.standard_normal(f.shape) + 1j * rng.standard_normal(f.shape)) * f**-1.9
    spectrum[0, 0] = 0
    z = np.fft.irfft2(spectrum, s=(PERIOD, cols))
    slope = np.hypot(*np.gradient(z, PIXEL_M)).mean()
    return (z * np.tan(np.radians(5)) / slope).astype(np.float32)


def shading(z, elevation=np.radians(35)):
    """Lambert, Sun in the west."""
    gy, gx = np.gradient(z, PIXEL_M)
    return np.clip((np.sin(elevation) - np.cos(elevation) * gx) / np.sqrt(1 + gx**2 + gy**2), 0, None)


def create(path, rows, cols, dtype, pixel_m, **layout):
    place = from_origin(0, 0, pixel_m, pixel_m)
    return rasterio.open(path, "w", dtype=dtype, width=cols, height=rows, transform=place, **COMMON, **layout)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--lines", type=int, default=50_000)
    parser.add_argument("--samples", type=int, default=5_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--truth", action="store_true", help="also write the true heights")
    a = parser.parse_args()
    a.folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(a.seed)
    coarse_rows, coarse_cols = -(-a.lines // COARSE_PX), -(-a.samples // COARSE_PX)
    z = terrain(rng, coarse_cols * COARSE_PX)
    shade = shading(z)
    # One row per strip in the image, as ISIS and the LROC team write their files.
    image = create(a.folder / "strip_image.tif", a.lines, a.samples, "uint16", PIXEL_M, blockysize=1)
    truth = None
    if a.truth:
        truth = create(a.folder / "strip_truth.tif", a.lines, a.samples, "float32", PIXEL_M, tiled=True, bigtiff="if_safer")
    coarse = np.zeros((coarse_rows, coarse_cols), np.float32)
    rows_at_once = 34
    for first in range(0, coarse_rows, rows_at_once):
        rows = min(rows_at_once, coarse_rows - first)
        at = np.arange(first * COARSE_PX, (first + rows) * COARSE_PX) % PERIOD
        coarse[first : first + rows] = z[at].reshape(rows, COARSE_PX, coarse_cols, COARSE_PX).mean((1, 3))
        at = at[: a.lines - first * COARSE_PX]
        window = Window(0, first * COARSE_PX, a.samples, len(at))
        dn = 200 + 9000 * shade[at, : a.samples] * (1 + 0.01 * rng.standard_normal((len(at), a.samples), np.float32))
        image.write(np.clip(dn, 1, 65535).astype(np.uint16), 1, window=window)
        if truth:
            truth.write(z[at, : a.samples], 1, window=window)
    image.close()
    if truth:
        truth.close()
    # A low-frequency error of about a metre, as global models have it.
    coarse += 9 * uniform_filter(rng.standard_normal(coarse.shape).astype(np.float32), 9)
    with create(a.folder / "strip_coarse.tif", coarse_rows, coarse_cols, "float32", PIXEL_M * COARSE_PX) as file:
        file.write(coarse, 1)


if __name__ == "__main__":
    main()
