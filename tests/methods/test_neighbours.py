"""Forces of neighbours that nearly cancel: steps follow the motion, not rounding."""

import numpy as np
import pytest

from lagsim.methods.parts.control import pseudorandom
from tests.support import run

MOVING = """
coordinates: {{u(1..n): {{}}}}
parameters: {{n: {n}, c: {c}}}
energy:
  kinetic: "{mass}*sum(i = 1..n, u_dot(i)^2)/2"
  potential: "{mass}*c*({links})/2"
initial: {{u(i = 1..n): "{u}", u_dot(i = 1..n): "{v}"}}
simulation: {{duration: {T}, output_step: {T}/{rows}, method: {method}{more}}}
"""
CHAIN = "sum(i = 1..n-1, (u(i+1) - u(i))^2)"
STRING = f"u(1)^2 + u(n)^2 + {CHAIN}"
BEAM = "sum(i = 2..n-1, (u(i+1) - 2*u(i) + u(i-1))^2)"
# Steps that a motion of this kind takes at most, a few times over: a chain at 200/s has
# waves of 4 rad, of which a Taylor series takes 2 steps, radau 14.
FEW = 30


def motion(
    links, method, n=40, c=1e4, T=0.02, mass=1.0, u="1e-3", v="1e-9*i", more="", rows=1
):
    """Run a lattice; return its run, with its last displacements and velocities."""
    text = MOVING.format(
        links=links, method=method, n=n, c=c, T=T, mass=mass, u=u, v=v, more=more,
        rows=rows,
    )  # fmt: skip
    found = run(text, most_steps=1000)
    names = range(1, n + 1)
    ends = [[found[f"{x}.{i}"] for i in names] for x in ("u", "u_dot")]
    return found, *np.array(ends, dtype=np.longdouble)


def free_modes(n):
    """Modes (n, n) of a chain with free ends, and their frequencies for c = 1."""
    k = np.arange(n, dtype=np.longdouble)
    pi = 4 * np.arctan(np.longdouble(1))
    modes = np.cos(pi * np.outer(k + 0.5, k) / n) * np.sqrt(np.longdouble(2) / n)
    modes[:, 0] /= np.sqrt(np.longdouble(2))
    return modes, 2 * np.sin(pi * k / (2 * n))


def errors(found, u, v, modes, frequencies, c):
    """Largest errors of the last row, against the sum of the modes."""
    t = np.longdouble(found["t"][-1])
    w = np.sqrt(np.longdouble(c)) * frequencies
    a, b = modes.T @ u[:, 0], modes.T @ v[:, 0]
    grown = np.where(w > 0, np.sin(w * t) / np.where(w > 0, w, 1), t)
    exact = modes @ (a * np.cos(w * t) + b * grown)
    rates = modes @ (b * np.cos(w * t) - a * w * np.sin(w * t))
    return np.max(np.abs(u[:, -1] - exact)), np.max(np.abs(v[:, -1] - rates))


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dop853", "taylor", "radau"])
@pytest.mark.parametrize(
    ("u", "v"), [("1e-3", "1e-9*i"), ("1", "1e-7*i"), ("1e6", "1e-3*i")]
)
def test_a_chain_that_begins_to_stretch(method, u, v):
    """Only its ends have a force; rounding inside the chain is no motion."""
    c, size = 1e4, float(u)
    found, places, rates = motion(CHAIN, method, c=c, u=u, v=v)
    assert found.trajectory.statistics.steps < FEW
    off, off_rates = errors(found, places, rates, *free_modes(40), c)
    # What forces are bounded by: 32 roundings of the displacements, for 0.02 s. The
    # estimate of radau, of lower order, may be rtol^(-1/5) tolerances.
    allowed = 32 * 4 * c * 2.0**-53 * size * 0.02
    assert off_rates < allowed * (1e-11**-0.2 if method == "radau" else 1.0)
    assert off < allowed * 0.02 + 32 * 2.0**-53 * size


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dop853", "taylor", "radau"])
@pytest.mark.parametrize(
    ("mass", "u", "more"),
    [
        (1.0, "2.5 + 1e-3*i", ""), (1e-6, "2500 + i", ""),
        (1.0, "1e5 + 1e-3*i", ", start: 1e6"),
    ],
)  # fmt: skip
def test_a_beam_that_turns(method, mass, u, more):
    """A straight free beam has no force: fourth differences are rounding."""
    options = {"mass": mass, "u": u, "v": "1e-6*i", "more": more}
    found, places, rates = motion(BEAM, method, **options)
    assert found.trajectory.statistics.steps < FEW
    # 32 roundings of the displacements, of which a force has 16, for 0.02 s.
    bound = 32 * 16 * 1e4 * 2.0**-53 * np.max(np.abs(places)) * 0.02
    assert np.max(np.abs(rates[:, -1] - rates[:, 0])) < bound


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dop853", "taylor"])
@pytest.mark.parametrize(
    ("n", "T", "rows", "most"),
    [
        (1000, 0.02, 1, 3), (2000, 0.02, 1, 3), (2000, 0.05, 1, 3),
        (1000, 0.02, 1000, 100), (2000, 0.02, 1000, 100),  # a short first step
    ],
)  # fmt: skip
def test_a_long_string_that_begins_to_swing(method, n, T, rows, most):
    """It begins at rest; its forces are 1e-6 of the force of a single link."""
    options = {"n": n, "c": 250, "T": T, "u": "0.1*sin(pi*i/(n+1))", "v": "0"}
    found, places, rates = motion(STRING, method, **options, rows=rows)
    assert found.trajectory.statistics.steps <= most
    w = 2 * np.sqrt(np.longdouble(250)) * np.sin(np.longdouble(np.pi) / (2 * (n + 1)))
    exact = places[:, 0] * np.cos(w * T)
    assert np.max(np.abs(places[:, -1] - exact)) < 32 * 2.0**-53 * 0.1
    exact = -w * places[:, 0] * np.sin(w * T)
    assert np.max(np.abs(rates[:, -1] - exact)) < 32 * 4 * 250 * 2.0**-53 * 0.1 * T


@pytest.mark.parametrize("way", [0, 1])
def test_parts_of_components_have_no_pattern(way):
    """Of 10,000 differences a part d in 1/d is smaller than d, whatever their order."""
    parts = np.array([pseudorandom(i, way) for i in range(10_000)])
    assert np.min(parts) >= 0.0
    assert np.max(parts) < 1.0
    for order in range(5):
        differences = np.abs(np.diff(parts - 0.5, order))
        assert np.mean(differences < 0.01) < 0.03
        assert np.mean(differences < 0.001) < 0.005
