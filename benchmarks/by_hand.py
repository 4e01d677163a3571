"""The elastic pendulum as a user would write it, with sympy, scipy and pyplot.

    python by_hand.py FOLDER [--rtol 1e-11] [--no-plots]

The same motion, rows, columns and pictures as `lagsim run elastic-pendulum.yaml`.
"""

import argparse
from pathlib import Path

import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp

VALUES = {"l": 1.0, "g": 9.8, "K": 25.6, "M": 1.0}
START = [0.0, 1.0, 0.5, 0.0]
END, STEP = 36.0, 0.02
STATE = ["theta", "u", "theta_dot", "u_dot"]
SHOWN = ["x", "y", "kinetic", "potential", "energy"]
COLUMNS = ["t", *STATE, "theta_ddot", "u_ddot", *SHOWN]


def derived():
    """Return two functions of the state: accelerations, and derived quantities.

    Both are derived with sympy, for arguments theta, u and their rates.
    """
    l, g, K, M = sp.symbols("l g K M")  # noqa: E741  as the notes name it
    t = sp.Symbol("t")
    theta, u = sp.Function("theta")(t), sp.Function("u")(t)
    q = sp.Matrix([theta, u])
    v = q.diff(t)
    T = M * ((l + u) * v[0]) ** 2 / 2 + M * v[1] ** 2 / 2
    V = M * g * (l - (l + u) * sp.cos(theta)) + K * u**2 / 2
    L = T - V
    momenta = sp.Matrix([L]).jacobian(v).T
    a = sp.Matrix(sp.symbols("a1 a2"))
    residual = momenta.diff(t) - sp.Matrix([L]).jacobian(q).T
    residual = residual.subs(dict(zip(v.diff(t), a, strict=True)))
    mass = residual.jacobian(a)
    force = -residual.subs(dict.fromkeys(a, 0))
    accelerations = mass.LUsolve(force)
    shown = [(l + u) * sp.sin(theta), -(l + u) * sp.cos(theta), T, V, T + V]
    y = sp.symbols(STATE)
    names = dict(zip([*v, *q], [*y[2:], *y[:2]], strict=True))

    def compiled(expressions):
        plain = [e.subs(names).subs(VALUES) for e in expressions]
        return sp.lambdify(y, plain, "numpy", cse=True)

    return compiled(accelerations), compiled(shown)


def integrate(accelerations, rtol):
    """Return the times (rows,) and the states (4, rows) by scipy's DOP853."""

    def rhs(_t, y):
        return [y[2], y[3], *accelerations(*y)]

    rows = round(END / STEP) + 1
    times = np.arange(rows) * STEP
    result = solve_ivp(
        rhs, (0.0, END), START, "DOP853", t_eval=times, rtol=rtol, atol=rtol
    )
    return result.t, result.y


def tabulate(t, y, accelerations, shown):
    """Return the table's rows, with columns for time, state and derived quantities."""
    return np.column_stack([t, *y, *accelerations(*y), *shown(*y)])


def draw(rows, folder):
    """Write energy.png, trajectory.png and the path in the plane."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    column = dict(zip(COLUMNS, rows.T, strict=True))
    t = column["t"]
    figure, axes = plt.subplots(2, sharex=True, figsize=(7, 4.3), height_ratios=[2, 1])
    axes[0].plot(t, column["kinetic"], label="T")
    axes[0].plot(t, column["potential"], "--", label="V")
    axes[0].plot(t, column["energy"], "k", label="T + V")
    axes[0].legend()
    axes[0].set_ylabel("energy (J)")
    axes[1].plot(t, column["energy"] - column["energy"][0], "k")
    axes[1].set_ylabel("drift (J)")
    axes[1].set_xlabel("t (s)")
    for axis in axes:
        axis.grid()
    figure.savefig(folder / "energy.png", dpi=200)
    plt.close(figure)

    figure, axes = plt.subplots(3, figsize=(7, 9), height_ratios=[1, 1, 2])
    for axis, name, unit in zip(axes, ("theta", "u"), ("rad", "m"), strict=False):
        axis.plot(t, column[name])
        axis.set_ylabel(f"{name} ({unit})")
        axis.set_xlabel("t (s)")
    axes[2].plot(column["x"], column["y"])
    axes[2].plot(0, 0, "k.")
    axes[2].set_aspect("equal")
    axes[2].set_xlabel("x (m)")
    axes[2].set_ylabel("y (m)")
    for axis in axes:
        axis.grid()
    figure.savefig(folder / "trajectory.png", dpi=200)
    plt.close(figure)

    figure, axis = plt.subplots(figsize=(7, 4.3))
    axis.plot(column["x"], column["y"])
    axis.set_xlabel("x (m)")
    axis.set_ylabel("y (m)")
    axis.set_title("Path in the plane")
    axis.grid()
    figure.savefig(folder / "plot_1.png", dpi=200)


def main():
    options = argparse.ArgumentParser()
    options.add_argument("folder", type=Path)
    options.add_argument("--rtol", type=float, default=1e-11)
    options.add_argument("--no-plots", action="store_true")
    given = options.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    accelerations, shown = derived()
    t, y = integrate(accelerations, given.rtol)
    rows = tabulate(t, y, accelerations, shown)
    header = ",".join(COLUMNS)
    table = given.folder / "trajectory.csv"
    np.savetxt(table, rows, "%.17g", delimiter=",", header=header, comments="")
    if not given.no_plots:
        draw(rows, given.folder)


if __name__ == "__main__":
    main()
