"""Pages of the Python interface on which values of a model are set."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from lagsim.api import in_python
from lagsim.codes.known import NOT_IN_A_FILE
from lagsim.errors import LagsimError
from lagsim.outputs.notebook import framed
from lagsim.studies.explore.explorer import Explorer
from lagsim.studies.explore.file import page_in_a_file
from lagsim.studies.explore.server import Server

if TYPE_CHECKING:
    from collections.abc import Iterable

    from lagsim.model.model import Model


class Exploration:
    """Page with sliders on which a model's motion follows its values.

    A notebook shows the page at the end of a cell. Models that a page alone cannot
    compute have a server in this process, and the notebook shows its address.

    Attributes
    ----------
    html : str
        The text of the page, which loads no other file; "" where there is a server.
    address : str
        The address of the page on this machine; "" where there is none.
    reason : str
        The reason why a page alone cannot compute the motions; "" if it can.
    """

    def __init__(self, explorer: Explorer, height: int) -> None:
        self._name, self._height = explorer.model.name, height
        self.html = self.address = self.reason = ""
        self._server: Server | None = None
        try:
            with in_python():
                self.html = page_in_a_file(explorer).decode()
        except LagsimError as error:
            if error.code != NOT_IN_A_FILE:
                raise
            self.reason = str(error).splitlines()[0]
            self._server = Server(explorer)
            self.address = self._server.address
            threading.Thread(target=self._server.serve, daemon=True).start()

    def write(self, path: str | Path) -> None:
        """Write the page to a file, for a browser.

        Raises
        ------
        ValueError
            If a page alone cannot compute the model.
        """
        if self.reason:
            raise ValueError(self.reason)
        Path(path).write_text(self.html, encoding="utf-8")

    def end(self) -> None:
        """End the server, which else ends a minute after its page was closed."""
        if self._server is not None:
            self._server.over.set()

    def __repr__(self) -> str:
        where = self.address or f"{len(self.html) / 1000:.0f} kB of HTML"
        return f"<Exploration of {self._name}: {where}>"

    def _repr_html_(self) -> str:
        if not self.address:
            return framed(self.html, self._name, self._height)
        name, address, reason = map(escape, (self._name, self.address, self.reason))
        return (
            f'<p><a href="{address}" target="_blank" rel="noopener">Explore {name}</a>'
            f" at {address}</p><p><small>{reason}</small></p>"
        )


def explored(
    model: Model,
    vary: Iterable[str] | Mapping[str, tuple[float, float] | None],
    height: int,
) -> Exploration:
    """Return the page of a model; arguments as of `api.models.Model.explore`."""
    ends = dict(vary) if isinstance(vary, Mapping) else dict.fromkeys(vary)
    with in_python():
        explorer = Explorer(model, {}, ends, str)
    return Exploration(explorer, height)
