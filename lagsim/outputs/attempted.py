"""A picture that cannot be drawn costs that picture, and nothing else of a run."""

from __future__ import annotations

import traceback
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, TypeVar

from lagsim.notes import Caution

if TYPE_CHECKING:
    from collections.abc import Callable

# The name of a file, and what is in it or why it could not be drawn.
Made: TypeAlias = "tuple[str, bytes | Caution]"
T = TypeVar("T")


def attempted(name: str, draw: Callable[[], T]) -> T | Caution:
    """Give what is drawn, or the warning that `name` could not be drawn."""
    try:
        return draw()
    except Exception as error:  # noqa: BLE001  rows are worth more than any picture
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(place.filename).name}, line {place.lineno}"
        why = f"{type(error).__name__}: {error} ({where})"
        text = f"`{name}` could not be drawn, all else is complete: {why}"
        return Caution("not-drawn", text)
