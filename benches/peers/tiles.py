"""Synthetic tiles as the network takes them: fractal terrain, seen under a Sun in the north-west."""
import numpy as np
import torch
import torch.nn.functional as F

ROWS, COLS = 256, 320
COARSE_PX = 32  # pixels per side of a coarse one
PIXEL_M = 2.0
SLOPE = np.tan(np.radians(8))  # mean of the terrain
SUN_ELEVATION = np.radians(35)
SLOPE_UNIT, LIMIT = 0.1, 10.0  # of a guide's maps


def terrain(random):
    """Heights in metres, [ROWS, COLS], cut from a field twice as large, which is periodic."""
    f = np.hypot(np.fft.fftfreq(2 * ROWS)[:, None], np.fft.rfftfreq(2 * COLS))
    f[0, 0] = 1
    spectrum = (random.standard_normal(f.shape) + 1j * random.standard_normal(f.shape)) * f**-1.9
    spectrum[0, 0] = 0
    z = np.fft.irfft2(spectrum, s=(2 * ROWS, 2 * COLS))[:ROWS, :COLS]
    return z * SLOPE / np.hypot(*np.gradient(z, PIXEL_M)).mean()


def shade(z):
    """Lambert's law; rows run south, columns east."""
    south, east = np.gradient(z, PIXEL_M)
    sun = np.cos(SUN_ELEVATION) * (south + east) / np.sqrt(2)
    return np.clip((np.sin(SUN_ELEVATION) + sun) / np.sqrt(1 + south**2 + east**2), 0, None)


def tile(seed, config):
    """Image [1, maps, ROWS, COLS] and coarse DTM [1, 1, ROWS, COLS], f32, normalised as `config` wants it."""
    z = terrain(np.random.default_rng(seed))
    image = shade(z)
    if config.get("illumination") in ("given", "weighed"):
        # The smallest slope that explains the contrast, its two components alike: the Sun stands in the north-west. The relief
        # is the true one, of which photoclinometry finds most.
        slope = (image / image.mean() - 1) * np.tan(SUN_ELEVATION) / np.sqrt(2) / SLOPE_UNIT
        low = F.avg_pool2d(torch.from_numpy(z)[None, None], COARSE_PX)
        low = F.interpolate(low, size=(ROWS, COLS), mode="bicubic", align_corners=False)[0, 0].numpy()
        relief = (z - low) / PIXEL_M
        image = np.stack([slope, slope, relief, np.full_like(z, np.tan(SUN_ELEVATION))]).clip(-LIMIT, LIMIT)
    else:
        image = ((image - image.min()) / np.ptp(image))[None]
    coarse = F.avg_pool2d(torch.from_numpy(z)[None, None], COARSE_PX)
    coarse = F.interpolate(coarse, size=(ROWS, COLS), mode="bicubic", align_corners=False).numpy()
    if config.get("target_range") == "pixel":
        coarse = (coarse - coarse.mean()) / PIXEL_M
    else:
        margin = config.get("range_margin", 0.0)
        coarse = config.get("nr", 50.0) * ((coarse - coarse.min()) / np.ptp(coarse) + margin) / (1 + 2 * margin)
    return image[None].astype(np.float32), coarse.astype(np.float32)
