"""Arrays and files are predicted as the program predicts files."""

import json
import pathlib

import numpy as np
import pytest

import elunardtm
from elunardtm import Model


@pytest.fixture(scope="module", params=["ground", "nano"])
def model(request):
    return request.param


def same(a, b):
    return a.dtype == b.dtype and a.tobytes() == b.tobytes()


def without_times(record):
    return {key: value for key, value in record.items() if key not in ("seconds", "phases", "image", "coarse", "output", "uncertainty")}


def test_heights_and_errors_are_those_of_the_program(model, scene, files, elunar, read, tmp_path):
    image, coarse, _ = files
    output, errors = tmp_path / "dtm.tif", tmp_path / "errors.tif"
    words = ["--image", image, "--coarse", coarse, "--model", model, "-o", output, "--fit-sun", "--json"]
    more = ["--uncertainty", errors] if model == "ground" else []
    record = elunar("predict", *words, *more)
    made = Model.load(model).predict(
        scene.image, scene.coarse, **scene.place, uncertainty=model == "ground", progress=False
    )
    voids = read(output) < -1e38
    heights = np.where(voids, np.float32(np.nan), read(output))
    assert made.heights.shape == (300, 340) and same(made.heights, heights) and (made.valid == ~voids).all()
    if model == "ground":
        assert same(np.where(voids, np.float32(np.nan), read(errors, 1)), made.sigma)
        assert same(np.where(voids, np.float32(np.nan), read(errors, 2)), made.slope_sigma)
        assert (read(errors, 3).astype("u1") == made.origin).all()
    else:
        assert made.sigma is None and made.origin is None
    assert without_times(json.loads(json.dumps(record))) == without_times(made.record)


def test_a_file_is_that_of_the_program(model, files, elunar, tmp_path):
    image, coarse, _ = files
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
    elunar("predict", "--image", image, "--coarse", coarse, "--model", model, "-o", tmp_path / "a/dtm.tif")
    made = Model.load(model).predict_file(image, coarse, tmp_path / "b/dtm.tif")
    assert made["output"].endswith("b/dtm.tif") and made["warnings"] == []
    for name in ("dtm.tif", "dtm.tif.sha256", "dtm_hillshade.png"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name
    assert Model.load(model).predict_file(image, coarse, tmp_path / "b/dtm.tif")["finished_before"]


def test_the_suns_angles_count(scene, files):
    rasterio = pytest.importorskip("rasterio")
    image, coarse, _ = files
    with rasterio.open(image) as file:
        tags = file.tags()
    assert abs(float(tags["SUN_AZIMUTH_DEG"]) - scene.sun_azimuth) < 0.01
    sun = {"sun_azimuth": float(tags["SUN_AZIMUTH_DEG"]), "sun_elevation": float(tags["SUN_ELEVATION_DEG"])}
    model = Model.load("ground")
    given = model.predict(scene.image, scene.coarse, **scene.place, **sun)
    stated, fitted = model.predict(image, coarse), model.predict(image, coarse, fit_sun=True)
    assert given.light.source == stated.light.source == "given" and fitted.light.source == "fitted"
    assert stated.light.azimuth_from_file and not given.light.azimuth_from_file
    assert same(given.heights, stated.heights) and not same(given.heights, fitted.heights)


def test_types_strides_masks_and_nodata(scene):
    model = Model.load("nano")
    cut = scene.image[:80, :90]
    place = {**scene.place, "threads": 1}
    expected = model.predict(cut, scene.coarse, **place).heights
    wide = np.zeros((80, 180), "u2")
    wide[:, ::2] = cut
    assert same(model.predict(wide[:, ::2], scene.coarse.astype("f8"), **place).heights, expected)
    holes = cut.copy()
    holes[3, 4] = 0
    void = model.predict(holes, scene.coarse, **place, image_nodata=0)
    assert not void.valid[3, 4] and void.valid.sum() == 80 * 90 - 1
    masked = model.predict(np.ma.masked_equal(holes, 0), scene.coarse, **place)
    assert same(masked.heights, void.heights)
    lists = model.predict(cut.astype("i4").tolist(), scene.coarse.tolist(), **place)
    assert same(lists.heights, expected)


def test_a_coarse_dtm_on_the_images_grid_needs_the_size_of_its_pixels(scene):
    model = Model.load("nano")
    image, truth = scene.image[:64, :64], scene.truth[:64, :64]
    with pytest.raises(elunardtm.UsageError, match="coarse_pixel_size"):
        model.predict(image, truth, pixel_size=2.0)
    with pytest.raises(elunardtm.UsageError, match="coarse_pixel_size: pixels of 2 m at least expected"):
        model.predict(image, truth, pixel_size=2.0, coarse_pixel_size=1.0)
    assert model.predict(image, truth, pixel_size=2.0, coarse_pixel_size=60.0).valid.all()


def test_models_are_shipped_or_files(tmp_path):
    assert Model.load("ground").description != Model.load("nano").description
    bad = tmp_path / "bad.eld"
    bad.write_bytes(b"no model")
    for path, kind in [(tmp_path / "absent.eld", elunardtm.InputError), (bad, elunardtm.InputError)]:
        with pytest.raises(kind, match=path.name):
            Model.load(path)
    shipped = pathlib.Path(__file__).parents[2] / "models" / "nano.eld"
    assert Model.load(shipped).description == Model.load("nano").description


def test_errors_are_the_one_line_of_the_program(scene, tmp_path):
    model = Model.load("nano")
    cases = [
        (elunardtm.UsageError, {"sun_azimuth": 700}, "--sun-azimuth"),
        (elunardtm.UsageError, {"overlap": 4000}, "overlap"),
        (elunardtm.UsageError, {"crs": "EPSG:nonsense"}, "image: crs:"),
        (elunardtm.UsageError, {"threads": 5000}, "a number from 0 to 1024 expected"),
        (elunardtm.UsageError, {"coarse_sigma": 3.0}, "--uncertainty"),
        (elunardtm.UsageError, {"tracks": ["a.csv", "b.csv"]}, "--uncertainty"),
        (elunardtm.InputError, {"tracks": "absent.csv", "uncertainty": True}, "absent.csv"),
        (elunardtm.InputError, {"coarse_transform": (60, 0, 9e6, 0, -60, 0)}, "none found"),
    ]
    for kind, more, text in cases:
        with pytest.raises(kind) as raised:
            model.predict(scene.image, scene.coarse, **{**scene.place, **more})
        assert text in str(raised.value) and "\n" not in str(raised.value), raised.value
        assert isinstance(raised.value, (elunardtm.Error, ValueError))
    with pytest.raises(elunardtm.UsageError, match=r"shape \(2, 2, 2\)"):
        model.predict(np.zeros((2, 2, 2)), scene.coarse, **scene.place)
    with pytest.raises(elunardtm.InputError, match="absent.tif"):
        model.predict_file(tmp_path / "absent.tif", tmp_path / "c.tif", tmp_path / "o.tif")


def test_what_is_doubtful_is_a_warning(scene):
    with pytest.warns(elunardtm.Warning) as caught:
        made = Model.load("ground").predict(scene.image, scene.coarse + 1e6, **scene.place)
    assert made.warnings and [str(one.message) for one in caught] == made.warnings
