"""Sessions that are ready, kept by all that they are made from.

To read, derive, examine, plan and link what was run before takes longer than to
integrate it: a run of the same text with the same options begins with the session that
the one before it has kept, and loads nothing of what made it. It is found by the text,
the options, the code of lagsim, the versions of what it rests on, and the processor; so
nothing kept is ever out of date. Where it lies, and who may write there, is told in
`native.link.cache`.
"""

from __future__ import annotations

import contextlib
import io
import os
import pickle
import sys
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from lagsim.native.link.cache import slot
from lagsim.version import __version__

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from lagsim.language.graph import Graph
    from lagsim.model.model import Model, Separation, Stated
    from lagsim.model.settings import Settings
    from lagsim.run.session import Session

# Scenes of more nodes take longer to be made than a process to start, and much room.
MOST_NODES = 20_000
# What few scenes need, and what takes long to load only to ask for its version.
UNASKED = "scipy"
_PROTOCOL = 5


class Asked(NamedTuple):
    """What is asked for: the text of a model, where it stands, and what goes first."""

    text: str
    file: str
    overrides: Mapping[str, str]
    options: Mapping[str, str]


def kept_session(asked: Asked, make: Callable[[], Session]) -> Session:
    """Give the session that was asked for before, or make it, and keep it."""
    own = slot(["session", *_made_from(asked)])
    content = own.content()
    if content is not None:
        found: Session = pickle.loads(content)
        return found
    made = make()
    small = len(made.case.equations.graph) <= MOST_NODES
    if own.path is not None and small and UNASKED not in sys.modules:
        with contextlib.suppress(RecursionError):  # of what is nested too deep
            own.keep(_bytes(made))
    return made


def _made_from(asked: Asked) -> Iterator[str]:
    yield asked.text
    yield asked.file
    yield repr((sorted(asked.overrides.items()), sorted(asked.options.items())))
    yield repr((__version__, sys.version, np.__version__))
    yield _code()


@cache
def _code() -> str:
    """Tell the code of lagsim from any other: where it lies, its sizes, its ages."""
    waiting, found = [str(Path(__file__).parents[1])], []
    for folder in waiting:
        # Where there are no files to look at, the version has to do.
        with contextlib.suppress(OSError), os.scandir(folder) as entries:
            for entry in entries:
                if entry.name.endswith(".py"):
                    told = entry.stat()
                    found.append((entry.path, told.st_size, told.st_mtime_ns))
                elif entry.name != "__pycache__" and entry.is_dir():
                    waiting.append(entry.path)
    return repr(sorted(found))


class Later:
    """What a file says in numbers; loaded where somebody asks for other ones.

    See `model.Stated`.
    """

    def __init__(self, graph: Graph, content: bytes) -> None:
        self._graph, self._content = graph, content

    @cached_property
    def _stated(self) -> Stated:
        found: Stated = _Completing(self._graph, self._content).load()
        return found

    def bound(
        self, model: Model, parameters: Mapping[str, str], initial: Mapping[str, str]
    ) -> Model:
        """Give the model with other values."""
        return self._stated.bound(model, parameters, initial)

    def settings(self, options: Mapping[str, str]) -> Settings:
        """Give how the file wants to be run."""
        return self._stated.settings(options)

    def separated(self, model: Model) -> Separation:
        """Give the model in other coordinates."""
        return self._stated.separated(model)


def _bytes(session: Session) -> bytes:
    content = io.BytesIO()
    _Putting(content, session.case.equations.model).dump(session)
    return content.getvalue()


class _Putting(pickle.Pickler):
    """Puts what the file says in numbers apart."""

    def __init__(self, file: io.BytesIO, model: Model) -> None:
        super().__init__(file, _PROTOCOL)
        self._model = model

    def reducer_override(self, what: object) -> Any:
        """Give how something is made again."""
        if what is not self._model.stated:
            return NotImplemented
        content, graph = io.BytesIO(), self._model.graph
        _Without(content, graph).dump(what)
        return Later, (graph, content.getvalue())


class _Without(pickle.Pickler):
    """Leaves the graph out, which is kept once."""

    def __init__(self, file: io.BytesIO, graph: Graph) -> None:
        super().__init__(file, _PROTOCOL)
        self._graph = graph

    def persistent_id(self, what: object) -> str | None:
        """Tell the graph from all else."""
        return "graph" if what is self._graph else None


class _Completing(pickle.Unpickler):
    """Puts the graph where it was left out."""

    def __init__(self, graph: Graph, content: bytes) -> None:
        super().__init__(io.BytesIO(content))
        self._graph = graph

    def persistent_load(self, _: object) -> Graph:
        """Give the graph."""
        return self._graph
