"""Rows end where the answer does: relations that part, and gaps that jump."""

from __future__ import annotations

import numpy as np
import pytest

import lagsim

PARTING = """
parameters: {{k: {k!r}, at: {at!r}, T: {T!r}}}
coordinates: {{x: {{}}, y: {{}}, z: {{}}}}
energy: {{kinetic: "k*(x_dot^2 + y_dot^2) + {m!r}*z_dot^2/2", potential: 0}}
constraints: {{{relations}}}
initial: {{x: {{guess: at}}, y: {{guess: 0.5}}, z: 1, x_dot: {{guess: 0.3}},
  y_dot: {{guess: 0}}, z_dot: 2}}
simulation: {{start: {start!r}, duration: 5, output_step: 0.1, method: {method}}}
"""
AGREES = ("(x - at) + 3*y = 2", "2*(x - at) + 6*y = 4 + {more}")
CURVED = ("(x - at)^2 + y^2 = 1", "2*(x - at)^2 + 2*y^2 = 2 + {more}")
SPEEDS = ("x_dot + 3*y_dot = 0", "2*x_dot + 6*y_dot = {more}")


@pytest.mark.parametrize("method", ["auto", "dop853"])
@pytest.mark.parametrize(
    "other", [{}, {"k": 1e6, "at": -30.0}, {"m": 1e9}, {"start": 20.0}], ids=str
)
@pytest.mark.parametrize("relations", [AGREES, CURVED, SPEEDS])
@pytest.mark.parametrize(
    "more", ["if(t < T, 0, (t - T)^3)", "max(0, t - T)", "1 - cos(max(0, t - T))"]
)
def test_relations_that_part_end_the_run(more, relations, other, method):
    """Both hold up to T, 2.91 after the start; rows to come are no answer."""
    numbers = {"k": 1.0, "at": 0.0, "m": 1.0, "start": 0.0, "method": method} | other
    T = numbers["start"] + 2.91
    first, second = relations
    second = second.format(more=more)
    for order in ((first, second), (second, first)):
        told = ", ".join(f'{n}: "{r}"' for n, r in zip("ab", order, strict=True))
        model = lagsim.load(PARTING.format(relations=told, T=T, **numbers))
        found = lagsim.simulate(model)
        assert found.outcome == "failed"
        assert found.record["failure"]["code"] == "no-answer"
        assert found.t[-1] == pytest.approx(numbers["start"] + 2.9)
        assert len(found.t) == 30
        assert f"from t = {numbers['start'] + 3.0:.9g} on" in found.reason
        assert "constraint-not-held" not in [w.code for w in found.warnings]


@pytest.mark.parametrize("relations", [AGREES, CURVED, SPEEDS])
def test_relations_that_agree_to_the_end(relations):
    told = [r.format(more="0*max(0, t - T)") for r in relations]
    told = ", ".join(f'{n}: "{r}"' for n, r in zip("ab", told, strict=True))
    model = PARTING.format(
        relations=told, T=2.97, k=1.0, at=0.0, m=1.0, start=0.0, method="auto"
    )
    found = lagsim.simulate(lagsim.load(model))
    assert found.complete
    assert len(found.t) == 51


RISER = """
parameters: {{h: {h!r}, w: {w!r}, at: {at!r}, g: 9.81}}
coordinates: {{x: {{}}, y: {{}}{more}}}
energy: {{kinetic: "(x_dot^2 + y_dot^2)/2{kinetic}", potential: g*y}}
constraints: {{s: {{relation: "{relation}", restitution: {e}}}}}
initial: {{x: at + 0.5*w, y: {y}, x_dot: w{starts}}}
simulation: {{start: {start!r}, duration: 3, output_step: 0.05}}
"""


@pytest.mark.parametrize("beside", [False, True])
@pytest.mark.parametrize(
    ("h", "w", "at", "start"),
    [(0.2, 1.0, 0.0, 0.0), (2e-3, 0.01, 0.0, 5.0), (30.0, 100.0, 1e3, 0.0)],
)
@pytest.mark.parametrize(("e", "y"), [(0, "0"), (0.5, "h/4")])
@pytest.mark.parametrize(
    "relation",
    [
        "y >= h*floor((x - at)/w)",
        "y >= if(x - at >= w, h, 0)",
        "y >= h*heaviside(x - at - w)",
    ],
)
def test_a_ball_that_runs_into_a_riser(relation, e, y, h, w, at, start, beside):
    """At x = at + w, half a unit of time after the start, the ground is h higher."""
    words = {
        "more": ", z: {}" if beside else "",
        "kinetic": " + 1e6*z_dot^2/2" if beside else "",
        "starts": ", z: 0, z_dot: 1" if beside else "",
    }
    text = RISER.format(
        relation=relation, e=e, y=y, h=h, w=w, at=at, start=start, **words
    )
    found = lagsim.simulate(lagsim.load(text))
    assert found.outcome == "failed"
    assert found.record["failure"]["code"] == "constraint-jumps"
    assert found.t[-1] - start == pytest.approx(0.5, abs=1e-9)
    assert np.all(found["y"] < 0.9 * h)
    assert not [w for w in found.warnings if w.code != "unused-parameter"]
