"""The equations of motion, to read, to print and to compute with."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

from lagsim.api.models import model_of
from lagsim.mechanics import equations
from lagsim.show.as_python import as_python
from lagsim.version import __version__

if TYPE_CHECKING:
    from pathlib import Path

    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model as Read
    from lagsim.show.content import Content


class Derivation:
    """The equations of a model, in each format of `lagsim derive`.

    Made when they are asked for. A notebook shows them typeset.
    """

    def __init__(self, equations: Equations, options: dict[str, bool]) -> None:
        self._equations, self._options = equations, options

    @cached_property
    def _content(self) -> Content:
        from lagsim.show.lagrange import content

        return content(self._equations, **self._options)

    @cached_property
    def text(self) -> str:
        """Text for a terminal."""
        return self.as_text()

    def as_text(self, *, ascii_only: bool = False) -> str:
        """Return text for a terminal; in ASCII, as in model files, if so asked."""
        from lagsim.show.text import as_text

        return as_text(self._content, ascii_only=ascii_only)

    @cached_property
    def latex(self) -> str:
        """A document that LaTeX compiles."""
        from lagsim.show.latex import as_latex

        return as_latex(self._content)

    @cached_property
    def markdown(self) -> str:
        """Text with formulas, as notebooks typeset them."""
        from lagsim.show.latex import as_markdown

        return as_markdown(self._content)

    @cached_property
    def json(self) -> dict[str, Any]:
        """The expressions, by name."""
        from lagsim.show.as_json import as_json

        return as_json(self._content)

    @cached_property
    def python(self) -> str:
        """A module with mass matrix, forces and constraints, without lagsim."""
        return as_python(self._equations, __version__)

    def __str__(self) -> str:
        return self.text

    def __repr__(self) -> str:
        return f"<Derivation of {self._equations.model.name}>"

    def _repr_markdown_(self) -> str:
        return self.markdown


def derive(
    model: Read | str | Path,
    *,
    substitute: bool = False,
    solve: bool = False,
    gauss: bool = False,
) -> Derivation:
    """Derive the equations of motion of a model.

    Parameters
    ----------
    model
        What `load` gives, a path, or the text of a model file.
    substitute
        Put the numbers of the parameters in.
    solve
        Give the accelerations in closed form, however long.
    gauss
        Give Gauss's principle, too.

    Raises
    ------
    InputError
        Where the model has faults.
    """
    options = {"substitute": substitute, "solve": solve, "with_gauss": gauss}
    return Derivation(equations.derive(model_of(model), chained=False), options)
