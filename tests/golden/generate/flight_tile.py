#!/usr/bin/env python3
"""A tile as a camera would hand it to the flight library, with gaps: raw little-endian arrays, row-major 256 x 320.

    cargo run -p host-train -- synth --out scene --rows 256 --cols 320 --seed 6 --kind highland
    python3 tests/golden/generate/flight_tile.py scene tests/golden/flight_tile     # numpy, rasterio
"""
import sys
from pathlib import Path

import numpy as np
import rasterio
from rasterio.warp import Resampling, reproject

scene, out = Path(sys.argv[1]), Path(sys.argv[2])
with rasterio.open(scene / "scene_0000_image.tif") as source:
    image, transform, crs = source.read(1).astype("<f4"), source.transform, source.crs
coarse = np.full(image.shape, np.nan, "<f4")
with rasterio.open(scene / "scene_0000_coarse.tif") as source:
    reproject(
        rasterio.band(source, 1), coarse, dst_transform=transform, dst_crs=crs, dst_nodata=np.nan,
        resampling=Resampling.cubic_spline,
    )
assert image.shape == (256, 320) and np.isfinite(coarse).all()

image[40:48, 100:140] = np.nan  # lost packets
image[200, 7] = np.inf
coarse[120:124, 300:] = np.float32(-3.4028226550889045e38)  # ISIS NULL
valid = np.ones(image.shape, "u1")
valid[240:, :24] = 0  # a corner the camera does not see
image[240:, :24] = 0
for name, array in [("image.f32", image), ("coarse_m.f32", coarse.astype("<f4")), ("valid.u8", valid)]:
    (out / name).write_bytes(array.tobytes())
