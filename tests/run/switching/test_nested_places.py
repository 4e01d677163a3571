"""Switches within switches in every place of a model, against their integrals.

The value e(x) of each spelling is periodic and linear on pieces. A body that e slows
down satisfies x_dot^2/2 + I(x) = const, where I is the integral of e; with damping
e*x_dot it satisfies x_dot + I(x) = const, and a state of the rate e*x_dot is I(x).
"""

import numpy as np
import pytest

import lagsim

TABLE = "tables: {v: {points: [[0, 0.1], [0.3, 0.7], [1, 0.1]], outside: hold}}"
# Expression, period, and the pieces: start, value there, value at the end.
SPELLINGS = {
    "if(mod(X, 0.5) < 0.25, 0.2, 0.6)": (0.5, [(0, 0.2, 0.2), (0.25, 0.6, 0.6)]),
    "0.1 + 0.3*floor(mod(2*X, 3))": (
        1.5, [(0, 0.1, 0.1), (0.5, 0.4, 0.4), (1, 0.7, 0.7)],
    ),
    "0.1 + abs(X - floor(X + 0.5))": (1, [(0, 0.1, 0.6), (0.5, 0.6, 0.1)]),
    "v(mod(X, 1))": (1, [(0, 0.1, 0.7), (0.3, 0.7, 0.1)]),
    "0.2 + floor(X) - 2*floor(floor(X)/2)": (2, [(0, 0.2, 0.2), (1, 1.2, 1.2)]),
    "if(mod(X, 2) < 1 + 0.5*heaviside(mod(X, 2) - 1.2), 0.3, 0.8)": (
        2, [(0, 0.3, 0.3), (1, 0.8, 0.8), (1.2, 0.3, 0.3), (1.5, 0.8, 0.8)],
    ),
    "min(mod(X, 1) + 0.1, if(mod(X, 2) < 1, 0.6, 0.2))": (
        2, [(0, 0.1, 0.6), (0.5, 0.6, 0.6), (1, 0.1, 0.2), (1.1, 0.2, 0.2)],
    ),
}  # fmt: skip
BODY = "coordinates: {x: {}}\nenergy: {kinetic: x_dot^2/2, potential: 0}\n"
ON_FLOOR = """\
coordinates: {x: {}, y: {}}
energy: {kinetic: (x_dot^2 + y_dot^2)/2, potential: 10*y}
constraints: {floor: {relation: y >= 0, restitution: 0, friction: E/10, slip: x_dot}}
"""
PLACES = {
    "force": BODY + "forces: {x: -E}\n",
    "limit": BODY + "constraints: {rub: {relation: x_dot = 0, limit: E}}\n",
    "friction": ON_FLOOR,
    "damping": BODY + "forces: {x: -E*x_dot}\n",
    "state": BODY + "states: {s: {rate: E*x_dot}}\nforces: {x: -s}\n",
    "member": """\
coordinates: {q(1..2): {}}
definitions: {x: q(2)}
energy: {kinetic: "sum(i = 1..2, q_dot(i)^2)/2", potential: 0}
forces: {q(i = 1..2): -E}
""",
}


def integral(x, period, pieces):
    """Return the integral (rows,) from 0 to x of a function linear on pieces."""
    turns, u = np.divmod(x, period)
    ends = [*(start for start, *_ in pieces[1:]), period]

    def part(u):
        found = 0.0
        for (start, low, high), end in zip(pieces, ends, strict=True):
            d = np.clip(u - start, 0.0, end - start)
            found = found + low * d + (high - low) * d**2 / 2 / (end - start)
        return found

    return turns * part(np.float64(period)) + part(u)


SLOW = pytest.mark.slow
OTHERS = [
    pytest.param(X, method, marks=SLOW)
    for X, method in ((1e3, ""), (0.0, ", method: dopri5"), (-7.3, ""))
]


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("expression", SPELLINGS)
@pytest.mark.parametrize(("X", "method"), [(0.0, ""), *OTHERS])
def test_a_body_is_slowed_down_by_the_integral(place, expression, X, method):
    own = "q(i)" if place == "member" else "x"
    text = expression.replace("X", f"({own} - ({X!r}))" if X else own)
    names = ("q(1..2)", "q_dot(1..2)") if place == "member" else ("x", "x_dot")
    start = ", s: 0" if place == "state" else ", y: 0" if place == "friction" else ""
    model = PLACES[place].replace("-E*x_dot", f"'-({text})*x_dot'")
    for form in ("-E", "E/10", "E*x_dot", "E"):
        model = model.replace(f": {form}", f": '{form.replace('E', f'({text})')}'", 1)
    model += f"initial: {{{names[0]}: {X!r}, {names[1]}: 2.5{start}}}\n"
    model += f"simulation: {{duration: 2, output_step: 0.05{method}}}\n"
    model += TABLE if "v(" in text else ""
    found = lagsim.simulate(lagsim.load(model), error_bar="never")
    assert found.complete
    columns = ("q.2", "q_dot.2") if place == "member" else ("x", "x_dot")
    x, v = (found[name] for name in columns)
    fallen = integral(x - X, *SPELLINGS[expression])
    lost = {"damping": 2.5 - v, "state": found["s"] if place == "state" else 0.0}
    slowed = lost.get(place, (2.5**2 - v**2) / 2)
    assert slowed == pytest.approx(fallen, abs=1e-9 * max(1.0, abs(X) / 10))
    assert v.min() > 0.1
