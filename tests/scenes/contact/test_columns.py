"""Columns of balls that come to rest: accumulations of a group are one accumulation."""

import numpy as np
import pytest

from tests.scenes.contact.motions import GLOBAL, G, contact, play, scene

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
    """Hold a run against what must be: no gap closed by force, and the end."""
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
