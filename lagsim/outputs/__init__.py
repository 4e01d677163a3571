"""Writers of the files of a run, one module per kind; each write is atomic."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias, TypeVar

from lagsim.codes.known import NOT_DRAWN
from lagsim.notes import Caution

if TYPE_CHECKING:
    from collections.abc import Callable

# The name of a file, and its content or the warning that it could not be drawn.
Made: TypeAlias = "tuple[str, bytes | Caution]"
T = TypeVar("T")
# The columns of energies.
ENERGIES = ("kinetic", "potential", "lagrangian", "energy", "work")


class TableFormat(StrEnum):
    """Format of a table; its value is the ending of the file name."""

    CSV = "csv"
    NPZ = "npz"
    PARQUET = "parquet"

    @property
    def file(self) -> str:
        """The file name of the table of a run in this format."""
        return f"trajectory.{self.value}"


def attempted(name: str, draw: Callable[[], T]) -> T | Caution:
    """Return the result of `draw()`; if it raises, a warning that names the file.

    A failure thus stops neither the run nor the other files.

    name : the file that `draw` creates.
    """
    import traceback

    try:
        return draw()
    except Exception as error:  # noqa: BLE001  rows are worth more than any picture
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{Path(place.filename).name}, line {place.lineno}"
        why = f"{type(error).__name__}: {error} ({where})"
        text = f"`{name}` could not be drawn, all else is complete: {why}"
        return Caution(NOT_DRAWN, text)
