"""The pages of the site on which shipped models are played with.

Each is what `lagsim explore MODEL -o FILE` writes; models that a page alone cannot
compute have none. All take about a minute of one processor's time.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from lagsim.errors import LagsimError
from lagsim.studies.explore.explorer import Explorer
from lagsim.studies.explore.file import page_in_a_file

MODELS = Path(__file__).resolve().parent.parent / "models"


def page(path: Path) -> bytes:
    """Give the page of a model; b"" where a page alone cannot compute it."""
    try:
        return page_in_a_file(Explorer(str(path), {}, {}, str))
    except LagsimError as error:
        if error.code != "not-in-a-file":
            raise
        return b""


def pages() -> dict[str, bytes]:
    """Give the pages of all shipped models that have one, by the name of the model."""
    paths = sorted(MODELS.glob("*.yaml"))
    with ProcessPoolExecutor() as pool:
        made = pool.map(page, paths)
    return {path.stem: x for path, x in zip(paths, made, strict=True) if x}
