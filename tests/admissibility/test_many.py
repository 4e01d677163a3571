"""Many starts at once against one by one."""

import numpy as np
import pytest

from lagsim.admissibility.examination import examine
from lagsim.admissibility.refusal import clear_starts, needs_no_solve
from lagsim.errors import InputError
from lagsim.mechanics.derivation import derive
from lagsim.model.reader import read

# M = [[1, c], [c, 1]] is positive for |c| < 1; the force is finite for x > 0.
COUPLED = """\
parameters: {c: 0.5}
coordinates: {x: , y: }
energy: {kinetic: x_dot^2/2 + y_dot^2/2 + c*x_dot*y_dot, potential: sqrt(x) + y^2}
initial: {x: 1, y: 0}
simulation: {duration: 1}
"""
# What is constant in an energy makes no force, and none that is infinite.
PLAIN = COUPLED.replace("c*x_dot", "0*x_dot")
CS = (0.0, 0.5, 0.999, 1.0, -1.0, 2.0, 0.5, 0.5, np.nan)


@pytest.mark.parametrize(
    ("text", "clear"),
    [
        (COUPLED, [0, 1, 2]),
        *[(PLAIN.replace(f"{part}: ", f"{part}: log(c) + "), [1, 2, 3, 5])
          for part in ("potential", "kinetic")],
    ],
)  # fmt: skip
def test_verdicts_are_those_of_each_alone(text, clear):
    model = read(text, "m.yaml")
    equations = derive(model)
    x = np.array([1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, -1.0, 1.0])
    values = {"t": 0.0, "y": 0.0, "x_dot": 0.0, "y_dot": 0.0}
    found = clear_starts(equations, values | {"c": np.array(CS), "x": x}, len(x))
    assert np.flatnonzero(found).tolist() == clear
    for k in range(8):
        bound = equations.of(model.bind(c=CS[k], x=float(x[k])))
        if k in clear:
            assert examine(bound).admissible
        else:
            with pytest.raises(InputError):
                examine(bound)


@pytest.mark.parametrize(
    ("text", "none"),
    [
        (COUPLED, True), (COUPLED + "constraints: {held: x - y = 1}\n", False),
        (COUPLED.replace("y: 0}", "y: {guess: 0}}"), False),
    ],
)  # fmt: skip
def test_what_is_solved_for_is_left_to_each(text, none):
    assert needs_no_solve(derive(read(text, "m.yaml"))) is none
