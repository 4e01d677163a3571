"""Reading a model."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

    from lagsim.model.model import Model


def load(source: str | Path, **values: float | str) -> Model:
    """Read a model.

    Parameters
    ----------
    source
        A path, or the text of a model file: what has a line break in it.
    **values
        Numbers, or expressions, instead of those of parameters or of start values, see
        `Model.bind`.

    Raises
    ------
    InputError
        With every fault, each with file, line, column, code, text and hint.
    """
    from lagsim.model.reader import TEXT, read, read_file

    text = str(source)
    model = read(text, TEXT) if "\n" in text else read_file(text)
    return model.bind(**values) if values else model
