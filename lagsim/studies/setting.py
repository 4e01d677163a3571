"""Setting of the search for rests: the model at its start, with all constraints frozen.

Limited equalities that slide at rest, as on a moving belt, are forces there.
"""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.point import Point
from lagsim.admissibility.rest import sliding_limits
from lagsim.admissibility.verdict import out_of_force, with_timed
from lagsim.codes.known import FROZEN_TIME
from lagsim.mechanics.derivation import may_gather
from lagsim.mechanics.equations import Instant
from lagsim.mechanics.reduction import equations_of_motion
from lagsim.notes import Caution
from lagsim.run.session import after_start_events

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.admissibility.examination import StartReport
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model


class Setting(NamedTuple):
    """Model at the time of its start, with all constraints constant in time.

    Attributes
    ----------
    model : Model
    equations : Equations
        The equations, with the equalities in force at the start among the rows.
    report : StartReport
        The examination of the start.
    off : frozenset of str
        Constraints that are out of force.
    sliding : mapping of str to int
        Multipliers of limited equalities that slide at rest, by the name of the row:
        nodes. They are forces of the equations, and their constraints are in `off`.
    """

    model: Model
    equations: Equations
    report: StartReport
    off: frozenset[str]
    sliding: Mapping[str, int] = MappingProxyType({})

    @property
    def start(self) -> Instant:
        """The admissible state nearest to the start; without one, the stated state."""
        at = self.report.state
        return Instant(at.t, at.q, at.v, at.s)

    @property
    def point(self) -> Point:
        """The positions of the start, with velocities 0."""
        at = self.start
        still = Instant(at.t, at.q, np.zeros_like(at.v), at.s)
        return Point(self.equations, still)

    @property
    def cautions(self) -> list[Caution]:
        """A warning where the equations depend on time."""
        e, g = self.equations, self.equations.graph
        nodes = [c.relation.node for c in self.model.constraints]
        if "t" not in g.depends([*nodes, self.model.lagrangian, *e.of_accelerations]):
            return []
        text = f"the equations depend on t: they are those of t = {self.start.t:g}"
        return [Caution(FROZEN_TIME, text)]


def setting_of(model: Model) -> Setting:
    """Derive the equations of a model with frozen constraints; examine its start.

    Raises
    ------
    InputError
        If energies or forces are not finite at the start.
    """
    settings = model.settings()
    gathers = may_gather(model)
    model = model if gathers else model.written_out()
    still = _frozen(model, settings.start)
    equations, report = after_start_events(
        equations_of_motion(still, gathers=gathers), settings
    )
    off = out_of_force(equations, settings.start)
    return Setting(model, with_timed(equations, off), report, off)


def with_sliding(setting: Setting) -> Setting:
    """Return the setting with limited equalities that slide at rest as forces."""
    found = sliding_limits(setting.point, setting.off)
    return setting._replace(
        equations=found.equations, off=found.off, sliding=found.multipliers
    )


def _frozen(model: Model, time: float) -> Model:
    """Return the model with moving constraints frozen at a time."""
    g = model.graph
    nodes = [c.relation.node for c in model.constraints]
    if "t" not in g.depends(nodes):
        return model
    new = g.substitute(nodes, {g.variable("t"): g.constant(time)})
    constraints = tuple(
        c._replace(relation=c.relation._replace(node=node))
        for c, node in zip(model.constraints, new, strict=True)
    )
    return replace(model, constraints=constraints)
