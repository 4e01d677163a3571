"""matplotlib without what pictures of runs do not use: a third of the time to load.

Two thirds go into docstrings and signatures that it puts together for people who read
them, and into modules of which lagsim draws nothing. In a process that runs nothing but
a command nobody reads, and nobody else draws: there stand-ins take their places while
it is loaded. Nothing of what is drawn changes, which a test sees, byte by byte. Where a
version of matplotlib does not go along, it is loaded as it is.
"""

from __future__ import annotations

import contextlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

# Projections, plots, widgets and layouts that no picture of a run has; what sets type,
# reads and writes other pictures; what these need.
UNUSED = (
    "matplotlib._blocking_input",
    "matplotlib._fontconfig_pattern",
    "matplotlib._layoutgrid",
    "matplotlib._mathtext",
    "matplotlib._pylab_helpers",
    "matplotlib.axes._secondary_axes",
    "matplotlib.backend_managers",
    "matplotlib.backend_tools",
    "matplotlib.category",
    "matplotlib.colorbar",
    "matplotlib.contour",
    "matplotlib.dates",
    "matplotlib.dviread",
    "matplotlib.inset",
    "matplotlib.layout_engine",
    "matplotlib.legend",
    "matplotlib.mathtext",
    "matplotlib.mlab",
    "matplotlib.offsetbox",
    "matplotlib.projections.geo",
    "matplotlib.projections.polar",
    "matplotlib.quiver",
    "matplotlib.stackplot",
    "matplotlib.streamplot",
    "matplotlib.table",
    "matplotlib.texmanager",
    "matplotlib.tri",
    "matplotlib.widgets",
    "mpl_toolkits",
    "mpl_toolkits.mplot3d",
    "PIL",
    "PIL.Image",
    "PIL.PngImagePlugin",
    "dateutil",
    "pyparsing",
)


def load() -> None:
    """Load matplotlib like this, unless it is there already.

    Only for processes that nobody else has a part in, and for pictures in pixels.
    """
    if "matplotlib" in sys.modules:
        return
    before = set(sys.modules)
    try:
        with _stand_ins():
            import lagsim.outputs.bare_matplotlib  # noqa: F401

            _leave_docstrings()
            import matplotlib.backends.backend_agg
            import matplotlib.figure  # noqa: F401
    except Exception:  # noqa: BLE001  whatever a version does not go along with
        for name in set(sys.modules) - before:
            # What is compiled cannot be loaded twice.
            own = name.startswith(("matplotlib", "lagsim.outputs.bare_matplotlib"))
            if own and str(getattr(sys.modules[name], "__file__", "")).endswith(".py"):
                del sys.modules[name]


@contextlib.contextmanager
def _stand_ins() -> Iterator[None]:
    """Let modules stand in for those that are not used."""
    made = {name: StandIn(name) for name in UNUSED if name not in sys.modules}
    sys.modules.update(made)
    try:
        yield
    finally:
        for name, module in made.items():
            if sys.modules.get(name) is module:
                del sys.modules[name]


class _Kind(type):
    """What has any attribute, and is empty."""

    def __getattr__(cls, name: str) -> str:
        if name.startswith("__"):
            raise AttributeError(name)
        return ""


class StandIn(ModuleType):
    """A module with a class of any name, which nothing is an instance of."""

    # Newer than whatever is asked for.
    __version__ = "999"

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.__path__: list[str] = []

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        # Projections are registered by their names.
        made = _Kind(name, (), {"name": name, "__init__": _nothing})
        setattr(self, name, made)
        return made


def _nothing(*_: object, **__: object) -> None:
    """Do nothing."""


class _Blank(dict[str, str]):
    def __missing__(self, _: str) -> str:
        return ""


class _AsItIs:
    """Leaves what it decorates as it is; for all of matplotlib's ways to write docs."""

    params = _Blank()
    register = update = staticmethod(_nothing)

    def __init__(self, *_: object, **__: object) -> None:
        pass

    def __call__(self, what: Any) -> Any:
        return what


def _leave_docstrings() -> None:
    """Let docstrings be, and signatures that are put together for readers."""
    import matplotlib as mpl
    from matplotlib import _docstring as docstring

    docs: Any = docstring
    docs.interpd = docs.dedent_interpd = _AsItIs()
    docs.Substitution = _AsItIs
    own: Any = mpl
    # It lets the first arguments of a plot be names of columns in `data=`.
    own._preprocess_data = _as_they_are  # noqa: SLF001
    from matplotlib.artist import Artist

    artists: Any = Artist
    artists._update_set_signature_and_docstring = classmethod(_marked)  # noqa: SLF001


def _as_they_are(function: Any = None, **_: object) -> Any:
    return _AsItIs() if function is None else function


def _marked(kind: Any) -> None:
    """Say that `set` of a kind of artists is not its own."""
    kind.set._autogenerated_signature = True  # noqa: SLF001
