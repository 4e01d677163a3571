"""The equations as the notes print them, each held to what is derived by algebra.

H. P. Gavin, Generalized Coordinates, Lagrange's Equations, and Constraints, with the
corrections of the errata: one sign of lambda, and eqs 65 and 68 as they must read.
"""

from __future__ import annotations

from typing import Any

import pytest
import sympy as sp

from lagsim.show.lagrange import content
from tests.show.cases import content_of, equations_of, s

M, g, K, th, u = s.M, s.g, s.K, s.theta, s.u
l, p = s.l, s.p  # noqa: E741  the notes' letter
dth, du, ddth, ddu = s.theta_dot, s.u_dot, s.theta_ddot, s.u_ddot
sin, cos = sp.sin, sp.cos

RIGHT53 = -M * g * (l + u) * sin(th) - 2 * M * (l + u) * du * dth
RIGHT54 = M * (l + u) * dth**2 - K * u + M * g * cos(th)
# 34-39 term by term, and their sums, 40 and 41.
TERMS = (
    {
        "ddt_dT_dqdot": M * (2 * (l + u) * du * dth + (l + u) ** 2 * ddth),
        "dT_dq": sp.S.Zero, "dV_dq": M * g * (l + u) * sin(th), "Q": sp.S.Zero,
    },
    {
        "ddt_dT_dqdot": M * ddu, "dT_dq": M * (l + u) * dth**2,
        "dV_dq": K * u - M * g * cos(th), "Q": sp.S.Zero,
    },
)  # fmt: skip
FREE = (M * (l + u) ** 2 * ddth - RIGHT53, M * ddu - RIGHT54)
# The notes' g is 1 - theta^2 - u/l, ours u - (l - l theta^2): their lambda is -l ours.
NO_TERMS = {"coordinate", "momentum", "left", "right"}
path, steering = -l * s.lambda_path, s.lambda_steering
# Models, and what is 0 by the equations of their coordinates: 40 and 41, 10.1, 53 and
# 54, 66 and 67 with the sign of eq. 47.
MOTION = {
    "elastic-pendulum": FREE,
    "forced-oscillator": (M * ddu + s.C * du + K * u - s.F0 * cos(s.w * s.t),),
    "elastic-pendulum-curve": (FREE[0] + 2 * th * path, FREE[1] + path / l),
    "elastic-pendulum-steered": (
        FREE[0] + l * sin(p) * steering, FREE[1] - cos(p) * steering,
    ),
}  # fmt: skip
RIGHT68 = l * cos(p) * dth**2 + dth * du * (sin(p) + s.b * cos(p))
RIGHT68 += s.b / l * du**2 * sin(p)
# Constraints, their rows of A and b: 49 to 56, and 62 to 68.
ROWS = {
    "elastic-pendulum-curve": (
        -l * (1 - th**2 - u / l), [2 * l * th, 1], -2 * l * dth**2,
    ),
    "elastic-pendulum-steered": (
        du * cos(p) - l * dth * sin(p), [-l * sin(p), cos(p)], RIGHT68,
    ),
}  # fmt: skip


def same(found: Any, expected: Any) -> bool:
    return bool(sp.simplify(sp.expand(found - expected)) == 0)


@pytest.mark.parametrize("name", ["elastic-pendulum", *ROWS])
def test_34_to_39_term_by_term(name: str) -> None:
    for line, expected in zip(
        content_of(name).document["equations"], TERMS, strict=True
    ):
        assert line.keys() - NO_TERMS == expected.keys()
        for key, value in expected.items():
            assert same(line[key], value), key


@pytest.mark.parametrize("name", MOTION)
def test_the_equations_of_motion(name: str) -> None:
    for line, expected in zip(
        content_of(name).document["equations"], MOTION[name], strict=True
    ):
        assert same(line["left"] - line["right"], expected)


@pytest.mark.parametrize("name", ROWS)
def test_the_constraints(name: str) -> None:
    (found,), (function, A, b) = content_of(name).document["constraints"], ROWS[name]
    assert same(found["function"], function)
    assert all(map(same, found["A"], A))
    assert same(found["b"], b)
    assert same(found["acceleration"], A[0] * ddth + A[1] * ddu - b)


def test_42_to_45_in_matrices_and_solved() -> None:
    c = content_of("elastic-pendulum").document
    assert [[M * (l + u) ** 2, 0], [0, M]] == c["M"]
    assert all(map(same, c["f"], (RIGHT53, RIGHT54)))
    expected = (RIGHT53 / M / (l + u) ** 2, RIGHT54 / M)
    assert all(map(same, c["accelerations"]["q_ddot"], expected))
    kept = content_of("elastic-pendulum-steered").document["definitions"]
    assert kept.keys() == {"p"}
    assert same(kept["p"], th + s.b * u / l)


def test_70_to_73_gauss() -> None:
    c = content(equations_of("elastic-pendulum-curve"), with_gauss=True).document
    gauss, (row,) = c["gauss"], c["constraints"]
    A, b = sp.Matrix([row["A"]]), sp.Matrix([row["b"]])
    inverse = sp.Matrix(c["M"]).inv()
    a = inverse * sp.Matrix(c["f"])
    gain = -A.T * (A * inverse * A.T).inv()
    forces = gain * (A * a - b)
    (lam,) = c["accelerations"]["lambda"]
    free = dict(zip((s.__getattr__(f"a.{q.name}") for q in (th, u)), a, strict=True))
    found = [*gauss["a"], *(row[0] for row in gauss["K"])]
    found += [Q.subs(free) for Q in gauss["Qc"]]
    found += [x.subs(s.lambda_path, lam) for x in c["accelerations"]["q_ddot"]]
    found += [lam * x for x in A]
    expected = [*a, *gain, *forces, *(a + inverse * forces), *forces]
    for x, y in zip(found, expected, strict=True):
        # With 60 digits at a point where all symbols differ: quick.
        difference = sp.Add(x, -y)
        letters = sorted(difference.free_symbols, key=str)
        at = {z: sp.Rational(7 + 3 * k, 11) for k, z in enumerate(letters)}
        assert abs(difference.subs(at).evalf(60)) < 1e-50
