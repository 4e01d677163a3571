"""What is constant is factored once, and the motion is the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lagsim.plan.making import by_loops
from lagsim.run.observers import Keep
from tests.support import case_of

# Masses that pull on one another, coupled in M; `ROWS` holds some of them.
PULLING = """
parameters: {m: 2, k: 3}
coordinates: {a: {}, b: {}, c: {}, d: {}}
energy:
  kinetic: "m*(a_dot^2 + b_dot^2 + c_dot^2 + d_dot^2)/2 + 0.3*a_dot*b_dot
    + 0.2*b_dot*c_dot + 0.1*a_dot*d_dot"
  potential: k*(a - b)^2/2 + (b - c)^4 + 2*(c - d)^2 + sin(a)
ROWS
initial: {a: 0.5, b: 0, c: {guess: 0.1}, d: {guess: 0}, a_dot: 0.2,
  b_dot: 0.1, c_dot: {guess: 0}, d_dot: {guess: 0}}
simulation: {duration: 5, output_step: 0.1}
"""
CONSTANT = 'constraints: {one: "a + 2*b - c = 0", two: "b - 0.5*d = 0.1*sin(t)"}'
MOVING = 'constraints: {one: "a + 2*b = c^2 + c", two: "b^2 - 0.5*d = 0"}'


def rows(text, *, loops, constant=None):
    case = case_of(text, formulation="full")
    plan = by_loops(case.plan()) if loops else case.plan()
    found = plan.constant
    if constant is not None:
        plan = replace(plan, constant=constant)
    keep = Keep()
    trajectory = case.ready(plan).run([keep])
    return found, trajectory.statistics, keep.table


@pytest.mark.parametrize(
    ("constraints", "constant"),
    [("constraints: {}", 2), (CONSTANT, 2), (MOVING, 1)],
    ids=["none", "constant", "moving"],
)
@pytest.mark.parametrize("loops", [False, True], ids=["straight", "dense"])
def test_constant_parts_give_the_same_motion(constraints, constant, loops):
    text = PULLING.replace("ROWS", constraints)
    found, statistics, once = rows(text, loops=loops)
    assert found == constant
    assert statistics.factorisations == (1 if constant == 2 else statistics.evaluations)
    _, _, always = rows(text, loops=loops, constant=0)
    # The same operations on the same numbers: the rounding is the same.
    assert np.array_equal(once, always)


def test_a_mass_that_changes_is_factored_each_time():
    text = PULLING.replace("ROWS", "constraints: {}").replace(
        "m*(a_dot^2", "(2 + sin(t))*(a_dot^2"
    )
    found, statistics, _ = rows(text, loops=True)
    assert found == 0
    assert statistics.factorisations == statistics.evaluations


def test_straight_code_factors_constant_matrices_outside_of_the_run():
    case = case_of(PULLING.replace("ROWS", CONSTANT), formulation="full")
    elimination = case.plan().elimination
    g = case.equations.graph
    factors = [*elimination.mass.inverse.values(), *elimination.schur.inverse.values()]
    # What depends on parameters alone is computed by `prepare`, once in an arc.
    assert g.depends(factors) <= {"m", "k"}
