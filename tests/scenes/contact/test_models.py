"""Expectations in the headers of the shipped models with contacts."""

import math

import numpy as np
import pytest

import lagsim
from tests.scenes.contact.motions import G, Motion, play
from tests.support import MODELS


def shipped(name):
    return play((MODELS / f"{name}.yaml").read_text(encoding="utf-8"))


def test_slack_string():
    found = shipped("slack-string")
    assert [e.kind for e in found.result.events] == ["release", "impact", "contact"]
    caught = found.times("impact")[0]
    assert found.pair("x", caught)[1] == pytest.approx(0.0, abs=1e-9)
    assert found.pair("x_dot", caught)[1] == pytest.approx(-1.107361, abs=1e-6)
    before, after = found.pair("energy", caught)
    assert (before + 0.5 * G) / (after + 0.5 * G) == pytest.approx(28, rel=1e-9)
    assert np.min(found["tension"]) >= 0.0


@pytest.mark.slow  # test_release.py has the closed form of it
def test_rocking_block():
    found = shipped("rocking-block")
    listed = [0.599936, 1.517815, 2.277666, 2.927816]
    assert found.instants("impact")[:4] == pytest.approx(listed, abs=1e-6)
    assert found.times("zeno") == pytest.approx([8.690777] * 2, abs=1e-6)
    upright = np.abs(found["th"]) < 1e-9
    assert np.max(np.abs(found["x"][upright])) < 1e-9


@pytest.mark.slow
def test_newtons_cradle():
    found = shipped("newtons-cradle")
    first = found.times("impact")[:4]
    assert first[0] == pytest.approx(0.504459, abs=1e-6)
    assert first[3] - first[0] < 1e-3 / 3
    assert np.max(found["a5"]) == pytest.approx(0.3, abs=2e-6)
    for k in (2, 3, 4):
        assert np.max(np.abs(found[f"a{k}"])) < 1e-3
    assert np.ptp(found["energy"]) < 1e-11


def test_newtons_cradle_without_gaps():
    # One strikes four as one: m v = m u + 4 m w, w - u = v. What touches stays together
    # and costs no more steps than what is apart.
    text = (MODELS / "newtons-cradle.yaml").read_text(encoding="utf-8")
    model = lagsim.load(text, gap=0)
    found = Motion(lagsim.simulate(model, error_bar="never"))
    assert [w.code for w in found.result.warnings] == ["impact-order"]
    v = math.sqrt(2 * G * (1 - math.cos(0.3)))
    first = found.instants("impact")[0]
    rates = [found.pair(f"a{k}_dot", first)[1] for k in range(1, 6)]
    assert rates == pytest.approx([-0.6 * v, *[0.4 * v] * 4], abs=1e-9)
    assert found.result.record["evaluations"] < 5000


@pytest.mark.slow
def test_ball_on_a_vibrating_table():
    found = shipped("ball-on-a-vibrating-table")
    times = np.array(found.times("impact"))
    assert np.diff(times)[-5:] == pytest.approx(np.full(5, 0.1), abs=1e-6)
    phase = times[-1] * 20 * math.pi % (2 * math.pi)
    assert phase == pytest.approx(0.520855, abs=1e-5)
    assert found.pair("y_dot", times[-1])[1] == pytest.approx(0.4905, abs=1e-6)
