"""Goldens of motions with impacts, whose times are results."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lagsim.model.reader import read
from lagsim.studies.golden import (
    at_impacts,
    before_impacts,
    judge,
    measure,
    run,
)
from tests.golden.scenes import judged, scene_of, stored
from tests.scenes.contact import scenes
from tests.support import MODELS

IMPACTS = ["bouncing-ball", "slack-string", "newtons-cradle", "rocking-block"]


def changed(name, old, new):
    text = (MODELS / f"{name}.yaml").read_text()
    assert text.count(old) == 1
    return scene_of(read(text.replace(old, new), f"{name}.yaml"))


@pytest.mark.parametrize("name", IMPACTS)
def test_goldens_keep_both_rows_of_impacts(name):
    t = stored(name).rows[:, 0]
    assert 2 <= np.count_nonzero(at_impacts(t)) <= 12
    assert stored(name).horizon is None


@pytest.mark.parametrize("name", IMPACTS)
def test_bounds_of_impacts_do_not_spoil_the_others(name):
    # The tolerance is 1e-11; what hundreds of impacts make of it stays below 1e-7.
    golden = stored(name)
    for column in golden.columns:
        size = max(
            1.0, float(np.max(np.abs(golden.rows[:, golden.columns.index(column)])))
        )
        assert golden.bounds(column)[-1] < 1e-7 * size


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("bouncing-ball", "restitution: 0.8", "restitution: 0.80000001"),
        ("slack-string", "l: {value: 1.0,", "l: {value: 1.00000001,"),
        ("newtons-cradle", "gap: {value: 1e-4", "gap: {value: 1.00001e-4"),
    ],
)  # fmt: skip
def test_a_small_change_is_seen(name, old, new):
    assert not judged(name, changed(name, old, new)).passed


def test_an_impact_that_moves_by_rounding_is_the_same():
    # g off by 1e-15 of itself moves impacts by about that.
    found = changed("bouncing-ball", "value: 9.81,", "value: 9.81*(1 + 1e-15),")
    assert judged("bouncing-ball", found).passed


def shifted(motion, by):
    """Give the motion with each impact `by` later, and nothing else."""
    rows = motion.rows.copy()
    rows[at_impacts(rows[:, 0]), 0] += by
    return replace(motion, rows=rows)


def test_the_time_of_an_impact_is_judged():
    name = "bouncing-ball"
    case = changed(name, "h: {value: 1.0,", "h: {value: 1.0,")
    motion = run(case, stored(name))
    (bound,) = {float(stored(name).bounds("t")[-1])}
    assert judged(name, case, shifted(motion, 0.5 * bound)).passed
    found = judged(name, case, shifted(motion, 2 * bound))
    assert {d.column for d in found.worst if not d.passed} == {"t"}


def test_an_impact_that_is_gone_is_missed():
    name = "bouncing-ball"
    case = changed(name, "h: {value: 1.0,", "h: {value: 1.0,")
    motion = run(case, stored(name))
    gone = replace(motion, rows=motion.rows[~at_impacts(motion.rows[:, 0])])
    assert not judged(name, case, gone).passed


@pytest.mark.parametrize("text", [scenes.sphere(50), scenes.dry(as_limit=True)])
def test_laws_of_every_kind_are_the_same_again(text):
    case = scene_of(read(text, "m.yaml"))
    golden, base = measure(case)
    assert golden.horizon is None
    about = {"output_step": case.settings.output_step, "end": base.trajectory.end}
    found = judge(case, base, replace(golden, about=about))
    assert found.passed
    # What slides has no residual that stays zero; the gap stays above it.
    bounds = [v.bound for k, v in golden.invariants.items() if k.startswith("resid")]
    assert all(bound < 1e-8 for bound in bounds)


def test_twins():
    t = np.array([0.0, 1, 1, 2, 2, 2, 3, 4, 4])
    assert before_impacts(t).tolist() == [k in (1, 7) for k in range(9)]
    assert at_impacts(t).tolist() == [k in (1, 2, 7, 8) for k in range(9)]
    for short in ([], [1.0]):
        assert not at_impacts(np.array(short)).any()
