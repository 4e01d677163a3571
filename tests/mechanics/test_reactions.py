"""Reactions against closed forms, explicit constraints, and rates of momentum."""

import numpy as np
import pytest

from lagsim.errors import InputError
from lagsim.model.reader import read
from lagsim.run.session import check
from tests.support import at_outputs, ready, run

G = 9.81
PENDULUM = """
parameters: {m: 1.5, l: 1.1, g: 9.81}
coordinates: {a: {unit: rad}}
definitions:
  x: l*sin(a)
  y: -l*cos(a)
  unused: 2*a
  tension: -(reaction.x*x + reaction.y*y)/l
energy: {kinetic: m*(x_dot^2 + y_dot^2)/2, potential: m*g*y}
initial: {a: 1, a_dot: 0.5}
simulation: {duration: 3, output_step: 0.05}
output:
  reactions: [x, unused, y]
  plots: [{x: t, y: "hypot(reaction.x, reaction.y)"}]
"""


def at_rows(model, **options):
    """Return the columns of a run by name."""
    r = run(model, **options)
    return {name: r[name] for name in r.system.columns.names}


def test_the_rod_of_a_pendulum():
    # Newton: T - m g cos(a) = m l a'^2.
    r = at_rows(PENDULUM)
    T = 1.5 * G * np.cos(r["a"]) + 1.5 * 1.1 * r["a_dot"] ** 2
    assert r["tension"] == pytest.approx(T, rel=1e-12)
    # Along the rod, towards the pivot; of x'' and y'' it is all but the weight.
    assert r["reaction.x"] == pytest.approx(-T * np.sin(r["a"]), rel=1e-11, abs=1e-12)
    assert r["reaction.y"] == pytest.approx(T * np.cos(r["a"]), rel=1e-11)
    assert r["plot:0.y.1"] == pytest.approx(T, rel=1e-12)
    assert not r["reaction.unused"].any()


def test_they_stand_last_in_the_table_and_change_no_other_column():
    formula = "hypot(reaction.x, reaction.y)"
    plain = PENDULUM.replace("  reactions: [x, unused, y]\n", "")
    plain = plain.replace("  tension: -(reaction.x*x + reaction.y*y)/l\n", "")
    asked, others = run(PENDULUM), at_rows(plain.replace(formula, "a"))
    columns = asked.system.columns
    names = columns.names[: columns.table]
    assert names[-3:] == ("reaction.x", "reaction.unused", "reaction.y")
    shared = [name for name in names if name in others]
    assert len(shared) == len(names) - 4
    for name in shared:
        assert np.array_equal(asked[name], others[name])


# The same twice: with x, y and z as definitions whose reactions are asked for, and as
# coordinates that constraints hold. What hangs on x by z is held by x, too.
IMPLICIT = """
coordinates: {th: {}, u: {}}
definitions: {x: (l + u)*sin(th) + c*t^2, y: -(l + u)*cos(th), z: x + r*sin(th - u)}
output: {reactions: [x, y, z]}
constraints:
"""
EXPLICIT = """
coordinates: {th: {}, u: {}, x: {}, y: {}, z: {}}
constraints:
  hold_x: x = (l + u)*sin(th) + c*t^2
  hold_y: y = -(l + u)*cos(th)
  hold_z: z = x + r*sin(th - u)
"""
GUESSED = ", ".join(f"{x}: {{guess: 0.1}}, {x}_dot: {{guess: 0.1}}" for x in "xyz")
PARTS = """
parameters: {l: 1, k: 40, g: 9.81, c: 0.1, mu: 0.3, r: 0.4}
forces: {x: 2*sin(3*t) - 0.1*x_dot, u: -0.3*u_dot}
simulation: {duration: 1.5, output_step: 0.01}
"""
PLAIN = "kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2 + r*u_dot^2, potential: g*y + k*u^2/2"
SPINNING = "(x_dot^2 + z_dot^2)/2 + r*u_dot^2 + x*y_dot - y*z_dot - g*y - k*u^2/2"
FLOOR = "y >= -0.9, restitution: 0.5, friction: mu, slip: x_dot"
REST = "th: 1, u: 0"
PATH = "th: 1, th_dot: 0.5, u: {guess: 0}, u_dot: {guess: 0}"
ROLL = "th: 1, th_dot: 0.5, u: 0, u_dot: {guess: 0}"
# Energies, constraints, start.
SCENES = {
    "dissipation": (f"{PLAIN}, dissipation: c*(x_dot - u_dot)^2 + c*y_dot^4", "", REST),
    "lagrangian": (f"lagrangian: {SPINNING}", "", REST),
    "path": (PLAIN, "path: u = 0.2*x^2 - y^3/9", PATH),
    "slip": (PLAIN, "roll: x_dot*cos(th) = 0.3*y_dot + u_dot", ROLL),
    "limit": (PLAIN, "brake: {relation: x_dot = 0, limit: 3}", REST),
    "floor": (PLAIN, f"floor: {{relation: {FLOOR}}}", REST),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SCENES)
def test_against_the_multipliers_of_explicit_constraints(name):
    energy, constraint, start = SCENES[name]
    parts = f"  {constraint}\n{PARTS}\nenergy: {{{energy}}}\n"
    ours = at_rows(f"{IMPLICIT}{parts}initial: {{{start}}}\n")
    theirs = at_rows(f"{EXPLICIT}{parts}initial: {{{start}, {GUESSED}}}\n")
    assert len(ours["t"]) == len(theirs["t"]) > 100
    # The two rows of an impact lie at times that are known to rounding only.
    apart = at_outputs(ours["t"], 0.0, 0.01)
    assert ours["th"] == pytest.approx(theirs["th"], abs=1e-10)
    for c in "xyz":
        one, other = ours[f"reaction.{c}"], theirs[f"lambda_hold_{c}"]
        size = np.max(np.abs(other[apart]))
        assert size > 1
        # As near as the two motions are.
        assert one[apart] == pytest.approx(other[apart], abs=1e-10 * size)


def test_dry_friction_that_holds_is_in_it():
    # Pulled by 2 < mu m g it sticks: friction is -2, which what is pulled transmits.
    r = at_rows("""
parameters: {m: 1, g: 9.81, mu: 0.4}
coordinates: {q: {}}
definitions: {x: 2*q}
energy: {kinetic: m*q_dot^2/2, potential: 0}
forces: {x: -mu*m*g*sign(x_dot), q: 4}
initial: {q: 0}
simulation: {duration: 1}
output: {reactions: [x]}
""")
    assert np.max(np.abs(r["q"])) < 1e-12
    assert r["reaction.x"][1:] == pytest.approx(2.0, rel=1e-12)


def test_what_nothing_is_written_with_is_told():
    found = check(read(PENDULUM, "model.yaml"))[0].examined.warnings
    [told] = [w for w in found if w.code == "reaction-zero"]
    assert "`reaction.unused`" in told.text


def test_multipliers_of_other_relations_are_refused():
    # q^2 = 0 is met as q = 0; with x apart x*q = 0 is no multiple root.
    model = read("""
coordinates: {q: {}, z: {}}
definitions: {x: q}
energy: {kinetic: (x_dot^2 + z_dot^2)/2, potential: 0}
constraints: {c: x*q = 0}
initial: {q: 0, z: 0}
simulation: {duration: 1}
output: {reactions: [x]}
""", "model.yaml")  # fmt: skip
    with pytest.raises(InputError) as told:
        ready(model)
    [problem] = told.value.problems
    assert (problem.code, problem.line) == ("multiple-root", 5)
