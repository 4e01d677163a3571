"""Reduced equations: omitted coordinates, and the motion of the full equations."""

from dataclasses import replace

import numpy as np
import pytest

from lagsim.mechanics.derivation import derive
from lagsim.mechanics.reduction import Reduction, conserved
from lagsim.model.reader import read
from lagsim.plan.plan import by_loops
from lagsim.run.observers import Keep
from tests.scenes.contact.motions import contact, scene
from tests.support import case_of, refused, run

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
# Two coordinates with conserved momenta, coupled with each other and with the others.
TOP = """
coordinates: {phi: {}, a: {}, psi: {}, b: {}}
energy:
  kinetic: (1 + a^2)*phi_dot^2/2 + (2 + sin(b))*psi_dot^2/2 + 0.3*phi_dot*psi_dot*a
    + a_dot^2/2 + b_dot^2 + 0.2*a_dot*b_dot*cos(a) + 0.1*phi_dot*b_dot + 0.2*psi_dot*a
  potential: a^2 + cos(b)
initial: {phi: 0.3, a: 0.2, psi: -1, b: 0.5, phi_dot: 1, psi_dot: -0.7, a_dot: 0.4}
simulation: {duration: 1}
"""
SCENES = [
    ("elastic-pendulum-curve", "elimination"),
    (STEERED, "elimination"),
    (MIXED, "elimination"),
]


def differences(reduced, full):
    """Return, by column, the greatest difference against the size of the column."""
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


@pytest.mark.slow
@pytest.mark.parametrize(("model", "formulation"), SCENES)
@pytest.mark.parametrize("loops", [False, True], ids=["straight", "dense"])
def test_all_columns_agree(model, formulation, loops):
    full = run(model, formulation="full", rtol="1e-13")
    reduced = run(model, formulation=formulation, rtol="1e-13", loops=loops)
    left = reduced.system
    assert left.n < full.system.n
    # 1e-13 a step and the motion's own growth leave 1e-11 at most.
    for name, off in differences(reduced, full).items():
        assert off < 1e-10, name


@pytest.mark.slow
def test_eliminated_constraints_hold_to_the_last_digit():
    found = run("elastic-pendulum-curve")
    assert found.plan.formulation == "elimination"
    # The relation's own expression, of a coordinate that it gave: a rounding each.
    assert np.max(np.abs(found["residual_path"])) <= 2.3e-16
    assert found.trajectory.statistics.evaluations < run(
        "elastic-pendulum-curve", formulation="projection"
    ).trajectory.statistics.evaluations  # fmt: skip


@pytest.mark.slow
def test_it_must_pay_to_be_chosen():
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


@pytest.mark.slow
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


def reduction_of(text, formulation):
    return case_of(text, formulation=formulation).plan().reduction


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
    assert reduction_of(text, "auto").eliminated == (("y", "curve"),)
    # With c = 0 the relation says sin(x) = 0, which gives no coordinate.
    text = text.replace("c: 1}", "c: 0}")
    assert reduction_of(text, "auto").eliminated == ()
    with refused("formulation-refused", "`curve`"):
        reduction_of(text, "elimination")


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
    sizes = dict.fromkeys(equations.q, 1.0)
    found = Reduction(equations).eliminate(values | {"c": 1.0}, sizes).eliminated
    assert "y" not in [q for q, _ in found]


def test_a_coordinate_that_moves_a_thousand_times_as_far_is_left_alone():
    text = CURVE.replace("RIGHT", "5000*x + sin(z)*0.1")
    assert reduction_of(text, "auto").eliminated == (("x", "curve"),)


def test_a_motion_that_is_wholly_prescribed_keeps_a_coordinate():
    text = """
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 0}
constraints: {one: x = sin(t), two: y = cos(t)}
initial: {x: 0, y: 1, x_dot: 1}
simulation: {duration: 1}
"""
    assert len(reduction_of(text, "auto").equations.q) == 1


@pytest.mark.slow
def test_dependent_constraints_are_left_alone():
    text = CURVE.replace('"c*y = RIGHT"}', '"y = x^2", again: "2*y = 2*x^2"}')
    assert reduction_of(text, "auto").eliminated == ()
    with refused("formulation-refused", "2 of rank 1"):
        reduction_of(text, "elimination")


@pytest.mark.parametrize(
    ("change", "to"),
    [
        ("simulation:", "forces: {phi: 0.1}\nsimulation:"),
        ("simulation:", "forces: {phi: -phi_dot}\nsimulation:"),
        ("potential: a^2", "potential: a^2 + 0.1*phi"),
        ("(1 + a^2)*phi_dot^2/2", "(1 + a^2)*phi_dot^2/2 + phi*a_dot^2"),
        ("initial: {", "constraints: {held: phi = 0.3 + a - 0.2}\ninitial: {"),
        ("initial: {", "constraints: {held: phi_dot = 5*a_dot - 1}\ninitial: {"),
    ],
)
def test_momenta_that_are_not_conserved(change, to):
    equations = derive(read(TOP, "model.yaml"))
    assert [equations.q[c] for c in conserved(equations)] == ["phi", "psi"]
    assert change in TOP
    equations = derive(read(TOP.replace(change, to), "model.yaml"))
    assert "phi" not in [equations.q[c] for c in conserved(equations)]


@pytest.mark.parametrize(
    ("inertia", "act"), [("1", "impulse: {phi: 0.1}"), ("J", "set: {J: 2}")]
)
def test_momenta_jump_at_acts(inertia, act):
    """An event gives an impulse, or sets an inertia: no momentum is constant."""
    text = TOP.replace("(1 + a^2)", f"({inertia} + a^2)").replace(
        "initial: {",
        f"{'modes: {J: 1}' if inertia == 'J' else ''}\n"
        f"events: {{e: {{every: 0.5, {act}}}}}\ninitial: {{",
    )
    assert conserved(derive(read(text, "model.yaml"))) == []


FLOOR = contact("y >= 0", 0.5)
ROUGH = contact("y >= 0", 0.5, friction=0.3, slip="x_dot")


@pytest.mark.parametrize(
    ("constraints", "expected"),
    [
        ({}, ["x"]),
        ({"floor": FLOOR}, ["x"]),
        ({"floor": ROUGH}, []),
        ({"floor": FLOOR, "wall": contact("x <= 3", 0.5)}, []),
        ({"floor": FLOOR, "brake": {"relation": "x_dot = 0", "limit": 2}}, []),
        # It pushes y alone, but from another place where x is another.
        ({"hill": {"relation": "y_dot = 0", "limit": "2 + x"}}, []),
    ],
)
def test_a_ball_that_flies_sideways(constraints, expected):
    text = scene(
        "x y", "(x_dot^2 + y_dot^2)/2", "g*y", constraints,
        {"x": 0, "y": 1, "x_dot": 1}, duration=1,
    )  # fmt: skip
    equations = derive(read(text, "m.yaml"))
    assert [equations.q[k] for k in conserved(equations)] == expected


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
