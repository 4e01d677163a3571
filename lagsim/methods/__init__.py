"""The integration methods: one file each, registered by being there."""

from __future__ import annotations

import inspect
import pkgutil
import textwrap
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from lagsim.errors import Problem
from lagsim.native.layout import Option

if TYPE_CHECKING:
    from types import ModuleType

    from lagsim.errors import Place

WIDTH = 88


class Structure(NamedTuple):
    """Structure of the equations of motion.

    Attributes
    ----------
    mass_varies_with : str
        `nothing`, or the first of `velocities`, `positions`, `time` that M depends on.
    diagonal : bool
        M is.
    blocks : int
        Of M: groups of coordinates that it does not couple.
    constant_rows : bool
        A is made of parameters only, as it is without constraints.
    constraints : str
        `none`, `holonomic`, `nonholonomic` or `mixed`.
    forces_free_of_velocities : bool
        f is.
    autonomous : bool
        Time does not stand in the equations.
    linear : bool
        y' is affine in the state: M and A constant, f and b affine; and the power,
        where there is one, quadratic.
    unknowns : int
        Coordinates and constraints.
    """

    mass_varies_with: str
    diagonal: bool
    blocks: int
    constant_rows: bool
    constraints: str
    forces_free_of_velocities: bool
    autonomous: bool
    linear: bool
    unknowns: int

    @property
    def constant_mass(self) -> bool:
        """M is made of parameters only."""
        return self.mass_varies_with == "nothing"


def unrestricted(_scene: Structure) -> str:
    """No refusal, "": the method handles every scene."""
    return ""


@cache
def names() -> tuple[str, ...]:
    """Return the names of all methods, in alphabetical order."""
    modules = (m.name for m in pkgutil.iter_modules(__path__) if not m.ispkg)
    return tuple(
        sorted(name.replace("_", "-") for name in modules if not name.startswith("_"))
    )


@cache
def method(name: str) -> ModuleType:
    """Return the module of a method.

    It has

    - NAME, TITLE, ORDER, DENSE_ORDER, ADAPTIVE, HANDLES, and a docstring that is its
      page in `lagsim methods`;
    - `refusal(scene)`: why it cannot handle a `Structure`, or "";
    - `amplification(z)`: the spectral radius of one step h of an oscillation with the
      eigenvalues z/h and their conjugate, and IMAGINARY_LIMIT, the largest |z| on the
      imaginary axis below which it does not exceed 1 (inf: none);
    - QUADRATURES (optional): whether y may have components after `work`, whose rates
      are integrated as they are: the action, the coordinates that `reduction` leaves;
    - STATES (optional): whether y may have first-order states;
    - EVENTS (optional): False where its steps go over switches and contacts;
    - NEEDS: names of functions of the model beyond y', see `program/functions.py`;
    - STATE, the class of the memory it keeps, PARAMETERS (optional), that of what the
      model gives it, and the kernels `start`, `step` and `interpolate`; besides, where
      ADAPTIVE, `interpolate_rates`, and else `make`, around which `fixed.step` is.

    A number of STATE that is declared as an `option` is one that users choose: reader,
    schema, commands, Python interface and pages know of it by that.
    """
    return import_module(f"{__name__}.{name.replace('-', '_')}")


def options_of(name: str) -> dict[str, Option]:
    """Options of a method, by the keys of `simulation`."""
    fields = method(name).STATE.fields.items()
    return {key: field for key, field in fields if isinstance(field, Option)}


@cache
def options() -> dict[str, tuple[str, Option]]:
    """Options of all methods, each with the name of the method."""
    return {
        key: (name, found)
        for name in names()
        for key, found in options_of(name).items()
    }


def page(name: str) -> str:
    """Page on a method: its docstring, and its options."""
    parts = [inspect.cleandoc(method(name).__doc__ or "")]
    for key, x in options_of(name).items():
        text = (
            f"`{key}`, {x.least:g} to {x.most:g}, {x.default:g} unless given: {x.about}"
        )
        parts.append(textwrap.fill(f"{text}.", WIDTH))
    return "\n\n".join(parts)


# Methods, and those of other programs, in small letters, that do the same.
_ELSEWHERE = {
    "dop853": "rk45 ode45 ode113 dopri dopri5 lsoda adams",
    "radau": "bdf ode15s ode23s dassl ida implicit",
    "verlet": "leapfrog stormer velocityverlet",
    "generalized-alpha": "newmark hht",
    "rk4": "rungekutta rungekutta4",
    "kahan-li8": "symplectic",
}


def method_problems(
    asked: str, place: Place | None = None, *, auto: bool = True
) -> list[Problem]:
    """Fault of a method that does not exist; `auto` may leave the choice."""
    known = [*(["auto"] if auto else []), *names()]
    if asked in known:
        return []
    import re
    from difflib import get_close_matches

    plain = re.sub(r"[\W_]", "", asked.casefold())
    alike = next((own for own, x in _ELSEWHERE.items() if plain in x.split()), plain)
    near = get_close_matches(alike, known, 1) if auto else []
    hint = f"one of {', '.join(known)}; `lagsim methods` describes them"
    if near:
        hint = f"did you mean `{near[0]}`? `lagsim methods` lists all"
    return [Problem("unknown-method", f"there is no method `{asked}`", place, hint)]
