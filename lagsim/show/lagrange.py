"""Lagrange's equations term by term: derived on the graph, tidied in sympy.

Source: H. P. Gavin, Generalized Coordinates, Lagrange's Equations, and Constraints,
eqs 34-47 and 61.

Accelerations and multipliers in closed form: M q'' = f + A^T lambda (mass matrix M,
forces f, constraint rows A) is solved block by block, each by its adjugate, where that
is short enough to read. Where it is too long and a closed form is insisted on, the
elimination is given step by step.

By Gauss's principle of least constraint, q'' minimises G = (q'' - a)^T M (q'' - a)/2
subject to A q'' = b, where M a = f. The constraint forces are Qc = K (A a - b) with the
gain K = -A^T (A M^-1 A^T)^-1. It is given for equality constraints that always hold
(Gavin, section 13, eqs 70-73; its multipliers are minus ours).
"""

from __future__ import annotations

from collections import Counter
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import sympy as sp

from lagsim import limits
from lagsim.codes.known import SINGULAR_MASS
from lagsim.errors import unusable
from lagsim.language.derivatives import gradient, tangent
from lagsim.language.evaluate import evaluate_rows
from lagsim.language.sparse import TooLongError
from lagsim.mechanics.constraints import constraint_row
from lagsim.mechanics.derivation import mass_matrix
from lagsim.mechanics.forces import generalized_forces
from lagsim.mechanics.ldl import Elimination
from lagsim.model.model import Level
from lagsim.show import RESTITUTION_LAW, Content, always, law_of
from lagsim.show.conserved import conserved_quantities, evident
from lagsim.show.members import MemberSums
from lagsim.show.names import PrintedName
from lagsim.show.separation import Separation, is_long, refuse_long, words_of
from lagsim.show.symbols import Translation, number, symbol, to_sympy
from lagsim.show.tidy import MOST_PRODUCTS, written_size
from lagsim.tolerances import DEPENDENT_ROWS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.mechanics.constraints import Row
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Constraint, Force, Transition


Matrix = list[list[Any]]
Part = dict[str, Any]
"""Of the document."""
Inverse = list[tuple[list[int], Matrix, Any]]
"""Blocks: their indices, adjugates and determinants."""

# Largest number of symbols and operations in an acceleration that is printed in closed
# form.
READABLE = 130
# Largest block whose adjugate is printed.
LARGEST_BLOCK = 3


class _Solver:
    """Solution of M q'' = f + A^T lambda, A q'' = b in closed form, if that is short.

    For each part that is too long, a note for the reader is added to `notes`.

    Parameters
    ----------
    x : Translation
    document : mapping
        The equations, with the entries M, f and constraints.
    notes : list of str
        The list that receives the notes.
    """

    def __init__(self, x: Translation, document: Part, notes: list[str]) -> None:
        self.x, self.M, self.f = x, document["M"], document["f"]
        self.constraints, self.notes = document["constraints"], notes
        self.in_words = "separated" in document
        self.equalities = [k for k in self.constraints if always(k)]
        self.come_and_go = len(self.equalities) < len(self.constraints)

    @cached_property
    def inverse(self) -> Inverse | None:
        """Inverse of M."""
        return _inverted(self.x, self.M)

    @cached_property
    def gram(self) -> Inverse | None:
        """Inverse of A M^-1 A^T, for the constraints that always hold."""
        x, inverse = self.x, self.inverse
        if inverse is None or len(self.equalities) > LARGEST_BLOCK:
            return None
        rows = [k["A"] for k in self.equalities]
        moved = [_solved(x, inverse, row) for row in rows]
        return _inverted(
            x, [[x.tidy(_dot(row, z), factored=True) for z in moved] for row in rows]
        )

    def solution(self, *, insist: bool) -> Part | None:
        """Return accelerations and multipliers in closed form, or None if too long.

        insist : whether the elimination step by step is returned in place of None.
        """
        # Closed forms in numbered steps are not readable.
        found = None if self.in_words else self._closed()
        if found and _readable((*found["q_ddot"], *found["lambda"])):
            return found
        if without_inertia(self.x.equations) is not None:
            why = "M is not positive definite: it is not solved for the accelerations"
        elif self.come_and_go:
            contact = any(k["kind"] == "one-sided" for k in self.constraints)
            noun = "contacts" if contact else "constraints"
            why = f"the accelerations are left out: {noun} hold at times"
        elif not insist:
            why = "the accelerations are too long to be read; `--solve` prints them"
        else:
            try:
                return self._stepwise()
            except TooLongError:
                why = (
                    "the accelerations in closed form take thousands of steps; "
                    "`--format python` gives the functions that are solved for them"
                )
        self.notes.append(why)
        return None

    def _closed(self) -> Part | None:
        # Each multiplier is in some acceleration, or is eliminated with the others.
        most = READABLE * len(self.f) if self.come_and_go else LARGEST_BLOCK
        if len(self.constraints) > most or self.inverse is None:
            return None
        right = [
            fj + _dot([k["A"][j] for k in self.constraints], self.x.multipliers)
            for j, fj in enumerate(self.f)
        ]
        accelerations = _solved(self.x, self.inverse, right)
        multipliers: list[Any] = []
        if self.equalities and not self.come_and_go:
            if self.gram is None:
                return None
            free = _solved(self.x, self.inverse, self.f)
            missed = (k["b"] - _dot(k["A"], free) for k in self.equalities)
            right = [self.x.tidy(e, factored=True) for e in missed]
            multipliers = _solved(self.x, self.gram, right)
        return {"steps": {}, "q_ddot": accelerations, "lambda": multipliers}

    def _stepwise(self) -> Part:
        """Return accelerations and multipliers by numbered steps of an elimination.

        Each expression that is used more than once is a step with a name.
        """
        x, e, g = self.x, self.x.equations, self.x.g
        elimination = Elimination(e)
        known = dict(x.known)
        for entries, values in zip((*e.M, e.f), (*self.M, self.f), strict=True):
            known |= dict(zip(entries, values, strict=True))
        for row, k in zip(e.rows, self.constraints, strict=True):
            known |= dict(zip(row.A, k["A"], strict=True)) | {row.b: k["b"]}
        known |= {g.constant(v): number(v) for v in (0.0, 1.0)}
        found = elimination.motion()
        steps = _steps(x, known, [n for nodes in found for n in nodes])
        q_ddot, multipliers = ([known[n] for n in nodes] for nodes in found)
        return {"steps": steps, "q_ddot": q_ddot, "lambda": multipliers}

    def gauss(self) -> Part:
        """Return Gauss's principle as a part of the document.

        Raises
        ------
        InputError
            Where M is singular, so that there is no unconstrained acceleration.
        """
        x = self.x
        if self.come_and_go:
            self.notes.append("Gauss's principle is given for the equality constraints")
        if (lacking := without_inertia(x.equations)) is not None:
            text = (
                "Gauss's principle needs the acceleration without constraints, M^-1 f, "
                "and the mass matrix of this model is singular: a direction has no "
                "inertia"
            )
            hint = f"such as along `{lacking}`; give every coordinate some mass"
            raise unusable(SINGULAR_MASS, text, hint=hint)
        free = [
            x.add(
                symbol(f"a.{q}"),
                PrintedName(q.name, 0, "unconstrained"),
                (4, len(x.q) + j),
            )
            for j, q in enumerate(x.q)
        ]
        differences = [*enumerate(a - b for a, b in zip(x.a, free, strict=True))]
        pairs = product(differences, repeat=2)
        G = sp.Add(*(self.M[i][j] * p * q / 2 for (i, p), (j, q) in pairs))
        a = _solved(x, self.inverse, self.f) if self.inverse else None
        a = a if a and _readable(a) else None
        K, Qc = self._gain(free) if self.equalities and self.gram else (None, None)
        long = ["a = M^-1 f"] if a is None else []
        long += ["the gain K"] if self.equalities and K is None else []
        if long:
            text = f"left out, for it is too long to be read: {' and '.join(long)}"
            self.notes.append(text)
        return {"a": a, "G": G, "K": K, "Qc": Qc}

    def _gain(self, free: list[Any]) -> tuple[Any, Any]:
        """Return the gain K and the forces Qc = K (A a - b) of Gauss's principle.

        Both are None if they are too long.

        free : the accelerations a (n,) without constraints.
        """
        assert self.gram is not None
        x, rows = self.x, self.equalities
        columns = ([k["A"][j] for k in rows] for j in range(len(x.q)))
        gains = (_solved(x, self.gram, column) for column in columns)
        K = tuple(tuple(-e for e in row) for row in gains)
        if not all(map(_readable, K)):
            return None, None
        missed = [x.tidy(_dot(k["A"], free) - k["b"]) for k in rows]
        return K, tuple(x.tidy(_dot(row, missed)) for row in K)


def _solved(x: Translation, inverse: Inverse, right: Sequence[Any]) -> list[Any]:
    """Return the product of an inverse and a vector, each entry as one fraction.

    right : the vector.
    """
    out = [sp.S.Zero] * len(right)
    for indices, adjugate, determinant in inverse:
        under = x.tidy.one_fraction(determinant)
        has_sum = any(part.is_Add for part in sp.Mul.make_args(under))
        for i, row in zip(indices, adjugate, strict=True):
            over = _dot(row, [right[j] for j in indices])
            if has_sum:
                out[i] = x.tidy.one_fraction(over) / under
            else:
                out[i] = x.tidy(over / determinant, factored=True)
    return out


def _inverted(x: Translation, M: Matrix) -> Inverse | None:
    """Return the inverse of M by blocks, or None if a block is too large or singular.

    Each block has indices of rows, adjugate and determinant.
    """
    whole, blocks = sp.Matrix(M), list[tuple[list[int], Matrix, Any]]()
    for indices in whole.connected_components():
        if len(indices) > LARGEST_BLOCK:
            return None
        # Laplace's expansion; other methods search for common factors meanwhile.
        part = whole.extract(indices, indices)
        determinant = x.tidy(part.det(method="laplace"), factored=True)
        if determinant == 0:
            return None
        adjugate = part.adjugate(method="laplace").tolist()
        blocks.append((indices, [[x.tidy(e) for e in row] for row in adjugate],
                       determinant))  # fmt: skip
    return blocks


def _dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """Return the scalar product of two vectors of expressions."""
    return sp.Add(*(p * q for p, q in zip(a, b, strict=True)))


def _readable(parts: Sequence[Any]) -> bool:
    return all(written_size(e) <= READABLE for e in parts)


def _steps(x: Translation, known: dict[int, Any], nodes: list[int]) -> dict[str, Any]:
    """Return definitions of numbered steps: name -> expression.

    Each expression that `nodes` uses more than once is such a step.

    known : node -> expression, to which the steps and `nodes` are added.
    nodes : nodes to be expressed.
    """
    g = x.g
    cone = g.cone(nodes, ends=known)
    uses = Counter({*nodes})
    uses.update(a for n in cone if n not in known for a in g.args[n])
    letters, names = ("s", "k", "z", "step", "step_"), [s.name for s in x.names]
    prefix = next(p for p in letters if not any(n.startswith(p) for n in names))
    steps: dict[str, Any] = {}
    for n in (n for n in cone if uses[n] > 1):
        (value,) = to_sympy(g, [n], known=known)
        if written_size(value) > 2:
            name = f"{prefix}{len(steps) + 1}"
            s = x.add(symbol(name), PrintedName(name), (1, len(x.rank)))
            steps[name], known[n] = value, s
    to_sympy(g, nodes, known=known)
    return steps


# States at which a mass matrix is examined.
STATES = 3


def without_inertia(e: Equations) -> str | None:
    """Return the coordinate with the least inertia if M is not positive definite.

    None if M is positive definite at one of some random states, with the parameters of
    the file.
    """
    random = np.random.default_rng(3)
    n = len(e.q)
    # Column j of M is M q'' where q'' is 1 for coordinate j, and 0 for the others.
    nodes = e.mass_times([e.graph.variable(name) for name in e.accelerations])
    fixed: dict[str, Any] = dict(zip(e.accelerations, np.eye(n), strict=True))
    fixed |= {p.name: p.value for p in e.model.parameters}
    start = {i.name: i.value for i in e.model.initial}
    diagonal = np.zeros(n)
    for _ in range(STATES):
        state = {
            name: start.get(name, 0.0) + random.uniform(0.1, 0.4) for name in e.moving
        }
        M = evaluate_rows(e.graph, nodes, fixed | state, n)
        if not np.all(np.isfinite(M)):
            continue
        diagonal = np.abs(np.diag(M))
        size = np.sqrt(diagonal)
        scaled = M / np.outer(size, size) if np.all(size > 0) else None
        if scaled is not None and np.linalg.eigvalsh(scaled)[0] > DEPENDENT_ROWS:
            return None
    return e.q[int(np.argmin(diagonal))]


def derived(
    equations: Equations,
    *,
    substitute: bool = False,
    solve: bool = False,
    with_gauss: bool = False,
    expand: bool = False,
    matrices: bool = True,
) -> Content:
    """Derive the equations of a model, their solution and conserved quantities.

    Parameters
    ----------
    equations
        The model.
    substitute
        Whether the values of parameters are inserted.
    expand
        Whether definitions are written out, of any length; implied by `with_gauss`.
    solve
        Whether accelerations are solved for in closed form, of any length.
    with_gauss
        Whether Gauss's principle is added.
    matrices
        Whether M, f, A and b are added to equations in the definitions of the file.

    Raises
    ------
    InputError
        If the energies are too long to be written out, or with `with_gauss` if M is
        singular.
    """
    words = words_of(equations.model)
    expand = expand or with_gauss or not is_long(equations, words)
    refuse_long(equations.model, {} if expand else words)
    x = Translation(equations, substitute=substitute, named=None if expand else words)
    if expand:
        steps, found, conserved = _in_full(x)
    else:
        separation = Separation(equations, words)
        steps, found, conserved = _in_words(x, separation, matrices=matrices or solve)
    model, notes = equations.model, _on_contacts(found["constraints"])
    if not expand:
        notes.append(
            "the equations are written in the definitions of the file; `--expand` "
            "writes them out, and the mass matrix"
        )
    solver = _Solver(x, found, notes)
    document = {
        "definitions": {s.name: e for s, e in x.definitions.items()} | steps,
        **found,
        "accelerations": solver.solution(insist=solve),
        "conserved": conserved,
        "gauss": solver.gauss() if with_gauss else None,
        "notes": notes,
    }
    if model.states:
        rates = x.sympy([s.rate for s in model.states], written=True)
        document["states"] = dict(
            zip((s.name for s in model.states), rates, strict=True)
        )
    if model.events:
        document["events"] = {event.name: _event(event, x) for event in model.events}
    if (equations.is_set or model.kicks) and conserved:
        notes.append(
            "conserved quantities are constant between events, which change the energy"
        )
    if x.tidy.cut:
        notes.append(
            "some expressions are longer than they might be: simplification was "
            f"cut after {MOST_PRODUCTS:,} products of terms in one, or "
            f"{limits.TIDYING_PRODUCTS:,} in all"
        )
    sums = MemberSums(x)
    x.definitions.update(sums.inserted(x.definitions))
    return Content(x, sums.inserted(document))


def _event(event: Transition, x: Translation) -> Part:
    """Return the entry of an event in the document.

    It has no `impulse` if the event has no impulses.
    """

    def written(node: int) -> Any:
        return x.sympy([node], written=True)[0]

    found = {
        "at": event.at and event.at.text,
        "every": event.every or None,
        "once": event.once,
        "set": {mode: written(node) for mode, node in event.sets},
    }
    if event.impulses:
        found["impulse"] = {one.on: written(one.node) for one in event.impulses}
    return found


# Steps, the part of a document up to the constraints, and the conserved quantities.
_Found: TypeAlias = "tuple[Part, Part, list[Part]]"


def _in_full(x: Translation) -> _Found:
    """Derive the equations term by term.

    Expressions are tidied before they are differentiated, so that derivatives are
    short.

    Returns
    -------
    tuple of (dict, dict, list)
        Numbered steps, the entries of the document up to constraints, and conserved
        quantities.
    """
    e, g, flow, model = x.equations, x.g, x.equations.flow, x.equations.model
    n = len(e.q)
    found = _energies(x)
    T, V, L = (found[key] for key in ("kinetic", "potential", "lagrangian"))
    if model.kinetic is None or model.potential is None:
        parts = {"L": x.node(L, model.lagrangian)}
    else:
        parts = {"T": x.node(T, model.kinetic), "V": x.node(V, model.potential)}
    variables = [*flow.rates, *flow.positions, g.variable("t")]
    # By letter: slopes in the velocities, the coordinates and t; the rates of the first
    # slopes.
    slopes = {k: _tidied(x, gradient(g, node, variables)) for k, node in parts.items()}
    accelerations = map(g.variable, e.accelerations)
    forward = flow.forward | dict(zip(flow.rates, accelerations, strict=True))
    rates = {k: tangent(g, own[:n], forward) for k, own in slopes.items()}
    of_L, *of_V = slopes.values()
    for own in of_V:
        of_L = [g.call("sub", *pair) for pair in zip(of_L, own, strict=True)]
    momenta = _tidied(x, of_L[:n])
    drifts = tangent(g, momenta, flow.forward)
    work = generalized_forces(g, model, flow)
    constraints = []
    for c in model.constraints:
        (function,) = x.sympy([c.relation.node], written=True)
        node = x.node(function, c.relation.node)
        row = constraint_row(g, c.name, node, flow)
        A = [x.tidy(entry, factored=True) for entry in x.sympy(row.A)]
        (rate,) = x.sympy([row.rate])
        (drift,) = x.sympy(tangent(g, [x.node(rate, row.rate)], flow.forward))
        moved = _acceleration_row(x, A, x.tidy(-drift))
        constraints.append(_constraint(x, c, row, (function, rate), moved))
    lines = []
    for j, Q in enumerate(x.sympy(work)):
        terms: Part = {}
        left = sp.S.Zero
        for letter, own in slopes.items():
            rate, slope = x.sympy((rates[letter][j], own[n + j]))
            if letter != "V" or rate != 0:
                terms[f"ddt_d{letter}_dqdot"] = rate
            terms[f"d{letter}_dq"] = slope
            left += slope - rate if letter == "V" else rate - slope
        holding = _dot([k["A"][j] for k in constraints], x.multipliers)
        (momentum,) = x.sympy([momenta[j]])
        about = {"coordinate": e.q[j], "momentum": momentum, **terms, "Q": Q}
        lines.append(about | _sides(x, left, Q + holding))
    entries = mass_matrix(g, momenta, flow.rates)
    lower = [x.sympy([*row][: i + 1]) for i, row in enumerate(entries)]
    M = [[lower[max(i, j)][min(i, j)] for j in range(n)] for i in range(n)]
    sums = zip(of_L[n:], drifts, work, strict=False)
    f = x.sympy(g.call("add", g.call("sub", a, b), Q) for a, b, Q in sums)
    drift = tangent(g, [model.lagrangian], flow.states)
    (dL_dt,) = x.sympy([g.call("add", of_L[-1], *drift)])
    conserved = conserved_quantities(x, L, dL_dt, of_L[n:-1], lines, constraints)
    found["lagrangian"] = x.tidy(L, written=True)
    forces = [
        {**_force(x, force), "Q": x.sympy(_work(x, force))} for force in model.forces
    ]
    found |= {"forces": forces, "equations": lines}
    return {}, found | {"M": M, "f": f, "constraints": constraints}, conserved


def _in_words(x: Translation, s: Separation, *, matrices: bool) -> _Found:
    """Derive the equations in the definitions of the file, see `separation`.

    Entries of matrices are numbered steps, for programs. The result has the same form
    as that of `_in_full`.

    s : the separated equations.
    matrices : whether M, f, A and b are included.
    """
    e, model = x.equations, x.equations.model
    groups = {"momentum": 3, "reaction": 5, "force": 5}
    for k, (called, name) in enumerate(s.names.items(), len(x.rank)):
        group = groups.get(name.kind, 2) + name.order
        x.add(symbol(called), name, (min(group, 5), k))
    found = _energies(x)
    found["forces"] = forces = [_force(x, force) for force in model.forces]
    separated = {
        key: dict(zip(nodes, x.sympy(nodes.values()), strict=True))
        for key, nodes in (
            ("momenta", s.momenta), ("rates", s.rates), ("forces", s.forces),
            ("reactions", s.reactions),
        )
    }  # fmt: skip
    found["equations"] = lines = []
    # refused before the first expression is written
    x.operations(n for line in s.equations for n in line)
    sides = [x.sympy(line) for line in s.equations]
    for q, (momentum, left, Q) in zip(e.q, sides, strict=True):
        about = {"coordinate": q, "momentum": momentum}
        lines.append(about | _sides(x, left, Q))
    rows = [
        constraint_row(x.g, c.name, c.relation.node, e.flow) for c in model.constraints
    ]
    x.name_sums()
    known, steps = dict(x.known), dict[str, Any]()
    M, f = list[list[Any]](), list[Any]()
    if matrices:
        terms = [_work(x, force) for force in model.forces]
        wanted = [n for row in (*e.M, e.f, *terms) for n in row]
        wanted += [n for row in rows for n in (*row.A, row.b)]
        steps = _steps(x, known, wanted)
        for force, Q in zip(forces, terms, strict=True):
            force["Q"] = [known[n] for n in Q]
        M, f = [[known[n] for n in row] for row in e.M], [known[n] for n in e.f]
    constraints = []
    for c, row in zip(model.constraints, rows, strict=True):
        values = x.sympy([row.residual, row.rate], written=True)
        moved: Part = {}
        if matrices:
            moved = _acceleration_row(x, [known[n] for n in row.A], known[row.b])
        constraints.append(_constraint(x, c, row, values, moved))
    found |= {"separated": separated, "M": M, "f": f, "constraints": constraints}
    return steps, found, evident(x)


def _energies(x: Translation) -> Part:
    """Return energies, Lagrangian and dissipation function as the file has these."""
    model = x.equations.model
    energies = [model.kinetic, model.potential, model.dissipation]
    T, V, F = x.sympy(energies, written=True)
    L = T - V if T is not None else x.sympy([model.lagrangian], written=True)[0]
    return {"kinetic": T, "potential": V, "lagrangian": L, "dissipation": F}


def _tidied(x: Translation, nodes: Sequence[int]) -> list[int]:
    """Return simplified nodes equal to `nodes`, whose derivatives are shorter."""
    return [x.node(e, n) for e, n in zip(x.sympy(nodes), nodes, strict=True)]


def _force(x: Translation, force: Force) -> Part:
    p, direction = x.sympy([force.node, force.direction], written=True)
    level = force.level.name.lower()
    return {"on": force.on, "force": p, "direction": direction, "level": level}


def _work(x: Translation, force: Force) -> list[int]:
    """Return the nodes (n,) of the generalized forces by one force of the file."""
    velocity = force.level is not Level.POSITION
    slopes = x.equations.flow.gradient(x.g, force.direction, by_rates=velocity)
    return [x.g.call("mul", force.node, slope) for slope in slopes]


def _sides(x: Translation, left: Any, Q: Any) -> Part:
    """Return the two sides of an equation of motion, as entries of the document.

    Terms that depend on the state are on the left; multipliers and functions of t alone
    are on the right.

    left : the left side as derived, an expression.
    Q : the generalized force.
    """
    state = {*x.q, *x.v, *x.states}
    right = sp.Add(
        *(
            p
            for p in sp.Add.make_args(Q)
            if not x.free(p) & state or p.free_symbols & {*x.multipliers}
        )
    )
    return {"left": x.tidy(left - (Q - right)), "right": x.tidy(right)}


def _acceleration_row(x: Translation, A: list[Any], b: Any) -> Part:
    """Return the row A q'' = b of a constraint: A q'' - b, A (n,) and b, by name."""
    return {"acceleration": x.tidy(_dot(A, x.a) - b), "A": A, "b": b}


def _constraint(
    x: Translation, c: Constraint, row: Row, values: Sequence[Any], row_entries: Part
) -> Part:
    """Return the entry of a constraint: function, rate, row A q'' = b, and law.

    values : function and rate, expressions.
    row_entries : the entries of `_acceleration_row`.
    """
    law, given = c.law, law_of(c)
    nodes = [given["friction"], given["static_friction"], c.limit, c.static, c.when]
    nodes += [law.bounce, *law.slips] if law else [None]
    friction, static, limit, holding, when, e, *slip = x.sympy(nodes, written=True)
    if when is not None and when.is_Piecewise:  # if(condition, 1, 0)
        when = when.args[0][1]
    kind = "holonomic" if row.holonomic else "nonholonomic"
    function, rate = values
    found = {
        "name": c.name,
        "kind": kind if law is None else "one-sided",
        "function": function,
        "rate": rate if row.holonomic else function,
        **row_entries,
        "restitution": given["restitution"] if e is None else e,
        "friction": friction,
        "static_friction": static,
        "slip": slip,
        "limit": limit,
        "static_limit": holding,
    }
    if c.pair:  # two relations that share a limit
        names = [f"lambda_{c.called}.{k}" for k in c.ends]
        found["pair"] = [m for m in x.multipliers if m.name in names]
    found["when"] = when
    return found | {key: given[key] for key in RESTITUTION_LAW if key in given}


def _on_contacts(constraints: Sequence[Part]) -> list[str]:
    """Return notes on effects of contacts and friction that are not in the equations.

    constraints : entries of the document.
    """
    notes = []
    if any(k["kind"] == "one-sided" for k in constraints):
        notes.append("the multiplier of a contact is 0 while it is open")
    if any(k["friction"] is not None for k in constraints):
        notes.append(
            "friction is not in these equations: it acts along the slopes of the slip "
            "with respect to the velocities, against the slip, with at most the "
            "friction coefficient times the multiplier"
        )
    return notes
