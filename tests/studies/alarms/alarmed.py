"""The alarms of a run, as `lagsim run` raises them."""

from __future__ import annotations

from lagsim.studies.alarms import alarms
from lagsim.studies.attempts import Monitors


def cautions(found, bar="not estimated"):
    """Give the cautions of a finished run."""
    own = Monitors(found.session)
    own.add(found.rows)
    return alarms(own.evidence(found.trajectory, bar))


def codes(found, bar="not estimated"):
    """Give their codes, sorted, without repetition."""
    return sorted({caution.code for caution in cautions(found, bar)})
