"""The settling of an instant: its page names its phases; what one time has in turn."""

import inspect
import re
from pathlib import Path
from typing import NamedTuple

import pytest

import lagsim
from lagsim.methods.parts.parameters import KEPT
from lagsim.run import arcs, settle
from lagsim.run.events.surface_modes import SurfaceModes
from lagsim.run.modes import ArcModes, Selection

PAGE = (Path(__file__).parents[2] / "docs" / "events.md").read_text(encoding="utf-8")


def test_the_page_names_the_phases_in_the_order_of_the_code():
    rows = re.findall(r"^\| \d(?:, within [^|]*)? \| ([^|]*) \|", PAGE, re.MULTILINE)
    phases = [name for row in rows for name in re.findall(r"`(\w+)`", row)]
    for name in phases:
        assert callable(getattr(settle, name)), name
    text = inspect.getsource(settle.settle)
    text += inspect.getsource(settle.sides_and_velocities)
    found = [x for x in re.findall(r"\b(\w+)\(", text) if x in phases]
    assert set(found) == set(phases)
    source = inspect.getsource(settle)
    places = [source.index(f"def {name}(") for name in phases]
    assert places == sorted(places)


def test_the_page_says_who_writes_each_word_that_an_arc_keeps():
    table = PAGE[PAGE.index("## Who writes each word") :]
    knots = {"knot_times", "knot_modes", "cells_before", "cells_after"}
    assert {name for name in KEPT if f"`{name}`" not in table} <= knots
    assert "`ModeWords`" in table


# A ball that rolls in a corner, a body that sticks and slides in a plane beside a
# switch, a massless slider, a corner of an equality, a mode of the file, and a branch
# of t that depends on it.
ALL_KINDS = """\
modes: {m: 1}
coordinates: {x: {}, y: {}, u: {}, v: {}, z: {}, w: {}, r: {}, s: {}}
energy:
  kinetic: (x_dot^2 + y_dot^2 + u_dot^2 + v_dot^2 + z_dot^2 + r_dot^2 + s_dot^2)/2
  potential: 9.81*y + 2*u^2 + 50*(z - w)^2 + 9.81*s
forces: {u: 0.7*cos(3*t), v: 0.4 - 0.3*sign(v_dot), z: sin(4*t), x: -0.2*sign(x - 0.4),
         y: 0.1*m*sign(sin(7*m*t))}
events: {turn: {every: 0.35, set: {m: -m}}, faster: {at: x >= 0.2, set: {m: 2*m}}}
constraints:
  floor: {relation: y >= 0, restitution: 0.5, friction: 0.3, slip: x_dot}
  wall: {relation: x <= 1, restitution: 0.4}
  plane: {relation: [u_dot = 0, v_dot = 0], limit: 0.2}
  slider: {relation: w_dot = 0, limit: 0.3}
  track: s = abs(r)
initial: {x: 0, y: 0.1, u: 0.5, v: 0, z: 0, w: 0, r: -0.3, x_dot: 1, r_dot: 1,
          s: {guess: 0.3}, s_dot: {guess: -1}}
simulation: {duration: 1.5, output_step: 0.1}
"""


class Watched(NamedTuple):
    """Records of a run of ALL_KINDS."""

    kinds: set
    given: set
    stored: set


@pytest.fixture(scope="module")
def watched():
    """Run ALL_KINDS; modes change within selections of `settle` alone.

    Selections write only words of the record.
    """
    known, found = [], Watched(set(), set(), set())
    own, due, write = settle.settle, settle.due_before, settle.write
    store = SurfaceModes.store

    class Selected(Selection):
        def __init__(self, arc):
            super().__init__(arc)
            assert not known or self.before == known[-1]

        def __exit__(self, *error):
            super().__exit__(*error)
            known.append(ArcModes.of(self.arc))
            p = self.arc.system.p
            found.given.add((*p.file_modes.tolist(), *p.branches.tolist()))

        def undo(self):
            super().undo()
            known.append(ArcModes.of(self.arc))

    def writing(arc, modes):
        write(arc, modes)
        known.append(modes)

    def beginning(now, by):
        known.clear()  # the kernel has changed words in the arc
        return due(now, by)

    def settling(now, by):
        now = own(now, by)
        assert not known or ArcModes.of(now.arc) == known[-1]
        found.kinds.update(e.kind for e in now.events)
        return now

    def storing(modes, **numbers):
        store(modes, **numbers)
        p = modes.p
        first, last = p.place("file_modes"), p.place_after("law_pushes")
        found.stored.update(numbers)
        for name in numbers:
            assert first <= p.place(name) < last, name

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(settle, "Selection", Selected)
        patch.setattr(settle, "write", writing)
        patch.setattr(arcs, "settle", settling)
        patch.setattr(arcs, "due_before", beginning)
        patch.setattr(SurfaceModes, "store", storing)
        lagsim.simulate(ALL_KINDS, error_bar="never")
    return found


def test_only_settle_writes_the_modes_of_an_arc(watched):
    assert watched.kinds == {
        "impact", "slip", "stick", "switch", "corner", "zeno", "event"
    }  # fmt: skip
    assert {m for m, *_ in watched.given} == {-1.0, -2.0, 2.0}
    assert {branch for _, branch in watched.given} >= {-1.0, 1.0}


def test_all_words_that_a_selection_of_sides_stores_are_in_the_record(watched):
    # An error restores them, and another system of the run receives them.
    assert watched.stored >= {"slack", "band", "roundoff", "decisive"}


CORNER = """\
modes: {m: -1, n: 0}
coordinates: {x: {}}
energy: {kinetic: x_dot^2/2, potential: 0}
forces: {x: 2*m}
constraints: {wall: {relation: x <= 1, restitution: 1}}
events:
  struck: {at: x_dot <= 0, set: {n: n + 1}}
  wall_time: {every: 1, set: {m: m + 1}}
  counted: {at: m >= 1, set: {n: 10*n}, once: true}
initial: {x: 0, x_dot: 1}
simulation: {duration: 1.25, output_step: 0.25}
"""


def test_what_meets_at_one_time_follows_in_the_order_of_the_phases():
    # At t = 1 the period of `wall_time` ends and the wall is reached with speed 1.
    # Acts come first, and their rounds; then the impact; then what it makes true.
    result = lagsim.simulate(CORNER, error_bar="never")
    late = [e for e in result.events if e.time > 0.5]
    assert [e.name or e.kind for e in late] == [
        "wall_time", "counted", "impact", "struck",
    ]  # fmt: skip
    assert {e.time for e in late} == {1.0}
    assert result["x_dot"][-1] == pytest.approx(-1.0 + 2 * 0.25, abs=1e-12)


TWO_JUMPS = """\
coordinates: {x: {}, y: {}, z: {}}
energy: {kinetic: (x_dot^2 + y_dot^2 + z_dot^2)/2, potential: 2*z}
constraints:
  track: y = abs(x)
  floor: {relation: z >= 0, restitution: 1}
initial: {x: -1, x_dot: 1, y: {guess: 1}, y_dot: {guess: -1}, z: 1, z_dot: 0}
simulation: {duration: 1.5, output_step: 0.5}
"""


@pytest.mark.parametrize("step", [0.5, 0.4])
def test_all_jumps_of_an_instant_have_two_rows(step):
    # At t = 1 a ball of mass 1 strikes the floor with speed 2, and leaves with 2; a
    # bead stops in the corner of its track. The rows are those before and after both,
    # at the time of an output row and between two of these.
    text = TWO_JUMPS.replace("output_step: 0.5", f"output_step: {step}")
    result = lagsim.simulate(text, error_bar="never")
    at = abs(result.t - 1.0) < 1e-12
    assert result["z_dot"][at] == pytest.approx([-2.0, 2.0], abs=1e-12)
    assert result["x_dot"][at] == pytest.approx([1.0, 0.0], abs=1e-12)
    assert result["impulse.floor"][at] == pytest.approx([0.0, 4.0], abs=1e-12)
