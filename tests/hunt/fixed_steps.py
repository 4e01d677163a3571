"""Scenes of instants, contacts and features by methods with fixed steps, and by radau.

Each is run with two steps. The error of the shorter ones is below the distance of both
runs, since a quarter of the step leaves at most a quarter of the error. A run that no
shorter step brings nearer to another is a fault, unless the scene magnifies errors.
"""

from __future__ import annotations

import random
import zlib
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from tests.hunt import hybrid_verdict, instants_verdict
from tests.hunt.contacts import contact_scene
from tests.hunt.features import feature_scene
from tests.hunt.instants import made, written
from tests.hunt.integrator import NoTruthError
from tests.hunt.series import UndecidedError
from tests.hunt.verdict import Verdict, broken

# Not those of order 1, whose bounces end late.
METHODS = (
    "rk4", "verlet", "kahan-li6", "kahan-li8", "gauss4", "midpoint",
    "generalized-alpha", "rattle", "radau",
)  # fmt: skip
SCENES = ("instants", "instants", "contacts", "features")
# The code of a method that does not handle a scene.
REFUSED = "[E402]"
# Rows so near to an instant, in intervals of rows, may be on either side of it.
BESIDE = 0.05
# Steps, in intervals of rows; the last is for motions that are not yet as near.
PARTS, NEAR = (1 / 4, 1 / 16, 1 / 64), 1e-4
# Runs farther apart than this part of the sizes follow no one motion; a scene that
# magnifies errors by more than this factor may be to blame.
UNSETTLED, MAGNIFIED = 1e-2, 30.0


def tried(seed, lagsim, *options):
    """Run the scene of a seed by methods with fixed steps; return file and verdict."""
    r = random.Random(zlib.crc32(f"fixed steps {seed}".encode()))
    kind, methods = r.choice(SCENES), r.sample(METHODS, len(METHODS))
    runs = Runs(lagsim, methods, options)
    if kind == "instants":
        model = made(seed)
        text = written(model)
        try:
            ways = instants_verdict.truths(model)
        except UndecidedError as fault:
            return text, Verdict("uncounted", str(fault))
        return text, by_instants(text, ways, runs)
    told = contact_scene(seed).told() if kind == "contacts" else feature_scene(seed)
    try:
        truth = hybrid_verdict.truth(told)
    except (NoTruthError, np.linalg.LinAlgError) as fault:
        return told.text, Verdict("uncounted", str(fault))
    return told.text, by_hybrid(told, truth, runs)


def by_instants(text, ways, runs):
    """Return the verdict on a model of instants whose motions are known."""
    one = ways[0]
    if one.first.chatters is not None:
        return Verdict("uncounted", "events undo each other")
    magnified = max(np.max(x.known / x.size) for x in ways) / instants_verdict.NUDGE
    clear = away(one.times, one.first.instants and np.array(one.first.instants)[:, 0])

    def judged(answer, apart):
        found = [x if apart is None else x.permitting(apart * x.size) for x in ways]
        return instants_verdict.judged_by(found, runs.lagsim, answer)

    return runs.verdict(
        text, one.made.step * one.made.words.time,
        lambda x: instants_verdict.states(one, x)[clear] / one.size, magnified, judged,
    )  # fmt: skip


def by_hybrid(told, truth, runs):
    """Return the verdict on a scene of contacts or features whose motion is known."""
    path, known, size = truth
    times = np.array([row[0] for row in path.rows])
    clear = away(times, [*path.impacts, *(t for t, _, _ in path.events)])

    def judged(answer, apart):
        return hybrid_verdict.judged(
            told, runs.lagsim, answer, *truth, 0.0 if apart is None else apart
        )

    return runs.verdict(
        told.text, (told.times[1] - told.times[0]) / told.scale,
        lambda x: hybrid_verdict.states(told, path, x)[clear] / size,
        np.max(known) / hybrid_verdict.NUDGE, judged,
    )  # fmt: skip


def away(times, instants):
    """Return a mask of the rows that lie on one side of each instant in both runs.

    The last row may be the located end.
    """
    near = BESIDE * (times[1] - times[0]) if len(times) > 1 else 0.0
    turns = np.array([*instants, np.inf])
    found = np.min(np.abs(times[:, None] - turns), axis=1) > near
    found[-1] = False
    return found


class Runs(NamedTuple):
    """Runs of a scene by the first method of a list that can integrate it."""

    lagsim: Any
    methods: list[str]
    options: tuple[str, ...]

    def verdict(self, text, step, states, magnified, judged):
        """Return the verdict on runs with ever shorter steps.

        step : the interval of rows
        states : run -> (rows, columns), in sizes
        magnified : how many times errors grow
        judged : run and permitted error, in sizes -> verdict
        """
        before, apart = None, np.inf
        for part in PARTS:
            method, answer = self._run(text, part * step)
            found = broken(answer)
            if found is None and method == "radau":
                found = judged(answer, None)
            if found is not None:
                return _of(method, found)
            now = states(answer)
            if before is not None and before.shape == now.shape:
                apart = np.max(np.abs(now - before), initial=0.0)
            if apart < NEAR:
                break
            before = now
        if not apart < UNSETTLED:
            kind = "uncounted" if magnified > MAGNIFIED else "unsettled"
            return _of(method, Verdict(kind, f"runs are {apart:.1e} apart"))
        return _of(method, judged(answer, apart))

    def _run(self, text, step):
        for method in self.methods:
            steps = () if method == "radau" else ("--step", repr(step))
            answer = self.lagsim.run(text, *self.options, "--method", method, *steps)
            if REFUSED not in answer.told:
                break
        return method, answer


def _of(method, found):
    return replace(found, text=f"{method}: {found.text}")
