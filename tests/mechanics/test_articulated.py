"""Motion solved along chains and trees, against M written out; and its operations."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
import pytest

from benchmarks.link_chain import chain
from lagsim.language.evaluate import evaluate
from lagsim.mechanics.equations import derive
from lagsim.mechanics.ldl import Elimination, without_rows
from lagsim.model.reader import read
from tests.support import run

if TYPE_CHECKING:
    from lagsim.mechanics.equations import Equations
    from lagsim.model.model import Model


def tree(
    seed: int, n: int, *, relative: bool = False, closed: bool = False, more: str = ""
) -> str:
    """Give bodies on links that hang in a random tree from a moving pivot."""
    random = np.random.default_rng(seed)
    above = [0, *(int(random.integers(max(0, k - 4), k)) for k in range(2, n + 1))]
    lines = ["  x0: 0.2*sin(3*t)", "  y0: 0.1*cos(2*t)"]
    if relative:
        lines.append("  b0: 0.3*t")
    squares, heights = [], []
    for k, j in enumerate(above, 1):
        angle = f"b{k}" if relative else f"a{k}"
        length, mass = random.uniform(0.3, 1.0, 2)
        if relative:
            lines.append(f"  b{k}: b{j} + a{k}")
        lines += [
            f"  x{k}: x{j} + {length}*sin({angle})",
            f"  y{k}: y{j} - {length}*cos({angle})",
        ]
        squares.append(f"{mass}*(x{k}_dot^2 + y{k}_dot^2)/2")
        heights.append(f"{9.81 * mass}*y{k}")
        if k % 3 == 0:
            squares.append(f"0.05*{angle}_dot^2")
    squares.append(f"0.05*x2_dot*y{n}_dot")
    energy = f"  potential: {' + '.join(heights)} + 2*((x{n} - x1)^2 + y{n}^2)"
    held = f"constraints:\n  shut: x{n}^2 + y{n}^2 = x{n - 1} + 1\n" if closed else ""
    return "\n".join(
        [
            "coordinates:",
            *(f"  a{k}: {{}}" for k in range(1, n + 1)),
            "definitions:",
            *lines,
            "energy:",
            f"  kinetic: {' + '.join(squares)}",
            energy,
            f"  dissipation: 0.1*(x{n}_dot^2 + a2_dot^2)",
            f"forces:\n  x{n - 1}: 1.5*cos(t)\n  a1: 0.3",
            f"{held}initial:",
            *(f"  a{k}: {{guess: 0.1}}" for k in range(1, n + 1)),
            "simulation: {duration: 1, output_step: 0.1}",
            more,
        ]
    )


def in_space(n: int) -> str:
    """Give a chain of masses on links in space, in two angles each."""
    lines, squares = [], []
    for k in range(1, n + 1):
        before = [f"{c}{k - 1} + " if k > 1 else "" for c in "xyz"]
        lines += [
            f"  x{k}: {before[0]}sin(u{k})*cos(w{k})",
            f"  y{k}: {before[1]}sin(u{k})*sin(w{k})",
            f"  z{k}: {before[2]}cos(u{k})",
        ]
        squares.append(f"x{k}_dot^2 + y{k}_dot^2 + z{k}_dot^2")
    return "\n".join(
        [
            "coordinates:",
            *(f"  {c}{k}: {{}}" for k in range(1, n + 1) for c in "uw"),
            "definitions:",
            *lines,
            f"energy:\n  kinetic: ({' + '.join(squares)})/2",
            f"  potential: {' + '.join(f'z{k}' for k in range(1, n + 1))}",
            "initial:",
            *(f"  {c}{k}: 1.0" for k in range(1, n + 1) for c in "uw"),
            "simulation: {duration: 1, output_step: 0.1}",
        ]
    )


def states(model: Model, number: int = 2) -> list[dict[str, float]]:
    """Give random states; they need not meet constraints."""
    random = np.random.default_rng(5)
    given = {p.name: p.value for p in model.parameters}
    found = []
    for _ in range(number):
        state = {"t": random.uniform(0, 3)}
        for c in model.coordinates:
            state[c.name] = random.uniform(0.3, 2.8)
            state[f"{c.name}_dot"] = random.normal()
        found.append(given | state)
    return found


def written_out(e: Equations, values: dict[str, float]) -> tuple[np.ndarray, float]:
    """Give q'' and lambda from M, A, f and b in numbers, and their condition."""
    g, n, m = e.graph, len(e.q), len(e.rows)
    M = np.reshape(evaluate(g, [x for row in e.M for x in row], values), (n, n))
    A = np.reshape(evaluate(g, [x for r in e.rows for x in r.A], values), (m, n))
    right = evaluate(g, [*e.f, *(row.b for row in e.rows)], values)
    whole = np.block([[M, A.T], [A, np.zeros((m, m))]])
    found = np.linalg.solve(whole, right)
    found[n:] *= -1.0
    return found, float(np.linalg.cond(whole))


SCENES = {
    "tree": tree(1, 24),
    "large tree": tree(2, 32),
    "relative angles": tree(3, 28, relative=True),
    "closed loop": tree(4, 14, closed=True),
    "closed, relative": tree(5, 28, relative=True, closed=True),
    "in space": in_space(8),
    "chain": chain(20, 1.0),
}


@cache
def both(name: str) -> tuple[Equations, Equations]:
    """Give the equations along chains, and with M written out."""
    model = read(SCENES[name], "links")
    return derive(model), derive(model, chained=False)


@pytest.mark.parametrize("name", SCENES)
def test_motion_is_that_of_the_matrix(name: str) -> None:
    e, full = both(name)
    assert e.chains is not None
    assert full.chains is None
    elimination = Elimination(e)
    q, lam = elimination.motion()
    for values in states(e.model):
        expected, condition = written_out(full, values)
        found = evaluate(e.graph, [*q, *lam], values)
        # Both round M, whose condition multiplies that.
        bound = 1e-15 * condition * max(1.0, np.max(np.abs(expected)))
        assert found == pytest.approx(expected, rel=0, abs=bound)
        assert bound < 1e-3 * np.max(np.abs(expected))


@pytest.mark.parametrize("name", SCENES)
def test_what_else_is_made_of_the_mass_matrix(name: str) -> None:
    e, full = both(name)
    g, n = e.graph, len(e.q)
    x = [g.variable(name) for name in e.velocities]
    nodes = [
        *e.inertias,
        *e.mass_times(x),
        e.kinetic_form,
        *without_rows(e).motion()[0],
    ]
    for values in states(e.model):
        M = np.reshape(evaluate(g, [m for row in full.M for m in row], values), (n, n))
        f = np.array(evaluate(g, list(full.f), values))
        v = np.array([values[name] for name in e.velocities])
        found = np.array(evaluate(g, nodes, values))
        terms = np.max(np.abs(M)) * np.sum(np.abs(v))
        assert found[:n] == pytest.approx(np.diag(M), rel=1e-13)
        assert found[n : 2 * n] == pytest.approx(M @ v, rel=0, abs=1e-13 * terms)
        if e.energy_is_sum and name in ("in space", "chain"):
            assert found[2 * n] == pytest.approx(v @ M @ v / 2, rel=1e-13)
        expected = np.linalg.solve(M, f)
        bound = 1e-15 * np.linalg.cond(M) * max(1.0, np.max(np.abs(expected)))
        assert found[2 * n + 1 :] == pytest.approx(expected, rel=0, abs=bound)


@pytest.mark.parametrize("name", SCENES)
def test_forces_are_those_of_lagrange_s_equations(name: str) -> None:
    e, full = both(name)
    moving = {*e.q, *e.velocities, "t"}
    assert e.graph.cost(e.f, moving) < 0.8 * e.graph.cost(full.f, moving)
    for values in states(e.model):
        expected = np.array(evaluate(e.graph, full.f, values))
        found = evaluate(e.graph, e.f, values)
        # Lagrange's sums have terms that cancel, of the size of the largest at most.
        bound = 1e-13 * np.max(np.abs(expected))
        assert found == pytest.approx(expected, rel=1e-12, abs=bound)


def test_sums_that_are_no_rates_of_a_definition_keep_their_forces() -> None:
    """The same chain, its velocities written by hand: nothing tells their positions."""
    n = 12
    lines = ["  vx1: cos(a1)*a1_dot", "  vy1: sin(a1)*a1_dot"]
    for k in range(2, n + 1):
        lines += [
            f"  vx{k}: vx{k - 1} + cos(a{k})*a{k}_dot",
            f"  vy{k}: vy{k - 1} + sin(a{k})*a{k}_dot",
        ]
    links = range(1, n + 1)
    heights = [f"{n - k + 1}*cos(a{k})" for k in links]
    text = "\n".join(
        [
            "coordinates:",
            *(f"  a{k}: {{}}" for k in links),
            "definitions:",
            *lines,
            "energy:",
            f"  kinetic: ({' + '.join(f'vx{k}^2 + vy{k}^2' for k in links)})/2",
            f"  potential: -({' + '.join(heights)})",
            "initial:",
            *(f"  a{k}: 1.0" for k in links),
            "simulation: {duration: 1, output_step: 0.1}",
        ]
    )
    e = derive(read(text, "links"))
    full = derive(e.model, chained=False)
    assert e.chains is not None
    [values] = states(e.model, 1)
    expected = evaluate(e.graph, full.f, values)
    assert evaluate(e.graph, e.f, values) == pytest.approx(expected, rel=1e-12)


def test_entries_of_a_chain_are_those_of_the_closed_form() -> None:
    """M_ij = m l^2 (n - max(i, j)) cos(a_i - a_j), counted from 0."""
    n = 12
    e = derive(read(chain(n, 1.0), "links"))
    [values] = states(e.model, 1)
    a = np.array([values[name] for name in e.q])
    behind = n - np.maximum.outer(np.arange(n), np.arange(n))
    expected = behind * np.cos(a[:, None] - a) / n**2
    nodes = [x for row in e.M for x in row]
    found = np.reshape(evaluate(e.graph, nodes, values), (n, n))
    assert found == pytest.approx(expected, rel=0, abs=1e-14)
    assert evaluate(e.graph, e.inertias, values) == pytest.approx(np.diag(expected))


def test_few_links_and_free_bodies_keep_their_entries() -> None:
    assert derive(read(chain(5, 1.0), "links")).chains is None
    assert derive(read(chain(7, 1.0), "links")).chains is None
    text = SCENES["chain"]
    assert derive(read(text, "links")).chains is not None
    # 20 pairs that do not meet.
    pairs = [f"(a{k}_dot + sin(a{k})*a{k + 1}_dot)^2" for k in range(1, 20, 2)]
    free = [f"a{k}_dot^2" for k in range(1, 21)]
    kinetic = f'  kinetic: "{" + ".join(pairs + free)}"'
    lines = [kinetic if "kinetic:" in x else x for x in text.splitlines()]
    assert derive(read("\n".join(lines), "links")).chains is None


def test_what_is_no_polynomial_of_velocities_keeps_its_entries() -> None:
    text = SCENES["chain"].replace('kinetic: "', 'kinetic: "cosh(a3_dot) + ')
    assert derive(read(text, "links")).chains is None
    text = SCENES["chain"].replace('kinetic: "', 'kinetic: "a3_dot^4 + ')
    assert derive(read(text, "links")).chains is None


@pytest.mark.slow
def test_operations_grow_as_the_number_of_links() -> None:
    found = []
    for n in (50, 100, 200):
        e = derive(read(chain(n, 1.0), "links"))
        elimination = Elimination(e, 40 * n)
        q, _ = elimination.motion()
        nodes = len(e.graph.cone([*q, e.energy, e.kinetic_form, *e.inertias]))
        found.append((elimination.operations, nodes, len(e.graph)))
        assert "rows" not in vars(e.M)  # n^2 entries were not made
    growth = np.diff(found, axis=0)
    # The first and the last links differ from the others, which are all alike.
    assert np.all(growth[1:] == 2 * growth[:-1])


@pytest.mark.slow
def test_two_hundred_links_keep_their_energy() -> None:
    found = run(read(chain(200, 0.1), "links"))
    assert found.trajectory.outcome.complete
    assert found.session.plan.tape
    names = found.session.system.columns.names
    kinetic, energy = (found.rows[:, names.index(x)] for x in ("kinetic", "energy"))
    # Let go level, at rest: the energy is 0, and each step is held to 1e-11.
    assert np.max(np.abs(energy)) < 1e-9 * np.max(kinetic)
    # Level links do not pull, and the bend at the pivot is far from the tip: it falls.
    tip, t = (found.rows[:, names.index(x)] for x in ("y200", "t"))
    assert tip == pytest.approx(-9.81 * t**2 / 2, rel=1e-6, abs=1e-15)
