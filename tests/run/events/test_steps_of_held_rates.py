"""Steps of rates and gaps that laws or forces hold at 0: conditions and columns.

A step such as `sign(x_dot - y_dot/3)` is at its level while friction holds
`2.1*x_dot - 0.7*y_dot` at 0. In floating point its argument is then a few roundings of
either sign, and at the instant at which the slip ends, possibly past 0.
"""

import numpy as np
import pytest

import lagsim

# A mass of 0.7 kg under -0.37 N and one of 1.3 kg under 0.11 N: while it slides, the
# slip a x_dot - b y_dot of a limit of 1 N falls at a constant rate.
BODIES = """\
coordinates: {x: {}, y: {}}
energy: {kinetic: 0.7*x_dot^2/2 + 1.3*y_dot^2/2, potential: 0}
modes: {n: 0}
"""
LIMIT = "constraints: {rub: {relation: SLIP = 0, limit: 1}}\nforces: {x: FX, y: FY}\n"
FORCE = "definitions: {r: PLACE}\nforces: {r: -sign(r_dot), x: FX, y: FY}\n"
END = "initial: {x: 0.1, y: 0, x_dot: SPEED, y_dot: 0.3}\nsimulation: {duration: 2}\n"
# The slip, its argument in steps, and the slip as the rate of a place.
SLIPS = {
    "one rate": ("x_dot", "x_dot", "x"),
    "thirds": ("2.1*x_dot - 0.7*y_dot", "x_dot - y_dot/3", "2.1*x - 0.7*y"),
    "tenths": ("x_dot - 0.1*y_dot", "10*x_dot - y_dot", "x - 0.1*y"),
}
# A condition, and how often its event acts where S falls to 0, or rises to it. The
# step of 0 is that of the level: sign(0) = 0, heaviside(0) = 1, floor(0) = 0.
CONDITIONS = {
    "sign(S) >= -0.5": (0, 1), "sign(S) <= 0.5": (1, 0), "sign(S) >= 0.5": (0, 0),
    "heaviside(S) >= 0.3": (0, 1), "heaviside(S) <= 0.2": (0, 0),
    "abs(sign(S)) <= 0.5": (1, 1),
    "if(S > 0, 1, 0) <= 0.5": (1, 0), "if(S >= 0, 1, 0) <= 0.5": (0, 0),
    "floor(S) <= -0.5": (0, 0),
}  # fmt: skip


def run(*parts, **words):
    text = BODIES + "".join(parts) + END
    for word, value in words.items():
        text = text.replace(word, f"'{value}'" if word == "PLACE" else str(value))
    return lagsim.simulate(lagsim.load(text), error_bar="never")


@pytest.mark.slow  # a case takes up to 5 s
@pytest.mark.parametrize("by", [LIMIT, FORCE], ids=["limit", "force"])
@pytest.mark.parametrize("name", SLIPS)
@pytest.mark.parametrize("falls", [True, False], ids=["falls", "rises"])
def test_a_condition_on_the_step_of_a_slip_that_ends(name, by, falls):
    slip, argument, place = SLIPS[name]
    names = {f"e{k}": text for k, text in enumerate(CONDITIONS)}
    events = [
        f"  {e}: {{at: '{text.replace('S', f'({argument})')}', set: {{n: n + 1}}}}\n"
        for e, text in names.items()
    ]
    way = 1 if falls else -1
    speed = 1.1 if falls else -0.9
    result = run(
        by, "events:\n", *events,
        SLIP=slip, PLACE=place, FX=-0.37 * way, FY=0.11 * way, SPEED=speed,
    )  # fmt: skip
    acts = [e.name for e in result.events if e.kind == "event"]
    found = {text: acts.count(e) for e, text in names.items()}
    assert found == {text: n[not falls] for text, n in CONDITIONS.items()}


@pytest.mark.parametrize("name", SLIPS)
def test_columns_of_steps_while_a_limit_holds_the_slip(name):
    slip, argument, _ = SLIPS[name]
    # Steps, with their values while S is positive and while it is 0.
    steps = {
        "sign(S)": (1.0, 0.0), "heaviside(S)": (1.0, 1.0),
        "if(S > 0, 1, 0)": (1.0, 0.0), "ceil(S)": (None, 0.0),
    }  # fmt: skip
    columns = [
        f"  d{k}: '{x.replace('S', f'({argument})')}'\n" for k, x in enumerate(steps)
    ]
    result = run(
        LIMIT, "definitions:\n", *columns, SLIP=slip, FX=-0.37, FY=0.11, SPEED=1.1
    )
    stuck = result.t > 0.6  # the last of these slips ends at 0.562
    for k, (before, held) in enumerate(steps.values()):
        assert np.all(result[f"d{k}"][stuck] == held)
        assert before is None or result[f"d{k}"][0] == before


def test_columns_of_steps_of_a_gap_at_rest():
    text = """\
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y}
definitions: {d: sign(y - 0.2*x), f: "floor(y - 0.2*x)", g: "if(y > 0.2*x, 1, 0)"}
constraints: {floor: {relation: y >= 0.2*x, restitution: 0}}
initial: {x: 0.1, y: 0.5}
simulation: {duration: 2}
"""
    result = lagsim.simulate(lagsim.load(text), error_bar="never")
    slides = result.t > 0.32  # it falls 0.48 m: sqrt(2*0.48/9.81) = 0.313
    for name in "dfg":
        assert np.all(result[name][slides] == 0.0)
