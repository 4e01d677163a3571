"""Mechanisms: each adds coordinates, energies and constraints that belong together."""

from __future__ import annotations

import itertools
import math

from tests.hunt.maker import Numbers, Point, distance, short, squares, weight

AXES = "xyz"


def free_point(k, place, speed, mass):
    """Add a point mass with a coordinate for each component."""
    n = Numbers(k)
    tail = next(k.count)
    names = tuple(f"{axis}{tail}" for axis in AXES[: len(place)])
    m = n("m", mass)
    k.add(
        "point", parameters=n,
        coordinates={q: (x, v) for q, x, v in zip(names, place, speed, strict=True)},
        kinetic=(f"{m}*({squares(*(f'{q}_dot' for q in names))})/2",),
    )  # fmt: skip
    point = Point(names, mass, place)
    k.points.append(point)
    k.pushed += [(q, mass * k.gravity) for q in names]
    return point


def anchor(place):
    return Point(tuple(repr(x) for x in place), math.inf, place)


def somewhere(k, dimensions, size=1.0):
    return tuple(
        k.offset + k.signed(0.2, 1.5, size * k.length) for _ in range(dimensions)
    )


def some_velocity(k, dimensions):
    if k.chance(0.3):
        return (0.0,) * dimensions
    return tuple(k.signed(0.1, 1, k.speed) for _ in range(dimensions))


def stiffness(k, a, b, low=0.5, high=8):
    """Return a stiffness whose frequency suits the scene."""
    reduced = 1.0 / (1.0 / a.mass + (0.0 if math.isinf(b.mass) else 1.0 / b.mass))
    return short(reduced * k.between(low, high, 1 / k.time) ** 2)


def spring(k, a, b):
    """Add a spring between two points: linear, with a rest length, or cubic."""
    n = Numbers(k)
    K = n("K", stiffness(k, a, b))
    text, d = distance(a, b)
    straight = (
        "(" + squares(*(f"({x} - {y})" for x, y in zip(a.at, b.at, strict=True))) + ")"
    )
    kind = k.one_of("plain", "length", "duffing")
    if kind == "plain" or len(a.at) == 1:
        energy = f"{K}*{straight}/2"
        if kind == "duffing":
            energy += f" + {K}*{straight}^2/(4*{n('d', d * d)})"
    elif kind == "length":
        energy = f"{K}*({text} - {n('l', short(d * k.between(0.5, 1.2)))})^2/2"
    else:
        energy = f"{K}*{straight}^2/(4*{n('d', d * d)})"
    k.add(f"spring-{kind}", parameters=n, potential=(energy,))


def points_and_springs(k):
    d = k.one_of(1, 2, 2, 3)
    count = k.one_of(1, 2, 2, 3)
    made = [
        free_point(k, somewhere(k, d), some_velocity(k, d), k.some_mass())
        for _ in range(count)
    ]
    spring(k, made[0], anchor(somewhere(k, d, 0.3)))
    for a, b in itertools.pairwise(made):
        spring(k, a, b)
    if d == 1:
        k.sliders += [(p.at[0], p.mass, 0.0) for p in made]


def unequal_masses(k):
    """Bodies whose masses differ by up to twelve decades, bound by springs."""
    d = k.one_of(1, 2)
    masses = [k.mass, k.decades(-6, 6, k.mass), k.decades(-6, 6, k.mass)]
    made = [free_point(k, somewhere(k, d), some_velocity(k, d), m) for m in masses]
    for a, b in itertools.pairwise(made):
        spring(k, a, b)
    if k.chance(0.5):
        spring(k, made[0], anchor(somewhere(k, d, 0.3)))


def gravitating(k):
    """A sun, a planet or two, a probe: masses over many decades."""
    n = Numbers(k)
    sun = k.mass * 1e6
    G = n("G", short(k.length**3 / (sun * k.time**2)))
    bodies = [free_point(k, (k.offset, k.offset), (0.0, 0.0), sun)]
    for i in range(k.one_of(1, 2, 2)):
        r = k.length * k.between(0.7, 1.3) * 2.2**i
        turn, sense = k.between(0, 6.28), k.one_of(-1, 1)
        v = sense * k.between(0.8, 1.15) * math.sqrt(n[G] * sun / r)
        mass = k.decades(-9, -2, sun)
        place = (r * math.cos(turn) + k.offset, r * math.sin(turn) + k.offset)
        speed = (-v * math.sin(turn), v * math.cos(turn))
        bodies.append(free_point(k, place, speed, mass))
    terms = []
    for i, a in enumerate(bodies):
        for b in bodies[:i]:
            text, _ = distance(a, b)
            terms.append(f"-{G}*{_mass(k, a)}*{_mass(k, b)}/{text}")
    k.add("gravity", parameters=n, potential=tuple(terms))


def _mass(k, point):
    for item in k.items:
        if point.at[0] in item.coordinates:
            return next(name for name in item.parameters if name.startswith("m"))
    raise KeyError(point.at[0])


def rods(k):
    """Points on rods: a pendulum of one to three, or a free figure, in 2 or 3-D."""
    d, hangs = k.one_of(2, 2, 3), k.chance(0.6)
    n = Numbers(k)
    last = anchor((k.offset,) * d) if hangs else None
    boost = () if hangs else tuple(k.signed(0, 3, k.speed) for _ in range(d))
    for _ in range(k.one_of(1, 2, 2, 3) + (not hangs)):
        base = last.place if last else (k.offset,) * d
        place = tuple(x + k.signed(0.2, 0.8, k.length) for x in base)
        speed = some_velocity(k, d)
        if boost:
            speed = tuple(x + v for x, v in zip(speed, boost, strict=True))
        point = free_point(k, place, speed, k.some_mass())
        if last:
            _rod(k, last, point)
        last = point
    if hangs or k.chance(0.5):
        g = n("g", k.between(0.5, 5, k.gravity))
        heights = tuple(f"{_mass(k, p)}*{g}*{p.at[-1]}" for p in k.points)
        for height in heights:
            k.add("weight", parameters=n, potential=(height,))


def _rod(k, a, b):
    n = Numbers(k)
    steps = [f"({x} - {y})" for x, y in zip(b.at, a.at, strict=True)]
    l = n("l", math.dist(a.place, b.place))  # noqa: E741
    k.add(
        "rod", parameters=n, constraints={k.name("rod"): f"{squares(*steps)} = {l}^2"}
    )


def bead(k):
    """A bead on a curve in the plane, or on a surface in space; it may move."""
    d = k.one_of(2, 2, 3)
    n = Numbers(k)
    x0, v0 = somewhere(k, d), some_velocity(k, d)
    m = k.some_mass()
    h, w = (
        n("h", k.between(0.1, 0.6, k.length)),
        n("w", k.between(0.5, 3, 1 / k.length)),
    )
    tail = next(k.count)
    names = [f"{axis}{tail}" for axis in AXES[:d]]
    off = n("o", k.offset)
    arguments = [f"({q} - {off})" for q in names[:-1]]
    place = [x - k.offset for x in x0[:-1]]
    if k.chance(0.5):
        text = f"{h}*(" + " + ".join(f"cos({w}*{x})" for x in arguments) + ")"
        value = n[h] * sum(math.cos(n[w] * x) for x in place)
    else:
        text = f"{h}*{w}^2*({squares(*arguments)})"
        value = n[h] * n[w] ** 2 * sum(x * x for x in place)
    if k.chance(0.3):
        lift, pace = (
            n("A", k.between(0.02, 0.2, k.length)),
            n("w", k.between(0.5, 5, 1 / k.time)),
        )
        text += f" + {lift}*sin({pace}*(t - {n('t', k.start)}))"
    mass = n("m", m)
    start = [*place_with(k, place), value]
    k.add(
        "bead", parameters=n,
        coordinates={q: (x, v) for q, x, v in zip(names, start, v0, strict=True)},
        kinetic=(f"{mass}*({squares(*(f'{q}_dot' for q in names))})/2",),
        potential=(weight(k, mass, names[-1], n),),
        constraints={k.name("path"): f"{names[-1]} = {text}"},
    )  # fmt: skip


def place_with(k, place):
    return [x + k.offset for x in place]


def sleigh(k):
    n = Numbers(k)
    x, y, a = k.name("x"), k.name("y"), k.name("a")
    m, inertia = n("m", k.some_mass()), n("I", 0.0)
    arm = n("b", k.between(0.05, 0.4, k.length))
    n[inertia] = short(n[m] * k.between(0.05, 0.5) * k.length**2)
    cx, cy = k.name("c"), k.name("c")
    turn, v = k.between(0, 6), k.signed(0.3, 1, k.speed)
    tilt = (weight(k, m, cy, n),) if k.chance(0.4) else ()
    k.add(
        "sleigh", parameters=n,
        coordinates={
            x: (k.offset, v * math.cos(turn)), y: (k.offset, v * math.sin(turn)),
            a: (turn, k.signed(0.2, 2, 1 / k.time)),
        },
        definitions={cx: f"{x} + {arm}*cos({a})", cy: f"{y} + {arm}*sin({a})"},
        kinetic=(f"{m}*({cx}_dot^2 + {cy}_dot^2)/2 + {inertia}*{a}_dot^2/2",),
        potential=tilt,
        constraints={k.name("blade"): f"{x}_dot*sin({a}) = {y}_dot*cos({a})"},
    )  # fmt: skip


def roller(k):
    """A wheel that rolls on a line against a spring, maybe with an eccentric mass."""
    n = Numbers(k)
    x, a = k.name("x"), k.name("a")
    m, r = n("m", k.some_mass()), n("r", k.between(0.2, 1, k.length))
    K = n("K", short(n[m] * k.between(0.5, 5, 1 / k.time) ** 2))
    e = n("e", short(n[r] * k.between(0.05, 0.6)))
    turned = k.one_of(0.0, 0.0, k.between(100, 10000))
    k.add(
        "roller", parameters=n,
        coordinates={x: (k.offset, k.signed(0.1, 1, k.speed)), a: (turned, 0.0)},
        kinetic=(f"{m}*{x}_dot^2/2 + {m}*{r}^2*{a}_dot^2/4",
                 f"{m}*({x}_dot + {e}*{a}_dot*cos({a}))^2/8",
                 f"{m}*({e}*{a}_dot*sin({a}))^2/8"),
        potential=(f"{K}*({x} - {k.offset!r})^2/2", weight(k, m, f"{e}*cos({a})/4", n)),
        constraints={k.name("roll"): f"{x}_dot = {r}*{a}_dot"},
    )  # fmt: skip
    k.sliders.append((x, n[m], 0.0))


def hoop(k):
    """A bead on a hoop that turns: a rotating frame, explicit in t or not."""
    n = Numbers(k)
    a, m, r = k.name("a"), n("m", k.some_mass()), n("r", k.between(0.3, 2, k.length))
    w = n("w", k.between(0.5, 3, 1 / k.time))
    start = {a: (k.between(0.1, 2), k.one_of(0.0, k.signed(0.1, 1, 1 / k.time)))}
    if k.chance(0.5):
        x, y, z = (k.name(axis) for axis in "xyz")
        turned = f"{w}*(t - {n('t', k.start)})"
        definitions = {
            x: f"{r}*sin({a})*cos({turned})", y: f"{r}*sin({a})*sin({turned})",
            z: f"-{r}*cos({a})",
        }  # fmt: skip
        kinetic = f"{m}*({squares(f'{x}_dot', f'{y}_dot', f'{z}_dot')})/2"
        energy = weight(k, m, z, n)
    else:
        definitions = {}
        kinetic = f"{m}*{r}^2*({a}_dot^2 + ({w}*sin({a}))^2)/2"
        energy = "-" + weight(k, m, f"{r}*cos({a})", n)
    k.add(
        "hoop", parameters=n, coordinates=start, definitions=definitions,
        kinetic=(kinetic,), potential=(energy,),
    )  # fmt: skip
    k.pushed.append((a, n[m] * n[r] * k.gravity))


def oscillators(k):
    """A chain of masses on a line: linear unless something is added."""
    made = []
    for i in range(k.one_of(1, 2, 3, 5)):
        x = (k.offset + short(i * k.length) + k.signed(0, 0.3, k.length),)
        made.append(free_point(k, x, some_velocity(k, 1), k.some_mass()))
    last = anchor((k.offset - k.length,))
    for point in made:
        n = Numbers(k)
        K, gap = n("K", stiffness(k, point, last)), n("l", k.length)
        k.add(
            "link",
            parameters=n,
            potential=(f"{K}*({point.at[0]} - {last.at[0]} - {gap})^2/2",),
        )
        last = point
    k.sliders += [(p.at[0], p.mass, 0.0) for p in made]


def block(k):
    """One mass on a line, on a spring or between walls."""
    mass = k.some_mass()
    x0 = k.offset + k.signed(0, 1, k.length)
    v = k.one_of(0.0, k.signed(0.3, 2, k.speed), k.signed(0.3, 2, k.speed))
    point = free_point(k, (x0,), (v,), mass)
    if k.chance(0.6):
        spring(k, point, anchor((k.offset,)))
    k.sliders.append((point.at[0], mass, v))


# Angles and lengths: pendulums of all kinds, and an orbit.


def chain_of_angles(k):
    """A pendulum of one to three links, on a fixed, a sliding or a moving pivot."""
    n = Numbers(k)
    x, y = _pivot(k, n)
    coordinates, definitions, kinetic, potential = {}, {}, [], []
    g = n("g", k.between(0.5, 5, k.gravity))
    for _ in range(k.one_of(1, 1, 2, 2, 3)):
        a, m = k.name("a"), n("m", k.some_mass())
        l = n("l", k.between(0.3, 1, k.length))  # noqa: E741
        tip, low = k.name("x"), k.name("y")
        definitions |= {tip: f"{x} + {l}*sin({a})", low: f"{y} - {l}*cos({a})"}
        kinetic.append(f"{m}*({squares(f'{tip}_dot', f'{low}_dot')})/2")
        potential.append(f"{m}*{g}*{low}")
        speed = k.one_of(0.0, k.signed(0.1, 1, 1 / k.time))
        coordinates[a] = (k.signed(0.05, 1.6), speed)
        k.pushed.append((a, n[m] * n[l] * k.length / k.time**2))
        x, y = tip, low
    k.add(
        "pendulum", parameters=n, coordinates=coordinates, definitions=definitions,
        kinetic=tuple(kinetic), potential=tuple(potential),
    )  # fmt: skip


def _pivot(k, n):
    """Return the texts of the position of a pendulum's pivot; may add a cart."""
    kind = k.one_of("fixed", "fixed", "cart", "shaken", "turning")
    if kind == "cart":
        mass, s = k.some_mass(), k.name("s")
        v = k.one_of(0.0, k.signed(0.1, 1, k.speed))
        m = n("m", mass)
        k.add(
            "cart", parameters={m: n.pop(m)}, coordinates={s: (k.offset, v)},
            kinetic=(f"{m}*{s}_dot^2/2",),
        )  # fmt: skip
        k.sliders.append((s, mass, v))
        k.pushed.append((s, mass * k.gravity))
        if k.chance(0.4):
            K = n("K", short(mass * k.between(0.5, 6, 1 / k.time) ** 2))
            k.add(
                "cart-spring",
                parameters={K: n.pop(K)},
                potential=(f"{K}*({s} - {k.offset!r})^2/2",),
            )
        return s, "0"
    if kind == "fixed":
        return "0", "0"
    amplitude, w = (
        n("A", k.between(0.02, 0.3, k.length)),
        n("w", k.between(0.5, 6, 1 / k.time)),
    )
    since = f"(t - {n('t', k.start)})"
    if kind == "shaken":
        return "0", f"{amplitude}*cos({w}*{since})"
    return f"{amplitude}*cos({w}*{since})", f"{amplitude}*sin({w}*{since})"


def elastic_pendulum(k):
    n = Numbers(k)
    a, u = k.name("a"), k.name("u")
    m, l = n("m", k.some_mass()), n("l", k.between(0.5, 2, k.length))  # noqa: E741
    K = n("K", short(n[m] * k.between(2, 6, 1 / k.time) ** 2))
    k.add(
        "elastic-pendulum", parameters=n,
        coordinates={
            a: (k.signed(0, 1.5), k.signed(0, 0.5, 1 / k.time)),
            u: (k.signed(0, 0.2, n[l]), 0.0),
        },
        kinetic=(f"{m}*((({l} + {u})*{a}_dot)^2 + {u}_dot^2)/2",),
        potential=(f"{K}*{u}^2/2", f"-{weight(k, m, f'({l} + {u})*cos({a})', n)}"),
    )  # fmt: skip
    k.pushed.append((u, n[m] * k.gravity))


def polar_orbit(k):
    n = Numbers(k)
    r, a, m = k.name("r"), k.name("a"), n("m", k.some_mass())
    mu = n("mu", short(n[m] * k.length**3 / k.time**2))
    k.add(
        "polar", parameters=n,
        coordinates={r: (k.between(0.7, 1.3, k.length), k.signed(0, 0.2, k.speed)),
                     a: (k.between(0, 6), k.signed(0.7, 1.2, 1 / k.time))},
        kinetic=(f"{m}*({r}_dot^2 + ({r}*{a}_dot)^2)/2",),
        potential=(f"-{mu}/{r}",),
    )  # fmt: skip


def spherical_pendulum(k):
    n = Numbers(k)
    a, b = k.name("a"), k.name("b")
    m, l = n("m", k.some_mass()), n("l", k.between(0.5, 2, k.length))  # noqa: E741
    k.add(
        "spherical", parameters=n,
        coordinates={
            a: (k.between(0.5, 2), 0.0),
            b: (k.between(0, 6), k.signed(0.7, 2, 1 / k.time)),
        },
        kinetic=(f"{m}*{l}^2*({a}_dot^2 + ({b}_dot*sin({a}))^2)/2",),
        potential=(f"-{weight(k, m, f'{l}*cos({a})', n)}",),
    )  # fmt: skip


MECHANISMS = (
    points_and_springs, points_and_springs, unequal_masses, gravitating,
    chain_of_angles, chain_of_angles, elastic_pendulum,
    polar_orbit, spherical_pendulum,
    rods, rods, bead, sleigh, roller, hoop, oscillators, block, block, block,
)  # fmt: skip
