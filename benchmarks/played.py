"""Interactive pages of the site, one for each shipped model that a page can compute.

Each page is the output of `lagsim explore MODEL -o FILE`; models that a page alone
cannot compute have none. All pages take about a minute of processor time.
With `LAGSIM_TEST_SLICE=played=12` a trial of the site has the pages of one in twelve
models, others with each commit, and that of `SHOWN`.
"""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from lagsim.errors import LagsimError
from lagsim.studies.explore.explorer import Explorer
from lagsim.studies.explore.file import page_in_a_file
from tests.choosing import COMMIT, share, slices

MODELS = Path(__file__).resolve().parent.parent / "models"
# Another page of the site shows it.
SHOWN = "elastic-pendulum"


def page(path: Path) -> bytes:
    """Return the page of a model; b"" if a page alone cannot compute it."""
    try:
        return page_in_a_file(Explorer(str(path), {}, {}, str))
    except LagsimError as error:
        if error.code != "not-in-a-file":
            raise
        return b""


def tried(paths: list[Path]) -> list[Path]:
    """Return the models whose pages are made: all, or those of a slice."""
    one_in = slices(os.environ.get("LAGSIM_TEST_SLICE", "")).get("played", 1)
    names = {*share([path.stem for path in paths], COMMIT, one_in), SHOWN}
    return [path for path in paths if path.stem in names]


def pages() -> dict[str, bytes]:
    """Return the pages of shipped models that have one, by the model's name."""
    paths = tried(sorted(MODELS.glob("*.yaml")))
    with ProcessPoolExecutor() as pool:
        made = pool.map(page, paths)
    return {path.stem: x for path, x in zip(paths, made, strict=True) if x}
