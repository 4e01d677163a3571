"""The equations as the notes print them, each held to what is derived by algebra.

H. P. Gavin, Generalized Coordinates, Lagrange's Equations, and Constraints, with the
corrections of the errata: one sign of lambda, and eqs 65 and 68 as they must read.
"""

from __future__ import annotations

from typing import Any

import pytest
import sympy as sp

from tests.show.cases import content_of, s

M, g, K, th, u = s.M, s.g, s.K, s.theta, s.u
l = s.l  # noqa: E741  the notes' letter
dth, du, ddth, ddu = s.theta_dot, s.u_dot, s.theta_ddot, s.u_ddot
sin, cos = sp.sin, sp.cos

# 34-39, and their sums, 40 and 41.
THETA = {
    "ddt_dT_dqdot": M * (2 * (l + u) * du * dth + (l + u) ** 2 * ddth),
    "dT_dq": sp.S.Zero,
    "dV_dq": M * g * (l + u) * sin(th),
    "Q": sp.S.Zero,
}
U = {
    "ddt_dT_dqdot": M * ddu,
    "dT_dq": M * (l + u) * dth**2,
    "dV_dq": K * u - M * g * cos(th),
    "Q": sp.S.Zero,
}
ELASTIC = ("elastic-pendulum", "elastic-pendulum-curve", "elastic-pendulum-steered")


def same(found: Any, expected: Any) -> bool:
    return bool(sp.simplify(sp.expand(found - expected)) == 0)


def alike(found: Any, expected: Any) -> bool:
    """Compare with 60 digits at a point where all symbols differ: quick."""
    e = sp.Add(found, -expected)
    at = {
        x: sp.Rational(7 + 3 * k, 11)
        for k, x in enumerate(sorted(e.free_symbols, key=str))
    }
    return bool(abs(e.subs(at).evalf(60)) < 1e-50)


@pytest.mark.parametrize("name", ELASTIC)
@pytest.mark.parametrize(("j", "expected"), [(0, THETA), (1, U)])
def test_34_to_39_term_by_term(name: str, j: int, expected: dict[str, Any]) -> None:
    terms = content_of(name).lines[j].terms
    assert terms.keys() == expected.keys()
    for key, value in expected.items():
        assert same(terms[key], value), key


def test_40_to_42_44_and_45() -> None:
    c = content_of("elastic-pendulum")
    right40 = M * (2 * (l + u) * du * dth + (l + u) ** 2 * ddth)
    right40 += M * g * (l + u) * sin(th)
    right41 = M * ddu - M * (l + u) * dth**2 + K * u - M * g * cos(th)
    for line, expected in zip(c.lines, (right40, right41), strict=True):
        assert same(line.left - line.right, expected)
    assert ((M * (l + u) ** 2, 0), (0, M)) == c.M  # 42, and its right side
    assert same(c.f[0], -M * (2 * (l + u) * du * dth) - M * g * (l + u) * sin(th))
    assert same(c.f[1], M * (l + u) * dth**2 - K * u + M * g * cos(th))
    assert c.solution is not None
    first, second = c.solution.accelerations
    assert same(first, -(2 * du * dth + g * sin(th)) / (l + u))
    assert same(second, (l + u) * dth**2 - K / M * u + g * cos(th))


def test_10_1_the_forced_oscillator() -> None:
    (line,) = content_of("forced-oscillator").lines
    assert same(line.left, M * ddu + s.C * du + K * u)
    assert same(line.right, s.F0 * cos(s.w * s.t))


def test_50_to_56_on_the_curve() -> None:
    c = content_of("elastic-pendulum-curve")
    # The notes' g is 1 - theta^2 - u/l, ours u - (l - l theta^2): g = -ours/l.
    ours = c.constraints[0]
    factor = -1 / l
    assert same(factor * ours.function, 1 - th**2 - u / l)  # 49
    assert same(factor * ours.A[0], -2 * th)  # 50
    assert same(factor * ours.A[1], -1 / l)  # 51
    assert same(ours.acceleration, 2 * l * th * ddth + ddu + 2 * l * dth**2)  # 55
    assert same(ours.b, -2 * l * dth**2)
    # Their lambda multiplies their g: lambda_ours * g_ours = lambda * g.
    lam = s.lam
    new = {s.lambda_path: factor * lam}
    right53 = -M * g * (l + u) * sin(th) - 2 * M * (l + u) * du * dth
    right54 = M * (l + u) * dth**2 - K * u + M * g * cos(th)
    first, second = ((line.left - line.right).subs(new) for line in c.lines)
    assert same(first, M * (l + u) ** 2 * ddth + 2 * th * lam - right53)
    assert same(second, M * ddu + lam / l - right54)
    # 56: the matrix [M A^T; A 0] with the third row divided by l, as 70 has it.
    matrix = sp.Matrix(
        [[M * (l + u) ** 2, 0, 2 * th], [0, M, 1 / l], [2 * th, 1 / l, 0]]
    )
    rows = matrix * sp.Matrix([ddth, ddu, lam])
    assert same(rows[0] - right53, first)
    assert same(rows[1] - right54, second)
    assert same(l * rows[2] + 2 * l * dth**2, ours.acceleration)


def test_63_to_69_steered() -> None:
    c = content_of("elastic-pendulum-steered")
    (kept,) = c.translation.kept
    p = s.p
    assert kept.name == "p"
    assert same(kept.value, th + s.b * u / l)
    steering = c.constraints[0]
    assert same(steering.function, du * cos(p) - l * dth * sin(p))  # 62
    assert same(steering.A[0], -l * sin(p))  # 63
    assert same(steering.A[1], cos(p))  # 64
    right68 = (du * sin(p) + l * dth * cos(p)) * (dth + s.b * du / l)
    printed = l * cos(p) * dth**2 + dth * du * (sin(p) + s.b * cos(p))
    printed += s.b / l * du**2 * sin(p)
    assert same(steering.b, right68)
    assert same(printed, right68)
    right53 = -M * g * (l + u) * sin(th) - 2 * M * (l + u) * du * dth
    right54 = M * (l + u) * dth**2 - K * u + M * g * cos(th)
    lam = s.lambda_steering  # with the sign of eq. 47
    first, second = (line.left - line.right for line in c.lines)
    assert same(first, M * (l + u) ** 2 * ddth + l * sin(p) * lam - right53)  # 66
    assert same(second, M * ddu - cos(p) * lam - right54)  # 67
    # 69: the three as one matrix, with 70's other sign of lambda.
    matrix = sp.Matrix(
        [
            [M * (l + u) ** 2, 0, -l * sin(p)],
            [0, M, cos(p)],
            [-l * sin(p), cos(p), 0],
        ]
    )
    rows = matrix * sp.Matrix([ddth, ddu, -lam])
    assert same(rows[0] - right53, first)
    assert same(rows[1] - right54, second)
    assert same(rows[2] - printed, steering.acceleration)


def test_70_to_73_gauss() -> None:
    from lagsim.show.lagrange import content
    from tests.show.cases import equations_of

    c = content(equations_of("elastic-pendulum-curve"), with_gauss=True)
    assert c.gauss is not None
    assert c.gauss.a is not None
    assert c.gauss.K is not None
    assert c.gauss.Qc is not None
    assert c.solution is not None
    A, b = sp.Matrix([c.constraints[0].A]), sp.Matrix([c.constraints[0].b])
    mass = sp.Matrix(c.M)
    a = mass.inv() * sp.Matrix(c.f)
    gain = -A.T * (A * mass.inv() * A.T).inv()
    forces = gain * (A * a - b)
    accelerations = a + mass.inv() * forces
    (lam,) = c.solution.multipliers
    # 70: [M A^T; A 0] [q''; lambda] = [Q; b], with that lambda minus ours.
    matrix = mass.row_join(A.T).col_join(A.row_join(sp.zeros(1, 1)))
    left = matrix * accelerations.col_join(sp.Matrix([-lam]))
    right = sp.Matrix(c.f).col_join(b)
    assert all(alike(e, 0) for e in left - right)
    for j in range(2):
        assert alike(c.gauss.a[j], a[j])
        assert alike(c.gauss.K[j][0], gain[j])
        free = {
            s.__getattr__(f"a.{q.name}"): x for q, x in zip((th, u), a, strict=True)
        }
        assert alike(c.gauss.Qc[j].subs(free), forces[j])
        assert alike(c.gauss.Qc[j].subs(free), A[j] * lam)
        found = c.solution.accelerations[j].subs(s.lambda_path, lam)
        assert alike(found, accelerations[j])
