"""Lagrange's equations in sympy, term by term.

Derived a second time here, from tidy energies, because the graph's derivatives are
exact and fast but not short; tests hold the two to each other.
Source: H. P. Gavin, Generalized Coordinates, Lagrange's Equations, and Constraints,
eqs 34-47 and 61.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import sympy as sp

from lagsim import limits
from lagsim.derivation.conserved import conserved_quantities
from lagsim.derivation.content import Condition, Content, Force, Line
from lagsim.derivation.gauss import gauss
from lagsim.derivation.solving import solution
from lagsim.derivation.translation import Translation
from lagsim.model.model import Level

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Constraint


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
        model = x.equations.model
        energies = [model.kinetic, model.potential, model.dissipation]
        self.kinetic, self.potential, self.dissipation = x.sympy(energies)
        if self.kinetic is None or self.potential is None:
            self.lagrangian = x.sympy([model.lagrangian])[0]
        else:
            self.lagrangian = self.kinetic - self.potential
        self.forces = [self._force(k) for k in range(len(model.forces))]
        self.constraints = [self._condition(c) for c in model.constraints]
        self.lines = [self._line(j) for j in range(len(x.q))]

    def content(self, *, solve: bool, with_gauss: bool) -> Content:
        x = self.x
        M = [[x.tidy(sp.diff(line.momentum, v)) for v in x.v] for line in self.lines]
        f = [self._f(j) for j in range(len(x.q))]
        conserved = conserved_quantities(
            x, self.lagrangian, self.lines, self.constraints
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

    def _force(self, k: int) -> Force:
        x = self.x
        force = x.equations.model.forces[k]
        p, direction = x.sympy([force.node, force.direction])
        velocity = force.level is not Level.POSITION
        variables = x.v if velocity else x.q
        shares = tuple(x.tidy(p * x.slope(direction, s)) for s in variables)
        return Force(force.on, p, direction, velocity, shares)

    def _line(self, j: int) -> Line:
        """Work out the equation of coordinate j."""
        x, tidy = self.x, self.x.tidy
        v = x.v[j]
        terms: dict[str, Any] = {}
        if self.kinetic is None or self.potential is None:
            terms["ddt_dL_dqdot"] = tidy(x.rate(tidy(sp.diff(self.lagrangian, v))))
            terms["dL_dq"] = tidy(x.slope(self.lagrangian, x.q[j]))
            inertia = terms["ddt_dL_dqdot"] - terms["dL_dq"]
        else:
            terms["ddt_dT_dqdot"] = tidy(x.rate(tidy(sp.diff(self.kinetic, v))))
            terms["dT_dq"] = tidy(x.slope(self.kinetic, x.q[j]))
            inertia = terms["ddt_dT_dqdot"] - terms["dT_dq"]
            magnetic = tidy(x.rate(tidy(sp.diff(self.potential, v))))
            if magnetic != 0:
                terms["ddt_dV_dqdot"] = magnetic
            terms["dV_dq"] = tidy(x.slope(self.potential, x.q[j]))
            inertia += terms["dV_dq"] - magnetic
        Q = tidy(sp.Add(*(f.shares[j] for f in self.forces), -self._loss(j)))
        terms["Q"] = Q
        driving, rest = self._driving(Q)
        holding = (
            c.A[j] * s for c, s in zip(self.constraints, x.multipliers, strict=True)
        )
        return Line(
            coordinate=x.q[j].name,
            momentum=tidy(sp.diff(self.lagrangian, v)),
            terms=terms,
            left=tidy(inertia - rest),
            right=tidy(driving + sp.Add(*holding)),
        )

    def _loss(self, j: int) -> Any:
        if self.dissipation is None:
            return sp.S.Zero
        return sp.diff(self.dissipation, self.x.v[j])

    def _driving(self, Q: Any) -> tuple[Any, Any]:
        """Part Q into what stands right, given in time, and what stands left."""
        state = {*self.x.q, *self.x.v}
        parts = sp.Add.make_args(Q)
        driving = [p for p in parts if not self.x.free(p) & state]
        return sp.Add(*driving), sp.Add(*(p for p in parts if p not in driving))

    def _f(self, j: int) -> Any:
        x, line = self.x, self.lines[j]
        drift = x.drift(line.momentum)
        return x.tidy(x.slope(self.lagrangian, x.q[j]) - drift + line.terms["Q"])

    def _condition(self, constraint: Constraint) -> Condition:
        x, tidy = self.x, self.x.tidy
        function = x.sympy([constraint.relation.node])[0]
        holonomic = not x.free(function) & set(x.v)
        if holonomic:
            A = tuple(tidy(x.slope(function, q), factored=True) for q in x.q)
            rate = tidy(x.rate(function))
        else:
            A = tuple(tidy(sp.diff(function, v), factored=True) for v in x.v)
            rate = function
        kind = "holonomic" if holonomic else "nonholonomic"
        return Condition(
            name=constraint.name,
            kind=kind if constraint.law is None else "one-sided",
            function=function,
            rate=rate,
            acceleration=tidy(x.rate(rate)),
            A=A,
            b=tidy(-x.drift(rate)),
            law=self._law(constraint),
        )

    def _law(self, constraint: Constraint) -> dict[str, Any]:
        law = constraint.law
        found = {"limit": constraint.limit, "when": constraint.when}
        if law is None:
            return self._given(found)
        slips = {"slip": tuple(self.x.sympy(law.slips))} if law.slips else {}
        found = {"friction": law.friction, "static": law.static, **found}
        return {"restitution": law.restitution, **self._given(found), **slips}

    def _given(self, nodes: Mapping[str, int | None]) -> dict[str, Any]:
        found = zip(nodes, self.x.sympy(nodes.values()), strict=True)
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
