"""The referee of instants against closed forms."""

import numpy as np
import pytest

from tests.hunt.flights import Event, Law, Model, Script, Section
from tests.hunt.instants import var
from tests.hunt.instants_run import Run
from tests.hunt.series import UndecidedError, constant, first_root
from tests.hunt.trees import Table, Tree, number, plus, product

CLOSE = 1e-12


def model(force, *, v=1.0, duration=20.0, q=0.0, **more):
    """Return a unit mass q1 from 0 at speed v under a force."""
    return Model([1.0], [q], [v], [[force]], duration, **more)


def pushed(force, **more):
    """Return w' at the end of w'' = force(q), q = t."""
    made = Model([1.0, 1.0], [0.0, 0.0], [1.0, 0.0], [[], [force]], 20.0, **more)
    return Run(made, 0.5).made().rows[-1][1][3]


def compare(left, sign, right):
    return Tree("compare", (left, number(right) if isinstance(right, float) else right),
                sign)  # fmt: skip


def choice(condition, a, b):
    return Tree("if", (condition, number(a), number(b)))


def mod(x, m):
    return Tree("mod", (x,), m)


Q, V, T = var("q1"), var("v1"), var("t")
STEP = Tree("heaviside", (plus(Q, number(-5.0)),))
LIMIT = plus(number(3.0), product(number(5.0), STEP))
TRIANGLE = Table("tab", [0.0, 1.0, 4.0], [0.0, 3.0, 0.0], "linear", "repeat")
# Pushes of w where q = t, and w' after 20 s, by hand.
PUSHES = [
    (choice(compare(mod(Q, 4.0), "<", 1.0), 3.0, 0.0), 15.0),
    (choice(compare(Q, "<", LIMIT), 1.0, 0.0), 6.0),
    (Tree("table", (mod(Q, 4.0),), TRIANGLE), 5 * 6.0),
    (Tree("abs", (plus(mod(Q, 4.0), number(-2.0)),)), 20.0),
    (Tree("sign", (plus(mod(T, 2.0), number(-0.5)),)), 10.0),
    (Tree("floor", (Tree("min", (mod(Q, 4.0), number(2.5))),)), 5 * (1.0 + 4.0)),
]  # fmt: skip


@pytest.mark.parametrize(("push", "speed"), PUSHES)
def test_nested_switches_push_as_they_should(push, speed):
    assert pushed(push) == pytest.approx(speed, abs=CLOSE)


def test_a_slip_ends_and_is_held_by_the_static_limit():
    bound = choice(compare(Tree("abs", (V,)), ">", 0.0), 1.0, 5.0)
    rub = Law("limit", [1.0], bound=bound)
    run = Run(model(number(0.0), duration=2.0, laws=[rub]), 0.5).made()
    assert run.rows[-1][1] == pytest.approx([0.5, 0.0], abs=CLOSE)
    assert [t for t, _ in run.instants] == pytest.approx([1.0])


def test_a_held_mass_slips_where_the_push_passes_the_bound():
    rub = Law("limit", [1.0], bound=number(1.0), static=number(2.0))
    run = Run(model(T, v=0.0, duration=3.0, laws=[rub]), 0.5).made()
    # From t = 2 on the push is t - 1.
    assert run.rows[-1][1] == pytest.approx([0.5 + 1 / 6, 1.5], abs=CLOSE)


def test_a_motion_slides_along_a_switch_of_the_speed():
    force = plus(number(0.3), product(number(-1.0), Tree("sign", (V,))))
    run = Run(model(force, duration=3.0), 0.5).made()
    assert run.flights.slides == 1
    assert run.rows[-1][1] == pytest.approx([0.5 / 0.7, 0.0], abs=CLOSE)


def test_a_ball_bounces_between_rows_of_a_section():
    wall = Law("contact", [1.0], e=number(0.5))
    cut = Section("s", at=plus(V, number(0.1)))
    made = model(number(-2.0), v=0.0, q=1.0, duration=2.4, laws=[wall], sections=[cut])
    run = Run(made, 0.5).made()
    # It strikes at 1, at speed 2, and at 2, at speed 1; the jumps of v cross v = -0.1.
    assert [t for t, _ in run.instants if _ is False] == pytest.approx(
        [0.05, 1.0, 1.55, 2.0, 2.3]
    )
    crossings = [(t, x[1]) for t, x, _ in run.crossings["s"]]
    assert np.array(crossings) == pytest.approx(
        np.array([[0.05, -0.1], [1, 1], [1.55, -0.1], [2, 0.5], [2.3, -0.1]])
    )


def test_events_of_one_time_act_in_the_order_of_the_file():
    u, n = var("u1"), var("u2")
    events = [
        Event("a", at=compare(Q, ">=", 1.0), sets=[("u1", plus(u, number(1.0)))]),
        Event("b", at=compare(Q, ">=", 1.0), sets=[("u2", product(number(10.0), u))]),
        Event("c", every=0.5, sets=[("u1", product(number(2.0), u))]),
        Event("d", at=compare(n, ">=", 15.0), sets=[("u2", number(-1.0))]),
    ]
    made = model(u, v=0.0, duration=2.0, modes={"u1": 1.0, "u2": 0.0}, events=events)
    run = Run(made, 0.25).made()
    assert [name for _, name in run.events] == ["c", "c", "a", "b", "d", "c", "c", "c"]
    # u = 2 till 0.5, then 4: q = 0.25 + 1 (t - 0.5) + 2 (t - 0.5)^2.
    at = 0.5 + (-1.0 + np.sqrt(1.0 + 8.0 * 0.75)) / 4.0
    assert run.events[2][0] == pytest.approx(at, abs=CLOSE)


def test_what_rounding_decides_is_undecided():
    with pytest.raises(UndecidedError):
        first_root(constant(1.0) - np.eye(19)[1] * 2.0 + np.eye(19)[2], 2.0)
    with pytest.raises(UndecidedError, match="3 ways"):
        # Both sides lead away from q = 0, and rest is possible, too.
        Run(model(Tree("sign", (Q,)), v=0.0), 0.5).made()


def test_a_mass_rests_in_a_kink_of_the_potential_and_on_a_jump_of_the_force():
    kink = model(number(0.3), v=0.0, duration=2.0, potentials=[Tree("abs", (Q,))])
    down = model(product(number(-1.0), Tree("heaviside", (Q,))), v=0.0, duration=2.0)
    for made in (kink, down):
        run = Run(made, 0.5).made()
        assert np.array(run.rows[-1][1]) == pytest.approx(np.zeros(2), abs=CLOSE)
    # Pushed by more than the kink bears: 0.5 of 1.5.
    made = model(number(1.5), v=0.0, duration=2.0, potentials=[Tree("abs", (Q,))])
    assert Run(made, 0.5).made().rows[-1][1] == pytest.approx([1.0, 1.0], abs=CLOSE)


def test_each_way_that_a_model_leaves_open_is_a_motion():
    """At q = 1/2 rounding decides about floor(2 q)."""
    act = Tree("floor", (product(number(2.0), Q),))
    events = [Event("e", at=compare(Q, ">=", 0.5), sets=[("u1", act)])]
    made = model(number(0.0), duration=1.0, modes={"u1": -1.0}, events=events)
    with pytest.raises(UndecidedError):
        Run(made, 0.5).made()
    found, script = set(), Script()
    while script is not None:
        script.asked = 0
        found.add(Run(made, 0.5, script).made().rows[-1][2]["u1"])
        script = script.next()
    assert found == {0.0, 1.0}


def test_events_that_undo_each_other_end_a_motion():
    u = var("u1")
    events = [
        Event("a", at=compare(plus(Q, product(number(3.0), u)), ">=", 1.0),
              sets=[("u1", number(-1.0))]),
        Event("b", at=compare(plus(Q, product(number(3.0), u)), "<=", -1.0),
              sets=[("u1", number(0.0))]),
    ]  # fmt: skip
    run = Run(model(number(0.0), modes={"u1": 0.0}, events=events), 0.5, Script())
    assert run.made().chatters == pytest.approx(1.0, abs=CLOSE)


def test_an_event_that_undoes_another_ends_nothing_if_that_is_not_due_again():
    u = var("u1")
    events = [
        Event("a", at=compare(Q, ">=", 1.0), sets=[("u1", number(1.0))]),
        Event("b", at=compare(u, ">=", 0.5), sets=[("u1", number(0.0))]),
    ]
    made = model(number(0.0), duration=2.0, modes={"u1": 0.0}, events=events)
    run = Run(made, 0.5, Script()).made()
    assert run.chatters is None
    assert [name for _, name in run.events] == ["a", "b"]


def test_a_relation_that_jumps_at_a_time_at_which_a_mode_jumps_back_may_cross():
    """At t = 1 the relation jumps up, itself, and down by the act of the event."""
    u = var("u1")
    step = Tree("heaviside", (plus(plus(Q, u), number(-1.0)),))
    relation = plus(step, number(-0.5))
    events = [
        Event("a", at=compare(step, ">=", 0.5), sets=[("u1", plus(u, number(-3.0)))])
    ]
    made = model(
        number(0.0), duration=2.0, modes={"u1": 0.0}, events=events,
        sections=[Section("s", at=relation)],
    )  # fmt: skip
    found, script = [], Script()
    while script is not None:
        script.asked = 0
        run = Run(made, 0.5, script).made()
        assert [t for t, _ in run.events] == pytest.approx([1.0])
        found.append([t for t, *_ in run.crossings["s"]])
        script = script.next()
    assert sorted(found) == [[], pytest.approx([1.0])]
