"""Values of switches in rows: of the sides on which the motion goes on at that time."""

import re

import numpy as np
import pytest

import lagsim
from lagsim.run.observers import Keep
from tests.run.switching.scenes import one_quick, scene
from tests.support import ready, simulate

# The friction has the size 1.3 where it slides; `v` stands for the slip.
FRICTION = one_quick(
    "-1.3*sign(v)",
    "-if(v > 0, 1.3, if(v < 0, -1.3, 0))",
    "1.3 - 2.6*heaviside(v)",
    "-1.3*v/abs(v)",
    "-1.3*sign(cbrt(v))",
    "-1.3*sign(v)*sqrt(1 + abs(v)^1.5)",
    "1.3 - 1.3*floor(min(max(v, -1), 0.5) + 1)*2",
    "-1.3*sign(-2*v)*(-1)",
)


def drawn(law, *, v=0.0, belt=0.0, push="2*sin(3*t)", **settings):
    """Return the result of a block with friction, `drag`, that a force pushes."""
    law = re.sub(r"\bv\b", f"(x_dot - {belt})", law)
    text = scene(force="drag + push", v=v, duration=0.8, output_step=0.1)
    words = f'definitions: {{drag: "{law}", push: "{push}"}}\nenergy:'
    sections = (
        f"output: {{sections: {{s: {{at: x_dot = {belt}}}, strobe: {{every: 0.1}}}}}}"
    )
    return simulate(text.replace("energy:", words) + sections, **settings)


def out_of_balance(columns):
    """Return the largest difference of the force in definitions from the acting one."""
    force = np.asarray(columns["drag"]) + np.asarray(columns["push"])
    return np.max(np.abs(force - np.asarray(columns["x_ddot"])), initial=0.0)


@pytest.mark.slow
@pytest.mark.parametrize("law", FRICTION)
@pytest.mark.parametrize("belt", [0.0, 0.3])
def test_the_row_at_which_a_slip_begins_has_the_force_of_the_slip(law, belt):
    found = drawn(law, v=belt, belt=belt)
    # Held until 2 sin 3t = 1.3.
    slip = found.events[-1].time if found.events[-1].kind == "slip" else np.nan
    assert slip == pytest.approx(np.arcsin(0.65) / 3, abs=1e-12)
    at = found.at([0.0, slip, slip + 1e-3])
    # Forces of size 1, to rounding.
    assert at["drag"] == pytest.approx([0.0, -1.3, -1.3], abs=1e-4)
    assert out_of_balance(at) < 1e-12
    assert out_of_balance(found) < 1e-12
    for section in found.sections.values():
        assert out_of_balance(section) < 1e-12


@pytest.mark.parametrize("law", FRICTION)
def test_the_first_row_of_a_body_that_moves_off_has_the_force_of_the_motion(law):
    for sign in (1, -1):
        found = drawn(law, push=f"{sign * 2}*cos(t)")
        assert found["drag"][0] == pytest.approx(-1.3 * sign, abs=1e-12)
        assert found["x_ddot"][0] == pytest.approx(0.7 * sign, abs=1e-12)
        assert out_of_balance(found) < 1e-12


@pytest.mark.parametrize("law", FRICTION)
@pytest.mark.parametrize("belt", [0.0, 0.25])
def test_a_section_is_crossed_where_the_motion_reaches_it_and_stays(law, belt):
    # x'' = 2 sin 3t + 1.3 from below the belt's speed, which it reaches at `stick`.
    found = drawn(law, v=belt - 0.4, belt=belt)
    stick, slip = (e.time for e in found.events)
    t = np.linspace(0.0, 0.8, 1 + 2**20)
    below = -0.4 + 2 / 3 * (1 - np.cos(3 * t)) + 1.3 * t
    if "^1.5" not in law:  # another force while it slides
        assert stick == pytest.approx(np.interp(0.0, below, t), abs=1e-9)
    assert slip == pytest.approx(np.arcsin(0.65) / 3, abs=1e-12)
    crossing = found.sections["s"]
    assert crossing["t"].tolist() == [stick]
    assert crossing["drag"] == pytest.approx(-2 * np.sin(3 * stick), abs=1e-12)
    assert crossing["x_ddot"] == pytest.approx(0.0, abs=1e-12)


HELD = one_quick(
    "sqrt(-min(0, v)) - 2*if(v > 0, v, 0)^0.4",
    "2*(max(0, -v)^0.1 - max(0, v)^0.1)",
    "-if(v > 0, v, 0)^0.3 + 2*if(v < 0, -v, 0)^0.3",
    "-(abs(v) + v)^0.2 + (abs(v) - v)^0.2",
)


@pytest.mark.slow
@pytest.mark.parametrize("law", HELD)
@pytest.mark.parametrize("push", ["1e-9*t", "-1e-9*t"])
def test_a_root_that_holds_is_shown_as_it_acts(law, push):
    # Below c floor^p the root holds the body like dry friction.
    found = drawn(law, push=push)
    assert found.events[0].kind == "stick"
    # The force is 1e-9, its rounding 1e-25.
    assert out_of_balance(found) < 1e-15
    assert out_of_balance(found.sections["strobe"]) < 1e-15


AGAIN = one_quick(
    scene(force="0.7*t + 2*(max(0, -x_dot)^0.1 - max(0, x_dot)^0.1)", duration=0.2),
    scene(force="sin(3*t) - 0.3*sign(x_dot) - cbrt(x_dot)", duration=2),
    scene(force="-sign(x)*abs(x_dot)^0.3 - 2*floor(x)", x=0.7, duration=2),
    scene(force="-9.81", x=1, duration=2)
    + "constraints: {floor: {relation: x >= 0, restitution: 0.5}}",
    scene(force="2*sin(3*t)", duration=2)
    + "constraints: {brake: {relation: x_dot = 0, limit: 1.3}}",
)


@pytest.mark.parametrize("text", AGAIN)
def test_a_session_runs_again_as_before(text):
    session = ready(text)
    runs = []
    for _ in range(3):
        rows = Keep()
        found = session.run([rows])
        runs.append((rows.table.tobytes(), found.events, found.statistics))
    assert runs[0] == runs[1] == runs[2]


@pytest.mark.slow
def test_states_between_rows_are_those_of_the_run():
    text = scene(
        force="0.7*t + 2*(max(0, -x_dot)^0.1 - max(0, x_dot)^0.1)",
        duration=1, output_step=0.1,
    )  # fmt: skip
    found = lagsim.simulate(text, error_bar="never")
    again = found.at(found["t"])
    assert all(np.array_equal(again[name], found[name]) for name in found.columns)
