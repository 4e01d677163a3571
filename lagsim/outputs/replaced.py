"""What a result replaces that was made in another way, by the records of both."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from lagsim.notes import Caution

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

OPTIONS = ("method", "formulation", "rtol", "atol", "step")
# So many differences are told.
MOST = 3


def replaced(
    before: Mapping[str, Any], now: Mapping[str, Any], folder: Path
) -> Caution | None:
    """Tell of a result of the same file with other parameters, or of another file.

    A file that was edited since is what people do all day: nothing is said of that.

    Parameters
    ----------
    before, now
        The contents of two run.json; the first may be anything.
    """
    old, new = before.get("model"), now["model"]
    if not isinstance(old, dict):
        return None
    if old.get("sha256") == new["sha256"]:
        told = list(_differences(before, now))
        more = f" and {len(told) - MOST} more" if len(told) > MOST else ""
        what = f"with {', '.join(told[:MOST])}{more}" if told else ""
    else:
        file = str(old.get("file"))
        what = f"of {file}" if Path(file) != Path(new["file"]) else ""
    if not what:
        return None
    text = f"this replaces the result {what} in {folder}; with -o DIR both are kept"
    return Caution("result-replaced", text)


def _differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    values = before.get("parameters")
    if isinstance(values, dict):
        for name, value in now["parameters"].items():
            if name in values and values[name] != value:
                yield f"{name} = {values[name]!r}"
    for name in OPTIONS:
        if name in before and before[name] != now[name]:
            yield f"{name} {before[name]}"
    whole = before.get("outcome") == now["outcome"] == "done"
    if whole and before.get("end") != now["end"]:
        yield f"end {before.get('end')}"
