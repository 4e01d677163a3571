"""Scenes of the shipped models, and changes of these."""

import functools
from dataclasses import replace

from lagsim.model.reader import read_file
from lagsim.run.session import open_case
from lagsim.studies.golden import judge, load, run
from tests.support import MODELS, ROOT

GOLDENS = ROOT / "tests" / "golden"


def scene(name, **overrides):
    """Return a shipped model, with parameters set."""
    texts = {k: repr(v) for k, v in overrides.items()}
    return open_case(read_file(str(MODELS / f"{name}.yaml"), texts))


@functools.cache
def stored(name):
    return load(GOLDENS, name)


def judged(name, other, motion=None):
    """Compare a scene, or a motion of it, with the golden of a shipped model."""
    motion = run(other, stored(name)) if motion is None else motion
    return judge(other, motion, stored(name))


def replaced(motion, column, values):
    """Return the motion with another column."""
    rows = motion.rows.copy()
    rows[:, motion.columns.index(column)] = values
    return replace(motion, rows=rows)


def told(judgement):
    """Return a short text on the result of a comparison."""
    worst = judgement.worst[0]
    return f"{worst.column} at {worst.t:.4g}: {worst.ratio:.2g} of its bound"
