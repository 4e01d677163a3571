"""What is kept of an exception that nobody has foreseen, so that it can be reported."""

from __future__ import annotations

import os
import platform
import sys
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

TRACEBACK = "--traceback"
"""Has lagsim print it as well."""


def kept(told: str) -> Path | None:
    """Write a report to a file of the user's cache; None where there is no room."""
    from lagsim.native.link.cache import folder
    from lagsim.outputs.manifest import versions
    from lagsim.version import __version__

    where = folder("reports")
    if where is None:
        return None
    known = ", ".join(f"{name} {version}" for name, version in versions().items())
    text = (
        f"lagsim {__version__}; {known}; {platform.platform()}\n"
        f"{' '.join(map(repr, sys.argv[1:]))}\n\n{told}"
    )
    now = time.strftime("%Y%m%d-%H%M%S", time.gmtime())
    path = where / f"lagsim-{now}-{os.getpid()}-{time.monotonic_ns() % 10**6:06}.txt"
    try:
        with path.open("x", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
    except OSError:
        return None
    return path
