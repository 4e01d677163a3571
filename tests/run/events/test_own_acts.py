"""An event's own act does not make its condition true; that of another event does."""

import pytest
import yaml

from tests.support import simulate

CROSSES = {"at": "u + 0.5 = 0", "set": {"u": "-0.75"}}


def acts(events, u=-0.75):
    """Return the events of a point that moves at rate 1, with their times, and u."""
    found = simulate(
        yaml.safe_dump({
            "coordinates": {"x": {}},
            "energy": {"kinetic": "x_dot^2/2", "potential": 0},
            "modes": {"u": u},
            "initial": {"x": 0, "x_dot": 1},
            "events": events,
            "simulation": {"duration": 1, "output_step": 0.25},
        }, sort_keys=False)
    )  # fmt: skip
    assert found.outcome == "done"
    return [(e.name, pytest.approx(e.time)) for e in found.events], found["u"][-1]


@pytest.mark.parametrize(
    ("first", "time"), [({"every": 5}, 0.0), ({"at": "x >= 0.3"}, 0.3)]
)
def test_an_act_through_the_zero_of_its_own_relation_counts_once(first, time):
    # The start and the run alike: `a` moves u through -0.5, and `b` moves it back.
    found = acts({"a": first | {"set": {"u": 0}}, "b": CROSSES}, u=-0.875)
    assert found == ([("a", time), ("b", time)], -0.75)


def test_a_toggle_beside_a_periodic_toggle_acts_once_at_each_of_its_times():
    when = {"e0": {"every": 0.5}, "e1": {"at": "u + 0.5 = 0"}}
    found, u = acts({e: at | {"set": {"u": "1 - u"}} for e, at in when.items()})
    assert found == [(e, t) for t in (0.0, 0.5, 1.0) for e in ("e0", "e1")]
    assert u == -0.75


def test_an_act_of_a_later_event_makes_the_relation_true_again():
    events = {
        "a": {"every": 5, "set": {"u": 0}},
        "b": CROSSES,
        "c": {"at": "u + 0.625 = 0", "once": True, "set": {"u": "-0.25"}},
    }
    # a: -0.875 to 0; b and c together: to -0.75, then to -0.25.
    found, _ = acts(events, u=-0.875)
    assert [name for name, _ in found] == ["a", "b", "c"]
