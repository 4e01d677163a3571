"""What Python does around a run: counted, since for short runs it is what they take."""

from __future__ import annotations

import sys

import pytest

from tests.support import ready


def calls_of(function):
    """Count the functions that are called, in Python and by name of it."""
    count = 0

    def note(_frame, kind, _what):
        nonlocal count
        count += kind in ("call", "c_call")

    sys.setprofile(note)
    try:
        function()
    finally:
        sys.setprofile(None)
    return count


# Some quarter of a microsecond each; a tenth more than they were counted as.
@pytest.mark.parametrize(
    ("name", "most"), [("elastic-pendulum", 245), ("pendulum-cartesian", 270)]
)
def test_a_run_of_a_few_steps_calls_few_functions(name, most):
    session = ready(name, duration="1e-3", output_step="1e-3")
    session.run([])  # what is found out once
    assert 50 < calls_of(lambda: session.run([])) <= most
