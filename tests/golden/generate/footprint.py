"""Writes footprint/case.json: slope and roughness of the least-squares planes under square footprints of the DEM in gdaldem/case.json.

    python3 tests/golden/generate/footprint.py tests/golden/gdaldem/case.json tests/golden/footprint/case.json

Needs numpy. Planes are fitted by its singular value decomposition, window by window.
"""
import json
import sys

import numpy as np

RADII_PX = [1, 2, 4]


def footprint(window, pixel):
    """Slope in degrees and largest vertical distance from the plane in metres of a window of heights."""
    if not np.isfinite(window).all():
        return None, None
    y, x = np.mgrid[0 : window.shape[0], 0 : window.shape[1]]
    design = np.stack([x.ravel() * pixel["col_m"], y.ravel() * pixel["row_m"], np.ones(window.size)], axis=1)
    plane = np.linalg.lstsq(design, window.ravel(), rcond=None)[0]
    slope = np.degrees(np.arctan(np.hypot(plane[0], plane[1])))
    return float(slope), float(np.abs(window.ravel() - design @ plane).max())


def main(source, path):
    with open(source) as file:
        case = json.load(file)
    rows, cols = case["rows"], case["cols"]
    heights = np.array([np.nan if h is None else h for h in case["heights_m"]], dtype=np.float64).reshape(rows, cols)
    footprints = []
    for r in RADII_PX:
        found = [(None, None)] * (rows * cols)
        for row in range(r, rows - r):
            for col in range(r, cols - r):
                found[row * cols + col] = footprint(heights[row - r : row + r + 1, col - r : col + r + 1], case["pixel"])
        footprints.append({"radius_px": r, "slope_deg": [f[0] for f in found], "roughness_m": [f[1] for f in found]})
    with open(path, "w") as file:
        json.dump({"made_by": f"numpy {np.__version__}", "footprints": footprints}, file)
        file.write("\n")


main(*sys.argv[1:])
