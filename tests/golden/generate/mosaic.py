"""Blends three overlapping tiles with gaps by dem_mosaic's rules, written with numpy and scipy alone.

python3 tests/golden/generate/mosaic.py tests/golden/mosaic/blend.f32
"""
import sys

import numpy as np
from scipy import ndimage, stats

SCENE, TILE, SIGMA = (70, 90), (48, 60), 5.0
CORNERS = [(0, 0), (10, 30), (22, 7)]

rng = np.random.default_rng(20240)
taps = np.arange(-17, 18)
kernel = stats.norm.cdf(taps + 0.5, scale=SIGMA) - stats.norm.cdf(taps - 0.5, scale=SIGMA)
kernel /= kernel.sum()

tiles = []
sum_wz, sum_w = np.zeros(SCENE), np.zeros(SCENE)
for row, col in CORNERS:
    z = (-1900 + ndimage.gaussian_filter(rng.normal(size=TILE), 4) * 200 + row).astype("f4")
    gap = ndimage.gaussian_filter(rng.normal(size=TILE), 3) > 0.14
    z[gap] = np.nan
    tiles.append(z)
    inside = np.pad(~gap, 1)  # beyond the border there is nothing
    distance = ndimage.distance_transform_cdt(inside, metric="taxicab")[1:-1, 1:-1].astype("f8")
    blurred = ndimage.convolve1d(ndimage.convolve1d(distance, kernel, axis=0, mode="constant"), kernel, axis=1, mode="constant")
    w = np.where(distance > 0, blurred**2, 0.0)
    window = np.s_[row : row + TILE[0], col : col + TILE[1]]
    sum_wz[window] += np.where(w > 0, w * np.nan_to_num(z.astype("f8")), 0.0)
    sum_w[window] += w

with np.errstate(invalid="ignore"):
    scene = (sum_wz / sum_w).astype("f4")
out = np.concatenate([t.ravel() for t in tiles] + [scene.ravel()]).astype("<f4")
out.tofile(sys.argv[1])
print(out.size, "numbers;", int(np.isnan(scene).sum()), "pixels without height;", [int(np.isnan(t).sum()) for t in tiles], "gaps")
