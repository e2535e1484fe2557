from collections.abc import Callable, Sequence
from typing import Any, TypedDict, final

import numpy as np
from numpy.typing import NDArray

SOFTWARE: str
__version__: str

Progress = Callable[[str, int, int, str], object]
Held = tuple[str, NDArray[np.float32], Sequence[float], str | None, str, tuple[float | None, float | None]]

class Outcome(TypedDict):
    text: str
    json: str | None
    maps: dict[str, NDArray[Any]]
    transform: list[float] | None
    said: list[tuple[str, str]]

@final
class Model:
    def __new__(cls, path: str) -> Model: ...
    @property
    def description(self) -> str: ...
    @property
    def tile(self) -> tuple[int, int]: ...

def call(
    words: Sequence[str],
    arrays: Sequence[Held],
    in_memory: bool,
    progress: Progress | None = None,
    model: Model | None = None,
    expected_errors: bool = False,
    coarse_pixel_m: float | None = None,
) -> Outcome: ...
def options(command: str) -> list[str]: ...
def sigma_of_mean(
    sigma: NDArray[np.float32], inside: NDArray[np.bool_], sizes_m: tuple[float, float], coarse_m: tuple[float, float]
) -> float: ...
def sun(time: str, lon: float, lat: float, mars: bool) -> tuple[float, float]: ...
def write_scene(folder: str, rows: int, cols: int, seed: int) -> list[str]: ...
def scene(rows: int, cols: int, seed: int) -> tuple[list[tuple[NDArray[np.float32], list[float]]], float, float]: ...
