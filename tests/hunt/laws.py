"""Laws of force that are added to mechanisms: walls, hills, drag, friction, pulses."""

from __future__ import annotations

import math

from tests.hunt.bodies import free_point, some_velocity
from tests.hunt.maker import Numbers, short


def energy_of(k, mass):
    return mass * k.speed**2


def wall(k):
    """A wall after Hertz, linear, or steep as a power, that a slider may reach."""
    x, mass, _ = k.one_of(*k.sliders)
    n = Numbers(k)
    away, side = k.one_of((1, ""), (-1, "-"))
    at = n("b", _start(k, x) + away * k.between(0.05, 1.5, k.length))
    power = k.one_of(2, 2, 2.5, 3)
    K = n("K", short(k.between(1, 50) * energy_of(k, mass) / (0.1 * k.length) ** power))
    depth = f"max(0, {side}({x} - {at}))"
    energy = f"{K}*{depth}^{power}/{power}"
    if k.chance(0.3):
        energy = (
            f"if({side}({x} - {at}) > 0, {K}*({side}({x} - {at}))^{power}/{power}, 0)"
        )
    width = 0.1 * k.length
    k.add("wall", parameters=n, potential=(energy,), features=((f"{x} - {at}", width),))


def hill(k):
    """Potential: a Gaussian hill or well, or a ramp of tanh, narrow in the scene."""
    x, mass, _ = k.one_of(*k.sliders)
    n = Numbers(k)
    w = n("w", k.decades(-2.5, -0.5, k.length))
    at = n("b", k.offset + k.signed(0.1, 1.5, k.length))
    E = n("E", k.one_of(-1, 1) * k.between(0.05, 5, energy_of(k, mass)))
    s = f"(({x} - {at})/{w})"
    energy = k.one_of(f"{E}*exp(-{s}^2)", f"{E}*(1 + tanh({s}))/2")
    k.add(
        "hill", parameters=n, potential=(energy,), features=((f"{x} - {at}", n[w] / 2),)
    )


def pair_law(k):
    """Lennard-Jones between two sliders or a slider and a wall."""
    x, mass, _ = k.one_of(*k.sliders)
    n = Numbers(k)
    start = _start(k, x)
    d = n("d", k.between(0.05, 0.3, k.length))
    at = n("b", start - k.one_of(-1, 1) * n[d] * k.between(0.9, 3))
    E = n("E", k.between(0.1, 1, energy_of(k, mass)))
    s = f"({d}/abs({x} - {at}))"
    k.add(
        "lennard-jones", parameters=n, potential=(f"{E}*({s}^12 - 2*{s}^6)",),
        features=((f"{x} - {at}", n[d] / 4),),
    )  # fmt: skip


def _start(k, name):
    for item in k.items:
        if name in item.coordinates:
            return item.coordinates[name][0]
    raise KeyError(name)


def drag(k):
    """Drag on a slider: linear, square, or a broken power of the speed."""
    x, mass, _ = k.one_of(*k.sliders)
    n = Numbers(k)
    v = f"{x}_dot"
    c = k.between(0.02, 1, mass / k.time)
    kind = k.one_of(
        "linear", "square", "sign-square", "power", "root", "cube", "rayleigh"
    )
    size = n("c", c)
    s = n("v", k.speed)
    if kind == "rayleigh":
        k.add("drag-rayleigh", parameters=n, dissipation=(f"{size}*{v}^2/2 + 0*{s}",))
        return
    text = {
        "linear": f"-{size}*{v} + 0*{s}",
        "square": f"-{size}*abs({v})*{v}/{s}",
        "sign-square": f"-{size}*sign({v})*{v}^2/{s}",
        "power": f"-{size}*sign({v})*abs({v})^1.5/sqrt({s})",
        "root": f"-{size}*sign({v})*sqrt(abs({v}))*sqrt({s})",
        "cube": f"-{size}*{v}^3/{s}^2",
    }[kind]
    k.add(f"drag-{kind}", parameters=n, forces=((x, text),))


def air(k):
    """Drag of the air on a point in the plane or in space."""
    point = k.one_of(*k.points)
    n = Numbers(k)
    c = n("c", k.between(0.02, 0.5, point.mass / k.time))
    rates = [f"{x}_dot" for x in point.at]
    speed = "sqrt(" + " + ".join(f"{v}^2" for v in rates) + ")"
    s = n("v", k.speed)
    if len(rates) == 1 or k.chance(0.5):
        forces = tuple(
            (x, f"-{c}*{v} + 0*{s}") for x, v in zip(point.at, rates, strict=True)
        )
    else:
        forces = tuple(
            (x, f"-{c}*{speed}*{v}/{s}") for x, v in zip(point.at, rates, strict=True)
        )
    k.add("air", parameters=n, forces=forces)


def friction(k):
    """Dry friction of a slider on the ground or a belt, perhaps after Stribeck."""
    x, mass, _ = k.one_of(*k.sliders)
    n = Numbers(k)
    F = n("F", k.between(0.05, 0.8, mass * k.gravity))
    v = f"{x}_dot"
    if k.chance(0.4):
        v = f"({v} - {n('v', k.signed(0.1, 0.5, k.speed))})"
    if k.chance(0.3):
        more, s = n("S", k.between(0.1, 1)), n("v", k.between(0.05, 0.5, k.speed))
        text = f"-{F}*sign({v})*(1 + {more}*exp(-({v}/{s})^2))"
    else:
        text = f"-{F}*sign({v})"
    k.add("friction", parameters=n, forces=((x, text),))


def forcing(k):
    """A force in time: a sine, a pulse (smooth or not, narrow or not), square waves."""
    if not k.pushed:
        return
    q, size = k.one_of(*k.pushed)
    n = Numbers(k)
    F = n("F", k.signed(0.1, 2, size))
    since = f"(t - {n('t', k.start)})"
    kind = k.one_of("sine", "pulse", "pulse", "square", "step", "box", "ramp")
    breaks: tuple[float, ...] = ()
    features: tuple[tuple[str, float], ...] = ()
    if kind == "sine":
        text = f"{F}*sin({n('w', k.between(0.3, 10, 1 / k.time))}*{since})"
    elif kind == "pulse":
        at = n("t", k.start + k.between(0.05, 0.95, k.duration))
        w = n("w", k.decades(-4, -1, k.duration))
        n[F] = short(n[F] * k.time / min(n[w], k.time))
        s = f"((t - {at})/{w})"
        text = f"{F}*" + k.one_of(f"exp(-{s}^2)", f"1/cosh({s})^2", f"exp(-abs({s}))")
        if "abs" in text:
            breaks = (n[at],)
        features = ((f"t - {at}", n[w] / 2),)
    elif kind == "square":
        w = n("w", k.between(0.5, 8, 1 / k.time))
        text = f"{F}*sign(sin({w}*{since}))"
        count = int(k.duration * n[w] / math.pi) + 1
        breaks = tuple(k.start + i * math.pi / n[w] for i in range(1, count + 1))
        if len(breaks) > 60:
            return
    elif kind == "ramp":
        rise = n("t", k.between(0.1, 0.8, k.duration))
        text = f"{F}*min(1, {since}/{rise})"
        breaks = (k.start + n[rise],)
    else:
        at = n("t", k.start + k.between(0.05, 0.6, k.duration))
        end = n("t", n[at] + k.decades(-4, -0.5, k.duration))
        text = f"if(t < {at}, 0, {F})"
        breaks = (n[at],)
        if kind == "box":
            text = f"if(t > {at} and t < {end}, {F}, 0)"
            breaks = (n[at], n[end])
        else:
            del n[end]
    k.add(
        f"force-{kind}", parameters=n, forces=((q, text),), breaks=breaks,
        features=features,
    )  # fmt: skip


def bystander(k):
    """A body without contact: heavy or light, near or far, at rest or fast."""
    d = k.one_of(1, 2)
    far = k.one_of(0, 0, 1e3, 1e6, 1e9) * k.length
    place = tuple(far + k.signed(0.1, 2, k.length) for _ in range(d))
    fast = k.one_of(1, 1, 1e3, 1e6)
    speed = tuple(fast * v for v in some_velocity(k, d))
    points, pushed = list(k.points), list(k.pushed)
    free_point(k, place, speed, k.decades(-9, 9, k.mass))
    k.points, k.pushed = points, pushed


def dead_zone(k):
    """A spring with play, maybe with a damper that only pushes (a backlash)."""
    x, mass, _ = k.one_of(*k.sliders)
    n = Numbers(k)
    K = n("K", short(mass * k.between(1, 10, 1 / k.time) ** 2))
    b, at = n("b", k.between(0.05, 0.6, k.length)), n("o", k.offset)
    stretch = k.name("u")
    text = f"{x} - {at} - max(-{b}, min({b}, {x} - {at}))"
    width = 0.1 * k.length
    features = ((f"{x} - {at} - {b}", width), (f"{x} - {at} + {b}", width))
    if k.chance(0.5):
        k.add(
            "dead-zone", parameters=n, definitions={stretch: text},
            potential=(f"{K}*{stretch}^2/2",), features=features,
        )  # fmt: skip
        return
    c = n("c", k.between(0.05, 1, mass / k.time))
    low = f"min(0, {K}*({x} - {at} + {b}) + {c}*{x}_dot)"
    high = f"max(0, {K}*({x} - {at} - {b}) + {c}*{x}_dot)"
    force = f"-if({x} > {at} + {b}, {high}, 0) - if({x} < {at} - {b}, {low}, 0)"
    k.add("backlash", parameters=n, forces=((x, force),), features=features)


def relay(k):
    """Control force that switches at a position, or at a line of the phase plane."""
    x, mass, _ = k.one_of(*k.sliders)
    n = Numbers(k)
    F = n("F", k.between(0.1, 1.5, mass * k.gravity))
    s = f"{x} - {n('o', k.offset)}"
    if k.chance(0.6):
        s += f" + {n('d', k.between(0.1, 1, k.time))}*{x}_dot"
    text = f"-{F}*sign({s})"
    if k.chance(0.3):
        K = n("K", short(k.between(1, 50) * n[F] / k.length))
        text = f"-max(-{F}, min({F}, {K}*({s})))"
    k.add("relay", parameters=n, forces=((x, text),))


def bent_spring(k):
    """A spring whose force is a broken power of the stretch."""
    x, mass, _ = k.one_of(*k.sliders)
    n = Numbers(k)
    power = k.one_of(1.5, 2.5, 3.5)
    K = n("K", short(k.between(0.5, 10) * energy_of(k, mass) / k.length**power))
    s = f"abs({x} - {n('o', k.offset + k.signed(0, 0.5, k.length))})"
    k.add("bent-spring", parameters=n, potential=(f"{K}*{s}^{power}/{power}",))


def magnetic(k):
    """Magnetic field normal to the plane, as a potential that depends on velocities."""
    flat = [p for p in k.points if len(p.at) == 2]
    if not flat:
        return
    point = k.one_of(*flat)
    n = Numbers(k)
    B = n("B", k.signed(0.3, 3, point.mass / k.time))
    x, y = point.at
    k.add("magnetic", parameters=n, potential=(f"-{B}*({x}*{y}_dot - {y}*{x}_dot)/2",))
