#!/usr/bin/env python3
"""Lists of test scenes from a folder of independent data, for `host-train suite --suite LIST.toml`.

    host-train/suites/external.py DATA OUT

DATA holds any of the folders independent_synthetic, stereolunar, nac_apollo15 and nac_m139939938le; for each that is there a list is
written into OUT (and, for the Apollo 15 crop, a DTM as GeoTIFF); the others are named as skipped. Needs numpy and rasterio. Where the
data do not tell the Sun, it is fitted to image and truth by the best correlation with a Lambert hillshade, and the list says so.
"""

import json
import pathlib
import sys

import numpy as np
import rasterio

MOON = "+proj=eqc +lat_ts=0 +lat_0=0 +lon_0=0 +R=1737400"


def read(path):
    with rasterio.open(path) as file:
        return file.read(1, masked=True).astype("f8").filled(np.nan), abs(file.transform.a)


def lambert(heights, pixel_m, azimuth_deg, elevation_deg):
    south, east = np.gradient(heights, pixel_m)
    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    sun = np.sin(azimuth) * np.cos(elevation), -np.cos(azimuth) * np.cos(elevation), np.sin(elevation)
    return np.clip((sun[2] - east * sun[0] - south * sun[1]) / np.sqrt(1 + east**2 + south**2), 0, None)


def correlation(a, b):
    both = np.isfinite(a) & np.isfinite(b)
    return np.corrcoef(a[both], b[both])[0, 1]


def fitted_sun(image, truth, pixel_m, elevations):
    """The azimuth (to 2 degrees) and elevation whose hillshade of the truth is most like the image."""
    tried = [(correlation(image, lambert(truth, pixel_m, az, el)), az, el) for el in elevations for az in range(0, 360, 10)]
    _, azimuth, elevation = max(tried)
    near = [(correlation(image, lambert(truth, pixel_m, az % 360, elevation)), az % 360) for az in range(azimuth - 10, azimuth + 11, 2)]
    return max(near)[1], elevation, max(near)[0]


def toml(value):
    return json.dumps(str(value)) if isinstance(value, (str, pathlib.Path)) else json.dumps(value)


def write(out, name, about, scenes):
    lines = [f"name = {toml(name)}", f"about = {toml(about)}"]
    for scene in scenes:
        lines += ["", "[[scene]]"] + [f"{key} = {toml(value)}" for key, value in scene.items()]
    (out / f"{name}.toml").write_text("\n".join(lines) + "\n")
    print(f"{out / name}.toml: {len(scenes)} scenes")


def independent_synthetic(folder, out):
    scenes = []
    for image in sorted(folder.glob("*_image.tif")):
        name = image.name.removesuffix("_image.tif")
        coarse, truth = (folder / f"{name}_{what}.tif" for what in ("coarse", "truth"))
        azimuth, elevation, how = fitted_sun(read(image)[0], *read(truth), range(10, 80, 5))
        remarks = f"Sun fitted to image and truth (correlation {how:.2f})."
        scenes.append(dict(name=name, kind="independent", image=image, coarse=coarse, truth=truth, sun_azimuth_deg=azimuth,
                           sun_elevation_deg=elevation, remarks=remarks))
    about = "Synthetic scenes of another generator: image of 2 m, coarse DTM of 60 m with 1.5 m of low-frequency error and up to 8 m of misregistration."
    write(out, "independent", about, scenes)


def stereolunar(folder, out):
    place = {"00540": "place 540", "00541": "place 540", "00576": "place 576", "00577": "place 576"}
    scenes = []
    for entry in json.loads((folder / "coregistration.json").read_text()):
        ground, image = entry["geom"], entry["img"]
        truth = folder / f"g{ground}_height_50m_f32.tif"
        scenes.append(dict(name=f"g{ground}-{image}", kind=place[ground], ground=f"g{ground}", truth=truth,
                           image=folder / f"g{ground}_img{image}_u8.tif", srs=MOON, coarse_px=30, sun_azimuth_deg=entry["az"],
                           sun_elevation_deg=entry["alt"]))
    about = ("Ray-traced images over laser topography at 50 m a pixel, a scale far from training: a test of generalisation. The coarse "
             "DTM is the truth averaged over 1.5 km, without error. Heights carry steps of 16 m, smoothed. 540 and 541, and 576 and "
             "577, are overlapping views of one place each.")
    write(out, "stereolunar", about, scenes)


def nac_apollo15(folder, out):
    source = next(folder.glob("*.png"))
    heights = read(source)[0] * 49 / 255
    # Steps of 0.19 m would shade as terraces: a Gaussian of 1.5 pixels takes them away.
    taps = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)
    padded = np.pad(heights, 5, mode="edge")
    for axis in (0, 1):
        padded = np.apply_along_axis(lambda line: np.convolve(line, taps / taps.sum(), "valid"), axis, padded)
    truth = (out / "apollo15.tif").resolve()
    transform = rasterio.transform.from_origin(110_000, 790_000, 2, 2)
    with rasterio.open(truth, "w", driver="GTiff", height=padded.shape[0], width=padded.shape[1], count=1, dtype="float32",
                       crs=rasterio.crs.CRS.from_proj4(MOON), transform=transform) as file:
        file.write(padded.astype("f4"), 1)
    suns = [(300, 25), (60, 25), (180, 40), (90, 12)]
    scenes = [dict(name=f"apollo15-az{azimuth}-el{elevation}", kind="Apollo 15", ground="apollo15", truth=truth,
                   sun_azimuth_deg=azimuth, sun_elevation_deg=elevation) for azimuth, elevation in suns]
    about = ("Real relief of a stereo DTM (crop of 257 x 257 pixels of 2 m, smoothed), rendered by this program without albedo; coarse DTM "
             "averaged from it over 60 m, without error.")
    write(out, "apollo15", about, scenes)


def nac_pair(folder, out):
    image, truth = folder / "image.tif", folder / "stereo_dem.tif"
    heights, pixel_m = read(truth)
    # Near the pole the Sun is never high.
    azimuth, elevation, how = fitted_sun(read(image)[0], heights, pixel_m, range(2, 13, 2))
    scene = dict(name="m139939938le", kind="real pair", image=image, truth=truth, weak_truth=True, sun_azimuth_deg=azimuth,
                 sun_elevation_deg=elevation, high_pass_m=60,
                 remarks=f"The stereo DTM misses small craters and has terraces: look at long waves and at the correlation of hillshade "
                         f"and image only. Sun fitted (correlation {how:.2f}).")
    about = "A real image with a stereo DTM on its grid, near the south pole; coarse DTM averaged from the stereo DTM over 59 m."
    write(out, "nac", about, [scene])


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    data, out = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2])
    out.mkdir(parents=True, exist_ok=True)
    for name, make in [("independent_synthetic", independent_synthetic), ("stereolunar", stereolunar),
                       ("nac_apollo15", nac_apollo15), ("nac_m139939938le", nac_pair)]:
        if (data / name).is_dir():
            make(data / name, out)
        else:
            print(f"SKIPPED: {data / name}: not there")


main()
