#!/usr/bin/env python3
"""Lists of test scenes from a folder of independent data, for `host-train suite --suite LIST.toml`.

    host-train/suites/external.py DATA OUT

DATA holds any of the folders independent_synthetic, stereolunar, nac_apollo15, nac_m139939938le and real; for each that is there a list
is written into OUT (and, for the Apollo 15 crop and the real pairs, GeoTIFFs); the others are named as skipped. Needs numpy and rasterio. Where the
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
    noise(out, truth, padded)


def noise(out, truth, heights):
    """The crop under one Sun, with noise and albedo of known spectra in its image."""
    azimuth, elevation = 300, 25
    clean = lambert(heights, 2, azimuth, elevation)
    contrast, scenes = clean.std() / clean.mean(), []
    with rasterio.open(truth) as file:
        place, crs = file.transform, file.crs
    for number, (noisy, patchy) in enumerate([(0, 0), (0.01, 0), (0.03, 0), (0.1, 0), (0, 0.5), (0, 1), (0.03, 0.5)]):
        name = f"apollo15-noise{noisy}-albedo{patchy}"
        white = np.random.default_rng(number).standard_normal(clean.shape)
        image = clean * (1 + patchy * contrast * albedo(clean.shape, number)) + noisy * clean.mean() * white
        scenes.append(dict(name=name, kind="noise", truth=truth, image=save(out.resolve() / f"{name}_image.tif", image, place, crs),
                           sun_azimuth_deg=azimuth, sun_elevation_deg=elevation))
    about = ("The crop of the Apollo 15 DTM under one Sun, with white noise (of the mean) and with albedo without a direction (of the relief's "
             "contrast) in its image. Waves of 2 to 4 pixels are 4 to 8 m long.")
    write(out, "noise", about, scenes)



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


# Real images with a DTM: image, truth, pixels of the image that are averaged to one, side of the coarse DTM's pixel in these.
REAL = {
    "moon_aristarchus_cp_wac": ("image_iof_214m.tif", "truth_dtm_214m.tif", 1, 20),
    "mars_noctis_hirise": ("image_17.5m.tif", "truth_dtm_17.5m_scale_guessed.tif", 1, 20),
    "mars_cerberus_hirise": ("image_scale_guessed.tif", "truth_dtm_scale_guessed.tif", 1, 20),
    "mars_gale_hirise_1m": ("image_1m.tif", "truth_dtm_1m.tif", 2, 25),
    "mars_candor_hirise": ("image_42.26m.tif", "truth_dtm_42.26m_height_scale_guessed.tif", 1, 20),
    "mars_gale_hrsc": ("image_333m.tif", "truth_dtm_667m.tif", 2, 20),
}
# True sides of pixels, metres, where the files state others.
PIXELS_M = {"mars_cerberus_hirise": 35.85}
# Sets whose image has 0 where it is void.
ZERO_IS_VOID = ("mars_candor_hirise", "mars_gale_hrsc")
# Azimuths of the light that the truths show: the fit of the light (`predict`) with the truth in place of the coarse DTM. Windows of the pole's
# mosaic have no single one.
AZIMUTHS = {"moon_aristarchus_cp_wac": 256, "mars_noctis_hirise": 308, "mars_cerberus_hirise": 297, "mars_gale_hirise_1m": 319,
            "mars_candor_hirise": 303, "mars_gale_hrsc": 280}
# Windows of the image of the Moon's north pole, each under one Sun: first row and column.
POLE = "moon_wac_lola_north_pole", "image_1600m.tif", "truth_dtm_1600m.tif", 20
WINDOWS, SIDE = [(0, 0), (127, 508), (508, 127), (508, 508)], 254
# Stereo and altimetry resolve less than their pixel. Truth and DTMs are compared after a Gaussian of 2 pixels, which halves these waves.
RESOLUTION_PX = 2 / 0.18739
NODATA = -3.4028226550889045e38


def means(map_, side, least):
    """Means over squares, NaN where less than a share `least` of a square is valid."""
    rows, cols = (n // side for n in map_.shape)
    squares = map_[: rows * side, : cols * side].reshape(rows, side, cols, side)
    valid = np.isfinite(squares)
    sums, counts = np.where(valid, squares, 0).sum((1, 3)), valid.sum((1, 3))
    return np.where(counts >= least * side * side, sums / np.maximum(counts, 1), np.nan)


def filled(map_):
    """Gaps take the value of the nearest valid sample."""
    gaps, (rows, cols) = ~np.isfinite(map_), np.indices(map_.shape)
    at = np.argwhere(~gaps)
    out = map_.copy()
    for row, col in np.argwhere(gaps):
        near = at[((at - (row, col)) ** 2).sum(1).argmin()]
        out[row, col] = map_[tuple(near)]
    return out


def save(path, map_, transform, crs):
    with rasterio.open(path, "w", driver="GTiff", height=map_.shape[0], width=map_.shape[1], count=1, dtype="float32", crs=crs,
                       transform=transform, nodata=NODATA) as file:
        file.write(np.where(np.isfinite(map_), map_, NODATA).astype("f4"), 1)
    return path


def with_azimuths(scenes):
    return [scene | {"sun_azimuth_deg": AZIMUTHS[scene["name"]]} if scene["name"] in AZIMUTHS else scene for scene in scenes]


def real_scene(out, name, kind, image, truth, places, crs, coarse_px):
    """Writes a scene, its coarse DTM averaged from the truth. `places`: transforms of image and truth."""
    out = out.resolve()
    of_image, of_truth = places
    side = max(1, round(coarse_px * of_image.a / of_truth.a))
    coarse = filled(means(truth, side, 0.3))
    return dict(name=name, kind=kind, image=save(out / f"{name}_image.tif", image, of_image, crs),
                coarse=save(out / f"{name}_coarse.tif", coarse, of_truth * rasterio.Affine.scale(side), crs),
                truth=save(out / f"{name}_truth.tif", truth, of_truth, crs), truth_resolution_m=RESOLUTION_PX * abs(of_truth.a))


def real(folder, out):
    def opened(path):
        with rasterio.open(path) as file:
            return file.read(1, masked=True).astype("f8").filled(np.nan), file.transform, file.crs

    scenes, moon = [], rasterio.crs.CRS.from_proj4(MOON)
    for name, (image, truth, shrink, coarse_px) in REAL.items():
        if (folder / name).is_dir():
            (image, of_image, crs), (truth, of_truth, other) = opened(folder / name / image), opened(folder / name / truth)
            if name in ZERO_IS_VOID:
                image[image == 0] = np.nan
            if name in PIXELS_M:
                scale = rasterio.Affine.scale(PIXELS_M[name] / abs(of_image.a))
                of_image, of_truth = of_image * scale, of_truth * scale
            places = of_image * rasterio.Affine.scale(shrink), of_truth
            scenes.append(real_scene(out, name, name.split("_")[0].title(), means(image, shrink, 0.5), truth, places, crs or other or moon,
                                     coarse_px))
        else:
            print(f"SKIPPED: {folder / name}: not there")
    name, image, truth, coarse_px = POLE
    if (folder / name).is_dir():
        (image, of_image, crs), (truth, of_truth, _) = opened(folder / name / image), opened(folder / name / truth)
        for number, (row, col) in enumerate(WINDOWS):
            window = np.s_[row:row + SIDE, col:col + SIDE]
            places = [place * rasterio.Affine.translation(col, row) for place in (of_image, of_truth)]
            scenes.append(real_scene(out, f"north_pole_{number}", "Moon, north pole", image[window], truth[window], places, crs or moon,
                                     coarse_px))
    else:
        print(f"SKIPPED: {folder / name}: not there")
    about = ("Real images with DTMs of stereo or altimetry; the Sun is not told. The coarse DTM is the truth averaged over 20 or 25 pixels of "
             "the image, without error. Truth and DTMs are compared after a Gaussian of 2 pixels of the truth. Heights of Noctis, "
             "Cerberus and Candor have a guessed scale: only ratios count.")
    write(out, "real", about, scenes)
    told = about.replace("the Sun is not told", "the azimuth is told where there is one, fitted to the truth")
    write(out, "real-azimuth", told, with_azimuths(scenes))
    erring(out, scenes)
    unrelated(out, scenes)
    variants(out, scenes)


# Errors of a coarse DTM in metres where its pixel has 59 m, as SLDEM2015 has them (`host-train/synth/src/coarse.rs`): long waves, and tracks with a
# step. Greatest misregistration in pixels.
SLDEM_PIXEL_M, LONG_WAVES_M, STRIPES_M, MISREGISTRATION_PX = 59.2, 2.6, 1.5, 0.25


def sldem_errors(shape, random):
    """A map of errors for a coarse DTM of this shape, for pixels of 59 m."""
    rows, cols = np.indices(shape)
    errors = np.zeros(shape)
    for _ in range(24):
        wave_px = 13.5 * (84.4 / 13.5) ** random.random()
        angle, phase = 2 * np.pi * random.random(2)
        along = rows * np.sin(angle) + cols * np.cos(angle)
        errors += LONG_WAVES_M * np.sqrt(2 / 24) * random.standard_normal() * np.cos(2 * np.pi * along / wave_px + phase)
    lean = 0.15 * (2 * random.random() - 1)
    number = (cols + lean * rows + max(0, -lean) * shape[0]).astype(int)
    off = random.random(number.max() + 1) < 0.3
    errors += STRIPES_M * np.sqrt(0.5 / 0.3) * (off * random.standard_normal(off.size))[number]
    angle, (row, col) = 2 * np.pi * random.random(), (0.25 + 0.5 * random.random(2)) * shape
    side = np.sign((rows - row) * np.sin(angle) + (cols - col) * np.cos(angle))
    return errors + STRIPES_M * np.sqrt(0.5) * random.standard_normal() * side


def erring(out, real):
    """The real scenes with coarse DTMs that have errors of SLDEM2015's kind, in proportion to their pixels."""
    out, scenes = out.resolve(), []
    for seed, scene in enumerate(real):
        random = np.random.default_rng(seed)
        with rasterio.open(scene["coarse"]) as file:
            coarse, place, crs = file.read(1).astype("f8"), file.transform, file.crs
        coarse += sldem_errors(coarse.shape, random) * abs(place.a) / SLDEM_PIXEL_M
        far, angle = MISREGISTRATION_PX * np.sqrt(random.random()), 2 * np.pi * random.random()
        moved = place * rasterio.Affine.translation(far * np.cos(angle), far * np.sin(angle))
        scenes.append({**scene, "coarse": save(out / f"{scene['name']}-erring_coarse.tif", coarse, moved, crs)})
    about = (f"The real scenes; their coarse DTMs have errors of {LONG_WAVES_M} m in waves of 13.5 to 84.4 pixels and of {STRIPES_M} m in tracks "
             f"and a step, for pixels of 59 m and in proportion for others, and are misregistered by up to {MISREGISTRATION_PX} pixels. Seeds: "
             "numbers of the scenes. The Sun is not told.")
    write(out, "real-erring", about, scenes)
    told = about.replace("The Sun is not told", "The azimuth is told where there is one")
    write(out, "real-erring-azimuth", told, with_azimuths(scenes))


def maps_of(scene):
    """Image and truth of a scene that was written, their transforms and CRS."""
    maps = {}
    for what in ("image", "truth"):
        with rasterio.open(scene[what]) as file:
            maps[what] = file.read(1, masked=True).astype("f8").filled(np.nan), file.transform, file.crs
    return maps["image"], maps["truth"]


def albedo(shape, seed):
    """A map without a direction, its power falling with the square of the frequency; mean 0, standard deviation 1."""
    frequency = np.hypot(*np.meshgrid(*map(np.fft.fftfreq, shape), indexing="ij"))
    frequency[0, 0] = np.inf
    map_ = np.fft.ifft2(np.fft.fft2(np.random.default_rng(seed).standard_normal(shape)) / frequency).real
    return map_ / map_.std()


def variants(out, real):
    """The real scenes with coarser images, with other coarse DTMs, and with albedo added."""
    scenes = []
    for number, scene in enumerate(real):
        (image, of_image, crs), (truth, of_truth, _) = maps_of(scene)

        def add(name, kind, map_, shrink, coarse_px):
            places = of_image * rasterio.Affine.scale(shrink), of_truth
            if min(map_.shape) >= 5 * coarse_px:
                made = real_scene(out, f"{scene['name']}-{name}", kind, map_, truth, places, crs, coarse_px)
                azimuth = {"sun_azimuth_deg": AZIMUTHS[scene["name"]]} if scene["name"] in AZIMUTHS else {}
                scenes.append(made | azimuth | {"truth_resolution_m": max(made["truth_resolution_m"], RESOLUTION_PX * abs(places[0].a))})

        for shrink in (2, 4):
            for coarse_px in (8, 20):
                add(f"{shrink}x-{coarse_px}", "coarser", means(image, shrink, 0.5), shrink, coarse_px)
        for times in (0.5, 1.0):
            contrast = np.nanstd(image) / np.nanmean(image)
            add(f"albedo-{times}", "albedo", image * (1 + times * contrast * albedo(image.shape, number)), 1, 20)
    about = "The real scenes with images 2 and 4 times coarser and coarse pixels of 8 and 20 of theirs, or with albedo added that has 0.5 and 1 of the contrast."
    write(out, "variants", about + " The azimuth is told where there is one.", scenes)


def unrelated(out, real):
    """Coarse DTMs of the real scenes under images of other ground: their own image mirrored, and those of the other scenes."""
    out, scenes = out.resolve(), []
    opened = {}
    for scene in real:
        opened[scene["name"]] = maps_of(scene)[0]
    for scene in real:
        image, transform, crs = opened[scene["name"]]
        images = {"down": image[::-1], "across": image[:, ::-1], "both": image[::-1, ::-1]}
        for other, (map_, *_) in opened.items():
            if other != scene["name"]:
                beyond = [(0, max(0, wanted - found)) for wanted, found in zip(image.shape, map_.shape)]
                images[other] = np.pad(map_, beyond, mode="symmetric")[: image.shape[0], : image.shape[1]]
        for how, map_ in images.items():
            name = f"{scene['name']}-{how}"
            scenes.append({**scene, "name": name, "kind": scene["name"], "image": save(out / f"{name}_image.tif", map_, transform, crs)})
    about = "The real scenes under images of other ground: what a method adds is wrong."
    write(out, "unrelated", about, scenes)
    told = [scene | {"sun_azimuth_deg": AZIMUTHS[scene["kind"]]} for scene in scenes if scene["kind"] in AZIMUTHS]
    write(out, "unrelated-azimuth", about + " The azimuth of the right image is told.", told)


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    data, out = pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2])
    out.mkdir(parents=True, exist_ok=True)
    for name, make in [("independent_synthetic", independent_synthetic), ("stereolunar", stereolunar),
                       ("nac_apollo15", nac_apollo15), ("nac_m139939938le", nac_pair), ("real", real)]:
        if (data / name).is_dir():
            make(data / name, out)
        else:
            print(f"SKIPPED: {data / name}: not there")


if __name__ == "__main__":
    main()
