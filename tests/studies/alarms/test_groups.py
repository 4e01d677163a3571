"""The energy of a group that touches no other is judged by itself."""

from __future__ import annotations

import numpy as np
import pytest

import lagsim
from lagsim.studies.alarms import group_balances
from tests.studies.alarms.test_doubt import bump, spoilt
from tests.studies.judged import doubt, evidence
from tests.support import run

# A pendulum of 1 J, and beside it an oscillator of 50 kJ, or more.
BESIDE = """
parameters: {{M: {M}}}
coordinates: {{x: {{}}, z: {{}}}}
energy: {{kinetic: x_dot^2/2 + M*z_dot^2/2, potential: "1 - cos(x) + M*z^2/2{more}"}}
{forces}
initial: {{x: 1, z: 1}}
simulation: {{start: {start}, duration: 10, output_step: 0.01}}
"""
BALL = """
parameters: {M: 1e5}
coordinates: {y: {}, z: {}}
energy: {kinetic: y_dot^2/2 + M*z_dot^2/2, potential: 9.81*y + M*z^2/2}
constraints: {floor: {relation: y >= 0, restitution: 0.5}}
initial: {y: 1, z: 1}
simulation: {duration: 2, output_step: 0.01}
"""
ROD = """
parameters: {M: 1e5}
coordinates: {x: {}, y: {}, z: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2 + M*z_dot^2/2, potential: y + M*z^2/2}
constraints: {rod: x^2 + y^2 = 1}
initial: {x: 1, y: 0, z: 1}
simulation: {duration: 10, output_step: 0.01}
"""


def beside(M=1e5, more="", forces="", start=0.0):
    return BESIDE.format(M=M, more=more, forces=forces, start=start)


def faster(found, name, speed, since):
    """Give a run whose body of unit mass is faster from some time on."""
    late = found["t"] - found["t"][0] > since
    gain = late * (found[name] * speed + speed**2 / 2)
    wrong = spoilt(found, name, lambda _: late * speed)
    return spoilt(wrong, "energy", lambda _: gain)


def shown(found):
    monitor = evidence(found).monitor
    return {b.names: b for b in group_balances(found.equations, monitor)}


SCENES = [
    beside(),
    beside(M=1e9, start=1e3),
    beside(forces="forces: {x: -0.1*x_dot}"),
    beside(forces="forces: {x: 0.3*sin(t)}"),
    beside(forces="forces: {z: 1e3*sin(t)}"),
    beside(more=" + x*sin(2*t)/10"),
    beside(forces="forces: {x: -0.1*x_dot, z: 1e3*sin(t)}"),
    beside(forces="forces: {x: 0.3*sin(t), z: -1e3*z_dot}", M=1e7, start=-50),
    beside(more=" + x*sin(2*t)/10 + sin(3*t)", forces="forces: {z: -z_dot}"),
    ROD,
]


@pytest.mark.parametrize("text", [*SCENES, BALL])
def test_sound_groups_are_not_in_doubt(text):
    found = run(text)
    assert len(shown(found)) == 2
    for balance in shown(found).values():
        assert balance.drift < 1e-8 * balance.in_play
    assert doubt(found) is None


@pytest.mark.parametrize("text", SCENES)
def test_no_other_energy_hides_what_a_body_gains(text):
    """A velocity that is off by 5 % is 1e-7 of the energy beside it, or less."""
    found = run(text)
    told = doubt(faster(found, "x_dot", 0.05, since=5))
    assert told.refutes
    assert told.text.startswith("energy - work of x")
    assert told.time - found["t"][0] == pytest.approx(5, abs=0.2)


def test_a_bounce_that_gains_beside_an_oscillator():
    found = run(BALL)
    told = doubt(faster(found, "y_dot", 0.1, since=1))
    assert told.refutes
    assert told.time == pytest.approx(1, abs=0.05)


def test_the_share_of_each_group():
    """The pendulum's energy is 1 - cos 1 = 0.4597, the oscillator's M/2."""
    balance = shown(run(beside()))
    assert balance["x",].in_play == pytest.approx(1 - np.cos(1), rel=1e-2)
    assert balance["z",].in_play == pytest.approx(5e4, rel=1e-2)


@pytest.mark.parametrize(
    "more", [" + 0.1*x*z", " + sqrt(1 + x^2 + z^2)", " + 0.1*(x - z)^2"]
)
def test_what_is_no_sum_is_one_account(more):
    found = run(beside(M=1, more=more))
    assert not shown(found)
    assert doubt(found) is None
    assert doubt(spoilt(found, "energy", bump(0.3))).refutes


def test_impacts_beside_energy_that_would_round_their_work():
    """A difference of 1.5e15 J would be known to 0.1 J, of 7 J."""
    found = run("""
name: drowned
coordinates: {y: {}, z: {}}
energy: {kinetic: y_dot^2/2 + 1e9*z_dot^2/2, potential: 9.81*y + 1.5e15*z^2}
constraints: {floor: {relation: y >= 0, restitution: 0.5}}
initial: {y: 0.7, z: 1}
simulation: {duration: 0.6, output_step: 0.01}
""")
    (impact,) = found.trajectory.events
    assert impact.energy == pytest.approx(-0.75 * 9.81 * 0.7, rel=1e-9)
    assert shown(found)["y",].drift < 1e-9
    assert doubt(found) is None
    assert doubt(faster(found, "y_dot", 0.1, since=0.5)).refutes


ALIASED = """
parameters: {{A: {A}, T: {T}, m: {m}}}
coordinates: {{x: {{}}, z: {{}}{more[0]}}}
energy: {{kinetic: m*x_dot^2/2 + z_dot^2/2{more[1]}, potential: z^2}}
forces: {{x: m*A*cos(2*pi*t/T)}}
initial: {{x: 0, z: 1{more[2]}}}
simulation: {{duration: 20*T, output_step: {step}*T}}
"""
ALONE = ("", "", "")
LINKED = (", u: {}", " + m*(x_dot - u_dot)^2", ", u: 0")  # which moves as x does


def aliased(A=1.0, T=1.0, m=1.0, more=ALONE, step=1.0):
    """Give a model whose rows show x at rest; its rate is A T sin(2 pi t/T)/(2 pi)."""
    return ALIASED.format(A=A, T=T, m=m, more=more, step=step)


@pytest.mark.parametrize("bar", ["auto", "never"])
@pytest.mark.parametrize("method", ["dop853", "radau"])
@pytest.mark.parametrize(
    "options", [{}, {"more": LINKED}, {"A": 1e-3, "T": 10.0, "m": 1e6}]
)
def test_rows_that_alias_a_group_are_no_fault(method, bar, options):
    model = lagsim.load(aliased(**options))
    found = lagsim.simulate(model, method=method, rtol=1e-5, error_bar=bar)
    assert (found.outcome, found.warnings) == ("done", [])


@pytest.mark.parametrize("more", [ALONE, LINKED])
@pytest.mark.parametrize("step", [0.01, 1.0])
def test_the_energy_in_play_is_that_between_rows_too(step, more):
    found = run(aliased(step=step, more=more))
    greatest = 1 / (8 * np.pi**2)
    # Ends of steps may pass over the greatest rate by a part of a step.
    assert evidence(found).balances[0].in_play == pytest.approx(greatest, rel=0.1)
