"""The loops for q'' and lambda on random systems of known rank, against numpy."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from lagsim.methods.parts.parameters import Parameters
from lagsim.native.link import cache
from lagsim.native.link.engine import Engine
from lagsim.program.dense import position_step, solve_motion, velocity_step
from lagsim.program.patterns import RowPattern
from lagsim.tolerances import DEPENDENT_ROWS, LOST_RANK
from tests.kernels import bind

if TYPE_CHECKING:
    from lagsim.language.arrays import Floats

ROUNDING = 2.0**-53


# The model's functions that the loops call: they give the system that lies in y.
def dynamics(t: float, y: Floats, p: Parameters, out: Floats) -> None:  # noqa: ARG001
    """Store M, A, f, b."""
    n = p.n
    m = p.m
    for i in range(n * n + n * m + n + m):
        out[i] = y[i]


def geometry(t: float, y: Floats, p: Parameters, out: Floats) -> None:  # noqa: ARG001
    """Store M, A, residuals (from b), rates (twice these), the scales 1 of both."""
    n = p.n
    m = p.m
    for i in range(n * n + n * m):
        out[i] = y[i]
    residuals = out[n * n + n * m :]
    for i in range(m):
        residuals[i] = y[n * n + n * m + n + i]
        residuals[m + i] = 2.0 * residuals[i]
        residuals[2 * m + i] = residuals[3 * m + i] = 1.0


def second_order(t: float, y: Floats, p: Parameters, out: Floats) -> None:  # noqa: ARG001
    """Store the residuals that remain after Newton steps."""
    for i in range(p.m):
        out[i] = 0.125 / (1.0 + i)
        out[p.m + i] = 0.125 * (1.0 + i)


def solve(t: float, y: Floats, p: Parameters, out: Floats) -> None:  # noqa: ARG001
    """Leave q'' and lambda in p."""
    solve_motion(t, y, p)


KERNELS = (solve, position_step, velocity_step)
MODEL = {"dynamics": dynamics, "geometry": geometry, "second_order": second_order}


def plain(name: str, y: Floats, p: Parameters, out: Floats) -> None:
    kernel = next(k for k in KERNELS if k.__name__ == name)
    bind(kernel, MODEL)(0.0, y, p, out)


def compiled(whole: bool) -> Any:
    """Return the compiled kernels: of rows by their reaches, or of whole rows."""
    statics = {"WHOLE": whole}
    engine = Engine([cache.kernel_part([*KERNELS, *MODEL.values()], statics).object])
    pointer = ctypes.c_void_p

    def call(name: str, y: Floats, p: Parameters, out: Floats) -> None:
        kinds = (ctypes.c_double, pointer, pointer, pointer)
        function = engine.function(name, None, kinds)
        function(0.0, y.ctypes.data, p.flat.ctypes.data, out.ctypes.data)

    return call


@pytest.fixture(scope="module")
def native() -> Any:
    return compiled(whole=False)


@pytest.fixture(scope="module")
def whole() -> Any:
    return compiled(whole=True)


@pytest.fixture(params=["plain", "native", "whole"])
def call(request: pytest.FixtureRequest) -> Any:
    return plain if request.param == "plain" else request.getfixturevalue(request.param)


@dataclass(frozen=True)
class System:
    """M (n, n), A (m, n), f (n,), b (m,), and the data that a plan has about these."""

    M: Any
    A: Any
    f: Any
    b: Any
    augmented: bool = False
    expected: int | None = None
    reference: float = 0.0

    @property
    def arrays(self) -> tuple[Any, Any, Any]:
        m, n = self.A.shape
        parts = (self.M, self.A, self.f, self.b)
        y = np.concatenate([np.ravel(part) for part in parts])
        p = Parameters.allocate(n=n, m=m, size=2 * n, loops=1, reached=m)
        p = Parameters(np.concatenate([p.flat, GUARD]))
        whole = [(0, n)]  # every row may have any column
        RowPattern([0] * n, [whole] * m, [[]] * m).fill(p)
        rank = min(n, m) if self.expected is None else self.expected
        p.augmented, p.expected, p.reference = self.augmented, rank, self.reference
        p.least_sigma = 1.0
        return y, p, np.zeros(n + 3)

    def motion(self, call: Any) -> tuple[Any, Any]:
        """Return q'' and lambda."""
        y, p, out = self.arrays
        call("solve", y, p, out)
        assert p.flat[-4:].tolist() == GUARD  # no more memory than is declared
        return motion_in(p)


GUARD = [3.0, 1.0, 4.0, 1.0]


def motion_in(p: Any) -> tuple[Any, Any]:
    return p.motion[: p.n].copy(), p.multipliers.copy()


def random_system(seed: int, n: int, m: int, rank: int | None = None) -> System:
    """Return a consistent system with rows of the given rank."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(n, n))
    M = root @ root.T + np.eye(n)
    rank = m if rank is None else rank
    A = random.normal(size=(m, rank)) @ random.normal(size=(rank, n))
    return System(M, A, random.normal(size=n), A @ random.normal(size=n))


def least_norm(x: System) -> tuple[Any, Any]:
    """Return q'' and the shortest lambda, by the null space of A and lstsq."""
    _, sizes, V = np.linalg.svd(x.A)
    rank = int(np.sum(sizes > 1e-9 * sizes[0])) if len(sizes) else 0
    free = V[rank:].T
    particular = np.linalg.lstsq(x.A, x.b, rcond=1e-9)[0]
    reduced = free.T @ x.M @ free
    moved = free @ np.linalg.solve(reduced, free.T @ (x.f - x.M @ particular))
    q_ddot = particular + moved
    lam = np.linalg.lstsq(x.A.T, x.M @ q_ddot - x.f, rcond=1e-9)[0]
    return q_ddot, lam


def close(found: Any, expected: Any, tolerance: float) -> None:
    scale = np.max(np.abs(expected), initial=0.0)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance * scale)


@pytest.mark.parametrize(("n", "m"), [(1, 0), (1, 1), (3, 1), (4, 4), (9, 5)])
def test_full_rank(call: Any, n: int, m: int) -> None:
    for seed in range(4):
        x = random_system(seed, n, m)
        # A few hundred roundings, times the condition of random rows.
        lost = np.linalg.cond(x.A) if m else 1.0
        for found, expected in zip(x.motion(call), least_norm(x), strict=True):
            close(found, expected, 1e-14 * lost)


@pytest.mark.parametrize(
    ("n", "m", "rank"), [(3, 2, 1), (4, 4, 2), (5, 7, 3), (2, 5, 2), (6, 4, 0)]
)
def test_redundant_rows_get_the_shortest_lambda(
    call: Any, n: int, m: int, rank: int
) -> None:
    for seed in range(4):
        x = random_system(seed, n, m, rank)
        for known in (rank, None):  # known beforehand, or found
            motion = replace(x, expected=known).motion(call)
            for found, expected in zip(motion, least_norm(x), strict=True):
                close(found, expected, 1e-11)


@pytest.mark.parametrize("angle", [1e-3, 1e-5, 1e-7])
def test_nearly_parallel_rows_keep_their_digits(call: Any, angle: float) -> None:
    for seed in range(4):
        random = np.random.default_rng(seed)
        n = 5
        u, v = np.linalg.qr(random.normal(size=(n, 2)))[0].T
        M = np.diag(random.uniform(0.5, 2.0, n))
        A = np.array([u, u + angle * v])
        difference = A[1] - A[0]  # exact, by Sterbenz's lemma
        start = random.normal(size=n)
        b = np.array([A[0] @ start, A[0] @ start + difference @ start])
        x = System(M, A, random.normal(size=n), b)
        q_ddot, lam = x.motion(call)
        # The same constraints by orthogonal rows: what is given exactly is known to
        # b's own rounding, magnified by 1/angle once, not twice.
        other = System(
            M, np.array([u, difference / angle]), x.f,
            np.array([b[0], (b[1] - b[0]) / angle]),
        )  # fmt: skip
        expected, _ = least_norm(other)
        close(q_ddot, expected, 50 * ROUNDING / angle)
        balance = M @ q_ddot - x.f - A.T @ lam
        assert np.max(np.abs(balance)) <= 50 * ROUNDING * np.max(np.abs(lam))


@pytest.mark.parametrize("scales", [(1e-8, 1e8), (1e8, 1e8), (1e-8, 1e-8), (1e-3, 7.0)])
def test_the_scale_of_a_row_changes_nothing(
    call: Any, scales: tuple[float, float]
) -> None:
    for rank in (3, 2):
        x = random_system(5, 6, 3, rank)
        d = np.array([*scales, 1.0])
        scaled = replace(x, A=d[:, None] * x.A, b=d * x.b)
        q_ddot, lam = x.motion(call)
        q_ddot_scaled, lam_scaled = scaled.motion(call)
        close(q_ddot_scaled, q_ddot, 1e-12)
        close(scaled.A.T @ lam_scaled, x.A.T @ lam, 1e-12)
        if rank == 3:
            close(d * lam_scaled, lam, 1e-12)


def singular_mass(seed: int, n: int, m: int) -> System:
    """Return a system whose M has rank n - m + 1, and [M; A] full column rank."""
    random = np.random.default_rng(seed)
    root = random.normal(size=(n, n - m + 1))
    A = random.normal(size=(m, n))
    x = System(root @ root.T, A, random.normal(size=n), A @ random.normal(size=n))
    return replace(x, augmented=True)


@pytest.mark.parametrize(("n", "m"), [(2, 2), (4, 2), (6, 3), (7, 5)])
def test_singular_mass_matrix(call: Any, n: int, m: int) -> None:
    for seed in range(4):
        x = singular_mass(seed, n, m)
        q_ddot, lam = x.motion(call)
        kkt = np.block([[x.M, x.A.T], [x.A, np.zeros((m, m))]])
        expected = np.linalg.solve(kkt, np.concatenate([x.f, x.b]))
        lost = 1e-15 * np.linalg.cond(kkt)
        close(q_ddot, expected[:n], 100 * lost)
        close(lam, -expected[n:], 100 * lost)


def test_a_mass_matrix_that_is_not_positive_gives_nan(call: Any) -> None:
    x = random_system(3, 3, 1)
    q_ddot, _ = replace(x, M=-x.M).motion(call)
    assert np.all(np.isnan(q_ddot))


def test_corrections_are_least_in_the_metric_of_the_mass(call: Any) -> None:
    for rank in (3, 2):
        x = random_system(7, 5, 3, rank)
        y, p, out = x.arrays
        call("position_step", y, p, out)
        # The least change has no force but the constraints': M dq = A^T mu, A dq = -g.
        expected, _ = least_norm(replace(x, f=np.zeros(5), b=-x.b))
        close(out[:5], expected, 1e-12)
        largest = np.max(np.abs(x.b))
        assert out[[5, 7]].tolist() == [largest, 0.125]
        call("velocity_step", y, p, out)
        close(out[:5], 2 * expected, 1e-12)
        assert out[[5, 7]].tolist() == [2 * largest, 0.375]


def test_rows_redundant_in_general_stay_so_off_the_constraints(call: Any) -> None:
    whole = random_system(11, 5, 2)
    twice = replace(whole, A=whole.A[[0, 1, 1]], b=whole.b[[0, 1, 1]])
    # At the stages of a step redundant rows are redundant no more, and contradict.
    random = np.random.default_rng(0)
    off = replace(
        twice,
        A=twice.A + 1e-6 * random.normal(size=(3, 5)),
        b=twice.b + 1e-6 * random.normal(size=3),
    )
    exact, _ = whole.motion(call)
    naive, _ = off.motion(call)
    q_ddot, _ = replace(off, expected=2).motion(call)
    assert np.max(np.abs(naive - exact)) > 1e-2
    # The rows are off by 1e-6 and well conditioned.
    assert np.max(np.abs(q_ddot - exact)) < 1e-4


def nearly_parallel(angle: float) -> System:
    random = np.random.default_rng(4)
    u, v = np.linalg.qr(random.normal(size=(5, 2)))[0].T
    A = np.array([u, u + angle * v])
    return System(np.eye(5), A, random.normal(size=5), np.array([0.3, 0.3 + 1e-9]))


def test_rank_lost_on_the_way_is_seen_against_what_it_was(call: Any) -> None:
    # In a model whose rows were far from parallel, it is noise that is left of their
    # independence; in one where they always were that close, it is digits.
    angle = LOST_RANK / 10
    assert angle > 2 * DEPENDENT_ROWS
    passing = replace(nearly_parallel(angle), reference=1.0)
    q_ddot, lam = passing.motion(call)
    expected, _ = least_norm(replace(passing, A=passing.A[:1], b=passing.b[:1]))
    assert q_ddot == pytest.approx(expected, abs=10 * angle)
    assert np.max(np.abs(lam)) < 10
    always = replace(passing, reference=angle)
    q_ddot, lam = always.motion(call)
    residuals = always.A @ q_ddot - always.b
    assert residuals == pytest.approx([0, 0], abs=1e-15)
    assert np.max(np.abs(lam)) > 1e6


def test_health_is_kept_in_mind(call: Any) -> None:
    for angle in (1.0, 1e-2, 1e-5):
        y, p, out = nearly_parallel(angle).arrays
        call("velocity_step", y, p, out)
        # Rows of length 1, the second of which pivots to its part across the first.
        u, v = nearly_parallel(angle).A
        sine = np.sqrt(1 - (u @ v) ** 2 / (v @ v)) if angle == 1.0 else angle
        assert out[6] == p.sigma == pytest.approx(sine, rel=1e-3)
        assert p.reference == out[6]
    y, p, out = replace(nearly_parallel(1e-2), reference=0.5).arrays
    call("velocity_step", y, p, out)
    assert p.reference == 0.5


def test_a_row_that_vanishes_on_the_way_is_measured_by_its_past(call: Any) -> None:
    x = random_system(12, 4, 2)
    fading = replace(x, A=x.A * [[1.0], [1e-8]], b=x.b * [1.0, 1.0], reference=1.0)
    one = replace(x, A=x.A[:1], b=x.b[:1])
    y, p, out = replace(x, reference=1.0).arrays
    call("velocity_step", y, p, out)  # as of a state on the way
    call("solve", fading.arrays[0], p, out)
    q_ddot, lam = motion_in(p)
    expected, _ = least_norm(one)
    # The row still takes its share, 1e-8 of the other's, of the least lambda.
    assert q_ddot == pytest.approx(expected, rel=1e-6, abs=1e-6)
    assert np.all(np.isfinite(lam))


def test_reflections_leave_no_rounding_in_what_a_row_does_not_join(call: Any) -> None:
    # Bystanders of 1e-12 kg, named first, beside a part with large forces.
    for seed in range(4):
        x = random_system(seed, 6, 3)
        M, A = np.eye(9) * 1e-12, np.zeros((3, 9))
        M[3:, 3:], A[:, 3:] = x.M, x.A
        f = np.concatenate([np.zeros(3), 1e6 * x.f])
        q_ddot, _ = System(M, A, f, x.b).motion(call)
        assert np.all(q_ddot[:3] == 0.0)
        close(q_ddot[3:], least_norm(replace(x, f=1e6 * x.f))[0], 1e-12)
