"""The plan of a run: formulation, linear solver and method, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from lagsim.admissibility.point import Point
from lagsim.admissibility.rank import Neighbourhood, row_lengths
from lagsim.admissibility.refusal import needs_constraints
from lagsim.codes.known import SINGULAR_MASS
from lagsim.errors import unusable
from lagsim.language.evaluate import evaluate
from lagsim.language.functions import ELEMENTS
from lagsim.mechanics.corners import corners, with_pushes
from lagsim.mechanics.ldl import BUDGET, dense_operations, elimination_of
from lagsim.mechanics.partition import Partition, partition_of
from lagsim.mechanics.reduction import augmented, with_lengths
from lagsim.mechanics.switch_search import model_switches
from lagsim.methods import Structure, method
from lagsim.model.model import DEFAULT_RTOL
from lagsim.notes import Choice
from lagsim.plan.formulation import formulate
from lagsim.plan.method_choice import (
    ANY,
    STRAIGHT_ONLY,
    choose,
    law_rows_vary,
    locates,
    needs_regular_mass,
    newton_of,
    refuse,
    structure,
    suits,
)
from lagsim.tolerances import NEARLY_DEPENDENT_ROWS, STATE_ROUNDOFF

if TYPE_CHECKING:
    from collections.abc import Sequence

    from lagsim.admissibility.examination import Start
    from lagsim.language.arrays import Floats
    from lagsim.mechanics.equations import Equations, Instant
    from lagsim.mechanics.ldl import Elimination
    from lagsim.mechanics.linearisation import NewtonMatrix
    from lagsim.mechanics.partition import Blocks
    from lagsim.mechanics.reduction import Reduction
    from lagsim.mechanics.switches import Switches
    from lagsim.model.model import Settings


@dataclass(frozen=True, slots=True)
class Plan:
    """The decisions of a run.

    Attributes
    ----------
    method : str
    formulation : str
        See `lagsim.plan.formulation`.
    reduction : Reduction
        The equations that are integrated.
    projected : bool
        Whether states are projected onto their constraints.
    gain : float
        The rate of the formulation `baumgarte`, per unit of time; else 0.
    elimination : Elimination or None
        Symbolic solution for q'' and lambda on the graph; None where kernels solve the
        equations numerically, by loops.
    tape : bool
        Whether the model's functions are interpreted from tapes instead of compiled.
    rank : int
        Generic rank of the constraint rows.
    smallest_singular_value : float
        Generic smallest singular value of the scaled constraint rows; with tapes, its
        estimate from the pivots of `elimination` at the start.
    volume : float
        Smallest volume of the blocks of a solution by independent coordinates at the
        start, in [0, 1], see `mechanics.partition.volume`; 0 without such blocks.
    set_aside : tuple of bool, length m
        Marks rows that are combinations of other rows in every state.
    lengths : tuple of float, length m
        Typical length of each row in the metric of the mass matrix M, see
        `usual_lengths`.
    constant : int
        The constant matrices, which are factored once in an arc: 2 for the mass matrix
        M and the rows A of all constraints, laws included; 1 for M alone; 0 for none.
    augmented : bool
        Whether M is singular and is solved together with the constraints.
    rtol, atol, step : float or None
        Tolerances of an adaptive method, or the step of a fixed-step method.
    switches : Switches
    choices : tuple of Choice
        The decisions with their reasons, as shown to the user.
    """

    method: str
    formulation: str
    reduction: Reduction
    projected: bool
    gain: float
    elimination: Elimination | None
    tape: bool
    rank: int
    smallest_singular_value: float
    volume: float
    set_aside: tuple[bool, ...]
    lengths: tuple[float, ...]
    constant: int
    augmented: bool
    rtol: float | None
    atol: float | None
    step: float | None
    switches: Switches
    choices: tuple[Choice, ...]

    @property
    def form(self) -> tuple[object, ...]:
        """Key of the compiled functions of given equations.

        The key contains each decision that may change with the start or with values of
        parameters.
        """
        reduction, solved = self.reduction, self.elimination
        return (
            self.method, self.formulation, self.projected, self.tape, self.augmented,
            solved is None or solved.along_links, solved is None, self.blocks,
            self.rtol, reduction.eliminated,
        )  # fmt: skip

    @property
    def blocks(self) -> Blocks:
        """The blocks of a solution by independent coordinates; else empty."""
        solved = self.elimination
        return solved.blocks if isinstance(solved, Partition) else ()

    @property
    def newton(self) -> NewtonMatrix | None:
        """Sparse Newton matrix of an implicit method; None where none is used."""
        if self.elimination is None:
            return None
        return newton_of(self.method, self.reduction.equations)

    @property
    def tolerance(self) -> float:
        """Relative tolerance of an adaptive method, given or by default."""
        return DEFAULT_RTOL if self.rtol is None else self.rtol

    @property
    def accuracy(self) -> tuple[Literal["rtol", "step"], float]:
        """Name and value of the setting on which the error depends.

        It is `rtol` for a method that controls its error, else `step`.
        """
        if self.step is not None:
            return "step", self.step
        assert self.rtol is not None
        return "rtol", self.rtol

    def at(self, value: float) -> Plan:
        """Return the plan with another `rtol` or `step`, and with the default `atol`.

        value : of the setting that `accuracy` names.
        """
        if self.step is not None:
            return replace(self, step=value, atol=None)
        return replace(self, rtol=value, atol=None)


# --- From a scene to its plan: structure, formulation, solve, method
#
# A row's length in the metric of M is its length at the start. For a row that vanishes
# there it is evaluated at states nearby, at distances over which its relation changes.
#
# The structure of the equations decides which methods and formulations can handle a
# scene, as far as the expressions show this structure: one that only appears at some
# values of the parameters is not found.


# Number of states around the start at which lengths are evaluated, and their distance
# from the start, relative to the distance over which a relation changes.
AROUND = 3
NEARBY = 0.1


def usual_lengths(equations: Equations, start: Instant) -> tuple[float, ...]:
    """Return the length (m,) of each row at the start, in the metric of M.

    For a row that vanishes at the start, it is the largest length of the row at random
    states nearby.
    """
    if not equations.rows:
        return ()
    point = Point(equations, start)
    lengths = _lengths(point)
    vanishing = ~(lengths > 0.0)
    if vanishing.any():
        around = Neighbourhood(point)
        random = np.random.default_rng(4)  # equal states in each run
        for _ in range(AROUND):
            q, v = (around.varied(NEARBY, random, velocities=x) for x in (False, True))
            found = np.fmax(lengths, _lengths(point.at(q, v)))
            lengths = np.where(vanishing, found, lengths)
    return tuple(map(float, np.nan_to_num(lengths)))


def _lengths(point: Point) -> Floats:
    """Return the lengths (m,) of the rows of A in the metric of M at a point.

    0 where a length is roundoff, nan where M is not finite.
    """
    names = point.e.state
    errors = STATE_ROUNDOFF * np.abs(np.concatenate([point.q, point.v]))
    return row_lengths(point.at(errors=dict(zip(names, errors, strict=False))))


# Loops of this many multiplications take a millisecond, so that their QR decomposition
# is affordable.
CHEAP = 10**6
# Code that fills in more entries of M and A than these compiles for long.
MOST_ENTRIES = 10_000
# Functions of as many slopes as n (n + m), twice: see `program/functions.py`.
SLOPES = frozenset(("jacobian", "lagrangian"))
# A tape whose operations repeat as often as this, on average, takes 1.4 to 1.8 times as
# long as code (strings, nets, 40 bodies that attract). Of as many operations of q'',
# the code takes as long to compile as 100,000 evaluations.
REPEATS, MOST_COMPILED = 200, 1500


def eliminate(
    equations: Equations, start: Start, lengths: Sequence[float], choices: list[Choice]
) -> Elimination | None:
    """Solve for q'' and lambda on the graph.

    Parameters
    ----------
    lengths : sequence of float, length m
        Lengths of the rows, see `usual_lengths`.
    choices : list of Choice
        The choice of the solver, with its reason, is appended.

    Returns
    -------
    Elimination or None
        None where kernels solve the equations numerically, by loops.
    """
    if start.augmented:
        return None
    if start.ranks.rank < len(equations.rows):
        reason = f"{len(equations.rows)} constraints have rank {start.ranks.rank}"
        choices.append(Choice("solve: loops with QR, least-norm lambda", reason))
        return None
    n, m = len(equations.q), len(equations.rows)
    dense = dense_operations(n, m)
    close = start.ranks.smallest < NEARLY_DEPENDENT_ROWS
    reason = f"the constraints are nearly dependent ({start.ranks.smallest:.1e})"
    if close and dense <= CHEAP:
        choices.append(Choice("solve: loops with QR", reason))
        return None
    elimination = elimination_of(equations)
    if elimination is None:
        text = f"elimination saves too little of their {dense} multiplications"
        choices.append(Choice("solve: loops", text))
        return None
    if close:
        smallest = singular_value_of(equations, start, lengths, elimination)
        if smallest < NEARLY_DEPENDENT_ROWS:
            slow = f"{reason}, at the price of {dense} multiplications"
            choices.append(Choice("solve: loops with QR", slow))
            return None
    elif (found := _partition(equations, start, elimination)) is not None:
        left = ", ".join(f"`{equations.q[c]}`" for c in found.independent)
        choices.append(Choice("solve: independent coordinates", left))
        return found
    count = elimination.operations
    many = f"{count} multiplication{'s' * (count != 1)}"
    if equations.chains is not None:
        many += " along chains"
    if count <= BUDGET:
        choices.append(Choice("solve: straight-line code", many))
    else:
        where = " of entries that are not zero" * (equations.chains is None)
        reason = f"{many}{where}; loops would need {dense}"
        choices.append(Choice("solve: sparse elimination", reason))
    return elimination


def _partition(
    equations: Equations, start: Start, elimination: Elimination
) -> Partition | None:
    """Return the solution by independent coordinates, or None where it does not pay.

    elimination : the solution by M^-1.
    """
    if elimination.operations > BUDGET:
        return None
    point = Point(equations, start)
    return partition_of(elimination, point.values, list(point.sizes))


def _volume(
    equations: Equations,
    start: Instant,
    lengths: Sequence[float],
    elimination: Elimination | None,
) -> float:
    if not isinstance(elimination, Partition):
        return 0.0
    return singular_value_of(equations, start, lengths, elimination)


def from_tape(equations: Equations, elimination: Elimination | None) -> bool:
    """Whether the model's functions are too long to compile, and run from tapes.

    elimination : the solution for q'' and lambda on the graph; None where kernels solve
        the equations numerically, by loops.
    """
    if equations.graph.of((ELEMENTS,)):
        return True
    if elimination is not None:
        return elimination.operations > BUDGET
    # M is full, and assembled in the place where it is read
    if equations.chains is not None:
        return len(equations.q) ** 2 > MOST_ENTRIES
    rows = sum(len(row.A.entries) for row in equations.rows)
    return sum(len(row.entries) for row in equations.M) + rows > MOST_ENTRIES


def many_slopes(
    name: str,
    equations: Equations,
    elimination: Elimination | None,
    choices: list[Choice],
) -> bool:
    """Whether tapes are needed since a method's derivatives are too many to compile.

    name : the name of the method.
    elimination : the solution for q'' and lambda on the graph; None where kernels solve
        the equations numerically, by loops.
    choices : the decision on the derivatives, with its reason, is appended.
    """
    n, m = len(equations.q), len(equations.rows)
    sparse = None if elimination is None else newton_of(name, equations)
    slopes = 2 * n * (n + m)
    if sparse is not None:
        slopes = len(sparse.entries)
        reason = (
            f"{slopes} entries; {sparse.operations} multiplications per factorisation"
        )
        choices.append(Choice("Newton's matrix: sparse", reason))
    if not SLOPES.intersection(method(name).NEEDS) or slopes <= MOST_ENTRIES:
        return False
    choices.append(Choice("tapes", f"{slopes} derivatives would need long to compile"))
    return True


def repeats(
    name: str,
    equations: Equations,
    elimination: Elimination | None,
    choices: list[Choice],
) -> bool:
    """Whether the model runs from tapes because its operations repeat.

    In a string or a net, q'' of each member takes equal operations, and one instruction
    of a tape evaluates all operations of one kind and level: a tape then saves the time
    to compile. If so, the choice is appended to `choices`.

    name : the name of the method.
    elimination : the solution for q'' and lambda on the graph; None where kernels solve
        the equations numerically, by loops.
    """
    if elimination is None or STRAIGHT_ONLY.intersection(method(name).NEEDS):
        return False
    g, level, kinds = equations.graph, dict[int, int](), set[tuple[int, str]]()
    if len(g) < MOST_COMPILED:
        return False
    for n in g.cone(elimination.motion()[0]):
        if g.args[n]:
            level[n] = 1 + max(level.get(a, 0) for a in g.args[n])
            kinds.add((level[n], g.ops[n]))
    count = len(level)
    if count < MOST_COMPILED or count < REPEATS * len(kinds):
        return False
    reason = f"{count} operations of {len(kinds)} kinds would need long to compile"
    choices.append(Choice("tapes", reason))
    return True


def singular_value_of(
    equations: Equations,
    start: Instant,
    lengths: Sequence[float],
    elimination: Elimination,
) -> float:
    """Return an estimate of the smallest singular value of the scaled rows at a start.

    The estimate is computed from the pivots of `elimination`.

    lengths : the lengths of the rows (m,).
    """
    values = {**Point(equations, start).values}
    for row, length in zip(equations.rows, lengths, strict=True):
        values[f"length.{row.name}"] = length
    return float(
        evaluate(equations.graph, [elimination.smallest_singular_value()], values)[0]
    )


def implied_rows(equations: Equations, start: Start) -> tuple[bool, ...]:
    """Return a bool for each row (m,): whether other rows imply it in every state."""
    redundant = {d.name for d in start.ranks.dependences if d.everywhere is not False}
    return tuple(row.name in redundant for row in equations.rows)


def make_plan(equations: Equations, start: Start, settings: Settings) -> Plan:
    """Return the plan of a run: formulation, linear solver, method, with reasons.

    Raises
    ------
    InputError
        If the method or the formulation of the settings is impossible, or `output`
        contains a quantity that the model or the method does not provide.

    Examples
    --------
    >>> from lagsim.admissibility.examination import examine
    >>> from lagsim.mechanics.derivation import derive
    >>> from lagsim.model.reader import read
    >>> text = '''
    ... coordinates: {x: {}, y: {}}
    ... energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
    ... constraints: {rod: x^2 + y^2 = 1}
    ... initial: {x: 1, y: 0, x_dot: 0, y_dot: 0}
    ... simulation: {duration: 1}
    ... '''
    >>> model = read(text, "pendulum.yaml")
    >>> equations = derive(model)
    >>> plan = make_plan(equations, examine(equations).start, model.settings())
    >>> plan.formulation, plan.projected
    ('projection', True)
    >>> plan.choices[0].choice
    'mass matrix: constant, diagonal'
    """
    if (
        start.augmented
        and equations.model.output.gauss
        and needs_constraints(Point(with_lengths(equations), start))
    ):
        text = "`output.gauss` requires the accelerations without constraints, M^-1 f, "
        text += "and the mass matrix of this model is singular without the constraints"
        raise unusable(SINGULAR_MASS, text)
    found = formulate(equations, start, settings, partial(suits, settings.method))
    equations, start = found.reduction.equations, found.start
    if start.augmented and needs_regular_mass(settings.method):
        equations = augmented(equations, equations.rows)
        start = replace(start, augmented=False)
        found = found._replace(reduction=found.reduction._replace(equations=equations))
    scene = structure(equations)
    choices = [
        Choice(f"mass matrix: {_mass_matrix(scene)}", _mass_reason(equations, scene))
    ]
    choices += found.choices
    equations, switches = _with_switches(equations, settings)
    found = found._replace(reduction=found.reduction._replace(equations=equations))
    if count := switches.acting:
        reason = "forces jump or have a kink there: each is located, and the "
        reason += "integration restarts"
        choices.append(Choice(f"switches: {count} located", reason))
    lengths = usual_lengths(equations, start)
    if not locates(settings.method):
        elimination = None
        choices.append(Choice("solve: impulses in steps", "by projected relaxation"))
    elif equations.laws:
        elimination = None
        choices.append(
            Choice("solve: loops", "the active constraints change during the run")
        )
    else:
        elimination = eliminate(equations, start, lengths, choices)
    if start.augmented:
        solved_with = "mass matrix solved with the constraints"
        choices.append(Choice(solved_with, "it is singular without the constraints"))
    tape = from_tape(equations, elimination)
    smallest = start.ranks.generic_smallest
    if elimination is not None and tape and equations.rows:
        # The estimate that the run will use: for long chains it is small.
        smallest = singular_value_of(equations, start, lengths, elimination)
    solved = None if tape else elimination
    switching = bool(switches.acting or equations.laws)
    name = choose(equations, scene, solved, settings, choices, switching=switching)
    if elimination is None:
        refuse(name, method(name).refusal(scene), settings)
    adaptive = bool(method(name).ADAPTIVE)
    tape = tape or many_slopes(name, equations, elimination, choices)
    tape = tape or repeats(name, equations, elimination, choices)
    # Matrices factored once: 2 M and A, 1 only M, 0 neither.
    constant = (1 + scene.constant_rows) * scene.constant_mass
    # Factored with the constraints, M is constant only if they are.
    known = constant if not start.augmented or constant == 2 else 0
    if law_rows_vary(equations):
        known = min(known, 1)
    return Plan(
        method=name,
        formulation=found.name,
        reduction=found.reduction,
        projected=found.projected,
        gain=found.gain,
        elimination=elimination,
        tape=tape,
        rank=start.ranks.generic_rank,
        smallest_singular_value=smallest,
        volume=_volume(equations, start, lengths, elimination),
        set_aside=implied_rows(equations, start),
        lengths=lengths,
        constant=known,
        augmented=start.augmented,
        rtol=settings.tolerance if adaptive else None,
        atol=settings.atol if adaptive else None,
        step=None if adaptive else settings.fixed_step,
        switches=switches,
        choices=tuple(choices),
    )


def _with_switches(
    equations: Equations, settings: Settings
) -> tuple[Equations, Switches]:
    """Return the equations, with forces of equalities at kinks added, and all switches.

    settings : the settings, of which the method is used: if it does not locate events,
        only switches of the time have sides.
    """
    located = locates(settings.method)
    known = settings.method != "auto"
    cuts = known and not method(settings.method).ADAPTIVE
    find = partial(model_switches, located=located, cuts=cuts, shown=True)
    switches = find(equations)
    bent = corners(equations, switches)
    if not bent:
        return equations, switches
    pushed = with_pushes(equations, switches, bent)
    return pushed, replace(find(pushed), corners=bent)


def by_loops(plan: Plan) -> Plan:
    """Return a plan in which kernels solve the equations numerically, by loops.

    Used during a run when constraints become dependent. A method that needs y' as nodes
    of the graph, or refuses the equations, is replaced by the method `ANY`.
    """
    choices = [c for c in plan.choices if not c.choice.startswith("solve:")]
    choices.append(Choice("solve: loops with QR", "the constraints became dependent"))
    name = plan.method
    why = method(name).refusal(structure(plan.reduction.equations))
    if STRAIGHT_ONLY.intersection(method(name).NEEDS):
        why = f"`{name}` needs straight-line code"
    if why:
        choices.append(Choice(f"method: {ANY}", why))
        name = ANY
    tape = from_tape(plan.reduction.equations, None)
    return replace(
        plan, method=name, elimination=None, tape=tape, choices=tuple(choices)
    )


def without_partition(plan: Plan, reason: str) -> Plan:
    """Return a plan that solves with M^-1 instead of by independent coordinates.

    A run changes to it if the independent coordinates no longer determine the others.
    It is used from the start where a run cannot change its plan: in a page in a file.

    reason : the reason of the choice, shown with the plan.
    """
    e = plan.reduction.equations
    choices = [c for c in plan.choices if not c.choice.startswith("solve:")]
    choices.append(Choice("solve: straight-line code", reason))
    return replace(
        plan, elimination=elimination_of(e), volume=0.0, choices=tuple(choices)
    )


def _mass_matrix(scene: Structure) -> str:
    varies = scene.mass_varies_with
    kind = "constant" if scene.constant_mass else f"depends on {varies}"
    if scene.diagonal:
        return f"{kind}, diagonal"
    return f"{kind}, {scene.blocks} blocks" if scene.blocks > 1 else kind


def _mass_reason(equations: Equations, scene: Structure) -> str:
    if scene.constant_mass:
        return "factored once, before the run"
    n = len(equations.q)
    if equations.chains is not None:
        return f"kept as {len(equations.chains.sums)} sums along chains"
    full = len(equations.mass_entries)
    return f"{full} of {n * n} entries are not zero"
