"""Equations -> compiled functions, linked with a method into something that runs.

The state is y = (q, q', work where the model has it). Compiled functions take
(t, y, p, out); p holds the parameters, the modes of the arc and working memory, so that
new values of parameters compile nothing.
"""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING, Any

import numpy as np

from lagsim.kkt import _layout
from lagsim.methods import _driver, method
from lagsim.methods._interface import LEAST_HEALTH
from lagsim.native.cache import kernel_object, object_code
from lagsim.native.engine import Engine
from lagsim.native.graph_code import Layout, generate
from lagsim.switches import find_switches

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from lagsim.equations import Equations
    from lagsim.kkt.straight import Elimination
    from lagsim.native.kernel_types import Floats
    from lagsim.plan import Plan

_POINTER = ctypes.c_void_p
_FUNCTION = (None, (ctypes.c_double, _POINTER, _POINTER, _POINTER))
_ADVANCE = (
    ctypes.c_int64,
    (_POINTER, _POINTER, _POINTER, ctypes.c_int64, ctypes.c_int64),
)
_TABULATE = (
    None,
    (_POINTER, ctypes.c_int64, ctypes.c_int64, _POINTER, _POINTER, ctypes.c_int64),
)


class Columns:
    """What is computed for each row: the columns of the table, then what plots need.

    Attributes
    ----------
    nodes : dict of str to int
        In the order of the table; expressions of the state, q'' and lambda.
    table : int
        How many of them the table shows.
    """

    def __init__(self, equations: Equations) -> None:
        model, g = equations.model, equations.graph
        nodes = {"t": g.variable("t")}
        for group in (equations.q, equations.velocities, equations.accelerations):
            nodes.update((name, g.variable(name)) for name in group)
        defined = {d.name: d.node for d in model.definitions}
        nodes.update((name, defined[name]) for name in model.output.columns)
        if model.kinetic is not None and model.potential is not None:
            nodes |= {"kinetic": model.kinetic, "potential": model.potential}
        else:
            nodes["lagrangian"] = model.lagrangian
        nodes["energy"] = equations.energy
        if equations.power is not None:
            nodes["work"] = g.variable("work")
        nodes.update((name, g.variable(name)) for name in equations.multipliers)
        forces = equations.constraint_forces() if equations.rows else []
        names = [f"Qc_{q}" for q in equations.q]
        nodes.update(zip(names, forces, strict=False))
        nodes.update((f"residual_{row.name}", row.residual) for row in equations.rows)
        self.table = len(nodes)
        nodes.update(
            (f"scale.{row.name}", row.residual_scale) for row in equations.rows
        )
        for name, components in model.scene.points.items():
            for k, node in enumerate(components, 1):
                nodes[f"point.{name}.{k}"] = node
        for k, plot in enumerate(model.output.plots):
            nodes |= {f"plot.{k}.x": plot.x, f"plot.{k}.y": plot.y}
        new = {g.variable("energy"): equations.energy}
        new |= {
            g.variable(f"Qc_{q}"): f for q, f in zip(equations.q, forces, strict=False)
        }
        self.nodes = dict(zip(nodes, g.substitute(nodes.values(), new), strict=True))

    @property
    def names(self) -> tuple[str, ...]:
        """All names, in order."""
        return tuple(self.nodes)


class System:
    """The compiled functions of a model, for one formulation.

    Parameters
    ----------
    equations : Equations
    plan : Plan
        The formulation decides between straight-line code and loops.

    Attributes
    ----------
    size : int
        Components of y.
    p : ndarray
        Parameters, modes, and working memory.
    """

    def __init__(self, equations: Equations, plan: Plan) -> None:
        self.equations = equations
        self.plan = plan
        self.n, self.m = len(equations.q), len(equations.rows)
        self.has_work = equations.power is not None
        self.size = 2 * self.n + self.has_work
        self.columns = Columns(equations)
        self.rows_observed = len(self.columns.nodes)
        functions = self._functions(plan.elimination)
        state = [*equations.q, *equations.velocities]
        moving = [*state, "work", *equations.accelerations, *equations.multipliers]
        self.switches = find_switches(equations.graph, _physics(equations), moving)
        # Rows show the expressions as written; the method sees the arc's branches.
        live = ("observe", "columns", "until")
        functions = {
            name: nodes if name in live else self.switches.freeze(nodes)
            for name, nodes in functions.items()
        }
        layout = self._layout()
        code = generate(equations.graph, functions, layout)
        self.p = np.zeros(code.p_size)
        self.p[: _layout.HEADER] = [
            self.n, self.m, self.motion, self.has_work, plan.augmented, plan.rank,
            plan.independence, 1.0, 1.0, self._weak(),
        ]  # fmt: skip
        for row, length in zip(equations.rows, plan.lengths, strict=True):
            self.p[layout.p[f"length.{row.name}"]] = length
        for parameter in equations.model.parameters:
            self.p[layout.p[parameter.name]] = parameter.value
        self.modes_at = [layout.p[mode.variable] for mode in self.switches.modes]
        self._runners: dict[str, Runner] = {}
        self._objects = [object_code(code.ir)]
        if plan.elimination is None:
            self._objects.append(_loops(constrained=self.m > 0))

    def _weak(self) -> int:
        """Give where loops note the weakest direction; 0 where none do."""
        if self.plan.elimination is not None:
            return 0
        return self.motion + _layout.weak_direction(self.n, self.m)

    def _functions(self, elimination: Elimination | None) -> dict[str, list[int]]:
        """Give what is compiled from the graph: name -> what it writes to out."""
        e, g = self.equations, self.equations.graph
        diagonal = [e.M[i][i] for i in range(self.n)]
        rest = g.call("sub", e.energy, e.kinetic_form)
        functions = {"measure": [e.kinetic_form, rest, *diagonal, self._driven()]}
        simulation = e.model.simulation
        if simulation and simulation.until:
            functions["until"] = [simulation.until.node]
        if elimination is None:
            return functions | self._terms()
        accelerations, multipliers = elimination.motion()
        new = {
            g.variable(v): node
            for v, node in zip(e.multipliers, multipliers, strict=True)
        }
        velocities = [g.variable(v) for v in e.velocities]
        power = [e.power] if e.power is not None else []
        functions["derivative"] = [
            *velocities, *accelerations, *g.substitute(power, new),
        ]  # fmt: skip
        new |= {
            g.variable(v): node
            for v, node in zip(e.accelerations, accelerations, strict=True)
        }
        functions["observe"] = g.substitute(self.columns.nodes.values(), new)
        if self.m:
            held, moving, worst_held, worst_moving = self._residuals()
            functions["position_step"] = [*elimination.correction(held), worst_held]
            functions["velocity_step"] = [
                *elimination.correction(moving), worst_moving, elimination.health(),
            ]  # fmt: skip
        return functions

    def _driven(self) -> int:
        """Give the sum of f^2 / M over the diagonal, where it is not zero."""
        e, g = self.equations, self.equations.graph
        total = g.zero
        for i, force in enumerate(e.f):
            if e.M[i][i] != g.zero:
                part = g.call("div", g.call("mul", force, force), e.M[i][i])
                some = g.call("gt", e.M[i][i], g.zero)
                total = g.call("add", total, g.call("if", some, part, g.zero))
        return total

    def _residuals(self) -> tuple[list[int], list[int], int, int]:
        """Give residuals (m,), rates (m,), and the largest of each against its scale.

        Relations between velocities have no residual on the level of positions.
        """
        g, rows = self.equations.graph, self.equations.rows
        held = [r.residual if r.holonomic else g.zero for r in rows]
        rates = [r.rate for r in rows]

        def worst(pairs: list[tuple[int, int]]) -> int:
            largest = g.zero
            for residual, scale in pairs:
                part = g.call("div", g.call("abs", residual), scale)
                some = g.call("gt", scale, g.zero)
                largest = g.call("max", g.call("if", some, part, g.zero), largest)
            return largest

        return (
            held,
            rates,
            worst([(r, row.residual_scale) for r, row in zip(held, rows, strict=True)]),
            worst([(r, row.rate_scale) for r, row in zip(rates, rows, strict=True)]),
        )

    def _terms(self) -> dict[str, list[int]]:
        """Give what the loops of `kkt.dense` begin with."""
        e, g = self.equations, self.equations.graph
        M = [node for row in e.M for node in row]
        A = [node for row in e.rows for node in row.A]
        power = e.power if e.power is not None else g.zero
        none = {g.variable(v): g.zero for v in e.multipliers}
        dynamics = [
            *M, *A, *e.f, *(r.b for r in e.rows),
            *g.substitute([power], none), *(r.transport for r in e.rows),
        ]  # fmt: skip
        functions = {"dynamics": dynamics, "columns": list(self.columns.nodes.values())}
        if self.m:
            held, moving, worst_held, worst_moving = self._residuals()
            functions["geometry"] = [
                *M, *A, *held, *moving, worst_held, worst_moving,
            ]  # fmt: skip
        return functions

    def _layout(self) -> Layout:
        e = self.equations
        state = (*e.q, *e.velocities, "work")
        fixed = [p.name for p in e.model.parameters]
        fixed += [mode.variable for mode in self.switches.modes]
        fixed += [f"length.{row.name}" for row in e.rows]
        p = {name: _layout.HEADER + k for k, name in enumerate(fixed)}
        self.motion = _layout.HEADER + len(fixed)
        motion = (*e.accelerations, *e.multipliers)
        p |= {name: self.motion + k for k, name in enumerate(motion)}
        loops = (
            _layout.workspace(self.n, self.m) if self.plan.elimination is None else 0
        )
        return Layout(
            y={name: k for k, name in enumerate(state)},
            p=p,
            fixed=frozenset(fixed),
            size=self.motion + max(loops, len(motion)),
        )

    def link(self, name: str) -> Runner:
        """Link with the method `name`, once."""
        if name not in self._runners:
            self._runners[name] = Runner(self, name)
        return self._runners[name]

    def set_modes(self, values: Sequence[float]) -> None:
        """Set the branch of each switch in time for the arc to come."""
        self.p[self.modes_at] = values

    def units(self) -> dict[str, str]:
        """Give the unit of each column of the table, where it is known."""
        model = self.equations.model
        units = dict.fromkeys(self.columns.names[: self.columns.table], "")
        for c in model.coordinates:
            if c.unit:
                units[c.name] = c.unit
                units[f"{c.name}_dot"] = f"{c.unit}/s"
                units[f"{c.name}_ddot"] = f"{c.unit}/s^2"
        units["t"] = "s"
        known = {d.name: d.unit for d in model.definitions}
        return {name: known.get(name, unit) for name, unit in units.items()}


class Runner:
    """A system linked with a method.

    Attributes
    ----------
    method : module
    """

    def __init__(self, system: System, name: str) -> None:
        self.system = system
        self.method = method(name)
        simulation = system.equations.model.simulation
        statics = {
            "CONSTRAINED": system.m > 0,
            "UNTIL": bool(simulation and simulation.until),
        }
        kernels = [self.method.start, self.method.step, self.method.interpolate]
        self.engine = Engine(
            [
                *system._objects,  # noqa: SLF001
                kernel_object(kernels, _used(statics, self.method)),
                kernel_object([_driver.advance, _driver.tabulate], statics),
            ]
        )
        self._advance = self.engine.function("advance", *_ADVANCE)
        self._tabulate = self.engine.function("tabulate", *_TABULATE)

    def function(self, name: str) -> Callable[[float, Floats], Floats]:
        """Give one of the model's functions as (t, y) -> out, for tests and reports."""
        call = self.engine.function(name, *_FUNCTION)
        p = self.system.p
        length = max(self.system.rows_observed, self.system.size + 2, 2 + self.system.n)

        def evaluate(t: float, y: Floats) -> Floats:
            out = np.zeros(length)
            y = np.ascontiguousarray(y, dtype=float)
            call(t, y.ctypes.data, p.ctypes.data, out.ctypes.data)
            return out

        return evaluate

    def prepare(self) -> None:
        """Compute what depends on parameters and modes alone, before each arc.

        No arc sees what another one left in the working memory.
        """
        call = self.engine.function("prepare", *_FUNCTION)
        p = self.system.p
        p[_layout.REFERENCE] = self.system.plan.independence
        p[_layout.HEALTH] = p[LEAST_HEALTH] = 1.0
        p[self.system.motion :] = 0.0
        if self.system.plan.elimination is None:
            lengths = self.system.motion + self.system.n + self.system.m
            p[lengths : lengths + self.system.m] = self.system.plan.lengths
            aside = lengths + self.system.m
            p[aside : aside + self.system.m] = self.system.plan.set_aside
        call(0.0, None, p.ctypes.data, None)

    def advance(self, state: Floats, out: Floats, budget: int) -> int:
        """Run the method on; see `methods._driver.advance`. out : (rows, 1 + size)."""
        p = self.system.p
        return int(
            self._advance(
                state.ctypes.data, p.ctypes.data, out.ctypes.data, len(out), budget
            )
        )

    def tabulate(self, states: Floats) -> Floats:
        """Give the columns (rows, columns) of `states` (rows, 1 + size)."""
        out = np.empty((len(states), self.system.rows_observed))
        states = np.ascontiguousarray(states)
        self._tabulate(
            states.ctypes.data, len(states), states.shape[1] - 1,
            self.system.p.ctypes.data, out.ctypes.data, out.shape[1],
        )  # fmt: skip
        return out


def _physics(equations: Equations) -> list[int]:
    """Give the expressions whose switches are the model's own."""
    nodes = [node for row in equations.M for node in row]
    nodes += [*equations.f, equations.energy]
    nodes += [] if equations.power is None else [equations.power]
    for row in equations.rows:
        nodes += [row.residual, row.rate, *row.A, row.b, row.transport]
    return nodes


def _loops(*, constrained: bool) -> bytes:
    """Give the object code of the solve by loops."""
    from lagsim.kkt import dense

    kernels: list[Callable[..., Any]] = [dense.derivative, dense.observe]
    if constrained:
        kernels += [dense.position_step, dense.velocity_step]
    return kernel_object(kernels)


def _used(statics: Mapping[str, object], module: Any) -> dict[str, object]:
    return {name: value for name, value in statics.items() if hasattr(module, name)}
