"""Pictures of docs/failing.md, which `regenerate.py` writes.

Each function makes one, docs/failing/NAME.png, by running the models of models/failing
with the methods that fail and with the choice of `auto`: a minute for all.
"""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.failing_chart import EXACT, FAILS, HOLDS, MORE, OTHER, View, draw
from lagsim.methods import dop853
from lagsim.model.reader import read_file
from lagsim.native.kernels import keys
from lagsim.native.link import cache
from lagsim.run.arcs import Run
from lagsim.run.observers import Keep
from lagsim.run.session import open_case

ROOT = Path(__file__).resolve().parent.parent
MODELS = ROOT / "models" / "failing"


class Motion:
    """The rows of a run; `motion["x"]` is a column."""

    def __init__(self, name, sets=None, **options):
        options = {key: str(value) for key, value in options.items()}
        sets = {key: str(value) for key, value in (sets or {}).items()}
        model = read_file(str(MODELS / f"{name}.yaml"), sets, options)
        self.session = open_case(model).ready()
        self.case, self.system = self.session.case, self.session.system
        self.kept = Keep()

    def whole(self):
        """Integrate the motion; return this object."""
        with np.errstate(all="ignore"):
            self.trajectory = self.session.run([self.kept])
        return self

    def __getitem__(self, name):
        return self.kept.table[:, self.system.columns.names.index(name)]

    @property
    def evaluations(self):
        """Return the number of evaluations of y' in the run."""
        return self.trajectory.statistics.evaluations

    def steps(self, most):
        """Return the first steps: times, lengths, rejections, evaluations (4, steps).

        The rejections and evaluations are counted from the start of the run.

        most : the largest number of steps.
        """
        run = Run(self.session.first_arc(), [])
        run.begin()
        run.arc.state.pause_at = 0.0  # go on at the bound
        found, s = [], run.arc.state
        while len(found) < most and run.t < self.case.settings.end:
            run.arc.advance(len(run.arc.runner.block), 1)
            found.append((s.t, s.step_h, s.rejections, s.evaluations))
        return np.array(found).T


def run(name, sets=None, **options):
    """Run a model of models/failing; return its `Motion`.

    sets : values of parameters.
    options : settings of the run.
    """
    return Motion(name, sets, **options).whole()


@contextmanager
def constants(module, **values):
    """Context manager: kernels are compiled with other constants of their module."""
    before = {name: getattr(module, name) for name in values}
    try:
        for name, value in values.items():
            setattr(module, name, value)
        cache._digests = keys.Digests()  # noqa: SLF001  # of kernels with other constants
        yield
    finally:
        for name, value in before.items():
            setattr(module, name, value)
        cache._digests = keys.Digests()  # noqa: SLF001


def oscillator():
    spiral = run("oscillator", method="euler", step=0.1, duration=40, output_step=0.1)
    t = np.linspace(0.0, 2.0 * np.pi, 200)
    plane = View("Euler, h = 0.1: a spiral", "x", "x_dot", square=True)
    plane.add("euler", spiral["x"], spiral["x_dot"], FAILS)
    plane.add("exact", np.cos(t), -np.sin(t), EXACT)
    energy = View("RK4: the energy, by h", "t", "E / E(0)", log_y=True)
    for step, pen in ((2.9, FAILS), (1.0, MORE)):
        found = run("oscillator", method="rk4", step=step, output_step=10)
        energy.add(f"{step}", found["t"], found["energy"] / 0.5, pen)
    auto = run("oscillator", output_step=10)
    energy.add("auto", auto["t"], auto["energy"] / 0.5, HOLDS)
    return draw(plane, energy)


def verlet():
    past = View("Verlet about its bound, h = 2", "t", "|x|", log_y=True)
    for step, pen in ((2.01, FAILS), (1.99, HOLDS)):
        found = run(
            "oscillator", method="verlet", step=step, output_step=step,
            duration=400 * step,
        )  # fmt: skip
        past.add(f"h = {step}", found["t"], np.abs(found["x"]) + 1e-3, pen)
    well = View("Cubic well: the amplitude from 0.02", "t", "amplitude")
    for step, pen, name in ((3**0.5, FAILS, "h = √3"), (1.6, HOLDS, "h = 1.6")):
        found = run(
            "cubic-well", method="verlet", step=step, output_step=3 * step, duration=128
        )
        size = np.hypot(found["x"], found["x_dot"])
        inside = size < 1.0
        well.add(name, found["t"][inside], size[inside], pen)
    return draw(past, well)


def drift():
    view = View(
        "RK4, h = 0.01: by how much the rod has grown", "t", "|g|",
        log_x=True, log_y=True,
    )  # fmt: skip
    for name, options, pen in (
        ("drift", {}, FAILS),
        ("baumgarte, gain 10", {"gain": 10}, OTHER),
        ("projection", {}, HOLDS),
    ):
        found = run(
            "rod", method="rk4", step=0.01, formulation=name.split(",")[0], **options
        )
        worst = np.maximum.accumulate(np.abs(found["residual_rod"]))
        late = found["t"] >= 0.5
        view.add(name, found["t"][late], np.maximum(worst[late], 1e-17), pen)
    t = np.array([2.0, 80.0])
    view.add("t squared", t, 2.3e-3 * (t / 80.0) ** 2 * 3.0, EXACT)
    return draw(view)


def baumgarte():
    view = View(
        "DOP853 at 1e-8: what a gain costs", "gain (1/s)", "evaluations in 1 s",
        log_x=True, log_y=True, marks=True,
    )  # fmt: skip
    gains = 10.0 ** np.arange(0, 5.5, 0.5)
    options = {"method": "dop853", "rtol": 1e-8, "duration": 1}
    costs = [
        run("rod", formulation="baumgarte", gain=gain, **options).evaluations
        for gain in gains
    ]
    view.add("baumgarte", gains, costs, FAILS)
    projected = run("rod", formulation="projection", **options).evaluations
    view.add("projection", gains, np.full(len(gains), projected), HOLDS)
    return draw(view)


def bdf():
    radau = Motion("stiff-spring", method="radau", rtol=1e-4, atol=1e-10, duration=1)
    t, h, _, evaluations = radau.steps(10_000)
    derivative = radau.system.link("radau").function("derivative")
    radau.system.link("radau").prepare()
    seen = []

    def rate(time, y):
        seen.append(time)
        return derivative(time, y)[:4]

    start = np.concatenate([radau.case.start.q, radau.case.start.v])
    solution = solve_ivp(rate, (0.0, 0.3), start, method="BDF", rtol=1e-4, atol=1e-10)
    steps = View("The step that each chooses", "t", "h", log_y=True)
    steps.add("BDF", solution.t[1:], np.diff(solution.t), FAILS)
    steps.add("radau", t, h, HOLDS)
    work = View("Evaluations so far", "t", "evaluations", log_y=True)
    work.add("BDF", np.array(seen[::50]), np.arange(1, len(seen) + 1)[::50], FAILS)
    work.add("radau", t, evaluations, HOLDS)
    return draw(steps, work)


def damping():
    view = View("Energy of a vibration that nothing damps", "t", "vibration (J)")
    for name, options, pen in (
        ("radau at 1e-2", {"method": "radau", "rtol": 1e-2}, FAILS),
        ("generalized-alpha, h = 1e-4",
         {"method": "generalized-alpha", "step": 1e-4}, MORE),
        ("auto", {"rtol": 1e-9}, HOLDS),
    ):  # fmt: skip
        found = run("stiff-spring", {"l0": 1e-4}, output_step=0.005, **options)
        view.add(name, found["t"], found["vibration"], pen)
    return draw(view)


def bound():
    steps = View("The step, at the stability bound", "t", "h")
    count = View("Rejections so far", "t", "rejections")
    options = {"method": "dop853", "rtol": 1e-4}
    for name, values, pen in (
        ("without PI control", {"beta": 0.0, "exponent": 0.125}, FAILS),
        ("with", {}, HOLDS),
    ):
        pair = dop853.PAIR._replace(**values)
        with constants(dop853, PAIR=pair):
            t, h, rejections, _ = Motion("stiff-spring", **options).steps(4000)
        some = slice(1500, 1580)
        if values:
            steps.add(name, t[some], h[some], pen)
            steps.add("bound", t[some], np.full(80, 5.96e-4), EXACT)
        count.add(name, t, rejections, pen)
    return draw(steps, count)


def taylor():
    motion = Motion("symmetric-start")
    runner = motion.system.link("taylor")
    runner.prepare()
    size = motion.system.size
    y = np.concatenate([motion.case.start.q, motion.case.start.v])
    found = runner.function("series", 1 + 41 * size)(0.0, y)
    order = int(found[0])
    series = found[1 : 1 + (order + 1) * size].reshape(order + 1, size)
    k = np.arange(order + 1)
    view = View(
        f"The series of a at the start: coefficients to order {order} that are not 0",
        "k", "|a_k|", log_y=True, marks=True,
    )  # fmt: skip
    size_of = np.abs(series[:, 0])
    size_of[size_of < 1e-9 * np.max(size_of)] = np.nan
    view.add("", k, size_of, FAILS)
    return draw(view)


def chaos():
    loose = run("chaos", rtol=1e-11)
    tight = run("chaos", rtol=1e-13)
    motion = View("Two tolerances, one start", "t", "theta1 (rad)")
    motion.add("rtol 1e-11", loose["t"], loose["theta1"], FAILS)
    motion.add("rtol 1e-13", tight["t"], tight["theta1"], HOLDS)
    apart = View("How far they are apart", "t", "difference (rad)", log_y=True)
    difference = np.abs(loose["theta1"] - tight["theta1"])
    late = loose["t"] > 0.5
    apart.add("", loose["t"][late], np.maximum(difference[late], 1e-13), FAILS)
    return draw(motion, apart)


def polar():
    misses = 10.0 ** -np.arange(1.0, 7.5, 0.5)
    path = View("The direction as the pole is passed", "t", "phi (rad)")
    for miss, pen in ((1e-1, OTHER), (1e-3, FAILS)):
        found = run("polar-miss", {"miss": miss}, duration=5)
        path.add(f"miss {miss:g}", found["t"], found["phi"], pen)
    cost = View(
        "DOP853 at 1e-9", "miss", "evaluations", log_x=True, marks=True,
    )  # fmt: skip
    options = {"method": "dop853", "rtol": 1e-9}
    counts = [run("polar-miss", {"miss": m}, **options).evaluations for m in misses]
    cost.add("polar-miss", misses, counts, FAILS)
    counts = [run("gimbal", {"push": m}, **options).evaluations for m in misses]
    cost.add("gimbal (push)", misses, counts, OTHER)
    return draw(path, cost)


def gimbal():
    found = run("sleeping-top")
    view = View("Euler's angles of a top near the upright", "t", "angle (rad)")
    view.add("phi", found["t"], found["phi"], FAILS)
    view.add("psi", found["t"], found["psi"], OTHER)
    view.add("phi + psi", found["t"], found["phi"] + found["psi"], HOLDS)
    tilt = View("The tilt", "t", "theta (rad)")
    tilt.add("", found["t"], found["theta"], HOLDS)
    return draw(view, tilt)


def rank():
    found = run("parallelogram", duration=6, output_step=0.002)
    t = found["t"]
    view = View("Multipliers near collinear positions", "t", "lambda (N)")
    lam = found["lambda_left_x"]
    view.add("left_x", t, np.clip(lam, -30, 30), FAILS)
    view.add("right_x", t, np.clip(found["lambda_right_x"], -30, 30), MORE)
    force = View("The force that they make", "t", "force (N)")
    force.add("Qc of a", t, found["Qc_a"], HOLDS)
    force.add("Qc of b", t, found["Qc_b"], OTHER)
    return draw(view, force)


def pulse():
    def rate(t, y):
        return [y[1], -y[0] + 1000.0 * (50.0 < t < 50.001)]

    blind = solve_ivp(
        rate, (0.0, 100.0), [0.0, 0.0], method="DOP853", rtol=1e-8,
        dense_output=True,
    )  # fmt: skip
    found = run("pulse")
    view = View("A push of 1 ms at t = 50", "t", "x (m)")
    view.add("located", found["t"], found["x"], HOLDS)
    view.add("stepped over", found["t"], blind.sol(found["t"])[0], FAILS)
    return draw(view)


def jumps():
    seen = []

    def rate(t, y):
        seen.append(t)
        return [y[1], np.sign(np.sin(t)) - y[0]]

    solve_ivp(rate, (0.0, 60.0), [0.0, 0.0], method="DOP853", rtol=1e-10, atol=1e-10)
    found = run("square-wave", method="dop853", rtol=1e-10)
    motion = View("The motion", "t", "x (m)")
    motion.add("", found["t"], found["x"], HOLDS)
    work = View("Evaluations so far", "t", "evaluations")
    work.add("not located", np.maximum.accumulate(seen), range(len(seen)), FAILS)
    ends = [
        run("square-wave", method="dop853", rtol=1e-10, duration=T).evaluations
        for T in range(4, 61, 4)
    ]
    work.add("located", range(4, 61, 4), ends, HOLDS)
    return draw(motion, work)


def zeno():
    g, e = 9.81, 0.8

    def gap(_t, y):
        return y[0]

    gap.terminal, gap.direction = True, -1
    t, y, times = 0.0, [1.0, 0.0], []
    while len(times) < 100:
        flight = solve_ivp(
            lambda _t, y: [y[1], -g], (t, 5.0), y, events=gap, rtol=1e-10, atol=1e-12
        )
        t, y = flight.t[-1], [0.0, -e * flight.y[1, -1]]
        times.append(t)
    found = run("../bouncing-ball")
    fall = View("The ball", "t", "y (m)")
    fall.add("", found["t"], found["y"], HOLDS)
    count = View("Impacts so far", "t", "impacts")
    count.add("one by one", [0.0, *times], range(len(times) + 1), FAILS)
    events = [x for x in found.trajectory.events if x.kind == "impact"]
    told = [0.0, *(x.time for x in events), found.trajectory.end]
    count.add("lagsim", told, [*range(len(events) + 1), len(events)], HOLDS)
    return draw(fall, count)


def graze():
    R, depths = 1.0, 10.0 ** -np.arange(1.0, 11.0)

    def blind(depth):
        """Return the deflection if contact is tested at ends of steps of 0.07 only.

        depth : of the path below the surface.
        """

        def gap(_t, y):
            return np.hypot(y[0], y[1]) - R

        gap.terminal = True
        start = [-10.0, R - depth, 1.0, 0.0]
        flight = solve_ivp(
            lambda _t, y: [y[2], y[3], 0.0, 0.0], (0.0, 30.0), start, method="DOP853",
            events=gap, max_step=0.07,
        )  # fmt: skip
        return 2.0 * np.arccos(1.0 - depth) if flight.status == 1 else 0.0

    found = run("graze")
    path = View("Grazed by 1e-8", "x (m)", "off its way (m)")
    path.add("located", found["x"], found["aside"], HOLDS)
    path.add("missed", found["x"], np.zeros(len(found["x"])), FAILS)
    angles = View("The deflection", "depth (m)", "angle (rad)", log_x=True, log_y=True)
    located = [run("graze", {"depth": d})["y_dot"][-1] for d in depths]
    angles.add("located", depths, np.arcsin(located), HOLDS)
    angles.add("at ends of steps", depths, [blind(d) for d in depths], FAILS)
    return draw(path, angles)


def balls():
    views = []
    for gap, title in ((0.0, "Two that touch"), (1e-6, "A micrometre apart")):
        found = run("balls-in-a-row", {"gap": gap})
        view = View(title, "t", "x (m)")
        for x, pen in (("x1", MORE), ("x2", OTHER), ("x3", HOLDS)):
            view.add(x, found["t"], found[x], pen)
        views.append(view)
    return draw(*views)


def falling(t, e=0.8, g=9.81):
    """Return the heights of the ball of bouncing-ball.yaml at the times `t`."""
    start, v = np.sqrt(2.0 / g), e * np.sqrt(2.0 * g)
    y = np.where(t < start, 1.0 - g * t**2 / 2.0, 0.0)
    while v > 1e-12:
        s, length = t - start, 2.0 * v / g
        y = np.where((s >= 0.0) & (s < length), v * s - g * s**2 / 2.0, y)
        start, v = start + length, e * v
    return y


def moreau():
    options = {"duration": 3, "output_step": 0.01, "method": "moreau"}
    ball = View("The ball, h = 0.03", "t", "y (m)")
    for name, given, pen in (
        ("moreau", options | {"step": 0.03}, FAILS), ("auto", {"duration": 3}, HOLDS)
    ):  # fmt: skip
        found = run("../bouncing-ball", **given)
        ball.add(name, found["t"], found["y"], pen)
    far = View(
        "Largest error in 3 s", "h", "error (m)", log_x=True, log_y=True,
    )  # fmt: skip
    steps = 10.0 ** -np.arange(1.5, 5.01, 0.25)
    errors = []
    for step in steps:
        found = run("../bouncing-ball", step=step, **options)
        errors.append(np.max(np.abs(found["y"] - falling(found["t"]))))
    far.add("moreau", steps, errors, FAILS)
    far.add("8 h", steps, 8.0 * steps, EXACT)
    return draw(ball, far)


def speed():
    found = run("constant-speed")
    path = View("The path", "x (m)", "y (m)", square=True)
    path.add("", found["x"], found["y"], HOLDS)
    energy = View("Energy E and work W", "t", "energy (J)")
    energy.add("E", found["t"], found["energy"], FAILS)
    energy.add("W", found["t"], found["work"], OTHER)
    balance = found["energy"] - found["work"]
    energy.add("E - W", found["t"], balance, HOLDS)
    return draw(path, energy)


PICTURES = (
    oscillator, verlet, drift, baumgarte, bdf, damping, bound, taylor, chaos, polar,
    gimbal, rank, pulse, jumps, zeno, graze, balls, moreau,
    speed,
)  # fmt: skip


def drawn(name):
    """Draw the picture with this name; return a PNG."""
    (picture,) = (x for x in PICTURES if x.__name__ == name)
    return picture()
