"""Subsystems that do not touch: found, and integrated apart with the same answer."""

import numpy as np
import pytest

from lagsim.language.evaluate import evaluate
from lagsim.mechanics.equations import derive, groups
from lagsim.model.reader import read
from lagsim.plan.formulation import subsystems
from lagsim.program.system import BLOCK
from lagsim.run.interrupt import Interrupt
from lagsim.run.trajectory import Outcome
from tests.mechanics.test_reduction import differences
from tests.support import case_of, refused, run

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


def test_all_columns_agree():
    full = run(three(), formulation="full", rtol="1e-13")
    apart = run(three(), formulation="apart", rtol="1e-13")
    assert len(apart.plan.parts) == 3
    assert apart.trajectory.outcome is Outcome.DONE
    assert apart.trajectory.rows == full.trajectory.rows == 201
    for name, off in differences(apart, full).items():
        # 45 periods of the fast spring, 1e-13 a step: the phase is off by 1e-11.
        assert off < 1e-10, name
    one, whole = apart.trajectory.statistics, full.trajectory.statistics
    # At the fast spring's steps nobody solves for the rod.
    assert one.factorisations < 0.5 * whole.factorisations


def test_rows_that_wait_are_bounded(monkeypatch):
    from lagsim.run.arcs import Part

    most = []
    add = Part.add

    def noted(part, rows):
        add(part, rows)
        most.append(len(part.waiting))

    monkeypatch.setattr(Part, "add", noted)
    text = three(60).replace("output_step: 0.01", "output_step: 0.005")
    found = run(text, formulation="apart", rtol="1e-6")
    assert found.trajectory.rows == 12001
    assert list(found["t"]) == [*(0.005 * k for k in range(12000)), 60.0]
    assert max(most) <= 2 * BLOCK


def test_a_failure_names_its_subsystem_and_keeps_the_rows_before_it():
    # r falls into the centre at t = pi/(2 sqrt 2) = 1.1107.
    text = """
coordinates: {r: {}, x: {}}
energy: {kinetic: (r_dot^2 + x_dot^2)/2, potential: -1/r + x^2}
initial: {r: 1, x: 1}
simulation: {duration: 2, output_step: 0.01}
"""
    found = run(text, formulation="apart")
    assert found.trajectory.outcome is Outcome.STEP_TOO_SMALL
    assert found.trajectory.reason.startswith("subsystem (r): ")
    assert found.trajectory.end == pytest.approx(1.1107207345, abs=1e-6)
    assert np.max(np.abs(found["x"] - np.cos(np.sqrt(2) * found["t"]))) < 1e-9


def test_an_interrupt_keeps_the_rows_before_it():
    interrupt = Interrupt()
    interrupt.signal = 2
    found = run(three(1e4), formulation="apart", interrupt=interrupt, rtol="1e-6")
    assert found.trajectory.outcome is Outcome.INTERRUPTED
    assert len(found.rows) == found.trajectory.rows > 0


@pytest.mark.parametrize(
    ("change", "to", "why"),
    [
        ("9.8*y", "9.8*y + x*z + a*x", "coupled"),
        ("0.01}", '0.01, until: "x = 7"}', "`until`"),
        ("initial", "forces: {x: -x_dot}\ninitial", "work"),
        ("5000*x^2", "if(x > 0, 5000, 3000)*x^2", "switch"),
    ],
)
def test_what_is_not_integrated_apart(change, to, why):
    assert change in THREE
    with refused("formulation-refused", why):
        run(three().replace(change, to), formulation="apart")
    short = three(0.1).replace(change, to)
    assert run(short).plan.parts == ()


def test_it_must_pay_to_be_chosen():
    # A short run costs less than compiling two systems more.
    assert run(three(1)).plan.parts == ()
    # 2000 s of a spring of 100 rad/s, with a pendulum solved for at each of its steps.
    plan = case_of(three(20000), output_step=100).plan()
    assert len(plan.parts) == 3
    assert "subsystems: 3 integrated apart" in [c.choice for c in plan.choices]


@pytest.mark.parametrize(
    "kinetic",
    [
        "-(-3*b_dot^2 - a_dot^2)",
        "c*(a_dot^2/c - c*(0 - b_dot^2))",
        # Not seen to be apart as it is written.
        "(a_dot + b_dot)^2/2 - a_dot*b_dot",
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
    e, parts = case.equations, subsystems(case.equations, case.start)
    assert [part.equations.q for part in parts] == [("a",), ("b",)]
    nodes = [e.energy, *(part.equations.energy for part in parts)]
    values = {p.name: p.value for x in parts for p in x.equations.model.parameters}
    start = {"start.a": 0.3, "start.b": 0.4, "start.a_dot": 0.5, "start.b_dot": 0.6}
    assert values.items() <= (start | {"c": 1.7}).items()

    def energies(*state):
        given = dict(zip(("a", "b", "a_dot", "b_dot"), state, strict=True))
        return np.array(evaluate(e.graph, nodes, values | given))

    base = energies(0.3, 0.4, 0.5, 0.6)
    # What moves alone changes nothing for the other one.
    whole, own, other = energies(-1.0, 0.4, 2.0, 0.6) - base
    assert (own, other) == (pytest.approx(whole, rel=1e-12), 0.0)
    whole, other, own = energies(0.3, 2.5, 0.5, -1.1) - base
    assert (own, other) == (pytest.approx(whole, rel=1e-12), 0.0)


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
        assert len(subsystems(case.equations, case.start)) == n
        return len(case.equations.graph) - before

    assert added(80) <= 2 * added(40) + 10


def test_a_rate_that_overflows_is_none():
    text = """
coordinates: {x: {}, y: {}}
energy: {kinetic: x*x_dot^2 + y_dot^2, potential: 1}
initial: {x: 1e-308, y: 0, x_dot: 0.5}
simulation: {duration: 0.01}
"""
    # x'' = -x'^2/(2 x) is -1.25e307: no step is short enough, and that is said.
    assert run(text).trajectory.outcome is Outcome.STEP_TOO_SMALL
