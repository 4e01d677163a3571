"""Masses on massless links, solved for the tensions: values, digits and operations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import mpmath
import numpy as np
import pytest

from benchmarks.link_chain import chain
from lagsim.language.evaluate import evaluate
from lagsim.language.sparse import Meter
from lagsim.mechanics.equations import derive
from lagsim.mechanics.ldl import Elimination, factored_mass
from lagsim.mechanics.tensions import accelerations
from lagsim.model.reader import read
from tests.mechanics.test_articulated import in_space, states, written_out

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from lagsim.mechanics.equations import Equations

LINE = tuple(range(7))
TREE = (0, 1, 1, 2, 2, 2, 4)


def bodies(
    above: Sequence[int],
    *,
    pivot: tuple[str, str] = ("0", "0"),
    own: Sequence[str] = (),
    relative: bool = False,
    energy: tuple[str, str] = ("0", "0"),
    masses: Sequence[float] = (),
    lengths: Sequence[float] = (),
    more: str = "",
) -> str:
    """Give the text of masses on links, link k on the mass above[k - 1] or the pivot.

    Parameters
    ----------
    own
        Coordinates beside the angles.
    relative
        Angles are those between links.
    energy
        What is added to the kinetic and to the potential energy.
    """
    numbers = range(1, len(above) + 1)
    m = dict(zip(numbers, map(repr, map(float, masses)), strict=False))
    lengths_of = dict(zip(numbers, map(repr, map(float, lengths)), strict=False))
    angle = "b" if relative else "a"
    lines = []
    for k, j in zip(numbers, above, strict=True):
        if relative:
            lines.append(f"  b{k}: {f'b{j} + ' if j else ''}a{k}")
        x, y = (f"x{j}", f"y{j}") if j else pivot
        length = lengths_of.get(k, "l")
        lines += [
            f"  x{k}: {x} + {length}*sin({angle}{k})",
            f"  y{k}: {y} - {length}*cos({angle}{k})",
        ]
    squares = (f"{m.get(k, 'm')}*(x{k}_dot^2 + y{k}_dot^2)/2" for k in numbers)
    heights = (f"{m.get(k, 'm')}*g*y{k}" for k in numbers)
    return "\n".join(
        [
            "parameters: {m: 0.7, l: 0.3, g: 9.81, M: 2.0}",
            "coordinates:",
            *(f"  {name}: {{}}" for name in own),
            *(f"  a{k}: {{}}" for k in numbers),
            "definitions:",
            *lines,
            "energy:",
            f"  kinetic: {' + '.join((*squares, energy[0]))}",
            f"  potential: {' + '.join((*heights, energy[1]))}",
            more,
            "initial:",
            *(f"  {name}: 0.1" for name in own),
            *(f"  a{k}: 1.0" for k in numbers),
            "simulation: {duration: 1, output_step: 0.1}",
        ]
    )


FORCED = "forces:\n  x4: 1.5*cos(t)\n  a1: 0.3"
LOSSES = "  dissipation: 0.1*(x5_dot^2 + a2_dot^2)\n"
TWISTED = " + ".join(f"2.5*(a{k} - a{k - 1})^2/2" for k in range(2, 8))
SCENES = {
    "pair": bodies(LINE[:2]),
    "two trees": bodies((*TREE, 0, 8)),
    "cart": bodies(LINE, pivot=("s", "0"), own=("s",), energy=("M*s_dot^2/2", "0")),
    "free": bodies(
        LINE,
        pivot=("s", "h"),
        own=("s", "h"),
        energy=("M*(s_dot^2 + 3*h_dot^2)/2", "M*g*h"),
    ),
    "moving": bodies(
        LINE, pivot=("0.2*sin(3*t)", "0.1*cos(2*t)"), more=LOSSES + FORCED
    ),
    "twisted": bodies(LINE, energy=("0", TWISTED)),
    "springs": bodies(LINE, energy=("0", "2*((x7 - x1)^2 + y7^2)")),
    "relative tree": bodies(
        TREE, relative=True, pivot=("0.2*sin(3*t)", "0"), more=LOSSES + FORCED
    ),
}


def springs(n: int) -> str:
    """Give masses that hang on each other by massless springs."""
    numbers = range(1, n + 1)
    lines = [f"  {c}0: 0" for c in "xy"]
    for k in numbers:
        lines += [
            f"  x{k}: x{k - 1} + (l + r{k})*sin(a{k})",
            f"  y{k}: y{k - 1} - (l + r{k})*cos(a{k})",
        ]
    squares = " + ".join(f"m*(x{k}_dot^2 + y{k}_dot^2)/2" for k in numbers)
    work = " + ".join(f"m*g*y{k} + 20*r{k}^2/2" for k in numbers)
    return "\n".join(
        [
            "parameters: {m: 0.7, l: 0.3, g: 9.81}",
            "coordinates:",
            *(f"  {c}{k}: {{}}" for k in numbers for c in "ra"),
            "definitions:",
            *lines,
            f"energy:\n  kinetic: {squares}\n  potential: {work}",
            "initial:",
            *(f"  {c}{k}: 0.1" for k in numbers for c in "ra"),
            "simulation: {duration: 1, output_step: 0.1}",
        ]
    )


SCENES |= {"springs in a row": springs(4), "in space": in_space(4)}


def moving_operations(e: Equations, nodes: Iterable[int]) -> int:
    """Count what each evaluation takes."""
    moving = {*e.q, *e.velocities, "t"}
    return sum(bool(e.graph.args[k]) for k in e.graph.dependent(nodes, moving))


@pytest.mark.parametrize("name", SCENES)
def test_motion_is_that_of_the_matrix(name: str) -> None:
    e = derive(read(SCENES[name], "links"), chained=False)
    g, found = e.graph, accelerations(e)
    assert found is not None
    assert Elimination(e).motion()[0] == found
    before = factored_mass(e, Meter()).solve(dict(enumerate(e.f)))
    assert moving_operations(e, found) < 0.85 * moving_operations(e, before.values())
    for values in states(e.model):
        expected, condition = written_out(e, values)
        # The matrix is rounded, whose condition multiplies that.
        bound = 1e-15 * condition * max(1.0, np.max(np.abs(expected)))
        assert evaluate(g, found, values) == pytest.approx(expected, rel=0, abs=bound)
        assert bound < 1e-3 * np.max(np.abs(expected))


def exact(
    masses: np.ndarray, lengths: np.ndarray, a: np.ndarray, w: np.ndarray
) -> list[mpmath.mpf]:
    """Give the accelerations of a chain by its closed form.

    sum_j S_ij l_i l_j (cos(a_i - a_j) a_j'' + sin(a_i - a_j) a_j'^2) is the torque of
    gravity, -S_ii g l_i sin(a_i), where S_ij is the mass that hangs on both links.
    """
    n = len(masses)
    m, lengths, a, w = (
        [mpmath.mpf(float(x)) for x in y] for y in (masses, lengths, a, w)
    )
    below = [mpmath.fsum(m[k:]) for k in range(n)]
    M, f = mpmath.matrix(n, n), mpmath.matrix(n, 1)
    for i in range(n):
        f[i] = -below[i] * mpmath.mpf(9.81) * lengths[i] * mpmath.sin(a[i])
        for j in range(n):
            weight = below[max(i, j)] * lengths[i] * lengths[j]
            M[i, j] = weight * mpmath.cos(a[i] - a[j])
            f[i] -= weight * mpmath.sin(a[i] - a[j]) * w[j] ** 2
    return list(mpmath.lu_solve(M, f))


@pytest.mark.parametrize("orders", [0, 3])
def test_each_acceleration_has_nearly_all_digits(orders: float) -> None:
    """In line or not, and for masses of other orders: M has a condition of 1e6."""
    n, random = 7, np.random.default_rng(7)
    masses = 10.0 ** random.uniform(-orders, orders, n)
    lengths = random.uniform(0.3, 1.0, n)
    e = derive(read(bodies(LINE, masses=masses, lengths=lengths), "links"))
    given = {p.name: p.value for p in e.model.parameters}
    nodes = Elimination(e).motion()[0]
    for bend in (1.0, 1e-6, 0.0):
        a, w = 0.7 + bend * random.normal(size=n), random.normal(size=n)
        values = given | dict(zip((*e.q, *e.velocities), (*a, *w), strict=True))
        with mpmath.workdps(60):
            expected = exact(masses, lengths, a, w)
        largest = max(map(abs, expected))
        for x, y in zip(evaluate(e.graph, nodes, values), expected, strict=True):
            # Some twenty operations a link; in line the others do not move at all.
            assert abs(x - y) < 2e-14 * abs(y) + 1e-30 * largest


def test_operations_of_a_chain() -> None:
    """17 a link, counted on paper.

    A difference of angles, its sine and cosine, a'^2; sin^2, its sum with what the
    pivot behind has beside 1, the pivot, and these two and the cosine over it; the
    right side's product and sum; quotient, product and sum for the tension; two
    products and a sum for a''. Textbooks' elimination, 2 - cos^2/pivot, takes 16.
    """
    counts = []
    for n in (7, 17):
        e = derive(read(chain(n, 1.0), "links"))
        counts.append(moving_operations(e, Elimination(e).motion()[0]))
    assert counts[1] - counts[0] <= 10 * 17
    assert counts[0] <= 7 * 17


@pytest.mark.parametrize(
    "text",
    [
        # Links with inertia, a mass that moves, and masses that are nothing.
        bodies(LINE, energy=("0.2*a3_dot^2", "0")),
        bodies(LINE, energy=("x3_dot*y5_dot", "0")),
        bodies(LINE, energy=("cos(a1)^2*x3_dot^2", "0")),
        bodies(LINE).replace("m: 0.7", "m: 0.0"),
        # L names no position whose rate is this sum.
        bodies(LINE, energy=("(x3_dot + a1)^2 - x3_dot^2", "0")),
        # Constraints.
        bodies(LINE, more="constraints:\n  shut: x7 = 1"),
    ],
)
def test_what_is_none_of_these_keeps_its_matrix(text: str) -> None:
    e = derive(read(text.replace("  a1: 1.0", "  a1: {guess: 1.0}"), "links"))
    assert accelerations(e) is None
