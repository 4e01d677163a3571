"""Bounces: lagsim, which meets every impact, beside MuJoCo, which steps over time.

The shipped ball falls from 1 m and keeps 0.8 of its speed; its heights are known in
closed form. MuJoCo's contact is a spring and a damper (`solref`): a bounce takes time,
and a stiffer spring less of it, in proportion to the step. The damper is the one that
leaves 0.8 of the speed, as Schwager and Poeschel (2007) have it for a force that only
pushes. The rows are made in C on both sides.
"""

from __future__ import annotations

import math
import time

import numpy as np
from measure import MODELS

DURATION, ROWS = 3.0, 300
HEIGHT, G, RESTITUTION = 1.0, 9.81, 0.8
# Steps in a bounce: a few keep it short, many make it exact. The best is shown.
IN_CONTACT = (10, 30, 100, 300)
STEPS = (1e-3, 1e-4, 1e-5)
TOLERANCES = (1e-3, 1e-7, 1e-11)
SECONDS = 0.5
BALL = """
<mujoco><option timestep="{step}" integrator="{integrator}" gravity="0 0 -{g}"/>
<worldbody>
  <geom type="plane" size="1 1 1" solref="{stiff} {damped}" solimp="0.9999 0.9999 1"
    priority="1" condim="1"/>
  <body pos="0 0 {height}"><joint type="slide" axis="0 0 1"/>
    <geom type="sphere" size="0.1" mass="1"/></body>
</worldbody></mujoco>"""


def heights(times):
    """Return the height at each time, from the closed form."""
    fall = math.sqrt(2 * HEIGHT / G)
    found, began, speed = [], -fall, G * fall
    for t in times:
        while t > began + 2 * speed / G:
            began, speed = began + 2 * speed / G, RESTITUTION * speed
        since = t - began
        found.append(speed * since - G * since**2 / 2)
    return np.array(found)


def damping():
    """Return the damping ratio with which a bounce has the restitution RESTITUTION."""
    from scipy.optimize import brentq

    def left(part):
        omega = math.sqrt(1 - part**2)
        turned = math.atan2(2 * part * omega, omega**2 - part**2)
        return math.exp(-part / omega * (math.pi - turned)) - RESTITUTION

    return brentq(left, 1e-6, 0.5)


def mujoco_ball(step, integrator, in_contact):
    """Return a function () -> heights in all rows, computed by MuJoCo."""
    import mujoco

    rate = math.pi / (in_contact * step)
    text = BALL.format(
        step=step, integrator=integrator, g=G, height=HEIGHT + 0.1,
        stiff=-(rate**2), damped=-2 * damping() * rate,
    )  # fmt: skip
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    between = round(DURATION / ROWS / step)

    def run():
        mujoco.mj_resetData(model, data)
        found = [HEIGHT]
        for _ in range(ROWS):
            mujoco.mj_step(model, data, between)
            found.append(HEIGHT + data.qpos[0])
        return np.array(found)

    return run


def own_ball(**options):
    """Return a function () -> heights in all rows, computed by lagsim."""
    from lagsim.model.reader import read_file
    from lagsim.run.observers import Keep
    from lagsim.run.session import open_case
    from lagsim.studies.comparison import on_grid

    texts = {"duration": str(DURATION), "output_step": str(DURATION / ROWS)}
    model = read_file(str(MODELS / "bouncing-ball.yaml"), options=texts)
    case = open_case(model).with_settings(**options)
    session = case.ready()

    def run():
        kept = Keep()
        session.run([kept])
        return on_grid(kept.table, case.settings)[:, 1]

    return run


def best_ball(step, integrator, exact):
    """Return the `mujoco_ball` with the stiffness of the least error of the heights."""
    balls = [mujoco_ball(step, integrator, count) for count in IN_CONTACT]
    return min(balls, key=lambda ball: np.max(np.abs(ball() - exact)))


def measured():
    """Measure times and errors of all solvers; return a JSON document."""
    exact = heights(np.linspace(0.0, DURATION, ROWS + 1))
    candidates = {
        **{f"lagsim, rtol {x:.0e}": own_ball(rtol=x) for x in TOLERANCES},
        **{
            f"lagsim, Moreau's step {x:.0e}": own_ball(method="moreau", step=x)
            for x in STEPS
        },
        **{
            f"MuJoCo, {how}, step {x:.0e}": best_ball(x, how, exact)
            for how in ("Euler", "RK4")
            for x in STEPS
        },
    }
    found = []
    for name, run in candidates.items():
        error = float(np.max(np.abs(run() - exact)))
        best, spent = math.inf, 0.0
        while spent < SECONDS:
            began = time.perf_counter()
            run()
            passed = time.perf_counter() - began
            best, spent = min(best, passed), spent + passed
        found.append({"solver": name, "seconds": best, "error": error})
    return found
