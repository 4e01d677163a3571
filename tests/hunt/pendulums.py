"""Mechanisms in angles and lengths: pendulums of all kinds, and an orbit."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tests.hunt.maker import Numbers, short, squares, weight

if TYPE_CHECKING:
    from tests.hunt.maker import Maker


def chain_of_angles(k: Maker) -> None:
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


def _pivot(k: Maker, n: Numbers) -> tuple[str, str]:
    """Give the texts of where a pendulum hangs; may add a cart."""
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


def elastic_pendulum(k: Maker) -> None:
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


def polar_orbit(k: Maker) -> None:
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


def spherical_pendulum(k: Maker) -> None:
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
