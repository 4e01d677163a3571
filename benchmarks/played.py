"""Interactive pages of the site, one for each shipped model that a page can compute.

Each page is the output of `lagsim explore MODEL -o FILE`; models that a page alone
cannot compute have none. All pages take about a minute of processor time.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from lagsim.errors import LagsimError
from lagsim.studies.explore.explorer import Explorer
from lagsim.studies.explore.file import page_in_a_file

MODELS = Path(__file__).resolve().parent.parent / "models"


def page(path: Path) -> bytes:
    """Return the page of a model; b"" if a page alone cannot compute it."""
    try:
        return page_in_a_file(Explorer(str(path), {}, {}, str))
    except LagsimError as error:
        if error.code != "not-in-a-file":
            raise
        return b""


def pages() -> dict[str, bytes]:
    """Return the pages of all shipped models that have one, by the model's name."""
    paths = sorted(MODELS.glob("*.yaml"))
    with ProcessPoolExecutor() as pool:
        made = pool.map(page, paths)
    return {path.stem: x for path, x in zip(paths, made, strict=True) if x}
