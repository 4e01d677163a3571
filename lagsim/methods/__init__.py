"""The integration methods: one module each, registered by its presence here."""

from __future__ import annotations

import inspect
import pkgutil
import textwrap
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

from lagsim.codes.known import UNKNOWN_METHOD
from lagsim.errors import Problem
from lagsim.native.layout import Option

if TYPE_CHECKING:
    from types import ModuleType

    from lagsim.errors import Place

WIDTH = 88
# Methods with options: every start asks for all options, and most methods have none.
WITH_OPTIONS = ("generalized-alpha",)


class Structure(NamedTuple):
    """Structure of the equations of motion, by which methods accept or refuse a model.

    Attributes
    ----------
    mass_varies_with : str
        `nothing`, or the first of `velocities`, `positions`, `time` on which M depends.
    diagonal : bool
        Whether M is diagonal.
    blocks : int
        Number of groups of coordinates that M does not couple.
    constant_rows : bool
        Whether A depends on parameters only; true without constraints.
    constraints : str
        `none`, `holonomic`, `nonholonomic` or `mixed`.
    forces_free_of_velocities : bool
        Whether f does not depend on velocities.
    autonomous : bool
        Whether the equations do not depend on time.
    linear : bool
        Whether y' is affine in the state: M and A constant, f and b affine; and the
        power, if any, quadratic.
    unknowns : int
        Number of coordinates and constraints.
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
        """Whether M depends on parameters only."""
        return self.mass_varies_with == "nothing"


def unrestricted(_scene: Structure) -> str:
    """Return "": no reason to refuse a model, for methods that handle every model.

    The argument, the structure of the model, is not used.
    """
    return ""


@cache
def names() -> tuple[str, ...]:
    """Return the names of all methods, in alphabetical order.

    Examples
    --------
    >>> "dop853" in names(), "generalized-alpha" in names()
    (True, True)
    """
    modules = (m.name for m in pkgutil.iter_modules(__path__) if not m.ispkg)
    return tuple(
        sorted(name.replace("_", "-") for name in modules if not name.startswith("_"))
    )


@cache
def method(name: str) -> ModuleType:
    """Return the module of the method `name`, as `names` lists it.

    The attributes of the module are

    - NAME, TITLE, ORDER, DENSE_ORDER, ADAPTIVE, HANDLES, and a docstring that is its
      page in `lagsim methods`;
    - `refusal(scene)`: the reason why the method cannot handle a `Structure`, or "";
    - `amplification(z)`: the spectral radius of one step h for an oscillation with the
      eigenvalues z/h and their conjugate, and IMAGINARY_LIMIT, the largest |z| on the
      imaginary axis below which the radius does not exceed 1 (inf: none);
    - QUADRATURES (optional): whether y may have components after `work` that are plain
      integrals: the action, the coordinates that `reduction` eliminates;
    - STATES (optional): whether y may have first-order states;
    - EVENTS (optional): False if the steps go over switches and contacts;
    - NEEDS: names of functions of the model beyond y', see `program/functions.py`;
    - PAIR (optional): the tables of an explicit pair, for `parts.embedded`;
    - STATE, the class of its memory, PARAMETERS (optional), the class of the data from
      the model, and the kernels `start`, `step` and `interpolate`; besides, if
      ADAPTIVE, `interpolate_rates`, else `make`, which `fixed.step` calls; and
      `interpolate_rows` (optional), in place of one call of `interpolate` a row.

    A number of STATE that is declared as an `option` can be set by users: reader,
    schema, commands, Python interface and pages are derived from the declaration.

    Examples
    --------
    >>> method("rk4").ORDER
    4
    """
    return import_module(f"{__name__}.{name.replace('-', '_')}")


def options_of(name: str) -> dict[str, Option]:
    """Return the options of the method `name`, by their keys in `simulation`.

    Examples
    --------
    >>> list(options_of("generalized-alpha"))
    ['spectral_radius']
    """
    fields = method(name).STATE.fields.items()
    return {key: field for key, field in fields if isinstance(field, Option)}


@cache
def options() -> dict[str, tuple[str, Option]]:
    """Return the options of all methods by key, with the names of their methods."""
    return {
        key: (name, found)
        for name in WITH_OPTIONS
        for key, found in options_of(name).items()
    }


def method_page(name: str) -> str:
    """Return the page of the method `name`: the module's docstring, and its options."""
    parts = [inspect.cleandoc(method(name).__doc__ or "")]
    for key, x in options_of(name).items():
        text = (
            f"`{key}`, {x.least:g} to {x.most:g}, {x.default:g} unless given: {x.about}"
        )
        parts.append(textwrap.fill(f"{text}.", WIDTH))
    return "\n\n".join(parts)


# Methods of earlier versions: a file or a command that names one gets `auto`.
RETIRED = ("exponential",)
# Equivalent methods of other programs, in small letters, by method.
_ELSEWHERE = {
    "dop853": "dopri8 dop ode78 ode89 ode113 lsoda adams",
    "dopri5": "rk45 ode45 dopri dormandprince",
    "radau": "bdf ode15s ode23s dassl ida implicit",
    "verlet": "leapfrog stormer velocityverlet",
    "generalized-alpha": "newmark hht",
    "rk4": "rungekutta rungekutta4",
    "kahan-li8": "symplectic",
}


def method_problems(
    name: str, place: Place | None = None, *, auto: bool = True
) -> list[Problem]:
    """Return a list with one fault if there is no method `name`, else [].

    place : the place of the name in the file, or None.
    auto : whether "auto" counts as a method.

    Examples
    --------
    >>> method_problems("dop853")
    []
    >>> method_problems("ode45")[0].hint
    'did you mean `dopri5`? `lagsim methods` lists all'
    """
    known = [*(["auto"] if auto else []), *names()]
    if name in known:
        return []
    if name in RETIRED:
        text = f"the method `{name}` is retired"
        return [Problem(UNKNOWN_METHOD, text, place, "`auto` chooses another one")]
    import re
    from difflib import get_close_matches

    plain = re.sub(r"[\W_]", "", name.casefold())
    alike = next((own for own, x in _ELSEWHERE.items() if plain in x.split()), plain)
    near = get_close_matches(alike, known, 1) if auto else []
    hint = f"one of {', '.join(known)}; `lagsim methods` describes each"
    if near:
        hint = f"did you mean `{near[0]}`? `lagsim methods` lists all"
    return [Problem(UNKNOWN_METHOD, f"there is no method `{name}`", place, hint)]
