"""What the tests of switches share."""

from __future__ import annotations

import pytest


def one_quick(first, *others):
    """Give values for `parametrize`: the first for every run of the tests."""
    many = isinstance(first, tuple)
    slow = pytest.mark.slow
    return [
        first,
        *(pytest.param(*(x if many else (x,)), marks=slow) for x in others),
    ]
