"""lagsim against the hybrid referee, on random scenes of the features of larger files.

HUNT_SEED and HUNT_FEATURES (60) choose what a night tries, HUNT_FOLDER its failures.
A scene takes about a second of one core.
"""

import os

import numpy as np
import pytest

from tests.hunt.feature_verdict import tried
from tests.hunt.features import feature_scene
from tests.hunt.hybrid import Equations, Hybrid, Law, Plain
from tests.hunt.test_hunt import folder, lagsim, seed  # noqa: F401

BALL = {
    "coordinates": {"x": {}, "y": {}}, "initial": {"x": 0, "x_dot": 3, "y": 1},
    "energy": {"kinetic": "x_dot^2 + y_dot^2", "potential": "2*9.81*y"},
}  # fmt: skip


def path(document, laws=(), end=2.0, **more):
    scene = Plain(document, tuple(laws), **more)
    return Hybrid(Equations(scene)).path(0.0, [0.0, end])


def hunted(seed, count, lagsim, folder):  # noqa: F811
    """Try scenes; write those that fail; give the kinds and what is to be said."""
    kinds, told = [], []
    for k in range(count):
        scene = feature_scene(f"{seed}-{k}")
        verdict = tried(scene, lagsim)
        kinds.append(verdict.kind)
        if verdict.is_fault:
            folder.mkdir(parents=True, exist_ok=True)
            place = folder / f"{seed}-{k}.yaml"
            place.write_text(scene.text, encoding="utf-8")
            told.append(f"{place}: {verdict.kind}\n  {verdict.text}")
    return kinds, "\n".join(told)


@pytest.mark.slow
def test_the_referee_knows_bounces_friction_and_rest():
    laws = [Law("contact", "y", e="0.5"), Law("slip", "x_dot", mu="0.1", normal=0)]
    found = path(BALL, laws, end=3.0)
    times = (2 / 9.81) ** 0.5 * (1 + 2 * (1 - 0.5 ** np.arange(4)))
    assert found.impacts[:4] == pytest.approx(times, abs=1e-10)
    # Once it lies the floor has pushed as much as its weight, and a tenth along.
    assert found.rows[-1][1][1:] == pytest.approx([0, 3 - 0.981 * 3, 0], abs=1e-6)


@pytest.mark.slow
def test_the_referee_knows_tables_and_events():
    document = {
        "coordinates": {"x": {}}, "initial": {"x": 0}, "modes": {"u": 1},
        "energy": {"kinetic": "x_dot^2/2", "potential": "0"}, "forces": {"x": "u*f(t)"},
    }  # fmt: skip
    events = {"off": {"at": "x >= 1/6", "set": {"u": "0"}}}
    tables = {"f": ([0, 1], [0, 1], "linear", "extend")}
    found = path(document, tables=tables, events=events)
    # x = t^3/6 up to t = 1, and straight on from there.
    assert found.events[0][0] == pytest.approx(1.0, abs=1e-12)
    assert found.rows[-1][1] == pytest.approx([1 / 6 + 0.5, 0.5], abs=1e-11)


@pytest.mark.slow
def test_a_few_features_hold(lagsim, folder):  # noqa: F811
    _, told = hunted("few", 5, lagsim, folder)
    assert not told, told


@pytest.mark.nightly
@pytest.mark.timeout(7200)
def test_a_nights_features_hold(lagsim, folder, seed):  # noqa: F811
    count = int(os.environ.get("HUNT_FEATURES", "60"))
    kinds, told = hunted(seed, count, lagsim, folder)
    assert not told, f"seed {seed}\n{told}"
    assert kinds.count("fine") > len(kinds) / 2
