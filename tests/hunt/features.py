"""Random scenes of families, frames, bodies, tables, states, modes and events.

Each is written twice: for lagsim with the features of the file, and for the referee
with every member, rotation and sum written out by this generator. A base (sliders, a
chain, bodies in space, blocks on a ground) has movers: coordinates on which the
features of a scene act.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from math import sqrt
from typing import Any, NamedTuple

import yaml

from tests.hunt.hybrid import Law, Plain
from tests.hunt.hybrid_verdict import Told
from tests.hunt.verdict import MUTE

KINDS = ("linear", "cubic", "monotone")
ROWS = 40


class Mover(NamedTuple):
    """A coordinate: its names for lagsim and the referee, its inertia and its start."""

    told: str
    plain: str
    m: float
    at: float


@dataclass
class Maker:
    """A scene for lagsim and for the referee, both in construction.

    terms : terms of energies, and of the forces on movers, as pairs of texts
    still : movers that start at rest
    counted : modes that count
    """

    r: random.Random
    start: float
    duration: float
    told: dict[str, Any] = field(default_factory=dict)
    plain: dict[str, Any] = field(default_factory=dict)
    terms: dict[Any, list[tuple[str, str]]] = field(default_factory=dict)
    movers: list[Mover] = field(default_factory=list)
    laws: list[Law] = field(default_factory=list)
    tables: dict[str, Any] = field(default_factory=dict)
    events: dict[str, Any] = field(default_factory=dict)
    sections: dict[str, Any] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    times: list[float] = field(default_factory=list)
    still: set[str] = field(default_factory=set)
    counted: list[str] = field(default_factory=list)
    until: tuple[str, str] = ("", "")

    def some(self, low=-1.0, high=1.0):
        return round(self.r.uniform(low, high), 3)

    def several(self, n, low=-1.0, high=1.0):
        return [self.some(low, high) for _ in range(n)]

    def chance(self, part):
        return self.r.random() < part

    def name(self, letter):
        taken = (self.names, self.tables, self.events, self.sections, self.laws)
        modes = self.plain.get("modes", {})
        return f"{letter}{sum(map(len, taken)) + len(modes)}"

    def put(self, section, told, plain=None):
        """Add entries to a section: equal ones to both files, or one to each."""
        self.told.setdefault(section, {}).update(told)
        self.plain.setdefault(section, {}).update(told if plain is None else plain)

    def add(self, section, told, plain=None):
        self.terms.setdefault(section, []).append(
            (told, told if plain is None else plain)
        )

    def both(self, mover, text):
        """Return a text of {x} and {v} for both files."""
        family, bracket, index = mover.told.partition("(")
        pairs = {mover.told: f"{family}_dot{bracket}{index}",
                 mover.plain: f"{mover.plain}_dot"}  # fmt: skip
        found = [text.format(x=x, v=pairs[x]) for x in (mover.told, mover.plain)]
        return found[0], found[1]

    def force(self, mover, text):
        self.add((mover.told, mover.plain), *self.both(mover, text))

    def potential(self, mover, text):
        self.add("potential", *self.both(mover, text))

    def stop(self, mover):
        """Start a mover at rest; return whether no other feature holds it."""
        if mover.plain in self.still:
            return False
        self.still.add(mover.plain)
        told, plain = self.both(mover, "{v}")
        self.put("initial", {told: 0}, {plain: 0})
        return True

    def law(self, told, *laws):
        """Add a constraint: its entry for lagsim, its rows for the referee."""
        self.told.setdefault("constraints", {})[self.name("c")] = told
        self.laws += laws

    def table(self, low, high, size, outside="", kinds=KINDS):
        """Add a table of values up to `size` on [low, high]; return its name."""
        outside = outside or self.r.choice(["hold", "extend", "repeat"])
        name, kind = self.name("tab"), self.r.choice(kinds)
        inner = {self.some(low, high) for _ in range(self.r.randint(2, 7))}
        x = sorted(inner | {low, high})
        y = self.several(len(x), -size, size)
        y[-1] = y[0] if outside == "repeat" else y[-1]
        points = [list(p) for p in zip(x, y, strict=True)]
        entry = {"points": points, "interpolation": kind, "outside": outside}
        self.told.setdefault("tables", {})[name] = entry
        self.tables[name] = (x, y, kind, outside)
        return name

    def event(self, letter, told, plain, **values):
        """Add an event: `told` and `plain` are entries that differ in both files."""
        name = self.name(letter)
        self.told.setdefault("events", {})[name] = told | values
        self.events[name] = plain | values

    def scene(self, seed):
        for key, pairs in self.terms.items():
            for k, document in enumerate((self.told, self.plain)):
                section, name = ("energy", key) if isinstance(key, str) else (
                    "forces", key[k])  # fmt: skip
                text = " + ".join(f"({pair[k]})" for pair in pairs)
                document.setdefault(section, {"potential": "0"} if name == key else {})
                document[section][name] = text
        step = self.duration / ROWS
        self.told["simulation"] = {
            "start": self.start, "duration": self.duration, "output_step": step,
        }  # fmt: skip
        if self.until[0]:
            self.told["simulation"]["until"] = self.until[0]
        if self.sections:
            cuts = {k: told for k, (told, _) in self.sections.items()}
            self.told["output"] = {"sections": cuts}
        text = yaml.safe_dump(self.told, sort_keys=False, width=10**6)
        times = [self.start + k * step for k in range(ROWS)]
        plain = Plain(
            self.plain, tuple(self.laws), self.tables, self.events,
            {k: x for k, (_, x) in self.sections.items()}, self.until[1],
            tuple(self.times),
        )  # fmt: skip
        whole = f"# hunt: {seed}\nname: scene\n{text}"
        end = self.start + self.duration
        # Between steps that stability holds the interpolant is worse than they are.
        return Told(
            whole, plain, self.names, self.start, [*times, end],
            excused=(("step-at-stability-bound", MUTE),),
        )  # fmt: skip


def members(k, letter, starts, speeds, masses):
    """Add a family of coordinates, its start and its movers."""
    known = list(enumerate(zip(starts, speeds, masses, strict=True), 1))
    k.put(
        "coordinates", {f"{letter}(1..n)": {}}, {f"{letter}_{i}": {} for i, _ in known}
    )
    k.put("initial", {f"{letter}(1..n)": starts, f"{letter}_dot(1..n)": speeds}, {})
    for i, (x, v, m) in known:
        name = f"{letter}_{i}"
        k.plain["initial"] |= {name: x, f"{name}_dot": v}
        k.movers.append(Mover(f"{letter}({i})", name, m, x))
        k.names |= {name: f"{letter}.{i}", f"{name}_dot": f"{letter}_dot.{i}"}


def total(form, *lists, first=1):
    """Return the written-out sum of a form.

    The form contains i, the index, j, the index before, and a, an element of each list.
    """
    return " + ".join(
        form.format(i=i, j=i - 1, a=a)
        for i, *a in zip(range(first, first + len(lists[0])), *lists, strict=False)
    ) or "0"  # fmt: skip


# --- bases ---------------------------------------------------------------------------


def sliders(k):
    """Masses on a line, tied to their neighbours and to the ground."""
    n, K = k.r.randint(1, 3), k.some(2, 40)
    m = k.several(n, 0.5, 2)
    k.put("parameters", {"n": n, "m(1..n)": m, "K": K}, {})
    members(k, "x", k.several(n, -0.5, 0.5), k.several(n), m)
    k.add(
        "kinetic", "sum(i = 1..n, m(i)*x_dot(i)^2)/2", total("{a[0]}*x_{i}_dot^2/2", m)
    )
    k.add("potential", "K*x(1)^2/2 + sum(i = 2..n, K*(x(i) - x(i-1))^2)/2",
          f"{K}*x_1^2/2 + "
          + total(f"{K}*(x_{{i}} - x_{{j}})^2/2", m[1:], first=2))  # fmt: skip


def chain(k):
    """Pendulums in a row below a cart, in absolute or relative angles."""
    n, size, M, before = k.r.randint(1, 4), k.some(0.3, 1), k.some(1, 3), k.chance(0.4)
    m = k.several(n, 0.3, 1.5)
    k.put("parameters", {"n": n, "m(1..n)": m, "l": size}, {})
    k.put("coordinates", {"X": {}})
    k.put("initial", {"X": 0, "X_dot": k.some()})
    k.names |= {"X": "X", "X_dot": "X_dot"}
    members(k, "q", k.several(n), k.several(n), [w * size * size for w in m])
    k.movers.append(Mover("X", "X", M, 0.0))
    told = {"a(0)": "0", "a(i = 1..n)": "a(i-1) + q(i)" if before else "q(i)",
            "p(0)": "vec(X, 0)",
            "p(i = 1..n)": "p(i-1) + l*vec(sin(a(i)), -cos(a(i)))"}  # fmt: skip
    plain = {"a_0": "0", "x_0": "X", "y_0": "0"}
    for i in range(1, n + 1):
        plain[f"a_{i}"] = f"a_{i - 1} + q_{i}" if before else f"q_{i}"
        plain[f"x_{i}"] = f"x_{i - 1} + {size}*sin(a_{i})"
        plain[f"y_{i}"] = f"y_{i - 1} - {size}*cos(a_{i})"
    k.put("definitions", told, plain)
    k.add("kinetic", f"{M}*X_dot^2/2")
    kinetic = "sum(i = 1..n, m(i)*dot(p_dot(i), p_dot(i)))/2"
    potential = "9.81*sum(i = 1..n, m(i)*p(i).y)"
    if k.chance(0.5):
        kinetic = potential = "bodies"
        k.told["gravity"] = [0, "-9.81"]
        k.told["bodies"] = {"bob(i = 1..n)": {"mass": "m(i)", "at": "p(i)"}}
    k.add("kinetic", kinetic, total("{a[0]}*(x_{i}_dot^2 + y_{i}_dot^2)/2", m))
    k.add("potential", potential, total("{a[0]}*9.81*y_{i}", m))


def tree(k):
    """Bodies in space on joints in a row, each about any axis of the one before."""
    n = k.r.randint(1, 2)
    frames: dict[str, Any] = {}
    bodies: dict[str, Any] = {}
    k.put("parameters", {"n": n}, {})
    k.put("definitions", {})
    members(k, "q", k.several(n), k.several(n), [0.3] * n)
    R = [[str(int(r == c)) for c in range(3)] for r in range(3)]
    w, place, tip, parent = ["0"] * 3, ["0"] * 3, "vec(0, 0, 0)", "space"
    for i in range(1, n + 1):
        axis = k.r.choice([[0, 0, 1], [0, 1, 0], k.several(3)])
        a = [x / sqrt(sum(y * y for y in axis)) for x in axis]
        m, J, arm = k.some(0.5, 1.5), k.several(3, 0.05, 0.1), k.several(3, -0.5, 0.5)
        vec = f"vec({', '.join(map(str, arm))})"
        frames[f"f{i}"] = {"on": parent, "axis": axis, "angle": f"q({i})"}
        bodies[f"b{i}"] = {"mass": m, "at": f"{tip} + rotate(f{i}, {vec}/2)",
                           "frame": f"f{i}", "inertia": J}  # fmt: skip
        tip, parent = f"{tip} + rotate(f{i}, {vec})", f"f{i}"
        turn = list(zip(*rodrigues(a, f"q_{i}"), strict=True))
        own = k.plain["definitions"]
        for r in range(3):
            own[f"W{i}{r}"] = f"{w[r]} + ({dot(R[r], a)})*q_{i}_dot"
            own |= {f"R{i}{r}{c}": dot(R[r], turn[c]) for c in range(3)}
        R = [[f"R{i}{r}{c}" for c in range(3)] for r in range(3)]
        w = [f"W{i}{r}" for r in range(3)]
        for r in range(3):
            own[f"C{i}{r}"] = f"{place[r]} + ({dot(R[r], arm)})/2"
            own[f"O{i}{r}"] = f"{place[r]} + {dot(R[r], arm)}"
            own[f"V{i}{r}"] = dot([row[r] for row in R], w)
            k.add("kinetic", "0", f"{m}*C{i}{r}_dot^2/2 + {J[r]}*V{i}{r}^2/2")
        place = [f"O{i}{r}" for r in range(3)]
        k.add("potential", "0", f"{m}*9.81*C{i}2")
        k.add("dissipation", f"0.05*q_dot({i})^2/2", f"0.05*q_{i}_dot^2/2")
    k.told |= {"frames": frames, "bodies": bodies, "gravity": [0, 0, "-9.81"]}
    k.add("kinetic", "bodies", "0")
    k.add("potential", "bodies", "0")


def dot(a, b):
    return " + ".join(f"({x})*({y})" for x, y in zip(a, b, strict=True))


def rodrigues(a, angle):
    """Return the rotation by an angle about a unit vector, as rows of texts."""
    cross = [[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]]
    return [
        [f"{float(r == c) - a[r] * a[c]!r}*cos({angle}) + {a[r] * a[c]!r}"
         f" + {float(cross[r][c])!r}*sin({angle})" for c in range(3)]
        for r in range(3)
    ]  # fmt: skip


def blocks(k):
    """Blocks or discs over a ground, each with friction and bounces of some kind."""
    n, r, disc = k.r.randint(1, 2), k.r, k.chance(0.4)
    m, now = k.several(n, 0.5, 2), k.start
    k.put("parameters", {"n": n, "m(1..n)": m}, {})
    ground = "0"
    if k.chance(0.5):  # without kinks: in a corner impulses are another thing
        ground = k.table(-4, 4, 0.3, kinds=KINDS[1:]) + "({x})"
    elif k.chance(0.4):
        ground = f"0.2*{k.table(now, now + k.duration, 0.2)}(t)"
    members(k, "x", k.several(n), k.several(n, -2, 2), m)
    movers = list(k.movers)
    members(k, "y", [k.some(0.6, 1.2) + i for i in range(n)], k.several(n), m)
    k.add("kinetic", "sum(i = 1..n, m(i)*(x_dot(i)^2 + y_dot(i)^2))/2",
          total("{a[0]}*(x_{i}_dot^2 + y_{i}_dot^2)/2", m))  # fmt: skip
    k.add("potential", "sum(i = 1..n, 9.81*m(i)*y(i))", total("9.81*{a[0]}*y_{i}", m))
    slip = ("x_dot(i)", "x_{i}_dot")
    if disc:
        members(k, "a", [0.0] * n, k.several(n, -10, 10), [0.02 * w for w in m])
        k.add("kinetic", "sum(i = 1..n, m(i)*a_dot(i)^2*0.02)/2",
              total("{a[0]}*a_{i}_dot^2*0.02/2", m))  # fmt: skip
        slip = ("x_dot(i) + 0.2*a_dot(i)", "x_{i}_dot + 0.2*a_{i}_dot")
    flat = ("hold", ("linear", "monotone"))
    e = r.choice(["0", str(k.some(0.2, 0.7)), "0.6 - 0.03*approach_speed",
                  "0.7/(1 + approach_speed)", "table"])  # fmt: skip
    e = f"0.4 + {k.table(now, now + 1, 0.3, *flat)}(t)" if e == "table" else e
    mu = r.choice([
        str(k.some(0, 0.6)), "0.2 + 0.2*exp(-slip_speed/0.3)", "0.3 + 0.05*slip_speed",
        "0.3/(1 + slip_speed)", "static", "table",
    ])  # fmt: skip
    mu = f"0.3 + {k.table(now, now + 1, 0.2, *flat)}(t)" if mu == "table" else mu
    static = r.choice(["0.3", "0.35 + 0.05*sin(t)"]) if mu == "static" else ""
    mu = "0.2" if static else mu
    both = {"static": static, "dynamic": mu} if static else mu
    relation = f"y(i) >= {ground.format(x='x(i)')}"
    entry = {"relation": relation, "restitution": e, "friction": both, "slip": slip[0]}
    poisson = k.chance(0.3)
    entry |= {"restitution_law": "poisson"} if poisson else {}
    k.told.setdefault("constraints", {})["floor(i = 1..n)"] = entry
    for i in range(1, n + 1):
        gap = f"y_{i} - ({ground.format(x=f'x_{i}')})"
        rubs = Law(
            "slip", slip[1].format(i=i), mu=mu, static=static, normal=len(k.laws)
        )
        k.laws += [Law("contact", gap, e=e, poisson=poisson), rubs]
    k.movers = movers


# --- what decorates a scene ----------------------------------------------------------


def drive(k, x):
    k.force(x, f"{k.some(0.5, 3) * x.m!r}*sin({k.some(1, 8)}*(t - {k.start}))")


def table_force(k, x):
    of = k.r.choice(["t", "{x}", "{v}"])
    low, high = k.some(-1.5, -0.2), k.some(0.2, 1.5)
    if of == "t":
        low, high = k.start + k.some(0, 0.5), k.start + k.some(1, 2)
    # A force that jumps with the velocity is friction, which has a name.
    outside = k.r.choice(["hold", "extend"]) if of == "{v}" else ""
    k.force(x, f"{x.m!r}*{k.table(low, high, 1.0, outside)}({of})")


def table_potential(k, x):
    ends = x.at - k.some(0.2, 1), x.at + k.some(0.2, 1)
    name = k.table(*ends, 0.5, k.r.choice(["extend", "repeat"]))
    k.potential(x, f"{x.m!r}*{name}({{x}})")


def dead_zone(k, x):
    a, K = k.some(0.05, 0.4), k.some(5, 30) * x.m
    above, below = f"max(0, {{x}} - {x.at + a!r})", f"max(0, {x.at - a!r} - {{x}})"
    k.potential(x, f"{K!r}*({above}^2 + {below}^2)")


def belt(k, x):
    """Dry friction on a belt, with a limit that may depend on many quantities."""
    size = repr(x.m * k.some(0.3, 3))
    factor = k.r.choice(["1", "(1 + abs({x}))", "(1.5 + sin(3*t))", "table", "mode"])
    if factor == "table":
        name = k.table(k.start, k.start + 1, 1, "hold", ("linear", "monotone"))
        factor = f"(1.5 + {name}(t))"
    if factor == "mode":
        factor = f"(1 + {k.counted[0]})" if k.counted else "1"
    told, plain = k.both(x, f"{{v}} - {k.r.choice([0, 0, k.some(-0.5, 0.5)])}")
    limits = k.both(x, f"{size}*{factor}")
    entry = {"relation": f"{told} = 0", "limit": limits[0]}
    k.law(entry, Law("limit", plain, mu=limits[1]))


def ratchet(k, x):
    """A freewheel: a coordinate that cannot move back."""
    if k.stop(x):
        told, plain = k.both(x, "{v}")
        k.law({"relation": f"{told} >= 0"}, Law("ratchet", plain))


def counter(k, x):
    """Located events that count, once or repeatedly, and an effect of the count."""
    n = k.name("n")
    k.put("modes", {n: 0})
    sign = k.r.choice(["<=", ">="])
    told, plain = k.both(x, f"{{x}} {sign} {x.at + k.some(-0.3, 0.3)!r}")
    once = {"once": True} if k.chance(0.3) else {}
    k.event("pass", {"at": told}, {"at": plain}, set={n: f"min(4, {n} + 1)"}, **once)
    k.force(x, f"{-x.m * k.some(0.2, 1)!r}*{n}*{{v}}")
    k.counted.append(n)


def relay(k, x):
    """A force with hysteresis: two located events."""
    u, F, b = k.name("u"), x.m * k.some(0.5, 4), k.some(0.05, 0.3)
    k.put("modes", {u: F})
    for sign, value, edge in ((">=", -F, x.at + b), ("<=", F, x.at - b)):
        told, plain = k.both(x, f"{{x}} {sign} {edge!r}")
        k.event("relay", {"at": told}, {"at": plain}, set={u: repr(value)})
    k.force(x, u)


def sampled(k, x):
    """A controller in samples, within bounds."""
    u, c, every = k.name("u"), x.m * k.some(2, 10), k.some(0.03, 0.2)
    k.put("modes", {u: 0})
    gains = x.m * k.some(5, 40), x.m * k.some(1, 4)
    wish = f"-{gains[0]!r}*({{x}} - {x.at}) - {gains[1]!r}*{{v}}"
    told, plain = k.both(x, f"max(-{c!r}, min({c!r}, {wish}))")
    k.event("sample", {"set": {u: told}}, {"set": {u: plain}}, every=every)
    k.force(x, u)


def state(k, x):
    """A filter or an integral that acts back."""
    s, T = k.name("s"), k.some(0.1, 1)
    rate = k.r.choice([
        f"({{x}} - {s})/{T}", f"{{x}} - {x.at}", f"({{v}} - {s})/{T}",
        f"({{x}} - {s}^3)/{T}", f"max(-0.5, min(0.5, {{v}})) - {s}",
    ])  # fmt: skip
    told, plain = k.both(x, rate)
    k.put("states", {s: {"rate": told}}, {s: {"rate": plain}})
    k.put("initial", {s: k.some(-0.5, 0.5)})
    k.names[s] = s
    k.force(x, f"-{x.m * k.some(1, 8)!r}*{s}")


def wall(k, x):
    """A contact beside the start, perhaps with a mode as its restitution."""
    e = k.r.choice(["0", str(k.some(0.3, 1)), "0.9 - 0.05*approach_speed", "mode"])
    if e == "mode":
        e = k.name("e")
        k.put("modes", {e: 0.8})
        k.event("wear", {}, {}, every=k.some(0.3, 0.9), set={e: f"0.9*{e}"})
    side = k.r.choice([1, -1])
    edge = repr(x.at - side * k.some(0.05, 0.5))
    edge += f" + 0.03*sin({k.some(2, 9)}*(t - {k.start}))" if k.chance(0.3) else ""
    told, plain = k.both(x, f"{side}*({{x}} - ({edge}))")
    poisson = {"restitution_law": "poisson"} if k.chance(0.2) else {}
    entry = {"relation": f"{told} >= 0", "restitution": e} | poisson
    k.law(entry, Law("contact", plain, e=e, poisson=bool(poisson)))


def latch(k, x):
    """A constraint until an event or a time, from rest."""
    if not k.stop(x):
        return
    at, when = k.start + k.some(0.2, 1.2), ""
    if k.chance(0.5):
        k.times.append(at)
        when = f"t < {at!r}"
    else:
        h = k.name("h")
        k.put("modes", {h: 2})
        k.event("count", {}, {}, every=k.some(0.2, 1.1), set={h: f"{h} - 1"})
        when = f"{h} > 0"
    told, plain = k.both(x, f"{{x}} - ({x.at!r})")
    k.law({"relation": f"{told} = 0", "when": when}, Law("hold", plain, when=when))


def section(k, x):
    told, plain = k.both(x, f"{{x}} - ({x.at + k.some(-0.2, 0.2)!r})")
    way = k.r.choice(["up", "down", "both"])
    k.sections[k.name("cut")] = {"at": f"{told} = 0", "direction": way}, (plain, way)


def end(k, x):
    k.until = k.both(x, f"{{x}} >= {x.at + k.some(0.3, 1)!r}")


BASES = (sliders, chain, tree, blocks)
DECORATIONS = (
    drive, ratchet, counter, table_force, table_force, table_potential, dead_zone, belt,
    relay, sampled, state, wall, latch, section, end,
)  # fmt: skip


def feature_scene(seed):
    """Return the scene of a seed."""
    r = random.Random(seed)
    k = Maker(r, r.choice([0.0, 0.0, 3.0, -2.0]), r.choice([1.0, 2.0, 3.0]))
    r.choices(BASES, [6, 4, 1, 5])[0](k)
    for _ in range(r.choice([1, 2, 3, 4, 5])):
        r.choice(DECORATIONS)(k, r.choice(k.movers))
    return k.scene(seed)
