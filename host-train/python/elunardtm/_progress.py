"""How far a call is: a bar of tqdm in notebooks, or a function of the caller."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Literal

from . import _native

#: A function of (pieces done, all pieces), ``True`` for a bar of tqdm, ``False`` for silence, ``"auto"`` for a bar in notebooks.
Progress = Callable[[int, int], object] | bool | Literal["auto"]


def in_notebook() -> bool:
    """Whether this is a kernel of Jupyter."""
    shell = sys.modules.get("IPython")
    return shell is not None and type(shell.get_ipython()).__name__ == "ZMQInteractiveShell"


@contextmanager
def listener(progress: Progress) -> Iterator[_native.Progress | None]:
    """Returns the function that the native part calls."""
    if callable(progress):
        tell = progress
        yield lambda _what, done, all, _unit: tell(done, all)
        return
    if progress is False or (progress == "auto" and not in_notebook()):
        yield None
        return
    try:
        from tqdm.auto import tqdm
    except ImportError:
        yield None
        return
    bars: dict[str, Any] = {}

    def show(what: str, done: int, all: int, unit: str) -> None:
        bar = bars.get(what)
        if bar is None:
            # One work begins when the one before is done.
            for before in bars.values():
                before.n = before.total
                before.refresh()
            bar = bars[what] = tqdm(total=all, desc=what or None, unit=f" {unit}")
        bar.total, bar.n = all, done
        bar.refresh()

    try:
        yield show
    finally:
        for bar in bars.values():
            bar.close()
