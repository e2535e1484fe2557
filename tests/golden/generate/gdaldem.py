"""Writes gdaldem/case.json: a small rough DEM with voids and what GDAL makes of it.

    python3 tests/golden/generate/gdaldem.py tests/golden/gdaldem/case.json

Needs numpy and the rasterio wheel. rasterio does not wrap GDALDEMProcessing, the function behind the `gdaldem` program,
so it is called in the GDAL library that the wheel brings along.
"""
import ctypes
import glob
import json
import os
import sys
import tempfile

import numpy as np
import rasterio
from rasterio.transform import Affine

ROWS, COLS, NODATA = 18, 23, -9999.0
PIXEL = {"row_m": 3.0, "col_m": 2.0}
SUNS = [(315.0, 45.0, 1.0), (120.0, 20.0, 2.5), (0.0, 8.0, 0.5)]


def library():
    folder = os.path.join(os.path.dirname(os.path.dirname(rasterio.__file__)), "rasterio.libs")
    gdal = ctypes.CDLL(glob.glob(os.path.join(folder, "libgdal*"))[0])
    for name in ("GDALOpen", "GDALDEMProcessingOptionsNew", "GDALDEMProcessing"):
        getattr(gdal, name).restype = ctypes.c_void_p
    gdal.GDALAllRegister()
    return gdal


def process(gdal, source, kind, arguments):
    words = [a.encode() for a in arguments]
    array = (ctypes.c_char_p * (len(words) + 1))(*words, None)
    options = ctypes.c_void_p(gdal.GDALDEMProcessingOptionsNew(array, None))
    with tempfile.TemporaryDirectory() as folder:
        out = os.path.join(folder, "out.tif")
        opened = ctypes.c_void_p(gdal.GDALOpen(source.encode(), 0))
        made = gdal.GDALDEMProcessing(out.encode(), opened, kind.encode(), None, options, None)
        gdal.GDALClose(ctypes.c_void_p(made))
        gdal.GDALClose(opened)
        with rasterio.open(out) as result:
            return result.read(1)


def main(path):
    gdal = library()
    random = np.random.default_rng(7)
    y, x = np.mgrid[0:ROWS, 0:COLS]
    heights = 8 * np.sin(x / 3.1) + 6 * np.cos(y / 2.3) + random.normal(0, 1.5, (ROWS, COLS)) - 1900
    heights = (np.round(heights * 64) / 64).astype(np.float32)
    heights[3, 5] = heights[0, 11] = heights[12:14, 19] = NODATA
    with tempfile.TemporaryDirectory() as folder:
        source = os.path.join(folder, "dem.tif")
        profile = dict(driver="GTiff", height=ROWS, width=COLS, count=1, dtype="float32", nodata=NODATA)
        profile |= dict(transform=Affine(PIXEL["col_m"], 0, 0, 0, -PIXEL["row_m"], 0))
        with rasterio.open(source, "w", **profile) as dem:
            dem.write(heights, 1)
        slope = process(gdal, source, "slope", [])
        shades = [process(gdal, source, "hillshade", ["-az", str(a), "-alt", str(e), "-z", str(z)]) for a, e, z in SUNS]
    case = {
        "made_by": f"GDAL {rasterio.__gdal_version__}",
        "rows": ROWS,
        "cols": COLS,
        "pixel": PIXEL,
        "heights_m": [None if h == NODATA else float(h) for h in heights.ravel()],
        "slope_deg": [None if s == NODATA else float(s) for s in slope.ravel()],
        "hillshade": [
            {"azimuth_deg": a, "elevation_deg": e, "exaggeration": z, "bytes": s.ravel().tolist()}
            for (a, e, z), s in zip(SUNS, shades)
        ],
    }
    with open(path, "w") as file:
        json.dump(case, file)
        file.write("\n")


main(sys.argv[1])
