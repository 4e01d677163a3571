"""Rows that hold at times, on random systems: steps, turns on a disc, rounding.

What moves, sticks and slides: tests/scenes/contact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from lagsim.methods.parts import parameters as kept
from lagsim.methods.parts.parameters import Parameters
from lagsim.program import dense, laws
from tests.kernels import bind

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

N = 7
# A relation that always holds, one that depends on it, another; of the laws: a contact
# with two slips, a contact with one, a limit, a freewheel, a coupling.
ALWAYS = 3
KINDS = (
    kept.CONTACT, kept.SLIP, kept.SLIP, kept.CONTACT, kept.SLIP, kept.LIMITED,
    kept.FREEWHEEL, kept.TIMED,
)  # fmt: skip
NORMALS = (-1, 0, 0, -1, 3, -1, -1, -1)
PAIRS = (-1, 2, 1, -1, -1, -1, -1, -1)
LAWS = len(KINDS)
ROWS = ALWAYS + LAWS
OFF, HELD, SLIDING = kept.OFF, kept.HELD, kept.SLIDING


@dataclass(frozen=True)
class System:
    """Numbers of one state, and which modes the laws have."""

    seed: int
    mode: tuple[float, ...]
    direction: tuple[float, ...] = (0.0,) * LAWS
    still: float = 0.0

    def __getattr__(self, name: str) -> Any:
        """Give a random array; the same at each call."""
        sizes = {
            "root": (N, N), "rows": (ROWS, N), "f": (N,), "b": (ROWS,),
            "speeds": (LAWS,), "bounds": (LAWS,), "statics": (LAWS,),
            "residuals": (2, ROWS),
            "scales": (2, ROWS), "gaps": (LAWS,), "force_rounding": (N,),
        }  # fmt: skip
        if name not in sizes:
            raise AttributeError(name)
        random = np.random.default_rng([self.seed, list(sizes).index(name)])
        found = random.normal(size=sizes[name])
        return (
            np.abs(found)
            if name in ("bounds", "statics", "scales", "force_rounding")
            else found
        )

    @property
    def A(self) -> Any:  # noqa: N802
        found = self.rows.copy()
        found[1] = -2.0 * found[0]
        return found

    @property
    def asked(self) -> Any:
        found = self.b.copy()
        found[1] = -2.0 * found[0]
        return found

    @property
    def M(self) -> Any:  # noqa: N802
        return self.root @ self.root.T + np.eye(N)

    @property
    def p(self) -> Parameters:
        p = Parameters.made(n=N, m=ROWS, laws=LAWS, size=2 * N, loops=1)
        p.aside[1] = 1.0
        p.law_kind[:], p.law_normal[:], p.law_pair[:] = KINDS, NORMALS, PAIRS
        p.law_mode[:], p.law_direction[:] = self.mode, self.direction
        p.law_still[:] = self.still
        p.law_forces = p.sigma = 1.0
        return p

    def call(self, name: str, p: Parameters, place: Any = None) -> Any:
        """Call a kernel; its model's functions give this system."""
        x = self

        def dynamics(_t: float, _y: Floats, _p: Parameters, out: Floats) -> None:
            parts = (x.M, x.A, x.f, x.asked, x.speeds, x.bounds, x.statics)
            put(out, parts)

        def geometry(_t: float, _y: Floats, _p: Parameters, out: Floats) -> None:
            put(out, (x.M, x.A, x.residuals, x.scales))

        def second_order(_t: float, z: Floats, _p: Parameters, out: Floats) -> None:
            put(out, (left_by(numbers(z, 2 * N)),))

        def force_rounding(_t: float, _y: Floats, _p: Parameters, out: Floats) -> None:
            put(out, (x.force_rounding,))

        def gaps(_t: float, _y: Floats, _p: Parameters, out: Floats) -> None:
            put(out, (x.gaps,))

        model = {
            f.__name__: f
            for f in (dynamics, geometry, second_order, force_rounding, gaps)
        }
        out = np.full(4 * N + ROWS + 3, np.nan)
        y = np.linspace(0.5, 1.5, 2 * N) if place is None else place
        own = {"LAWS": True}
        model["solve_motion"] = bind(dense.solve_motion, model, own)
        kernel = getattr(laws if name == "law_event_functions" else dense, name)
        bind(kernel, model, own)(0.0, y, p, out)
        return out

    @property
    def held(self) -> list[int]:
        return [0, 2, *(ALWAYS + k for k in range(LAWS) if self.mode[k] == HELD)]


def put(out: Floats, parts: Any) -> None:
    for k, value in enumerate(np.concatenate([np.ravel(part) for part in parts])):
        out[k] = value


def numbers(z: Floats, count: int) -> Any:
    return np.array([z[k] for k in range(count)])


def left_by(z: Any) -> Any:
    """Give what a Newton step leaves, of all rows twice: each by its own measure.

    Most of the row that is set aside.
    """
    size = 1e-3 * np.sum(np.abs(z[:N])) + np.sum(np.abs(z[N:] - 0.1)) / 500
    found = size * (1.0 + np.sin(3.0 * np.arange(2 * ROWS)))
    found[[1, ROWS + 1]] = 3.0 * size
    return found


MODES = {
    "all stick": ((HELD, HELD, HELD, OFF, OFF, HELD, OFF, OFF), (0,) * LAWS),
    "one slides": ((OFF, OFF, OFF, HELD, SLIDING, SLIDING, HELD, OFF),
                   (0, 0, 0, 0, 1, -1, 0, 0)),
}  # fmt: skip


def close(found: Any, expected: Any) -> None:
    scale = np.max(np.abs(expected), initial=0.0)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-10 * scale)


@pytest.mark.parametrize("name", MODES)
@pytest.mark.parametrize(
    ("kernel", "level"), [("position_step", 0), ("velocity_step", 1)]
)
def test_steps_to_what_holds(name, kernel, level):
    x = System(3, *MODES[name])
    p, held = x.p, x.held
    scales = vars(x)["scales"] = x.scales
    scales[:, held[2]] = 0.0  # a row without a scale is no measure
    x.call("field", p)  # friction has no part in what follows
    found = x.call(kernel, p)
    A, missed = x.A[held], x.residuals[level][held]
    back = np.linalg.solve(x.M, A.T)
    step = -back @ np.linalg.solve(A @ back, missed)
    close(found[:N], step)
    # Against the scale of its own level; of rows that do not hold nothing is asked.
    with np.errstate(divide="ignore"):
        measures = np.abs(missed) / scales[level][held]
    assert found[N] == pytest.approx(np.max(measures[np.isfinite(measures)]))
    assert found[N + 1] == level
    z = np.concatenate([np.linspace(0.5, 1.5, 2 * N)[:N], step])
    left = left_by(z).reshape(2, ROWS)
    assert found[N + 2] == pytest.approx(np.max(left[level][held]))
    assert found[N + 2] < np.max(left)


@pytest.mark.parametrize("first", [kept.HELD, kept.REDUNDANT])
def test_two_slips_that_stick_share_their_bound(first):
    # Of two that hold the first tells; where that hangs on others, the second does.
    x = System(5, (HELD, first, HELD, HELD, HELD, OFF, HELD, HELD))
    p = x.p
    found = x.call("law_event_functions", p)[:LAWS]
    lam = p.multipliers[ALWAYS:]
    tells, silent = (1, 2) if first == HELD else (2, 1)
    left = x.statics[tells] * lam[0] - np.hypot(lam[1], lam[2])
    assert found[tells] == pytest.approx(left)
    assert found[silent] == laws.ENDLESS
    assert (lam[1] != 0.0) == (first == HELD)


@pytest.mark.parametrize("angle", [0.0, 0.5, 1.0, 1.1, 2.0, np.pi, -0.5, -1.1, -2.0])
@pytest.mark.parametrize("speed", [0.1, 0.25, 0.3, 7.0])
def test_the_margin_of_a_disc_is_its_speed_until_its_way_has_turned(angle, speed):
    # On its way, at an angle from it; past a right angle it has stopped before.
    slip = speed * np.array([np.cos(0.3 + angle), np.sin(0.3 + angle)])
    direction = (0, -np.cos(0.3), -np.sin(0.3), 0, 0, 0, 0, 0)
    mode = (HELD, SLIDING, SLIDING, OFF, OFF, OFF, OFF, HELD)
    x = System(6, mode, direction, still=0.25)
    vars(x)["speeds"] = np.array([0.0, *slip, 0.0, 0.0, 0.0, 0.0, 0.0])
    found = x.call("law_event_functions", x.p)[1]
    if np.cos(angle) < 0.0:
        assert found == pytest.approx(-speed)
    else:
        turned = speed * (np.cos(angle) - 0.5)
        assert found == pytest.approx(min(speed - 0.25, turned), abs=1e-12)


@pytest.mark.parametrize("seed", [7, 8])
def test_what_holds_rounds_as_relations_do(seed):
    """Modes are of no matter: `dense` has the same rows as relations."""

    class Alone(System):
        A = System(seed, ()).A * (np.arange(ROWS) != 1)[:, None]

    x = Alone(seed, (HELD, OFF, HELD, OFF, OFF, HELD, OFF, OFF))
    found = x.call("rounding", x.p)[:N]
    rows = x.held

    def dynamics(_t: float, _y: Floats, _p: Parameters, out: Floats) -> None:
        put(out, (x.M, x.A[rows], x.f, x.asked[rows]))

    def force_rounding(_t: float, _y: Floats, _p: Parameters, out: Floats) -> None:
        put(out[0:], (x.force_rounding,))

    p = Parameters.made(n=N, m=len(rows), size=2 * N, loops=1)
    p.expected, p.least_sigma = len(rows), 1.0
    out = np.zeros(4 * N + ROWS + 3)
    kernel = bind(
        dense.rounding, {"dynamics": dynamics, "force_rounding": force_rounding}
    )
    kernel(0.0, np.zeros(2 * N), p, out)
    close(found, out[:N])
    back = np.linalg.solve(x.M, x.A[rows].T)
    free = np.linalg.solve(x.M, x.force_rounding)
    free -= back @ np.linalg.solve(x.A[rows] @ back, x.A[rows] @ free)
    assert np.all(found > np.abs(free))
