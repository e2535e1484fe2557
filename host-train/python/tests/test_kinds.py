"""Datasets of rasterio and DataArrays of xarray bring their place, and results are of their kind."""

import numpy as np
import pytest

import elunardtm
from elunardtm import Model

rasterio = pytest.importorskip("rasterio")
CRS = "+proj=eqc +lat_ts=0 +lon_0=0 +R=1737400 +units=m +no_defs"


@pytest.fixture(scope="module")
def expected(files, tmp_path_factory):
    image, coarse, _ = files
    output = tmp_path_factory.mktemp("out") / "dtm.tif"
    # Arrays cannot state the Sun, as these files do.
    Model.load("nano").predict_file(image, coarse, output, fit_sun=True)
    with rasterio.open(output) as file:
        return file.read(1), file.transform, file.crs


def test_rasterio(files, expected):
    heights, transform, crs = expected
    with rasterio.open(files[0]) as image, rasterio.open(files[1]) as coarse:
        made = Model.load("nano").predict(image, coarse, fit_sun=True)
        stated = Model.load("nano").predict(image, coarse)
        shade = elunardtm.hillshade(image)
    assert made.heights.read(1).tobytes() == heights.tobytes()
    assert made.heights.transform == transform and made.heights.crs == crs and made.heights.units == ("m",)
    assert np.isnan(made.heights.nodata) and shade.dtypes == ("uint8",) and shade.nodata == 0
    assert stated.light.azimuth_from_file and stated.light.source == "given"
    assert made.crs == crs and made.transform == tuple(transform)[:6]


def test_rioxarray(files, expected):
    rioxarray = pytest.importorskip("rioxarray")
    heights, transform, crs = expected
    image, coarse = (rioxarray.open_rasterio(path) for path in files[:2])
    made = Model.load("nano").predict(image, coarse, fit_sun=True).heights
    assert Model.load("nano").predict(image, coarse).light.azimuth_from_file
    assert made.values.tobytes() == heights.tobytes() and made.dims == ("y", "x")
    assert made.rio.transform() == transform and made.rio.crs == crs and made.attrs == {"units": "m"}
    assert (made.x.values == image.x.values).all()
    joined = elunardtm.mosaic([made, made.isel(x=slice(0, 100))], tr=4.0)
    assert joined.rio.transform().a == 4.0 and joined.rio.crs == crs and joined.shape == (150, 170)
    found = elunardtm.evaluate(made, rioxarray.open_rasterio(files[2]), coarse)
    assert [one["name"] for one in found["candidates"]] == ["dtm", "coarse"]


def test_xarray_without_a_place_takes_the_arguments(scene, expected):
    xarray = pytest.importorskip("xarray")
    image = xarray.DataArray(scene.image, dims=("y", "x"))
    made = Model.load("nano").predict(image, scene.coarse, **scene.place, crs=CRS)
    assert isinstance(made.heights, xarray.DataArray) and made.heights.values.tobytes() == expected[0].tobytes()


def test_a_georeference_changes_no_height(scene, expected):
    plane = Model.load("nano").predict(scene.image, scene.coarse, **scene.place)
    on_moon = Model.load("nano").predict(scene.image, scene.coarse, **scene.place, crs=CRS)
    affine = Model.load("nano").predict(
        scene.image, scene.coarse, transform=rasterio.Affine(*scene.transform), coarse_transform=scene.coarse_transform
    )
    assert plane.heights.tobytes() == on_moon.heights.tobytes() == affine.heights.tobytes() == expected[0].tobytes()
