"""Modes of laws (held, sliding, off): closed forms, and the laws, with ties as well."""

import numpy as np
import pytest

from lagsim.mechanics.complementarity import ComplementarityProblem, solve
from lagsim.mechanics.constraints import CONTACT, EQUALITY, LIMITED
from lagsim.mechanics.lemke import rates_at
from lagsim.mechanics.row_modes import modes
from lagsim.mechanics.rows import Mode
from tests.mechanics.contact._bodies import G, broken, closed, none, touching

OFF, HELD, SLIDING, REDUNDANT = Mode
# Of whole numbers below 100, after a few solves with condition numbers below 100.
ROUNDING = 1e-11


def quiet(body, free, rates=None, roundoff=0.0, ahead=None):
    """Return the modes of rows at rest except for some rates, known exactly."""
    r = len(free)
    noise = roundoff + none(r)
    more = [] if ahead is None else [ahead]
    return modes(body, free, none(r) if rates is None else rates, noise, none(r), *more)


def ahead(*values):
    """Rates of accelerations to come, known to 1e-6."""
    return lambda _: (np.array(values), np.full(len(values), 1e-6))


def rod(angle, mu):
    """Return a sliding rod of mass 1 and half-length 1 on its end; x, y, angle."""
    s, c = np.sin(angle), np.cos(angle)
    return touching([1.0, 1.0, 1 / 3], [[0.0, 1.0, -c], [1.0, 0.0, s]], 1, mu=mu)


@pytest.mark.parametrize("weight", [0.0, G])
def test_no_effective_mass_at_all_is_a_paradox(weight):
    body, rates = rod(np.arctan(2.0), 4 / 3), np.array([0.0, -1.0])
    assert quiet(body, np.array([-weight, 0.0]), rates).paradox


def test_a_bound_within_rounding_holds_unless_forces_grow():
    body = touching([1.0, 1.0], [[0, 1], [1, 0]], 1, mu=0.5)
    free = np.array([-10.0, 5.0 + 1e-13])
    # The weight may grow as well: by twice as much as the pull, it holds.
    for weight, mode in ((0.0, SLIDING), (1.9, SLIDING), (2.1, HELD)):
        found = quiet(body, free, roundoff=1e-12, ahead=ahead(-weight, 1.0))
        assert found.mode == (HELD, mode)
    assert quiet(body, free, roundoff=1e-12).mode == (HELD, HELD)


def test_what_is_tied_goes_on_to_bear_where_others_give_way():
    """Two blocks that rub on the ground, the second also on a wall; it is pushed.

    Each of its two rows rests at its bound: the third, of the blocks, takes the rest.
    """
    rows = [[0.0, 1.0], [0.0, 1.0], [-1.0, 1.0], [1.0, 0.0]]
    body = closed([1.0, 1.0], rows, [LIMITED] * 4, mu=1.0)
    growing = ahead(1.0, 1.0, 1.0, 0.0)
    found = quiet(body, np.array([2.5, 2.5, 2.5, 0.0]), ahead=growing)
    assert sorted(found.mode) == [HELD, HELD, REDUNDANT, REDUNDANT]
    assert found.multipliers[0] + found.multipliers[1] + found.multipliers[2] == -2.5


def test_rows_at_a_small_angle_both_hold():
    # 1e-8 apart: a second row of its own, which D alone could not tell.
    rows = [[1.0, 0.0], [1.0, 1e-8]]
    body = closed([1.0, 1.0], rows, [EQUALITY] * 2)
    assert quiet(body, np.array([-1.0, -1.0 - 1e-8])).mode == (HELD, HELD)
    twice = closed([1.0, 1.0], [rows[0], rows[0]], [EQUALITY] * 2)
    found = quiet(twice, np.array([-1.0, -1.0]))
    assert found.mode == (HELD, REDUNDANT)
    assert found.multipliers == pytest.approx([1.0, 0.0])


@pytest.mark.parametrize("angle", [0.0, np.pi / 2, np.pi, 0.7])
def test_a_disc_at_its_bound_slips_where_the_pull_grows(angle):
    """A block of weight 10 with mu = 1/2, pulled by 5 along a direction of the plane.

    The pull grows along this direction, or falls: an axis of the plane has one
    component only.
    """
    along = np.array([np.cos(angle), np.sin(angle)])
    body = touching(np.ones(3), np.eye(3), 2, mu=0.5)
    free = np.array([-10.0, *5.0 * along])
    for growth, mode in ((1.0, SLIDING), (-1.0, HELD)):
        found = quiet(body, free, roundoff=1e-12, ahead=ahead(0.0, *growth * along))
        assert found.mode == (HELD, mode, mode)
        assert found.multipliers == pytest.approx([10.0, *-5.0 * along], abs=1e-11)


@pytest.mark.parametrize("seed", range(8))
def test_rates_of_rows_that_hold_are_zero_to_the_last_bit(seed):
    """The multipliers of k held rows change such that their accelerations stay 0."""
    random = np.random.default_rng(seed)
    k, n = 1 + seed % 4, 6
    rows = random.normal(size=(k, n))
    D, c = rows @ rows.T, random.normal(size=k)
    x, w = rates_at(D, c, none(k), list(range(k)), np.zeros((0, k)))
    assert x == pytest.approx(-np.linalg.solve(D, c), rel=1e-9)
    assert not w.any()


CUBE = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 2 / 3])


@pytest.mark.parametrize(
    "pull",
    [
        # Its weight is 10 and mu 0.5: it rests while |(x, y)| < 5, and does not tilt.
        (0.0, 0.0, 0.0), (3.0, 2.0, 0.0), (4.0, 2.9, 0.0), (-2.0, 4.5, 0.0),
        # Turned about its middle, each leg bears 2.5 and has an arm of sqrt 2.
        (0.0, 0.0, 3.0), (0.0, 0.0, 7.0), (1.0, 1.0, 3.0),
    ],
)  # fmt: skip
def test_a_box_rests_on_four_legs(pull):
    """A cube of side 2, half as high, on its four corners."""
    corners = ((-1, -1, -0.5), (-1, 1, -0.5), (1, -1, -0.5), (1, 1, -0.5))
    axes = np.eye(3)[[2, 0, 1]]
    rows = np.array([[*x, *np.cross(corner, x)] for corner in corners for x in axes])
    body = touching(CUBE, rows, 2, mu=0.5)
    force = np.array([*pull[:2], -10.0, 0.0, 0.0, pull[2]])
    found = quiet(body, rows @ (force / CUBE))
    assert not found.paradox
    assert set(found.mode[::3]) <= {HELD, REDUNDANT}
    assert found.mode.count(HELD) == 6
    assert REDUNDANT in found.mode
    assert rows.T @ found.multipliers == pytest.approx(-force, abs=1e-12)
    p = found.multipliers.reshape(-1, 3)
    assert p[:, 0].min() >= 0.0
    assert (np.hypot(p[:, 1], p[:, 2]) <= 0.5 * p[:, 0] + 1e-12).all()
    for k, mode in enumerate(found.mode):
        if mode is REDUNDANT:
            n = body.table.normals[k]
            bound = 0.5 * found.multipliers[n] if n >= 0 else 0.0
            assert found.multipliers[k] == pytest.approx(found.direction[k] * bound)


@pytest.mark.slow
@pytest.mark.parametrize("inertia", [1.0, 1e-6])
@pytest.mark.parametrize("patches", [2, 4])
@pytest.mark.parametrize("part", [0.3, 0.8, 0.999])
def test_a_slab_rests_up_to_the_sum_of_the_limits(patches, part, inertia):
    """A slab of mass 1 on patches at a circle of radius 1, each with the limit 2.

    A pull through the middle, or a torque about it, is held up to 2 per patch, where
    every patch has to bear the same part, whatever the inertias. Past it the slab
    slides.
    """
    angles = 2.0 * np.pi * np.arange(patches) / patches
    rows = np.array(
        [row for a in angles for row in ([1, 0, -np.sin(a)], [0, 1, np.cos(a)])]
    )
    masses = np.array([1.0, 1.0, inertia])
    pairs = [k ^ 1 for k in range(2 * patches)]
    body = closed(masses, rows, [LIMITED] * 2 * patches, pairs=pairs, mu=2.0)
    for way in ([1.0, 0.0, 0.0], [0.6, -0.8, 0.0], [0.0, 0.0, 1.0]):
        most = 2.0 * patches * np.array(way)
        found = quiet(body, rows @ (part * most / masses), roundoff=1e-9)
        assert set(found.mode) <= {HELD, REDUNDANT}
        held = rows.T @ found.multipliers
        assert held == pytest.approx(-part * most, abs=1e-7)
        sizes = np.hypot(*found.multipliers.reshape(-1, 2).T)
        assert sizes.max() <= 2.0
        # The others bear 2 at most.
        least = 2.0 * (part * patches - (patches - 1))
        assert sizes.min() >= least - 1e-7
        beyond = quiet(body, rows @ (1.01 * most / masses), roundoff=1e-9)
        assert set(beyond.mode) == {SLIDING}


# --- random contacts, each with one slip or none --------------------------------------


def misplaced(body, found, w, rates, slack):
    """Return the rows that violate their modes."""
    rows = []
    for k, (mode, p, n) in enumerate(
        zip(found.mode, found.multipliers, body.table.normals, strict=True)
    ):
        turns = found.direction[k]
        if mode is OFF:
            wrong = p != 0.0
        elif mode is SLIDING:
            against = turns == -np.sign(rates[k]) if rates[k] else turns * w[k] <= slack
            full = abs(p - turns * body.bounds[k] * found.multipliers[n]) <= slack
            wrong = not (against and full)
        else:
            wrong = bool(n >= 0 and rates[k]) or abs(w[k]) > slack
        rows += [k] if wrong else []
    return rows


@pytest.mark.slow
@pytest.mark.parametrize("slips", [0, 1])
def test_laws_hold_on_every_edge(slips):
    """Of small whole numbers, full of ties and of dependent rows."""
    dependent = 0
    for seed in range(200):
        random = np.random.default_rng(seed)
        count, n = random.integers(1, 7), random.integers(2, 8)
        rows = random.integers(-1, 2, size=((1 + slips) * count, n)).astype(float)
        body, rates = touching(np.ones(n), rows, slips, mu=0.5), none(len(rows))
        if slips and seed % 2:
            rates[1::2] = random.integers(-1, 2, size=count)
        free = rows @ random.integers(-3, 4, size=n)
        found = quiet(body, free, rates)
        if found.paradox:
            # One of them has a solution, which pivots find at the third attempt.
            assert rates.any()
            assert seed != 73
            continue
        p = found.multipliers
        w = body.D @ p + free
        # What has a rate slides that way, whatever its acceleration.
        w_then = np.where(rates != 0.0, np.sign(rates), w)
        assert not broken(body, p, w_then, ROUNDING), seed
        assert not misplaced(body, found, w, rates, ROUNDING), seed
        held = [k for k, mode in enumerate(found.mode) if mode is HELD]
        assert not held or np.linalg.matrix_rank(rows[held]) == len(held)
        dependent += REDUNDANT in found.mode
    # The scenes are what they are meant to be.
    assert dependent > 40


@pytest.mark.slow
def test_static_friction_that_is_more_than_dynamic():
    # In two of these scenes what begins to slide would be pushed back at once.
    for seed in [*range(40), 73, 133]:
        random = np.random.default_rng(seed)
        count, n = int(random.integers(2, 4)), int(random.integers(3, 7))
        rows = random.normal(size=(2 * count, n))
        body = touching(np.ones(n), rows, 1, mu=0.2, static=0.6)
        free = rows @ random.normal(size=n)
        found = quiet(body, free)
        w = body.D @ found.multipliers + free
        slides = np.array([mode is SLIDING for mode in found.mode])
        mu = np.where(slides, body.bounds, body.statics)
        assert not broken(body, found.multipliers, w, ROUNDING, mu), seed
        assert not misplaced(body, found, w, none(2 * count), ROUNDING), seed


@pytest.mark.parametrize("over", [0.0, 1e-11, 5e-11])
@pytest.mark.parametrize("slope", [0.979, -1.3])
def test_a_disc_that_only_one_force_on_its_edge_holds(slope, over):
    """Along a rail the admissible friction is a line that touches the disc."""
    most, u = 1.661328, np.array([1.0, slope]) / np.hypot(1.0, slope)
    D = np.outer(u, u) / 0.747
    bounds = np.array([[most, most], [0.0, 0.0]])
    push = -most * (1.0 + over) * D @ u
    one = np.array([-1, -1]), np.array([1, 0])
    found = solve(ComplementarityProblem(D, push, -bounds, bounds, *one))
    assert found.found
    assert D @ found.p + push == pytest.approx(0.0, abs=1e-10)
    # Along the line the distance from the disc grows as a square.
    assert found.p == pytest.approx(most * u, abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [CONTACT, LIMITED, EQUALITY])
def test_the_mode_of_a_single_row_is_that_of_the_row_among_others(kind):
    """Two rows that are not coupled are decided as one problem, one by its closed form.

    Accelerations, bounds and rates are such that all modes and ties occur.
    """
    rng, seen = np.random.default_rng(7), set()
    alone = closed([0.5], [[1.0]], [kind], mu=2.0)
    both = closed([0.5, 0.5], [[1.0, 0.0], [0.0, 1.0]], [kind] * 2, mu=2.0)
    for _ in range(300):
        c = float(rng.choice([-4.0, -2.0, 0.0, 1e-13, 2.0 + 1e-14, 2.0, 3.0, -9.0]))
        rate = float(rng.choice([0.0, 1e-12, -1e-3, 0.2]))
        left, grows = int(rng.integers(3)), float(rng.choice([-1.0, 0.0, 1e-7, 1.0]))
        to_come = ahead(grows) if rng.integers(4) else None

        def doubled(p, grows=grows):
            return ahead(grows, grows)(p)

        arguments = [
            np.array([c]),
            np.array([rate]),
            np.array([1e-12]),
            np.array([1e-9]),
        ]
        found = modes(alone, *arguments, to_come, np.array([left]))
        twice = modes(
            both, *(np.repeat(x, 2) for x in arguments), to_come and doubled,
            np.array([left] * 2),
        )  # fmt: skip
        case = c, rate, left, grows, to_come is None
        assert found.mode[0] is twice.mode[0] is twice.mode[1], case
        assert found.direction[0] == twice.direction[0]
        assert found.multipliers[0] == twice.multipliers[0]
        assert not found.paradox
        seen.add((found.mode[0], bool(found.direction[0])))
    expected = {
        CONTACT: {(OFF, False), (HELD, False)},
        LIMITED: {(HELD, False), (SLIDING, True)},
        EQUALITY: {(HELD, False)},
    }
    assert seen == expected[kind]


@pytest.mark.parametrize("mu", [0.0, 2.0])
@pytest.mark.parametrize("c", [-3.0, 3.0])
def test_a_row_pushed_past_its_limit_slides_against_its_force(c, mu):
    """A mass of 2 whose force is limited to mu, at rest, with the acceleration c."""
    found = quiet(closed([2.0], [[1.0]], [LIMITED], mu=mu), np.array([c]))
    assert found.mode == (SLIDING,)
    assert found.direction[0] == -np.sign(c)
    assert found.multipliers[0] == -np.sign(c) * mu
