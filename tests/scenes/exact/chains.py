"""Chains of balls whose contacts are written as forces.

The motion is integrated by displacements, in which touching balls have gaps of exactly
0, by scipy's DOP853 at a tolerance of 1e-13, in steps of a 500th of the run at most.
"""

from __future__ import annotations

import functools
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from tests.scenes.contact.motions import scene
from tests.scenes.exact import Exact

LAWS = {
    "max": "{k}*max(0, {g})^{p}",
    "min": "{k}*(-min(0, -({g})))^{p}",
    "if": "if({g} > 0, {k}*({g})^{p}, 0)",
    "else": "if({g} <= 0, 0, {k}*({g})^{p})",
    "both": "if({g} > 0, {k}*({g})^{p}, -{k}*(-({g}))^{p})",
}


def chain(
    n, p, law, *, gap = 0.0, v = 1.0, k = 1.0,
    m = 1.0, d = 1.0, at = 0.0, duration = 4.0,
    within = 1e-9, **simulation,
):  # fmt: skip
    """Balls at `at` + i d, of which the first is `gap` before that and moves at v."""
    laws = [
        LAWS[law].format(g=f"x{i} + {d} - x{i + 1}", p=p, k=k) for i in range(n - 1)
    ]
    pushes = [f"- {laws[0]}", *(f"{a} - {b}" for a, b in pairwise(laws)), laws[-1]]
    initial = {f"x{i}": at + i * d for i in range(n)}
    initial |= {"x0": at - gap, "x0_dot": v}
    text = scene(
        " ".join(f"x{i}" for i in range(n)),
        " + ".join(f"{m}*x{i}_dot^2/2" for i in range(n)), "0", {}, initial,
        forces={f"x{i}": push for i, push in enumerate(pushes)}, duration=duration,
        output_step=duration / 20.0, **simulation,
    )  # fmt: skip

    def rates(_t, y):
        c = y[: n - 1] - y[1:n]
        push = k * np.abs(c) ** p
        push = np.where(c > 0.0, push, -push if law == "both" else 0.0)
        force = np.zeros(n)
        force[:-1] -= push
        force[1:] += push
        return np.concatenate([y[n:], force / m])

    @functools.cache
    def solved(*t):
        start = np.zeros(2 * n)
        start[0], start[n] = -gap, v
        size = abs(v) * min(1.0, duration)
        times = np.clip(t, 0.0, duration)
        return solve_ivp(
            rates, (0.0, duration), start, method="DOP853", t_eval=times, rtol=1e-13,
            atol=1e-16 * size, max_step=duration / 500.0,
        ).y  # fmt: skip

    def motion(t):
        # Far away the places are no measure of how they move.
        moved = [] if at else solved(*t)[:n]
        return {f"x{i}": i * d + x for i, x in enumerate(moved)}

    def also(t):
        return {f"x{i}_dot": rate for i, rate in enumerate(solved(*t)[n:])}

    return Exact(text, motion, also, within=within)


# Each ball begins to move by a higher power of the time than the one before.
SCENES = {
    f"{n} balls touch by {law}, {p}": chain(n, p, law)
    for law in LAWS
    for n, p in ((3, 1.5), (4, 1.5), (4, 2.5), (5, 1), (8, 1.5))
}
SCENES |= {
    f"{n} balls are struck by {law}, {p}": chain(n, p, law, gap=0.1)
    for law in ("max", "if")
    for n in (3, 4)
    for p in (1.5, 2.5)
}
for law in ("max", "both"):
    SCENES |= {
        f"balls by {law} far away": chain(4, 1.5, law, at=1e6, d=0.3, within=1e-7),
        f"slow balls by {law}": chain(4, 1.5, law, v=1e-3, duration=15.9),
        f"hard balls by {law}": chain(
            4, 1.5, law, k=1e9, m=1e-3, d=0.02, duration=6.3e-5
        ),
        f"hard heavy balls by {law}": chain(
            4, 1.5, law, k=1e9, m=1e3, d=0.02, v=1e-2, duration=4e-2
        ),
        f"balls by {law} and dop853": chain(4, 1.5, law, method="dop853"),
    }
