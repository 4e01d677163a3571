"""Bounds of laws whose arguments jump: limits, friction, static and dynamic.

A body slides at 64 and is slowed by its bound b(t) alone: its speed is 64 less the
integral of b, of which all pieces are linear in t. The clock c moves steadily.
"""

from itertools import pairwise

import numpy as np
import pytest
import yaml

from tests.support import refused, simulate

LAWS = {
    "limit": {"relation": "v_dot = 0", "limit": "{0}"},
    "static": {
        "relation": "v_dot = 0", "limit": {"static": "{0} + 1", "dynamic": "{0}"},
    },
    "friction": {
        "relation": "z >= 0", "restitution": 0, "friction": "{0}", "slip": "v_dot",
    },
    "disc": {
        "relation": "z >= 0", "restitution": 0, "friction": "{0}",
        "slip": ["v_dot", "w_dot"],
    },
}  # fmt: skip


def filled(law, bound):
    """Write a bound into a law."""
    if isinstance(law, dict):
        return {key: filled(x, bound) for key, x in law.items()}
    return law.format(bound) if isinstance(law, str) else law


def slowed(law, bound, *, rate=-1.0, **sections):
    """A body that slides, beside a clock c, for two seconds."""
    own = {"constraints": {"rub": filled(LAWS[law], bound)}} if law else {}
    return yaml.safe_dump({
        "coordinates": {"c": {}, "v": {}, "w": {}, "z": {}},
        "energy": {
            "kinetic": "(c_dot^2 + v_dot^2 + w_dot^2 + z_dot^2)/2", "potential": "z",
        },
        "initial": {"c": 1.875, "c_dot": rate, "v": 0, "v_dot": 64, "w": 0, "w_dot": 0,
                    "z": 0, "z_dot": 0},
        "simulation": {"duration": 2, "output_step": 0.5},
    } | own | sections, sort_keys=False)  # fmt: skip


def lost(b, t):
    """Integrate a function of t with jumps at multiples of 1/96 alone."""
    edges = np.linspace(0.0, t, round(96 * t) + 1)
    middles = (edges[1:] + edges[:-1]) / 2
    return sum(b(x) for x in middles) * t / max(len(middles), 1)


# Bounds of c = 1.875 - t (or of t), which reach 0 where they jump, or where they turn.
TABLE = {"tl": {"points": [[0, 0.5], [1, -0.5], [2, 0.5]], "interpolation": "linear",
                "outside": "repeat"}}  # fmt: skip
BOUNDS = {
    "mod(c, 0.75)": lambda t: (1.875 - t) % 0.75,
    "0.5*mod(c - 0.375*floor(4*t), 1.5)": lambda t: (
        0.5 * ((1.875 - t - 0.375 * np.floor(4 * t)) % 1.5)
    ),
    "if(c > 0.5, c - 0.5, 0.25)": lambda t: 1.375 - t if t < 1.375 else 0.25,
    "max(0, tl(c) + 0.25*floor(2*t))": lambda t: max(
        0.0, abs((1.875 - t) % 2 - 1) - 0.5 + 0.25 * np.floor(2 * t)
    ),
    "c - floor(c)": lambda t: (1.875 - t) % 1,
    "0.125 + abs(mod(c, 1) - 0.5*heaviside(c - 1))": lambda t: (
        0.125 + abs((1.875 - t) % 1 - 0.5 * (t <= 0.875))
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("bound", BOUNDS)
def test_a_bound_that_is_never_negative_ends_no_run(law, bound):
    tables = {"tables": TABLE} if "tl(" in bound else {}
    found = simulate(slowed(law, bound, **tables))
    assert found.outcome == "done"
    for t, v in zip(found.t, found["v_dot"], strict=True):
        # Linear pieces end at multiples of 1/96.
        assert v == pytest.approx(64 - lost(BOUNDS[bound], t), abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
def test_a_bound_is_judged_after_a_break_at_the_time_at_which_its_argument_jumps(law):
    # d falls to 0 where it jumps to 1.5, at a break in t; |d| = d, from a = 17/16.
    d = "mod(t - 1.90625*mod(2*t + 1.0625, 1), 1.5)"

    def bound(t):
        return 0.125 + 0.5 * ((t - 1.90625 * ((2 * t + 1.0625) % 1)) % 1.5)

    found = simulate(slowed(law, f"0.125 + 0.5*abs({d})"))
    assert found.outcome == "done"
    slope, jumps = 1 - 2 * 1.90625, [k / 2 - 1 / 32 for k in range(1, 5)]
    edges = [0.0, *jumps, 2.0]
    for low, high in pairwise(edges):
        first = low - 1.90625 * ((2 * low + 1.0625) % 1)
        zeros = (low + (1.5 * k - first) / slope for k in range(-3, 3))
        edges += [t for t in zeros if low < t < high]
    edges = sorted(edges)
    total = sum((b - a) * bound((a + b) / 2) for a, b in pairwise(edges))
    assert found["v_dot"][-1] == pytest.approx(64 - total, abs=1e-9)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("bound", "ends"),
    [("c - 0.875", 1.0), ("0.375 - mod(c, 1)", None), ("max(-0.5, 1.125 - t)", 1.125)],
)
def test_a_bound_that_falls_below_0_ends_the_run(law, bound, ends):
    if ends is None:  # it is negative at the start
        with refused("out-of-range", "`rub`", "-0.5"):
            simulate(slowed(law, bound))
        return
    found = simulate(slowed(law, bound))
    assert found.outcome == "failed"
    assert "`rub`" in found.reason
    assert " -1" in found.reason or ends != 1.0
    assert found.t[-1] == pytest.approx(ends, abs=1e-9)


# An event sets u = 0.5 and -0.25 by turns; at t = 0.5 the two arguments are equal.
BY_TURNS = {
    "modes": {"u": 0.5},
    "events": {"e": {"every": 0.25, "set": {"u": "0.25 - u"}}},
}


def least(t):
    u = -0.25 if int(4 * t) % 2 == 0 else 0.5
    return min(0.875 - 1.5 * u, -0.25 + 0.75 * t)


@pytest.mark.parametrize("law", ["", "limit", "friction"])
def test_an_act_at_the_time_of_a_switch_moves_its_argument_from_the_level(law):
    text = "min(0.875 - 1.5*u, 1.5*(c - 1.875)/2 - 0.25)"
    more = {"forces": {"v": f"-{text} - 1"}} if not law else {}
    model = slowed(law, f"1 + {text}", rate=1.0, **BY_TURNS, **more)
    found = simulate(model)
    for t, v in zip(found.t, found["v_dot"], strict=True):
        assert v == pytest.approx(64 - t - lost(least, t), abs=1e-9)


def test_the_last_row_has_the_branches_of_t_after_an_event_at_the_end():
    text = "0.25 - min(0, max(2*u + 1.25, -0.75*t - 0.875))"
    more = {"forces": {"v": f"-({text})"}, "modes": {"u": 1.0}}
    events = {"events": {"e": {"every": 0.5, "set": {"u": "-0.5 - u"}}}}
    found = simulate(slowed("", "", **more, **events))
    # u is -1.5 from 0 on, 1 from 0.5 on, ..., and -1.5 from t = 2 on.
    modes = np.array([-1.5, 1, -1.5, 1, -1.5])
    least = np.minimum(0, np.maximum(2 * modes + 1.25, -0.75 * found.t - 0.875))
    np.testing.assert_allclose(found["v_ddot"], least - 0.25, rtol=1e-12)
