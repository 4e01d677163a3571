"""Rows between steps where stability, and not accuracy, bounds these.

x'' = -x - (x - z) beside z'' = -(z - x) - k z - c z', of which a mode is fast and has
decayed. The motion is a sum of exponentials; errors are in units of rtol and of the
range of each component.
"""

import mpmath
import numpy as np
import pytest

from lagsim import load, simulate
from lagsim.methods import method, names

SCENE = """
parameters: {c: 1, k: 1}
coordinates: {x: {}, z: {}}
energy: {kinetic: (x_dot^2 + z_dot^2)/2, potential: x^2/2 + (z - x)^2/2 + k*z^2/2}
forces: {z: -c*z_dot}
initial: {x: 1, z: 0}
simulation: {duration: 3, output_step: 0.0117}
"""
UNTIL = SCENE.replace("0.0117", "0.0117, until: x <= 0.3")
COLUMNS = ("x", "z", "x_dot", "z_dot")


def motion_of(A):
    """Return a function of times (k,): exp(A t) (1, 0, 0, 0), to 30 digits, (k, 4)."""
    with mpmath.workdps(30):
        rates, modes = mpmath.eig(mpmath.matrix(A))
        shares = mpmath.lu_solve(modes, mpmath.matrix([1, 0, 0, 0]))

    def motion(times):
        with mpmath.workdps(30):
            grown = (mpmath.diag([mpmath.exp(r * t) for r in rates]) for t in times)
            states = [(modes * g * shares).apply(mpmath.re) for g in grown]
        return np.array([list(x) for x in states], dtype=float)

    return motion


@pytest.mark.parametrize("name", [n for n in names() if method(n).ADAPTIVE])
@pytest.mark.parametrize("rtol", [1e-8, 1e-11])
@pytest.mark.parametrize(("c", "k"), [(200, 0), (20, 1e4), (2000, 0)])
def test_they_err_no_more_than_steps_do(c, k, rtol, name):
    A = [[0, 0, 1, 0], [0, 0, 0, 1], [-2, 1, 0, 0], [1, -1 - k, 0, -c]]
    motion = motion_of(A)
    ranges = np.ptp(motion(np.arange(0.0, 3.0, 0.0117)), axis=0)

    def largest(found):
        rows = np.stack([found[q] for q in COLUMNS], axis=-1)
        return np.abs(rows - motion(found["t"])).max(axis=0) / ranges / rtol

    def moved(text):
        model = load(text).bind(c=c, k=k)
        return simulate(model, method=name, rtol=rtol, error_bar="never")

    result, ended = moved(SCENE), moved(UNTIL)
    bounds = [10, 10, 10, 50]
    assert (largest(result) < bounds).all()
    assert (largest(result.at(np.linspace(0.1, 2.9, 57))) < bounds).all()
    assert (largest({q: ended[q][-1:] for q in ("t", *COLUMNS)}) < bounds).all()
