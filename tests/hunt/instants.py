"""Random models with decisions at instants: nested switches, limits, events.

A model is made once, as trees: `flights` integrates the trees, and `told` writes these
for lagsim, in one of several spellings, from another origin, in other units, in another
order, beside a heavy body.
"""

from __future__ import annotations

import random
import zlib
from dataclasses import dataclass, field
from typing import Any

import yaml

from tests.hunt.flights import Event, Law, Model, Section
from tests.hunt.instants_run import Run
from tests.hunt.series import constant
from tests.hunt.trees import Reading, Table, Tree, number, plus, product, text

ROWS = 40
JUMPS = ("sign", "heaviside", "floor", "mod", "if")
KINKS = ("abs", "min", "max", "table")
METHODS = ("dop853", "radau", "taylor")


def var(name):
    return Tree("var", data=name)


@dataclass
class Words:
    """Form of a model for lagsim: coordinates x = length (far + q), times time t."""

    far: float = 0.0
    length: float = 1.0
    time: float = 1.0
    heavy: float = 0.0
    shuffled: bool = False
    named: bool = False
    method: str = ""

    @property
    def force(self):
        return self.length / self.time**2


@dataclass
class Maker:
    """Makes the trees of one model."""

    r: random.Random
    n: int
    variables: list[str] = field(default_factory=list)
    names: Any = field(default_factory=lambda: iter(range(10**6)))
    shown: dict[str, Tree] = field(default_factory=dict)
    tables: list[Table] = field(default_factory=list)

    def chance(self, part):
        return self.r.random() < part

    def some(self, low=-1.0, high=1.0):
        """Return a number, not 0: of few bits, so that sums of modes are exact."""
        x = round(64.0 * self.r.uniform(low, high)) / 64.0
        return x or 0.375

    def tree(self, kind, *args, data=None):
        return Tree(kind, args, data, self.r.randrange(12))

    def named(self, tree, part=0.3):
        """Return a tree, perhaps as a definition with a name."""
        if self.chance(part) and not tree.name and tree.kind not in ("var", "const"):
            tree.name = f"d{next(self.names)}"
            self.shown[tree.name] = tree
        return tree

    def variable(self, only=None):
        return var(self.r.choice(only or self.variables))

    def line(self, only=None):
        """Return a x + b."""
        x, r = self.variable(only), self.r
        a = r.choice([1.0, 1.0, 1.0, -1.0, 2.0, 0.5, self.some(0.3, 2)])
        x = x if a == 1.0 else product(number(a), x)
        if self.chance(0.6):
            x = plus(x, number(self.some(-2, 2)))
        return x

    def argument(self, depth, only=None):
        """Return the argument of a switch."""
        if depth <= 0 or self.chance(0.3):
            return self.line(only)
        inner = self.switch(depth - 1, only)
        way = self.r.random()
        if way < 0.35:
            return inner if inner.kind in ("mod", "table", "abs") else plus(
                inner, self.line(only))  # fmt: skip
        if way < 0.8:
            c = number(self.some(-2, 2))
            return plus(self.line(only), product(c, inner))
        return plus(inner, number(self.some(-1, 1)))

    def condition(self, depth, only=None):
        r = self.r
        if depth > 0 and self.chance(0.2):
            if self.chance(0.3):
                return self.tree("not", self.condition(depth - 1, only))
            kind = r.choice(["and", "or"])
            return self.tree(kind, self.condition(depth - 1, only),
                             self.condition(depth - 1, only))  # fmt: skip
        left = self.argument(depth, only)
        right = number(self.some(-1.5, 1.5))
        used = {x.data for x in left.nodes() if x.kind == "var"}
        others = [x for x in only or self.variables if x not in used]
        if others and self.chance(0.3):
            right = self.argument(depth - 1, others)
        return self.tree("compare", left, right, data=r.choice(["<", "<=", ">", ">="]))

    def relation(self, depth, only=None):
        """Return a condition for `at` or `until`: a single relation, <= or >=."""
        while True:
            made = self.condition(depth, only)
            names = {x.data[0] for x in made.nodes() if x.kind == "var"}
            if names & set("qvzu"):
                break
        if made.kind == "compare":
            made.data = made.data[0] + "="
            return made
        made = self.tree("if", made, number(1.0), number(0.0))
        return self.tree("compare", made, number(0.5), data=">=")

    def table(self):
        r = self.r
        kind = r.choice(["linear", "linear", "cubic"])
        outside = r.choice(["hold", "extend", "repeat"])
        count = r.randint(4, 7) if kind == "cubic" else r.randint(2, 6)
        if outside == "repeat":
            count = max(count, 3)
        x = sorted({round(8.0 * r.uniform(-3, 3)) / 8.0 for _ in range(count * 3)})
        x = sorted(r.sample(x, min(count, len(x))))
        y = [self.some(-1.5, 1.5) for _ in x]
        if outside == "repeat":
            y[-1] = y[0]
        found = Table(f"tab{len(self.tables)}", x, y, kind, outside)
        self.tables.append(found)
        return found

    def switch(self, depth, only=None, kinds=JUMPS + JUMPS + KINKS):
        """Return a node with cells; nested in its arguments to a depth."""
        kind = self.r.choice(kinds)
        if kind == "if":
            made = self.tree(
                "if", self.condition(depth, only), self.value(depth - 1, only),
                self.value(depth - 1, only),
            )  # fmt: skip
        elif kind in ("min", "max"):
            other = (number(self.some(-1, 1)) if self.chance(0.5)
                     else self.argument(depth - 1, only))  # fmt: skip
            made = self.tree(kind, self.argument(depth, only), other)
        elif kind == "mod":
            data = self.r.choice([1.0, 2.0, 1.5, self.some(0.7, 3)])
            made = self.tree(kind, self.argument(depth, only), data=data)
        elif kind == "table":
            made = self.tree(kind, self.argument(depth, only), data=self.table())
        else:
            made = self.tree(kind, self.argument(depth, only))
        return self.named(made)

    def value(self, depth, only=None):
        """Return a summand of a force: about 1 in size."""
        way = self.r.random()
        if depth <= 0 or way < 0.15:
            return number(self.some(-1.5, 1.5)) if way < 0.6 else product(
                number(self.some(-0.5, 0.5)), self.variable(only))  # fmt: skip
        made = product(number(self.some(-1.2, 1.2)), self.switch(depth, only))
        if self.chance(0.15):
            made = product(made, self.switch(depth - 1, only))
        if self.chance(0.1):
            w = number(self.some(0.5, 2))
            made = plus(made, self.tree("sin", product(w, self.variable(only))))
        return self.named(made, 0.15)

    def positive(self, depth, only=None):
        """Return a bound of a limit or a coefficient: at least 0.1, about 1."""
        if self.chance(0.25):
            return number(self.some(0.2, 1.5))
        x = self.tree("abs", self.switch(depth, only))
        x.form = self.r.choice([0, 1])
        return plus(number(self.some(0.1, 0.6)), product(number(self.some(0.2, 1)), x))


@dataclass
class Made:
    """A model, its form for lagsim, and the text of its file."""

    seed: str
    model: Model
    words: Words
    maker: Maker
    pushes: list[Any]
    floors: list[Any] = field(default_factory=list)
    grounds: list[Any] = field(default_factory=list)
    places: list[str] = field(default_factory=list)

    @property
    def step(self):
        return self.model.duration / ROWS

    def flights(self, nudge=None, forks=None):
        """Return a run; nudge : {forces or speeds: a part}, of a second motion."""
        model = self.model.nudged(**nudge) if nudge else self.model
        return Run(model, self.step, forks).made()


def made(seed):
    """Return the model of a seed."""
    r = random.Random(zlib.crc32(seed.encode()))
    n = r.choice([1, 1, 2, 2, 2, 3])
    k = Maker(r, n)
    q, v = [f"q{i + 1}" for i in range(n)], [f"v{i + 1}" for i in range(n)]
    # Mostly positions and the time: velocities give slides.
    k.variables = [*q, *q, *q, "t", "t", *(v if r.random() < 0.4 else [])]
    model = Model(
        masses=[1.0 if r.random() < 0.5 else k.some(0.4, 3) for _ in q],
        q=[r.choice([0.0, 0.0, k.some(-1, 1)]) for _ in q],
        v=[r.choice([1.0, 0.0, k.some(-2, 2), k.some(0.5, 2)]) for _ in q],
        forces=[[] for _ in q], duration=float(r.choice([3, 4, 5, 6])),
    )  # fmt: skip
    found = Made(seed, model, _words(r), k, [])
    # Of laws, events and sections most models have few, and some have several.
    law, event, section = r.choice(
        [(0.4, 0.45, 0.4), (0.9, 0.2, 0.2), (0.1, 1.0, 0.3), (0.2, 0.6, 1.0)]
    )
    if r.random() < event:
        _modes(k, model)
    if r.random() < 0.25:
        model.states["z1"] = k.some(-1, 1)
        k.variables += ["z1"]
    for i in range(n):
        if r.random() < 0.65:
            half = number(k.some(0.2, 2) / 2.0)
            x = var(q[i])
            model.potentials.append(product(half, product(x, x)))
    _places(k, found)
    if r.random() < law:
        _law(k, found)
    if model.modes:
        _events(k, model)
    if r.random() < section:
        _sections(k, model)
    if model.laws or (found.words.method == "taylor" and k.tables):
        found.words.method = found.words.method and "dop853"
    if r.random() < 0.12:
        model.until = k.relation(1)
    model.shown = k.shown
    return found


def _words(r):
    words = Words()
    if r.random() < 0.25:
        words.far = r.choice([10.0, 1e3, -1e4, 1e6])
    if r.random() < 0.25:
        words.length = r.choice([1e3, 1e-3, 2.5e6, 1e-9])
    if r.random() < 0.25:
        words.time = r.choice([1e3, 1e-6, 3.156e7])
    if r.random() < 0.2:
        words.heavy = r.choice([1e6, 1e12, 1e-9])
    words.shuffled = r.random() < 0.3
    words.named = r.random() < 0.3
    if r.random() < 0.2:
        words.method = r.choice(METHODS)
    return words


def _modes(k, model):
    for name in ("u1", "u2")[: k.r.choice([1, 1, 2])]:
        model.modes[name] = float(k.r.choice([0, 1, k.some(-1, 1)]))
    k.variables += [*model.modes, *model.modes]


def _places(k, found):
    """Insert switched expressions as forces, energies and rates."""
    r, model = k.r, found.model
    for _ in range(r.choice([1, 1, 2, 3])):
        depth = r.choice([1, 1, 2, 2, 3])
        place = r.choice(["force"] * 4 + ["definition", "potential", "dissipation"])
        found.places.append(place)
        if place == "force":
            i = r.randrange(k.n)
            tree = k.value(depth)
            model.forces[i].append(tree)
            found.pushes.append(([float(j == i) for j in range(k.n)], tree))
        elif place == "definition":
            row = [k.some(-1, 1) for _ in range(k.n)]
            tree = k.value(depth)
            for i, c in enumerate(row):
                model.forces[i].append(product(number(c), tree))
            found.pushes.append((row, tree))
        elif place == "potential":
            only = [f"q{i + 1}" for i in range(k.n)]
            kinks = KINKS if r.random() < 0.7 else (*KINKS, "mod")
            tree = k.switch(r.choice([0, 1]), only, kinks)
            model.potentials.append(product(number(k.some(0.2, 1)), tree))
        else:
            v = var(f"v{r.randrange(k.n) + 1}")
            c = k.positive(depth - 1, [x for x in k.variables if x[0] in "qt"])
            model.dissipations.append(product(c, product(v, v)))
    for z in model.states:
        tree = plus(k.value(2), product(number(-0.5), var(z)))
        model.rates[z] = tree


def _law(k, found):
    r, model = k.r, found.model
    i = r.randrange(k.n)
    row = [float(j == i) for j in range(k.n)]
    if k.n > 1 and r.random() < 0.3:
        row[(i + 1) % k.n] = -1.0
    kind = r.choice(
        ["limit", "limit", "floor", "contact", "contact", "hold", "groove", "ridge"]
    )
    if kind in ("groove", "ridge") and k.n > 1:
        return (_groove if kind == "groove" else _ridge)(k, found)
    if kind == "hold" and (not model.modes or k.n == 1):
        kind = "contact"
    if kind == "contact":
        return _wall(k, model, row)
    if kind == "hold":
        u = var(r.choice(list(model.modes)))
        when = k.tree("compare", u, number(k.some(-1, 1)), data=">")
        if r.random() < 0.3:
            when = k.tree("compare", var("t"), number(k.some(0.5, 3)),
                          data=r.choice("<>"))  # fmt: skip
        row, other = [0.0] * k.n, (i + 1) % k.n
        row[i], row[other] = 1.0, -1.0
        belt = number(k.some(-1, 1)) if r.random() < 0.3 else None
        x = constant(model.modes.get(u.data, 0.0))
        if Reading({u.data: x, "t": constant(0.0)}, {}).value(when):
            # In force at the start, so met there.
            model.v[other] = model.v[i] - (belt.data if belt else 0.0)
        model.laws.append(Law("hold", row, belt=belt, when=when, name="clutch"))
        return None
    only = [x for x in k.variables if x[0] in "qtuz"]
    bound, static = k.positive(r.choice([0, 1, 2]), only), None
    if r.random() < 0.25:
        static = k.positive(1, only)
        static = plus(bound, product(number(k.some(0.1, 1)), static))
    law = Law("limit", row, bound=bound, static=static, name="rub")
    if kind == "floor":
        law.row = [float(j == i) for j in range(k.n)]
        weight = k.some(0.5, 3)
        found.floors.append((law, weight))
        law.bound = product(number(weight), bound)
        law.static = product(number(weight), static) if static else None
        found.floors[-1] += (bound, static, i)
    model.laws.append(law)
    return None


def _wall(k, model, row):
    """Add a contact with a wall, or between two bodies."""
    r = k.r
    row = [r.choice([1.0, -1.0]) * c for c in row]
    at = sum(c * x for c, x in zip(row, model.q, strict=True))
    e = r.choice([number(0.0), number(1.0), number(0.5), number(k.some(0.2, 0.9))])
    if r.random() < 0.3:
        fast = k.tree("compare", var("approach_speed"), number(k.some(0.3, 1.5)),
                      data=r.choice("<>"))  # fmt: skip
        e = k.tree("if", fast, number(k.some(0.2, 0.9)), number(k.some(0.2, 0.9)))
    where = at - abs(k.some(0.1, 1.5))
    model.laws.append(Law("contact", row, where=where, e=e, name="wall"))


def _groove(k, found):
    """Add a ground y >= max of lines of x, under weight: a contact for each line."""
    r, model = k.r, found.model
    i, j = r.sample(range(k.n), 2)
    corner, low = k.some(-1, 1), k.some(-0.5, 0.5)
    left, right = -abs(k.some(0.1, 1.2)), abs(k.some(0.1, 1.2))
    if r.random() < 0.3:
        left = -right
    e = number(r.choice([0.0, 0.0, 0.5, 0.8, k.some(0.1, 0.7)]))
    for slope in (left, right):
        row = [0.0] * k.n
        row[i], row[j] = -slope, 1.0
        where = low - slope * corner
        model.laws.append(Law("contact", row, where=where, e=e, name="groove"))
    d = model.q[i] - corner
    model.q[j] = round(low + max(left * d, right * d) + abs(k.some(0.1, 1)), 3)
    weight = number(model.masses[j] * k.some(1, 4))
    model.potentials.append(product(weight, var(f"q{j + 1}")))
    x = plus(var(f"q{i + 1}"), number(-corner))
    if left == -right:
        ground = product(number(right), k.tree("abs", x))
    elif r.random() < 0.3:
        points = [corner - 2.0, corner, corner + 3.0]
        y = [-2.0 * left, 0.0, 3.0 * right]
        table = Table("ground", points, y, "linear", "extend")
        k.tables.append(table)
        ground = k.tree("table", var(f"q{i + 1}"), data=table)
    else:
        ground = k.tree("max", product(number(left), x), product(number(right), x))
    found.grounds = [(j, plus(ground, number(low)), e)]


def _ridge(k, found):
    """Add a ground y >= min of lines of x, or a wire with corners."""
    r, model = k.r, found.model
    i, j = r.sample(range(k.n), 2)
    x, low = var(f"q{i + 1}"), number(k.some(-0.5, 0.5))
    if r.random() < 0.4:
        steep = number(-abs(k.some(0.1, 1.2)))
        bump = k.tree("abs", plus(x, number(k.some(-1, 1))))
        height = plus(low, product(steep, bump))
    elif r.random() < 0.5:
        lines = [k.line([f"q{i + 1}"]) for _ in range(2)]
        height = plus(low, k.tree("min", *lines))
    else:
        at = sorted({round(8.0 * k.some(-2, 2)) / 8.0 for _ in range(4)} | {-2.5, 2.5})
        slopes = sorted((k.some(-1, 1) for _ in at[1:]), reverse=True)
        y = [0.0]
        for a, b, c in zip(at, at[1:], slopes, strict=False):
            y.append(y[-1] + c * (b - a))
        table = Table("ground", at, y, "linear", "extend")
        k.tables.append(table)
        height = plus(low, k.tree("table", x, data=table))
    row = [float(c == j) for c in range(k.n)]
    e = number(r.choice([0.0, 0.0, 0.5, 0.8, k.some(0.1, 0.7)]))
    series = {f"q{c + 1}": constant(q) for c, q in enumerate(model.q)}
    at = float(Reading(series, {}, lambda _r, _t, _p, _l, high: high).value(height)[0])
    wire = r.random() < 0.4
    if wire:
        if r.random() < 0.5:
            height, at = product(number(-1.0), height), -at
        law = Law("hold", row, height=height, name="wire")
        model.q[j] = at
        slope = Reading(series, {}, lambda _r, _t, _p, _l, high: high).slope(
            height, f"q{i + 1}"
        )
        model.v[j] = float(slope[0]) * model.v[i]
    else:
        law = Law("contact", row, height=height, e=e, name="ridge")
        model.q[j] = round(at + abs(k.some(0.1, 1)), 3)
    weight = number(model.masses[j] * k.some(1, 4))
    model.potentials.append(product(weight, var(f"q{j + 1}")))
    model.laws.append(law)
    found.grounds = [(j, height, e)]


def _events(k, model):
    r, modes = k.r, list(model.modes)

    def act(u):
        way = r.random()
        if way < 0.35:
            return plus(number(1.0), product(number(-1.0), var(u)))
        if way < 0.55:
            return plus(var(u), number(k.some(-0.5, 0.5)))
        if way < 0.75:
            return number(k.some(-1, 1))
        return k.value(1)

    def sets():
        return [(u, act(u)) for u in r.sample(modes, r.choice([1, len(modes)]))]

    moving = [x for x in k.variables if x != "t"]
    for j in range(r.choice([1, 1, 2, 2, 3])):
        once = r.random() < 0.12
        model.events += _event(k, f"e{j}", once, sets, moving)
    if len(model.events) > 1 and r.random() < 0.4:
        r.shuffle(model.events)


def _event(k, name, once, sets, moving):
    """Return an event, or two of one condition or of opposite ones."""
    r, way = k.r, k.r.random()
    if way < 0.3:
        period = r.choice([0.5, 0.25, 1.0, k.some(0.2, 2)])
        return [Event(name, every=period, once=once, sets=sets())]
    if way < 0.4:
        return [Event(name, equal=k.line(moving), once=once, sets=sets())]
    if way < 0.55:
        x, c = k.argument(1, moving), number(k.some(-0.8, 0.8))
        up, down = (k.tree("compare", x, c, data=sign) for sign in (">=", "<="))
        return [
            Event(name, at=up, once=once, sets=sets()),
            Event(name + "b", at=down, sets=sets()),
        ]
    at = k.relation(r.choice([0, 1, 1, 2]), [*moving, *k.variables])
    found = [Event(name, at=at, once=once, sets=sets())]
    if r.random() < 0.25:
        found.append(Event(name + "b", at=at, sets=sets()))
    return found


def _sections(k, model):
    r = k.r
    for j in range(r.choice([1, 1, 2])):
        way = r.random()
        if way < 0.25:
            period = r.choice([0.5, k.some(0.3, 1.5)])
            model.sections.append(Section(f"s{j}", every=period))
            continue
        shared = [e.at for e in model.events if e.at is not None
                  and e.at.kind == "compare"]  # fmt: skip
        if way < 0.4 and shared:
            e = r.choice(shared)
            line = plus(e.args[0], product(number(-1.0), e.args[1]))
        elif way < 0.75:
            line = k.line()
        else:
            line = plus(k.argument(2), number(k.some(-1, 1)))
        if not {x.data[0] for x in line.nodes() if x.kind == "var"} & set("qvz"):
            line = plus(line, var("q1"))
        side = r.choice(["up", "down", "both"])
        model.sections.append(Section(f"s{j}", at=line, direction=side))


# --- the file for lagsim --------------------------------------------------------------


def written(made):
    """Return the model file of a model."""
    m, w = made.model, made.words
    names, document = _names(made)
    defined: dict[str, str] = {}

    def told(tree):
        return text(tree, names, defined)

    x = [f"x{i + 1}" for i in range(m.n)]
    kinetic = " + ".join(
        f"{mass!r}*{name}_dot^2/2" for mass, name in zip(m.masses, x, strict=True)
    )
    document["coordinates"] = {name: {} for name in x}
    document["initial"] = {
        name: w.length * (w.far + q) for name, q in zip(x, m.q, strict=True)
    } | {
        f"{name}_dot": w.length / w.time * v for name, v in zip(x, m.v, strict=True)
    }  # fmt: skip
    if w.heavy:
        document["coordinates"]["by"] = {}
        document["initial"] |= {"by": 0, "by_dot": w.length / w.time}
        kinetic += f" + {w.heavy!r}*by_dot^2/2"
    energy = w.force * w.length
    terms = [f"{energy!r}*({told(v)})" for v in m.potentials]
    document["energy"] = {"kinetic": kinetic, "potential": " + ".join(terms) or "0"}
    if m.dissipations:
        power = energy / w.time
        document["energy"]["dissipation"] = " + ".join(
            f"{power!r}*({told(tree)})" for tree in m.dissipations
        )
    _forces(made, document, told)
    _laws(made, document, told)
    if m.states:
        document["states"] = {
            z: {"rate": f"({told(m.rates[z])})/{w.time!r}"} for z in m.states
        }
        document["initial"] |= m.states
    _instants(made, document, told)
    for tree in made.maker.shown.values():
        told(tree)
    document["definitions"] |= {k: v for k, v in defined.items() if v}
    if not document["definitions"]:
        del document["definitions"]
    body = str(document) + (told(m.until) if m.until else "")
    tables = {
        t.name: {
            "points": [list(p) for p in zip(t.x, t.y, strict=True)],
            "interpolation": t.kind, "outside": t.outside,
        }
        for t in made.maker.tables
        if f"{t.name}(" in body
    }  # fmt: skip
    if tables:
        document["tables"] = tables
    document["simulation"] = {
        "duration": m.duration * w.time, "output_step": made.step * w.time,
    }  # fmt: skip
    if w.method:
        document["simulation"]["method"] = w.method
    if m.until is not None:
        document["simulation"]["until"] = told(m.until)
    return _file(made, document)


def _names(made):
    m, w = made.model, made.words
    names: dict[str, str] = {u: u for u in (*m.modes, *m.states)}
    names["approach_speed"] = (
        "approach_speed" if w.length == w.time == 1.0
        else f"(approach_speed*{w.time / w.length!r})"
    )  # fmt: skip
    names["t"] = "t" if w.time == 1.0 else f"(t/{w.time!r})"
    definitions: dict[str, str] = {}
    for i in range(1, m.n + 1):
        q, v = f"x{i}", f"x{i}_dot"
        if w.far:
            q = f"({q} - ({w.far * w.length!r}))"
        if w.length != 1.0:
            q = f"({q}/{w.length!r})"
        if w.length != 1.0 or w.time != 1.0:
            v = f"({v}*{w.time / w.length!r})"
        if w.named:
            definitions[f"q{i}"], q = q, f"q{i}"
        names |= {f"q{i}": q, f"v{i}": v}
    return names, {"definitions": definitions}


def _forces(made, document, told):
    w, forces = made.words, {}
    for j, (row, tree) in enumerate(made.pushes):
        push = f"{w.force!r}*({told(tree)})" if w.force != 1.0 else told(tree)
        if sum(map(abs, row)) == 1.0 and 1.0 in row:
            name = f"x{row.index(1.0) + 1}"
            forces[name] = f"{forces[name]} + {push}" if name in forces else push
            continue
        at = " + ".join(f"({c!r})*x{i + 1}" for i, c in enumerate(row) if c)
        document["definitions"][f"p{j}"] = at
        forces[f"p{j}"] = push
    if forces:
        document["forces"] = forces


def _laws(made, document, told):
    m, w, rows = made.model, made.words, {}
    floors = {id(f[0]): f[1:] for f in made.floors}

    def scaled(tree):
        return f"{w.force!r}*({told(tree)})" if w.force != 1.0 else told(tree)

    def sizes(bound, static, of):
        if static is None:
            return of(bound)
        return {"static": of(static), "dynamic": of(bound)}

    for law in m.laws:
        rate = " + ".join(
            f"({c!r})*x{i + 1}_dot" for i, c in enumerate(law.row) if c
        )  # fmt: skip
        if id(law) in floors:
            weight, bound, static, i = floors[id(law)]
            document["coordinates"]["y"] = {}
            document["initial"]["y"] = 0
            document["energy"]["kinetic"] += " + y_dot^2/2"
            document["energy"]["potential"] += f" + {weight * w.force!r}*y"
            rows[law.name] = {
                "relation": "y >= 0", "restitution": 0, "slip": f"x{i + 1}_dot",
                "friction": sizes(bound, static, told),
            }  # fmt: skip
        elif made.grounds:
            rows[law.name] = _ground(made, law, told)
        elif law.kind == "limit":
            rows[law.name] = {
                "relation": f"{rate} = 0", "limit": sizes(law.bound, law.static, scaled)
            }  # fmt: skip
        elif law.kind == "hold":
            belt = law.belt.data * w.length / w.time if law.belt else 0.0
            rows[law.name] = {"relation": f"{rate} = {belt!r}", "when": told(law.when)}
        else:
            place = " + ".join(
                f"({c!r})*(x{i + 1} - ({w.far * w.length!r}))"
                for i, c in enumerate(law.row)
                if c
            )
            where = law.where * w.length
            rows[law.name] = {
                "relation": f"{place} >= {where!r}", "restitution": told(law.e)
            }  # fmt: skip
    if rows:
        document["constraints"] = rows


def _ground(made, law, told):
    """Return the entry of a ground with corners, or of a wire."""
    w, (j, ground, e) = made.words, made.grounds[0]
    sign = "=" if law.kind == "hold" else ">="
    height = f"{w.far * w.length!r} + {w.length!r}*({told(ground)})"
    entry = {"relation": f"x{j + 1} {sign} {height}"}
    return entry if law.kind == "hold" else entry | {"restitution": told(e)}


def _instants(made, document, told):
    m, w = made.model, made.words
    if m.modes:
        document["modes"] = dict(m.modes)
    events = {}
    for e in m.events:
        entry: dict[str, Any] = {"set": {u: told(tree) for u, tree in e.sets}}
        if e.every:
            entry["every"] = e.every * w.time
        elif e.equal is not None:
            entry["at"] = f"{told(e.equal)} = 0"
        else:
            entry["at"] = told(e.at)
        if e.once:
            entry["once"] = True
        events[e.name] = entry
    if events:
        document["events"] = events
    cuts = {}
    for s in m.sections:
        if s.every:
            cuts[s.name] = {"every": s.every * w.time}
        else:
            cuts[s.name] = {"at": f"{told(s.at)} = 0", "direction": s.direction}
    if cuts:
        document["output"] = {"sections": cuts}


def _file(made, document):
    r = random.Random(made.seed)
    if made.words.shuffled:
        for key in ("definitions", "coordinates", "constraints", "forces", "tables"):
            if key in document:
                pairs = list(document[key].items())
                r.shuffle(pairs)
                document[key] = dict(pairs)
        pairs = list(document.items())
        r.shuffle(pairs)
        document = dict(pairs)
    body = yaml.safe_dump(document, sort_keys=False, width=10**6)
    return f"# hunt: {made.seed}\nname: scene\n{body}"
