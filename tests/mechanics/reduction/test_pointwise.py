"""Reduced equations against the full ones, state by state, in plain Python.

At a state that the reduced coordinates give, the full equations must give the same
accelerations and multipliers, to rounding.
"""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.errors import InputError
from lagsim.language.evaluate import evaluate
from lagsim.mechanics.equations import derive
from lagsim.mechanics.ldl import Elimination
from lagsim.mechanics.reduction import ignorable, pairs
from lagsim.model.reader import read
from lagsim.plan.formulation import formulate
from tests.support import case_of

# A pendulum whose pivot u is steered, a rod through w, a bead s; three constraints give
# a coordinate each, the second only by way of the first, the last in time.
STEERED = """
parameters: {m: 2, g: 9.8, k: 7, c: -0.4}
coordinates: {theta: {}, u: {}, w: {}, s: {}, v: {}}
definitions: {x: u + sin(theta), y: -cos(theta)*(1 + 0.1*s^2)}
energy:
  kinetic: m*(x_dot^2 + y_dot^2)/2 + w_dot^2*(1 + s^2)/2 + s_dot^2 + v_dot^2/2
    + 0.3*w_dot*v_dot*cos(theta)
  potential: m*g*y + k*(w - v)^2/2 + sin(s)
  dissipation: 0.1*w_dot^2 + 0.05*theta_dot^2*s_dot^2
forces: {theta: 0.3*cos(t), w: -0.2*v_dot}
constraints:
  drive: "2*u + c*w*w = sin(2*t)"
  tie: "w + 0.5*v = theta^2/4 + s"
  bead: "c*s - 0.1*sin(theta) + 0.02*v^2 = 0"
initial: {theta: 0.4, u: {guess: 0}, w: {guess: 0}, s: {guess: 0}, v: 0.2,
  theta_dot: 1, u_dot: {guess: 1}, w_dot: {guess: 0}, s_dot: {guess: 0}, v_dot: 0.3}
simulation: {duration: 1}
"""
# One relation gives z; a rod and a blade, which give nothing, are left.
MIXED = """
coordinates: {x: {}, y: {}, z: {}, phi: {}, w: {}}
energy:
  kinetic: (x_dot^2 + y_dot^2 + z_dot^2 + w_dot^2)/2 + phi_dot^2/8
    + 0.1*z_dot*phi_dot*x
  potential: 9.8*z + w^2
constraints:
  floor: "z = 0.1*x^2 - 0.2*sin(y)"
  blade: x_dot*sin(phi) = y_dot*cos(phi)
  rod: x^2 + w^2 = 1
initial: {x: 0.6, y: 0.8, z: {guess: 0}, phi: 0.3, w: {guess: 0.8}, phi_dot: 1,
  x_dot: 0.5, y_dot: {guess: 0}, z_dot: {guess: 0}, w_dot: {guess: 0}}
simulation: {duration: 1}
"""
# Two ignorable coordinates, coupled with each other and with what is left.
TOP = """
coordinates: {phi: {}, a: {}, psi: {}, b: {}}
energy:
  kinetic: (1 + a^2)*phi_dot^2/2 + (2 + sin(b))*psi_dot^2/2 + 0.3*phi_dot*psi_dot*a
    + a_dot^2/2 + b_dot^2 + 0.2*a_dot*b_dot*cos(a) + 0.1*phi_dot*b_dot + 0.2*psi_dot*a
  potential: a^2 + cos(b)
initial: {phi: 0.3, a: 0.2, psi: -1, b: 0.5, phi_dot: 1, psi_dot: -0.7, a_dot: 0.4}
simulation: {duration: 1}
"""
# The same beside a constraint that gives b.
TOP_ON_A_CURVE = TOP.replace(
    "initial: {", "constraints: {curve: b = 0.5 + a^2}\ninitial: {"
).replace("a: 0.2", "a: 0").replace("a_dot: 0.4", "a_dot: 0")  # fmt: skip

SCENES = [
    ("elastic-pendulum-curve", "elimination"),
    ("heavy-top", "ignorable"),
    (STEERED, "elimination"),
    (MIXED, "elimination"),
    (TOP, "ignorable"),
    (TOP_ON_A_CURVE, "auto"),
]


def formulated(model, formulation, **options):
    case = case_of(model, formulation=formulation, **options)
    found = formulate(case.equations, case.start, case.settings, lambda _: True)
    return case.equations, case.start, found.reduction


def motion(equations, values):
    """Give q'' and lambda of the equations solved at a state."""
    q, lam = Elimination(equations).motion()
    names = [*equations.accelerations, *equations.multipliers]
    found = evaluate(equations.graph, [*q, *lam], values)
    return dict(zip(names, found, strict=True))


@pytest.mark.parametrize(("model", "formulation"), SCENES)
def test_the_full_equations_give_the_same_motion(model, formulation):
    full, _, reduction = formulated(model, formulation)
    g, left = full.graph, reduction.equations
    assert len(left.q) < len(full.q)
    random = np.random.default_rng(5)
    fixed = {p.name: p.value for p in full.model.parameters}
    for _ in range(5):
        # Any state of the coordinates left: rows that are left need not hold, for the
        # equations are the same off the constraints, too.
        state = dict.fromkeys((*full.q, *full.velocities), 0.0)
        state |= {name: random.normal() for name in (*left.q, *left.velocities)}
        state["t"] = random.normal()
        momenta = {name: random.normal() for name in reduction.momenta}
        values = fixed | state | momenta
        found = motion(left, values)
        recovered = list(reduction.recovered)
        names = [str(g.payload(n)) for n in recovered]
        whole = evaluate(g, reduction.recovered.values(), values | found)
        found |= dict(zip(names, whole, strict=True))
        state |= {name: found[name] for name in names if name in state}
        expected = motion(full, fixed | state)
        size = max(map(abs, expected.values()))
        # Ten or so operations on numbers of this size, and a solve of condition 1e3.
        for name, value in expected.items():
            assert found[name] == pytest.approx(value, rel=1e-12, abs=1e-12 * size)
        kept = evaluate(g, reduction.momenta.values(), fixed | state)
        assert kept == pytest.approx(list(momenta.values()), rel=1e-13, abs=1e-13)


@pytest.mark.parametrize(("model", "formulation"), SCENES)
def test_energies_and_power_are_those_of_the_full_state(model, formulation):
    full, start, reduction = formulated(model, formulation)
    g, left = full.graph, reduction.equations
    state = dict(zip((*full.q, *full.velocities), (*start.q, *start.v), strict=True))
    state |= {p.name: p.value for p in left.model.parameters} | {"t": start.t}
    moved = motion(full, state)
    pairs = [(full.energy, left.energy), (full.kinetic_form, left.kinetic_form)]
    pairs += zip(full.powers, left.powers, strict=True)
    for whole, reduced in pairs:
        [a, b] = evaluate(g, [whole, reduced], state | moved)
        assert b == pytest.approx(a, rel=1e-12, abs=1e-12)


CURVE = """
parameters: {c: 1}
coordinates: {x: {}, y: {}, z: {}}
energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: y + z^2}
constraints: {curve: "c*y = RIGHT"}
initial: {x: 0, y: 0, z: 0, x_dot: {guess: 1}, y_dot: {guess: 1}}
simulation: {duration: 1}
"""


def test_the_choice_follows_the_values_of_parameters():
    text = CURVE.replace("RIGHT", "sin(x)")
    assert formulated(text, "auto")[2].eliminated == (("y", "curve"),)
    # With c = 0 the relation says sin(x) = 0, which gives no coordinate.
    text = text.replace("c: 1}", "c: 0}")
    assert formulated(text, "auto")[2].eliminated == ()
    with pytest.raises(InputError, match="`curve`"):
        formulated(text, "elimination")


@pytest.mark.parametrize(
    "right",
    [
        "if(x > 1, x, 2*x - 1) + 1",  # its rate may jump: an impact for all of them
        "abs(t) + x",
        "y*x",  # the factor moves
        "y*sin(t) + x",
        "y^3 + x",
        "c*y + sin(x) + z^2",  # y drops out
    ],
)
def test_what_gives_no_coordinate(right):
    equations = derive(read(CURVE.replace("RIGHT", right), "model.yaml"))
    values = dict.fromkeys((*equations.q, *equations.velocities, "t"), 0.0)
    found = pairs(equations, values | {"c": 1.0}, np.ones(3))
    assert "y" not in [equations.q[pair.coordinate] for pair in found]


def test_a_coordinate_that_moves_a_thousand_times_as_far_is_left_alone():
    text = CURVE.replace("RIGHT", "5000*x + sin(z)*0.1")
    assert formulated(text, "auto")[2].eliminated == (("x", "curve"),)


def test_a_motion_that_is_wholly_prescribed_keeps_a_coordinate():
    text = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}
constraints: {one: x = sin(t), two: y = cos(t)}
initial: {x: 0, y: 1, x_dot: 1}
simulation: {duration: 1}
"""
    assert len(formulated(text, "auto")[2].equations.q) == 1


def test_dependent_constraints_are_left_alone():
    text = CURVE.replace('"c*y = RIGHT"}', '"y = x^2", again: "2*y = 2*x^2"}')
    assert formulated(text, "auto")[2].eliminated == ()
    with pytest.raises(InputError, match="rank 1"):
        formulated(text, "elimination")


@pytest.mark.parametrize(
    ("change", "to"),
    [
        ("simulation:", "forces: {phi: 0.1}\nsimulation:"),
        ("simulation:", "forces: {phi: -phi_dot}\nsimulation:"),
        ("potential: a^2", "potential: a^2 + 0.1*phi"),
        ("(1 + a^2)*phi_dot^2/2", "(1 + a^2)*phi_dot^2/2 + phi*a_dot^2"),
        ("(1 + a^2)*phi_dot^2/2", "(1 + a^2)*phi_dot^2/2 + phi_dot^4"),
        ("initial: {", "constraints: {held: phi = 0.3 + a - 0.2}\ninitial: {"),
        ("initial: {", "constraints: {held: phi_dot = 5*a_dot - 1}\ninitial: {"),
    ],
)
def test_what_is_not_ignorable(change, to):
    equations = derive(read(TOP, "model.yaml"))
    assert [equations.q[c] for c in ignorable(equations)] == ["phi", "psi"]
    assert change in TOP
    equations = derive(read(TOP.replace(change, to), "model.yaml"))
    assert "phi" not in [equations.q[c] for c in ignorable(equations)]
