"""Sparse elimination run from a tape: its cost, and its answers against the others."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.rod_chain import rod_chain
from lagsim.mechanics.ldl import BUDGET
from lagsim.native.graph import tapes
from lagsim.program.system import System
from lagsim.run.events.breaks import Values, values_by_majority
from lagsim.run.observers import Keep
from tests.support import SHIPPED, case_of, ready, run

TIME = 0.3  # of the states below


@pytest.mark.slow
def test_cost_grows_in_proportion(monkeypatch, tmp_path):
    # What is in the cache is not made anew.
    monkeypatch.setenv("LAGSIM_CACHE", str(tmp_path))
    made = []
    generate = tapes.generate

    def noted(*arguments):
        made.append(generate(*arguments))
        return made[-1]

    monkeypatch.setattr(tapes, "generate", noted)
    costs = []
    for n in (50, 100):
        session = ready(rod_chain(n, 1.0))
        e, plan = session.case.equations, session.plan
        assert "solve: sparse elimination" in [c.choice for c in plan.choices]
        entries = len(e.mass_entries) + sum(len(row.A.entries) for row in e.rows)
        code = made[-1]
        costs.append(
            [
                plan.elimination.operations,
                entries,
                len(e.graph),
                len(code.ir),
                code.p_size,
            ]
        )
    few, many = costs
    assert np.all(np.array(many) / few < 2.1)


def states(start, number=3):
    """Return random states, which need not satisfy the constraints."""
    random = np.random.default_rng(8)
    for _ in range(number):
        q = start.q + 0.2 * random.standard_normal(len(start.q))
        yield np.concatenate([q, random.standard_normal(len(q)), [0.0]])


def motion(e, plan):
    """Return the function of a state that returns q'' and lambda."""
    system = System(e, plan)
    runner = system.link("dop853")
    if system.switches.modes:
        parameters = {p.name: p.value for p in e.model.parameters}
        discrete = [mode.discrete for mode in system.switches.modes]
        value = Values(e.graph, discrete, parameters)
        system.set_modes(values_by_majority(value, TIME, TIME + 1e-9))
    runner.prepare()
    names = system.columns.names
    wanted = [names.index(name) for name in (*e.accelerations, *e.multipliers)]
    return lambda y: runner.function("observe")(TIME, y[: system.size])[wanted]


@pytest.mark.parametrize(
    "name",
    [pytest.param(x, marks=[pytest.mark.slow] * (x == "bicycle")) for x in SHIPPED],
)
def test_tapes_give_the_bits_of_compiled_code(name):
    case = case_of(name)
    e, plan = case.equations, case.plan()
    tape, code = (motion(e, replace(plan, tape=k)) for k in (True, False))
    for y in states(case.start, 2):
        assert np.array_equal(tape(y), code(y), equal_nan=True)


@pytest.mark.parametrize("n", [5, pytest.param(20, marks=pytest.mark.slow)])
def test_a_run_is_that_of_the_full_form(n):
    text = rod_chain(n, 0.3)
    full = run(text, loops=True)
    e = full.equations
    keep = Keep()
    case = full.session.case
    session = case.ready(replace(case.plan(), tape=True))
    system = session.system
    assert session.run([keep]).outcome.complete
    rows = keep.table
    names = system.columns.names
    state = [names.index(name) for name in (*e.q, *e.velocities)]
    size = np.max(np.abs(full.rows[:, state]), axis=0)
    apart = np.abs(rows[:, state] - full.rows[:, state])
    assert np.max(apart / np.max(size)) < 1e-10
    energy = rows[:, names.index("energy")]
    assert np.max(np.abs(energy - energy[0])) < 1e-12  # of some joules
    held = rows[:, [names.index(f"residual_{row.name}") for row in e.rows]]
    assert np.max(np.abs(held)) < 1e-15


@pytest.mark.slow
def test_the_plan_chooses_by_operations():
    small = case_of(rod_chain(10, 1.0)).plan()
    assert not small.tape
    assert small.elimination.operations <= BUDGET
    large = case_of(rod_chain(50, 1.0)).plan()
    assert large.tape
    choice = next(c for c in large.choices if c.choice.startswith("solve"))
    assert str(large.elimination.operations) in choice.reason
    # Of a full M elimination on the graph saves nothing.
    full = case_of(full_matrix(40)).plan()
    assert full.elimination is None
    assert not full.tape


def full_matrix(n):
    """Return a scene in which each velocity occurs in products with all others."""
    names = [f"a{k}" for k in range(n)]
    terms = [f"{n}*{a}_dot^2" for a in names]
    pairs = [(a, b) for i, a in enumerate(names) for b in names[:i]]
    terms += [f"cos({a} - {b})*{a}_dot*{b}_dot" for a, b in pairs]
    lines = ["coordinates:", *(f"  {a}: {{}}" for a in names)]
    lines += [f'energy: {{kinetic: "{" + ".join(terms)}", potential: 0}}', "initial:"]
    return "\n".join([*lines, *(f"  {a}: 0.1" for a in names)]) + "\n"
