"""The standard deviation of a mean height is that of means of simulated errors, and that of the scripts' own form."""

import runpy
from pathlib import Path

import numpy as np
import pytest

import elunardtm
from elunardtm import Model, _native

PIXEL_M, COARSE_PIXEL_M, COARSE_SIGMA_M = 20.0, 60.0, 3.0


def fields(shape, length_m, number, random):
    """Gaussian fields with a covariance of exp(-distance / length), by the square root of its matrix."""
    places = PIXEL_M * np.argwhere(np.ones(shape))
    apart = np.hypot(*(places[:, None] - places).transpose(2, 0, 1))
    root = np.linalg.cholesky(np.exp(-apart / length_m) + 1e-9 * np.eye(len(places)))
    return (root @ random.standard_normal((len(places), number))).T.reshape(number, *shape)


def disc(shape, row, col, radius):
    rows, cols = np.ogrid[: shape[0], : shape[1]]
    return np.hypot(rows - row, cols - col) <= radius


@pytest.mark.parametrize("length_m", [30.0, 200.0, 1500.0])
def test_means_of_simulated_errors_have_it(length_m):
    in_numpy = runpy.run_path(str(Path(__file__).parents[2] / "suites/means.py"))["sigma_of_mean"]
    random, shape, number = np.random.default_rng(5), (24, 30), 4000
    image_sd = 0.5 + 2 * random.random(shape)
    errors = COARSE_SIGMA_M * fields(shape, length_m, number, random)
    errors += image_sd * fields(shape, COARSE_PIXEL_M, number, random)
    scattered = disc(shape, 12, 12, 10) & (random.random(shape) < 0.4)
    for where in (disc(shape, 5, 6, 0), disc(shape, 12, 9, 4), disc(shape, 11, 15, 11), scattered):
        sigma, sizes = np.hypot(image_sd, COARSE_SIGMA_M).astype("f4"), (PIXEL_M, COARSE_PIXEL_M)
        stated = _native.sigma_of_mean(sigma, where, sizes, (COARSE_SIGMA_M, length_m))
        assert stated == pytest.approx(in_numpy(sigma, where, *sizes, COARSE_SIGMA_M, length_m), rel=1e-9)
        # Four standard deviations of that of 4,000 means.
        assert abs(errors[:, where].mean(1).std() / stated - 1) < 4 / np.sqrt(2 * number)


def test_a_prediction_gives_a_mean_with_its_standard_deviation(scene):
    model = Model.load("ground")
    made = model.predict(scene.image, scene.coarse, **scene.place, uncertainty=True)
    assert made.record["uncertainty"]["coarse_correlation_from"] == "assumed"
    coarse_px, pixel_m = made.record["coarse_px"], made.record["pixel_m"]
    assert made.record["uncertainty"]["coarse_correlation_m"] == pytest.approx(9 * coarse_px * pixel_m)
    where = disc(made.heights.shape, 100, 120, 60)
    height, sigma = made.mean_height(where)
    assert height == pytest.approx(made.heights[where].mean(dtype="f8"))
    one, sure = made.mean_height(disc(made.heights.shape, 100, 120, 0))
    assert one == made.heights[100, 120] and sure == pytest.approx(made.sigma[100, 120])
    # 240 m of 530 m over which coarse errors are alike: the image's errors are averaged out, the coarse DTM's are not.
    assert 0.8 < sigma / made.record["uncertainty"]["coarse_sigma_m"] < 1
    with pytest.raises(elunardtm.UsageError, match="bool of shape"):
        made.mean_height(where[:50])
    with pytest.raises(elunardtm.UsageError, match="none found"):
        made.mean_height(np.zeros_like(where))
    with pytest.raises(elunardtm.UsageError, match="with uncertainty expected"):
        model.predict(scene.image, scene.coarse, **scene.place).mean_height(where)


def test_datasets_have_the_means_of_arrays(scene, files):
    rasterio = pytest.importorskip("rasterio")
    model, where = Model.load("ground"), disc(scene.image.shape, 100, 120, 60)
    with rasterio.open(files[0]) as image, rasterio.open(files[1]) as coarse:
        made = model.predict(image, coarse, fit_sun=True, uncertainty=True)
    arrays = model.predict(scene.image, scene.coarse, **scene.place, uncertainty=True)
    assert made.mean_height(where) == pytest.approx(arrays.mean_height(where), rel=1e-6)
