"""Contacts: bounces beside smooth arcs and Moreau's time steps; a cradle, a pile."""

from __future__ import annotations

import math

from measure import Table, alternate, ms, ratio

BOUNCES = 10_000
FEWER = 1_000  # where each step is Moreau's
G = 9.81
FALL = math.sqrt(2.0 / G)  # from 1 m
SECONDS = 1.0
STEP = 1e-3

BALL = """
parameters: {{g: {g}}}
coordinates: {{y: {{}}}}
energy: {{kinetic: y_dot^2/2, potential: g*y}}
{more}
initial: {{y: 1}}
simulation: {{duration: {duration}, output_step: {duration}/100}}
"""
FLOOR = 'constraints: {floor: {relation: "y >= 0", restitution: 1}}'
# As often as the ball would strike, the force steps by next to nothing: an arc of the
# same length each.
STEPS = 'forces: {{y: "g + if(sin({rate}*t) > 0, 1e-3, -1e-3)"}}'


def session(text, **options):
    from lagsim.model.reader import read
    from lagsim.run.session import open_case

    model = read(text, "contacts.yaml")
    return open_case(model, model.settings(options)).ready()


def bouncing(count):
    return BALL.format(g=G, more=FLOOR, duration=2 * FALL * count)


def smooth(count):
    steps = STEPS.format(rate=math.pi / (2 * FALL))
    return BALL.format(g=G, more=steps, duration=2 * FALL * count)


def runs(of):
    """Return a function without arguments that runs a session once."""

    def whole():
        of.run([])

    return whole


def bounces(turns):
    """Measure the time of arcs that end at impacts, beside arcs without impacts."""
    chosen = {
        "bounces": session(bouncing(BOUNCES)),
        "arcs": session(smooth(BOUNCES)),
    }
    times = alternate({name: runs(s) for name, s in chosen.items()}, max(2, turns // 4))
    counted = {name: s.run([]) for name, s in chosen.items()}
    impacts = sum(e.kind == "impact" for e in counted["bounces"].events)
    rows = [
        [f"{impacts} bounces, each located", *ms(times["bounces"]), ""],
        [
            f"{counted['arcs'].statistics.arcs} smooth arcs of the same length",
            *ms(times["arcs"]),
            f"a bounce costs {ratio(times['bounces'], times['arcs'])}; goal under 5",
        ],
    ]
    head = ["a ball that bounces without loss", "least, ms", "median, ms", "times"]
    return Table("Contacts: a bounce and an arc", head, rows, [])


def error(of):
    """Return the largest error of the height over all rows."""
    from lagsim.run.observers import Keep

    keep = Keep()
    of.run([keep])
    worst = 0.0
    for row in keep.table:
        since = (row[0] + FALL) % (2 * FALL) - FALL
        worst = max(worst, abs(row[1] - 1.0 + G * since * since / 2.0))
    return worst


def accuracy(turns):
    """Measure time and error with located impacts, and with time stepping."""
    text = bouncing(FEWER)
    chosen = {
        f"located, rtol {rtol:g}": session(text, rtol=rtol)
        for rtol in (1e-3, 1e-7, 1e-11)
    }
    chosen |= {
        f"moreau, step {step:g}": session(text, method="moreau", step=step)
        for step in (1e-3, 1e-4, 1e-5)
    }
    times = alternate({name: runs(s) for name, s in chosen.items()}, max(2, turns // 4))
    rows = [[name, *ms(times[name]), f"{error(chosen[name]):.1e}"] for name in chosen]
    head = [f"{FEWER} bounces from 1 m", "least, ms", "median, ms", "largest error, m"]
    return Table("Contacts: time and error", head, rows, [])


def cradle(count):
    names = [f"x{k}" for k in range(count)]
    kinetic = " + ".join(f"{x}_dot^2/2" for x in names)
    touching = ", ".join(
        f'c{k}: {{relation: "x{k} >= x{k - 1} + 1", restitution: 1}}'
        for k in range(1, count)
    )
    places = ", ".join(f"x{k}: {k}" for k in range(count))
    return f"""
coordinates: {{{", ".join(f"{x}: {{}}" for x in names)}}}
energy: {{kinetic: {kinetic}, potential: "0"}}
constraints: {{{touching}}}
initial: {{{places}, x0_dot: 1}}
simulation: {{duration: {SECONDS}, output_step: 0.01}}
"""


def pile(count):
    names = [f"y{k}" for k in range(count)]
    kinetic = " + ".join(f"{y}_dot^2/2" for y in names)
    potential = " + ".join(f"{G}*{y}" for y in names)
    below = ["0", *(f"y{k} + 1" for k in range(count - 1))]
    touching = ", ".join(
        f'c{k}: {{relation: "y{k} >= {below[k]}", restitution: 0}}'
        for k in range(count)
    )
    places = ", ".join(f"y{k}: {k}" for k in range(count))
    return f"""
coordinates: {{{", ".join(f"{y}: {{}}" for y in names)}}}
energy: {{kinetic: {kinetic}, potential: {potential}}}
constraints: {{{touching}}}
initial: {{{places}}}
simulation: {{duration: {SECONDS}, output_step: 0.01}}
"""


def several(turns):
    """Measure scenes of many contacts, by located impacts and by time stepping."""
    rows = []
    for name, text in (
        ("a cradle of 20 balls", cradle(20)),
        ("a pile of 50 boxes at rest", pile(50)),
    ):
        chosen = {
            "located": session(text),
            f"moreau, step {STEP:g}": session(text, method="moreau", step=STEP),
        }
        calls = {way: runs(s) for way, s in chosen.items()}
        times = alternate(calls, max(2, turns // 8))
        for way, of in chosen.items():
            steps = of.run([]).statistics.steps
            rows.append([name, way, *ms(times[way]), str(steps)])
    head = [f"{SECONDS:g} s of motion", "", "least, ms", "median, ms", "steps"]
    return Table("Contacts: many at once", head, rows, [])


def tables(turns):
    yield bounces(turns)
    yield accuracy(turns)
    yield several(turns)
