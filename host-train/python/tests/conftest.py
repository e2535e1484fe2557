"""What all tests share: a small scene, its files, and the program `elunar` of the same checkout ($ELUNAR, or a built one)."""

import json
import os
import pathlib
import subprocess

import pytest

import elunardtm

REPOSITORY = pathlib.Path(__file__).parents[3]


def program() -> str | None:
    built = [os.environ.get("ELUNAR", "")] + [str(REPOSITORY / "target" / kind / "elunar") for kind in ("release", "debug")]
    return next((path for path in built if path and os.access(path, os.X_OK)), None)


@pytest.fixture(scope="session")
def scene() -> elunardtm.Example:
    return elunardtm.example(300, 340, 7)


@pytest.fixture(scope="session")
def files(scene, tmp_path_factory):
    return scene.write(tmp_path_factory.mktemp("scene"))


@pytest.fixture(scope="session")
def elunar():
    """Runs `elunar` and returns its JSON, or None."""
    path = program()
    if path is None:
        if os.environ.get("ELUNAR_REQUIRE_ORACLES"):
            pytest.fail("elunar is not built (cargo build -p elunar)")
        pytest.skip("elunar is not built (cargo build -p elunar)")

    def run(*words):
        made = subprocess.run([path, *map(str, words)], capture_output=True, text=True)
        assert made.returncode == 0, made.stderr
        return json.loads(made.stdout) if "--json" in words else None

    return run


@pytest.fixture(scope="session")
def read():
    """Reads a band of a file."""
    rasterio = pytest.importorskip("rasterio")

    def of(path, band=1):
        with rasterio.open(path) as file:
            return file.read(band)

    return of
