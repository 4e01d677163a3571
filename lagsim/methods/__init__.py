"""The integration methods: one file each, registered by being there."""

from __future__ import annotations

import pkgutil
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING

from lagsim.errors import Problem

if TYPE_CHECKING:
    from types import ModuleType

    from lagsim.errors import Place


@cache
def names() -> tuple[str, ...]:
    """Give the names of all methods, in alphabetical order."""
    modules = (m.name for m in pkgutil.iter_modules(__path__) if not m.ispkg)
    return tuple(
        sorted(name.replace("_", "-") for name in modules if not name.startswith("_"))
    )


@cache
def method(name: str) -> ModuleType:
    """Give the module of a method.

    It has

    - NAME, TITLE, ORDER, DENSE_ORDER, ADAPTIVE, HANDLES, and a docstring that is its
      page in `lagsim methods`;
    - `refusal(scene)`: why it cannot handle a `Structure`, or "";
    - `amplification(z)`: the spectral radius of one step h of an oscillation with the
      eigenvalues z/h and their conjugate, and IMAGINARY_LIMIT, the largest |z| on the
      imaginary axis below which it does not exceed 1 (inf: none);
    - QUADRATURES (optional): whether y may have components after `work`, whose rates
      are integrated as they are: the action, the coordinates that `reduction` leaves;
    - EVENTS (optional): False where its steps go over switches and contacts;
    - NEEDS: names of functions of the model beyond y', see `system.functions`;
    - STATE, the class of the memory it keeps, and the kernels `start`, `step` and
      `interpolate`; where ADAPTIVE, `interpolate_rates` as well.
    """
    return import_module(f"{__name__}.{name.replace('-', '_')}")


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
    """Give the fault of a method that does not exist; `auto` may leave the choice."""
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
