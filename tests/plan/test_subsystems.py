"""Subsystems that do not touch: found, and their shares of sums like the energy."""

import numpy as np
import pytest

from lagsim.language.evaluate import evaluate
from lagsim.mechanics.derivation import derive
from lagsim.mechanics.groups import groups, shared
from lagsim.model.reader import read
from lagsim.run.trajectory import Outcome
from tests.support import case_of, run

# A double pendulum of sorts, a fast spring, and a pendulum on a rod; `e` sees them all.
THREE = """
coordinates: {a: {}, x: {}, b: {}, y: {}, z: {}}
definitions: {px: x + a, e: (a_dot^2 + x_dot^2)/2 + y}
energy:
  kinetic: (a_dot^2 + b_dot^2*(1 + 0.1*sin(a)^2) + x_dot^2 + y_dot^2 + z_dot^2)/2
  potential: 9.8*(1 - cos(a)) + (a - b)^2 + 5000*x^2 + 100*x^4 + 9.8*y
constraints: {rod: y^2 + z^2 = 1}
initial: {a: 1, b: 0.2, x: 0.3, y: -0.6, z: 0.8}
simulation: {duration: DURATION, output_step: 0.01}
"""


def three(duration=2):
    return THREE.replace("DURATION", str(duration))


def names_of(text):
    e = derive(read(text, "model.yaml"))
    return [[e.q[j] for j in group] for group in groups(e)]


@pytest.mark.parametrize(
    ("change", "to", "expected"),
    [
        ("", "", [["a", "b"], ["x"], ["y", "z"]]),
        ("9.8*y", "9.8*y + x*z", [["a", "b"], ["x", "y", "z"]]),
        ("y_dot^2 + z", "y_dot^2 + x_dot*a_dot/9 + z", [["a", "x", "b"], ["y", "z"]]),
        ("z^2 = 1", "z^2 = 1 + 0*b + (x - 0.3)", [["a", "b"], ["x", "y", "z"]]),
        ("(a - b)^2 + ", "", [["a", "b"], ["x"], ["y", "z"]]),  # by M and its slopes
        ("0.1*sin(a)^2", "x^2", [["a", "x", "b"], ["y", "z"]]),
    ],
)
def test_groups(change, to, expected):
    assert change in THREE
    assert names_of(three().replace(change, to)) == expected


@pytest.mark.parametrize(
    "kinetic",
    [
        "-(-3*b_dot^2 - a_dot^2)",
        "c*(a_dot^2/c - c*(0 - b_dot^2))",
    ],
)
def test_energies_are_shared_out(kinetic):
    case = case_of(f"""
    parameters: {{c: 1.7}}
    coordinates: {{a: {{}}, b: {{}}}}
    energy: {{kinetic: "{kinetic}", potential: 3 - (cos(a) + 5)*c - (2 - b^2)/c}}
    initial: {{a: 0.3, b: 0.4, a_dot: 0.5, b_dot: 0.6}}
    simulation: {{duration: 1}}
    """)
    e = case.equations
    found = groups(e)
    assert [[e.q[j] for j in group] for group in found] == [["a"], ["b"]]
    nodes = [e.energy, *shared(e, found, e.energy)[0]]

    def energies(*state):
        given = dict(zip(("a", "b", "a_dot", "b_dot"), state, strict=True))
        return np.array(evaluate(e.graph, nodes, {"c": 1.7} | given))

    base = energies(0.3, 0.4, 0.5, 0.6)
    # What moves alone changes nothing for the other one.
    whole, own, other = energies(-1.0, 0.4, 2.0, 0.6) - base
    assert (own, other) == (pytest.approx(whole, rel=1e-12), 0.0)
    whole, other, own = energies(0.3, 2.5, 0.5, -1.1) - base
    assert (own, other) == (pytest.approx(whole, rel=1e-12), 0.0)


@pytest.mark.slow
def test_the_work_grows_with_the_number_of_subsystems():
    def added(n):
        q = [f"q{i}" for i in range(n)]
        case = case_of(f"""
        coordinates: {{{", ".join(f"{x}: {{}}" for x in q)}}}
        energy:
          kinetic: ({" + ".join(f"{x}_dot^2" for x in q)})/2
          potential: {" + ".join(f"cos({x})" for x in q)}
        initial: {{{", ".join(f"{x}: 1" for x in q)}}}
        simulation: {{duration: 1}}
        """)
        before = len(case.equations.graph)
        found = groups(case.equations)
        assert len(found) == n
        shared(case.equations, found, case.equations.energy)
        return len(case.equations.graph) - before

    assert added(80) <= 2 * added(40) + 10


@pytest.mark.slow
def test_a_rate_that_overflows_is_none():
    text = """
coordinates: {x: {}, y: {}}
energy: {kinetic: x*x_dot^2 + y_dot^2, potential: 1}
initial: {x: 1e-308, y: 0, x_dot: 0.5}
simulation: {duration: 0.01}
"""
    # x'' = -x'^2/(2 x) is -1.25e307: no step is short enough, and that is said.
    assert run(text).trajectory.outcome is Outcome.STEP_TOO_SMALL
