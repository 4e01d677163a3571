"""Reading a model."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from lagsim.api.models import Model


def load(source: str | Path, **values: float | str) -> Model:
    """Read a model.

    Parameters
    ----------
    source
        A path, or the text of a model file: a string with a line break in it.
    **values
        Numbers, or expressions, instead of those of parameters or of start values, see
        `Model.bind`.

    Raises
    ------
    InputError
        With every fault, each with file, line, column, code, text and hint.
    """
    from lagsim.api.models import model_of

    model = model_of(source)
    return model.bind(**values) if values else model
