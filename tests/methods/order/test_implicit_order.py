"""Orders of implicit methods on stiff motion."""

import numpy as np
import pytest

from tests.methods.order.test_convergence import slope
from tests.support import run

# v' = -L (v - sin t) + cos t: v = sin t (Prothero and Robinson, 1974).
PROTHERO_ROBINSON = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: -1e6*(x_dot - sin(t)) + cos(t)}
initial: {x: -1}
simulation: {duration: 2, output_step: 0.5, method: METHOD, step: 0.1}
"""
SMOOTH = PROTHERO_ROBINSON.replace("1e6", "1")


@pytest.mark.parametrize(
    ("name", "soft", "stiff"), [("gauss4", 4, 2), ("midpoint", 2, 2)]
)
def test_the_order_of_gauss_methods_on_a_stiff_problem(name, soft, stiff):
    for text, order in ((SMOOTH, soft), (PROTHERO_ROBINSON, stiff)):
        steps, errors = [0.125, 0.0625, 0.03125], []
        for h in steps:
            found = run(text.replace("METHOD", name), step=h)
            errors.append(np.max(np.abs(found["x_dot"] - np.sin(found["t"]))))
        assert slope(steps, errors) == pytest.approx(order, abs=0.4)
