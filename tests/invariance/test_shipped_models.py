"""Every shipped model elsewhere, moving, in other units, beside others: the same."""

from __future__ import annotations

import functools

import pytest

from tests.invariance.same import CHANGES, differs, known
from tests.invariance.transforms import document
from tests.support import MODELS

SHIPPED = sorted(path.stem for path in MODELS.glob("*.yaml"))
QUICK = [
    ("pendulum-cartesian", "shifted"), ("elastic-pendulum", "boosted"),
    ("elastic-pendulum", "beside-a-planet"), ("dry-friction", "microseconds"),
    ("chaplygin-sleigh", "metres"), ("charged-particle", "later"),
]  # fmt: skip
# The whole motion is the same; a part of it shows that as well.
LONGEST = 500  # rows


@functools.cache
def measured(name):
    model = document((MODELS / f"{name}.yaml").read_text(encoding="utf-8"))
    duration = min(model.duration, LONGEST * model.output_step)
    return known(shorter(model, duration))


def shorter(model, duration):
    from dataclasses import replace

    return replace(model, duration=duration)


def holds(name, change):
    ratio, told = differs(measured(name), CHANGES[change])
    assert ratio < 1.0, told


@pytest.mark.parametrize(("name", "change"), QUICK)
def test_the_same_motion_in_other_words(name, change):
    holds(name, change)


# Of all pairs each twelfth is slow, so that each model and each change comes up, and
# the rest is for the night.
PAIRS = [
    pytest.param(
        name,
        change,
        marks=pytest.mark.nightly if (i + j) % 12 else pytest.mark.slow,
    )
    for i, name in enumerate(SHIPPED)
    for j, change in enumerate(CHANGES)
]


@pytest.mark.parametrize(("name", "change"), PAIRS)
def test_every_model_moves_the_same_in_other_words(name, change):
    holds(name, change)
