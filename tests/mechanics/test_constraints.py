"""Rows of A and b against derivatives along arbitrary paths, and what is inferred."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

from lagsim.language.evaluate import evaluate
from lagsim.mechanics.constraints import Kind
from lagsim.mechanics.equations import Equations, derive
from lagsim.model.reader import read
from tests.sympy_oracle import expression

if TYPE_CHECKING:
    from collections.abc import Mapping

    from lagsim.mechanics.constraints import Row

PARAMETERS = {"l": 1.3, "w": 0.7, "k": 2.5}
RELATIONS = {
    "sphere": "x^2 + y^2 + z^2 = l^2",
    "plane": "x - 2*y = l",
    "curve": "y = l*sin(k*x)*exp(-z)",
    "moving": "x*cos(w*t) + y*sin(w*t) = l*t^2",
    "driven": "x = l*sin(w*t)",
    "branch": "if(x > 0, x^2, -x) + y = l",
    "distance": "hypot(x - y, z - t) = l",
    "skate": "x_dot*sin(z) - y_dot*cos(z) = 0",
    "affine": "x_dot*y - k*z_dot + w = 0",
    "affine_t": "x_dot - t*y_dot = sin(w*t)",
    "speed": "x_dot^2 + y_dot^2 = k^2",
    "cone": "x_dot^2 + y_dot^2 - l^2*z_dot^2 = 0",
    "cubic": "x_dot^3 + y*y_dot*z_dot = x*t",
    "roll": "sqrt(x_dot^2 + y_dot^2 + k) = l*z_dot",
}


def derived(relation: str) -> tuple[Equations, Row]:
    e = derive(
        read(
            "parameters: {l: 1.3, w: 0.7, k: 2.5}\n"
            "coordinates: {x: {}, y: {}, z: {}}\n"
            "energy:\n"
            "  kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2\n"
            "  potential: 0\n"
            "initial: {x: 1, y: 0, z: 0}\n"
            f'constraints: {{c: "{relation}"}}\n',
            "model.yaml",
        )
    )
    assert [row.name for row in e.rows] == ["c"]
    return e, e.rows[0]


def path(t: Any) -> dict[str, Any]:
    """Give positions on a path that meets no constraint."""
    return {"x": 0.8 + mp.sin(t), "y": t**2 - 0.6 * t, "z": mp.exp(-t) + 0.1 * t**3}


def along(text: str, t: Any) -> Any:
    """Give lhs - rhs on the path, by sympy's numbers, velocities by differentiation."""
    left, right = text.split("=")
    values = {**PARAMETERS, **path(t), "t": t}
    for name in "xyz":
        values[f"{name}_dot"] = mp.diff(lambda s, n=name: path(s)[n], t)
    exact = {name: sp.Float(x, mp.mp.dps) for name, x in values.items()}
    return expression(left, exact.get) - expression(right, exact.get)


def state(t: float) -> tuple[dict[str, float], Any, Any]:
    """Give the state on the path, q' and q''."""
    with mp.workdps(40):
        q = {name: float(x) for name, x in path(mp.mpf(t)).items()}
        v, a = (
            [
                float(mp.diff(lambda s, n=name: path(s)[n], mp.mpf(t), order))
                for name in "xyz"
            ]
            for order in (1, 2)
        )
    rates = dict(zip(("x_dot", "y_dot", "z_dot"), v, strict=True))
    return {**PARAMETERS, **q, **rates, "t": t}, np.array(v), np.array(a)


def numbers(e: Equations, row: Row, values: Mapping[str, float]) -> dict[str, Any]:
    names = ("residual", "rate", "b", "transport", "residual_scale", "rate_scale")
    nodes = [getattr(row, name) for name in names]
    found = dict(zip(names, evaluate(e.graph, nodes, values), strict=True))
    return {**found, "A": np.array(evaluate(e.graph, row.A, values))}


@pytest.mark.parametrize("name", RELATIONS)
def test_rows_are_derivatives_along_any_path(name: str) -> None:
    e, row = derived(RELATIONS[name])
    assert row.holonomic == ("_dot" not in RELATIONS[name])
    for t in (0.3, 1.1, 2.0):
        values, v, a = state(t)
        found = numbers(e, row, values)
        with mp.workdps(40):
            # Central differences: h^2 is far below the rounding of doubles.
            h = mp.mpf(10) ** -12
            behind, at, ahead = (
                mp.mpf(along(RELATIONS[name], mp.mpf(t) + k * h)) for k in (-1, 0, 1)
            )
            first = float((ahead - behind) / (2 * h))
            second = float((ahead - 2 * at + behind) / h**2)
        size = 1 + np.abs(found["A"]) @ np.abs(a) + abs(found["b"])
        assert found["residual"] == pytest.approx(float(at), rel=1e-12, abs=1e-14)
        if row.holonomic:
            assert found["rate"] == pytest.approx(first, rel=1e-12, abs=1e-12)
            acceleration = second
        else:
            assert found["rate"] == found["residual"]
            acceleration = first
        total = found["A"] @ a - found["b"]
        assert total == pytest.approx(acceleration, rel=0, abs=1e-12 * size)
        # A q' and `transport` differ by what vanishes on the constraint: the rate, or
        # by Euler's theorem its multiple by the degree.
        degree = {"speed": 0, "cone": 2, "cubic": 0, "affine": 0, "affine_t": 0}
        factor = degree.get(name, 0 if name == "roll" else 1)
        difference = found["A"] @ v - found["transport"]
        expected = factor * found["rate"]
        assert difference == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(
    ("name", "scleronomic", "pfaffian", "moved"),
    [
        ("sphere", True, True, False),
        ("moving", False, True, True),
        ("driven", False, True, True),
        ("skate", True, True, False),
        ("affine", True, True, True),
        ("affine_t", False, True, True),
        ("speed", True, False, True),
        ("cone", True, False, False),
        ("cubic", False, False, True),
        ("roll", True, False, True),
    ],
)
def test_what_is_inferred(
    name: str, scleronomic: bool, pfaffian: bool, moved: bool
) -> None:
    e, row = derived(RELATIONS[name])
    assert (row.scleronomic, row.pfaffian) == (scleronomic, pfaffian)
    # Only a relation that may exchange energy has a transport term.
    assert (row.transport != e.graph.zero) == moved
    assert bool(e.works) == moved


def test_absent_coordinates_have_zero_entries() -> None:
    e, row = derived("x - 2*y = l")
    assert list(row.A) == [e.graph.one, e.graph.constant(-2.0), e.graph.zero]
    assert row.b == e.graph.zero


@pytest.mark.parametrize(
    ("relation", "state", "residual_scale", "rate_scale"),
    [
        ("x^2 + y^2 = l^2", (3.0, 4.0, 1.0, 2.0), 32.0, 16.0),
        ("x = l", (3.0, 0.0, 0.5, 0.0), 3.0, 0.5),
        ("x = l", (0.1, 0.0, 0.5, 0.0), 1.3, 0.5),
        ("x*(y - 2) = 0", (3.0, 2.5, 1.0, 2.0), 7.5, 6.0),
        ("x_dot = k*y_dot", (0.0, 0.0, 3.0, 2.0), 5.0, 5.0),
        ("x_dot^2 + y_dot^2 = k^2", (0.0, 0.0, 3.0, 4.0), 32.0, 32.0),
    ],
)
def test_scales(
    relation: str,
    state: tuple[float, float, float, float],
    residual_scale: float,
    rate_scale: float,
) -> None:
    e, row = derived(relation)
    names = ("x", "y", "x_dot", "y_dot")
    values = dict(zip(names, state, strict=True))
    found = numbers(e, row, {**PARAMETERS, **values, "t": 0.0, "z": 0.0, "z_dot": 0.0})
    # The largest term, or |q_i dg/dq_i| (|q_i' d rate/dq_i'|), whichever is larger.
    assert found["residual_scale"] == pytest.approx(residual_scale, rel=1e-15)
    assert found["rate_scale"] == pytest.approx(rate_scale, rel=1e-15)


def test_scales_follow_the_units() -> None:
    values = {"x": 3.0, "y": 4.0, "z": 1.0, "x_dot": 1.0, "y_dot": 2.0, "z_dot": -1.0}
    metres = {**PARAMETERS, **values, "t": 0.0}
    millimetres = {name: 1000 * x for name, x in metres.items()}
    e, row = derived("x^2 + y*z = l^2")
    here, there = numbers(e, row, metres), numbers(e, row, millimetres)
    for part, scale in (("residual", "residual_scale"), ("rate", "rate_scale")):
        ratio = here[part] / here[scale]
        assert there[part] / there[scale] == pytest.approx(ratio, rel=1e-14)


def test_one_sided_relations_give_a_law_and_no_row() -> None:
    e = derive(
        read(
            "coordinates: {x: {}}\n"
            "energy: {kinetic: x_dot^2, potential: x}\n"
            "initial: {x: 1}\n"
            "constraints:\n"
            "  floor: {relation: x >= 0, restitution: 0.5}\n",
            "model.yaml",
        )
    )
    assert e.rows == ()
    assert [law.kind for law in e.laws] == [Kind.CONTACT]
    assert e.multipliers == ("lambda_floor",)
