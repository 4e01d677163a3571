"""Reduced runs against full ones: all columns of all rows to 1e-10."""

from __future__ import annotations

import numpy as np
import pytest

from tests.mechanics.reduction.test_pointwise import MIXED, STEERED, TOP, TOP_ON_A_CURVE
from tests.support import run

SHIPPED = [("elastic-pendulum-curve", "elimination"), ("heavy-top", "ignorable")]
SMALL = [
    (STEERED, "elimination"),
    (MIXED, "elimination"),
    (TOP, "ignorable"),
    (TOP_ON_A_CURVE, "auto"),
]


def differences(reduced, full):
    """Give, by column, the greatest difference against the size of the column."""
    table = full.system.columns.table
    names = full.system.columns.names[:table]
    assert reduced.system.columns.names[:table] == names
    a, b = reduced.rows[:, :table], full.rows[:, :table]
    assert a.shape == b.shape
    scale = np.max(np.abs(b), axis=0)
    # What should stay zero, as residuals, is compared with the size of its kind.
    kinds = {"residual": 1.0, "lambda": 1.0, "Qc": 1.0}
    for k, name in enumerate(names):
        scale[k] = max(scale[k], kinds.get(name.split("_")[0], 0.0))
    found = np.max(np.abs(a - b), axis=0) / np.where(scale > 0.0, scale, 1.0)
    return dict(zip(names, found, strict=True))


@pytest.mark.parametrize(("model", "formulation"), [*SHIPPED, *SMALL])
@pytest.mark.parametrize("loops", [False, True], ids=["straight", "dense"])
def test_all_columns_agree(model, formulation, loops):
    full = run(model, formulation="full", rtol="1e-13")
    reduced = run(model, formulation=formulation, rtol="1e-13", loops=loops)
    left = reduced.system
    assert left.n < full.system.n
    # 1e-13 a step and the motion's own growth leave 1e-11 at most.
    for name, off in differences(reduced, full).items():
        assert off < 1e-10, name


def test_eliminated_constraints_hold_to_the_last_digit():
    found = run("elastic-pendulum-curve")
    assert found.plan.formulation == "elimination"
    # The relation's own expression, of a coordinate that it gave: a rounding each.
    assert np.max(np.abs(found["residual_path"])) <= 2.3e-16
    assert found.trajectory.statistics.evaluations < run(
        "elastic-pendulum-curve", formulation="projection"
    ).trajectory.statistics.evaluations  # fmt: skip


def test_the_momentum_of_an_ignorable_coordinate_is_constant_to_rounding():
    options = {"duration": 20, "output_step": "0.01"}
    ignored = run("heavy-top", formulation="ignorable", **options)
    full = run("heavy-top", formulation="full", **options)
    assert ignored.plan.reduction.ignored == ("phi", "psi")
    for name, value in {"p_phi": 0.0046875, "p_psi": 0.009375}.items():
        # A few operations on numbers of this size, in every row.
        assert np.max(np.abs(ignored[name] - value)) < 4e-15 * value * 10
        assert np.max(np.abs(full[name] - value)) > 4e-15 * value * 10


@pytest.mark.parametrize(
    ("method", "off"),
    # The order of each at 5 ms for motion of 5 rad/s over 20 s.
    [("radau", 1e-8), ("taylor", 1e-8), ("gauss4", 1e-5), ("midpoint", 5e-3)],
)
def test_methods_integrate_what_is_left(method, off):
    fixed = {"step": 0.005} if method in ("gauss4", "midpoint") else {}
    found = run("elastic-pendulum-curve", method=method, **fixed)
    assert found.plan.formulation == "elimination"
    # The model's own statement of where it is after 20 s.
    assert found["theta"][-1] == pytest.approx(-0.81349383, abs=off)
    assert found["u_dot"][-1] == pytest.approx(-1.63833042, abs=5 * off)


def test_it_must_pay_to_be_chosen():
    # Measured: 4 % of the time of the heavy top, although a quarter of the operations.
    assert run("heavy-top", duration="0.1").plan.reduction.ignored == ()
    assert not run("chain-cartesian", duration="0.1").plan.reduction.eliminated


def test_messages_name_all_coordinates():
    text = """
coordinates: {r: {}, s: {}}
energy: {kinetic: (r_dot^2 + s_dot^2)/2, potential: -1/r}
constraints: {tie: s = 2*r}
initial: {r: 1, s: 2}
simulation: {duration: 5}
"""
    found = run(text)
    assert found.plan.formulation == "elimination"
    assert not found.trajectory.outcome.complete
    for name in ("r = ", "s = ", "r_dot = ", "s_dot = "):
        assert name in found.trajectory.reason


def test_a_quadrature_of_nothing_is_not_controlled_at_rounding_level():
    # A planet seen from afar drifts sideways at 1e-17 of its speed: rounding.
    text = """
coordinates: {r: {}, x: {}}
energy: {kinetic: (r_dot^2 + x_dot^2)/2, potential: r^2/2}
initial: {r: 1, x: 0, x_dot: 1e-17}
simulation: {duration: 20}
"""
    found = run(text, formulation="ignorable")
    plain = run(text, formulation="full")
    assert found.plan.reduction.ignored == ("x",)
    steps = found.trajectory.statistics.steps
    assert steps <= 1.2 * plain.trajectory.statistics.steps


def test_switches_of_what_is_left_out_are_met():
    # Dry friction on a coordinate that is given by another, which sticks and slips.
    text = """
coordinates: {x: {}, w: {}}
energy: {kinetic: (x_dot^2 + w_dot^2)/2, potential: w^2}
forces: {w: "-1.3*sign(w_dot)", x: "3*sin(t)"}
constraints: {tie: w = 0.6*x + 0.1*sin(x)}
initial: {x: 1, w: {guess: 0.6}, w_dot: {guess: 0}}
simulation: {duration: 12, output_step: 0.05}
"""
    full = run(text, formulation="full", rtol="1e-13")
    reduced = run(text, formulation="elimination", rtol="1e-13")
    assert reduced.plan.reduction.eliminated == (("w", "tie"),)
    kinds = [e.kind for e in full.trajectory.events]
    assert len(kinds) > 4
    assert [e.kind for e in reduced.trajectory.events] == kinds
    for before, after in zip(
        full.trajectory.events, reduced.trajectory.events, strict=True
    ):
        assert after.time == pytest.approx(before.time, abs=1e-9)
    positions = {c: v for c, v in differences(reduced, full).items() if "dd" not in c}
    # An event is located to rounding of forces that cancel; its rows are as good.
    for name in ("x", "w", "x_dot", "w_dot", "energy", "work"):
        assert positions[name] < 1e-9, name
