"""Warnings where the motion about a steady state is not linear, however small it is.

The equations of a steady state may differ between the sides of a surface on which the
state lies: `max(x, 0)` at x = 0. Each combination of sides that small motions reach is
linearised and compared with each other. A law of a contact, a freewheel, a friction or
a limit is not linear where its multiplier lies at its bound: the smallest motion opens
an unloaded contact.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.admissibility.point import Point
from lagsim.admissibility.verdict import CAUTION
from lagsim.codes.known import NOT_LINEAR
from lagsim.language.derivatives import gradient
from lagsim.mechanics.algebra import Metric
from lagsim.mechanics.linearisation import Linearisation
from lagsim.mechanics.surfaces import expression_text
from lagsim.mechanics.switch_search import model_switches
from lagsim.notes import Caution
from lagsim.tolerances import COMPUTED_ZERO, RESIDUAL_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from lagsim.errors import Place
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.constraints import Law
    from lagsim.mechanics.equations import Equations, Instant
    from lagsim.mechanics.linearisation import Slopes
    from lagsim.mechanics.surfaces import Side

# Largest number of surfaces of which all combinations of sides are compared; of more,
# one surface at a time.
MOST_COMBINED = 5
NOT_SMALL = "the motion about this state is not linear, however small it is"


class Linearised(NamedTuple):
    """State at rest or in steady motion, with the motion linearised about it.

    Attributes
    ----------
    equations : Equations
        The equations, with the rows of laws that hold among the rows.
    state : Instant
    linearisation : Linearisation
    values : dict of str to float
        The values of all variables, with accelerations and multipliers.
    laws : tuple of Law
        The laws of the model.
    origin : tuple of ndarray
        Positions and velocities (n,) from which the state was computed.
    """

    equations: Equations
    state: Instant
    linearisation: Linearisation
    values: dict[str, float]
    laws: tuple[Law, ...]
    origin: tuple[Floats, Floats]


def not_linear(steady: Linearised) -> list[Caution]:
    """Return a warning for each switch and each law at which motions are not linear."""
    if not steady.laws and not model_switches(steady.equations).sides:
        return []
    errors = _errors(steady)
    return [
        *(_Surfaces(steady, errors).cautions()),
        *_of_laws(steady, errors),
    ]


def _errors(steady: Linearised) -> dict[str, float]:
    """Return bounds of the errors of the state, of q'' and of multipliers, by name."""
    e, linearisation = steady.equations, steady.linearisation
    errors = Point(e, steady.state).solved_errors(steady.origin)
    x = _values(linearisation, steady)
    _, _, f, _, _ = linearisation.term_errors(x, errors)
    lam = np.array([x.values[name] for name in e.multipliers])
    terms = np.abs(x.M) @ np.abs(x.acceleration) + np.abs(x.A.T) @ np.abs(lam)
    f = f + RESIDUAL_ROUNDOFF * terms
    Z, by_force = x.metric.free, x.metric.multipliers(np.eye(len(f)))
    errors |= _named(e.accelerations, np.abs(Z) @ (np.abs(Z.T) @ f))
    return errors | _named(e.multipliers, np.abs(by_force) @ f)


def _named(names: tuple[str, ...], values: Floats) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=True))


def _values(linearisation: Linearisation, steady: Linearised) -> Slopes:
    at = steady.state
    return linearisation.values(at.t, at.q, at.v, at.s)


# --- Switches


class _OnSides(NamedTuple):
    """Equations and their derivatives on one side of each surface, with error bounds.

    Attributes
    ----------
    x : Slopes
    noise : ndarray, shape of `x.slopes`
        Bounds of the errors of `x.slopes`.
    terms : list of ndarray
        Bounds of the errors of the mass matrix M, the rows A, the forces f, the
        right-hand sides b of the rows, and s', as flat arrays.
    """

    x: Slopes
    noise: Floats
    terms: list[Floats]


class _Surfaces:
    """Surfaces of switches on which a steady state lies.

    Parameters
    ----------
    steady : Linearised
        The state with its linearised motion.
    errors : mapping of str to float
        Error bounds of the state, of q'' and of multipliers, by name.

    Attributes
    ----------
    levels : dict of int to float
        The level of each of these surfaces, by the index of its side.
    """

    def __init__(self, steady: Linearised, errors: Mapping[str, float]) -> None:
        self.steady, self.errors = steady, errors
        self.e, self.g = steady.equations, steady.equations.graph
        self.switches = model_switches(self.e)
        self.sides = self.switches.sides
        self.values: dict[str, float] = {}
        self.levels: dict[int, float] = {}
        point = Point(self.e, steady.state, errors)
        names = (*self.e.accelerations, *self.e.multipliers)
        point.multipliers = {name: steady.values[name] for name in names}
        nodes = [side.node for side in self.sides]
        found = point.array(nodes), CAUTION * point.rounding(nodes)
        for k, (u, error) in enumerate(zip(*found, strict=True)):
            side = self.sides[k]
            level = float(np.rint(u)) if side.whole else 0.0
            if abs(u - level) <= error:
                self.levels[k] = level
            self.values[side.variable] = self._mode_value(k, float(u))
            self.values |= {side.floor: 0.0} if side.floor else {}

    def _mode_value(self, k: int, u: float) -> float:
        """Return the value of surface k's mode variable where its expression is u."""
        if k in self.levels:
            return self.levels[k] - 0.5 if self.sides[k].whole else 0.0
        return float(np.floor(u) if self.sides[k].whole else np.sign(u))

    def cautions(self) -> list[Caution]:
        """Return a warning for each surface whose sides have different equations."""
        if not self.levels:
            return []
        own = self.switches.among(range(len(self.sides)))
        e, g = self.e, self.g
        self.frozen = Linearisation(e, own.freeze)
        state = [g.variable(name) for name in e.state]
        fixed = {
            g.variable(side.variable): g.constant(self.values[side.variable])
            for k, side in enumerate(self.sides)
            if k not in self.levels
        }
        among = list(self.levels)
        nodes = own.freeze([self.sides[k].node for k in among])
        pairs = zip(among, nodes, g.substitute(nodes, fixed), strict=True)
        # An expression that keeps its level on an interval has no sides.
        moving = {k: node for k, node, at in pairs if g.depends([at]) & {*e.state}}
        self.slopes = {k: gradient(g, node, state) for k, node in moving.items()}
        shown = _values(self.steady.linearisation, self.steady)
        self.change = self.frozen.changes(shown)[2]
        self.constrained = [k for k in moving if self._is_constrained(k)]
        self.chosen = [k for k in moving if k not in self.constrained]
        try:
            return [*self._compared()]
        except (ValueError, np.linalg.LinAlgError):  # no slopes on one side
            return []

    def _gradient(self, k: int, values: Mapping[str, float]) -> tuple[Floats, Floats]:
        """Return the gradient of surface k's expression u, by two sets of variables.

        These are (q, q', s), and the variables (a, w, z) of small motions that satisfy
        the constraints, see `mechanics.linearisation`; entries of the second gradient
        within rounding are 0.

        values : values of mode variables, by name.
        """
        point = Point(self.e, self.steady.state)
        names = (*self.e.accelerations, *self.e.multipliers)
        known = {name: self.steady.values[name] for name in names}
        point.multipliers = known | self.values | dict(values)
        whole = point.array(self.slopes[k])
        free = whole @ self.change
        small = COMPUTED_ZERO * (np.abs(whole) @ np.abs(self.change))
        return whole, np.where(np.abs(free) > small, free, 0.0)

    def _is_constrained(self, k: int) -> bool:
        """Whether rows hold the state on surface k."""
        whole, free = self._gradient(k, {})
        return bool(np.any(whole) and not np.any(free))

    def _ends(self, k: int, *, above: bool) -> float:
        if self.sides[k].whole:
            return self.levels[k] if above else self.levels[k] - 1.0
        return 1.0 if above else -1.0

    def _on(self, above: Mapping[int, bool]) -> dict[str, float]:
        """Return the values of mode variables on the given sides, by name.

        above : index of a surface -> True for its upper side.
        """
        return {
            self.sides[k].variable: self._ends(k, above=x) for k, x in above.items()
        }

    def _reached(self, above: Mapping[int, bool]) -> bool:
        """Whether small motions reach the given sides of all surfaces at once.

        above : index of a surface -> True for its upper side.
        """
        values = self._on(above)
        rows = np.array([self._gradient(k, values)[1] for k in above])
        lengths = np.linalg.norm(rows, axis=1)
        rows = rows[lengths > 0.0] / lengths[lengths > 0.0, None]
        signs = np.array([1.0 if x else -1.0 for x in above.values()])[lengths > 0.0]
        if not len(rows):
            return True
        along = np.linalg.pinv(rows) @ signs
        return bool(np.all(signs * (rows @ along) > COMPUTED_ZERO))

    def _combinations(self) -> Iterator[dict[int, bool]]:
        """Generate the combinations of sides whose equations are compared.

        Each maps the index of a surface to True for its upper side. Combinations that
        small motions cannot reach are left out; of many surfaces, only one at a time is
        on its lower side, or all are.
        """
        chosen = self.chosen
        found: Iterator[tuple[bool, ...]]
        if len(chosen) <= MOST_COMBINED:
            found = product((True, False), repeat=len(chosen))
        else:
            below = (tuple(k != i for k in chosen) for i in (None, *chosen))
            found = iter([*below, (False,) * len(chosen)])
        for above in found:
            sides = dict(zip(chosen, above, strict=True))
            if self._reached(sides):
                yield sides

    def _of(self, linearisation: Linearisation) -> _OnSides:
        x = _values(linearisation, self.steady)
        errors = dict(self.errors) | dict.fromkeys(self.values, 0.0)
        noise = linearisation.noise(x, errors)
        return _OnSides(x, noise, linearisation.term_errors(x, errors))

    def _compared(self) -> Iterator[Caution]:
        """Generate the warnings, by comparison of the combinations of sides."""
        found = list[tuple[dict[int, bool], _OnSides]]()
        for above in self._combinations():
            values = self.values | self._on(above)
            found.append((above, self._of(self.frozen.on(values))))
        if all(not self._differ(found[0][1], x) for _, x in found[1:]):
            return
        shown = self._of(self.steady.linearisation)
        equal = [above for above, x in found if not self._differ(shown, x)]
        for k in self.chosen:
            if any(
                self._differ(x, y)
                for above, x in found
                for other, y in found
                if above[k] and {i for i in above if above[i] != other[i]} == {k}
            ) or (len(self.chosen) > 1 and self._decides(k, found)):
                yield self._caution(k, above=equal[0][k] if equal else None)

    def _decides(self, k: int, found: list[tuple[dict[int, bool], _OnSides]]) -> bool:
        """Whether the equations change if k is crossed together with other surfaces.

        True if no two compared combinations differ in the side of k alone, and a
        combination above k has other equations than a combination below it. Such
        surfaces coincide to first order.

        found : the compared combinations of sides, with their equations.
        """
        coupled = [
            (x, y)
            for above, x in found
            for other, y in found
            if above[k] and not other[k]
        ]
        alone = any(
            {i for i in above if above[i] != other[i]} == {k}
            for above, _ in found
            for other, _ in found
        )
        return not alone and any(self._differ(x, y) for x, y in coupled)

    def _differ(self, a: _OnSides, b: _OnSides) -> bool:
        """Whether the linear motions on two sides differ by more than rounding."""
        x, y, Z = a.x, b.x, a.x.metric.free
        M, A, f, c, rates = (
            CAUTION * (p + q) for p, q in zip(a.terms, b.terms, strict=True)
        )
        dM = _beyond(y.M - x.M, M.reshape(x.M.shape))
        dA = _beyond(y.A - x.A, A.reshape(x.A.shape))
        if _exceeds_rounding(Z.T, dM, Z) or _exceeds_rounding(np.eye(len(dA)), dA, Z):
            return True
        error = np.abs(x.metric.inverse) @ c + np.abs(Z) @ (np.abs(Z.T) @ f)
        jumps = _beyond(y.acceleration - x.acceleration, error)
        if np.any(jumps) or np.any(_beyond(y.rates - x.rates, rates)):
            return True
        for one, other in ((x.B, y.B), (x.C, y.C)):
            if np.any(_beyond(other - one, COMPUTED_ZERO * np.abs(one))):
                return True
        sizes = RESIDUAL_ROUNDOFF * (np.abs(x.slopes) + np.abs(y.slopes))
        noise = CAUTION * (a.noise + b.noise) + sizes
        change = _beyond(y.slopes - x.slopes, noise)
        same = x._replace(slopes=change, turning=np.zeros_like(x.turning))
        R = self.steady.linearisation.linear(same, noise).R
        return bool(np.any(R[x.position_metric.free.shape[1] :]))

    def _caution(self, k: int, *, above: bool | None) -> Caution:
        """Return the warning on surface k.

        above : the side of the surface whose equations are those of the modes; None if
            they are those of no side.
        """
        side = self.sides[k]
        switch, place = self._written(side)
        text = f"{NOT_SMALL}: the equations change at `{switch}`, where this state "
        text += "lies; the modes belong to "
        if above is not None:
            text += f"the side on which {self._words(side, above=above)}"
        else:
            text += "neither side: they have the value and the slope of the "
            text += "switch at its level (`sign` and the slope of `abs` are 0 there)"
        return Caution(NOT_LINEAR, text, place)

    def _words(self, side: Side, *, above: bool) -> str:
        if side.whole:
            return f"its argument is {'larger' if above else 'smaller'}"
        text = expression_text(self.g, side.node)
        return f"`{text}` is {'positive' if above else 'negative'}"

    def _written(self, side: Side) -> tuple[str, Place | None]:
        """Return the text of a switch of a surface, and the place of its entry, if any.

        Entries are forces, relations of constraints, and energies.
        """
        model = self.e.model
        entries = [(x.node, x.place) for x in model.forces]
        entries += [(x.relation.node, x.relation.place) for x in model.constraints]
        for name in ("potential", "kinetic", "dissipation"):
            node, place = getattr(model, name), model.places.get(name)
            if node is not None and place is not None:
                entries.append((node, place))
        for node, place in entries:
            own = self.switches.texts([node])
            if side.variable in own:
                return own[side.variable], place
        return side.text, None


def _beyond(change: Floats, error: Floats) -> Floats:
    """Return the changes with 0 for entries of at most the size of their error."""
    return np.where(np.abs(change) > error, change, 0.0)


def _exceeds_rounding(left: Floats, change: Floats, right: Floats) -> bool:
    """Whether an entry of left @ change @ right is more than rounding."""
    moved = left @ change @ right
    size = np.abs(left) @ np.abs(change) @ np.abs(right)
    return bool(np.any(np.abs(moved) > COMPUTED_ZERO * size))


# --- Laws


def _of_laws(steady: Linearised, errors: Mapping[str, float]) -> Iterator[Caution]:
    """Generate a warning for each law in force whose multiplier is at its bound.

    A law is left out if the other rows already hold its row, or if it is friction of a
    contact whose multiplier is at its bound, too.

    errors : bounds of the errors of the state, of q'' and of multipliers, by name.
    """
    e = steady.equations
    laws = steady.laws
    rows = {row.name: k for k, row in enumerate(e.rows)}
    at_bound: dict[int, Law] = {}
    for k, law in enumerate(laws):
        in_force = law.row.name in rows and law.by_forces
        if in_force and _is_at_bound(steady, errors, law):
            at_bound[k] = law
    if not at_bound:
        return
    x = _values(steady.linearisation, steady)
    own = [rows[law.row.name] for law in at_bound.values()]
    others = np.delete(np.arange(len(e.rows)), own)
    free = Metric(x.M, x.A[others]).free
    named = set[str]()
    for law in at_bound.values():
        row = np.abs(x.A[rows[law.row.name]])
        moves = np.abs(x.A[rows[law.row.name]] @ free)
        if law.normal in at_bound or law.name in named:
            continue
        if np.any(moves > COMPUTED_ZERO * (row @ np.abs(free))):
            named.add(law.name)
            yield Caution(NOT_LINEAR, f"{NOT_SMALL}: {_law_text(law)}")


def _is_at_bound(steady: Linearised, errors: Mapping[str, float], law: Law) -> bool:
    """Whether the multiplier of a law in force is at its bound, within rounding.

    The bound of a contact and of a freewheel is 0.
    """
    value = steady.values[f"lambda_{law.row.name}"]
    error = CAUTION * errors[f"lambda_{law.row.name}"]
    if law.one_sided:
        return value <= error
    point = Point(steady.equations, steady.state, errors)
    names = (*steady.equations.accelerations, *steady.equations.multipliers)
    point.multipliers = {name: steady.values[name] for name in names}
    (bound,), (rounding,) = point.array([law.static]), point.rounding([law.static])
    pair = 0.0
    if law.pair >= 0:
        other = steady.laws[law.pair].row.name
        pair = steady.values.get(f"lambda_{other}", 0.0)
    if law.normal >= 0:
        normal = f"lambda_{steady.laws[law.normal].row.name}"
        load = steady.values.get(normal, 0.0)
        rounding = rounding * load + bound * errors.get(normal, 0.0)
        bound = bound * load
    return bool(np.hypot(value, pair) >= bound - error - CAUTION * rounding)


def _law_text(law: Law) -> str:
    if law.one_sided:
        noun, holds = "the contact " if law.gapped else "", law.role.words[0]
        text = f"{noun}`{law.name}` is {holds} without a force; the modes count "
        return text + f"it as {holds}"
    noun = "the friction of " if law.slips else ""
    text = f"{noun}`{law.name}` sticks with its force at the limit; the modes count it "
    return text + "as sticking"
