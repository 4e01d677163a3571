"""Steps at the stability bound, and numerical damping of oscillations, by eigenvalues.

A step h multiplies a mode with eigenvalue L by R(h L), with the stability function R of
the method, and the exact motion multiplies it by exp(h L). The step of a run is
compared with the eigenvalues of its model, linearised at the start and along the
motion. Explicit methods with step control detect themselves where stability limits the
step (`methods._stability`).

Source: E. Hairer, G. Wanner, Solving Ordinary Differential Equations II (1996), IV.2.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from lagsim.codes.known import FAST_MODE_DAMPED, STEP_AT_STABILITY_BOUND
from lagsim.errors import several
from lagsim.mechanics.linearisation import Linear, Linearisation, eigenmodes
from lagsim.methods import method
from lagsim.notes import Caution
from lagsim.tolerances import NEGLIGIBLE_RATE, SAME_RESULT

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from types import ModuleType

    from lagsim.language.arrays import Complexes, Floats
    from lagsim.mechanics.equations import Equations
    from lagsim.plan.plan import Plan
    from lagsim.run.observers.monitors import EnergyMonitor
    from lagsim.run.trajectory import Trajectory

    Amplification = Callable[[complex], float]

# Sizes of z = h*lambda that are examined: with the first factor in the directions of
# the fastest eigenvalues (Kahan and Li's method of order 8 is unstable in a gap of 1.4
# % only), and with the second in other directions.
SMALLEST, LARGEST = 0.02, 50.0
FINE, COARSE, MOST_FINE = 1.008, 1.12, 12
# A method that amplifies an oscillation at so small a step does so at any.
AT_ONCE = 1e-3
BISECTIONS = 40
# An amplification exceeds that of a motion that grows by e^x if the excess is more than
# this part of x; a smaller excess is an error of the method, and no instability. A mode
# whose growth is more than this part of its eigenvalue is left out, since the motion
# itself is unstable.
SLACK = 0.1


def exceeds(amplification: Amplification, z: complex) -> bool:
    """Whether a step amplifies a mode more than the exact motion does.

    Parameters
    ----------
    amplification : callable
        |R(z)|, with the stability function R of a method.
    z : complex
        The step times the eigenvalue of the mode.
    """
    with np.errstate(all="ignore"):
        return _exceeds(amplification, z)


def _exceeds(amplification: Amplification, z: complex) -> bool:
    """Return `exceeds(amplification, z)`; numpy may warn of overflows."""
    grows = max(0.0, z.real)
    allowed = math.exp(min(grows, 300.0)) * (1.0 + SLACK * grows)
    found = amplification(z)
    return not found <= allowed * (1.0 + SAME_RESULT)


def stability_limit(
    amplification: Amplification, direction: complex, most: float, factor: float = FINE
) -> float:
    """Return the smallest unstable |z| in a direction; inf if none is below `most`.

    Parameters
    ----------
    amplification : callable
        |R(z)|, with the stability function R of a method.
    direction : complex
        The direction of z, of absolute value 1.
    most : float
        The largest |z| to examine.
    factor : float
        The ratio of consecutive |z| that are examined.
    """
    # once, since the context costs a third of an amplification
    with np.errstate(all="ignore"):
        if _exceeds(amplification, AT_ONCE * direction):
            return 0.0
        low, high = AT_ONCE, SMALLEST
        while not _exceeds(amplification, high * direction):
            if high >= most:
                return math.inf
            low, high = high, high * factor
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            if _exceeds(amplification, middle * direction):
                high = middle
            else:
                low = middle
    return high


def predicted(
    amplification: Amplification, eigenvalues: Iterable[complex], span: float
) -> float | None:
    """Return the smallest step that is unstable for one of the eigenvalues.

    The value is 0 if every step is unstable, and None if no unstable step is found.

    Parameters
    ----------
    amplification : callable
        |R(z)|, with the stability function R of a method.
    eigenvalues : iterable of complex
        The eigenvalues, in 1/time.
    span : float
        The length of a run: slower eigenvalues have no effect within it.
    """
    best = math.inf
    found: dict[complex, float] = {}
    fastest_first = sorted(eigenvalues, key=lambda x: -abs(x))
    for eigenvalue in fastest_first:
        size = float(abs(eigenvalue))
        if size * span < NEGLIGIBLE_RATE:
            break
        if eigenvalue.real > SLACK * size:
            continue
        # The conjugate does the same; directions that differ by rounding are one.
        direction = complex(eigenvalue.real, abs(eigenvalue.imag)) / size
        key = complex(round(direction.real, 9), round(direction.imag, 9))
        if key not in found:
            most = min(LARGEST, best * size)
            factor = FINE if len(found) < MOST_FINE else COARSE
            reach = stability_limit(amplification, direction, most, factor)
            if math.isfinite(reach) or most == LARGEST:
                found[key] = reach
        best = min(best, found.get(key, math.inf) / size)
    return best if math.isfinite(best) else None


# The largest number of states that are linearised, and of nodes evaluated for all of
# these: about 0.3 s.
STATES = 12
MOST_NODES = 300_000
# The time for models with more coordinates exceeds the use of the result.
MOST_COORDINATES = 100
# Past this part of the bound a step is close to it: Verlet's resonance of order three,
# which spoils motion that is not linear, lies at sqrt(3)/2 of its bound.
NEAR = 0.8
# An oscillation has a damping ratio below this.
OSCILLATING = 0.3
# A mode is excited if it has this part of the energy in play (a fast mode that follows
# a slow motion has the fourth power of the ratio of the frequencies). A mode is damped
# by a method that would remove this part of its energy within the run.
EXCITED = 1e-4
DAMPED = 0.1
# A gain of Baumgarte's formulation limits the steps if it is this many times faster
# than the model.
FASTER = 30.0
# With a step longer than this, in parts of 1/|eigenvalue|, no method resolves a motion
# to its tolerance: DOP853 takes 1.5 at 1e-8, a series 1 at 1e-11 and 1.7 at 1e-14.
RESOLVED = 2.5
# So few steps are not limited by stability: at rest, steps grow until the end of the
# run.
FEW = 20
# Steps shorter than this part of the period of a mode resolve the mode.
SLOW = 1e-3


class LinearisedState(NamedTuple):
    """Model linearised at one state of the motion.

    Attributes
    ----------
    t : float
        The time of the state.
    eigenvalues : ndarray, shape (k,)
        The eigenvalues, in 1/s.
    shapes : ndarray, shape (n + l, k)
        Parts of coordinates and states in each mode, each at most 1, see
        `linearisation.Eigenmodes.parts`.
    energies : ndarray, shape (k,)
        Energies of the modes with their conjugates; 0 for modes that do not oscillate.
    """

    t: float
    eigenvalues: Complexes
    shapes: Floats
    energies: Floats


def about_steps(
    equations: Equations, plan: Plan, trajectory: Trajectory, monitor: EnergyMonitor
) -> list[Caution]:
    """Compare the steps of a run with the eigenvalues of its model; return warnings.

    monitor : the states of the rows, about which the model is linearised.
    """
    if trajectory.choices:
        return []  # another method continued the run
    if len(equations.q) > MOST_COORDINATES:
        return []
    module, steps = method(plan.method), trajectory.statistics.steps
    span = trajectory.end - trajectory.start
    h = span / steps if plan.step is None else plan.step
    if plan.formulation == "baumgarte":
        return _penalty(module, h, plan, _seen(equations, monitor, 1.0 / plan.gain))
    check = _StepCheck(equations, module, h, span, _seen(equations, monitor, h))
    if plan.step is None and math.isfinite(module.IMAGINARY_LIMIT):
        return check.limited_by_stability() if steps > FEW else []
    found = [] if plan.step is None else check.unstable()
    return found or check.damping(monitor.energy_in_play)


def _seen(
    equations: Equations, monitor: EnergyMonitor, h: float
) -> list[LinearisedState]:
    linearisation = Linearisation(equations)
    most = min(STATES, MOST_NODES // max(1, linearisation.nodes))
    found = []
    for t, (q, v, a, s) in monitor.states(max(1, most)):
        try:
            linear = linearisation.at(t, q, v, s)
            found.append(_analysed(t, linear, v, a, h))
        except (ValueError, np.linalg.LinAlgError):
            continue
    return found


def _analysed(
    t: float, linear: Linear, v: Floats, a: Floats, h: float
) -> LinearisedState:
    """Return the modes of a linearised motion, with their energies.

    t : the time.
    v, a : velocities and accelerations (n,) at the state.
    h : the step; modes much slower than 1/h are left out.
    """
    modes = eigenmodes(linear.R, lambda speeds: speeds * h > SLOW)
    G = linear.lengths.T @ linear.lengths
    first = linear.first_order
    rates = np.concatenate([linear.Zh.T @ G @ v, linear.Z.T @ G @ a, first])
    moved = modes.right[: linear.Zh.shape[1]]
    # v = 2 Re(c x e^(L t)) of a pair, whose kinetic energy is |2 c x|^2/2 at most.
    amplitudes = np.abs(modes.amplitudes(rates))
    energies = 2.0 * amplitudes**2 * np.sum(np.abs(moved) ** 2, axis=0)
    energies *= modes.are_slowly_damped(OSCILLATING) * (modes.values.imag > 0.0)
    shapes = modes.parts(linear.Zh @ moved, np.diag(G), len(first))
    return LinearisedState(t, modes.values, shapes, energies)


def _penalty(
    module: ModuleType, h: float, plan: Plan, states: list[LinearisedState]
) -> list[Caution]:
    """Return a warning if the gain of Baumgarte's formulation makes the model stiff.

    The formulation adds a double eigenvalue -gain for each constraint.

    module : the method.
    h : the step.
    states : linearised states.
    """
    if plan.step is not None and exceeds(module.amplification, complex(-h * plan.gain)):
        text = (
            f"the step ({h:.3g}) exceeds the stability bound of {module.NAME}: the "
            f"gain {plan.gain:.3g} of baumgarte makes it unstable; use a gain "
            f"below {1.0 / h:.2g}, or projection, which has no gain"
        )
        return [Caution(STEP_AT_STABILITY_BOUND, text)]
    sizes = [float(np.max(np.abs(there.eigenvalues), initial=0.0)) for there in states]
    fastest = max(sizes, default=0.0)
    if not plan.gain > FASTER * fastest:
        return []
    text = (
        f"the gain {plan.gain:.3g} of baumgarte makes the model stiff, whose "
        f"fastest motion is at {max(fastest, SLOW * plan.gain):.3g} per unit of "
        "time: the gain limits the steps; projection costs less and satisfies the "
        "constraints to rounding"
    )
    return [Caution(STEP_AT_STABILITY_BOUND, text)]


class _StepCheck(NamedTuple):
    """Steps of a method in a run, and the model linearised along the motion.

    Attributes
    ----------
    h : float
        The step, or the mean step of a method with step control.
    span : float
        The length of the run in time.
    module : module
        The method.
    states : list of LinearisedState
        The states along the motion.
    """

    equations: Equations
    module: ModuleType
    h: float
    span: float
    states: list[LinearisedState]

    def limited_by_stability(self) -> list[Caution]:
        """Return a warning if stability, not accuracy, limits the chosen steps.

        A fast motion that the rows do not show then determines the step. [] if there is
        none.
        """
        sizes = [np.abs(there.eigenvalues) for there in self.states]
        reaches = [self.h * float(np.max(x, initial=0.0)) for x in sizes]
        if not reaches or not np.median(reaches) > RESOLVED:
            return []
        there = self.states[int(np.argmax(reaches))]
        k = int(np.argmax(np.abs(there.eigenvalues)))
        text = (
            f"the steps (about {self.h:.3g}) are limited by the stability bound of "
            f"{self.module.NAME}, not by accuracy: fast motion of "
            f"{self.named(there, k)} at about {abs(there.eigenvalues[k]):.3g} per unit "
            "of time; `--method radau` has longer steps where fast motion has died "
            "out"
        )
        return [Caution(STEP_AT_STABILITY_BOUND, text)]

    def unstable(self) -> list[Caution]:
        """Return a warning if a fixed step is past or close to a stability bound."""
        amplification, h = self.module.amplification, self.h
        best: tuple[float, LinearisedState] | None = None
        for there in self.states:
            bound = predicted(amplification, there.eigenvalues, self.span)
            if bound is not None and (best is None or bound < best[0]):
                best = bound, there
        if best is None or not h > NEAR * best[0]:
            return []
        bound, there = best
        bounds = [predicted(amplification, [x], self.span) for x in there.eigenvalues]
        k = int(np.argmin([math.inf if b is None else b for b in bounds]))
        eigenvalue = complex(there.eigenvalues[k])
        # within the run an instability at every step size may not show
        if bound == 0.0:
            grown = math.log(amplification(h * eigenvalue)) - h * eigenvalue.real
            if not 2.0 * grown * self.span / h > DAMPED:
                return []
        past = exceeds(amplification, h * eigenvalue)
        side = "past" if past else "close to"
        text = (
            f"at t = {there.t:.6g} the step ({h:.3g}) is {side} the stability bound of "
            f"{self.module.NAME}: fast motion of {self.named(there, k)} at about "
            f"{abs(eigenvalue):.3g} per unit of time"
        )
        if past:
            text += " grows from step to step"
        if bound == 0.0:
            text += (
                "; the method is unstable for undamped oscillation at every step, use "
                "another method"
            )
        else:
            text += f"; use a step below {NEAR * bound:.2g}, or `--method auto`"
        return [Caution(STEP_AT_STABILITY_BOUND, text)]

    def damping(self, in_play: float) -> list[Caution]:
        """Return a warning if the method damps a mode that has energy numerically.

        in_play : the energy in play.
        """
        h, module = self.h, self.module
        worst, shown = EXCITED * in_play, None
        for there in self.states:
            left = self.span - (there.t - self.states[0].t)
            for k in np.flatnonzero(there.energies > worst).tolist():
                lost = self.damped_fraction(h, complex(there.eigenvalues[k]), left)
                if lost > DAMPED:
                    worst, shown = there.energies[k], (there, k, lost)
        if shown is None:
            return []
        there, k, lost = shown
        size = abs(there.eigenvalues[k])
        # The step at which the amplitude of the oscillation changes little within the
        # run.
        steps = [h * 0.5**n for n in range(1, 41)]
        kept = (
            x for x in steps if self.damped_fraction(x, complex(0.0, size)) < DAMPED
        )
        how = "a smaller rtol, for " if module.ADAPTIVE else ""
        text = (
            f"{module.NAME} damps the oscillation of {self.named(there, k)} at about "
            f"{size:.3g} per unit of time: with steps of {h:.2g} it removes "
            f"{100 * lost:.0f} % of that motion's energy within the run, which no "
            f"force of the model does; {how}steps below {next(kept, steps[-1]):.1g}, "
            "or `--method auto`, conserve it"
        )
        return [Caution(FAST_MODE_DAMPED, text)]

    def damped_fraction(
        self, h: float, eigenvalue: complex, left: float | None = None
    ) -> float:
        """Return the fraction of a mode's energy that numerical damping removes.

        h : the step.
        eigenvalue : the eigenvalue of the mode.
        left : the time during which it is damped; by default the length of the run.
        """
        size = self.module.amplification(h * eigenvalue)
        if size <= 0.0:
            return 1.0
        rate = math.log(size) / h - eigenvalue.real
        span = self.span if left is None else left
        return -math.expm1(min(0.0, 2.0 * rate * span))

    def named(self, there: LinearisedState, k: int) -> str:
        """Return the names of coordinates or states with the largest part in mode k.

        there : the linearised state that has the mode.
        """
        every = *self.equations.q, *(x.name for x in self.equations.states)
        shapes = zip(every, there.shapes[:, k], strict=True)
        return several((f"`{q}`" for q, x in shapes if x > 0.5), 4)
