"""Columns of balls that come to rest: accumulations of a group are one accumulation."""

import numpy as np
import pytest

from tests.scenes.contact.motions import GLOBAL, G, contact, play, scene
from tests.small_scenes import bounced

# When the last ball rests: by another integrator, with another search and another law
# of accumulation, which agree at three tolerances to the digits given. It dates that
# by the last impact that it sees.
RESTS = {(5, 0.5): 1.28505, (10, 0.5): 1.73998, (5, 0.8): 1.00501}
DATED = 3e-5


def column(count, e, floor=0.0, unit=1.0, beside="", **simulation):
    """Balls of 1 kg and a height of 0.1, dropped at 0.3, 0.55, 0.8, ... above a floor.

    `unit`: metres in the unit of length; `beside`: another coordinate, 1e9 times as
    heavy.
    """
    names = [f"q{k}" for k in range(count)]
    at = [round(0.3 + 0.25 * k, 3) / unit + floor for k in range(count)]
    on = [f"{floor}"] + [f"{q} + {0.1 / unit}" for q in names]
    touching = {
        f"c{k}": contact(f"{q} >= {below}", e)
        for k, (q, below) in enumerate(zip(names, on, strict=False))
    }
    kinetic = " + ".join(f"{q}_dot^2/2" for q in names)
    potential = " + ".join(f"g*{q}" for q in names)
    initial = dict(zip(names, at, strict=True))
    if beside:
        kinetic += f" + 1e9*{beside}_dot^2/2"
        initial |= {beside: 1.0, f"{beside}_dot": 3.0}
    return scene(
        " ".join([*names, *beside.split()]), kinetic, potential, touching, initial,
        parameters={"g": G / unit}, **{"duration": 4, "output_step": 0.02} | simulation,
    )  # fmt: skip


def check(found, count, e, rests, start=0.0, floor=0.0, unit=1.0):
    """Compare a run with its invariants: no gap closed by force, and the end."""
    for k in range(count):
        assert found[f"residual_c{k}"].min() > -1e-9 / unit
    last = max(found.times("zeno"))
    assert last - start == pytest.approx(rests, abs=DATED)
    # The last ball bounces on what rests: a geometric series from each impact on.
    top = f"c{count - 1}"
    (end,) = found.times("zeno", top)
    for event in found.result.events:
        if event.kind == "impact" and event.constraint == top and event.rate_after > 0:
            since = [t for t in found.times("zeno") if t < end]
            if event.time > max(since):
                left = 2 * event.rate_after * unit / (G * (1 - e))
                assert end - event.time == pytest.approx(left, abs=1e-8)
    # Nothing is stopped that moves: what comes to rest was slow before its last impact.
    slow = {}
    for event in found.result.events:
        if event.kind == "impact" and event.rate_before < 0:
            slow[event.constraint] = abs(event.rate_before) * unit
        elif event.kind == "zeno":
            assert slow[event.constraint] < 1e-3, event
    lies = found.t > last + 1e-3
    for k in range(count):
        heights = found[f"q{k}"][lies] - floor
        assert heights == pytest.approx(np.full(lies.sum(), 0.1 * k / unit), abs=1e-9)
    gained = found["energy"] - found["work"]
    assert np.ptp(gained) < 1e-10 * np.ptp(found["energy"]) + 1e-12 * abs(gained[0])


@pytest.mark.slow
@pytest.mark.parametrize(("count", "e"), RESTS)
def test_a_column_comes_to_rest(count, e):
    check(play(column(count, e)), count, e, RESTS[count, e])


@pytest.mark.slow
@pytest.mark.parametrize(
    "told",
    [
        {"floor": 1000.0},
        {"unit": 1e-3},
        {"unit": 1e4},
        {"beside": "z"},
        {"start": 100, "duration": 4},
    ],
    ids=lambda told: next(iter(told)),
)
def test_in_other_words_it_does_so_as_well(told):
    found = play(column(5, 0.5, **told))
    frame = {k: told[k] for k in ("floor", "unit", "start") if k in told}
    check(found, 5, 0.5, RESTS[5, 0.5], **frame)


@pytest.mark.slow
def test_where_it_rests_does_not_depend_on_the_tolerance():
    coarse, fine = (play(column(10, 0.5), rtol=rtol) for rtol in (1e-10, 1e-12))
    ends = [max(found.times("zeno")) for found in (coarse, fine)]
    assert ends[0] == pytest.approx(ends[1], abs=100 * GLOBAL)


# --- What an impact reaches: nothing of other bodies, and all through a shared one


@pytest.mark.slow
def test_balls_on_floors_of_their_own_bounce_as_if_alone():
    names = [f"q{k}" for k in range(12)]
    heights = {q: round(0.4 + 0.05 * k, 2) for k, q in enumerate(names)}
    e = {q: round(0.95 - 0.02 * k, 2) for k, q in enumerate(names)}
    masses = [10.0 ** (k % 4 - 1) for k in range(12)]
    found = play(
        scene(
            " ".join(names),
            " + ".join(f"{m}*{q}_dot^2/2" for m, q in zip(masses, names, strict=True)),
            " + ".join(f"{m}*g*{q}" for m, q in zip(masses, names, strict=True)),
            {f"c{q}": contact(f"{q} >= 0", e[q]) for q in names},
            heights,
            duration=1.3,
            output_step=0.013,
        )
    )
    for q in names:
        expected = bounced(found.t, e[q], heights[q])
        assert found[q] == pytest.approx(expected, abs=GLOBAL)


def plate(*, relative):
    """Five balls above a heavy plate on a spring; heights from the floor or the plate.

    With heights from the plate, M is not diagonal.
    """
    names = [f"q{k}" for k in range(5)]
    top, fast = ("P + ", "P_dot + ") if relative else ("", "")
    gap = "{} >= 0" if relative else "{} >= P"
    return scene(
        " ".join(["P", *names]),
        "500*P_dot^2/2 + " + " + ".join(f"({fast}{q}_dot)^2/2" for q in names),
        "5e5*P^2/2 + 500*g*P + " + " + ".join(f"g*({top}{q})" for q in names),
        {f"c{q}": contact(gap.format(q), 0.9) for q in names},
        {"P": 0.0} | {q: round(0.1 + 0.04 * k, 2) for k, q in enumerate(names)},
        duration=1.3, output_step=0.01,
    )  # fmt: skip


@pytest.mark.slow
def test_balls_share_a_plate_in_any_coordinates():
    above, absolute = (play(plate(relative=x)) for x in (True, False))
    kinds = [(e.kind, e.constraint) for e in above.result.events]
    assert kinds == [(e.kind, e.constraint) for e in absolute.result.events]
    assert len(kinds) > 12
    times = [[e.time for e in x.result.events] for x in (above, absolute)]
    assert times[0] == pytest.approx(times[1], abs=GLOBAL)
    for k in range(5):
        at = above["P"] + above[f"q{k}"]
        assert at == pytest.approx(absolute[f"q{k}"], abs=1e2 * GLOBAL)
