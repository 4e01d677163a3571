"""Random masses, springs and stops against the referee."""

from __future__ import annotations

import numpy as np
import pytest

from tests.scenes.contact import referee
from tests.scenes.contact.motions import play
from tests.support import at_outputs

QUICK, MANY = 3, 24


def agree(seed):
    line = referee.drawn(seed)
    found = play(referee.text(line))
    rows = at_outputs(found.t, 0.0, line.duration / 60)
    motion = referee.Motion(line)
    expected = motion.at(found.t[rows])
    got = np.column_stack([found[f"x{j}"] for j in range(len(line.q))])[rows]
    # Most agree to 1e-12. A swing that comes back to where a stop had let it go touches
    # there within rounding, 1e-14, and with the square root of that as its speed, or
    # does not.
    assert np.max(np.abs(got - expected)) < 1e-6
    early = [t for t in motion.impacts if t < 0.7][:5]
    assert found.instants("impact")[: len(early)] == pytest.approx(early, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(QUICK))
def test_random_lines(seed):
    agree(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(QUICK, MANY))
def test_many_random_lines(seed):
    agree(seed)
