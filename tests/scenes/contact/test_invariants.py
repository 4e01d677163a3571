"""Invariants of every row of every scene with one-sided constraints."""

import numpy as np
import pytest

import lagsim
from lagsim.language.names import rate_of
from tests.scenes.contact import scenes
from tests.scenes.contact.motions import play
from tests.scenes.reference import PROBLEMS, model_text
from tests.support import MODELS

# Of the size of a gap, and of a multiplier where a row lies within the tolerance of the
# event that ends the contact.
ROUNDING, AT_AN_EVENT = 1e-12, 1e-9


def one_sided(text):
    """Return the names of the one-sided constraints."""
    return [c.name for c in lagsim.load(text).constraints if c.law is not None]


TEXTS = scenes.EVERY | {
    n: model_text(n) for n, p in PROBLEMS.items() if p["unilateral"]
}
for path in sorted(MODELS.glob("*.yaml")):
    text = path.read_text(encoding="utf-8")
    if "restitution:" in text:
        TEXTS[path.stem] = text
# Half of a second each: a few in the quick suite.
QUICK = {"ball", "sphere that slips", "freewheel"}
EVERY = [
    pytest.param(name, marks=[] if name in QUICK else pytest.mark.slow)
    for name in TEXTS
]
# The largest coefficient of friction of a scene's contacts.
FRICTION = {
    "sphere that slips": 0.2, "sphere that rolls": 0.2, "sphere that bounces": 0.2,
    "steep incline": 0.3, "block uphill": 0.5, "belt": 0.6, "rocking block": 1,
    "slide": 0.3, "runner": 0.3,
}  # fmt: skip

# When a mode ends a contact: the trough holds up the stone until the sling lets it go.
ENDED = {("trebuchet", "trough"): lambda found: found.instants("event")[0]}


def size(values):
    """Return the size of a column; 1 where it consists of rounding only."""
    found = float(np.max(np.abs(values)))
    return found if found > 1e-9 else 1.0


def near(times, events):
    """Return marks of the times that lie within 1e-9 of an event."""
    away = [np.abs(times - e) for e in events]
    return np.min(away, axis=0, initial=np.inf) <= 1e-9 * max(1.0, times[-1])


@pytest.mark.parametrize("name", EVERY)
def test_contacts_push_or_are_open(name):
    found = play(TEXTS[name])
    at_events = near(found.t, [e.time for e in found.result.events])
    names = one_sided(TEXTS[name])
    assert names
    for c in names:
        gap, push = found[f"residual_{c}"], found[f"lambda_{c}"]
        gap, push = gap / size(gap), push / size(push)
        # What a mode has ended binds no longer, and pushes no more.
        ended = found.t > ENDED.get((name, c), lambda _: np.inf)(found)
        assert not np.any(push[ended]), c
        gap = np.where(ended, np.maximum(gap, 0.0), gap)
        assert np.min(gap) >= -ROUNDING, c
        assert np.min(push[~at_events], initial=0.0) >= 0.0, c
        assert np.min(push) >= -AT_AN_EVENT, c
        assert np.max(np.minimum(gap, push)[~at_events], initial=0.0) <= ROUNDING, c


@pytest.mark.parametrize("name", EVERY)
def test_positions_never_jump_and_velocities_only_at_impacts(name):
    found = play(TEXTS[name])
    coordinates = [c.name for c in lagsim.load(TEXTS[name]).coordinates]
    shared = np.flatnonzero(found.shared())
    assert [*found.t[shared]] == found.instants("impact")
    step = np.diff(found.t)
    for q in coordinates:
        x, v, a = found[q], found[rate_of(q)], found[rate_of(q, 2)]
        assert np.max(np.abs(x[shared] - x[shared - 1]), initial=0) <= ROUNDING * size(
            x
        )
        # Accelerations between rows are up to twice those in rows.
        moved = np.abs(np.diff(v)) - 2 * np.max(np.abs(a)) * step
        moved[shared - 1] = 0.0
        assert np.max(moved) <= 1e-9 * size(v)
        gone = np.abs(np.diff(x)) - 2 * np.max(np.abs(v)) * step
        assert np.max(gone) <= 1e-9 * size(x)


@pytest.mark.parametrize("name", EVERY)
def test_the_balance_of_energy_holds_through_impacts(name):
    found = play(TEXTS[name])
    work = found["work"] if "work" in found.result.columns else 0.0
    balance = found["energy"] - work
    scale = max(size(found["energy"]), np.max(found["kinetic"]))
    assert np.ptp(balance) <= 1e-9 * scale


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[] if n in QUICK else pytest.mark.slow) for n in FRICTION],
)
def test_friction_stays_below_its_bound(name):
    found = play(TEXTS[name])
    at_events = near(found.t, [e.time for e in found.result.events])
    for c in one_sided(TEXTS[name]):
        columns = [
            x for x in found.result.columns if x.split(".", 2)[:2] == ["friction", c]
        ]
        assert columns
        along = np.sqrt(sum(found[x] ** 2 for x in columns))
        bound = FRICTION[name] * found[f"lambda_{c}"]
        excess = (along - bound)[~at_events]
        assert np.max(excess) <= ROUNDING * size(bound)
