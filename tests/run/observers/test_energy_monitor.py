"""Energies of a run's rows: growth, rates, and the rows before a motion diverges."""

from types import SimpleNamespace

import numpy as np
import pytest

from lagsim.run.observers.monitors import EnergyMonitor, gained

COLUMNS = ("t", "x", "x_dot", "x_ddot", "kinetic", "potential", "energy")
ONE = SimpleNamespace(q="x", state_columns=[0, 1, 2])


def monitor_of(t, **values):
    """Return a monitor of rows at times t (k,); columns without values are 0."""
    rows = np.zeros((len(t), len(COLUMNS)))
    for name, value in ({"t": t, "kinetic": 1.0} | values).items():
        rows[:, COLUMNS.index(name)] = value
    monitor = EnergyMonitor(COLUMNS, ONE)
    monitor.add(rows)
    return monitor


@pytest.mark.parametrize(
    ("balance", "change"),
    [
        (lambda t: 1 + 0 * t, 0.0),
        (lambda t: 1 + 0.1 * np.sin(40 * t), 0.0),
        (lambda t: 1 - 0.01 * t, -0.009),
        (lambda t: np.exp(40 * t), np.exp(40) - 1.0),
        (lambda t: 1 + 0.1 * (np.abs(t - 0.8) < 0.01), 0.0),
        (lambda t: 1 + 0.1 * (t > 0.6), 0.1),
        # At once, before the second row, and never back.
        (lambda t: 1 + 0.1 * (t > 0.0), 0.1),
        # The median of the last tenth, of which 45 % are as at first.
        (lambda t: 1 + 0.2 * (t > 0.945) + 0.3 * (np.abs(t - 0.3) < 0.01), 0.2),
        # More than the first tenth oscillates, and less than the last one does.
        (lambda t: 1 + 0.05 * t + 0.1 * t * np.sin(200 * np.pi * t), 0.045),
        # Less than either tenth oscillates.
        (lambda t: 1 + 0.05 * t + 0.1 * np.sin(200 * np.pi * t), 0.0),
    ],
)
def test_growth_of_the_energy(balance, change):
    t = np.linspace(0.0, 1.0, 401)
    monitor = monitor_of(t, energy=balance(t))
    # By medians of a tenth at either end: a straight line gains 0.9 of its change.
    assert gained(monitor.balance) == pytest.approx(change, rel=0.02, abs=1e-12)


def test_the_rate_of_an_oscillation_is_its_frequency():
    t = np.linspace(0.0, 2.0 * np.pi, 401)
    x = {"x": np.sin(5 * t), "x_dot": 5 * np.cos(5 * t), "x_ddot": -25 * np.sin(5 * t)}
    assert monitor_of(t, **x).fastest_rate == pytest.approx(5.0, rel=1e-2)


@pytest.mark.parametrize(("kinetic", "count"), [(1.0, 301), (2.0, 601), (4.0, 1001)])
def test_states_end_where_the_error_is_a_third_of_the_kinetic_energy(kinetic, count):
    """The energy grows by t from 0 to 1: 0.3 of the kinetic energy is at t = 0.3."""
    t = np.linspace(0.0, 1.0, 1001)
    monitor = monitor_of(t, energy=t, kinetic=kinetic, x=2 * t, x_dot=3 * t, x_ddot=4.0)
    # One row of two is stored at more than 512.
    found = list(monitor.states(10_000))
    step = t[2] - t[0] if len(found) < count else t[1]
    assert found[0][0] == 0.0
    assert (count - 1) * 1e-3 - step < found[-1][0] <= (count - 1) * 1e-3
    for time, (q, v, a, others) in found:
        assert (*q, *v, *a, *others) == (2 * time, 3 * time, 4.0)
    assert len(list(monitor.states(10))) in (9, 10, 11)
