"""matplotlib, loaded without anybody's settings; to be imported before it.

On loading it reads `matplotlibrc` in the working directory first, which may be a
stranger's, a pipe, or no text; and fails at a MPLBACKEND that it does not know. What is
drawn here takes its style from neither (`sheet.in_house_style`). A program that has
loaded matplotlib before keeps what it has.
"""

from __future__ import annotations

import contextlib
import logging
import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

_OURS = ("MATPLOTLIBRC", "MPLBACKEND")


@contextlib.contextmanager
def _elsewhere() -> Iterator[None]:
    """Be where matplotlib's own defaults are its matplotlibrc."""
    found = find_spec("matplotlib")
    assert found is not None
    assert found.origin is not None
    kept = {name: os.environ.pop(name) for name in _OURS if name in os.environ}
    try:
        with _back():
            os.chdir(Path(found.origin).parent / "mpl-data")
            yield
    finally:
        os.environ.update(kept)


@contextlib.contextmanager
def _back() -> Iterator[None]:
    """Come back to the working directory, though it may be gone or not be readable."""
    if not hasattr(os, "fchdir"):  # Windows, where it cannot be gone
        with contextlib.chdir("."):
            yield
        return
    here = os.open(".", getattr(os, "O_PATH", os.O_RDONLY))
    try:
        yield
    finally:
        os.fchdir(here)
        os.close(here)


# It tells on stderr of a home that it cannot write to, which is no news.
logging.getLogger("matplotlib").setLevel(logging.ERROR)
if "matplotlib" not in sys.modules:
    with _elsewhere():
        import matplotlib as mpl  # noqa: F401
