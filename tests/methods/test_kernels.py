"""Each kernel in plain Python against native code: equal counts, equal states."""

import numpy as np
import pytest

from lagsim.methods import dop853
from lagsim.methods.parts import driver, embedded
from lagsim.methods.parts import state as at
from tests.kernels import bind
from tests.methods.plain import Plain, linked
from tests.support import ready

SPRING = """
parameters: {{l: 1, g: 9.8, K: 25.6}}
coordinates: {{theta: {{}}, u: {{}}}}
energy:
  kinetic: ((l + u)*theta_dot)^2/2 + u_dot^2/2
  potential: g*(l - (l + u)*cos(theta)) + K*u^2/2
forces: {{u: 0.3*cos(4*t)}}
{constraints}
initial: {{theta: 1, u: 0}}
simulation: {{duration: 0.8, output_step: 0.03, {options}}}
"""
ON_CURVE = 'constraints: {path: "u = l - l*theta^2"}'
TWICE = 'constraints: {path: "u = l - l*theta^2", again: "2*u + 2*l*theta^2 = 2*l"}'
STEERED = 'constraints: {blade: "u_dot*cos(theta + 5*u) = l*theta_dot*sin(theta)"}'
PASSED = 'until: "y <= -0.1"'
UNTIL = 'until: "theta <= 0.3"'
# The first is true at the start, and counts once it has become false.
EVENTS = """
modes: {far: 1}
events:
  far: {at: theta >= 0.6, set: {far: 1}}
  stretched: {at: u >= 0.4, set: {far: 0}}
"""
DOP853 = "method: dop853"
FIXED = "method: rk4, step: 0.02"
# Constant M and forces free of velocities, for the methods that need that.
SEPARABLE = """
coordinates: {{x: {{}}, y: {{}}}}
energy:
  kinetic: x_dot^2/2 + y_dot^2/2 + x_dot*y_dot/4
  potential: 20*(x^2 + y^2)/2 + x^4 + x*y*sin(t)
forces: {{y: 3*cos(4*t)}}
{constraints}
initial: {{x: 1, y: 0}}
simulation: {{duration: 0.8, output_step: 0.03, {options}}}
"""
# Sections, strobes and conditions: some of each within a step, and events.
WATCHED = """
modes: {m: 0}
events:
  high: {at: x >= 1.2, set: {m: 1}}
  low: {at: y = -7, set: {m: 2}}
output:
  sections:
    down: {at: x = 0.5, direction: down}
    both: {at: x_dot + y_dot = -3, direction: both}
    fast: {every: 0.007}
    slow: {every: 0.3}
"""
ON_CIRCLE = 'constraints: {ring: "x^2 + (y + sin(t)/9)^2 = 1"}'

CASES = {
    "free": ("", DOP853),
    "free until": ("", f"{DOP853}, {UNTIL}"),
    "free until equal": ("", f'{DOP853}, until: "u = 0.2"'),
    "free events": (EVENTS, DOP853),
    "held events until": (f"{ON_CURVE}{EVENTS}", f"{FIXED}, {UNTIL}"),
    "free, tolerances": ("", f"{DOP853}, rtol: 1e-7, atol: 1e-9"),
    "held": (ON_CURVE, DOP853),
    "held until": (ON_CURVE, f"{DOP853}, {UNTIL}"),
    "held twice until": (TWICE, UNTIL),
    "steered": (STEERED, DOP853),
    "dopri5": ("", "method: dopri5, rtol: 1e-7"),
    "dopri5 held until": (ON_CURVE, f"method: dopri5, rtol: 1e-7, {UNTIL}"),
    "rk4": ("", FIXED),
    "rk4 until": ("", f"{FIXED}, {UNTIL}"),
    "rk4 held until": (ON_CURVE, f"{FIXED}, {UNTIL}"),
    "rk4 steered": (STEERED, FIXED),
    "euler held until": (ON_CURVE, f"method: euler, step: 0.02, {UNTIL}"),
    "verlet": ("", "method: verlet, step: 0.02"),
    "kahan-li6": ("", "method: kahan-li6, step: 0.07"),
    "kahan-li8 until": ("", 'method: kahan-li8, step: 0.03, until: "x <= 0.3"'),
    "radau": ("", "method: radau, rtol: 1e-4"),
    "radau held until": (ON_CURVE, f"method: radau, rtol: 1e-4, {UNTIL}"),
    "radau steered": (STEERED, "method: radau, rtol: 1e-4"),
    "generalized-alpha held": (ON_CURVE, "method: generalized-alpha, step: 0.02"),
    "midpoint until": ("", f"method: midpoint, step: 0.02, {UNTIL}"),
    "gauss4": ("", "method: gauss4, step: 0.05"),
    "rattle": ("", "method: rattle, step: 0.02"),
    "moreau": ("", "method: moreau, step: 0.02"),
    "moreau held twice until": (TWICE, f"method: moreau, step: 0.02, {UNTIL}"),
    "rattle held until": (ON_CIRCLE, 'method: rattle, step: 0.02, until: "x <= 0.9"'),
    "taylor": ("", "method: taylor, rtol: 1e-9"),
    "taylor held until": (ON_CURVE, f"method: taylor, rtol: 1e-9, {UNTIL}"),
}
WATCHING = (
    "euler", "rk4", "verlet", "kahan-li6", "kahan-li8", "midpoint", "gauss4",
    "generalized-alpha", "rattle",
)  # fmt: skip
for _name in WATCHING:
    CASES[f"{_name} watched"] = (WATCHED, f"method: {_name}, step: 0.02, {PASSED}")
for _name in ("dop853", "dopri5", "radau", "taylor"):
    CASES[f"{_name} watched"] = (WATCHED, f"method: {_name}, rtol: 1e-5, {PASSED}")


def linked_system(case):
    constraints, options = CASES[case]
    free = any(name in case for name in ("verlet", "kahan-li", "rattle", "watched"))
    text = SEPARABLE if free else SPRING
    text = text.format(constraints=constraints, options=options)
    session = ready(text, formulation="full")
    plan, system, settings = session.plan, session.system, session.case.settings
    runner = system.link(plan.method)
    s = runner.empty.copy()
    s.y[:] = system.begin(session.case.start)
    runner.prepare()
    s.sigma = s.fresh = 1.0
    s.rtol, s.fixed_step = plan.rtol or 0.0, plan.step or 0.0
    s.atol = -1.0 if plan.atol is None else plan.atol
    s.row_step = settings.output_step
    s.row_limit = s.end = settings.end
    s.equation[:] = float("= 0.2" in options)
    statics = {
        "CONSTRAINED": system.m > 0,
        "UNTIL": bool(system.equations.model.located),
    }
    return runner, s, statics


@pytest.mark.parametrize("case", CASES)
def test_a_run_in_plain_python_is_the_native_run(case):
    # The same native functions of the model are called, so that nothing but the
    # kernels differs; they promise the same bits.
    runner, native, statics = linked_system(case)
    plain = Plain(runner.method, linked(runner), **statics)
    twin, p = native.copy(), runner.system.p.copy()
    twin_out = np.zeros((5, 1 + runner.system.size))
    flat = twin_out.reshape(-1)
    codes = []
    # Blocks of 5 rows and 7 steps: the returns for a full block and a pause are met.
    while not codes or codes[-1] in (at.BLOCK_FULL, at.PAUSED):
        codes.append(runner.advance(native, 5, 7))
        assert plain.advance(twin, p, flat, 5, 7) == codes[-1]
        rows = int(native.emitted)
        assert np.array_equal(runner.block[:rows], twin_out[:rows])
        assert np.array_equal(native.flat, twin.flat)
    assert codes[-1] == (at.EVENT_FOUND if statics["UNTIL"] else at.DONE)
    assert native.steps > 3
    least = {
        "euler": 1, "taylor": 1, "generalized-alpha": 3,
        "midpoint": 3, "verlet": 1, "moreau": 1, "rattle": 2, "kahan-li6": 9,
        "kahan-li8": 17,
    }  # fmt: skip
    stages = least.get(runner.method.NAME, 4)
    assert native.evaluations > stages * native.steps


# Methods that evaluate the motion by `derivative` alone, in the first steps of a run.
COUNTED = (
    "free", "held", "dopri5", "dopri5 held until", "rk4", "rk4 held until",
    "euler held until", "verlet", "kahan-li6", "radau held until",
    "generalized-alpha held", "rattle held until",
)  # fmt: skip


@pytest.mark.slow
def test_the_evaluations_are_the_calls_of_the_derivative():
    for case in COUNTED:
        runner, s, statics = linked_system(case)
        model, calls = linked(runner), []

        def derivative(*given, own=model["derivative"], calls=calls):
            calls.append(given[0])
            own(*given)

        plain = Plain(runner.method, model | {"derivative": derivative}, **statics)
        out = np.zeros(50 * (1 + runner.system.size))
        plain.advance(s, runner.system.p.copy(), out, 50, 10)
        assert s.steps > 3, case
        assert s.evaluations == len(calls), case


def test_tabulate_is_the_same():
    runner, _, _ = linked_system("held")
    states = np.array([[0.1, 0.9, 0.19, -0.1, 0.18, 0.0], [0.2, 0.5, 0.75, 1, -1, 0.3]])
    size, width = runner.system.size, runner.system.rows_observed
    out = np.zeros(2 * width)
    tabulate = bind(driver.tabulate, linked(runner))
    tabulate(states.ravel(), 2, size, runner.system.p, out, width)
    assert np.array_equal(out.reshape(2, width), runner.tabulate(states))


def hairers(error5, error3):
    """Equation (10.17) of section II.10, all tolerances 1 and h = 1."""
    both = np.sum(np.square(error5)), np.sum(np.square(error3))
    return both[0] / np.sqrt(len(error5) * (both[0] + 0.01 * both[1]))


def norm_with(motion, works):
    """The norm of errors of order 5 and 3, whose tolerances are 1."""
    s = dop853.STATE.allocate(n=len(motion) // 2, size=len(motion) + len(works))
    error_norm = bind(embedded.error_norm, {}, {"PAIR": dop853.PAIR})
    s.tolerances[:] = 1.0
    errors = np.array([e[k] for k in (0, 1) for e in (*motion, *works)])
    return error_norm(s, 1.0, errors)


MOTION = (30.0, 400.0), (20.0, 500.0)  # of order 5 and of 3


def test_a_work_hides_no_error_of_the_motion():
    """A work of which only the estimate of order 3 is large, at any tolerance."""
    alone = hairers([30.0, 20.0], [400.0, 500.0])
    assert norm_with(MOTION, []) == pytest.approx(alone)
    assert norm_with(MOTION, [(0.0, 1e18)]) == pytest.approx(alone)
    assert norm_with(MOTION, [(1e10, 1e18)]) > alone * np.sqrt(2 / 3) * (1 - 1e-12)
    # Its square underflows.
    assert norm_with(MOTION, [(1e-180, 0.0)]) == pytest.approx(alone * np.sqrt(2 / 3))


def test_a_work_hides_no_error_of_another():
    rests = (0.0, 0.0), (0.0, 0.0)
    alone = hairers([40.0], [900.0])
    for others in ([(1e-9, 1e18)], [(0.0, 1e18), (1e-9, 1e3)]):
        found = norm_with(rests, [*others, (40.0, 900.0)])
        assert found > alone * np.sqrt(1 / 3) * (1 - 1e-12)


@pytest.mark.parametrize("work", [(25.0, 100.0), (40.0, 30.0), (1e3, 2e4)])
def test_a_work_with_an_error_is_a_component_more(work):
    error5, error3 = np.transpose([*MOTION, work])
    assert norm_with(MOTION, [work]) == pytest.approx(hairers(error5, error3))
