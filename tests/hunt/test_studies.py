"""Studies of random triples of features: each has the numbers of a single run.

`result.at` is held against rows and closed forms, a sweep against single runs, and the
rows against the module that `derive` writes.
"""

import os

import numpy as np
import pytest

import lagsim
from lagsim.language.names import rate_of
from tests.hunt.test_triples import FEATURES, MIXED, drawn
from tests.scenes.pairs.scene import motion, scene
from tests.scenes.pairs.test_physical import BOUND, ROUNDING


def away(times, result):
    """Return the times that are at no event."""
    events = np.array([e.time for e in result.events] or [-1.0])
    return times[np.min(np.abs(times[:, None] - events), axis=1) > 1e-6]


def interpolated(features, result, bound, later):
    """Rows in another order have equal bits; between them the motion is right."""
    rows = np.isin(result.t, away(result.t, result))
    again = result.at(result.t[rows][::-1])
    for name in result.columns:
        np.testing.assert_array_equal(again[name][::-1], result[name][rows], name)
    between = away(result.t[:-1] + 0.37 * np.diff(result.t), result)
    found = result.at(between)
    for name, x in motion(*features, t=between - later).items():
        assert found[name] == pytest.approx(x, abs=bound), name


def swept(model, result):
    """The row of a sweep that has the model's own values is its single run."""
    start = model.initial[0]
    sweep = lagsim.sweep(model, {start.name: [start.value + 1e-3, start.value]}, jobs=1)
    for name in result.columns[1:]:
        column = result[name]
        for end, x in (("end", column[-1]), ("min", min(column)), ("max", max(column))):
            assert sweep[f"{name}.{end}"][1] == x, (name, end)
    assert sweep["complete"][1]
    assert sweep["error"][1] == result.error.relative


def derived(model, result):
    """M q'' = f + Qc of the derived module in the rows between events."""
    module: dict = {}
    exec(lagsim.derive(model).python, module)
    q, states = module["COORDINATES"], module.get("STATES", ())
    for k in np.flatnonzero(np.isin(result.t, away(result.t, result)))[::5]:
        for name in module["PARAMETERS"].keys() & {*result.columns}:  # modes
            module["PARAMETERS"][name] = float(result[name][k])
        groups = [q, [rate_of(x) for x in q], *([states] if states else [])]
        at = [np.array([result[x][k] for x in names]) for names in groups]
        at.insert(0, result.t[k])
        a = np.array([result[rate_of(x, 2)][k] for x in q])
        held = [f"Qc_{x}" for x in q if f"Qc_{x}" in result.columns]
        held = [result[x][k] for x in held]
        right = module["force"](*at) + np.array(held or 0.0)
        left = module["mass_matrix"](*at) @ a
        assert left == pytest.approx(right, abs=1e-9 * max(1.0, np.abs(right).max()))


def studied(features, words):
    """Compare the studies of a scene with its run, see the module."""
    model = lagsim.load(scene(*features, **MIXED, **words))
    result = lagsim.simulate(model)
    later = words.get("later", 0.0)
    size = max(words.get("far", 1), 2 * words.get("speed", 1), later)
    interpolated(features, result, BOUND + ROUNDING * size, later)
    swept(model, result)
    if not any(f.name == "sliding" for f in features):  # forces are as written there
        derived(model, result)


@pytest.mark.slow
@pytest.mark.parametrize("f", FEATURES[-7:], ids=lambda f: f.name)
def test_studies_of_a_feature_beside_two_others(f):
    studied([f, FEATURES[0], FEATURES[6]], {})


@pytest.mark.slow
def test_pauses_do_not_change_the_motion():
    known = {f.name: f for f in FEATURES}
    features = [known[name] for name in ("rheonomic", "smooth", "sliding")]
    studied(features, {"later": 1e4})


@pytest.mark.nightly
@pytest.mark.timeout(7200)
def test_studies_of_a_nights_triples(seed):
    count = int(os.environ.get("HUNT_TRIPLES", "60")) // 3
    for features, words in drawn(seed, count):
        studied(features, words)
