"""Equations -> compiled functions, linked with a method into an executable runner.

The state y has the blocks of `methods.parts.parameters.Blocks`. Compiled functions have
the arguments (t, y, p, out); p holds the parameters, the modes of the arc and working
memory, so that new values of parameters require no compilation.
"""

from __future__ import annotations

from array import array
from copy import copy
from functools import cached_property
from time import process_time
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from lagsim.language import tables
from lagsim.language.columns import IMPULSE
from lagsim.language.sparse import joined
from lagsim.mechanics.equations import has_poles
from lagsim.mechanics.motion_series import motion_series
from lagsim.mechanics.rows import RowTable
from lagsim.methods import method, moreau, taylor
from lagsim.methods.parts.parameters import KEPT, OFF, Parameters
from lagsim.methods.parts.search_table import POINTS
from lagsim.native.graph import keys, lanes, polynomials
from lagsim.native.graph.keys import Layout, Loop, Manner
from lagsim.native.layout import address
from lagsim.native.link.cache import ProgramPart, graph_part, kernel_part, runtime
from lagsim.native.link.engine import Engine, target
from lagsim.native.link.gradual import GradualParts
from lagsim.plan.formulation import GAIN, evaluation_cost
from lagsim.plan.method_choice import coupled
from lagsim.program import dense, departures, kernel_parts, laws, sliding
from lagsim.program.functions import (
    AFTER_FREEZING,
    functions,
    on_rates,
    section_functions,
    surface_functions,
    varying_inertias,
)
from lagsim.program.impulses import ImpulseFunction
from lagsim.program.localized import indicators
from lagsim.program.output_row import Columns
from lagsim.program.pace import Pace
from lagsim.program.patterns import RowPattern, fill, pattern, row_pattern
from lagsim.program.signatures import (
    ADVANCE,
    AT_CONDITIONS,
    AT_INSTANTS,
    FUNCTION,
    PROJECTION,
    TABULATE,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from lagsim.language.arrays import Flags, Floats
    from lagsim.mechanics.equations import Equations, Instant
    from lagsim.methods.parts.driver import State
    from lagsim.model.model import Model
    from lagsim.native.graph.keys import Functions
    from lagsim.native.graph.lines import Code
    from lagsim.plan.plan import Plan
    from lagsim.program.localized import Indicator


# Rows in one block: a few hundred kilobytes; fewer where there are many columns.
BLOCK = 2048
MOST_NUMBERS = 2**20
# Numbers in a block of states of sections.
STATES = 2**14
# Number of points of tables that are passed to the kernel at a time.
KNOTS = 256
# Functions that evaluate conditions and surfaces, and modes and momenta after an event.
CONDITIONS = (
    "located", "located_slopes", "sets", "impulses", "sections", "section_slopes",
)  # fmt: skip


def kernels(system: System) -> Iterator[ProgramPart]:
    """Yield the kernels that a method calls besides the model's functions.

    system : determines which kernels are linked.
    """
    statics = {"LAWS": bool(system.laws)}
    if system.has_loops:
        statics["WHOLE"] = system.sparsity().whole
    ends: list[Callable[..., Any]] = []
    if system.moreau is not None:
        yield kernel_part([moreau.observe])
    elif system.laws or system.plan.elimination is None:
        motion = [dense.field] if system.watched else [dense.derivative, dense.observe]
        steps = [dense.position_step, dense.velocity_step] if system.m else []
        if system.laws:
            ends = [dense.solve_motion, laws.law_event_functions, laws.share_loads]
        yield kernel_part([*motion, dense.rounding, *steps, *ends], statics)
    if system.has_jacobian:
        yield kernel_part([dense.jacobian])
    if system.watched:
        motion = [sliding.derivative, sliding.observe]
        ends = [sliding.event_functions, sliding.project_sliding]
        present = {"LAWS": bool(system.laws), "SURFACES": system.surfaces > 0}
        yield kernel_part([*motion, *ends], present)
    if system.surfaces:
        yield kernel_part(departures.KERNELS)
    if system.model.tables:
        yield kernel_part(tables.KERNELS)


def values_part(size: int, order: int, n: int) -> ProgramPart:
    """Return the program part that evaluates truncated power series and their rates.

    size, order : number of components of the series, and their order K.
    n : number of positions with constraints; 0 without constraints.
    """
    given = size, order, n
    made_from = polynomials.digest(*given)
    written = polynomials.series_values
    return graph_part(made_from, lambda: (written(*given), 0), gradual=False)


MANNER = Manner(
    contracted=("series",),
    once=("terms", "energies_masses", "inertias", "energies", "observe", "columns"),
    rare=("rounding", "force_rounding"),
)


class System:
    """The compiled functions of a model, for one formulation.

    Parameters
    ----------
    equations : Equations
        The full equations, whose columns output rows contain.
    plan : Plan
        Selects straight-line code, tapes, or loops.
    quick : bool
        Whether kernels are first linked as quick code, see `native.link.gradual`.

    Attributes
    ----------
    model : Model
        As read from the file.
    equations : Equations
        The equations that are integrated.
    n, m : int
        Numbers of coordinates, and of constraint rows with those of laws.
    size : int
        Number of components of y.
    state : tuple of str
        Names of the components of y.
    p : Parameters
        Parameters, modes, and working memory.
    first_unused : int
        Index in p at which the working memory of an arc begins.
    initial : ndarray
        Content of p before a run.
    unused : memoryview
        The working memory of an arc in `initial`.
    inertias : tuple of str
        The coordinates whose inertia varies with positions.
    laws : tuple of Law
        The rows that hold at times, of `equations`.
    watched : int
        Number of surfaces and laws, whose modes may end.
    newton : NewtonMatrix or None
        Sparse Newton matrix of an implicit method.
    together : bool
        Whether the columns of several rows are evaluated at once
        (`native.graph.lanes`).
    indicators : list of Indicator
        Activity indicators of localized terms, see `localized`.
    program : list of ProgramPart
        The model's functions, and the kernels that a method calls with them.
    operations : int
        Approximate number of operations of one evaluation of y', or of its series.
    """

    def __init__(
        self, equations: Equations, plan: Plan, *, quick: bool = False
    ) -> None:
        self.plan, self.quick = plan, quick
        self.model = equations.model
        self.columns = Columns(equations, plan.reduction.recovered)
        self.rows_observed = len(self.columns.nodes)
        self.impulses: ImpulseFunction | None = None
        if self.model.kicks:
            self.impulses = ImpulseFunction(equations, plan.reduction.recovered)
        equations = self.equations = plan.reduction.equations
        self.n, self.m = len(equations.q), len(equations.multipliers)
        self.laws = equations.laws
        needs = method(plan.method).NEEDS
        # With impulses at each step for all rows, no rows remain for other kernels.
        self.moreau = pattern(equations) if "balance" in needs else None
        self._row_patterns: dict[bool, RowPattern] = {}
        if self.moreau is not None:
            self.m, self.laws = 0, ()
        self.works = len(equations.works)
        self.inertias = tuple(varying_inertias(equations, plan))
        self.newton = plan.newton
        self.has_jacobian = "jacobian" in needs and self.newton is None
        self.state = (
            *equations.state,
            *(x.name for x in equations.works),
            *(x.name for x in equations.quadratures),
            *(equations.multipliers if self.moreau is not None else ()),
        )  # fmt: skip
        self.size = len(self.state)
        self.switches = plan.switches
        self.surfaces = len(self.switches.sides)
        # surfaces on whose sides the motion depends, the first of all surfaces
        self.acting_surfaces = self.switches.acting
        self.watched = self.surfaces + len(self.laws)
        nodes_of = functions(
            equations, plan, self.columns, needs, self.moreau,
            switching=self.watched > 0,
        )  # fmt: skip
        if self.columns.wants_sections:
            relations = self.columns.sections
            nodes_of |= section_functions(equations, relations, self.state)
        if self.impulses is not None:
            nodes_of["impulses"] = self.impulses.nodes
        self.has_energies = "energies" in nodes_of
        # Rows and conditions see the expressions as written; the method sees the arc's
        # branches.
        views = dict.fromkeys(("observe", "columns", "energies"), self.switches.shown)
        views |= dict.fromkeys(CONDITIONS, self.switches.at_levels)
        nodes_of = {
            name: views.get(name, self.switches.freeze)(nodes)
            for name, nodes in nodes_of.items()
        }
        if self.impulses is not None:  # masses and rows depend on the sides of the arc
            first = self.impulses.first_condition
            nodes = self.impulses.nodes[:first]
            nodes_of["impulses"][:first] = self.switches.freeze(nodes)
        self.indicators: list[Indicator] = []
        if self.moreau is None:
            self.indicators = self.watched_for(plan)
        if self.indicators:
            nodes_of["signals"] = [x.node for x in self.indicators]
        found, *self.pattern = surface_functions(equations, self.switches)
        nodes_of |= found
        code: dict[str, list[int] | Loop] = {**nodes_of}
        if AFTER_FREEZING in needs:
            rates = nodes_of["field" if self.watched else "derivative"][: self.size]
            made = motion_series(equations, rates, plan.rtol or 0.0, loop=not plan.tape)
            code["series"] = made
        self.operations = self._operations(code)
        code |= self._observed(nodes_of.get("observe", []), plan)
        p = self._parameters()
        layout = self._layout(p)
        written = graph_part(
            keys.fingerprint(equations.graph, code, layout, plan.tape, self._manner),
            lambda: self._code(code, layout),
        )
        self._p_size = written.p_size
        self._layout_of = layout.p
        self.p: Parameters = self._filled(p)
        self._runners: dict[str, Runner] = {}
        self.program = [written, *kernels(self)]
        if AFTER_FREEZING in needs:
            order = taylor.order_for(plan.rtol or 0.0)
            n = len(equations.q) if self.m and plan.projected else 0
            self.program.append(values_part(self.size, order, n))

    def _observed(self, nodes: list[int], plan: Plan) -> dict[str, list[int]]:
        """Return the function `observe` if several rows can be evaluated at once.

        It computes sines and cosines of fewer angles (`native.graph.lanes`). {} if the
        columns do not suit such an evaluation. Tapes evaluate the function row by row,
        with equal results to the last bit.

        nodes : the columns.
        """
        g = self.equations.graph
        suits = not self.model.tables and lanes.suits(g, nodes, self.size)
        self.together = suits and not plan.tape
        return {"observe": lanes.with_fewer_angles(g, nodes)} if suits else {}

    def _code(self, functions: Functions, layout: Layout) -> Code:
        """Return the generated code of all functions.

        Called only if the cache does not have the code.

        functions : name -> nodes written to out, or a loop.
        layout : the places of names in memory.
        """
        g = self.equations.graph
        if self.plan.tape:
            from lagsim.native.graph import tapes

            made = keys.nodes_of(functions)
            return tapes.generate(g, made, layout, self._manner)
        from lagsim.native.graph import straight_line

        return straight_line.generate(g, functions, layout, self._manner)

    @property
    def _manner(self) -> Manner:
        """Choices of how code is generated, see `native.graph.keys.Manner`."""
        matrices = (self.n + self.m) * self.n
        return MANNER._replace(
            blank=(("dynamics", matrices), ("geometry", matrices)),
            together=("observe",) * self.together,
        )

    @property
    def has_loops(self) -> bool:
        """Whether kernels of `dense` or `laws` solve equations, and need workspace."""
        loops = self.moreau is None and self.plan.elimination is None
        return loops or self.has_jacobian

    @cached_property
    def timed(self) -> list[Indicator]:
        """Indicators of localized terms that depend on t alone within an arc."""
        known = {"t"}.union(*self._fixed().values())
        depends = self.equations.graph.depends
        alone = (x for x in self.indicators if x.members == 1)
        return [x for x in alone if depends([x.node]) <= known]

    @property
    def sampled(self) -> int:
        """Least k such that indicators depend on no component of y but the first k.

        A step that is searched for localized terms approximates only these by
        polynomials.
        """
        used = self.equations.graph.depends([x.node for x in self.indicators])
        places = (k for k, name in enumerate(self.state, 1) if name in used)
        return max(places, default=0)

    def watched_for(self, plan: Plan) -> list[Indicator]:
        """Return the indicators of all terms that end or change an arc under `plan`.

        The terms belong to the equations of motion, to switches and events, and to
        sections.
        """
        equations, switches = plan.reduction.equations, plan.switches
        nodes = switches.freeze(equations.of_motion)
        ends = switches.freeze([side.node for side in switches.sides])
        ends += [x.node for x in equations.model.located]
        ends += self.columns.sections
        return indicators(equations, nodes, ends, switches.held())

    def fits(self, plan: Plan) -> bool:
        """Whether `plan` needs no compiled functions besides those of this system."""
        if plan.form != self.plan.form:
            return False
        return self.moreau is not None or self.indicators == self.watched_for(plan)

    def bound(self, model: Model, plan: Plan) -> System:
        """Return a copy of the system for other values, with its compiled functions.

        model, plan : the model and its plan with the other values; the plan must fit,
            see `fits`.
        """
        new = copy(self)
        new.set_model(model, plan)
        return new

    def set_model(self, model: Model, plan: Plan) -> None:
        """Replace model, plan and values of parameters; allocate new working memory."""
        self.plan, self.model = plan, model
        self.equations = plan.reduction.equations
        self.laws = self.equations.laws if self.moreau is None else ()
        # The values are copied: each copy has its own.
        self.__dict__.pop("restitutions", None)
        self.p = self._filled(self._parameters())
        self._runners = {name: x.over(self) for name, x in self._runners.items()}

    def _operations(self, code: Functions) -> int:
        if isinstance(series := code.get("series"), Loop):
            return series.operations
        nodes_of = keys.nodes_of(code)
        if self.moreau is not None:
            return len(self.equations.graph.cone(nodes_of["balance"]))
        loops = self.plan.elimination is None and series is None
        solved = "field" if self.watched else "derivative"
        name = "series" if series is not None else "dynamics" if loops else solved
        return evaluation_cost(self.equations, nodes_of[name], loops=loops)

    def sparsity(self) -> RowPattern:
        """Return the sparsity of the rows, memoized for all values of parameters."""
        augmented = self.plan.augmented > 0.0
        if augmented not in self._row_patterns:
            found = row_pattern(self.equations, augmented=augmented)
            self._row_patterns[augmented] = found
        return self._row_patterns[augmented]

    def _fixed(self) -> dict[str, list[str]]:
        """Return the names of values that are constant in an arc, by their arrays in p.

        The values are parameters and lengths of rows, modes of the file, and branches
        of switches of t alone.
        """
        parameters = self.equations.model.parameters
        values = [p.name for p in parameters if not p.mode]
        return {
            "fixed": values + [f"length.{row.name}" for row in self.equations.rows],
            "file_modes": [p.name for p in parameters if p.mode],
            "branches": [mode.variable for mode in self.switches.modes],
        }

    def _parameters(self) -> Parameters:
        starts, elements = self.pattern
        plan = self.plan
        sizes = {} if self.newton is None else self.newton.sizes
        if self.moreau is not None:
            sizes = {
                "row_count": len(self.equations.multipliers),
                "inertial": self.moreau.inertial, "sloping": len(self.moreau.columns),
            }  # fmt: skip
        sparsity = self.sparsity() if self.has_loops else None
        memory: Any = getattr(method(plan.method), "PARAMETERS", Parameters)
        fixed = self._fixed()
        p = memory.allocate(
            n=self.n, m=self.m, size=self.size, values=len(fixed["fixed"]),
            model_modes=len(fixed["file_modes"]), switches=len(fixed["branches"]),
            states=len(self.equations.states),
            works=self.works, laws=len(self.laws), surfaces=self.surfaces,
            elements=len(elements), corners=len(self.switches.corners),
            shown_width=self.rows_observed,
            loops=self.has_loops,
            slopes_known=self.has_jacobian,
            knots=KNOTS * any(low < high for _, _, (low, high) in self.switches.modes),
            kicked_rows=len(self.impulses.always) if self.impulses else 0, **sizes,
            **({} if sparsity is None else sparsity.sizes),
        )  # fmt: skip
        if sparsity is not None:
            sparsity.fill(p)
        if self.newton is not None:
            self.newton.fill(p)
        if self.moreau is not None:
            fill(p, self.equations, self.moreau)
        p.augmented, p.expected, p.reference = (
            plan.augmented,
            plan.rank,
            plan.smallest_singular_value,
        )
        p.usual_reference = p.reference
        p.sigma = p.least_sigma = 1.0
        p.gain, p.constant = plan.gain, plan.constant
        p.row_starts[:], p.row_columns[:] = starts, elements
        levels = np.array([(*x.smooth, *x.continuous) for x in self.switches.sides])
        p.first_smooth[:], p.last_smooth[:], p.first_met[:], p.last_met[:] = (
            levels.reshape(-1, 4).T
        )
        p.corner[list(self.switches.corners)] = 1.0
        p.on_rates[:] = on_rates(self.equations, self.switches)
        p.is_whole[:] = [side.whole for side in self.switches.sides]
        if self.works:
            p.worked[:] = self.equations.worked
        if self.laws:
            table = self.law_table
            p.law_low[:], p.law_high[:] = table.low, table.high
            p.law_gapped[:] = table.gapped
            bounds = [node for x in self.laws for node in (x.bound, x.static)]
            moves = self.equations.graph.dependent(bounds, self.equations.moving)
            p.law_varies[:] = [x.bound in moves for x in self.laws]
            fast = self.equations.graph.dependent(bounds, self.equations.velocities)
            p.law_weakens[:] = [
                x.static != x.bound and (x.bound in moves or x.static in moves)
                and fast.isdisjoint((x.bound, x.static))
                for x in self.laws
            ]  # fmt: skip
        p.law_normal[:] = [law.normal for law in self.laws]
        p.law_pair[:] = [law.pair for law in self.laws]
        places = [x.slider.coordinate if x.slider else -1 for x in self.laws]
        p.law_place[:] = places
        return cast("Parameters", p)

    def _filled(self, p: Parameters) -> Parameters:
        """Return p extended by the generated code's memory, with parameters' values."""
        # The memory of the generated code follows the declared memory.
        more = np.zeros(self._p_size - len(p.flat))
        whole = type(p)(np.concatenate([p.flat, more]))
        for row, length in zip(self.equations.rows, self.plan.lengths, strict=True):
            whole.flat[self._layout_of[f"length.{row.name}"]] = length
        for parameter in self.equations.model.parameters:
            whole.flat[self._layout_of[parameter.name]] = parameter.value
        self.first_unused = whole.place("motion")
        self.initial = whole.flat.copy()
        self.unused = self.initial.data[self.first_unused :]
        return whole

    def _layout(self, memory: Parameters) -> Layout:
        e = self.equations
        fixed = self._fixed()
        p = {
            name: memory.place(kind) + k
            for kind, names in fixed.items()
            for k, name in enumerate(names)
        }
        p[GAIN] = memory.fields["gain"].word
        for k, side in enumerate(self.switches.sides):
            p[side.variable] = memory.place("side") + k
            p[side.sliding] = memory.place("slides") + k
            p[side.slack] = memory.place("slack") + k
            p[side.departed] = memory.place("departed") + k
            if side.floor:
                p[side.floor] = memory.place("floor") + k
            if corner := self.switches.corners.get(k):
                p[corner.push] = memory.place("push") + k
        for k, name in enumerate(self.impulses.always if self.impulses else ()):
            p[IMPULSE.of(name)] = memory.place("row_impulses") + k
        for k, law in enumerate(self.laws):
            if law.normal < 0:  # the multiplier of a slip is none of these
                p[IMPULSE.of(law.constraint)] = memory.place("impulses") + k
            if law.slider and law.slider.first:
                p[law.slider.way] = memory.place("law_direction") + k
        passed = {x.variable for x in self.switches.modes if x.smooth[0] < x.smooth[1]}
        motion = e.accelerations
        if self.moreau is None:
            motion = (*motion, *e.multipliers)
        p |= {name: memory.place("motion") + k for k, name in enumerate(motion)}
        return Layout(
            y={name: k for k, name in enumerate(self.state)},
            p=p,
            fixed=frozenset().union(*fixed.values()) - passed,
            size=len(memory.flat),
        )

    def place(self, name: str) -> int:
        """Return the index in p of the parameter or mode `name`."""
        return self._layout_of[name]

    @cached_property
    def energy_columns(self) -> slice:
        """The output columns of the energies of the groups on which work is done."""
        first = self.columns.names.index("energy")
        return slice(first, first + self.works)

    @cached_property
    def file_modes(self) -> list[str]:
        """The names of the modes of the file, in their order in p."""
        return self._fixed()["file_modes"]

    def length_words(self, k: int) -> list[int]:
        """Return the indices in p that hold the length of constraint row k.

        With loops the length is stored three times: as a variable, and in two arrays.
        """
        words = [self.place(f"length.{self.equations.rows[k].name}")]
        if self.has_loops:
            words += [self.p.place(name) + k for name in ("lengths", "usual_lengths")]
        return words

    def link(self, name: str) -> Runner:
        """Return the runner of the method `name`, linked at the first call only."""
        if name not in self._runners:
            self._runners[name] = Runner(self, name)
        return self._runners[name]

    def begin(self, start: Instant) -> Floats:
        """Return the state vector y (size,) at a start.

        The memory p is first reset, so that no run depends on the run before: modes of
        the model file have their values in the model, and no surface has a side.
        """
        self.p.flat[:] = self.initial
        return self.plan.reduction.state(start, self.p)

    def set_modes(
        self, values: Sequence[float], which: Sequence[int] | None = None
    ) -> None:
        """Set the branch of each time-dependent switch for the next arc.

        which : indices of the switches; all by default.
        values : the values of the switches' discrete functions on their new branches.
        """
        self.p.branches[slice(None) if which is None else which] = values

    def copy_modes(self, other: System) -> None:
        """Copy all modes of an arc, and the knots ahead, from `other`.

        other : a system of the same model, by another plan.
        """
        for mine, its in zip(self.p.modes, other.p.modes, strict=True):
            mine[:] = its
        self.p.known, self.p.passed = other.p.known, other.p.passed
        self.p.knot_distance = other.p.knot_distance
        for name in KEPT:
            getattr(self.p, name)[:] = getattr(other.p, name)

    @cached_property
    def has_linear_sections(self) -> bool:
        """Whether all relations of sections are linear in the motion and t."""
        moving = frozenset(self.equations.moving)
        found = self.equations.graph.degrees(self.columns.sections, moving)
        return all(x is not None and x.most <= 1 for x in found)

    @cached_property
    def law_table(self) -> RowTable:
        """The constant columns of the laws."""
        return RowTable.of(self.laws)

    @cached_property
    def poles(self) -> Flags:
        """Mask of the event functions whose expressions may have poles; not of laws.

        The functions are those of surfaces, laws and conditions, in this order.
        """
        sides, located = self.switches.sides, self.model.located
        return np.array(
            [has_poles(self.equations, x.node) for x in sides]
            + [False] * len(self.laws)
            + [has_poles(self.equations, x.node) for x in located],
            dtype=bool,
        )

    @cached_property
    def has_static_bounds(self) -> Flags:
        """Mask (L,) of the laws whose static bound differs from the dynamic one."""
        return np.array([law.static != law.bound for law in self.laws], dtype=bool)

    @cached_property
    def holonomic_laws(self) -> Flags:
        """Mask (L,) of the laws with a row of positions."""
        return np.array([law.solved.holonomic for law in self.laws], dtype=bool)

    @cached_property
    def sliders(self) -> list[int]:
        """The indices of the laws that are sliders without mass."""
        return [k for k, law in enumerate(self.laws) if law.slider]

    @cached_property
    def restitutions(self) -> Floats:
        """The constant coefficients of restitution (L,); nan for an expression."""
        return np.array(
            [law.restitution if law.bounce is None else np.nan for law in self.laws]
        )

    @cached_property
    def has_times(self) -> bool:
        """Whether a law is in force at times only, by a condition `when`."""
        return any(law.when is not None for law in self.laws)

    @cached_property
    def _couplings(self) -> tuple[list[list[int]], list[tuple[int, list[int]]]]:
        """Lists of coordinates that are coupled by a row of an equality, or of a law.

        Each list of a law is paired with the law's index. Rows of a single coordinate
        couple none and are omitted, as are sliders.
        """
        e = self.equations
        rows = [[*row.A.entries] for row in e.rows]
        laws = [(k, [*x.row.A.entries]) for k, x in enumerate(e.laws) if not x.slider]
        return [x for x in rows if len(x) > 1], [x for x in laws if len(x[1]) > 1]

    def coupled_coordinates(self) -> list[int]:
        """Return, for each coordinate, the least index of a coordinate coupled to it.

        Coordinates are coupled by rows of equalities and of laws that are in force.
        """
        rows, laws = self._couplings
        on = (self.p.law_mode != OFF).tolist()
        acting = (entries for k, entries in laws if on[k])
        return joined(len(self.equations.q), [*rows, *acting])


class Runner:
    """A system linked with a method.

    Parameters
    ----------
    system : System
        The compiled functions of the model.
    name : str
        Name of the method.

    Attributes
    ----------
    method : module
        The module of the method, see `methods.method`.
    program : list of ProgramPart
        All linked parts.
    parts : GradualParts
        Parts of the program as they are linked: optimised, or as quick code.
    pace : Pace
        Pace of the runs so far.
    block : ndarray, shape (rows, 1 + size)
        Times and states of the rows written by the last call of `advance`.
    """

    def __init__(self, system: System, name: str) -> None:
        self.program = [
            *system.program,
            kernel_parts.of_method(system, name),
            *kernel_parts.of_steps(system, name),
            *kernel_parts.of_output(system, name),
        ]
        if system.equations.model.located:
            known = {"RATED": system.moreau is None}
            self.program.append(kernel_part(list(AT_CONDITIONS), known))
        self.system = system
        parts = [*self.program, *runtime(target())]
        self.parts = GradualParts(parts, quick=system.quick)
        self.pace = Pace()
        self._functions: dict[Any, Callable[[float, Floats], Floats]] = {}
        self._kernels: dict[str, Callable[..., float]] = {}
        self.method = method(name)
        self._link()
        columns, width = system.rows_observed, 1 + system.size
        self._columns, self._width = columns, width
        self.block = np.empty((max(1, min(BLOCK, MOST_NUMBERS // columns)), width))
        self._rows = address(self.block)

    def _link(self) -> None:
        """Link the parts; functions in use stay valid."""
        self.engine = Engine(self.parts.objects)
        self._prepare = self.engine.function("prepare", *FUNCTION)
        self._advance = self.engine.function("advance", *ADVANCE)
        if self.system.watched > 0:
            self._project = self.engine.function("project_sliding", *PROJECTION)
        self._tabulate = self.engine.function("tabulate", *TABULATE)

    @cached_property
    def empty(self) -> State:
        """Initial state of the method, with its memory, which each run copies."""
        system = self.system
        sizes = {} if system.newton is None else system.newton.sizes_of_factors
        located = len(system.columns.sections)
        strobes = len(system.model.output.sections) - located
        room = 0
        if located or strobes:
            room = max(2 * (located + strobes), min(BLOCK, STATES // (2 + system.size)))
        state: State = self.method.STATE.allocate(
            n=system.n,
            states=len(system.equations.states),
            size=system.size,
            signals=sum(x.members for x in system.indicators),
            sampled=system.sampled,
            sections=located,
            strobes=strobes,
            states_room=room,
            surfaces=system.watched,
            inertias=len(system.inertias),
            conditions=len(system.equations.model.located),
            noted=KNOTS * any(x.whole for x in system.switches.sides),
            **{key: x for key, x in sizes.items() if key in self.method.STATE.fields},
        )
        ends = bool(system.equations.model.located) or system.watched > 0
        state.located = float(ends or room > 0)
        state.widest = 1.0 if system.has_linear_sections else 2.0 / POINTS
        counts = [x.members for x in system.indicators]
        state.kinds[:] = np.repeat([x.kind for x in system.indicators], counts)
        state.powers[:] = np.repeat([x.power for x in system.indicators], counts)
        rows = system.equations.rows
        fixed = all(row.holonomic and row.scleronomic for row in rows)
        state.fixed_rows = float(fixed and not system.laws)
        state.joined[:] = coupled(system.equations)
        state.linked[:] = joined(system.n, [row.A.entries for row in rows])
        return state

    def over(self, system: System) -> Runner:
        """Return a copy of the runner that works in the memory of another system.

        system : a result of `System.bound`, with the code of this runner's system.
        """
        new = copy(self)
        new.__dict__ |= {"system": system, "_functions": {}}
        return new

    def function(
        self, name: str, length: int | None = None
    ) -> Callable[[float, Floats], Floats]:
        """Return the model's function `name` as a callable (t, y) -> out (length,)."""
        known = self._functions.get((name, length))
        if known is not None:
            return known
        call = self.engine.function(name, *FUNCTION)
        p, system = self.system.p.address, self.system
        size = length or max(system.rows_observed, system.size + 2, 2 + system.n)

        def evaluate(t: float, y: Floats) -> Floats:
            out, y = np.zeros(size), np.array(y, dtype=float, order="C")
            call(t, address(y), p, address(out))
            return out

        self._functions[name, length] = evaluate
        return evaluate

    def kernel(self, name: str) -> Callable[..., float]:
        """Return a kernel that runs call at instants, see `signatures.AT_INSTANTS`."""
        known = self._kernels.get(name)
        if known is None:
            known = self.engine.function(name, *AT_INSTANTS.get(name, FUNCTION))
            self._kernels[name] = known
        return known

    def event_functions(self, t: float, y: Floats) -> Floats:
        """Return the event functions (watched,) of surfaces, then of laws."""
        return self.function("event_functions", self.system.watched)(t, y)

    def at_levels(
        self, kernel: str, results: int, t: float, y: Floats, *given: Floats
    ) -> Floats:
        """Return the results (results, K) of a kernel for K surfaces at y (size,).

        kernel : the name of a kernel of `departures`.
        results : the number of results of each surface.
        given : the arrays that the kernel reads, in their order.
        """
        count, size = self.system.surfaces, self.system.size
        first = np.zeros(results * count)
        out = np.concatenate((first, *given, np.zeros(6 * size + 2 * count + 4)))
        y = np.ascontiguousarray(y)
        self.kernel(kernel)(t, address(y), self.system.p.address, address(out))
        return out[: results * count].reshape(results, count)

    def project_sliding(self, t: float, y: Floats) -> None:
        """Project y, in place, onto the surfaces that the motion slides along."""
        self._project(t, y.ctypes.data, self.system.p.address)

    def prepare(self) -> None:
        """Evaluate expressions of parameters and modes alone, and reset working memory.

        Called before each arc, so that no arc depends on the working memory of another
        one.
        """
        p = self.system.p
        usual = self.system.plan.smallest_singular_value
        # Reference and its usual value; sigma and the least; factored, noted.
        p.begun[:] = array("d", (usual, usual, 1.0, 1.0, 0.0, 0.0))
        p.numbers[self.system.first_unused :] = self.system.unused
        if self.system.has_loops:
            rows = len(self.system.plan.lengths)  # laws have no lengths
            p.lengths[:rows] = p.usual_lengths[:rows] = self.system.plan.lengths
            p.aside[:rows] = self.system.plan.set_aside
        self._prepare(0.0, None, p.address, None)

    def advance(self, state: State, rows: int, budget: int) -> int:
        """Run the method for at most `rows` rows and `budget` steps; return a code.

        See `driver.advance`.

        state : the memory of the method.
        """
        rows, quick = min(rows, len(self.block)), bool(self.parts.improvable)
        begin = process_time() if quick else 0.0
        code: int = self._advance(
            state.address, self.system.p.address, self._rows, rows, budget
        )
        if quick and self.parts.used(process_time() - begin):
            self._functions.clear()
            self._kernels.clear()
            self._link()
        return code

    def update_relations(self, state: State) -> None:
        """Evaluate sections at the time reached, before an event changes the state."""
        self.kernel("update_relations")(state.address, self.system.p.address)

    def finish(self, state: State, *, whole: bool) -> None:
        """Write the states of sections crossed at a run's end; see `crossings.finish`.

        state : the memory of the method.
        whole : whether the run has reached its end time.
        """
        finish = self.kernel("finish")
        finish(state.address, self.system.p.address, float(whole))

    def shown(self, count: int, out: Floats | None = None) -> Floats:
        """Return the table's columns (count, columns) for rows of the block.

        count : the number of rows, from the first on.
        out : contiguous memory for the columns, (count, columns); by default new
            memory.
        """
        return self._columns_of(self._rows, count, self._width - 1, out)

    def tabulate(self, states: Floats) -> Floats:
        """Return the columns (rows, columns) of `states` (rows, 1 + size): t and y."""
        states = np.ascontiguousarray(states)
        count, width = states.shape
        return self._columns_of(states.ctypes.data, count, width - 1)

    def _columns_of(
        self, states: int, count: int, size: int, out: Floats | None = None
    ) -> Floats:
        if out is None:
            out = np.empty((count, self._columns))
        if count:
            self._tabulate(
                states, count, size, self.system.p.address, address(out), self._columns
            )
        return out
