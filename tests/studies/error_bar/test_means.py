"""A repeat takes other steps than the run, or says nothing of its error."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest

from lagsim.model.reader import read
from lagsim.run.error import ErrorBar, Failed
from lagsim.studies import error_bar
from lagsim.studies.alarms import about_error
from lagsim.studies.error_bar import LOOSER, Repeat, by_other_means
from tests.cli.conftest import lagsim  # noqa: F401
from tests.studies.error_bar.test_error_bar import PENDULUM, shipped
from tests.studies.judged import barred, made, repeated

TIGHT = ("1e-13", "2e-14", "1e-14", "5e-15", "2e-15")


@pytest.mark.parametrize("rtol", ["1e-4", "1e-6", "1e-9", "1e-11", *TIGHT])
@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_tolerances_of_repeats_differ(method, rtol):
    session, trajectory, _ = made(
        read(PENDULUM, "m.yaml", options={"method": method, "rtol": rtol})
    )
    ways = list(by_other_means(session, trajectory))
    assert len(ways) >= 2
    for way in ways:
        parts = way.session.plan.rtol / float(rtol), float(rtol) / way.session.plan.rtol
        assert max(parts) >= 0.999 * LOOSER
    # The last cannot take the run's steps, whatever the tolerance makes of them.
    mean = trajectory.end / trajectory.statistics.steps
    assert ways[-1].session.longest_step < 0.5 * mean


@pytest.mark.parametrize("rtol", TIGHT)
@pytest.mark.parametrize(
    "name", ["andrews", "car-axis", "chain-angles", "chain-cartesian"]
)
def test_tight_tolerances_have_an_estimate_by_other_steps(name, rtol):
    model = shipped(name, rtol=rtol)
    bar = barred(model)[1]
    assert isinstance(bar, ErrorBar), bar
    # The errors of two motions by different steps differ by rounding, at least.
    assert 2.0**-52 < bar.relative < 1e-10


@pytest.mark.parametrize("rtol", TIGHT)
def test_chaos_has_a_horizon_at_every_tolerance(rtol):
    """The Lyapunov exponent of about 1/s leaves no digit of rounding after 35 s."""
    bar = barred(shipped("double-pendulum", duration="40", rtol=rtol))[1]
    assert isinstance(bar, ErrorBar)
    assert 20.0 < bar.horizon < 35.0


@pytest.mark.parametrize("method", ["taylor", "dop853", "radau"])
def test_a_run_is_no_repeat_of_itself(method, monkeypatch):
    options = {"method": method, "rtol": "1e-9"}
    session, trajectory, kept = made(read(PENDULUM, "m.yaml", options=options))

    def itself(session, _trajectory):
        yield Repeat(session)

    monkeypatch.setattr(error_bar, "by_other_means", itself)
    bar = repeated(session, trajectory, kept)
    assert isinstance(bar, Failed)
    assert "same steps as the run" in bar


@pytest.mark.parametrize("method", ["rk4", "euler", "verlet", "midpoint", "gauss4"])
def test_fixed_steps_are_repeated_by_others(method):
    options = {"method": method, "step": "0.05"}
    session, trajectory, _ = made(read(PENDULUM, "m.yaml", options=options))
    for way in by_other_means(session, trajectory):
        assert way.session.plan.method != method
        assert way.session.plan.rtol


def test_a_repeat_that_fails_is_a_warning(lagsim, tmp_path, monkeypatch):  # noqa: F811
    """In run.json and on the terminal, with its code; other reasons are none."""
    monkeypatch.setattr(error_bar.Allowance, "steps", lambda *_: 3)
    file = tmp_path / "m.yaml"
    file.write_text("name: swing\n" + PENDULUM)
    called = lagsim("run", file, "--no-plots", "-o", tmp_path / "r")
    assert called.code == 0
    assert "the error of the rows is not known" in called.err + called.out
    record = json.loads((tmp_path / "r" / "run.json").read_text())
    assert [w["code"] for w in record["warnings"]] == ["error-unknown"]
    assert record["error"] is None


def test_what_nobody_asked_for_is_no_warning():
    known = {"plan": SimpleNamespace(rtol=1e-11), "bar": "not asked for"}
    balances = [SimpleNamespace(part=1e-9)]
    assert about_error(SimpleNamespace(equations=0, balances=balances, **known)) == []
