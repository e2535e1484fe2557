"""The other functions give what the commands give, and know their options."""

import inspect
import json

import numpy as np
import pytest

import elunardtm
from elunardtm import _native


def test_files_are_those_of_the_program(scene, files, elunar, tmp_path):
    truth = files[2]
    sun = ["--sun-azimuth", 300, "--sun-elevation", 20]
    kinds = {"sun_azimuth": 300, "sun_elevation": 20}
    for a, b in (("ha.tif", "hb.tif"), ("ha.png", "hb.png")):
        elunar("hillshade", truth, "-o", tmp_path / a, *sun)
        assert elunardtm.hillshade(truth, tmp_path / b, **kinds) is None
        assert (tmp_path / a).read_bytes() == (tmp_path / b).read_bytes()
    elunar("render", truth, "-o", tmp_path / "ra.tif", *sun, "--seed", 4)
    elunardtm.render(truth, tmp_path / "rb.tif", **kinds, seed=4)
    elunar("mosaic", truth, truth, "-o", tmp_path / "ma.tif", "--tr", 4)
    elunardtm.mosaic([truth, truth], tmp_path / "mb.tif", tr=4)
    elunar("diff", truth, files[1], "-o", tmp_path / "da.tif")
    elunardtm.diff(truth, files[1], tmp_path / "db.tif")
    for name in ("r", "m", "d"):
        assert (tmp_path / f"{name}a.tif").read_bytes() == (tmp_path / f"{name}b.tif").read_bytes(), name


def test_arrays_are_as_files(scene, files, read, tmp_path):
    truth, place = files[2], {"transform": scene.transform}
    elunardtm.hillshade(truth, tmp_path / "h.tif")
    assert (elunardtm.hillshade(scene.truth, **place) == read(tmp_path / "h.tif")).all()
    elunardtm.render(truth, tmp_path / "r.tif", sun_azimuth=300, sun_elevation=20)
    assert (elunardtm.render(scene.truth, **place, sun_azimuth=300, sun_elevation=20) == read(tmp_path / "r.tif")).all()
    elunardtm.mosaic([truth, files[1]], tmp_path / "m.tif")
    heights, transform = elunardtm.mosaic([scene.truth, scene.coarse], transforms=[scene.transform, scene.coarse_transform])
    expected = read(tmp_path / "m.tif")
    assert np.array_equal(heights, np.where(expected < -1e38, np.nan, expected), equal_nan=True)
    assert heights.shape == expected.shape and transform[0] == 2.0


def test_figures_are_those_of_the_program(scene, files, elunar, tmp_path):
    image, coarse, truth = files
    expected = elunar("evaluate", "--dtm", coarse, "--truth", truth, "--json")
    found = elunardtm.evaluate(scene.coarse, scene.truth, transform=scene.coarse_transform)
    assert elunardtm.evaluate(coarse, truth) == expected and found is not None
    assert elunardtm.diff(coarse, truth)[1] == elunar("diff", coarse, truth, "--json")
    sun = {"sun_azimuth": scene.sun_azimuth, "sun_elevation": scene.sun_elevation}
    heights, _ = elunardtm.sfs(scene.image, scene.coarse, **scene.place, **sun)
    nothing, record = elunardtm.sfs(image, coarse, tmp_path / "sfs.tif")
    assert nothing is None and record["settings"]
    difference, statistics = elunardtm.diff(heights, truth, transform=scene.transform)
    assert difference.shape == heights.shape and statistics["pixels"] == heights.size


def test_every_option_of_a_command_has_its_argument():
    # Files, outputs and what Python has otherwise.
    elsewhere = {
        "help", "json", "model", "part", "image_sha256", "coarse_sha256", "dem_list", "curve", "truth", "input", "dems",
        "first", "second", "image_srs", "coarse_srs", "quiet", "verbose", "progress",
    }  # fmt: skip
    other_names = {"azimuth": "sun_azimuth", "altitude": "sun_elevation"}
    functions = {
        "predict": elunardtm.Model.predict_file, "evaluate": elunardtm.evaluate, "hillshade": elunardtm.hillshade,
        "diff": elunardtm.diff, "mosaic": elunardtm.mosaic, "sfs": elunardtm.sfs, "lola": elunardtm.lola,
        "render": elunardtm.render,
    }  # fmt: skip
    for command, function in functions.items():
        options = {other_names.get(name, name) for name in _native.options(command)} - elsewhere
        assert options, command
        assert options <= set(inspect.signature(function).parameters), command


def test_wrong_options_are_refused(scene):
    for call, text in [
        (lambda: elunardtm.hillshade(scene.truth, pixel_size=2.0, sun_elevation=95), "--altitude: 0 to 90 degrees expected"),
        (lambda: elunardtm.hillshade(scene.truth), "pixel_size, of an array expected"),
        (lambda: elunardtm.mosaic([scene.truth], transforms=[]), "one for each of 1 DTMs"),
        (lambda: elunardtm.mosaic([]), "required"),
        (lambda: elunardtm.render(scene.truth, pixel_size=2.0, sun_azimuth=0, sun_elevation=1), "2 to 90"),
        (lambda: elunardtm.sfs(scene.image, scene.coarse, **scene.place), "--sun-azimuth expected"),
        (lambda: elunardtm.hillshade(scene.truth, transform=(1, 2)), "six numbers"),
    ]:
        with pytest.raises(elunardtm.UsageError, match=text.replace("(", r"\(")):
            call()


def test_records_are_objects_of_json(scene):
    made = elunardtm.Model.load("nano").predict(scene.image, scene.coarse, **scene.place)
    assert json.loads(json.dumps(made.record)) == made.record


def test_the_sun_from_a_time(scene):
    from datetime import datetime, timedelta, timezone

    there = elunardtm.sun_position("2009-08-30T12:00:00", 3.63, 26.13)
    moment = datetime(2009, 8, 30, 14, tzinfo=timezone(timedelta(hours=2)))
    assert elunardtm.sun_position(moment, 3.63, 26.13) == there
    assert abs(there.azimuth - 107.71) < 0.02 and abs(there.elevation - 29.92) < 0.02
    assert elunardtm.sun_position(moment, 3.63, 26.13, body="mars") != there
    with pytest.raises(elunardtm.UsageError, match="a moment in UTC"):
        elunardtm.sun_position("noon", 0, 0)
    place = scene.place
    made = elunardtm.Model.load("nano").predict(scene.image, scene.coarse, **place, time="2009-08-30T12:00:00")
    assert made.record["light"]["azimuth_from_time"] is True
