"""Runs in one memory: each has the bits that it has alone."""

from __future__ import annotations

import numpy as np
import pytest

from lagsim.methods.parts.state import DONE
from lagsim.model.reader import read, read_file
from lagsim.run.ensemble import Ensemble, refusal
from lagsim.run.observers.extremes import Extremes
from lagsim.run.session import Session, open_case
from tests.support import MODELS

# An orbit with next to no angular momentum falls into the centre, by steps of no size.
FALL = """\
parameters: {mu: 1}
coordinates: {r: , phi: }
energy: {kinetic: r_dot^2/2 + r^2*phi_dot^2/2, potential: -mu/r}
initial: {r: 1, phi: 0, phi_dot: 1}
simulation: {duration: 3, output_step: 0.1, rtol: 1e-9, formulation: full}
"""


def opened(model, **options) -> Session:
    settings = model.settings({name: str(x) for name, x in options.items()})
    return open_case(model, settings).ready()


def alone(session, model):
    """Give the last row of a run by itself."""
    case = open_case(model, session.case.settings)
    own = session.bound(case)
    last = Extremes(len(session.system.columns.names))
    return own.run([last]), last.end


def assert_same(session, model, name, values, ends):
    # Starts that follow the parameter in the file stay where they are.
    start = {x.name: repr(x.value) for x in model.initial}
    for k, value in enumerate(values):
        trajectory, row = alone(session, model.bind({name: float(value)}, start))
        assert trajectory.outcome.complete
        assert ends.codes[k] == DONE
        assert np.array_equal(ends.ended[k], row, equal_nan=True)


@pytest.mark.parametrize(
    ("scene", "name", "options"),
    [
        ("elastic-pendulum", "K", {"rtol": 1e-15, "method": "taylor"}),
        ("elastic-pendulum", "K", {"method": "dop853"}),
        ("kepler", "mu", {"rtol": 1e-7, "method": "taylor"}),
        ("kepler", "mu", {"method": "verlet", "step": 0.01}),
        ("double-pendulum", "g", {"output_step": "0.001"}),
        ("elastic-pendulum-forced", "K", {"method": "radau"}),
    ],
)
def test_ends_are_those_of_runs_alone(scene, name, options):
    model = read_file(str(MODELS / f"{scene}.yaml"))
    session = opened(model, duration=6, **options)
    assert refusal(session) == ""
    value = next(p.value for p in model.parameters if p.name == name)
    values = value * np.linspace(0.9, 1.2, 3)
    start = session.case.start
    starts = np.repeat(np.concatenate([start.q, start.v])[None], 3, 0)
    ends = Ensemble(session).ends({name: values}, starts)
    assert_same(session, model, name, values, ends)


def test_a_run_that_fails_is_left_and_disturbs_no_other():
    model = read(FALL, "fall.yaml")
    session = opened(model)
    assert refusal(session) == ""
    spins = np.array([1.0, 0.9, 0.0, 1.1, np.nan, 0.8, 1.05, 0.95, 0.7, 1.2, 0.0, 1.15])
    starts = np.zeros((len(spins), 4))
    starts[:, 0], starts[:, 3] = 1.0, spins
    ends = Ensemble(session).ends({}, starts)
    failed = np.isnan(spins) | (spins == 0.0)
    assert np.array_equal(ends.codes != DONE, failed)
    for k in np.flatnonzero(~failed):
        _, row = alone(session, model.bind(phi_dot=float(spins[k])))
        assert np.array_equal(ends.ended[k], row)
    assert not alone(session, model.bind(phi_dot=0.0))[0].outcome.complete


def test_runs_that_need_more_than_the_kernel_are_refused():
    held = FALL.replace("formulation: full", "until: r = 0.5")
    assert "until" in refusal(opened(read(held, "fall.yaml")))
