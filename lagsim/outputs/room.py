"""Whether a table fits on the disk: asked before hours are spent on its rows."""

from __future__ import annotations

import math
import shutil
from typing import TYPE_CHECKING

from lagsim import limits
from lagsim.errors import InputError, Problem
from lagsim.outputs import Format

if TYPE_CHECKING:
    from pathlib import Path

    from lagsim.model.model import Settings

# Bytes of a number and its comma, as people's scenes have them: 16 digits and a sign.
# Packed, each is a double; Parquet and its kin may do with half.
USUAL = {Format.CSV: 19.0, Format.NPZ: 8.0, Format.PARQUET: 8.0}
# Below this it never is, but for columns of zeros.
LEAST = 0.5


def refuse_without_room(
    folder: Path, form: Format, settings: Settings, columns: int, *, ends: bool
) -> str:
    """Refuse a table that the disk has no room for; warn of one that it may not have.

    Parameters
    ----------
    folder
        Where it comes; it need not be there yet.
    ends
        The run may end long before its time, by `until`.

    Returns
    -------
    str
        The warning, or nothing.

    Raises
    ------
    InputError
    """
    rows = math.floor(settings.duration / settings.output_step) + 1
    needed = rows * columns * USUAL[form]
    free = _free(folder)
    if needed <= free:
        return ""
    about = (
        f"{rows:,} rows of {columns} columns take about {limits.size(int(needed))}, "
        f"and where {folder} is, {limits.size(free)} are free"
    )
    if ends or LEAST * needed <= free:
        return f"the disk may fill up: {about}"
    hint = "a larger output_step, fewer `output.columns`, --table npz, or another -o"
    raise InputError([Problem("no-room", f"there is no room: {about}", hint=hint)])


def _free(folder: Path) -> int:
    for place in (folder, *folder.absolute().parents):
        try:
            return shutil.disk_usage(place).free
        except OSError:
            continue
    return 1 << 62
