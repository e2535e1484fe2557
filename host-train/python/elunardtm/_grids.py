"""Inputs of many kinds as arrays with a place, and results of the same kind."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._errors import UsageError

Affine = tuple[float, float, float, float, float, float]
Path = str | os.PathLike[str]


@dataclass(frozen=True)
class Place:
    """Where arrays without a place of their own lie."""

    transform: Affine | None
    crs: Any
    pixel_size: float | None

    def affine(self, name: str) -> Affine:
        """Returns the transform; with a pixel size alone, that of a grid whose upper left corner is (0, 0)."""
        if self.transform is not None:
            return self.transform
        if self.pixel_size is None:
            raise UsageError(f"{name}: transform and crs, or pixel_size, of an array expected, none given")
        return (self.pixel_size, 0.0, 0.0, 0.0, -self.pixel_size, 0.0)


@dataclass(frozen=True)
class Grid:
    """An input: a file, or an array with its place."""

    name: str
    path: str | None
    samples: NDArray[np.float32] | None
    transform: Affine | None
    crs: Any
    dtype: str
    sun: tuple[float | None, float | None]
    like: Any

    @property
    def held(self) -> list[_native.Held]:
        """What the native part holds for it: nothing for a file."""
        if self.samples is None or self.transform is None:
            return []
        a, b, c, d, e, f = self.transform
        return [(self.name, self.samples, (c, a, b, f, d, e), crs_text(self.crs), self.dtype, self.sun)]

    @property
    def word(self) -> str:
        """What stands for it on the command line."""
        return self.name if self.path is None else self.path


def affine(transform: Any) -> Affine:
    """Returns a transform as six numbers a, b, c, d, e, f: x = a*col + b*row + c, y = d*col + e*row + f."""
    try:
        numbers = [float(number) for number in transform]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) == 9:
        numbers = numbers[:6]
    if len(numbers) != 6:
        raise UsageError(f"transform: an affine.Affine or its six numbers a, b, c, d, e, f expected, found {transform!r}")
    return (numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5])


def crs_text(crs: Any) -> str | None:
    """Returns a reference system as WKT, PROJ text or code."""
    if crs is None or isinstance(crs, str):
        return crs
    to_wkt = getattr(crs, "to_wkt", None)
    if to_wkt is None:
        raise UsageError(f"crs: a text, or an object with to_wkt, expected, found {crs!r}")
    return str(to_wkt())


def is_dataset(value: Any) -> bool:
    """Whether it is an open rasterio dataset, or another object with its interface."""
    return all(hasattr(value, name) for name in ("read", "transform", "crs", "dtypes"))


def is_xarray(value: Any) -> bool:
    """Whether it is an xarray.DataArray."""
    return all(hasattr(value, name) for name in ("dims", "coords", "values", "isel"))


def grid(name: str, value: Any, place: Place, nodata: float | None = None) -> Grid:
    """Makes an input of a path, an array, a rasterio dataset or an xarray.DataArray."""
    if isinstance(value, (str, os.PathLike)):
        return Grid(name, os.fspath(value), None, None, None, "", (None, None), None)
    if is_dataset(value):
        return _of_dataset(name, value, nodata)
    if is_xarray(value):
        return _of_xarray(name, value, place, nodata)
    samples = _samples(name, value, nodata)
    return Grid(name, None, samples, place.affine(name), place.crs, _dtype(value), (None, None), None)


def _of_dataset(name: str, dataset: Any, nodata: float | None) -> Grid:
    samples = dataset.read(1, masked=True)
    voids = np.ma.getmaskarray(samples)
    if nodata is not None:
        voids = voids | (samples.data == nodata)
    # In single precision, as from a file.
    scale, offset = float(dataset.scales[0]), float(dataset.offsets[0])
    data = samples.data.astype(np.float32)
    if (scale, offset) != (1.0, 0.0):
        data = (samples.data.astype(np.float64) * scale + offset).astype(np.float32)
    data[voids] = np.nan
    return Grid(name, None, data, affine(dataset.transform), dataset.crs, dataset.dtypes[0], _sun(dataset.tags()), dataset)


def _sun(tags: Mapping[Any, Any]) -> tuple[float | None, float | None]:
    """Returns the angles of the Sun that an image's tags state."""

    def angle(name: str) -> float | None:
        try:
            return None if name not in tags else float(tags[name])
        except (TypeError, ValueError):
            return None

    return angle("SUN_AZIMUTH_DEG"), angle("SUN_ELEVATION_DEG")


def _of_xarray(name: str, array: Any, place: Place, nodata: float | None) -> Grid:
    flat = array.squeeze()
    transform, crs = place.transform, place.crs
    try:
        import rioxarray  # noqa: F401
    except ImportError:
        pass
    else:
        nodata = flat.rio.nodata if nodata is None else nodata
        if flat.rio.crs is not None:
            crs, transform = flat.rio.crs, affine(flat.rio.transform())
    here = Place(transform, crs, place.pixel_size)
    samples = _samples(name, flat.values, nodata)
    return Grid(name, None, samples, here.affine(name), crs, str(flat.dtype), _sun(flat.attrs), flat)


def _samples(name: str, value: Any, nodata: float | None) -> NDArray[np.float32]:
    array = np.ma.asanyarray(value) if isinstance(value, np.ma.MaskedArray) else np.asarray(value)
    if array.ndim != 2 or array.dtype.kind not in "iuf":
        raise UsageError(f"{name}: numbers of shape (rows, columns) expected, found {array.dtype} of shape {array.shape}")
    voids = np.ma.getmaskarray(array) if isinstance(array, np.ma.MaskedArray) else None
    data = np.asarray(array.data if voids is not None else array)
    if nodata is not None and not np.isnan(nodata):
        voids = (data == nodata) if voids is None else voids | (data == nodata)
    samples = np.ascontiguousarray(data, dtype=np.float32)
    if voids is not None and voids.any():
        samples = np.where(voids, np.float32(np.nan), samples)
    return samples


def _dtype(value: Any) -> str:
    kind = np.asarray(value).dtype
    return {"u": "u", "i": "i", "f": "f"}.get(kind.kind, "") + str(8 * kind.itemsize)


def like(of: Grid, samples: NDArray[Any], transform: Sequence[float] | None = None, unit: str | None = None) -> Any:
    """Returns samples as the kind of `of`: an array for arrays and files, a DataArray, or a rasterio dataset in memory.

    `transform` (GDAL's order) is that of another grid; without it the grid is that of `of`.
    """
    if of.like is None:
        return samples
    if is_dataset(of.like):
        return _dataset(of, samples, transform, unit)
    return _data_array(of, samples, transform, unit)


def array_of(result: Any) -> NDArray[Any]:
    """Returns the samples of what `like` has made."""
    return np.asarray(result.read(1) if is_dataset(result) else result)


def place_of(of: Grid, transform: Sequence[float] | None) -> Affine | None:
    """Returns the transform of a result, in the order of affine.Affine."""
    if transform is None:
        return of.transform
    c, a, b, f, d, e = transform
    return (a, b, c, d, e, f)


def _dataset(of: Grid, samples: NDArray[Any], transform: Sequence[float] | None, unit: str | None) -> Any:
    from rasterio.io import MemoryFile
    from rasterio.transform import Affine as Transform

    rows, cols = samples.shape
    kind = samples.dtype
    nodata = float("nan") if kind.kind == "f" else 0 if kind.kind == "u" and unit is None else None
    memory = MemoryFile()
    with memory.open(
        driver="GTiff", height=rows, width=cols, count=1, dtype=kind.name, nodata=nodata, crs=of.crs,
        transform=Transform(*(place_of(of, transform) or ())),
    ) as made:  # fmt: skip
        made.write(samples, 1)
        if unit is not None:
            made.units = [unit]
    opened = memory.open()
    # Its bytes live as long as it does.
    opened._elunardtm_memory = memory
    return opened


def _data_array(of: Grid, samples: NDArray[Any], transform: Sequence[float] | None, unit: str | None) -> Any:
    import xarray

    template = of.like
    y, x = template.dims
    coords = dict(template.coords)
    if transform is not None and place_of(of, transform) != of.transform:
        rows, cols = samples.shape
        x0, dx, _, y0, _, dy = transform
        coords = {name: value for name, value in coords.items() if name not in (x, y)}
        coords[x], coords[y] = x0 + dx * (np.arange(cols) + 0.5), y0 + dy * (np.arange(rows) + 0.5)
        if hasattr(coords.get("spatial_ref"), "attrs"):
            coords["spatial_ref"] = coords["spatial_ref"].drop_attrs().assign_attrs(
                {key: value for key, value in coords["spatial_ref"].attrs.items() if key != "GeoTransform"}
            )
    attrs = {} if unit is None else {"units": unit}
    return xarray.DataArray(samples, dims=(y, x), coords=coords, attrs=attrs)
