"""Files that are derived from others are up to date.

`python -m benchmarks.regenerate` writes the stale ones.
"""

import pytest

from benchmarks import regenerate
from tests.support import ROOT


@pytest.mark.parametrize("name", [one.name for one in regenerate.DERIVED])
@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # as commands do
def test_nothing_is_stale(name):
    (derived,) = (one for one in regenerate.DERIVED if one.name == name)
    stale = [path.relative_to(ROOT).as_posix() for path, _ in derived.stale(False)]
    assert stale == [], f"run `{regenerate.COMMAND} {name}`, and read the difference"
