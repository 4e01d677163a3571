"""q'' and lambda as nodes of the graph: values, digits, and counts of operations.

They are found along chains, by the forces in massless links, or entry by entry; the
expected values come from the equations with M and A written out.
"""

from functools import cache

import mpmath as mp
import numpy as np
import pytest

from lagsim.language.evaluate import evaluate
from lagsim.language.sparse import Budget, TooLongError
from lagsim.mechanics.derivation import derive
from lagsim.mechanics.ldl import Elimination, affordable, factored_mass
from lagsim.mechanics.tensions import accelerations
from lagsim.model.reader import read
from tests.support import run, shipped


def document(coordinates, definitions, kinetic, potential, more="", loss=""):
    names = list(coordinates)
    energy = f"kinetic: {' + '.join(kinetic)}, potential: {' + '.join(potential)}"
    return "\n".join(
        [
            "parameters: {m: 0.7, l: 0.3, g: 9.81, M: 2.0}",
            f"coordinates: {{{', '.join(f'{name}: {{}}' for name in names)}}}",
            "definitions:",
            *(f"  {line}" for line in (*definitions, "far: 0")),
            f"energy: {{{energy}{loss}}}",
            more,
            f"initial: {{{', '.join(f'{name}: {{guess: 0.4}}' for name in names)}}}",
            "simulation: {duration: 0.1, output_step: 0.01}",
        ]
    )


def bodies(
    above,
    *,
    pivot=("0", "0"),
    own=(),
    relative=False,
    energy=("0", "0"),
    loss="",
    masses=(),
    lengths=(),
    more="",
):
    """Return the text of masses on links, link k on the mass above[k - 1] or the pivot.

    Parameters
    ----------
    own
        Coordinates beside the angles.
    relative
        Angles are those between links.
    energy
        Terms added to the kinetic and to the potential energy.
    """
    count = len(above)
    m = [f"{x!r}" for x in map(float, masses)] or ["m"] * count
    lengths_of = [f"{x!r}" for x in map(float, lengths)] or ["l"] * count
    angle = "b" if relative else "a"
    lines, kinetic, potential = [], [], []
    for k, j in enumerate(above, 1):
        if relative:
            lines.append(f"b{k}: {f'b{j} + ' if j else ''}a{k}")
        x, y = (f"x{j}", f"y{j}") if j else pivot
        lines += [
            f"x{k}: {x} + {lengths_of[k - 1]}*sin({angle}{k})",
            f"y{k}: {y} - {lengths_of[k - 1]}*cos({angle}{k})",
        ]
        kinetic.append(f"{m[k - 1]}*(x{k}_dot^2 + y{k}_dot^2)/2")
        potential.append(f"{m[k - 1]}*g*y{k}")
    names = [*own, *(f"a{k + 1}" for k in range(count))]
    kinetic, potential = [*kinetic, energy[0]], [*potential, energy[1]]
    return document(names, lines, kinetic, potential, more, loss)


def chain(n):
    return bodies(range(n))


def tree(seed, n, *, relative=False, closed=False):
    """Return a random tree of masses and wheels on links of a pivot that moves."""
    random = np.random.default_rng(seed)
    above = [0, *(int(random.integers(max(0, k - 4), k)) for k in range(2, n + 1))]
    wheels = (f"0.05*a{k}_dot^2" for k in range(3, n + 1, 3))
    shut = f"constraints: {{shut: x{n}^2 + y{n}^2 = x{n - 1} + 1}}\n" if closed else ""
    return bodies(
        above,
        pivot=("0.2*sin(3*t)", "0.1*cos(2*t)"),
        relative=relative,
        energy=(
            " + ".join((*wheels, f"0.05*x2_dot*y{n}_dot")),
            f"2*((x{n} - x1)^2 + y{n}^2)",
        ),
        loss=f", dissipation: 0.1*(x{n}_dot^2 + a2_dot^2)",
        masses=random.uniform(0.3, 1.0, n),
        lengths=random.uniform(0.3, 1.0, n),
        more=f"{shut}forces: {{x{n - 1}: 1.5*cos(t), a1: 0.3}}",
    )


def in_rows(n, coordinates, definitions, kinetic, potential):
    """Return n equal bodies in a row; K is the number of each, J that of the last."""

    def each(text):
        return [
            text.replace("K", str(k)).replace("J", str(k - 1)) for k in range(1, n + 1)
        ]

    names = [f"{c}{k}" for k in range(1, n + 1) for c in coordinates]
    start = [f"{x.split('K', 1)[0]}0: 0" for x in definitions]
    lines = [
        *start,
        *(x for line in zip(*map(each, definitions), strict=True) for x in line),
    ]
    return document(names, lines, each(kinetic), each(potential))


def in_space(n):
    """Return a chain of masses on links in space, in two angles each."""
    return in_rows(
        n, "uw",
        ["xK: xJ + sin(uK)*cos(wK)", "yK: yJ + sin(uK)*sin(wK)", "zK: zJ + cos(uK)"],
        "(xK_dot^2 + yK_dot^2 + zK_dot^2)/2", "zK",
    )  # fmt: skip


# Masses that hang on each other by massless springs.
SPRINGS = in_rows(
    4, "ra", ["xK: xJ + (l + rK)*sin(aK)", "yK: yJ - (l + rK)*cos(aK)"],
    "m*(xK_dot^2 + yK_dot^2)/2", "m*g*yK + 20*rK^2/2",
)  # fmt: skip
# A chain whose velocities are written by hand: nothing tells its places.
BY_VELOCITIES = in_rows(
    12, "a", ["vxK: vxJ + cos(aK)*aK_dot", "vyK: vyJ + sin(aK)*aK_dot"],
    "(vxK^2 + vyK^2)/2", "(K - 13)*cos(aK)",
)  # fmt: skip
# Pairs of coordinates that do not meet.
COUPLES = in_rows(
    10, "ab", [], "(aK_dot + sin(aK)*bK_dot)^2 + aK_dot^2 + bK_dot^2", "0"
)
LINE = tuple(range(7))
TREE = (0, 1, 1, 2, 2, 2, 4)
DRIVEN = "forces: {x4: 1.5*cos(t), a1: 0.3}"
LOSSES = ", dissipation: 0.1*(x5_dot^2 + a2_dot^2)"
TWISTED = " + ".join(f"2.5*(a{k} - a{k - 1})^2/2" for k in range(2, 8))
# Masses on massless links.
LINKS = {
    "pair": bodies(LINE[:2]),
    "two trees": bodies((*TREE, 0, 8)),
    "cart": bodies(LINE, pivot=("s", "0"), own=("s",), energy=("M*s_dot^2/2", "0")),
    "free": bodies(
        LINE,
        pivot=("s", "h"),
        own=("s", "h"),
        energy=("M*(s_dot^2 + 3*h_dot^2)/2", "M*g*h"),
    ),
    "moving": bodies(
        LINE, pivot=("0.2*sin(3*t)", "0.1*cos(2*t)"), loss=LOSSES, more=DRIVEN
    ),
    "twisted": bodies(LINE, energy=("0", TWISTED)),
    "springs": bodies(LINE, energy=("0", "2*((x7 - x1)^2 + y7^2)")),
    "relative tree": bodies(
        TREE, relative=True, pivot=("0.2*sin(3*t)", "0"), loss=LOSSES, more=DRIVEN
    ),
    "springs in a row": SPRINGS,
    "in space": in_space(4),
}
# Whose M is that of chains.
CHAINS = {
    "tree": tree(1, 24),
    "large tree": tree(2, 32),
    "relative angles": tree(3, 28, relative=True),
    "closed loop": tree(4, 14, closed=True),
    "closed, relative": tree(5, 28, relative=True, closed=True),
    "long in space": in_space(8),
    "chain": chain(20),
    "by velocities": BY_VELOCITIES,
}


@cache
def equations_of(name, *, chained=True):
    return derive(read((LINKS | CHAINS)[name], "links"), chained=chained)


def states(model, number=2):
    """Return random states, which need not satisfy constraints."""
    random = np.random.default_rng(5)
    given = {p.name: p.value for p in model.parameters}
    found = []
    for _ in range(number):
        state = {"t": random.uniform(0, 3)}
        for c in model.coordinates:
            state[c.name] = random.uniform(0.3, 2.8)
            state[f"{c.name}_dot"] = random.normal()
        found.append(given | state)
    return found


def written_out(e, values):
    """Return q'' and lambda from M, A, f and b as numbers, and rounding errors."""
    g, n, m = e.graph, len(e.q), len(e.rows)
    M = np.reshape(evaluate(g, [x for row in e.M for x in row], values), (n, n))
    A = np.reshape(evaluate(g, [x for r in e.rows for x in r.A], values), (m, n))
    right = evaluate(g, [*e.f, *(row.b for row in e.rows)], values)
    whole = np.block([[M, -A.T], [A, np.zeros((m, m))]])
    with mp.workdps(40):
        found = np.array(
            [float(x) for x in mp.lu_solve(mp.matrix(whole.tolist()), mp.matrix(right))]
        )
    # Rounding of the matrix, times its condition: bodies and rows of other units.
    lost = 1e-15 * np.linalg.cond(whole, 1) * np.max(np.abs(found))
    return found, lost


def moving_operations(e, nodes):
    """Return the number of operations of each evaluation."""
    return sum(bool(e.graph.args[k]) for k in e.graph.dependent(nodes, e.moving))


# M with all its entries, of some thirty coordinates.
LONG = {"large tree", "relative angles", "closed, relative"}


@pytest.mark.parametrize(
    "name",
    [pytest.param(x, marks=[pytest.mark.slow] * (x in LONG)) for x in LINKS | CHAINS],
)
def test_motion_is_that_of_the_matrices(name):
    full = equations_of(name, chained=False)
    e = full if name in LINKS else equations_of(name)
    assert (e.chains is not None) == (name in CHAINS)
    q, lam = Elimination(e).motion()
    for values in states(e.model):
        expected, lost = written_out(full, values)
        found = evaluate(e.graph, [*q, *lam], values)
        assert found == pytest.approx(expected, rel=1e-9, abs=lost)
        assert lost < 1e-3 * np.max(np.abs(expected))


@pytest.mark.parametrize("name", LINKS)
def test_tensions_take_fewer_operations(name):
    e = equations_of(name, chained=False)
    found = accelerations(e)
    assert found is not None
    assert Elimination(e).motion()[0] == found
    before = factored_mass(e, Budget()).solve(dict(enumerate(e.f)))
    assert moving_operations(e, found) < 0.85 * moving_operations(e, before.values())


def exact(masses, lengths, a, w):
    """Return the accelerations of a chain by its closed form.

    sum_j S_ij l_i l_j (cos(a_i - a_j) a_j'' + sin(a_i - a_j) a_j'^2) is the torque of
    gravity, -S_ii g l_i sin(a_i), where S_ij is the mass that hangs on both links.
    """
    n = len(masses)
    m, lengths, a, w = ([mp.mpf(float(x)) for x in y] for y in (masses, lengths, a, w))
    below = [mp.fsum(m[k:]) for k in range(n)]
    M, f = mp.matrix(n, n), mp.matrix(n, 1)
    for i in range(n):
        f[i] = -below[i] * mp.mpf(9.81) * lengths[i] * mp.sin(a[i])
        for j in range(n):
            weight = below[max(i, j)] * lengths[i] * lengths[j]
            M[i, j] = weight * mp.cos(a[i] - a[j])
            f[i] -= weight * mp.sin(a[i] - a[j]) * w[j] ** 2
    return list(mp.lu_solve(M, f))


@pytest.mark.parametrize(("n", "orders"), [(7, 0), (7, 3), (20, 0.3)])
def test_each_acceleration_has_nearly_all_digits(n, orders):
    """In line or not, and for masses of other orders: M has a condition of 1e6."""
    random = np.random.default_rng(7)
    masses = 10.0 ** random.uniform(-orders, orders, n)
    lengths = random.uniform(0.3, 1.0, n)
    e = derive(read(bodies(range(n), masses=masses, lengths=lengths), "links"))
    given = {p.name: p.value for p in e.model.parameters}
    elimination = Elimination(e)
    assert elimination.along_links
    nodes = elimination.motion()[0]
    for bend in (1.0, 1e-6, 0.0):
        a, w = 0.7 + bend * random.normal(size=n), random.normal(size=n)
        values = given | dict(zip((*e.q, *e.velocities), (*a, *w), strict=True))
        with mp.workdps(60):
            expected = exact(masses, lengths, a, w)
        largest = max(map(abs, expected))
        for x, y in zip(evaluate(e.graph, nodes, values), expected, strict=True):
            # Some twenty operations a link; in line the others do not move at all.
            assert abs(x - y) < 2e-14 * abs(y) + 1e-30 * largest


@pytest.mark.parametrize(
    ("name", "most"),
    [
        # By hand: six of squares and products of a rod, its pivot and solution, and
        # gravity and forces on each end; 299 in all as books have it.
        ("chain-cartesian", 299),
        # x'^2 + y'^2, x^2 + y^2, the quotient of both with g y: 8; then two forces, g.
        ("pendulum-cartesian", 13),
        ("andrews", 492),
        ("bead-hoop-cartesian", 60),
        # r theta'^2 + g cos - (K/M) u and (- g sin - 2 theta' u')/r, r = l + u: 15 and
        # what M r^2 has as a divisor of its own.
        ("elastic-pendulum", 20),
        ("rolling-disk", 128),
    ],
)
def test_elimination_is_as_short_as_by_hand(name, most):
    e = derive(shipped(name))
    assert moving_operations(e, Elimination(e).motion()[0]) <= most


@pytest.mark.slow
def test_operations_of_a_chain():
    """17 operations for each link, counted on paper.

    A difference of angles, its sine and cosine, a'^2; sin^2, its sum with what the
    pivot behind has beside 1, the pivot, and these two and the cosine over it; the
    right side's product and sum; quotient, product and sum for the tension; two
    products and a sum for a''. Textbooks' elimination, 2 - cos^2/pivot, takes 16.
    """
    counts = []
    for n in (7, 17):
        e = derive(read(chain(n), "links"))
        counts.append(moving_operations(e, Elimination(e).motion()[0]))
    assert counts[1] - counts[0] <= 10 * 17
    assert counts[0] <= 7 * 17


@pytest.mark.slow
def test_operations_grow_as_the_number_of_links():
    found = []
    for n in (50, 100, 200):
        e = derive(read(chain(n), "links"))
        elimination = Elimination(e, 40 * n)
        q, _ = elimination.motion()
        nodes = len(e.graph.cone([*q, e.energy, e.kinetic_form, *e.inertias]))
        found.append((elimination.operations, nodes, len(e.graph)))
        assert "rows" not in vars(e.M)  # n^2 entries were not made
    growth = np.diff(found, axis=0)
    # The first and the last links differ from the others, which are all alike.
    assert np.all(growth[1:] == 2 * growth[:-1])


@pytest.mark.slow
def test_two_hundred_links_keep_their_energy():
    level = chain(200).replace("l: 0.3", "l: 0.005").replace("{guess: 0.4}", "pi/2")
    found = run(read(level, "links"))
    assert found.trajectory.outcome.complete
    assert found.session.plan.tape
    # Let go level, at rest: the energy is 0, and each step is held to 1e-11.
    assert np.max(np.abs(found["energy"])) < 1e-9 * np.max(found["kinetic"])


@pytest.mark.parametrize(
    ("text", "kept"),
    [
        # Links with inertia, a mass that moves, and masses that are nothing.
        (bodies(LINE, energy=("0.2*a3_dot^2", "0")), False),
        (bodies(LINE, energy=("x3_dot*y5_dot", "0")), False),
        (bodies(LINE, energy=("cos(a1)^2*x3_dot^2", "0")), False),
        (bodies(LINE).replace("m: 0.7", "m: 0.0"), False),
        # L names no position whose rate is this sum.
        (bodies(LINE, energy=("(x3_dot + a1)^2 - x3_dot^2", "0")), False),
        (bodies(LINE, more="constraints: {shut: x7 = 1}"), False),
        # Velocities in functions, and of high powers: no sum of squares.
        (bodies(range(20), energy=("cosh(a3_dot)", "0")), False),
        (bodies(range(20), energy=("a3_dot^4", "0")), False),
        (COUPLES, False),
        (bodies(LINE), True),
        (chain(20), True),
    ],
)
def test_what_is_no_chain_of_masses_keeps_its_matrix(text, kept):
    e = derive(read(text, "links"))
    assert (accelerations(e) is not None) == kept
    # Of few links M takes fewer operations.
    assert (e.chains is not None) == (kept and len(e.q) > len(LINE))


def matrices_of_loops(loops):
    """Return `loops` squares side by side, of rods of length and mass 1, on the ground.

    In the points of their joints: neighbours share the masses of rods, so that the
    inverse of M has no zeros.
    """
    joints, bars = range(loops + 1), range(loops)
    kinetic = [f"(x{i}_dot^2 + y{i}_dot^2)/6" for i in joints]
    kinetic += [
        f"({c}{i}_dot^2 + {c}{i}_dot*{c}{i + 1}_dot + {c}{i + 1}_dot^2)/6"
        for i in bars
        for c in "xy"
    ]
    weights = [f"g*y{i}/2" for i in joints]
    weights += [f"g*(y{i} + y{i + 1})/2" for i in bars]
    held = [f"leg{i}: (x{i} - {i})^2 + y{i}^2 = 1" for i in joints]
    held += [f"bar{i}: (x{i + 1} - x{i})^2 + (y{i + 1} - y{i})^2 = 1" for i in bars]
    names = (f"{c}{i}" for i in joints for c in "xy")
    rows = f"constraints: {{{', '.join(held)}}}"
    return document(names, (), kinetic, weights, rows)


@pytest.mark.parametrize("loops", [15, 30])
def test_what_loops_solve_in_less_is_given_up_before_it_is_built(loops):
    """S of N four-bar linkages has no zeros, and its entries sums of up to N terms."""
    e = derive(read(matrices_of_loops(loops), "four-bars.yaml"))
    before = len(e.graph.ops)
    with pytest.raises(TooLongError):
        Elimination(e, affordable(len(e.q), len(e.rows)))
    most = 7 * loops**2  # Z has some 2 N^2 entries, S would take N^3 operations
    assert len(e.graph.ops) - before <= most


@pytest.mark.parametrize("loops", [1, 4])
def test_what_is_counted_beforehand_is_never_more_than_it_takes(loops):
    e = derive(read(matrices_of_loops(loops), "model.yaml"))
    count = Elimination(e).operations
    assert Elimination(e, count).operations == count
    with pytest.raises(TooLongError):
        Elimination(e, count - 1)
