"""Signals between the ends of a step, by their values and rates at three looks."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from lagsim.methods.parts.missed import BETWEEN, goes_one_way


def looked_at(coefficients, h):
    u = np.polynomial.Polynomial(coefficients)
    looks = [[u(x), u.deriv()(x)] for x in (0.0, BETWEEN * h, h)]
    names = ("signals_first", "signals_middle", "signals_last")
    return SimpleNamespace(signals=1, **dict(zip(names, looks, strict=True)))


@pytest.mark.parametrize(
    ("coefficients", "one_way"),
    [
        ((1.0, 1.0), True),
        ((-3.0, 1.0, 0.1), True),
        ((3.0, -1.0, 0.1), True),
        ((1.0, -2.0), False),  # passes 0
        ((1.09, -0.6, 1.0), False),  # least at 0.3
        ((1.81, -1.8, 1.0), False),  # least at 0.9
        ((1.0, 0.6, -1.0), False),  # largest at 0.3
        ((1.0, 1.0, -1.2, 1.0), True),  # flattest at 0.4, without a turn
        ((1.0, 0.42, -1.2, 1.0), False),  # turns twice about 0.4
    ],
)
def test_what_rises_or_falls_alone_is_told_from_what_turns(coefficients, one_way):
    for h in (1.0, 0.125):
        scaled = [c / h**k for k, c in enumerate(coefficients)]
        assert goes_one_way(looked_at(scaled, h), 0, h) == one_way
