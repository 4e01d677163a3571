"""Findings against a run: the rows before a time, and energies without their jumps."""

import numpy as np
import pytest

from lagsim.studies.audit.balances import Balance, without_jumps
from lagsim.studies.audit.finding import up_to
from tests.support import case_of, ready

FREE = """
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: POTENTIAL}
initial: {x: 0, x_dot: 1}
simulation: {start: 2, duration: 3, output_step: 0.25}
"""


def test_a_session_ends_at_the_last_output_time_before_a_time():
    session = ready(FREE.replace("POTENTIAL", "0"))
    for time, end in ((2.6, 2.5), (2.5, 2.25), (2.74, 2.5), (4.99, 4.75), (9.0, 5.0)):
        found = up_to(session, time).case.settings
        assert (found.start, found.end) == (2.0, pytest.approx(end, abs=1e-9)), time


@pytest.mark.parametrize(
    ("potential", "more"),
    [
        # At x = 1/2 and 3/2 by 1.5, at x = 1 by 1.
        ("floor(x) + 1.5*floor(x - 0.5)", 0.0),
        # All by one size: rows may miss some jumps, which are taken as such.
        ("floor(x)", 1.0),
        ("floor(x)", -2.0),
    ],
)
def test_jumps_of_a_potential_are_no_drift_of_the_energy(potential, more):
    """A drift of 0.01 per unit of time beside the jumps; x = t is the motion."""
    e = case_of(FREE.replace("POTENTIAL", potential)).equations
    t = np.array([0.1, 0.3, 0.7, 1.2, 1.8])
    V = np.floor(t) + (1.5 * np.floor(t - 0.5) if "1.5" in potential else 0.0)
    drift = 0.01 * t
    kept = V + drift + more * (t > 0.5)
    rows = np.column_stack([t, t, np.ones(5)])
    balance = Balance(
        [0], (), e.energy, 1.0, 0.0, 1.0, 1.0, None, kept, rows, lambda _: None
    )
    found = without_jumps(e, balance)
    assert found == pytest.approx(kept[0] + drift - drift[0], abs=1e-9)


def test_an_energy_without_jumps_has_none():
    e = case_of(FREE.replace("POTENTIAL", "x^2/2")).equations
    t = np.linspace(0.0, 1.0, 4)
    rows = np.column_stack([t, t, np.ones(4)])
    balance = Balance(
        [0], (), e.energy, 1.0, 0.0, 0.0, 0.0, None, t, rows, lambda _: None
    )
    assert without_jumps(e, balance) is None
