"""The Python text of each function of the language, by itself, against its value."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lagsim.language.functions import FUNCTIONS
from lagsim.mechanics.equations import derive
from lagsim.model.reader import read
from lagsim.show.as_python import as_python

# Independent of the table: the standard library's, and definitions.
MEANT = {
    "sin": math.sin, "cos": math.cos, "tan": math.tan, "asin": math.asin,
    "acos": math.acos, "atan": math.atan, "sinh": math.sinh, "cosh": math.cosh,
    "tanh": math.tanh, "asinh": math.asinh, "acosh": math.acosh, "atanh": math.atanh,
    "exp": math.exp, "log": math.log, "log10": math.log10, "sqrt": math.sqrt,
    "cbrt": lambda x: math.copysign(abs(x) ** (1 / 3), x), "abs": abs,
    "sign": lambda x: (x > 0) - (x < 0), "floor": math.floor, "ceil": math.ceil,
    "heaviside": lambda x: float(x >= 0), "atan2": math.atan2, "hypot": math.hypot,
    "min": min, "max": max, "if": lambda c, x, y: x if c else y,
}  # fmt: skip
POINTS = [(-0.7, 0.4), (0.3, -0.8), (0.6, 0.9), (1.7, -2.4), (-2.2, -1.1)]


def test_all_functions_are_here():
    assert set(MEANT) == set(FUNCTIONS)


@pytest.mark.parametrize("name", sorted(MEANT))
def test_a_function_by_itself(name):
    arity = FUNCTIONS[name].arity
    args = {1: "a", 2: "a, b", 3: "a < b, a, b"}[arity]
    text = (
        "coordinates: {x: {}}\nparameters: {a: 1, b: 2}\n"
        "energy: {kinetic: x_dot^2/2, potential: 0}\n"
        f"forces: {{x: 'x + {name}({args})'}}\ninitial: {{x: 1}}\n"
    )
    module = {}
    exec(as_python(derive(read(text, "one.yaml")), "0"), module)
    tried = 0
    for a, b in POINTS:
        values = {1: (a,), 2: (a, b), 3: (a < b, a, b)}[arity]
        try:
            expected = float(MEANT[name](*values))
        except ValueError:
            continue
        module["PARAMETERS"].update(a=a, b=b)
        (found,) = module["force"](0.0, np.array([0.25]), np.array([0.0]))
        assert found - 0.25 == pytest.approx(expected, rel=1e-14, abs=1e-15)
        tried += 1
    assert tried >= 1
