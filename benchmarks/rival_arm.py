"""Accelerations of the shipped seven-joint arm: lagsim beside MuJoCo.

    python benchmarks/rival_arm.py  (needs `pip install "mujoco<4"`)

MuJoCo's times are those of `mj_step1`, which ends before the forces of actuators;
lagsim's are whole derivatives in a run by rk4, the work of the step included. Both are
the least of several repeats, taken in turn. The second table has the difference of both
programs after 1 s, MuJoCo by RK4 with two steps.
"""

from __future__ import annotations

import time

import mujoco
import numpy as np
from measure import MODELS

import lagsim

AXES, REPEATS, CALLS, STEP = "zyzyzyz", 7, 20_000, 1e-3
START = 0.3 + 0.1 * np.arange(len(AXES))


def arm(step):
    """Return the arm as a model and data of MuJoCo, at its start."""
    links = ""
    for k, axis in enumerate(AXES):
        turns = "0 0 1" if axis == "z" else "0 1 0"
        links += (
            f'<body pos="0 0 {0.3 * bool(k)}"><joint axis="{turns}" damping="0.05"/>'
            '<inertial pos="0 0 0.15" mass="1" diaginertia="0.01 0.012 0.004"/>'
        )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{step}" integrator="RK4" gravity="0 0 -9.81">'
        '<flag contact="disable" constraint="disable"/></option>'
        f"<worldbody>{links}{'</body>' * len(AXES)}</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qpos[:] = START
    return model, data


def in_mujoco(step):
    """Return the angles (7,) after 1 s."""
    model, data = arm(step)
    for _ in range(round(1 / step)):
        mujoco.mj_step(model, data)
    return data.qpos.copy()


def main():
    """Print the times, and the distance of the motions."""
    path = MODELS / "seven-joint-arm.yaml"
    model, data = arm(STEP)
    options = {"method": "rk4", "step": STEP, "output_step": 5, "duration": 5}
    both = [], []
    for _ in range(REPEATS):
        began = time.perf_counter()
        for _ in range(CALLS):
            mujoco.mj_step1(model, data)
        both[0].append((time.perf_counter() - began) / CALLS)
        record = lagsim.simulate(path, error_bar="never", **options).record
        both[1].append(record["timings"]["integrate"] / record["evaluations"])
    theirs, ours = (1e6 * min(times) for times in both)
    print(f"mj_step1 {theirs:.2f} us, lagsim {ours:.2f} us: {ours / theirs:.2f} times")
    r = lagsim.simulate(path)
    end = np.array([r[f"q.{k}"][-1] for k in range(1, len(AXES) + 1)])
    for step in (2e-4, 1e-4):
        apart = np.max(np.abs(in_mujoco(step) - end))
        print(f"MuJoCo at {step:g}: {apart:.1e} rad apart after 1 s")


if __name__ == "__main__":
    main()
