"""A swept parameter acts in every place of a file where it may stand.

Functions compiled for one value serve all values of a sweep. A value that is stored
elsewhere, as a constant of the code or a property of a copied system, would have no
effect there.
"""

import numpy as np
import pytest

import lagsim

PLANE = {
    "coordinates": "x: {}, y: {}",
    "energy": "kinetic: (x_dot^2 + y_dot^2)/2, potential: 9.81*y",
    "initial": "x: 0, y: 0.3, x_dot: 2",
}
BLOCK = {"energy": "kinetic: x_dot^2/2, potential: 0", "initial": "x: 0, x_dot: 1"}
REST = BLOCK | {"initial": "x: 0", "forces": "x: 4*t"}
MOREAU = {"simulation": "duration: 1, method: moreau, step: 0.01"}
TABLE = {
    "tables": "f: {points: [[0, 0], [0.5, 1.3], [1, 1]], interpolation: linear,"
    " outside: extend}"
}


def floor(more, **other):
    """Return a particle that falls on a floor with these entries."""
    return PLANE | {"constraints": f"f: {{relation: y >= 0, {more}}}"} | other


def held(more, **other):
    """Return a block that friction brakes by a bound of these entries."""
    return BLOCK | {"constraints": f"c: {{relation: x_dot = 0, {more}}}"} | other


def acting(event, mode="m: 1", **other):
    """Return an oscillator with a mode that pushes, and an event."""
    given = {"modes": mode, "forces": "x: m", "initial": "x: 1, x_dot: -1"}
    return given | {"events": f"e: {{{event}}}"} | other


SPUN = {
    "frames": "f: {axis: [P, 1, 0], angle: x}",
    "energy": "kinetic: 'spin(vec(1, 2, 3), omega(f))',"
    " potential: 'rotate(f, vec(0, 0, 1)).z'",
}
BODY = "{mass: %s, at: 'vec(x, 0, x^2)', frame: f, inertia: [%s, 2, 3]}"
TURNED = {
    "frames": "f: {axis: [1, 1, 0], angle: x}",
    "energy": "kinetic: bodies, potential: bodies",
}
FALLING = {
    "coordinates": "'q(1..2)': {}",
    "energy": "kinetic: 'sum(i = 1..2, q_dot(i)^2/2)',"
    " potential: 'sum(i = 1..2, 9.81*q(i))'",
    "initial": "'q(1..2)': [0.3, 0.4]",
}

# By place: the sections of the file, the value with which it is compiled, another one.
PLACES = {
    "mass": ({"energy": "kinetic: P*x_dot^2/2, potential: x^2/2"}, 0.7, 1.1),
    "potential": ({"energy": "kinetic: x_dot^2/2, potential: P*x^4"}, 0, 1.1),
    "force": ({"forces": "x: P*sin(3*t)"}, 0, 1.1),
    "definition": ({"definitions": "d: P*x"}, 0, 1.1),
    "start": ({"initial": "x: P, x_dot: 1 - P^2"}, 0, 1.1),
    "start of a definition": (
        {"definitions": "d: 2*x + P", "initial": "x: {guess: 0}, d: 1"}, 0, 1.1,
    ),
    "guess": (
        PLANE | {"constraints": "c: x^2 + y^2 = 1",
                 "initial": "x: 0.6, y: {guess: P}"}, -0.5, 0.9,
    ),
    "equality": (
        PLANE | {"constraints": "c: x^2 + y^2 = P^2",
                 "initial": "x: 0.6, y: {guess: -1}"}, 0.8, 1.1,
    ),
    "time of the equality": (
        PLANE | {"constraints": "c: {relation: y = 0.3, when: t < P}"}, 0.4, 0.8,
    ),
    "gap": (PLANE | {"constraints": "f: {relation: y >= P*x, restitution: 0.5}"},
            -0.2, 0.1),
    "ridge": (
        PLANE | {"constraints":
                 "f: {relation: 'y >= P*abs(x - 0.1)', restitution: 0.5}"}, 0.5, -0.2,
    ),
    "restitution": (floor("restitution: P"), 0, 0.5),
    "restitution of a groove": (
        PLANE | {"constraints":
                 "f: {relation: 'y >= 0.3*abs(x - 0.1)', restitution: P}"}, 0.2, 0.5,
    ),
    "restitution in an expression": (
        floor("restitution: 'P/(1 + approach_speed)'"), 0.2, 0.5,
    ),
    "restitution beside an expression": (
        floor("restitution: P}, w: {relation: x <= 0.8,"
              " restitution: '0.3/(1 + approach_speed)'"), 0.2, 0.5,
    ),
    "restitution of impulses": (
        floor("restitution: P, restitution_law: poisson, friction: 0.2, slip: x_dot"),
        0.2, 0.5,
    ),
    "restitution by a mode": (
        floor("restitution: m", modes="m: 0.3",
              events="e: {at: x >= 0.3, set: {m: P}}"), 0.2, 0.7,
    ),
    "restitution of members": (
        FALLING | {"constraints":
                   "'f(i = 1..2)': {relation: q(i) >= 0, restitution: P/i}"}, 0.9, 0.7,
    ),
    "friction": (floor("restitution: 0.3, friction: P, slip: x_dot"), 0, 0.3),
    "static friction": (
        floor("restitution: 0, friction: {static: P, dynamic: 0.1}, slip: x_dot",
              initial="x: 0, y: 0", forces="x: 4*t"), 0.15, 0.3,
    ),
    "dynamic friction": (
        floor("restitution: 0.3, friction: {static: 0.6, dynamic: P}, slip: x_dot"),
        0, 0.3,
    ),
    "slip": (floor("restitution: 0.3, friction: 0.3, slip: x_dot - P"), 0, 0.3),
    "limit": (held("limit: P"), 0, 0.8),
    "static limit": (held("limit: {static: P, dynamic: 0.5}", **REST), 2.5, 1.8),
    "dynamic limit": (held("limit: {static: 3, dynamic: P}", **REST), 0, 1.8),
    "limit by place": (held("limit: P*f(x + 0.1)", **TABLE), 0.3, 1.2),
    "condition": (acting("at: x <= P, set: {m: -1}"), 0.4, 0.8),
    "act": (acting("at: x <= 0.7, set: {m: P*m}"), 0.4, 0.8),
    "act at the start": (acting("every: 10, set: {m: P}"), 0, 0.8),
    "period": (acting("every: P, set: {m: -m}"), 0.2, 0.3),
    "mode": (acting("at: x <= 0.8, set: {m: 2*m}", mode="m: P"), 0, -0.3),
    "impulse": (acting("at: x <= 0.8, impulse: {x: P}"), 0, -0.3),
    "impulse at the start": (acting("every: 10, impulse: {x: P}"), 0, -0.3),
    "rate": ({"states": "s: {rate: P - s}", "forces": "x: s",
              "initial": "x: 1, s: 0"}, 0, -0.3),
    "steady state": ({"states": "s: {rate: P*x - s}", "forces": "x: s",
                      "initial": "x: 1, s: {steady: 0}"}, 0.2, -0.3),
    "scale of a table": (TABLE | {"forces": "x: P*f(x)"}, 0, 0.7),
    "argument of a table": (TABLE | {"forces": "x: f(t - P)"}, 0.2, 0.3),
    "table as a floor": (
        TABLE | PLANE | {"constraints":
                         "c: {relation: y >= 0.1*P*f(x), restitution: 0.4}"}, -0.2, 1.3,
    ),
    "switch": ({"forces": "x: if(x < P, 2, -1)"}, 0.9, 0.7),
    "switch in time": ({"forces": "x: mod(t, P)"}, 0.43, 0.271),
    "corner": (
        PLANE | {"energy": "kinetic: (x_dot^2 + y_dot^2)/2, potential: 0",
                 "constraints": "c: y = P*abs(x)",
                 "initial": "x: -0.3, y: {guess: 0}, x_dot: 1, y_dot: {guess: 0}"},
        0.5, -0.3,
    ),
    "end": ({"simulation": "duration: 1, until: x <= P"}, 0.9, 0.7),
    "time of the start": (
        {"forces": "x: sin(t)", "simulation": "start: P, duration: 1"}, 0, 0.7,
    ),
    "output step": ({"simulation": "duration: 1, output_step: P"}, 0.1, 0.07),
    "step": ({"simulation": "duration: 1, method: rk4, step: P"}, 0.1, 0.05),
    "start at rest": (
        {"initial": "x: {guess: 0.1}", "forces": "x: P - 0.1*t",
         "simulation": "begin: rest, duration: 1"}, 0, 0.7,
    ),
    "axis": (SPUN, 0.9, 0.7),
    "axis, 0 in the file": (SPUN, 0, 0.7),
    "angle": (
        {"frames": "f: {angle: P + x}", "definitions": "d: 'rotate(f, vec(1, x))'",
         "forces": "d: 'vec(0.3, 0.1)'"}, 0, 0.7,
    ),
    "mass of a body": (
        TURNED | {"gravity": [0, 0, -9.81], "bodies": f"b: {BODY % ('P', 1)}"}, 0.9, 2,
    ),
    "inertia of a body": (
        TURNED | {"gravity": [0, 0, -9.81], "bodies": f"b: {BODY % (1, 'P')}"}, 0.9, 2,
    ),
    "gravity": (
        TURNED | {"gravity": "[0, 0, -P]", "bodies": f"b: {BODY % (1, 1)}"}, 0, 2,
    ),
    "mass of a member": (
        FALLING | {"parameters": "'m(1..2)': [1, P]", "energy":
                   "kinetic: 'sum(i = 1..2, m(i)*q_dot(i)^2/2)',"
                   " potential: '(q(1) - q(2))^2'"}, 0.9, 2,
    ),
    "restitution, moreau": (MOREAU | floor("restitution: P"), 0, 0.5),
    "friction, moreau": (
        MOREAU | floor("restitution: 0.2, friction: P, slip: x_dot"), 0, 0.05,
    ),
    "limit, moreau": (MOREAU | held("limit: P"), 0, 0.8),
}  # fmt: skip


def written(sections, value):
    """Return the text of a file with P of this value."""
    own = {
        "coordinates": "x: {}",
        "energy": "kinetic: x_dot^2/2, potential: x^2/2",
        "initial": "x: 1",
        "simulation": "duration: 1, output_step: 0.1",
    } | sections
    more = own.pop("parameters", "")
    whole = {"parameters": ", ".join(x for x in (f"P: {value}", more) if x), **own}
    return "\n".join(
        f"{key}: {text if key == 'gravity' else f'{{{text}}}'}"
        for key, text in whole.items()
    )


@pytest.mark.parametrize("place", PLACES)
def test_a_swept_value_acts_as_one_in_the_file(place):
    sections, first, second = PLACES[place]
    alone = lagsim.simulate(written(sections, second), error_bar="never")
    model = lagsim.load(written(sections, first))
    swept = lagsim.sweep(model, {"P": [second]}, jobs=1, error_bar="never")
    ends = lagsim.sweep(model, {"P": [second]}, jobs=1, ends=True)
    for name in alone.columns[1:]:
        rows = alone[name]
        own = [rows[-1], np.fmin.reduce(rows), np.fmax.reduce(rows)]
        found = [swept[f"{name}.{x}"][0] for x in ("end", "min", "max")]
        assert np.array_equal(found, own, equal_nan=True), name
        assert np.array_equal(ends[f"{name}.end"], rows[-1:], equal_nan=True), name


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES)
def test_the_value_has_an_effect(place):
    """A place in which no value has an effect would show nothing above."""
    sections, first, second = PLACES[place]
    one, other = (
        lagsim.simulate(written(sections, value), error_bar="never")
        for value in (first, second)
    )
    same = (np.array_equal(one[x], other[x], equal_nan=True) for x in one.columns)
    assert not all(same)
