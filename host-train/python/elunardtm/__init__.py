"""Terrain models of the Moon from one orbiter image and a coarse DTM.

    import elunardtm
    model = elunardtm.Model.load("ground")
    prediction = model.predict(image, coarse, transform=transform, crs="IAU_2015:30110", coarse_transform=coarse_transform)

Arrays have the shape (rows, columns), rows from north to south. Heights are metres above the sphere. NaN, masked samples and ``nodata`` are void.
A place is ``transform``, an ``affine.Affine`` or its six numbers, and ``crs``, a text such as ``IAU_2015:30110``, PROJ or WKT, or an object of
rasterio or pyproj; or ``pixel_size`` alone, metres. Datasets of rasterio and DataArrays of xarray bring theirs, and results are of their kind.
Paths of GeoTIFF and PDS3 files serve as well.

Calls release the interpreter's lock. Ctrl-C, and an exception of the ``progress`` function, stop a call. Options have the names, defaults and rules
of the program ``elunar``; the heights are the same, byte for byte.
"""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import _grids, _native, _progress
from ._errors import Error, InputError, TryAgainError, UsageError, Warning
from ._grids import Affine, Grid, Path, Place
from ._progress import Progress

__version__ = _native.__version__
__all__ = [
    "Error", "Example", "InputError", "Light", "Model", "Prediction", "SunDirection", "TryAgainError", "UsageError", "Warning",
    "diff", "evaluate", "example", "hillshade", "lola", "mosaic", "render", "sfs", "sun_position",
]  # fmt: skip

#: Where results in memory are, for the native part, which names its outputs. Nothing is written there.
_NOWHERE = "memory.tif"


def _words(options: dict[str, Any]) -> list[str]:
    """Returns options as words of the command line; those that are None or False are left out."""
    words = []
    for name, value in options.items():
        option = "--" + name.replace("_", "-")
        if value is True:
            words.append(option)
        elif isinstance(value, (list, tuple)):
            words += [f"{option}={os.fspath(item) if isinstance(item, os.PathLike) else item}" for item in value]
        elif value is not None and value is not False:
            words.append(f"{option}={os.fspath(value) if isinstance(value, os.PathLike) else value}")
    return words


def _utc(time: Any) -> str | None:
    """Returns a time as a text in UTC; a datetime without a zone is in UTC."""
    if not isinstance(time, datetime):
        return None if time is None else str(time)
    return time.astimezone(timezone.utc).strftime("%Y-%m-%dT%H:%M:%S.%f") if time.tzinfo else time.isoformat()


def sun_position(time: Any, lon: float, lat: float, *, body: str = "moon") -> SunDirection:
    """Returns the direction of the Sun at a place: longitude ``lon`` in degrees east, latitude ``lat`` in degrees north.

    ``body`` is ``"moon"`` or ``"mars"``. ``time`` is a text in UTC, or a datetime.

    >>> round(sun_position("2009-08-30T12:00:00", 3.63, 26.13).azimuth, 1)
    107.7
    """
    if body not in ("moon", "mars"):
        raise UsageError(f"body: moon or mars expected, found {body}")
    return SunDirection(*_native.sun(str(_utc(time)), lon, lat, body == "mars"))


class SunDirection(NamedTuple):
    """A direction of the Sun, degrees.

    >>> SunDirection(107.7, 29.9).elevation
    29.9
    """

    azimuth: float
    """Clockwise from north."""
    elevation: float
    """Above the horizon; negative at night."""


def _call(words: list[str], grids: Sequence[Grid], in_memory: bool, progress: Progress, **more: Any) -> _native.Outcome:
    arrays = [held for grid in grids for held in grid.held]
    with _progress.listener(progress) as listen:
        outcome = _native.call(words, arrays, in_memory, listen, **more)
    for kind, text in outcome["said"]:
        if kind == "warning":
            warnings.warn(text, Warning, stacklevel=3)
    return outcome


def _record(outcome: _native.Outcome) -> dict[str, Any]:
    record: dict[str, Any] = json.loads(outcome["json"] or "{}")
    return record


@dataclass(frozen=True)
class Light:
    """The light of an image, as :attr:`Prediction.light` has it.

    >>> scene = example()
    >>> sun = {"sun_azimuth": scene.sun_azimuth, "sun_elevation": scene.sun_elevation}
    >>> Model.load("nano").predict(scene.image, scene.coarse, **scene.place, **sun).light.source
    'given'
    """

    #: ``given``, ``fitted`` or ``assumed``.
    source: str
    #: Azimuth of the Sun, degrees clockwise from the grid's up, and its standard deviation; 0 for a known azimuth.
    azimuth_deg: float
    azimuth_sd_deg: float
    #: Contrast of a unit slope, and the standard deviation of its logarithm.
    strength: float
    log_strength_sd: float
    #: Elevation of a Sun of this strength, degrees.
    elevation_deg: float
    #: Expected share of relief that has the right direction, 0 to 1.
    trust: float
    #: Probability that brightness follows the slopes of the coarse DTM at all, 0 to 1.
    related: float
    #: Share of the contrast of waves of 2 to 8 coarse pixels that is relief, 0 to 1.
    long_share: float | None
    #: Whether the angles are from the image's file.
    azimuth_from_file: bool
    elevation_from_file: bool
    #: Whether the angles follow from the image's time.
    azimuth_from_time: bool
    elevation_from_time: bool
    #: How the light changes across the scene; None if the scene has one light.
    change: Any


@dataclass(frozen=True)
class Prediction:
    """Maps on the image's grid, of the kind of the image: arrays, DataArrays or rasterio datasets in memory.

    >>> scene = example(64, 64)
    >>> made = Model.load("ground").predict(scene.image, scene.coarse, **scene.place, uncertainty=True)
    >>> made.heights.shape, made.heights.dtype, bool(made.valid.all())
    ((64, 64), dtype('float32'), True)
    >>> bool((made.sigma > 0).all())
    True
    """

    #: Heights, metres above the sphere, float32; NaN where image or coarse DTM is void.
    heights: Any
    #: Whether a pixel has a height, bool.
    valid: NDArray[np.bool_]
    #: Standard deviation that the errors of heights are expected to have, metres, float32; None if not asked for.
    sigma: Any
    #: Standard deviation that the errors of slopes are expected to have along either axis, metres per metre, float32.
    slope_sigma: Any
    #: Origin of a height, uint8: 0 image, 1 image and coarse DTM, 2 coarse DTM, 3 shadow, 4 no height.
    origin: Any
    #: The light; None if the network takes none.
    light: Light | None
    #: What the user should know, a line each. Each is also a :class:`Warning`.
    warnings: list[str]
    #: Transform a, b, c, d, e, f: x = a*col + b*row + c, y = d*col + e*row + f.
    transform: Affine | None
    #: Reference system, as it was given.
    crs: Any
    #: All that ``elunar predict --json`` says.
    record: dict[str, Any] = field(repr=False)

    def mean_height(self, where: Any) -> tuple[float, float]:
        """Returns the mean height over an area, and the standard deviation that its error is expected to have, metres.

        ``where`` has a sample for each pixel, true inside the area; pixels without a height do not count. Errors of the coarse DTM are alike over
        ``record["uncertainty"]["coarse_correlation_m"]``, so a mean over a smaller area is hardly surer than one height. Needs ``uncertainty``.

        >>> scene = example(64, 80)
        >>> made = Model.load("ground").predict(scene.image, scene.coarse, **scene.place, uncertainty=True)
        >>> row, col = np.ogrid[:64, :80]
        >>> ellipse = ((row - 30) / 20) ** 2 + ((col - 40) / 30) ** 2 < 1
        >>> height, sigma = made.mean_height(ellipse)
        >>> bool(0 < sigma < made.sigma[ellipse].mean())
        True
        """
        if self.sigma is None:
            raise UsageError("mean_height: a prediction with uncertainty expected, found one without")
        inside = np.asarray(where)
        if inside.dtype != np.bool_ or inside.shape != self.valid.shape:
            raise UsageError(f"where: bool of shape {self.valid.shape} expected, found {inside.dtype} of shape {inside.shape}")
        inside = inside & self.valid
        if not inside.any():
            raise UsageError("where: a pixel with a height expected, none found")
        heights, sigma = (_grids.array_of(of) for of in (self.heights, self.sigma))
        pixel_m, errors = self.record["pixel_m"], self.record["uncertainty"]
        sizes = pixel_m, self.record["coarse_px"] * pixel_m
        coarse = errors["coarse_sigma_m"], errors["coarse_correlation_m"]
        return float(heights[inside].mean(dtype="f8")), _native.sigma_of_mean(sigma, inside, sizes, coarse)


@dataclass(frozen=True)
class Model:
    """A network of the int8 runner.

    >>> Model.load("ground").tile
    (256, 320)
    """

    _model: _native.Model

    @classmethod
    def load(cls, name: Path) -> Model:
        """Opens a model.

        ``name`` is ``"ground"``, the better one, or ``"nano"``, the one for flight, which are in this package, or the path of an ``.eld`` file.

        >>> Model.load("nano").description.startswith("int8 network nano.eld sha256:")
        True
        """
        return cls(_native.Model(os.fspath(name)))

    @property
    def description(self) -> str:
        """One line: kind, name, SHA-256 of the file.

        >>> Model.load("ground").description[:24]
        'int8 network ground.eld '
        """
        return self._model.description

    @property
    def tile(self) -> tuple[int, int]:
        """Rows and columns of the network's tile.

        >>> Model.load("nano").tile
        (256, 320)
        """
        return self._model.tile

    def predict(
        self,
        image: Any,
        coarse: Any,
        *,
        transform: Any = None,
        crs: Any = None,
        pixel_size: float | None = None,
        coarse_transform: Any = None,
        coarse_crs: Any = None,
        coarse_pixel_size: float | None = None,
        coarse_unit: str | None = None,
        image_nodata: float | None = None,
        coarse_nodata: float | None = None,
        sun_azimuth: float | None = None,
        sun_elevation: float | None = None,
        time: Any = None,
        fit_sun: bool = False,
        uncertainty: bool = False,
        coarse_sigma: float | None = None,
        tracks: Path | Sequence[Path] | None = None,
        overlap: int | None = None,
        no_anchor: bool = False,
        threads: int = 0,
        progress: Progress = "auto",
    ) -> Prediction:
        """Predicts the heights of an image.

        ``image`` is relative brightness, ``coarse`` heights in metres above the sphere, both of shape (rows, columns), each on a grid of its own on
        one sphere. A coarse array without ``coarse_transform`` lies on the image's grid; ``coarse_pixel_size`` then says how large its pixels were
        before it was interpolated, metres. ``coarse_crs`` is that of the image unless it is given. ``image_nodata`` and ``coarse_nodata`` are samples
        that mean no measurement. ``coarse_unit`` is for files that state none.

        ``sun_azimuth`` is degrees clockwise from the grid's up, ``sun_elevation`` degrees above the horizon. Angles that are not given follow
        from ``time`` (a text in UTC, or a datetime); else they are those that the image's file states, unless ``fit_sun``, or fitted. ``uncertainty`` also makes the expected errors, from the standard deviation of
        the coarse DTM's own heights, ``coarse_sigma``, metres [default: 0.04 of its pixels, at most 3 m], or found along laser altimeter ``tracks``, one table or several. ``overlap`` is that of neighbouring tiles,
        pixels. ``no_anchor`` takes the low frequencies from the network. ``threads``: 0 takes as many as the machine offers. ``progress`` is a
        function of (tiles done, all tiles), True for a bar of tqdm, False for none, ``"auto"`` for a bar in notebooks.

        >>> scene = example(64, 80)
        >>> made = Model.load("ground").predict(scene.image, scene.coarse, transform=scene.transform, coarse_transform=scene.coarse_transform)
        >>> made.heights.shape
        (64, 80)
        >>> Model.load("ground").predict(scene.image, scene.coarse)
        Traceback (most recent call last):
        elunardtm._errors.UsageError: image: transform and crs, or pixel_size, of an array expected, none given
        """
        image_place = Place(None if transform is None else _grids.affine(transform), crs, pixel_size)
        seen = _grids.grid("image", image, image_place, image_nodata)
        on_image = coarse_transform is None
        coarse_crs = seen.crs if coarse_crs is None else coarse_crs
        coarse_place = Place(seen.transform if on_image else _grids.affine(coarse_transform), coarse_crs, None)
        ground = _grids.grid("coarse", coarse, coarse_place, coarse_nodata)
        if ground.samples is not None and ground.transform == seen.transform and coarse_pixel_size is None:
            raise UsageError(
                "coarse: coarse_transform expected, or for an array on the image's grid coarse_pixel_size, the size of the DTM's own pixels; none given"
            )
        words = ["predict", f"--image={seen.word}", f"--coarse={ground.word}", "--model=ground", f"--output={_NOWHERE}"]
        words += _of_files(seen, ground, crs, coarse_crs, coarse_unit, image_nodata, coarse_nodata)
        words += _words(
            {
                "sun_azimuth": sun_azimuth, "sun_elevation": sun_elevation, "time": _utc(time),
                "fit_sun": fit_sun, "overlap": overlap, "no_anchor": no_anchor, "threads": threads,
            }
        )  # fmt: skip
        words += _words({"coarse_sigma": coarse_sigma, "tracks": tracks, "uncertainty": "errors.tif" if uncertainty else None})
        more = {"model": self._model, "expected_errors": uncertainty, "coarse_pixel_m": coarse_pixel_size}
        outcome = _call(words, [seen, ground], True, progress, **more)
        return _prediction(seen, outcome)

    def predict_file(
        self,
        image: Path,
        coarse: Path,
        output: Path,
        *,
        image_srs: Any = None,
        coarse_srs: Any = None,
        coarse_unit: str | None = None,
        image_nodata: float | None = None,
        coarse_nodata: float | None = None,
        sun_azimuth: float | None = None,
        sun_elevation: float | None = None,
        time: Any = None,
        fit_sun: bool = False,
        uncertainty: Path | None = None,
        coarse_sigma: float | None = None,
        tracks: Path | Sequence[Path] | None = None,
        report: Path | None = None,
        stac: Path | None = None,
        pds4: Path | None = None,
        part_dir: Path | None = None,
        overlap: int | None = None,
        no_anchor: bool = False,
        threads: int = 0,
        progress: Progress = "auto",
    ) -> dict[str, Any]:
        """Predicts a DTM from files, as ``elunar predict`` does: a cloud-optimised GeoTIFF ``output`` with a hillshade beside it.

        Rows of a run that stopped wait beside the output; the same call goes on from there. ``uncertainty`` is the file for the expected errors,
        ``report`` that for a page to look at, ``stac`` that for a STAC item, ``pds4`` that for a PDS4 label, ``part_dir`` the folder for unfinished rows. The other options are those of :meth:`predict`. Returns what ``--json`` prints: heights in
        metres, counts of pixels and tiles, the light, warnings, seconds.

        >>> import tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     image, coarse, truth = example(64, 64).write(folder)
        ...     made = Model.load("nano").predict_file(image, coarse, f"{folder}/dtm.tif")
        >>> made["rows"], made["pixels_valid"]
        (64, 4096)
        """
        words = ["predict", "--model=ground"] + _words(
            {
                "image": image, "coarse": coarse, "output": output, "image_srs": _grids.crs_text(image_srs),
                "coarse_srs": _grids.crs_text(coarse_srs), "coarse_unit": coarse_unit, "image_nodata": image_nodata,
                "coarse_nodata": coarse_nodata, "sun_azimuth": sun_azimuth, "sun_elevation": sun_elevation,
                "time": _utc(time), "fit_sun": fit_sun, "uncertainty": uncertainty, "coarse_sigma": coarse_sigma, "tracks": tracks, "report": report,
                "stac": stac, "pds4": pds4, "part_dir": part_dir, "overlap": overlap, "no_anchor": no_anchor, "threads": threads,
            }
        )  # fmt: skip
        return _record(_call(words, [], False, progress, model=self._model))


def _of_files(
    image: Grid, coarse: Grid, crs: Any, coarse_crs: Any, unit: str | None, nodata: float | None, coarse_nodata: float | None
) -> list[str]:
    """Returns what the user says about inputs that are files."""
    words = []
    if image.path is not None:
        words += _words({"image_srs": _grids.crs_text(crs), "image_nodata": nodata})
    if coarse.path is not None:
        words += _words(
            {"coarse_srs": _grids.crs_text(coarse_crs), "coarse_unit": unit, "coarse_nodata": coarse_nodata}
        )
    elif unit not in (None, "m"):
        raise UsageError(f"coarse_unit: for a file; heights of an array in metres expected, {unit!r} found")
    return words


def _prediction(seen: Grid, outcome: _native.Outcome) -> Prediction:
    maps, record = outcome["maps"], _record(outcome)
    transform = outcome["transform"]
    heights = maps["heights"]

    def map_of(name: str, unit: str | None) -> Any:
        return _grids.like(seen, maps[name], transform, unit) if name in maps else None

    light = record.get("light")
    return Prediction(
        heights=map_of("heights", "m"),
        valid=np.isfinite(heights),
        sigma=map_of("sigma", "m"),
        slope_sigma=map_of("slope_sigma", "1"),
        origin=map_of("origin", "1"),
        light=None if light is None else Light(**light),
        warnings=record["warnings"],
        transform=_grids.place_of(seen, transform),
        crs=seen.crs,
        record=record,
    )


def _place(transform: Any, crs: Any, pixel_size: float | None) -> Place:
    return Place(None if transform is None else _grids.affine(transform), crs, pixel_size)


def evaluate(
    dtm: Any,
    truth: Any,
    coarse: Any = None,
    *,
    transform: Any = None,
    crs: Any = None,
    pixel_size: float | None = None,
    coarse_transform: Any = None,
    truth_resolution_m: float | None = None,
    uncertainty: Path | None = None,
    error_map: Path | None = None,
    reliability: Path | None = None,
    spectra: Path | None = None,
    progress: Progress = "auto",
) -> dict[str, Any]:
    """Compares a DTM with a truth, both of shape (rows, columns), metres; the coarse DTM is the baseline.

    Arrays lie on one grid (``transform`` and ``crs``, or ``pixel_size``), the coarse DTM on that of ``coarse_transform``. ``truth_resolution_m`` is
    the wavelength that the truth resolves, metres. ``uncertainty`` is a file of expected errors. ``error_map``, ``reliability`` and ``spectra`` are
    pictures to draw. Returns what ``elunar evaluate --json`` prints: errors are DTM minus truth, metres and degrees.

    >>> scene = example()
    >>> made = Model.load("nano").predict(scene.image, scene.coarse, **scene.place)
    >>> dtm, coarse = evaluate(made.heights, scene.truth, scene.coarse, **scene.place)["candidates"]
    >>> dtm["slope_mae_deg"] < coarse["slope_mae_deg"]
    True
    """
    place = _place(transform, crs, pixel_size)
    grids = [_grids.grid("dtm", dtm, place), _grids.grid("truth", truth, place)]
    if coarse is not None:
        on = place if coarse_transform is None else Place(_grids.affine(coarse_transform), crs, None)
        grids.append(_grids.grid("coarse", coarse, on))
    words = ["evaluate", "--json"] + [f"--{grid.name}={grid.word}" for grid in grids]
    words += _words(
        {
            "truth_resolution_m": truth_resolution_m, "uncertainty": uncertainty, "error_map": error_map,
            "reliability": reliability, "spectra": spectra,
        }
    )  # fmt: skip
    return _record(_call(words, grids, True, progress))


def hillshade(
    dtm: Any,
    output: Path | None = None,
    *,
    transform: Any = None,
    crs: Any = None,
    pixel_size: float | None = None,
    sun_azimuth: float | None = None,
    sun_elevation: float | None = None,
    z_factor: float | None = None,
    compute_edges: bool = False,
    progress: Progress = "auto",
) -> Any:
    """Shades a DTM of shape (rows, columns), metres, as ``gdaldem hillshade`` does.

    ``sun_azimuth`` is degrees clockwise from north [315], ``sun_elevation`` degrees above the horizon [45], ``z_factor`` a factor on the heights [1].
    ``compute_edges`` also shades the outermost pixels. Returns uint8 of the DTM's kind, 0 where there is no value, else 1 to 255; with ``output``, a
    GeoTIFF or PNG that is written instead, None.

    >>> shade = hillshade(example(64, 64).truth, pixel_size=2.0, sun_elevation=20)
    >>> shade.shape, shade.dtype
    ((64, 64), dtype('uint8'))
    """
    grid = _grids.grid("dtm", dtm, _place(transform, crs, pixel_size))
    options = {
        "output": _NOWHERE if output is None else output, "sun_azimuth": sun_azimuth, "sun_elevation": sun_elevation,
        "z_factor": z_factor, "compute_edges": compute_edges,
    }  # fmt: skip
    outcome = _call(["hillshade", *_words(options), "--", grid.word], [grid], output is None, progress)
    return _grids.like(grid, outcome["maps"]["shade"]) if output is None else None


def render(
    dtm: Any,
    output: Path | None = None,
    *,
    sun_azimuth: float,
    sun_elevation: float,
    transform: Any = None,
    crs: Any = None,
    pixel_size: float | None = None,
    seed: int | None = None,
    progress: Progress = "auto",
) -> Any:
    """Renders an image of a DTM of shape (rows, columns), metres, under a given Sun, as an orbiter's camera sees it.

    ``sun_azimuth`` is degrees clockwise from the grid's up, ``sun_elevation`` degrees above the horizon, 2 to 90, ``seed`` that of blur, exposure and
    noise [0]. Every pixel must have a height. Returns relative DN, 0 to 4095, float32, of the DTM's kind; with ``output``, a GeoTIFF or PNG that is
    written instead, None.

    >>> image = render(example(64, 64).truth, pixel_size=2.0, sun_azimuth=300, sun_elevation=25)
    >>> image.shape, bool((image >= 0).all())
    ((64, 64), True)
    """
    grid = _grids.grid("dtm", dtm, _place(transform, crs, pixel_size))
    options = {
        "output": _NOWHERE if output is None else output, "sun_azimuth": sun_azimuth, "sun_elevation": sun_elevation,
        "seed": seed,
    }  # fmt: skip
    outcome = _call(["render", *_words(options), "--", grid.word], [grid], output is None, progress)
    return _grids.like(grid, outcome["maps"]["image"]) if output is None else None


def diff(
    first: Any,
    second: Any,
    output: Path | None = None,
    *,
    transform: Any = None,
    crs: Any = None,
    pixel_size: float | None = None,
    second_transform: Any = None,
    absolute: bool = False,
    picture: Path | None = None,
    progress: Progress = "auto",
) -> tuple[Any, dict[str, Any]]:
    """Subtracts the second DTM from the first, on the grid of the first, metres.

    Arrays lie on one grid, or the second on that of ``second_transform``; it is interpolated bilinearly. ``absolute`` takes the absolute value.
    ``output`` and ``picture`` are also written. Returns the difference, float32 of the first DTM's kind, NaN
    where either is void, and its statistics, metres.

    >>> import numpy
    >>> difference, statistics = diff(numpy.full((8, 8), 5.0), numpy.full((8, 8), 3.0), pixel_size=1.0)
    >>> float(difference[0, 0]), statistics["mean_m"]
    (2.0, 2.0)
    """
    place = _place(transform, crs, pixel_size)
    on = place if second_transform is None else Place(_grids.affine(second_transform), crs, None)
    grids = [_grids.grid("first", first, place), _grids.grid("second", second, on)]
    options = {"output": output, "picture": picture, "absolute": absolute}
    words = ["diff", *_words(options), "--", *(grid.word for grid in grids)]
    outcome = _call(words, grids, True, progress)
    return _grids.like(grids[0], outcome["maps"]["difference"], None, "m"), _record(outcome)


def mosaic(
    dtms: Sequence[Any],
    output: Path | None = None,
    *,
    transforms: Sequence[Any] | None = None,
    crs: Any = None,
    t_srs: Any = None,
    tr: float | None = None,
    t_projwin: tuple[float, float, float, float] | None = None,
    erode_length: int | None = None,
    weights_exponent: int | None = None,
    weights_blur_sigma: float | None = None,
    priority_blending_length: int | None = None,
    compress: str | None = None,
    progress: Progress = "auto",
) -> Any:
    """Joins overlapping DTMs of shape (rows, columns), metres, as ``dem_mosaic`` does.

    Arrays have a transform each in ``transforms``, and one ``crs``. The options are those of ``elunar mosaic``: ``t_srs`` is the mosaic's reference
    system, ``tr`` the side of its pixels and ``t_projwin`` its region (west, south, east, north), map units; ``erode_length`` pixels to remove at
    edges, ``weights_exponent`` and ``weights_blur_sigma`` (pixels) shape the weights, ``priority_blending_length`` keeps earlier DTMs but for a band
    of so many pixels. Returns the mosaic, float32 of the first DTM's kind, and for arrays and files (heights, transform); with ``output``, a GeoTIFF
    that is written instead, None.

    >>> import numpy
    >>> left, right = numpy.full((8, 8), 1.0), numpy.full((8, 8), 1.0)
    >>> heights, transform = mosaic([left, right], transforms=[(2, 0, 0, 0, -2, 0), (2, 0, 8, 0, -2, 0)])
    >>> heights.shape, transform[:3]
    ((8, 12), (2.0, 0.0, 0.0))
    """
    places = [None] * len(dtms) if transforms is None else [_grids.affine(one) for one in transforms]
    if len(places) != len(dtms):
        raise UsageError(f"transforms: one for each of {len(dtms)} DTMs expected, {len(places)} found")
    named = zip(range(1, len(dtms) + 1), dtms, places)
    grids = [_grids.grid(f"dtm {k}", dtm, Place(place, crs, None)) for k, dtm, place in named]
    options = {
        "output": _NOWHERE if output is None else output, "tr": tr, "erode_length": erode_length,
        "weights_exponent": weights_exponent, "weights_blur_sigma": weights_blur_sigma,
        "priority_blending_length": priority_blending_length, "compress": compress,
    }  # fmt: skip
    words = ["mosaic", *_words(options)]
    words += [] if t_srs is None else [f"--t_srs={_grids.crs_text(t_srs)}"]
    words += [] if t_projwin is None else ["--t_projwin", *(str(limit) for limit in t_projwin)]
    outcome = _call([*words, "--", *(grid.word for grid in grids)], grids, output is None, progress)
    if output is not None or not grids:
        return None
    first, transform = grids[0], outcome["transform"]
    if t_srs is not None:
        first = Grid(**{**vars(first), "crs": t_srs})
    made = _grids.like(first, outcome["maps"]["heights"], transform, "m")
    return (made, _grids.place_of(first, transform)) if first.like is None else made


def sfs(
    image: Any,
    coarse: Any,
    output: Path | None = None,
    *,
    transform: Any = None,
    crs: Any = None,
    pixel_size: float | None = None,
    coarse_transform: Any = None,
    coarse_crs: Any = None,
    coarse_unit: str | None = None,
    image_nodata: float | None = None,
    coarse_nodata: float | None = None,
    sun_azimuth: float | None = None,
    sun_elevation: float | None = None,
    time: Any = None,
    fit_sun: bool = False,
    smoothness_weight: float | None = None,
    dem_constraint_weight: float | None = None,
    shadow_threshold: float | None = None,
    threads: int = 0,
    progress: Progress = "auto",
) -> tuple[Any, dict[str, Any]]:
    """Makes a DTM by shape from shading, for comparison with :meth:`Model.predict`.

    ``image`` is relative brightness, ``coarse`` heights in metres, of shape (rows, columns), each with its place. ``sun_azimuth`` is degrees clockwise
    from the grid's up, ``sun_elevation`` degrees above the horizon; ``time`` says where it stood, ``fit_sun`` fits what is not given. The other options are those of ``elunar
    sfs``. Returns the heights, metres, float32 of the image's kind, and what ``--json`` prints; with ``output``, for inputs that are files, a GeoTIFF is
    written instead of the heights, which are None.

    >>> scene = example(48, 48)
    >>> sun = {"sun_azimuth": scene.sun_azimuth, "sun_elevation": scene.sun_elevation}
    >>> heights, record = sfs(scene.image, scene.coarse, **scene.place, **sun)
    >>> heights.shape, len(record["tiles"])
    ((48, 48), 1)
    """
    seen = _grids.grid("image", image, _place(transform, crs, pixel_size), image_nodata)
    coarse_crs = seen.crs if coarse_crs is None else coarse_crs
    on = Place(seen.transform if coarse_transform is None else _grids.affine(coarse_transform), coarse_crs, None)
    ground = _grids.grid("coarse", coarse, on, coarse_nodata)
    if output is not None and (seen.path is None or ground.path is None):
        raise UsageError("output: only for inputs that are files")
    words = ["sfs", "--json", f"--image={seen.word}", f"--coarse={ground.word}"]
    words += _of_files(seen, ground, crs, coarse_crs, coarse_unit, image_nodata, coarse_nodata)
    words += _words(
        {
            "output": _NOWHERE if output is None else output, "sun_azimuth": sun_azimuth, "sun_elevation": sun_elevation,
            "time": _utc(time), "fit_sun": fit_sun, "smoothness_weight": smoothness_weight, "dem_constraint_weight": dem_constraint_weight,
            "shadow_threshold": shadow_threshold, "threads": threads,
        }
    )  # fmt: skip
    outcome = _call(words, [seen, ground], output is None, progress)
    heights = None if output is not None else _grids.like(seen, outcome["maps"]["heights"], outcome["transform"], "m")
    return heights, _record(outcome)


def lola(
    dtm: Any,
    tracks: Path | Sequence[Path],
    *,
    transform: Any = None,
    crs: Any = None,
    pixel_size: float | None = None,
    search_m: float | None = None,
    csv_format: str | None = None,
    progress: Progress = "auto",
) -> dict[str, Any]:
    """Compares a DTM of shape (rows, columns), metres, with tracks of a laser altimeter, each shifted to its best fit.

    ``tracks`` are tables (CSV) of points. ``search_m`` is the greatest shift along either axis, metres [20], ``csv_format`` the columns as for ``elunar
    lola``. Returns what ``elunar lola --json`` prints, metres.

    >>> import numpy, tempfile
    >>> y, x = numpy.mgrid[0:80, 0:60]
    >>> dtm = 20 * numpy.sin(0.31 * y) + 15 * numpy.cos(0.17 * x)
    >>> rows = [f"{(2 * c + 1) / 30323.3},{-(2 * r + 1) / 30323.3},{dtm[r, c]}" for r, c in zip(range(12, 62), range(8, 58))]
    >>> with tempfile.NamedTemporaryFile("w", suffix=".csv") as table:
    ...     _ = table.write("lon,lat,height_m\\n" + "\\n".join(rows)) and table.flush()
    ...     found = lola(dtm, table.name, pixel_size=2.0, search_m=4)
    >>> found["tracks"][0]["points"]
    50
    """
    grid = _grids.grid("dtm", dtm, _place(transform, crs, pixel_size))
    tables = [tracks] if isinstance(tracks, (str, os.PathLike)) else list(tracks)
    options = {"tracks": tables, "search_m": search_m, "csv_format": csv_format}
    return _record(_call(["lola", "--json", f"--dtm={grid.word}", *_words(options)], [grid], True, progress))


@dataclass(frozen=True)
class Example:
    """A scene of the synthetic Moon.

    >>> example(64, 80).image.shape
    (64, 80)
    """

    #: Relative DN, 0 to 4095, float32.
    image: NDArray[np.float32]
    #: Coarse DTM on its own grid, metres above the sphere, float32.
    coarse: NDArray[np.float32]
    #: True DTM on the image's grid, metres above the sphere, float32.
    truth: NDArray[np.float32]
    #: Transform of image and truth, as six numbers a, b, c, d, e, f.
    transform: Affine
    #: Transform of the coarse DTM.
    coarse_transform: Affine
    #: Azimuth of the Sun, degrees clockwise from the grid's up.
    sun_azimuth: float
    #: Elevation of the Sun above the horizon, degrees.
    sun_elevation: float
    #: Seed of the Moon.
    seed: int

    @property
    def place(self) -> dict[str, Any]:
        """Both transforms, by the names of the arguments.

        >>> sorted(example(64, 64).place)
        ['coarse_transform', 'transform']
        """
        return {"transform": self.transform, "coarse_transform": self.coarse_transform}

    def write(self, folder: Path) -> list[str]:
        """Writes image, coarse DTM and truth as GeoTIFFs, and returns their paths.

        >>> import os, tempfile
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     [os.path.basename(path) for path in example(64, 64).write(folder)]
        ['scene_0000_image.tif', 'scene_0000_coarse.tif', 'scene_0000_truth.tif']
        """
        rows, cols = self.image.shape
        names = _native.write_scene(os.fspath(folder), rows, cols, self.seed)
        return [os.path.join(os.fspath(folder), name) for name in names]


def example(rows: int = 256, cols: int = 320, seed: int = 1) -> Example:
    """Makes a scene of the synthetic Moon of a ``seed``: ``rows`` x ``cols`` pixels of 2 m.

    >>> example(64, 80).truth.dtype
    dtype('float32')
    """
    maps, azimuth, elevation = _native.scene(rows, cols, seed)

    def turned(transform: list[float]) -> Affine:
        c, a, b, f, d, e = transform
        return (a, b, c, d, e, f)

    (image, on), (coarse, coarse_on), (truth, _) = maps
    return Example(image, coarse, truth, turned(on), turned(coarse_on), azimuth, elevation, seed)
