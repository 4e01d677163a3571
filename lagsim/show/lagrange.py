"""Lagrange's equations term by term: derived on the graph, tidied in sympy.

Source: H. P. Gavin, Generalized Coordinates, Lagrange's Equations, and Constraints,
eqs 34-47 and 61.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import sympy as sp

from lagsim import limits
from lagsim.language.derivatives import gradient, tangent
from lagsim.mechanics.constraints import Flow, constraint_row
from lagsim.mechanics.equations import generalized_forces, mass_matrix
from lagsim.model.model import Level
from lagsim.show.conserved import conserved_quantities
from lagsim.show.content import Condition, Content, Force, Line
from lagsim.show.solution import gauss, solution
from lagsim.show.symbols import Translation

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Constraint
    from lagsim.model.model import Force as ModelForce


def content(
    equations: Equations,
    *,
    substitute: bool = False,
    solve: bool = False,
    with_gauss: bool = False,
) -> Content:
    """Derive everything that is told.

    Parameters
    ----------
    equations
        The model.
    substitute
        Put the numbers of the parameters in.
    solve
        Give the accelerations in closed form, however long.
    with_gauss
        Give Gauss's principle too.

    Raises
    ------
    InputError
        Where the energies are too long to be written out, or M is singular and Gauss's
        principle is asked for.
    """
    x = Translation(equations, substitute=substitute)
    return _Derivation(x).content(solve=solve, with_gauss=with_gauss)


class _Derivation:
    def __init__(self, x: Translation) -> None:
        self.x = x
        e, g, model = x.equations, x.g, x.equations.model
        self.flow = Flow(g, e.q, e.velocities)
        rates = self.flow.rates
        accelerations = map(g.variable, e.accelerations)
        self.forward = self.flow.forward | dict(zip(rates, accelerations, strict=True))
        energies = [model.kinetic, model.potential, model.dissipation]
        self.kinetic, self.potential, self.dissipation = x.sympy(energies, written=True)
        if model.kinetic is None or model.potential is None:
            self.lagrangian = x.sympy([model.lagrangian], written=True)[0]
            self.slopes = {"L": self._slopes(self.lagrangian, model.lagrangian)}
            self.slope = self.slopes["L"]
        else:
            self.lagrangian = self.kinetic - self.potential
            T = self._slopes(self.kinetic, model.kinetic)
            V = self._slopes(self.potential, model.potential)
            self.slopes = {"T": T, "V": V}
            self.slope = [g.call("sub", a, b) for a, b in zip(T, V, strict=True)]
        n = len(e.q)
        self.momenta = self._tidied(self.slope[:n])
        self.drifts = tangent(g, self.momenta, self.flow.forward)
        self.rates = {
            letter: tangent(g, slopes[:n], self.forward)
            for letter, slopes in self.slopes.items()
        }
        self.Q = generalized_forces(g, model, self.flow)
        self.forces = [self._force(force) for force in model.forces]
        self.constraints = [self._condition(c) for c in model.constraints]
        self.lines = [self._line(j) for j in range(n)]

    def _slopes(self, e: Any, original: int) -> list[int]:
        """Give the slopes of an energy in the velocities, the coordinates and t."""
        x, flow = self.x, self.flow
        variables = [*flow.rates, *flow.positions, x.g.variable("t")]
        return self._tidied(gradient(x.g, x.node(e, original), variables))

    def _tidied(self, nodes: Sequence[int]) -> list[int]:
        """Give nodes of the tidy forms of `nodes`, whose slopes are short."""
        tidy = self.x.sympy(nodes)
        return [self.x.node(e, n) for e, n in zip(tidy, nodes, strict=True)]

    def content(self, *, solve: bool, with_gauss: bool) -> Content:
        x, n = self.x, len(self.lines)
        entries = mass_matrix(x.g, self.momenta, self.flow.rates)
        lower = [x.sympy(row[: i + 1]) for i, row in enumerate(entries)]
        M = [[lower[max(i, j)][min(i, j)] for j in range(n)] for i in range(n)]
        sums = zip(self.slope[n:], self.drifts, self.Q, strict=False)
        f = x.sympy(x.g.call("add", x.g.call("sub", a, b), Q) for a, b, Q in sums)
        (dL_dt,) = x.sympy(self.slope[-1:])
        conserved = conserved_quantities(
            x, self.lagrangian, dL_dt, self.slope[n:-1], self.lines, self.constraints
        )
        notes = _on_contacts(self.constraints)
        solved = solution(x, M, f, self.constraints, notes, insist=solve)
        principle = None
        if with_gauss:
            principle = gauss(x, M, f, self.constraints, notes)
        if x.tidy.cut:
            notes.append(
                "some expressions are longer than they might be: simplification was "
                f"cut after {x.tidy.budget} operations on each"
            )
        if x.tidy.late:
            notes.append(
                "expressions are not simplified further, because simplification "
                f"has taken {limits.TIDYING_SECONDS:.3g} s; a second derivation "
                "may write them differently"
            )
        return Content(
            translation=x,
            kinetic=self.kinetic,
            potential=self.potential,
            lagrangian=x.tidy(self.lagrangian, written=True),
            dissipation=self.dissipation,
            forces=tuple(self.forces),
            lines=tuple(self.lines),
            M=tuple(map(tuple, M)),
            f=tuple(f),
            constraints=tuple(self.constraints),
            conserved=tuple(conserved),
            solution=solved,
            gauss=principle,
            notes=tuple(notes),
        )

    def _force(self, force: ModelForce) -> Force:
        x, g = self.x, self.x.g
        p, direction = x.sympy([force.node, force.direction], written=True)
        velocity = force.level is not Level.POSITION
        levers = self.flow.gradient(g, force.direction, by_rates=velocity)
        shares = x.sympy(g.call("mul", force.node, lever) for lever in levers)
        return Force(force.on, p, direction, velocity, tuple(shares))

    def _line(self, j: int) -> Line:
        """Work out the equation of coordinate j."""
        x, n = self.x, len(self.x.q)
        terms: dict[str, Any] = {}
        left = []
        for letter, slopes in self.slopes.items():
            sign = -1 if letter == "V" else 1
            rate, slope = x.sympy((self.rates[letter][j], slopes[n + j]))
            if letter != "V" or rate != 0:
                terms[f"ddt_d{letter}_dqdot"] = rate
            terms[f"d{letter}_dq"] = slope
            left += [sign * rate, -sign * slope]
        (Q,) = x.sympy([self.Q[j]])
        terms["Q"] = Q
        driving, rest = self._driving(Q)
        holding = (
            c.A[j] * s for c, s in zip(self.constraints, x.multipliers, strict=True)
        )
        return Line(
            coordinate=x.q[j].name,
            momentum=x.sympy([self.momenta[j]])[0],
            terms=terms,
            left=x.tidy(sp.Add(*left, -rest)),
            right=x.tidy(driving + sp.Add(*holding)),
        )

    def _driving(self, Q: Any) -> tuple[Any, Any]:
        """Part Q into what stands right, given in time, and what stands left."""
        state = {*self.x.q, *self.x.v}
        parts = sp.Add.make_args(Q)
        driving = [p for p in parts if not self.x.free(p) & state]
        return sp.Add(*driving), sp.Add(*(p for p in parts if p not in driving))

    def _condition(self, constraint: Constraint) -> Condition:
        x, g = self.x, self.x.g
        node = constraint.relation.node
        (function,) = x.sympy([node], written=True)
        row = constraint_row(g, constraint.name, x.node(function, node), self.flow)
        A = tuple(x.tidy(entry, factored=True) for entry in x.sympy(row.A))
        (rate,) = x.sympy([row.rate])
        (drift,) = x.sympy(tangent(g, [x.node(rate, row.rate)], self.flow.forward))
        moved = sp.Add(*(entry * a for entry, a in zip(A, x.a, strict=True)))
        kind = "holonomic" if row.holonomic else "nonholonomic"
        return Condition(
            name=constraint.name,
            kind=kind if constraint.law is None else "one-sided",
            function=function,
            rate=rate if row.holonomic else function,
            acceleration=x.tidy(moved + drift),
            A=A,
            b=x.tidy(-drift),
            law=self._law(constraint),
        )

    def _law(self, constraint: Constraint) -> dict[str, Any]:
        law = constraint.law
        found = {"limit": constraint.limit, "when": constraint.when}
        if law is None:
            return self._given(found)
        slips = {"slip": tuple(self.x.sympy(law.slips, written=True))}
        found = {"friction": law.friction, "static": law.static, **found}
        given = {"restitution": law.restitution, **self._given(found)}
        return {**given, **slips} if law.slips else given

    def _given(self, nodes: Mapping[str, int | None]) -> dict[str, Any]:
        found = zip(nodes, self.x.sympy(nodes.values(), written=True), strict=True)
        return {key: e for key, e in found if e is not None}


def _on_contacts(constraints: Sequence[Condition]) -> list[str]:
    """Say what the equations of a model with contacts do not show."""
    notes = []
    if any(c.kind == "one-sided" for c in constraints):
        notes.append("the multiplier of a contact is 0 while it is open")
    if any("friction" in c.law for c in constraints):
        notes.append(
            "friction is not in these equations: it acts along the slopes of the slip "
            "with respect to the velocities, against the slip, with at most the "
            "friction coefficient times the multiplier"
        )
    return notes
