"""The kernels of a run by a method, and the constants that each is compiled for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from lagsim.methods import method
from lagsim.methods.parts import driver, missed, no_search, one_by_one, search
from lagsim.native.link.cache import kernel_part
from lagsim.program.signatures import AT_SECTIONS

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from lagsim.mechanics.equations import Equations
    from lagsim.mechanics.linearisation import NewtonMatrix
    from lagsim.native.link.cache import ProgramPart
    from lagsim.plan.plan import Plan
    from lagsim.program.localized import Indicator
    from lagsim.program.output_row import Columns
    from lagsim.program.patterns import Pattern

# The constants that the loop of steps depends on, and the search of a step for events.
OF_DRIVER = ("CONSTRAINED", "SWITCHES", "ADAPTIVE")
OF_STEP = ("UNTIL", "SWITCHES", "LOCALIZED")
OF_SEARCH = ("CONSTRAINED", *OF_STEP, "RATED")


class SystemProperties(Protocol):
    """The properties of a system on which its kernels depend, see `system.System`."""

    equations: Equations
    plan: Plan
    m: int
    watched: int
    indicators: list[Indicator]
    newton: NewtonMatrix | None
    columns: Columns
    moreau: Pattern | None
    together: bool


def statics(system: SystemProperties, name: str) -> dict[str, object]:
    """Return the constants at compile time of all kernels of a run, by their names.

    name : the name of the method.
    """
    return {
        "CONSTRAINED": system.m > 0 and system.plan.projected,
        "UNTIL": bool(system.equations.model.located),
        "SWITCHES": system.watched > 0,
        "LOCALIZED": bool(system.indicators),
        "ADAPTIVE": method(name).ADAPTIVE,
        "RATED": system.moreau is None,
    }


def of_method(system: SystemProperties, name: str) -> ProgramPart:
    """Return the kernels of a method.

    name : the name of the method.
    """
    by, known = method(name), statics(system, name)
    known |= {"SPARSE": system.newton is not None, "PAIR": getattr(by, "PAIR", None)}
    del known["ADAPTIVE"]
    kernels = [by.start, by.step, by.interpolate]
    kernels.append(by.interpolate_rates if by.ADAPTIVE else by.make)
    if hasattr(by, "interpolate_rows"):
        kernels.append(by.interpolate_rows)
    return kernel_part(kernels, _chosen(known, filter(vars(by).__contains__, known)))


def of_steps(system: SystemProperties, name: str) -> Iterator[ProgramPart]:
    """Yield the loop of steps, and the searches of a step that it calls.

    name : the name of the method.
    """
    known, none = statics(system, name), dict.fromkeys(OF_STEP, False)
    yield kernel_part([driver.advance], _chosen(known, OF_DRIVER))
    if not hasattr(method(name), "interpolate_rows"):
        yield kernel_part([one_by_one.interpolate_rows])
    if known["UNTIL"] or known["SWITCHES"]:
        yield kernel_part([search.find_end], _chosen(known, OF_SEARCH))
    else:
        yield kernel_part([no_search.find_end])
    if known["CONSTRAINED"]:
        yield kernel_part([search.loses_rank], none)
    if known["ADAPTIVE"] and known["LOCALIZED"]:
        known = none | _chosen(known, ["SWITCHES", "LOCALIZED"])
        yield kernel_part([search.missed_feature, missed.check_features], known)
    elif known["ADAPTIVE"]:
        yield kernel_part([no_search.missed_feature, no_search.check_features])


def of_output(system: SystemProperties, name: str) -> Iterator[ProgramPart]:
    """Yield the kernels of columns and of sections.

    name : the name of the method.
    """
    kernels: list[Callable[..., Any]] = [driver.tabulate]
    if system.columns.wants_sections:
        known = _chosen(statics(system, name), OF_SEARCH)
        yield kernel_part([search.find_crossings, *AT_SECTIONS], known)
    else:
        kernels.append(no_search.find_crossings)
    yield kernel_part(kernels, {"TOGETHER": system.together})


def _chosen(known: dict[str, object], names: Iterable[str]) -> dict[str, object]:
    return {name: known[name] for name in names}
