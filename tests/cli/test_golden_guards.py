"""`lagsim golden`: its report on the numbers of a model that a golden guards."""

from pathlib import Path

import pytest

from tests.cli._results import document

# s follows a pulse at a rate of 100, and forgets it within the time of a row: at 0.5 by
# exp(-20), of which a part of 1e-4 is 2e-13.
PULSE = """
name: pulse
parameters: {pulse: 1, w: 2}
coordinates: {x: {}}
states: {s: {rate: "100*(if(t > 0.2 and t < 0.3, pulse, 0) - s)"}}
energy: {kinetic: x_dot^2/2, potential: w^2*x^2/2}
initial: {x: 1, s: 0}
simulation: {duration: 2, output_step: 0.5}
"""


def test_a_change_between_rows_is_not_seen_and_named(lagsim, write):
    write(PULSE, "pulse.yaml")
    told = lagsim("golden", "--update", "pulse.yaml", code=0)
    assert told.reports("W406", "pulse")
    assert "[W406]" in told.err
    about = document("golden/pulse.json")
    found = about["changes"]["parameters"]
    assert found["w"]["ratio"] > 1.0
    assert "response" not in found["w"]
    assert found["pulse"]["ratio"] < 1.0
    # The pulse reaches 1 - exp(-10); a ten-thousandth of that is far from rounding.
    assert found["pulse"]["response"] > 1e6
    told = lagsim("golden", "pulse.yaml", code=0)
    [note] = [x for x in told.out.splitlines() if "note: small changes" in x]
    assert note.endswith(": pulse")
    answer = lagsim("golden", "--json", "pulse.yaml", code=0).json
    assert answer["models"][0]["unseen"] == ["pulse"]
    # It is so: with another pulse the golden passes.
    write(PULSE.replace("pulse: 1", "pulse: 1.0001"), "pulse.yaml")
    lagsim("golden", "pulse.yaml", code=0)


@pytest.mark.slow
def test_a_change_that_closer_rows_show_is_seen(lagsim, write):
    other = PULSE.replace("pulse: 1", "pulse: 1.0001")
    write(PULSE.replace("0.5}", "0.05}"), "pulse.yaml")
    assert "W406" not in lagsim("golden", "--update", "pulse.yaml", code=0).err
    write(other.replace("0.5}", "0.05}"), "pulse.yaml")
    lagsim("golden", "pulse.yaml", code=1)


CHAOS = """
name: chaos
parameters: {m: 1, g: 9.81, l: 1}
coordinates: {a: {}, b: {}}
energy:
  kinetic: m*l^2*(a_dot^2 + b_dot^2/2 + a_dot*b_dot*cos(a - b))
  potential: -m*g*l*(2*cos(a) + cos(b))
initial: {a: 2, b: 1}
simulation: {duration: 200, output_step: STEP}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("step", "few"), [("1", True), pytest.param("0.1", False, marks=pytest.mark.slow)]
)
def test_rows_before_an_early_horizon_are_fifty_or_fewer_are_warned_of(
    lagsim, write, step, few
):
    # Errors grow tenfold in 2 s: the horizon is at about 20 s of 200.
    write(CHAOS.replace("STEP", step), "chaos.yaml")
    told = lagsim("golden", "--update", "chaos.yaml", code=0)
    about = document("golden/chaos.json")
    table = Path("golden/chaos.csv").read_text().splitlines()
    rows = len(table) - 1
    assert f"{rows} of {200 / float(step) + 1:,.0f} rows" in told.out
    assert f"past t = {about['horizon']:.4g} of 200 only" in told.out
    assert ("W405" in told.err) == few
    assert (rows < 50) == few
    # No row before the horizon that could have been kept is missing where they are few.
    assert not few or rows == about["horizon"]
